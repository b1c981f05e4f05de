//! The questions that [`super::bounded`] puts to a panel: its modes.

use super::bounded::{BoundedAnswer, ComparedValues, RefinableQuestion, answer_with_error_bounds};
use super::estimator::FrequencyRounding;
use super::panel::{PanelMode, PanelModel};
use super::poles::Pole;
use super::{Accuracy, Bound, ModelError};
use crate::scene::Scene;
use std::f64::consts::TAU;

/// Coarser levels have higher frequencies: they are asked this much further, so that each mode finds its like.
const FURTHER: f64 = 1.3;
/// Relative error of a frequency that was computed with a surface that stays straight, in the order of what springs were
/// allowed to be soft against it.
const STRAIGHT: f64 = 1e-6;

/// Times the estimate of a frequency: a pole's error goes with those of shapes, as a response's does.
const POLE_SAFETY: f64 = 8.0;
/// Highest modulus of a pole that has a bound, as a multiple of the highest frequency asked for.
const RESOLVED: f64 = 2.0;
/// Modes of the coarser level whose pole may be the one that a finer level's is compared with, relative: of two as near to each other either may
/// have either.
const SAME_MODE: f64 = 0.01;

/// Modes up to a frequency: what is compared are their frequencies, then their poles.
struct ModesUpTo(f64);

impl ModesUpTo {
    fn modes_within_limit<'a>(&self, fine: &'a [PanelMode]) -> &'a [PanelMode] {
        &fine[..fine.iter().take_while(|mode| mode.frequency_hz <= self.0).count()]
    }

    /// Whether a pole is far above all modes that are known: what it is depends on every finer mesh, unless it is that of a mode by itself.
    fn is_pole_coupled_and_far_above_limit(&self, pole: &Pole) -> bool {
        pole.is_coupled && pole.s.norm() > TAU * RESOLVED * self.0
    }

    /// Whether a pole is one of the mesh: on a motion that dies out before it swings, and fast, levels do not agree. Beside a dashpot at a point there is less
    /// mass the finer the mesh, and no limit.
    fn has_bounded_frequency_but_unbounded_overdamped_coupled_pole(
        &self,
        mode: &PanelMode,
        frequency_bound: Bound,
    ) -> bool {
        let is_told = mode.pole_bound.limit_if_known().is_some() || frequency_bound.limit_if_known().is_none();
        let is_left_out = !mode.pole.is_whole && !self.is_pole_coupled_and_far_above_limit(&mode.pole);
        !is_told && !is_left_out && mode.pole.is_coupled && mode.pole.is_overdamped_or_nearly()
    }
}

impl RefinableQuestion for ModesUpTo {
    type Answer = Vec<PanelMode>;
    type Error = ModelError;

    fn answer_from_model(&self, model: &PanelModel) -> Result<Vec<PanelMode>, ModelError> {
        model.compute_mode_frequencies_and_poles(FURTHER * self.0)
    }

    /// For each mode of the fine level up to the frequency: relative for an elastic one, 0 for a rigid one, whose
    /// frequency is exact. Then the same for its pole.
    fn relative_difference_of_each_part(&self, coarse: &Vec<PanelMode>, fine: &Vec<PanelMode>) -> Vec<f64> {
        let listed = self.modes_within_limit(fine);
        let of_frequency = |(k, fine): (usize, &PanelMode)| match coarse.get(k) {
            _ if fine.frequency_hz == 0.0 => 0.0,
            Some(coarse) => (coarse.frequency_hz / fine.frequency_hz - 1.0).abs(),
            None => f64::INFINITY,
        };
        let of_pole = |fine: &PanelMode| {
            if fine.frequency_hz == 0.0 {
                return 0.0;
            }
            if !fine.pole.is_known() || self.is_pole_coupled_and_far_above_limit(&fine.pole) {
                return f64::INFINITY;
            }
            let is_near = |coarse: &&PanelMode| (coarse.frequency_hz / fine.frequency_hz - 1.0).abs() < SAME_MODE;
            let distances =
                coarse.iter().filter(is_near).map(|coarse| fine.pole.relative_distance_or_infinity_to(&coarse.pole));
            POLE_SAFETY * distances.fold(f64::INFINITY, f64::min)
        };
        listed.iter().enumerate().map(of_frequency).chain(listed.iter().map(of_pole)).collect()
    }

    fn count_leading_parts_that_decide_refinement(&self, parts: usize) -> usize {
        parts / 2
    }

    fn kind_of_compared_values(&self) -> ComparedValues {
        ComparedValues::Frequencies
    }

    fn error_floor_of_each_part(&self, fine: &Vec<PanelMode>, rounding: FrequencyRounding) -> Vec<f64> {
        let floor = |mode: &PanelMode| match mode {
            _ if mode.frequency_hz == 0.0 => 0.0,
            _ if mode.straight => STRAIGHT,
            _ => rounding.relative_frequency_error_no_finer_mesh_removes_at(mode.unloaded_hz),
        };
        let listed = self.modes_within_limit(fine);
        listed.iter().chain(listed).map(floor).collect()
    }
}

/// All modes up to `max_hz`, with a bound for each: relative to its frequency, for a rigid motion absolute in Hz (and 0). What is asked for is an accuracy of
/// frequencies; the poles are told with what bound comes of it, without those of which a finer mesh would say anything else
/// ([`Pole::keep_slower_eigenvalue_and_mark_rest_unknown`]).
///
/// # Errors
/// [`ModelError`]: a frequency out of range, too many unknowns, matrices that cannot be factored.
pub fn compute_modes_with_error_bounds(
    scene: &Scene,
    accuracy: Accuracy,
    max_hz: f64,
) -> Result<BoundedAnswer<Vec<PanelMode>>, ModelError> {
    let question = ModesUpTo(max_hz);
    let mut found = answer_with_error_bounds(&question, scene, accuracy, max_hz)?;
    found.answer.retain(|mode| mode.frequency_hz <= max_hz);
    let of_poles = found.bounds.split_off(found.answer.len().min(found.bounds.len()));
    for ((mode, frequency), bound) in found.answer.iter_mut().zip(&found.bounds).zip(of_poles) {
        mode.pole_bound = bound;
        if question.has_bounded_frequency_but_unbounded_overdamped_coupled_pole(mode, *frequency) {
            mode.pole = mode.pole.keep_slower_eigenvalue_and_mark_rest_unknown();
            mode.damping_ratio = mode.pole.damping_ratio;
        }
    }
    Ok(found)
}
