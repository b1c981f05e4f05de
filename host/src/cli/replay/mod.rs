//! `era replay`: a recording's requests again, in their times, at a running daemon.

mod pages;

use super::args::{DaemonOptions, Replay};
use super::client::{self, DaemonAnswer};
use super::progress::run_with_progress;
use super::signals::run_in_thread_on_first_end_signal;
use super::terminal_messages::tell_why_command_failed;
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::replay::TouchOutcome;
use crate::replay::{RecordedAction, RecordedRequest, Recording, largest_relative_drive_difference};
use crate::text_file::refuse_utf16;
use pages::ReplayedPages;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::time::{Duration, Instant};

/// For what comes back to the last message of a page.
const LAST: Duration = Duration::from_millis(300);

/// How many answers that are others than recorded are told one by one; `--json` has all.
const PRINTED_DIFFERENCES: usize = 20;

/// What became of a request now.
struct ReplayedRequest {
    /// Place of the request in the recording.
    place: usize,
    result: Result<DaemonAnswer, Failure>,
}

pub fn run_replay(options: &Replay) -> CommandResult {
    let named = |error: &dyn std::fmt::Display| Failure::Usage(format!("{}: {error}", options.file.display()));
    let bytes = std::fs::read(&options.file).map_err(|error| named(&format!("the file cannot be read: {error}")))?;
    refuse_utf16(&bytes).map_err(|error| named(&error))?;
    let recording = Recording::parse(&bytes).map_err(|error| named(&error))?;
    let daemon = &options.daemon;
    let scene = client::request_body_failing_on_error_status(daemon, "GET", "/v1/scene", None)?;
    let now = scene["name"].as_str().unwrap_or_default();
    if now != recording.scene {
        tracing::warn!(
            "the recording was made with the scene {:?}, but the daemon now has the scene {now:?}",
            recording.scene
        );
    }
    // What it has asked for would be driven on.
    let driven = daemon.clone();
    let is_ended = Arc::new(AtomicBool::new(false));
    let ended = Arc::clone(&is_ended);
    run_in_thread_on_first_end_signal(move |signal| {
        // Nothing is asked for after the stop.
        ended.store(true, Ordering::SeqCst);
        let stopped = client::request_body_failing_on_error_status(&driven, "POST", "/v1/stop", None);
        let told = stopped.map_or_else(
            |failure| failure.message_or_empty_if_already_reported(),
            |_| "the daemon has stopped all drives".into(),
        );
        tell_why_command_failed(&format!("{signal} ended the replay; {told}"));
        std::process::exit(1);
    });
    let (done, results) = channel();
    let mut pages = ReplayedPages::new(daemon);
    run_with_progress("replaying", || {
        let started = Instant::now();
        for (place, asked) in recording.asked.iter().enumerate() {
            pages.read_page_messages_until(started + asked.at.div_f64(options.speed));
            park_thread_forever_once_ending(&is_ended);
            match &asked.what {
                RecordedAction::Touch(_, body) => {
                    send_request_in_thread(daemon, "/v1/touch", place, Some(body.clone()), &done)
                }
                RecordedAction::EffectFile(_, body) => {
                    send_request_in_thread(daemon, "/v1/effects", place, Some(body.clone()), &done)
                }
                RecordedAction::Stop => send_request_in_thread(daemon, "/v1/stop", place, None, &done),
                RecordedAction::Arm => send_request_in_thread(daemon, "/v1/arm", place, None, &done),
                RecordedAction::Clear => send_request_in_thread(daemon, "/v1/faults/clear", place, None, &done),
                RecordedAction::Fingers(page, message) => {
                    pages.send_recorded_message_of_page_to_daemon_or_count_lost(*page, message)
                }
                RecordedAction::Gone(page) => pages.close_page(*page),
            }
        }
        if pages.said > 0 {
            pages.read_page_messages_until(Instant::now() + LAST);
        }
    });
    park_thread_forever_once_ending(&is_ended);
    drop(done);
    print_summary_and_fail_if_unanswered_or_lost(options, &recording, results.into_iter().collect(), &pages)
}

/// Does not return once a signal has come: the thread that stops everything then ends the process.
fn park_thread_forever_once_ending(is_ended: &AtomicBool) {
    while is_ended.load(Ordering::SeqCst) {
        std::thread::park();
    }
}

/// Asks in a thread of its own, as requests overlapped when they were recorded.
fn send_request_in_thread(
    daemon: &DaemonOptions,
    path: &'static str,
    place: usize,
    body: Option<Value>,
    done: &Sender<ReplayedRequest>,
) {
    let (daemon, done) = (daemon.clone(), done.clone());
    std::thread::spawn(move || {
        let result = client::request_json_answer_of_any_status_but_redirect(&daemon, "POST", path, body);
        // Nobody waits for it any more if the command has failed.
        let _ = done.send(ReplayedRequest { place, result });
    });
}

/// A touch or an effect file that was answered otherwise than recorded.
struct ChangedAnswer<'r> {
    asked: &'r RecordedRequest,
    id: u64,
    /// What was asked, in one line: of an effect file not its content.
    asked_text: String,
    body: &'r Value,
    then: &'r TouchOutcome,
    /// Nothing: no answer.
    now: Option<TouchOutcome>,
    /// Detail of the present answer, or why there was no answer.
    detail: String,
}

impl ChangedAnswer<'_> {
    fn to_json(&self) -> Value {
        let told = |it: &TouchOutcome| json!({"status": it.status, "type": it.problem});
        json!({
            "at_ms": self.asked.at.as_secs_f64() * 1e3, "id": self.id, "body": self.body, "then": told(self.then),
            "now": self.now.as_ref().map(told), "detail": self.detail,
        })
    }

    fn format_line(&self) -> String {
        let now = self.now.as_ref().map_or_else(|| "no answer".into(), TouchOutcome::to_string);
        let detail = if self.detail.is_empty() { String::new() } else { format!(": {}", self.detail) };
        let at = self.asked.at.as_secs_f64();
        format!("  {at:9.3} s  {}  {} in the recording, {now} now{detail}", self.asked_text, self.then)
    }
}

fn print_summary_and_fail_if_unanswered_or_lost(
    options: &Replay,
    recording: &Recording,
    mut done: Vec<ReplayedRequest>,
    pages: &ReplayedPages<'_>,
) -> CommandResult {
    // Threads end in any order.
    done.sort_by_key(|done| done.place);
    let (mut statuses, mut unanswered, mut otherwise) = (BTreeMap::<u16, u64>::new(), 0_u64, Vec::new());
    let (mut compared, mut largest) = (0_u64, 0.0_f64);
    for ReplayedRequest { place, result } in &done {
        let (now, detail) = match result {
            Ok(DaemonAnswer { status, body }) => {
                *statuses.entry(*status).or_default() += 1;
                (Some(TouchOutcome::from_answer(*status, body)), body["detail"].as_str().unwrap_or_default().to_owned())
            }
            Err(failure) => (None, failure.message_or_empty_if_already_reported()),
        };
        unanswered += u64::from(now.is_none());
        let Some(asked) = recording.asked.get(*place) else { continue };
        let (id, body, asked_text) = match &asked.what {
            RecordedAction::Touch(id, body) => (id, body, format!("touch {id} {body}")),
            RecordedAction::EffectFile(id, body) => {
                (id, body, format!("effect file {id} at {}, {} px", body["x_px"], body["y_px"]))
            }
            _ => continue,
        };
        let Some(then) = recording.outcomes.get(id) else { continue };
        match now {
            Some(now) if (now.status, &now.problem) == (then.status, &then.problem) => {
                if let Some(difference) = largest_relative_drive_difference(&then.drives, &now.drives) {
                    compared += 1;
                    largest = largest.max(difference);
                }
            }
            now => otherwise.push(ChangedAnswer { asked, id: *id, asked_text, body, then, now, detail }),
        }
    }
    if options.daemon.json {
        let list: Vec<Value> = otherwise.iter().map(ChangedAnswer::to_json).collect();
        print_json(&json!({
            "requests": done.len(), "messages": pages.said, "messages_refused": pages.refused, "messages_lost": pages.lost, "statuses": statuses, "unanswered": unanswered,
            "answered_otherwise": otherwise.len(), "otherwise": list, "drives_compared": compared,
            "drives_differ_by": largest, "left_out": recording.left_out,
        }))?;
        return check_none_unanswered_or_lost(unanswered, pages.lost);
    }
    let refused: Vec<String> = pages.refused.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
    let refused = if refused.is_empty() { "none".into() } else { refused.join(", ") };
    let lost = pages
        .reason
        .as_ref()
        .map_or_else(String::new, |reason| format!(", but {} of them could not be sent: {reason}", pages.lost));
    let list: Vec<String> = statuses.iter().map(|(status, count)| format!("{count} with status {status}")).collect();
    let mut told: Vec<String> = otherwise.iter().take(PRINTED_DIFFERENCES).map(ChangedAnswer::format_line).collect();
    if otherwise.len() > PRINTED_DIFFERENCES {
        told.push(format!(
            "  and {} more requests: with --json, the field `otherwise` lists all of them",
            otherwise.len() - PRINTED_DIFFERENCES
        ));
    }
    let told = told.iter().fold(String::new(), |text, line| text + "\n" + line);
    print_text_after_queued_log(&format!(
        "{} requests replayed ({}), {unanswered} without an answer; {} messages of web pages replayed{lost}\n\
         errors in the answers to these messages: {refused}; the drives that these messages cause are not compared\n\
         touches and effect files whose answer differs from the recorded answer: {}{told}\n\
         touches whose drives were compared: {compared}; largest relative difference in frequency or voltage: {largest:.1e}\n\
         lines that the recording lacks, because the disk was too slow: {}",
        done.len(),
        if list.is_empty() { "no answer".into() } else { list.join(", ") },
        pages.said,
        otherwise.len(),
        recording.left_out
    ))?;
    check_none_unanswered_or_lost(unanswered, pages.lost)
}

/// It failed where the daemon was not there for something.
fn check_none_unanswered_or_lost(unanswered: u64, lost: u64) -> CommandResult {
    if unanswered + lost == 0 {
        return Ok(());
    }
    Err(Failure::runtime_error(format!(
        "{unanswered} replayed requests had no answer, and {lost} recorded messages from web pages could not be sent to the daemon"
    )))
}
