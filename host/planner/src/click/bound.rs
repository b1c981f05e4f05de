//! The strongest crisp click that no drive of these actuators exceeds.
//!
//! Free forces between -F and F, F that of an electrode at its highest voltage with the mass at rest, in pieces of 0.5 ms for 30 ms on every
//! actuator. The felt acceleration at the place has its peak 8, 12 or 15 ms after the beginning, is at no time larger, and stays below a tenth
//! of the peak from the time asked for on. Left out are dead time, charging of the electrodes, the number of windows, the growth of
//! forces as gaps close, travel, the supply's current, and panels off the scene.

use super::felt::SAMPLE_S;
use super::measures::QUIET;
use super::program::{ForceProgram, MotionBounds, SlotForce, TargetResponses};
use super::slots::compute_slot_responses_to_constant_forces;
use crate::physics::rise::PointResidues;

/// Samples of a piece.
const PIECE_SAMPLES: usize = 2;
/// Pieces.
const PIECES: usize = 60;
/// Samples at which the peak may come.
const PEAKS: [usize; 3] = [32, 48, 60];
/// What panels off the scene may do: there are none.
const ANYTHING: f64 = f64::INFINITY;

/// That peak in m/s^2, for forces of at most `forces_n` N; quiet from `crisp_s` on. `None` if a programme does not end.
#[must_use]
pub fn bound_crisp_click_peak_if_solved_m_per_s2(
    residues: &PointResidues,
    forces_n: &[f64],
    crisp_s: f64,
) -> Option<f64> {
    let panels = [compute_slot_responses_to_constant_forces(residues, forces_n.len(), PIECE_SAMPLES)];
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundred samples")]
    let quiet_sample = (crisp_s / SAMPLE_S).round() as usize;
    let free = |(actuator, force_n): (usize, &f64)| {
        let force_n = *force_n;
        (0..PIECES).map(move |slot| SlotForce { actuator, slot, force_n, bounds: (-1.0, 1.0), cost: 0.0 })
    };
    let forces: Vec<SlotForce> =
        forces_n.iter().enumerate().filter(|(_, force_n)| **force_n > 0.0).flat_map(free).collect();
    let peak = |peak_sample: usize| {
        let bounds = MotionBounds { peak_sample, quiet_sample, before: [1.0, ANYTHING], after: [QUIET, ANYTHING] };
        let targets = vec![TargetResponses { panels: &panels, factor: 1.0, besides: &[] }];
        let program = ForceProgram { targets, forces: forces.clone(), bounds, asked: 1.0, first: &[] };
        program.find_largest_peak().map(|solved| solved.goal)
    };
    let peaks = PEAKS.into_iter().filter(|sample| *sample < quiet_sample).map(peak).collect::<Option<Vec<f64>>>()?;
    Some(peaks.into_iter().fold(0.0, f64::max))
}
