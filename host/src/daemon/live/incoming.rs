//! What a page's message says, finger by finger: one that is wrong takes nothing from the others, above all not that they are lifted.
//!
//! The list of fingers is cut out of the message as text, so that whatever is wrong with the text of one (a number that no float holds, a key
//! twice, `NaN`, which some libraries write) stays its own.

use super::PageMessage;
use crate::daemon::api::json::{ExpectedForm, parse_json_object};
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::daemon::touch::check::CheckedFinger;
use crate::daemon::touch::request::Finger;
use crate::planner::request::MAX_TARGETS;
use crate::scene::Scene;
use crate::whole_numbers::to_exact_whole_number;
use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::Value;
use std::borrow::Cow;
use std::ops::Range;

/// How far outside the screen a finger counts as at its edge, as a part of that side: touch controllers report such places of fingers that come
/// over the edge.
const EDGE_FRACTION: f64 = 0.01;
/// Most fingers of one message that are told to be wrong one by one.
const MAX_REPORTED_FINGERS: usize = 10;
const WANTED_MESSAGE: ExpectedForm<'_> = ExpectedForm {
    subject: "The whole message",
    form: r#"{"type": "touch", "touches": [...]}, {"type": "controls", "controls": [...]} or {"type": "stop"}"#,
};
const WANTED_FINGER: ExpectedForm<'_> = ExpectedForm {
    subject: "Each finger",
    form: r#"{"id": number, "x_px": number, "y_px": number, "intensity_g"?: number, "effect"?: text}"#,
};

/// A message: what it says besides the fingers, and the text of each finger; `None` where it has no list of fingers.
#[derive(Debug)]
pub struct IncomingMessage {
    /// All but the fingers, whose list is empty in it; or what is wrong with that.
    pub rest: Result<PageMessage, Problem>,
    /// Whether it is about fingers, whatever is wrong with the rest.
    pub is_touch: bool,
    fingers: Option<Vec<String>>,
}

/// Fingers that count, and what is wrong with those that do not.
#[derive(Debug, Default)]
pub struct CheckedFingers {
    /// With their places on the screen.
    pub fingers: Vec<CheckedFinger>,
    /// One for each of the others, the first ten of them.
    pub problems: Vec<Problem>,
}

impl IncomingMessage {
    /// Reads a message as far as that goes.
    #[must_use]
    pub fn from_text(original: &str) -> Self {
        let text = quote_bare_words(original);
        let (rest, fingers) = match find_finger_list_and_entries(&text) {
            Some((list, fingers)) => {
                let rest = [text.get(..list.start), text.get(list.end..)].map(Option::unwrap_or_default).join("[]");
                let fingers = fingers.into_iter().filter_map(|finger| text.get(finger)).map(str::to_owned).collect();
                (Cow::Owned(rest), Some(fingers))
            }
            None => match parse_strict_json_and_split_off_fingers(&text) {
                Some((rest, fingers)) => (Cow::Owned(rest), Some(fingers)),
                None => (text, None),
            },
        };
        let types = list_values_of_top_level_type_keys_in_possibly_invalid_json(rest.as_bytes());
        let is_touch = !types.is_empty() && types.iter().all(|kind| kind == "touch");
        let rest = parse_json_object(rest.as_bytes(), WANTED_MESSAGE).map_err(|problem| {
            if serde_json::from_str::<IgnoredAny>(&quote_bare_words(original)).is_ok() {
                return problem;
            }
            // The place of a mistake in the syntax is that in the message as it was sent.
            parse_json_object::<PageMessage>(original.as_bytes(), WANTED_MESSAGE).err().unwrap_or(problem)
        });
        Self { rest, is_touch, fingers }
    }

    /// What is wrong where it is about fingers and has no list of them.
    #[must_use]
    pub fn missing_fingers_problem() -> Problem {
        Problem::bad_body(format!("`touches` is missing. {WANTED_MESSAGE}")).with_field("touches".into())
    }

    /// What is wrong where it is about controls and has no list of them.
    #[must_use]
    pub fn problem_that_controls_field_is_missing() -> Problem {
        Problem::bad_body(format!("`controls` is missing. {WANTED_MESSAGE}")).with_field("controls".into())
    }

    /// How many fingers its list has; `None` where it has no list.
    #[must_use]
    pub fn count_fingers(&self) -> Option<usize> {
        self.fingers.as_ref().map(Vec::len)
    }

    /// The fingers that can be made out by their numbers, whatever else is wrong with them or the message.
    #[must_use]
    pub fn list_finger_ids(&self) -> Vec<i64> {
        self.fingers.iter().flatten().filter_map(|finger| parse_finger_id_or_zero_if_absent(finger)).collect()
    }

    /// The fingers on this scene's screen. Those that were `ids_down` before come before others where there are more than can be driven.
    #[must_use]
    pub fn check_fingers(&self, scene: &Scene, ids_down: &[i64]) -> CheckedFingers {
        let mut read = CheckedFingers::default();
        let mut seen = Vec::new();
        let mut wrong = 0_usize;
        let mut refuse = |problem: Problem, id: Option<i64>, problems: &mut Vec<Problem>| {
            wrong += 1;
            if wrong <= MAX_REPORTED_FINGERS {
                problems.push(match id {
                    Some(id) => problem.with_finger_id_and_detail_prefix(id),
                    None => problem,
                });
            }
        };
        let mut good = Vec::new();
        for (t, text) in self.fingers.iter().flatten().enumerate() {
            let part = format!("touches[{t}]");
            if !text.trim_start().starts_with('{') {
                let shown: Value = serde_json::from_str(text).unwrap_or_else(|_| text.trim().into());
                let detail = format!("{part} is {shown}, but must be an object. {WANTED_FINGER}");
                refuse(
                    Problem::bad_body(detail).with_field_and_value(&part, shown, "an object".into(), None),
                    None,
                    &mut read.problems,
                );
                continue;
            }
            let finger = parse_finger_clamped_to_screen_edge_and_check_it(text, scene);
            let id = finger
                .as_ref()
                .map_or_else(|_| parse_finger_id_or_zero_if_absent(text), |finger| Some(finger.finger.id));
            if let Some(id) = id.filter(|id| seen.contains(id)) {
                refuse(duplicate_finger_id_problem(t, id), Some(id), &mut read.problems);
                continue;
            }
            seen.extend(id);
            match finger {
                Ok(finger) => good.push((t, finger)),
                Err(problem) => {
                    refuse(problem.prefix_field_and_detail_if_prefix_given(Some(part)), id, &mut read.problems)
                }
            }
        }
        // Stable: in the order of the message otherwise.
        good.sort_by_key(|(_, checked)| !ids_down.contains(&checked.finger.id));
        for (t, checked) in good.split_off(good.len().min(MAX_TARGETS)) {
            let detail = format!("touches[{t}] is ignored: the daemon accepts at most {MAX_TARGETS} fingers at once");
            refuse(
                Problem::new(ProblemKind::TouchCount, detail).with_field(format!("touches[{t}]")),
                Some(checked.finger.id),
                &mut read.problems,
            );
        }
        good.sort_by_key(|(t, _)| *t);
        read.fingers = good.into_iter().map(|(_, finger)| finger).collect();
        read
    }
}

/// The texts of all keys `type` of a message's own object, or of each where there are several behind each other or in a list: one that is there twice counts
/// too. What the message has besides need not be JSON, nor end: a stop counts that has `NaN` beside it, a comma too many, or another message behind it.
pub fn list_values_of_top_level_type_keys_in_possibly_invalid_json(message: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(message);
    let (bytes, mut types) = (text.as_bytes(), Vec::new());
    let (mut at, mut depth) = (0, 0_usize);
    // The key before a value, and whether its colon has come.
    let (mut key, mut is_value) = (None, false);
    while let Some(byte) = bytes.get(at) {
        match byte {
            b'"' => {
                let end = find_index_after_closing_quote(bytes, at);
                let word = text.get(at..end).and_then(|word| serde_json::from_str::<String>(word).ok());
                if is_value {
                    types.extend(word.filter(|_| depth == 1 && key.as_deref() == Some("type")));
                    (key, is_value) = (None, false);
                } else {
                    key = word;
                }
                at = end;
                continue;
            }
            b':' => is_value = key.is_some(),
            b'{' => (depth, key, is_value) = (depth + 1, None, false),
            b'}' => (depth, key, is_value) = (depth.saturating_sub(1), None, false),
            byte if byte.is_ascii_whitespace() => {}
            _ => (key, is_value) = (None, false),
        }
        at += 1;
    }
    types
}

/// Where the string that begins at `start` ends, quotes included; the text's end where it does not.
fn find_index_after_closing_quote(bytes: &[u8], start: usize) -> usize {
    let mut at = start + 1;
    while let Some(byte) = bytes.get(at) {
        match byte {
            b'\\' => at += 2,
            b'"' => return at + 1,
            _ => at += 1,
        }
    }
    bytes.len()
}

/// One finger, on the screen.
fn parse_finger_clamped_to_screen_edge_and_check_it(text: &str, scene: &Scene) -> Result<CheckedFinger, Problem> {
    let mut finger: Finger = parse_json_object(text.as_bytes(), WANTED_FINGER)?;
    let screen = &scene.screen;
    for (place, side) in [(&mut finger.x_px, screen.width_px), (&mut finger.y_px, screen.height_px)] {
        let side = f64::from(side);
        if (-EDGE_FRACTION * side..=(1.0 + EDGE_FRACTION) * side).contains(place) {
            *place = place.clamp(0.0, side);
        }
    }
    finger.check_on_scene(scene)
}

/// The number of a finger whatever else is wrong with it, if that can be read: 0 where it has none.
fn parse_finger_id_or_zero_if_absent(text: &str) -> Option<i64> {
    #[derive(Deserialize)]
    struct OnlyId {
        id: Option<serde_json::Number>,
    }
    let id = serde_json::from_str::<OnlyId>(text).ok()?.id;
    id.map_or(Some(0), |id| id.as_i64().or_else(|| to_exact_whole_number(id.as_f64()?)))
}

/// That two fingers have the same number: nobody could say then which of them was lifted. The first one counts.
fn duplicate_finger_id_problem(finger_index: usize, id: i64) -> Problem {
    let detail = format!(
        "touches[{finger_index}].id is {id}, but an earlier entry of `touches` already has this id: all ids must differ"
    );
    Problem::new(ProblemKind::OutOfRange, detail).with_field_and_value(
        &format!("touches[{finger_index}].id"),
        id.into(),
        "a number that no other finger has".into(),
        None,
    )
}

/// What is in a text, for whoever looks for places in it: each byte with whether it is in a string, quotes included.
fn scan_bytes_marking_strings(text: &str) -> impl Iterator<Item = (usize, u8, bool)> + '_ {
    let (mut inside, mut escaped) = (false, false);
    text.bytes().enumerate().map(move |(at, byte)| {
        let was_inside = inside;
        match byte {
            _ if escaped => escaped = false,
            b'\\' if inside => escaped = true,
            b'"' => inside = !inside,
            _ => {}
        }
        (at, byte, was_inside || inside)
    })
}

/// Where a message has its list of fingers, brackets included, and where each of them is; `None` where there is none, or where it does not end.
fn find_finger_list_and_entries(text: &str) -> Option<(Range<usize>, Vec<Range<usize>>)> {
    const KEY: &str = "\"touches\"";
    let (mut depth, mut start, mut finger_start, mut fingers) = (0_usize, None, 0, Vec::new());
    // The key has been read, and its colon; nothing else has come.
    let mut is_next = false;
    for (at, byte, in_string) in scan_bytes_marking_strings(text) {
        if in_string {
            if start.is_none() && depth == 1 {
                is_next = is_next || text.get(..=at).is_some_and(|read| read.ends_with(KEY));
            }
            continue;
        }
        match (byte, start) {
            (b'[', None) if depth == 1 && is_next => {
                (start, finger_start) = (Some(at), at + 1);
                depth += 1;
            }
            (b'[' | b'{', _) => depth += 1,
            (b']', Some(from)) if depth == 2 => {
                if text.get(finger_start..at).is_some_and(|last| !last.trim().is_empty()) || !fingers.is_empty() {
                    fingers.push(finger_start..at);
                }
                return Some((from..at + 1, fingers));
            }
            (b']' | b'}', _) => depth = depth.checked_sub(1)?,
            (b',', Some(_)) if depth == 2 => {
                fingers.push(finger_start..at);
                finger_start = at + 1;
            }
            _ => {}
        }
        is_next &= byte == b':' || byte.is_ascii_whitespace();
    }
    None
}

/// The rest of a message and its fingers where the key of their list is written with escapes (`"touche\u0073"`), so that the text does not show it.
fn parse_strict_json_and_split_off_fingers(text: &str) -> Option<(String, Vec<String>)> {
    let mut message: serde_json::Map<String, Value> = serde_json::from_str(text).ok()?;
    let list = message.get_mut("touches")?.as_array_mut()?;
    let fingers = list.drain(..).map(|finger| finger.to_string()).collect();
    Some((Value::Object(message).to_string(), fingers))
}

/// The text with quotes around words that are no JSON, `NaN` and `Infinity` above all: what has one for a value has a text then, and is told so.
fn quote_bare_words(text: &str) -> Cow<'_, str> {
    let is_of_word = |byte: u8| byte.is_ascii_alphanumeric() || b"+-._".contains(&byte);
    let mut words: Vec<Range<usize>> = Vec::new();
    for (at, byte, in_string) in scan_bytes_marking_strings(text) {
        match words.last_mut() {
            Some(word) if !in_string && is_of_word(byte) && word.end == at => word.end = at + 1,
            _ if !in_string && is_of_word(byte) => words.push(at..at + 1),
            _ => {}
        }
    }
    let is_bare = |word: &Range<usize>| {
        let word = text.get(word.clone()).unwrap_or_default();
        let is_number = word.trim_start_matches('-').starts_with(|c: char| c.is_ascii_digit());
        !is_number && !["true", "false", "null"].contains(&word)
    };
    words.retain(is_bare);
    if words.is_empty() {
        return Cow::Borrowed(text);
    }
    let mut quoted = String::with_capacity(text.len() + 2 * words.len());
    let mut done = 0;
    for word in words {
        quoted.push_str(text.get(done..word.start).unwrap_or_default());
        quoted.push('"');
        quoted.push_str(text.get(word.clone()).unwrap_or_default());
        quoted.push('"');
        done = word.end;
    }
    quoted.push_str(text.get(done..).unwrap_or_default());
    Cow::Owned(quoted)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fingers(text: &str) -> Option<Vec<String>> {
        IncomingMessage::from_text(text).fingers.map(|all| all.iter().map(|one| one.trim().to_owned()).collect())
    }

    #[test]
    fn fingers_are_cut_out_of_a_message() {
        let of = |list: &[&str]| Some(list.iter().map(|one| (*one).to_owned()).collect::<Vec<_>>());
        assert_eq!(fingers(r#"{"type": "touch", "touches": []}"#), of(&[]));
        assert_eq!(
            fingers(r#"{"touches" : [ {"id":1}, {"id": 2} ], "type":"touch"}"#),
            of(&[r#"{"id":1}"#, r#"{"id": 2}"#])
        );
        let odd = r#"{"a": {"touches": [9]}, "b": "\"touches\": [", "touches": [{"x": "],[", "y": [1, {}]}, 3]}"#;
        assert_eq!(fingers(odd), of(&[r#"{"x": "],[", "y": [1, {}]}"#, "3"]));
        // A key may be written with escapes.
        let escaped = r#"{"type": "touch", "touche\u0073": [{"id": 1}]}"#;
        assert_eq!(fingers(escaped), of(&[r#"{"id":1}"#]));
        assert!(IncomingMessage::from_text(escaped).rest.is_ok());
        // A value is no key, and a list that does not end is none.
        assert_eq!(fingers(r#"{"kind": "touches", "x": [1]}"#), None);
        assert_eq!(fingers(r#"{"touches": [{"id": 1}"#), None);
        assert_eq!(fingers(r#"{"touches": null, "x": [1]}"#), None);
        assert_eq!(fingers("]]]}"), None);
        assert_eq!(
            fingers(r#"{"touches": [NaN, -Infinity, 1e999, true]}"#),
            of(&["\"NaN\"", "\"-Infinity\"", "1e999", "true"])
        );
    }

    #[test]
    fn the_place_of_a_mistake_is_that_in_the_message_as_it_was_sent() {
        for (text, place) in [
            ("{bad", "line 1 column 2"),
            (r#"{"type": "touch", "intensity_g": bad, "touches": [{"id": 1, "x_px": 3}]"#, "line 1 column 34"),
        ] {
            let problem = format!("{:?}", IncomingMessage::from_text(text).rest.expect_err("no JSON"));
            assert!(problem.contains(place), "{text}: {problem}");
        }
    }

    #[test]
    fn a_stop_is_found_whatever_is_beside_it() {
        for stop in [
            r#"{"type":"stop"}"#,
            r#"{ "type" : "st\u006fp" }"#,
            r#"{"type":"stop","x":NaN}"#,
            r#"{"x":NaN,"type":"stop"}"#,
            r#"{"type":"stop","x":-Infinity}"#,
            r#"{"type":"stop","x":{"y":[NaN, "}"]}}"#,
            r#"{"x":{"y":[NaN, "}{"]}, "type":"stop"}"#,
            "{\"type\":\"stop\"}\n{\"type\":\"stop\"}\n",
            "{\"type\":\"touch\",\"touches\":[]}\n{\"type\":\"stop\"}",
            r#"{"type":"stop"};"#,
            "{\"type\":\"stop\"}\0",
            r#"{"type":"stop"} // now"#,
            r#"{"type":"stop",}"#,
            r#"[{"type":"stop"}]"#,
            r#"{"type":"touch","type":"stop"}"#,
            r#"{"type":"stop","x":"\ud800"}"#,
            r#"{"type":"stop","x":"#,
        ] {
            assert!(
                list_values_of_top_level_type_keys_in_possibly_invalid_json(stop.as_bytes())
                    .contains(&"stop".to_owned()),
                "{stop}"
            );
        }
        assert!(
            list_values_of_top_level_type_keys_in_possibly_invalid_json(b"{\"type\":\"stop\",\"x\":\"\xff\"}")
                .contains(&"stop".to_owned())
        );
        for other in [
            "",
            "\"",
            "stop",
            r#""stop""#,
            r#"{"type":"touch","touches":[{"type":"stop"}]}"#,
            r#"{"kind":"type", "x":"stop"}"#,
            r#"{"x":"{\"type\":\"stop\"}"}"#,
            r#"{"type":["stop"]}"#,
            r#"{"type":{"x":"stop"}}"#,
            r#"{"type"}"stop""#,
        ] {
            assert!(
                !list_values_of_top_level_type_keys_in_possibly_invalid_json(other.as_bytes())
                    .contains(&"stop".to_owned()),
                "{other}"
            );
        }
    }

    #[test]
    fn lifts_are_found_whatever_is_behind_them() {
        for text in [
            r#"{"type":"touch","touches":[{"id":2}]}}"#,
            r#"{"type":"touch","touches":[{"id":2}]}x"#,
            r#"{"type":"touch","touches":[{"id":2}],}"#,
        ] {
            let message = IncomingMessage::from_text(text);
            assert!(message.rest.is_err() && message.is_touch && message.list_finger_ids() == [2], "{text}");
        }
    }

    #[test]
    fn what_is_no_json_is_quoted_and_all_else_stays() {
        for same in [r#"{"a": [1e5, -2.5E-3, true, false, null, "NaN é \" x"]}"#, "", "[", r#"{"a": "é"#] {
            assert_eq!(quote_bare_words(same), same);
        }
        assert_eq!(quote_bare_words(r#"{"a":NaN,"b":-Infinity}"#), r#"{"a":"NaN","b":"-Infinity"}"#);
    }
}
