//! A sign of life for what takes more than a second, and what it will cost before it begins.
//!
//! On a terminal a bar or a spinner, which is gone afterwards; otherwise plain lines, the more seldom the longer it takes.
//! Everything goes to standard error.

use super::cost::{Cost, describe_duration_rounded_to_one_digit};
use super::terminal_messages::{self, tell};
use indicatif::{ProgressBar, ProgressStyle};
use std::fmt;
use std::io::IsTerminal;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use tracing::field::{Field, Visit};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

/// Work that takes no longer is nobody's concern.
const SHORT: Duration = Duration::from_secs(1);
/// First plain line of what takes long; the next ones come after twice as long each.
const FIRST_LINE: Duration = Duration::from_secs(10);
/// Parts of a bar.
const PARTS: u64 = 1000;

/// The model's latest level, as its event tells: order, unknowns.
static LEVEL: Mutex<Option<(u64, u64)>> = Mutex::new(None);

/// Runs `work`; if it takes longer than a second, shows `what` with the time it has taken.
pub fn run_with_progress<T>(what: &'static str, work: impl FnOnce() -> T) -> T {
    run_while_showing_progress(what, None, work)
}

/// The same with what it is expected to take: said before it begins, if that is more than a second.
pub fn run_telling_expected_cost_and_showing_progress<T>(
    what: &'static str,
    cost: Option<Cost>,
    work: impl FnOnce() -> T,
) -> T {
    let Some(cost) = cost else { return run_with_progress(what, work) };
    let time = cost.estimate_time_measuring_machine_speed_if_large();
    if time > SHORT {
        tell!("{what}: about {} ({cost})", describe_duration_rounded_to_one_digit(time));
    }
    run_while_showing_progress(what, Some(time), work)
}

fn run_while_showing_progress<T>(what: &'static str, expected: Option<Duration>, work: impl FnOnce() -> T) -> T {
    *LEVEL.lock().unwrap_or_else(PoisonError::into_inner) = None;
    let (done, waiting) = channel::<()>();
    let watcher =
        std::thread::Builder::new().name("progress".into()).spawn(move || show_progress(what, expected, &waiting));
    let result = work();
    drop(done);
    if let Ok(watcher) = watcher {
        let _ = watcher.join();
    }
    result
}

fn show_progress(what: &'static str, expected: Option<Duration>, done: &Receiver<()>) {
    let started = Instant::now();
    let is_over = |time: Duration| done.recv_timeout(time) != Err(RecvTimeoutError::Timeout);
    if is_over(SHORT) {
        return;
    }
    if terminal_messages::is_log_json() || !std::io::stderr().is_terminal() {
        let mut line = FIRST_LINE;
        while !is_over(line.saturating_sub(started.elapsed())) {
            tell!("{what}: {:.0} s so far{}", started.elapsed().as_secs_f64(), describe_latest_mesh_or_empty());
            line *= 2;
        }
        return;
    }
    let expected = expected.filter(|expected| *expected > SHORT);
    let (bar, template) = match expected {
        Some(_) => (ProgressBar::new(PARTS), "{msg} [{bar:30}] {elapsed}"),
        None => (ProgressBar::new_spinner(), "{spinner} {msg} ({elapsed})"),
    };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    loop {
        bar.set_message(format!("{what}{}", describe_latest_mesh_or_empty()));
        match expected {
            Some(expected) => {
                bar.set_position(compute_bar_position_per_mille_never_reaching_end(started.elapsed(), expected))
            }
            None => bar.tick(),
        }
        if is_over(Duration::from_millis(120)) {
            break;
        }
    }
    bar.finish_and_clear();
}

/// How far a bar is: never at its end, as an estimate may be short.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss, reason = "0 to 1000")]
fn compute_bar_position_per_mille_never_reaching_end(elapsed: Duration, expected: Duration) -> u64 {
    let ratio = elapsed.as_secs_f64() / expected.as_secs_f64();
    // Straight to 80 %, and from there on towards 100 %.
    let part = if ratio < 0.8 { ratio } else { 1.0 - 0.2 * (-(ratio - 0.8) / 0.2).exp() };
    (part * PARTS as f64) as u64
}

/// The latest level in words.
fn describe_latest_mesh_or_empty() -> String {
    let level = *LEVEL.lock().unwrap_or_else(PoisonError::into_inner);
    level.map_or_else(String::new, |(order, unknowns)| {
        format!(
            ", last computed mesh: order {order}, {unknowns} \
    unknowns"
        )
    })
}

/// Notes the model's events named `level`, which it sends after every level of an answer with the fields `order` and `dofs`.
#[derive(Clone, Copy, Debug, Default)]
pub struct LevelWatch;

impl LevelWatch {
    /// Where such events come from.
    pub const TARGET: &'static str = "era_model::model";
}

impl<S: tracing::Subscriber> Layer<S> for LevelWatch {
    fn on_event(&self, event: &tracing::Event<'_>, _: Context<'_, S>) {
        let mut seen = Seen::default();
        event.record(&mut seen);
        if let Seen { is_level: true, order: Some(order), dofs: Some(dofs) } = seen {
            *LEVEL.lock().unwrap_or_else(PoisonError::into_inner) = Some((order, dofs));
        }
    }
}

/// What is of interest in an event.
#[derive(Default)]
struct Seen {
    is_level: bool,
    order: Option<u64>,
    dofs: Option<u64>,
}

impl Visit for Seen {
    fn record_u64(&mut self, field: &Field, value: u64) {
        match field.name() {
            "order" => self.order = Some(value),
            "dofs" => self.dofs = Some(value),
            _ => {}
        }
    }

    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            self.is_level = format!("{value:?}") == "level";
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Accuracy, compute_modes_with_error_bounds};
    use crate::scene::{EXAMPLE_BAR, Scene};
    use tracing_subscriber::layer::SubscriberExt;

    /// The event and its fields are the model's: this fails if they are renamed there.
    #[test]
    fn levels_of_the_model_are_seen() {
        let scene = Scene::parse("bar", EXAMPLE_BAR).unwrap();
        let subscriber = tracing_subscriber::registry().with(LevelWatch);
        let found = tracing::subscriber::with_default(subscriber, || {
            compute_modes_with_error_bounds(&scene, Accuracy::FAST, 300.0)
        })
        .unwrap();
        let (order, dofs) = LEVEL.lock().unwrap().unwrap();
        assert!(found.steps.iter().any(|step| step.fineness.order as u64 == order && step.dofs as u64 == dofs));
        assert!(describe_latest_mesh_or_empty().contains(&format!("order {order}")));
        // Of other work nothing is known yet.
        let told = run_with_progress("asking", describe_latest_mesh_or_empty);
        assert_eq!(told, "");
    }

    #[test]
    fn a_bar_never_ends_early_and_never_goes_back() {
        let expected = Duration::from_secs(10);
        let parts: Vec<u64> = (0..100)
            .map(|second| compute_bar_position_per_mille_never_reaching_end(Duration::from_secs(second), expected))
            .collect();
        assert!(parts.is_sorted() && parts[0] == 0 && parts[4] == 400 && parts[10] < 950 && parts[99] <= PARTS);
    }
}
