//! The questions that [`super::bounded`] puts to a panel: its modes.

use super::bounded::{Bounded, Question, Values, bounded};
use super::estimator::Rounding;
use super::panel::{Mode, PanelModel};
use super::{Accuracy, ModelError};
use crate::scene::Scene;

/// Coarser levels have higher frequencies: they are asked this much further, so that each mode finds its like.
const FURTHER: f64 = 1.3;
/// Relative error of a frequency that was computed with a surface that stays straight, in the order of what springs were
/// allowed to be soft against it.
const STRAIGHT: f64 = 1e-6;

struct ModesUpTo(f64);

impl Question for ModesUpTo {
    type Answer = Vec<Mode>;
    type Error = ModelError;

    fn ask(&self, model: &PanelModel) -> Result<Vec<Mode>, ModelError> {
        model.modes(FURTHER * self.0)
    }

    /// For each mode of the fine level up to the frequency: relative for an elastic one, 0 for a rigid one, whose
    /// frequency is exact.
    fn differences(&self, coarse: &Vec<Mode>, fine: &Vec<Mode>) -> Vec<f64> {
        let listed = fine.iter().take_while(|mode| mode.frequency_hz <= self.0);
        listed
            .enumerate()
            .map(|(k, fine)| match coarse.get(k) {
                _ if fine.frequency_hz == 0.0 => 0.0,
                Some(coarse) => (coarse.frequency_hz / fine.frequency_hz - 1.0).abs(),
                None => f64::INFINITY,
            })
            .collect()
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
        fine.iter().map(floor).collect()
    }
}

/// All modes up to `max_hz`, with a bound for each: relative to its frequency, for a rigid motion absolute in Hz (and 0).
///
/// # Errors
/// [`ModelError`]: a frequency out of range, too many unknowns, matrices that cannot be factored.
pub fn bounded_modes(scene: &Scene, accuracy: Accuracy, max_hz: f64) -> Result<Bounded<Vec<Mode>>, ModelError> {
    let mut found = bounded(&ModesUpTo(max_hz), scene, accuracy, max_hz)?;
    found.answer.retain(|mode| mode.frequency_hz <= max_hz);
    Ok(found)
}
