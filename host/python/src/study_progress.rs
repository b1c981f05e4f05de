//! How far the work of a study is, from the threads that compute designs to the thread that tells Python.

use era_study::run::StudyObserver;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::Sender;

/// Who may stop work, and wants to know how much is done.
pub struct ProgressObserver {
    /// Asked before each design.
    pub stop: era_model::stop::StopRequest,
    /// Designs that were computed here.
    pub done: AtomicUsize,
    /// To whoever wants to know how many more are there.
    pub more: Sender<usize>,
}

impl ProgressObserver {
    fn send_count_of_further_designs(&self, further_designs: usize) {
        // Nobody listens after a signal.
        let _ = self.more.send(further_designs);
    }
}

impl StudyObserver for ProgressObserver {
    fn is_stop_wanted(&self) -> bool {
        self.stop.is_stop_requested_or_deadline_over()
    }

    fn report_already_computed_of_all_at_start(&self, there: usize, _all: usize) {
        if there > 0 {
            self.send_count_of_further_designs(there);
        }
    }

    fn report_further_designs_found_in_folder(&self, designs: usize) {
        self.send_count_of_further_designs(designs);
    }

    fn report_newly_computed_designs(&self, designs: usize) {
        self.done.fetch_add(designs, Ordering::Relaxed);
        self.send_count_of_further_designs(designs);
    }
}
