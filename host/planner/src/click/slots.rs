//! What a place does for the force of one slot of time, whose mean over the slot is 1 N.

use super::felt::{LAST_LINE, RECORD, SAMPLE_S, weigh_spectrum_and_transform_to_felt_record};
use super::realise::{
    SLOT_S, WIDEST_S, fourier_integral_of_squared_relative_voltage_of_window_s,
    integrate_squared_relative_voltage_of_window_s,
};
use crate::physics::rise::PointResidues;
use crate::scene::ChargingTimes;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Samples of a slot.
pub const SLOT_SAMPLES: usize = 4;
/// How far the frequencies of a panel off its scene are off: modulus or springs 5 % off.
const OFF: f64 = 0.025;
/// Of so many of the slowest poles, those before the widest step are the motions of the panel on its springs.
const ON_SPRINGS: usize = 7;

/// The felt acceleration of one place for a force whose mean over a slot that begins at time 0 is 1 N, of every actuator.
#[derive(Clone, Debug)]
pub struct SlotResponses {
    /// Samples of a slot.
    slot_samples: usize,
    /// Actuators x samples, in m/s^2 per N; every record twice, so that each of its samples can be the first.
    records: Vec<Vec<f64>>,
}

impl SlotResponses {
    /// Of slots with so many samples; `pole_factor` as in [`PointResidues::accelerations_per_n_by_point_and_actuator_from_1_hz_poles_scaled`].
    /// `fourier_integral_s` is that of an actuator's force over time, at an angular frequency.
    fn new(
        residues: &PointResidues,
        slot_samples: usize,
        pole_factor: impl Fn(f64) -> f64,
        fourier_integral_s: impl Fn(usize, f64) -> Complex64,
    ) -> Self {
        let last_hz = u32::try_from(LAST_LINE).unwrap_or(u32::MAX);
        let record = |(actuator, accelerations): (usize, Vec<Complex64>)| {
            let lines = accelerations.into_iter().zip(1_u32..);
            let spectrum =
                lines.map(|(acceleration, hz)| acceleration * fourier_integral_s(actuator, TAU * f64::from(hz)));
            weigh_spectrum_and_transform_to_felt_record(spectrum).repeat(2)
        };
        let records = residues
            .accelerations_per_n_by_point_and_actuator_from_1_hz_poles_scaled(last_hz, pole_factor)
            .into_iter()
            .enumerate()
            .map(record)
            .collect();
        Self { slot_samples, records }
    }

    /// Acceleration in m/s^2, sample by sample, for 1 N of an actuator over the slot with this number, from 0.
    #[must_use]
    pub fn acceleration_record_per_n_over_slot(&self, actuator: usize, slot: usize) -> &[f64] {
        let first = RECORD - slot * self.slot_samples % RECORD;
        self.records.get(actuator).and_then(|record| record.get(first..first + RECORD)).unwrap_or(&[])
    }
}

/// The panel of the scene alone, with forces that are constant over slots of so many samples.
#[must_use]
pub fn compute_slot_responses_to_constant_forces(residues: &PointResidues, slot_samples: usize) -> SlotResponses {
    #[expect(clippy::cast_precision_loss, reason = "some samples")]
    let slot_s = slot_samples as f64 * SAMPLE_S;
    let of_slot = |_: usize, omega_rad_s: f64| {
        let jw = Complex64::new(0.0, omega_rad_s);
        (1.0 - (-jw * slot_s).exp()) / jw
    };
    SlotResponses::new(residues, slot_samples, |_| 1.0, of_slot)
}

/// The panel of the scene, and four panels off it: all frequencies higher or lower, and those of the panel on its springs one way with
/// those of its bending the other way. The forces are those of the widest windows of electrodes that charge in these times.
#[must_use]
pub fn compute_slot_responses_of_nominal_and_four_detuned_panels(
    residues: &PointResidues,
    charging: &[ChargingTimes],
) -> Vec<SlotResponses> {
    let slowest: Vec<f64> = residues.vibrating_pole_frequencies_hz().take(ON_SPRINGS).collect();
    let step = |pair: &[f64]| pair.first().zip(pair.last()).map_or(0.0, |(low, high)| high / low);
    let widest = slowest.windows(2).max_by(|a, b| step(a).total_cmp(&step(b)));
    let split_hz = widest.and_then(|pair| pair.first().zip(pair.last())).map_or(0.0, |(low, high)| (low * high).sqrt());
    let of_window = |actuator: usize, omega_rad_s: f64| {
        let times = charging.get(actuator).copied().unwrap_or_default();
        let mean = integrate_squared_relative_voltage_of_window_s(times, WIDEST_S) / SLOT_S;
        fourier_integral_of_squared_relative_voltage_of_window_s(times, WIDEST_S, omega_rad_s) / mean
    };
    [(0.0, 0.0), (OFF, OFF), (-OFF, -OFF), (OFF, -OFF), (-OFF, OFF)]
        .into_iter()
        .map(|(springs, bending)| {
            let pole_factor = |hz: f64| 1.0 + if hz < split_hz { springs } else { bending };
            SlotResponses::new(residues, SLOT_SAMPLES, pole_factor, of_window)
        })
        .collect()
}
