//! A word by which whoever asked a long question ends it.
//!
//! It is of the thread that asks: questions look for it where they are on that thread, between levels and before they divide
//! their work.

use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

thread_local! {
    /// Of the question that this thread is at.
    static CURRENT: RefCell<StopRequest> = RefCell::default();
}

/// Whether an answer is still waited for.
#[derive(Clone, Debug, Default)]
pub struct StopRequest {
    is_requested: Arc<AtomicBool>,
    deadline: Option<Instant>,
}

impl StopRequest {
    /// One that is made by itself when the time is over.
    #[must_use]
    pub fn with_deadline(deadline: Instant) -> Self {
        Self { deadline: Some(deadline), ..Self::default() }
    }

    /// Asks the work to end: nobody waits for it any more.
    pub fn request_stop(&self) {
        self.is_requested.store(true, Ordering::Relaxed);
    }

    /// Whether somebody has asked the work to end.
    #[must_use]
    pub fn is_stop_requested_by_somebody(&self) -> bool {
        self.is_requested.load(Ordering::Relaxed)
    }

    /// Whether the work is to end: somebody has asked for that, or the time is over.
    #[must_use]
    pub fn is_stop_requested_or_deadline_over(&self) -> bool {
        self.is_stop_requested_by_somebody() || self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    /// The stop request of the work that this thread does; one that is never made outside of any.
    #[must_use]
    pub fn current_request_of_thread() -> Self {
        CURRENT.with_borrow(Self::clone)
    }

    /// Runs work that this request can end.
    pub fn run_with_self_as_current_stop_request_of_thread<T>(&self, question: impl FnOnce() -> T) -> T {
        // Put back by a panic too.
        struct Before(StopRequest);
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
    use crate::model::{Accuracy, ModelError, compute_modes_with_error_bounds};
    use crate::response::{CurveError, compute_acceleration_curves_per_newton_with_error_bounds};
    use crate::scene::{EXAMPLE_BAR, Scene};

    #[test]
    fn a_question_that_is_stopped_has_no_answer() {
        let scene = Scene::parse("bar", EXAMPLE_BAR).unwrap();
        let stop = StopRequest::default();
        let modes = || compute_modes_with_error_bounds(&scene, Accuracy::FAST, 300.0);
        assert!(stop.run_with_self_as_current_stop_request_of_thread(modes).is_ok());
        stop.request_stop();
        assert_eq!(stop.run_with_self_as_current_stop_request_of_thread(modes).unwrap_err(), ModelError::Stopped);
        let curves = stop.run_with_self_as_current_stop_request_of_thread(|| {
            compute_acceleration_curves_per_newton_with_error_bounds(&scene, Accuracy::FAST, (0.1, 0.01), &[100.0])
        });
        assert_eq!(curves.unwrap_err(), CurveError::Model(ModelError::Stopped));
        let late = StopRequest::with_deadline(Instant::now());
        assert_eq!(late.run_with_self_as_current_stop_request_of_thread(modes).unwrap_err(), ModelError::Stopped);
        assert!(late.is_stop_requested_or_deadline_over() && !late.is_stop_requested_by_somebody());
        // Others on this thread are not, and within it neither.
        assert!(
            modes().is_ok()
                && stop
                    .run_with_self_as_current_stop_request_of_thread(
                        || StopRequest::default().run_with_self_as_current_stop_request_of_thread(modes)
                    )
                    .is_ok()
        );
    }

    /// A level that was found before is no answer to somebody who has gone.
    #[test]
    fn a_question_that_is_stopped_on_its_way_has_no_answer() {
        struct Once(StopRequest);
        impl crate::model::bounded::RefinableQuestion for Once {
            type Answer = usize;
            type Error = ModelError;
            fn answer_from_model(&self, model: &crate::model::PanelModel) -> Result<usize, ModelError> {
                self.0.request_stop();
                Ok(model.count_unknowns())
            }
            fn answer_enough_for_comparison(&self, model: &crate::model::PanelModel) -> Result<usize, ModelError> {
                Ok(model.count_unknowns())
            }
            fn relative_difference_of_each_part(&self, _: &usize, _: &usize) -> Vec<f64> {
                vec![1.0]
            }
            fn kind_of_compared_values(&self) -> crate::model::bounded::ComparedValues {
                crate::model::bounded::ComparedValues::Frequencies
            }
            fn error_floor_of_each_part(&self, _: &usize, _: crate::model::estimator::FrequencyRounding) -> Vec<f64> {
                vec![0.0]
            }
        }
        let scene = Scene::parse("bar", EXAMPLE_BAR).unwrap();
        let stop = StopRequest::default();
        let found = stop.run_with_self_as_current_stop_request_of_thread(|| {
            crate::model::bounded::answer_with_error_bounds(&Once(stop.clone()), &scene, Accuracy::FAST, 300.0)
        });
        assert_eq!(found.unwrap_err(), ModelError::Stopped);
    }
}
