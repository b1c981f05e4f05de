//! A word by which whoever asked a long question ends it.
//!
//! It is of the thread that asks: questions look for it where they are on that thread, between levels and before they divide
//! their work.

use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

thread_local! {
    /// Of the question that this thread is at.
    static CURRENT: RefCell<Stop> = RefCell::default();
}

/// Whether an answer is still waited for.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Nobody waits any more.
    pub fn ask(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether nobody waits.
    #[must_use]
    pub fn is_asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// That of the question that this thread is at; one that is never asked outside of any.
    #[must_use]
    pub fn current() -> Self {
        CURRENT.with_borrow(Self::clone)
    }

    /// Asks a question that this ends.
    pub fn during<T>(&self, question: impl FnOnce() -> T) -> T {
        // Put back by a panic too.
        struct Before(Stop);
        impl Drop for Before {
            fn drop(&mut self) {
                CURRENT.set(std::mem::take(&mut self.0));
            }
        }
        let _before = Before(CURRENT.replace(self.clone()));
        question()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Accuracy, ModelError, bounded_modes};
    use crate::response::{CurveError, bounded_curves};
    use crate::scene::{EXAMPLE_BAR, Scene};

    #[test]
    fn a_question_that_is_stopped_has_no_answer() {
        let scene = Scene::parse("bar", EXAMPLE_BAR).unwrap();
        let stop = Stop::default();
        let modes = || bounded_modes(&scene, Accuracy::FAST, 300.0);
        assert!(stop.during(modes).is_ok());
        stop.ask();
        assert_eq!(stop.during(modes).unwrap_err(), ModelError::Stopped);
        let curves = stop.during(|| bounded_curves(&scene, Accuracy::FAST, (0.1, 0.01), &[100.0]));
        assert_eq!(curves.unwrap_err(), CurveError::Model(ModelError::Stopped));
        // Others on this thread are not, and within it neither.
        assert!(modes().is_ok() && stop.during(|| Stop::default().during(modes)).is_ok());
    }

    /// A level that was found before is no answer to somebody who has gone.
    #[test]
    fn a_question_that_is_stopped_on_its_way_has_no_answer() {
        struct Once(Stop);
        impl crate::model::bounded::Question for Once {
            type Answer = usize;
            type Error = ModelError;
            fn ask(&self, model: &crate::model::PanelModel) -> Result<usize, ModelError> {
                self.0.ask();
                Ok(model.dofs())
            }
            fn ask_to_compare(&self, model: &crate::model::PanelModel) -> Result<usize, ModelError> {
                Ok(model.dofs())
            }
            fn differences(&self, _: &usize, _: &usize) -> Vec<f64> {
                vec![1.0]
            }
            fn values(&self) -> crate::model::bounded::Values {
                crate::model::bounded::Values::Frequencies
            }
            fn floors(&self, _: &usize, _: crate::model::estimator::Rounding) -> Vec<f64> {
                vec![0.0]
            }
        }
        let scene = Scene::parse("bar", EXAMPLE_BAR).unwrap();
        let stop = Stop::default();
        let found = stop.during(|| crate::model::bounded::bounded(&Once(stop.clone()), &scene, Accuracy::FAST, 300.0));
        assert_eq!(found.unwrap_err(), ModelError::Stopped);
    }
}
