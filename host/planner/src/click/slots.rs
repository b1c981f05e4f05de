//! What a place does for a force of 1 N over one slot of time.

use super::felt::{LAST_LINE, RECORD, SAMPLE_S, weigh_spectrum_and_transform_to_felt_record};
use crate::physics::rise::PointResidues;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// How far the frequencies of a panel off its scene are off: modulus or springs 5 % off.
const OFF: f64 = 0.025;
/// Of so many of the slowest poles, those before the widest step are the motions of the panel on its springs.
const ON_SPRINGS: usize = 7;

/// The felt acceleration of one place for a force of 1 N over a slot that begins at time 0, of every actuator.
#[derive(Clone, Debug)]
pub struct SlotResponses {
    /// Samples of a slot.
    slot_samples: usize,
    /// Actuators x samples, in m/s^2 per N; every record twice, so that each of its samples can be the first.
    records: Vec<Vec<f64>>,
}

impl SlotResponses {
    /// Of slots with so many samples; `pole_factor` as in [`PointResidues::accelerations_per_n_by_point_and_actuator_from_1_hz_poles_scaled`].
    fn new(residues: &PointResidues, slot_samples: usize, pole_factor: impl Fn(f64) -> f64) -> Self {
        #[expect(clippy::cast_precision_loss, reason = "some samples")]
        let slot_s = slot_samples as f64 * SAMPLE_S;
        let last_hz = u32::try_from(LAST_LINE).unwrap_or(u32::MAX);
        let record = |accelerations: Vec<Complex64>| {
            let spectrum = accelerations.into_iter().zip(1_u32..).map(|(acceleration, hz)| {
                let jw = Complex64::new(0.0, TAU * f64::from(hz));
                acceleration * (1.0 - (-jw * slot_s).exp()) / jw
            });
            weigh_spectrum_and_transform_to_felt_record(spectrum).repeat(2)
        };
        let records = residues
            .accelerations_per_n_by_point_and_actuator_from_1_hz_poles_scaled(last_hz, pole_factor)
            .into_iter()
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

/// The panel of the scene alone.
#[must_use]
pub fn compute_slot_responses(residues: &PointResidues, slot_samples: usize) -> SlotResponses {
    SlotResponses::new(residues, slot_samples, |_| 1.0)
}

/// The panel of the scene, and four panels off it: all frequencies higher or lower, and those of the panel on its springs one way with
/// those of its bending the other way.
#[must_use]
pub fn compute_slot_responses_of_nominal_and_four_detuned_panels(
    residues: &PointResidues,
    slot_samples: usize,
) -> Vec<SlotResponses> {
    let slowest: Vec<f64> = residues.vibrating_pole_frequencies_hz().take(ON_SPRINGS).collect();
    let step = |pair: &[f64]| pair.first().zip(pair.last()).map_or(0.0, |(low, high)| high / low);
    let widest = slowest.windows(2).max_by(|a, b| step(a).total_cmp(&step(b)));
    let split_hz = widest.and_then(|pair| pair.first().zip(pair.last())).map_or(0.0, |(low, high)| (low * high).sqrt());
    [(0.0, 0.0), (OFF, OFF), (-OFF, -OFF), (OFF, -OFF), (-OFF, OFF)]
        .into_iter()
        .map(|(springs, bending)| {
            SlotResponses::new(residues, slot_samples, |hz| 1.0 + if hz < split_hz { springs } else { bending })
        })
        .collect()
}
