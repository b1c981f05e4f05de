//! Recordings of the daemon (`era serve --record`), read back: what was asked, in its time, and what became of it.

use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::time::Duration;

/// One request of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedRequest {
    /// Since the recording began.
    pub at: Duration,
    /// What was asked.
    pub what: RecordedAction,
}

/// What can be asked.
#[derive(Clone, Debug, PartialEq)]
pub enum RecordedAction {
    /// `POST /v1/touch`, with its number then.
    Touch(u64, Value),
    /// `POST /v1/effects`, with its number then.
    EffectFile(u64, Value),
    /// A message of a page's fingers, with the page.
    Fingers(u64, Value),
    /// A page went away.
    Gone(u64),
    /// Everything off.
    Stop,
    /// Arm.
    Arm,
    /// Clear the latched fault.
    Clear,
}

/// What a touch had.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TouchOutcome {
    /// HTTP status.
    pub status: u16,
    /// The problem's type, where it is one.
    pub problem: Option<String>,
    /// Its drives, where it has some.
    pub drives: Value,
}

impl TouchOutcome {
    /// Of an answer's status and body, which is a problem's or has drives.
    #[must_use]
    pub fn from_answer(status: u16, body: &Value) -> Self {
        Self { status, problem: body["type"].as_str().map(strip_problem_prefix), drives: body["drives"].clone() }
    }
}

impl std::fmt::Display for TouchOutcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.status)?;
        self.problem.as_ref().map_or(Ok(()), |problem| write!(f, " {problem}"))
    }
}

/// A problem's type without what all of them begin with.
fn strip_problem_prefix(kind: &str) -> String {
    kind.rsplit(':').next().unwrap_or(kind).to_owned()
}

/// A recording.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    /// Name of the scene that was served.
    pub scene: String,
    /// In their order.
    pub asked: Vec<RecordedRequest>,
    /// What touches had, by their numbers.
    pub outcomes: BTreeMap<u64, TouchOutcome>,
    /// Lines that the recorder left out.
    pub left_out: u64,
}

/// What is wrong with a recording.
#[derive(Debug, thiserror::Error)]
#[error("line {line}: {reason}")]
pub struct ReplayError {
    /// From 1.
    pub line: usize,
    /// In words.
    pub reason: String,
}

#[derive(Deserialize)]
struct RecordingLine {
    at_ms: f64,
    kind: String,
    #[serde(default)]
    left_out_before: u64,
    format: Option<u32>,
    scene: Option<String>,
    id: Option<u64>,
    body: Option<Value>,
    socket: Option<u64>,
    message: Option<Value>,
    status: Option<u16>,
    drives: Option<Value>,
    problem: Option<Value>,
}

/// What keeps a text from being a line of a recording. The line is told before, and of a key that is missing no column.
fn describe_json_mistake(error: &serde_json::Error) -> String {
    let message = error.to_string();
    let what = message.split_once(" at line ").map_or(message.as_str(), |(what, _)| what);
    match what.strip_prefix("missing field `").and_then(|rest| rest.strip_suffix('`')) {
        Some(key) => format!("the line has no key {key:?}"),
        None => format!("this is not a line of a recording (column {}: {what})", error.column()),
    }
}

impl Recording {
    /// Reads a recording's lines. What is behind the last whole line is left out if it cannot be read: with the machine's power a line is cut
    /// off, even within a letter, and many file systems fill up with zeros what never came onto the disk.
    ///
    /// # Errors
    /// [`ReplayError`] with the line.
    pub fn parse(bytes: &[u8]) -> Result<Self, ReplayError> {
        let mut recording = Self::default();
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        for (number, text) in (1..).zip(bytes.split_inclusive(|byte| *byte == b'\n')) {
            let wrong = |reason: String| ReplayError { line: number, reason };
            let is_rest = number > 1 && !text.ends_with(b"\n");
            let line: RecordingLine = match serde_json::from_slice(text.trim_ascii_end()) {
                Ok(line) => line,
                Err(_) if is_rest => break,
                Err(error) => return Err(wrong(describe_json_mistake(&error))),
            };
            let at = Duration::try_from_secs_f64(line.at_ms / 1e3)
                .map_err(|_| wrong(format!("at_ms is {}, but must be 0 or more", line.at_ms)))?;
            recording.left_out += line.left_out_before;
            let missing = |key: &str| wrong(format!("the line of the kind {:?} has no key {key:?}", line.kind));
            if (number == 1) != (line.kind == "begin") {
                return Err(wrong(
                    "the first line of a recording, and no other line, must be of the kind \"begin\"".into(),
                ));
            }
            let what = match line.kind.as_str() {
                "begin" if line.format == Some(1) => {
                    recording.scene = line.scene.ok_or_else(|| missing("scene"))?;
                    continue;
                }
                "begin" => {
                    let said = line.format.map_or_else(|| "no format".to_owned(), |format| format!("format {format}"));
                    return Err(wrong(format!("the recording has {said}, but this program reads format 1 only")));
                }
                "touch" => RecordedAction::Touch(
                    line.id.ok_or_else(|| missing("id"))?,
                    line.body.ok_or_else(|| missing("body"))?,
                ),
                "effect_file" => RecordedAction::EffectFile(
                    line.id.ok_or_else(|| missing("id"))?,
                    line.body.ok_or_else(|| missing("body"))?,
                ),
                "fingers" => RecordedAction::Fingers(
                    line.socket.ok_or_else(|| missing("socket"))?,
                    line.message.ok_or_else(|| missing("message"))?,
                ),
                "gone" => RecordedAction::Gone(line.socket.ok_or_else(|| missing("socket"))?),
                "stop" => RecordedAction::Stop,
                "arm" => RecordedAction::Arm,
                "clear" => RecordedAction::Clear,
                "outcome" => {
                    let status = line.status.ok_or_else(|| missing("status"))?;
                    let id = line.id.ok_or_else(|| missing("id"))?;
                    let problem =
                        line.problem.as_ref().and_then(|problem| problem["type"].as_str()).map(strip_problem_prefix);
                    let drives = line.drives.unwrap_or_default();
                    recording.outcomes.insert(id, TouchOutcome { status, problem, drives });
                    continue;
                }
                // What later versions may write.
                _ => continue,
            };
            recording.asked.push(RecordedRequest { at, what });
        }
        if bytes.is_empty() {
            return Err(ReplayError { line: 1, reason: "the file is empty".into() });
        }
        Ok(recording)
    }
}

/// Largest relative difference of the drives' frequencies and voltages; `None` where they are not of the same actuators.
#[must_use]
pub fn largest_relative_drive_difference(then: &Value, now: &Value) -> Option<f64> {
    let (then, now) = (then.as_array()?, now.as_array()?);
    if then.len() != now.len() {
        return None;
    }
    let mut largest = 0.0_f64;
    for (then, now) in then.iter().zip(now) {
        if then["actuator"] != now["actuator"] {
            return None;
        }
        for key in ["frequency_hz", "voltage_v"] {
            let (then, now) = (then[key].as_f64()?, now[key].as_f64()?);
            largest = largest.max((now - then).abs() / then.abs().max(f64::MIN_POSITIVE));
        }
    }
    Some(largest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_recording_is_read_back() {
        let text = r#"{"at_ms": 0.0, "kind": "begin", "format": 1, "scene": "desk"}
{"at_ms": 12.5, "kind": "touch", "id": 1, "body": {"x_px": 3, "y_px": 4}}
{"at_ms": 13.0, "kind": "effect_file", "id": 3, "body": {"x_px": 5}}
{"at_ms": 14.0, "kind": "outcome", "id": 1, "status": 200, "drives": [], "left_out_before": 2}
{"at_ms": 20.0, "kind": "fingers", "socket": 7, "message": {"type": "touch", "touches": []}}
{"at_ms": 21.0, "kind": "later-version", "something": [1]}
{"at_ms": 22.0, "kind": "gone", "socket": 7}
{"at_ms": 22.5, "kind": "outcome", "id": 2, "status": 409, "problem": {"type": "urn:era:problem:superseded"}}
{"at_ms": 23.0, "kind": "st"#;
        let recording = Recording::parse(text.as_bytes()).unwrap();
        let (asked, outcomes) = (&recording.asked, &recording.outcomes);
        assert_eq!((recording.scene.as_str(), asked.len(), recording.left_out), ("desk", 4, 2));
        assert_eq!(asked[0].at, Duration::from_micros(12_500));
        assert_eq!(asked[0].what, RecordedAction::Touch(1, json!({"x_px": 3, "y_px": 4})));
        assert_eq!(asked[1].what, RecordedAction::EffectFile(3, json!({"x_px": 5})));
        let answered = TouchOutcome { status: 200, problem: None, drives: json!([]) };
        assert_eq!((&asked[3].what, &outcomes[&1]), (&RecordedAction::Gone(7), &answered));
        assert_eq!(outcomes[&2].to_string(), "409 superseded");
    }

    /// What a lost power leaves behind the last whole line.
    #[test]
    fn what_never_came_onto_the_disk_is_left_out() {
        let whole = "{\"at_ms\": 0, \"kind\": \"begin\", \"format\": 1, \"scene\": \"desk\"}\n{\"at_ms\": 1, \"kind\": \"stop\"}\n";
        let rests: [&[u8]; 5] =
            [b"", &[0; 300], b"{\"at_ms\": 2, \"kin", b"{\"at_ms\": 2, \"kind\": \"\xc3", b"{\"at_ms\": 2\0\0\0"];
        for rest in rests {
            let recording = Recording::parse(&[whole.as_bytes(), rest].concat()).unwrap();
            assert_eq!(recording.asked.len(), 1, "{rest:?}");
            // In the middle it is a mistake.
            let more = [whole.as_bytes(), rest, b"\n", b"{\"at_ms\": 3, \"kind\": \"stop\"}\n"].concat();
            let error = Recording::parse(&more);
            assert!(error.is_err_and(|error| error.line == 3), "{rest:?}");
        }
    }

    #[test]
    fn what_is_wrong_is_reported_with_its_line() {
        let begin = r#"{"at_ms": 0, "kind": "begin", "format": 1, "scene": "desk"}"#;
        for (text, line, wanted) in [
            (String::new(), 1, "empty"),
            ("x".into(), 1, "not a line"),
            (r#"{"at_ms": 1, "kind": "stop"}"#.into(), 1, "first line"),
            (begin.replace("format\": 1", "format\": 2"), 1, "format 2, but this program reads format 1"),
            (format!("{begin}\n{begin}"), 2, "first line"),
            (format!("{begin}\n{{\"at_ms\": -1, \"kind\": \"stop\"}}"), 2, "0 or more"),
            (format!("{begin}\n{{\"at_ms\": 1, \"kind\": \"touch\", \"id\": 1}}"), 2, "has no key \"body\""),
            (format!("{begin}\n{{\"at_ms\":\n{begin}"), 2, "not a line"),
        ] {
            let error = Recording::parse(text.as_bytes()).unwrap_err();
            assert!(error.line == line && error.to_string().contains(wanted), "{text:?}: {error}");
        }
    }

    #[test]
    fn drives_differ_by_their_frequencies_and_voltages() {
        let drives = |hz: f64, volts: f64| json!([{"actuator": "left", "frequency_hz": hz, "voltage_v": volts}]);
        assert_eq!(largest_relative_drive_difference(&drives(100.0, 50.0), &drives(100.0, 50.0)), Some(0.0));
        assert_eq!(largest_relative_drive_difference(&drives(100.0, 50.0), &drives(110.0, 50.0)), Some(0.1));
        assert_eq!(largest_relative_drive_difference(&drives(100.0, 50.0), &drives(100.0, 40.0)), Some(0.2));
        assert_eq!(largest_relative_drive_difference(&drives(100.0, 50.0), &json!([])), None);
    }
}
