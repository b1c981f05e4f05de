//! The questions that [`super::bounded`] puts to a panel: its modes.

use super::bounded::{Bounded, Question, Values, bounded};
use super::estimator::Rounding;
use super::panel::{Mode, PanelModel};
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
    fn listed<'a>(&self, fine: &'a [Mode]) -> &'a [Mode] {
        &fine[..fine.iter().take_while(|mode| mode.frequency_hz <= self.0).count()]
    }

    /// Whether a pole is far above all modes that are known: what it is depends on every finer mesh, unless it is that of a mode by itself.
    fn is_beyond(&self, pole: &Pole) -> bool {
        pole.is_coupled && pole.s.norm() > TAU * RESOLVED * self.0
    }

    /// Whether a pole is one of the mesh: on a motion that dies out before it swings, and fast, levels do not agree. Beside a dashpot at a point there is less
    /// mass the finer the mesh, and no limit.
    fn is_of_the_mesh(&self, mode: &Mode, frequency: Bound) -> bool {
        let is_told = mode.pole_bound.value().is_some() || frequency.value().is_none();
        let is_left_out = !mode.pole.is_whole && !self.is_beyond(&mode.pole);
        !is_told && !is_left_out && mode.pole.is_coupled && mode.pole.dies_out()
    }
}

impl Question for ModesUpTo {
    type Answer = Vec<Mode>;
    type Error = ModelError;

    fn ask(&self, model: &PanelModel) -> Result<Vec<Mode>, ModelError> {
        model.modes(FURTHER * self.0)
    }

    /// For each mode of the fine level up to the frequency: relative for an elastic one, 0 for a rigid one, whose
    /// frequency is exact. Then the same for its pole.
    fn differences(&self, coarse: &Vec<Mode>, fine: &Vec<Mode>) -> Vec<f64> {
        let listed = self.listed(fine);
        let of_frequency = |(k, fine): (usize, &Mode)| match coarse.get(k) {
            _ if fine.frequency_hz == 0.0 => 0.0,
            Some(coarse) => (coarse.frequency_hz / fine.frequency_hz - 1.0).abs(),
            None => f64::INFINITY,
        };
        let of_pole = |fine: &Mode| {
            if fine.frequency_hz == 0.0 {
                return 0.0;
            }
            if !fine.pole.is_known() || self.is_beyond(&fine.pole) {
                return f64::INFINITY;
            }
            let is_near = |coarse: &&Mode| (coarse.frequency_hz / fine.frequency_hz - 1.0).abs() < SAME_MODE;
            let distances = coarse.iter().filter(is_near).map(|coarse| fine.pole.distance(&coarse.pole));
            POLE_SAFETY * distances.fold(f64::INFINITY, f64::min)
        };
        listed.iter().enumerate().map(of_frequency).chain(listed.iter().map(of_pole)).collect()
    }

    fn deciding(&self, parts: usize) -> usize {
        parts / 2
    }

    fn values(&self) -> Values {
        Values::Frequencies
    }

    fn floors(&self, fine: &Vec<Mode>, rounding: Rounding) -> Vec<f64> {
        let floor = |mode: &Mode| match mode {
            _ if mode.frequency_hz == 0.0 => 0.0,
            _ if mode.straight => STRAIGHT,
            _ => rounding.of(mode.unloaded_hz),
        };
        let listed = self.listed(fine);
        listed.iter().chain(listed).map(floor).collect()
    }
}

/// All modes up to `max_hz`, with a bound for each: relative to its frequency, for a rigid motion absolute in Hz (and 0). What is asked for is an accuracy of
/// frequencies; the poles are told with what bound comes of it, without those of which a finer mesh would say anything else
/// ([`Pole::without_faster`]).
///
/// # Errors
/// [`ModelError`]: a frequency out of range, too many unknowns, matrices that cannot be factored.
pub fn bounded_modes(scene: &Scene, accuracy: Accuracy, max_hz: f64) -> Result<Bounded<Vec<Mode>>, ModelError> {
    let question = ModesUpTo(max_hz);
    let mut found = bounded(&question, scene, accuracy, max_hz)?;
    found.answer.retain(|mode| mode.frequency_hz <= max_hz);
    let of_poles = found.bounds.split_off(found.answer.len().min(found.bounds.len()));
    for ((mode, frequency), bound) in found.answer.iter_mut().zip(&found.bounds).zip(of_poles) {
        mode.pole_bound = bound;
        if question.is_of_the_mesh(mode, *frequency) {
            mode.pole = mode.pole.without_faster();
            mode.damping_ratio = mode.pole.damping_ratio;
        }
    }
    Ok(found)
}
