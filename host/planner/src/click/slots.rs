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
    /// `force_lines_s` has the Fourier integrals of each actuator's force over time at 1, 2, ... Hz.
    fn new(
        residues: &PointResidues,
        slot_samples: usize,
        pole_factor: impl Fn(f64) -> f64,
        force_lines_s: &[Vec<Complex64>],
    ) -> Self {
        let last_hz = u32::try_from(LAST_LINE).unwrap_or(u32::MAX);
        let record = |(accelerations, lines_s): (Vec<Complex64>, &Vec<Complex64>)| {
            let spectrum = accelerations.into_iter().zip(lines_s).map(|(acceleration, line_s)| acceleration * line_s);
            weigh_spectrum_and_transform_to_felt_record(spectrum).repeat(2)
        };
        let records = residues
            .accelerations_per_n_by_point_and_actuator_from_1_hz_poles_scaled(last_hz, pole_factor)
            .into_iter()
            .zip(force_lines_s)
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
pub fn compute_slot_responses_to_constant_forces(
    residues: &PointResidues,
    actuators: usize,
    slot_samples: usize,
) -> SlotResponses {
    #[expect(clippy::cast_precision_loss, reason = "some samples")]
    let slot_s = slot_samples as f64 * SAMPLE_S;
    let line_s = |jw: Complex64| (1.0 - (-jw * slot_s).exp()) / jw;
    let lines_s: Vec<Complex64> = list_felt_lines_rad_s().map(|omega| line_s(Complex64::new(0.0, omega))).collect();
    SlotResponses::new(residues, slot_samples, |_| 1.0, &vec![lines_s; actuators])
}

/// The angular frequencies of the lines that are felt: of 1, 2, ... Hz.
fn list_felt_lines_rad_s() -> impl Iterator<Item = f64> {
    let last_hz = u32::try_from(LAST_LINE).unwrap_or(u32::MAX);
    (1..=last_hz).map(|hz| TAU * f64::from(hz))
}

/// Fourier integrals in s, at 1, 2, ... Hz, of the force of the widest window in a slot, whose mean over the slot is 1 N.
#[must_use]
pub fn list_spectral_lines_of_force_of_widest_window_s(times: ChargingTimes) -> Vec<Complex64> {
    let mean = integrate_squared_relative_voltage_of_window_s(times, WIDEST_S) / SLOT_S;
    let line_s = |omega| fourier_integral_of_squared_relative_voltage_of_window_s(times, WIDEST_S, omega) / mean;
    list_felt_lines_rad_s().map(line_s).collect()
}

/// The panel of the scene, and four panels off it: all frequencies higher or lower, and those of the panel on its springs one way with
/// those of its bending the other way. The spectral lines of each actuator's force are given
/// ([`list_spectral_lines_of_force_of_widest_window_s`]).
#[must_use]
pub fn compute_slot_responses_of_nominal_and_four_detuned_panels(
    residues: &PointResidues,
    window_lines_s: &[Vec<Complex64>],
) -> Vec<SlotResponses> {
    let slowest: Vec<f64> = residues.vibrating_pole_frequencies_hz().take(ON_SPRINGS).collect();
    let step = |pair: &[f64]| pair.first().zip(pair.last()).map_or(0.0, |(low, high)| high / low);
    let widest = slowest.windows(2).max_by(|a, b| step(a).total_cmp(&step(b)));
    let split_hz = widest.and_then(|pair| pair.first().zip(pair.last())).map_or(0.0, |(low, high)| (low * high).sqrt());
    [(0.0, 0.0), (OFF, OFF), (-OFF, -OFF), (OFF, -OFF), (-OFF, OFF)]
        .into_iter()
        .map(|(springs, bending)| {
            let pole_factor = |hz: f64| 1.0 + if hz < split_hz { springs } else { bending };
            SlotResponses::new(residues, SLOT_SAMPLES, pole_factor, window_lines_s)
        })
        .collect()
}
