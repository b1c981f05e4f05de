//! `era replay`: a recording's requests again, in their times, at a running daemon.

use super::args::{Daemon, Replay};
use super::client::{self, Answer};
use super::live::{self, Socket};
use super::{Failure, Outcome, print_json, print_text};
use crate::replay::{Recording, What, difference};
use serde_json::{Value, json};
use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, HashMap};
use std::sync::mpsc::{Sender, channel};
use std::time::{Duration, Instant};
use tungstenite::Message;

/// For what a page has been sent meanwhile, before it speaks again.
const LISTEN: Duration = Duration::from_millis(1);

/// What became of a request now.
struct Done {
    /// Of a touch.
    id: Option<u64>,
    result: Result<Answer, Failure>,
}

pub fn run(options: &Replay) -> Outcome {
    let named = |error: &dyn std::fmt::Display| Failure::Usage(format!("{}: {error}", options.file.display()));
    let text = std::fs::read_to_string(&options.file).map_err(|error| named(&error))?;
    let recording = Recording::parse(&text).map_err(|error| named(&error))?;
    let daemon = &options.daemon;
    let scene = client::call(daemon, "GET", "/v1/scene", None)?;
    let now = scene["name"].as_str().unwrap_or_default();
    if now != recording.scene {
        tracing::warn!("recorded on the scene {:?}, replayed on {now:?}", recording.scene);
    }
    let (done, results) = channel();
    let (mut sockets, mut messages) = (HashMap::new(), 0_u64);
    let started = Instant::now();
    for asked in &recording.asked {
        let due = started + asked.at.div_f64(options.speed);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        match &asked.what {
            What::Touch(id, body) => ask(daemon, "/v1/touch", Some(*id), Some(body.clone()), &done),
            What::Stop => ask(daemon, "/v1/stop", None, None, &done),
            What::Arm => ask(daemon, "/v1/arm", None, None, &done),
            What::Clear => ask(daemon, "/v1/faults/clear", None, None, &done),
            What::Fingers(page, message) => {
                say(&mut sockets, daemon, *page, message)?;
                messages += 1;
            }
            What::Gone(page) => {
                if let Some(mut socket) = sockets.remove(page) {
                    let _ = socket.close(None).and_then(|()| socket.flush());
                }
            }
        }
    }
    drop(done);
    summary(options, &recording, results.into_iter().collect(), messages)
}

/// Asks in a thread of its own, as requests overlapped when they were recorded.
fn ask(daemon: &Daemon, path: &'static str, id: Option<u64>, body: Option<Value>, done: &Sender<Done>) {
    let (daemon, done) = (daemon.clone(), done.clone());
    std::thread::spawn(move || {
        let result = client::answer(&daemon, "POST", path, body);
        // Nobody waits for it any more if the command has failed.
        let _ = done.send(Done { id, result });
    });
}

/// Says a page's message over a socket of its own.
fn say(sockets: &mut HashMap<u64, Socket>, daemon: &Daemon, page: u64, message: &Value) -> Outcome {
    let socket = match sockets.entry(page) {
        Entry::Occupied(known) => known.into_mut(),
        Entry::Vacant(place) => {
            let socket = live::open(daemon, "send=")?;
            socket.get_ref().set_read_timeout(LISTEN).map_err(Failure::failed)?;
            place.insert(socket)
        }
    };
    // Its questions for a sign of life are answered by reading them.
    while socket.read().is_ok() {}
    socket.send(Message::text(message.to_string())).map_err(Failure::failed)
}

fn summary(options: &Replay, recording: &Recording, done: Vec<Done>, messages: u64) -> Outcome {
    let (mut statuses, mut unanswered, mut otherwise) = (BTreeMap::<u16, u64>::new(), 0_u64, 0_u64);
    let (mut compared, mut largest) = (0_u64, 0.0_f64);
    for Done { id, result } in &done {
        let Ok(Answer { status, body }) = result else {
            unanswered += 1;
            continue;
        };
        *statuses.entry(*status).or_default() += 1;
        if let Some((then, drives)) = id.and_then(|id| recording.outcomes.get(&id)) {
            otherwise += u64::from(then != status);
            if let Some(difference) = difference(drives, &body["drives"]).filter(|_| then == status) {
                compared += 1;
                largest = largest.max(difference);
            }
        }
    }
    if options.daemon.json {
        return print_json(&json!({
            "requests": done.len(), "messages": messages, "statuses": statuses, "unanswered": unanswered,
            "answered_otherwise": otherwise, "drives_compared": compared, "drives_differ_by": largest,
            "left_out": recording.left_out,
        }));
    }
    let list: Vec<String> = statuses.iter().map(|(status, count)| format!("{count} with {status}")).collect();
    print_text(&format!(
        "{} requests ({}), {unanswered} without an answer, and {messages} messages of pages\n\
         answered otherwise than recorded: {otherwise}\n\
         drives compared: {compared}, which differ by {largest:.1e} at most in frequency and voltage\n\
         lines that the recorder left out: {}",
        done.len(),
        if list.is_empty() { "no answer".into() } else { list.join(", ") },
        recording.left_out
    ))
}
