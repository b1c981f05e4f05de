//! How far a study is, with the time that is left, and stopping it.

use super::cost::describe_duration_rounded_to_one_digit;
use super::serve::await_end_signal;
use super::signals::EndSignals;
use super::standard_error;
use super::terminal_messages::{self, tell};
use crate::study::run::StudyObserver;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// First plain line; the next ones come after twice as long each.
const FIRST_LINE: Duration = Duration::from_secs(10);
/// Longest time from one plain line to the next.
const LAST_LINE: Duration = Duration::from_secs(600);

/// Shows how far a study is on standard error: a bar on a terminal, plain lines elsewhere.
pub struct StudyProgressDisplay {
    stops: Arc<AtomicBool>,
    started: Instant,
    bar: Option<ProgressBar>,
    all: AtomicUsize,
    /// Number of computed designs: at the start of the command, and now.
    there: [AtomicUsize; 2],
    /// When the next line is due, and the time from this line to the following line.
    next_line: Mutex<(Instant, Duration)>,
}

impl StudyProgressDisplay {
    /// For work that `stops` may end.
    pub fn new(stops: Arc<AtomicBool>) -> Self {
        let bar = (std::io::stderr().is_terminal() && !terminal_messages::is_log_json()).then(|| {
            let bar = ProgressBar::new(0);
            if let Ok(style) = ProgressStyle::with_template("{pos} of {len} designs [{bar:30}] {msg}") {
                bar.set_style(style);
            }
            bar
        });
        let now = Instant::now();
        Self {
            stops,
            started: now,
            bar,
            all: AtomicUsize::new(0),
            there: [AtomicUsize::new(0), AtomicUsize::new(0)],
            next_line: Mutex::new((now + FIRST_LINE, FIRST_LINE)),
        }
    }

    /// Ends it: how many designs are there, and how many there are to be.
    pub fn finish_and_count_done_and_all_designs(self) -> (usize, usize) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        (self.there[1].load(Ordering::Relaxed), self.all.load(Ordering::Relaxed))
    }

    /// Designs per second, and the time that is left.
    #[expect(clippy::cast_precision_loss, reason = "about")]
    fn describe_rate_and_time_left(&self) -> String {
        let [first, now] = self.there.each_ref().map(|count| count.load(Ordering::Relaxed));
        let left = self.all.load(Ordering::Relaxed).saturating_sub(now);
        let rate = now.saturating_sub(first) as f64 / self.started.elapsed().as_secs_f64().max(1e-9);
        if rate <= 0.0 {
            return String::new();
        }
        format!(
            "{rate:.1} designs per second, about {} remaining",
            describe_duration_rounded_to_one_digit(Duration::from_secs_f64((left as f64 / rate).min(1e9)))
        )
    }
}

impl StudyObserver for StudyProgressDisplay {
    fn is_stop_wanted(&self) -> bool {
        self.stops.load(Ordering::Relaxed)
    }

    fn report_already_computed_of_all_at_start(&self, there: usize, all: usize) {
        self.all.store(all, Ordering::Relaxed);
        self.there.iter().for_each(|count| count.store(there, Ordering::Relaxed));
        if there > 0 {
            tell!("{there} of {all} designs are already computed");
        }
        if let Some(bar) = &self.bar {
            bar.set_length(all as u64);
            bar.set_position(there as u64);
        }
    }

    fn report_further_designs_found_in_folder(&self, designs: usize) {
        self.there.iter().for_each(|count| {
            count.fetch_add(designs, Ordering::Relaxed);
        });
    }

    fn report_newly_computed_designs(&self, designs: usize) {
        let now = self.there[1].fetch_add(designs, Ordering::Relaxed) + designs;
        if let Some(bar) = &self.bar {
            bar.set_position(now as u64);
            bar.set_message(self.describe_rate_and_time_left());
            return;
        }
        let mut next = self.next_line.lock().unwrap_or_else(PoisonError::into_inner);
        if Instant::now() >= next.0 {
            next.1 = (2 * next.1).min(LAST_LINE);
            next.0 = Instant::now() + next.1;
            tell!(
                "{now} of {} designs computed, {}",
                self.all.load(Ordering::Relaxed),
                self.describe_rate_and_time_left()
            );
        }
    }
}

/// A flag that Ctrl-C sets, or the signal that job schedulers send; the second time ends the program.
pub fn make_signal_stop_flag_second_signal_exits() -> Arc<AtomicBool> {
    let stops = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stops);
    let wait = move || {
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_io().build() else { return };
        runtime.block_on(async { await_end_signal(EndSignals::listen()).await });
        flag.store(true, Ordering::Relaxed);
        tell!(
            "stopping after the chunks of designs that have begun; a second Ctrl-C ends the study at once \
             and loses only these chunks"
        );
        runtime.block_on(async { await_end_signal(EndSignals::listen()).await });
        standard_error::wait_until_queue_is_written_or_timeout();
        std::process::exit(1);
    };
    if let Err(error) = std::thread::Builder::new().name("signals".into()).spawn(wait) {
        tracing::warn!(%error, "cannot start the thread that waits for Ctrl-C: Ctrl-C now ends the study at once");
    }
    stops
}
