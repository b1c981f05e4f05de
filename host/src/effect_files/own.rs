//! This program's own format, as TOML and as JSON. It is strict: what is wrong in it is an error that names the field.

use super::error::ReadError;
use super::events::{EnvelopePoint, EventKind, EventList, HapticEvent, MAX_DURATION_S, MAX_EVENTS};
use super::format::FileFormat;
use super::primitive::Primitive;
use crate::serde_messages::{
    describe_expected_type, describe_unknown_field, parse_unknown_field_and_find_nearest, parse_wrong_value,
};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The version that is read.
const VERSION: u32 = 1;
/// What only a scene file has at its top.
const SCENE_KEYS: [&str; 6] = ["surface", "support", "actuator", "screen", "layer", "edge"];
/// Sequences inside each other.
const MAX_DEPTH: usize = 8;
/// Most events and sequences, with all loops played out.
const MAX_STEPS: usize = 10 * MAX_EVENTS;
/// How often something is repeated at most.
const MAX_REPEATS: f64 = 1000.0;
/// Most points of an envelope.
pub const MAX_ENVELOPE_POINTS: usize = 100;
/// Furthest from the touched place in mm: 2 m.
const MAX_OFFSET_MM: f64 = 2000.0;

/// An effect file in the format of this program.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EffectFile {
    /// Version of the format: 1.
    #[serde(deserialize_with = "crate::whole_numbers::deserialize_whole_number")]
    pub version: u32,
    /// Name of the effect.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Plays the whole effect several times.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repeat: Option<Repeat>,
    /// The primitives and sequences that are played.
    pub events: Vec<FileEvent>,
}

/// A primitive or a sequence.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FileEvent {
    /// The primitive that is played; absent with `events`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub primitive: Option<Primitive>,
    /// A sequence that is played as one event; absent with `primitive`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(no_recursion)]
    pub events: Option<Vec<FileEvent>>,
    /// Begin of the event in ms from the begin of the effect or sequence that contains it; absent with `pause_ms`. Without both, the event begins at
    /// the end of the previous event.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_ms: Option<f64>,
    /// Time from the end of the previous event to the begin of this event, in ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pause_ms: Option<f64>,
    /// Duration in ms; only for primitives that have a duration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub duration_ms: Option<f64>,
    /// Strength, 0 to 1; 1 if absent. It multiplies the intensity of the primitive, or of all events of the sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub intensity: Option<f64>,
    /// 0 (dull) to 1 (sharp); replaces the sharpness of the primitive. Not allowed for a sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sharpness: Option<f64>,
    /// Factors of the intensity over time; replaces the envelope of the primitive. Only for primitives that have a duration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub envelope: Option<Vec<FilePoint>>,
    /// Plays the event several times.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repeat: Option<Repeat>,
    /// Distance to the right of the touched place in mm; 0 if absent. It is added to the distance of the sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dx_mm: Option<f64>,
    /// Distance below the touched place in mm; 0 if absent. It is added to the distance of the sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dy_mm: Option<f64>,
}

/// A point of an envelope.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FilePoint {
    /// Time from the begin of the event in ms.
    pub time_ms: f64,
    /// Factor of the intensity, 0 to 1.
    pub level: f64,
}

/// How often something is played.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Repeat {
    /// Number of repeats, 1 to 1000.
    #[serde(deserialize_with = "crate::whole_numbers::deserialize_whole_number")]
    pub count: u32,
    /// Time from one begin to the next in ms; the duration of what is repeated if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period_ms: Option<f64>,
}

/// Numbers in effect files: the structure's name in the interface's description, the field's name, and the least and most that it takes.
pub const FIELD_RANGES: [(&str, &str, (f64, f64)); 12] = {
    const LONGEST_MS: f64 = 1e3 * MAX_DURATION_S;
    const OFFSET: (f64, f64) = (-MAX_OFFSET_MM, MAX_OFFSET_MM);
    [
        ("EffectFile", "version", (1.0, 1.0)),
        ("Repeat", "count", (1.0, MAX_REPEATS)),
        ("Repeat", "period_ms", (1.0, LONGEST_MS)),
        ("FileEvent", "time_ms", (0.0, LONGEST_MS)),
        ("FileEvent", "pause_ms", (0.0, LONGEST_MS)),
        ("FileEvent", "duration_ms", (1.0, LONGEST_MS)),
        ("FileEvent", "intensity", (0.0, 1.0)),
        ("FileEvent", "sharpness", (0.0, 1.0)),
        ("FileEvent", "dx_mm", OFFSET),
        ("FileEvent", "dy_mm", OFFSET),
        ("FilePoint", "time_ms", (0.0, LONGEST_MS)),
        ("FilePoint", "level", (0.0, 1.0)),
    ]
};

/// Reads a text of TOML or JSON.
///
/// # Errors
/// [`ReadError`] with the field.
pub fn read_own_text(text: &str, format: FileFormat) -> Result<EventList, ReadError> {
    let syntax = |detail: &str| ReadError::Syntax { format, detail: detail.trim_end().to_owned() };
    let file: EffectFile = if format == FileFormat::Toml {
        let read = toml::Deserializer::parse(text).map_err(|error| syntax(&error.to_string()))?;
        serde_path_to_error::deserialize(read)
            .map_err(|error| read_error_from_serde(error.path(), error.inner().message()))?
    } else {
        serde_path_to_error::deserialize(&mut serde_json::Deserializer::from_str(text)).map_err(|error| {
            let message = error.inner().to_string();
            if error.inner().is_data() { read_error_from_serde(error.path(), &message) } else { syntax(&message) }
        })?
    };
    list_events_of_file(file, format)
}

/// What is wrong with a field, or with what is at this path, of a text that is of its format.
fn read_error_from_serde(path: &serde_path_to_error::Path, message: &str) -> ReadError {
    let path = path.to_string();
    let inside = |name: &str| match path.as_str() {
        "." => name.to_owned(),
        // A key may be in the path already.
        path if path == name || path.ends_with(&format!(".{name}")) => path.to_owned(),
        path => format!("{path}.{name}"),
    };
    if let Some((name, nearest)) = parse_unknown_field_and_find_nearest(message) {
        let known = message.split('`').skip(3).step_by(2).collect::<Vec<_>>().join(", ");
        let is_at_top = inside(name) == name;
        let of_what = if is_at_top { "of an effect file" } else { "here" };
        let hint = match nearest {
            Some(_) => String::new(),
            None if is_at_top && SCENE_KEYS.contains(&name) => {
                format!(": this is a scene, but an effect file is needed, with the fields {known}")
            }
            None => format!("; the known fields {of_what} are {known}"),
        };
        return ReadError::UnreadField(format!("{} {}{hint}", inside(name), describe_unknown_field(nearest)));
    }
    if let Some((_, name)) = message.split_once("missing field `") {
        return ReadError::UnreadField(format!("{} is missing", inside(name.split('`').next().unwrap_or(name))));
    }
    if let Some((value, allowed)) = parse_wrong_value(message).zip(describe_expected_type(message)) {
        return ReadError::new_field_error(&path, value, allowed);
    }
    ReadError::UnreadField(if path == "." { message.to_owned() } else { format!("{path}: {message}") })
}

/// The events of a file, with all loops played out.
///
/// # Errors
/// [`ReadError`] with the field.
pub fn list_events_of_file(file: EffectFile, format: FileFormat) -> Result<EventList, ReadError> {
    if file.version != VERSION {
        return Err(ReadError::new_field_error("version", file.version, VERSION.to_string()));
    }
    let whole = FileEvent { events: Some(file.events), repeat: file.repeat, ..FileEvent::default() };
    let mut expansion = Expansion { list: EventList::new(format, file.name), made: 0, steps: 0 };
    expansion.add_event(&whole, "", EventScope { begin_s: 0.0, intensity: 1.0, dx_mm: 0.0, dy_mm: 0.0, depth: 0 })?;
    expansion.list.finish()
}

/// When, how strong and where an event is played.
#[derive(Clone, Copy)]
struct EventScope {
    begin_s: f64,
    intensity: f64,
    dx_mm: f64,
    dy_mm: f64,
    depth: usize,
}

struct Expansion {
    list: EventList,
    made: usize,
    /// Events and sequences that were looked at: sequences may be empty.
    steps: usize,
}

impl Expansion {
    /// Adds an event that the file has at `path`; when it ends, in s.
    fn add_event(&mut self, event: &FileEvent, path: &str, place: EventScope) -> Result<f64, ReadError> {
        let name = |field: &str| if path.is_empty() { field.to_owned() } else { format!("{path}.{field}") };
        let check = |field: &str, value: Option<f64>, default: f64, (min, max): (f64, f64)| {
            let value = value.unwrap_or(default);
            let fits = (min..=max).contains(&value);
            if fits {
                Ok(value)
            } else {
                Err(ReadError::new_field_error(name(field), value, format!("{min} to {max}")))
            }
        };
        let intensity = place.intensity * check("intensity", event.intensity, 1.0, (0.0, 1.0))?;
        let offset = (-MAX_OFFSET_MM, MAX_OFFSET_MM);
        let dx_mm = place.dx_mm + check("dx_mm", event.dx_mm, 0.0, offset)?;
        let dy_mm = place.dy_mm + check("dy_mm", event.dy_mm, 0.0, offset)?;
        let place = EventScope { intensity, dx_mm, dy_mm, depth: place.depth + 1, ..place };
        let Some(Repeat { count, period_ms }) = event.repeat else {
            return self.add_event_once(event, path, place);
        };
        let count = check("repeat.count", Some(f64::from(count)), 1.0, (1.0, MAX_REPEATS))?;
        let period_ms =
            period_ms.map(|ms| check("repeat.period_ms", Some(ms), ms, (1.0, 1e3 * MAX_DURATION_S))).transpose()?;
        let (mut begin_s, mut end_s) = (place.begin_s, place.begin_s);
        let mut round = 0.0;
        while round < count {
            end_s = self.add_event_once(event, path, EventScope { begin_s, ..place })?;
            round += 1.0;
            begin_s = period_ms.map_or(end_s, |ms| place.begin_s + 1e-3 * ms * round);
        }
        Ok(end_s)
    }

    fn add_event_once(&mut self, event: &FileEvent, path: &str, place: EventScope) -> Result<f64, ReadError> {
        let name = |field: &str| if path.is_empty() { field.to_owned() } else { format!("{path}.{field}") };
        self.steps += 1;
        if self.steps > MAX_STEPS {
            let allowed = format!(
                "at most {MAX_STEPS} events and sequences in the whole file, with all repeats \
                                   counted"
            );
            return Err(ReadError::new_field_error(name("events"), "too long", allowed));
        }
        match (event.primitive, &event.events) {
            (Some(primitive), None) => self.add_primitive(event, primitive, path, place),
            (None, Some(events)) => {
                let alone = [
                    ("duration_ms", event.duration_ms.is_some()),
                    ("sharpness", event.sharpness.is_some()),
                    ("envelope", event.envelope.is_some()),
                ];
                if let Some((field, _)) = alone.into_iter().find(|(_, is_given)| *is_given) {
                    return Err(ReadError::new_field_error(
                        name(field),
                        "given",
                        format!("absent, because a sequence has no {field}"),
                    ));
                }
                if place.depth > MAX_DEPTH {
                    let allowed = format!("nested at most {MAX_DEPTH} levels deep");
                    return Err(ReadError::new_field_error(name("events"), "nested too deeply", allowed));
                }
                self.add_sequence(events, path, place)
            }
            (Some(_), Some(_)) => Err(ReadError::new_field_error(name("events"), "given", "absent with `primitive`")),
            (None, None) => {
                Err(ReadError::new_field_error(name("primitive"), "missing", "given if `events` is missing"))
            }
        }
    }

    /// When its last event ends, in s.
    fn add_sequence(&mut self, events: &[FileEvent], path: &str, place: EventScope) -> Result<f64, ReadError> {
        let (mut previous_end_s, mut last_end_s) = (place.begin_s, place.begin_s);
        for (i, inner) in events.iter().enumerate() {
            let inner_path = if path.is_empty() { format!("events[{i}]") } else { format!("{path}.events[{i}]") };
            let time = |field: &str, ms: f64| {
                let fits = (0.0..=1e3 * MAX_DURATION_S).contains(&ms);
                let allowed = format!("0 to {}", 1e3 * MAX_DURATION_S);
                if fits {
                    Ok(1e-3 * ms)
                } else {
                    Err(ReadError::new_field_error(format!("{inner_path}.{field}"), ms, allowed))
                }
            };
            let begin_s = match (inner.time_ms, inner.pause_ms) {
                (Some(_), Some(pause_ms)) => {
                    return Err(ReadError::new_field_error(
                        format!("{inner_path}.pause_ms"),
                        pause_ms,
                        "absent with time_ms",
                    ));
                }
                (Some(time_ms), None) => place.begin_s + time("time_ms", time_ms)?,
                (None, pause_ms) => previous_end_s + time("pause_ms", pause_ms.unwrap_or(0.0))?,
            };
            previous_end_s = self.add_event(inner, &inner_path, EventScope { begin_s, ..place })?;
            last_end_s = last_end_s.max(previous_end_s);
        }
        Ok(last_end_s)
    }

    fn add_primitive(
        &mut self,
        event: &FileEvent,
        primitive: Primitive,
        path: &str,
        place: EventScope,
    ) -> Result<f64, ReadError> {
        let sharpness = event.sharpness;
        if let Some(value) = sharpness.filter(|value| !(0.0..=1.0).contains(value)) {
            return Err(ReadError::new_field_error(format!("{path}.sharpness"), value, "0 to 1"));
        }
        let longest_ms = 1e3 * MAX_DURATION_S;
        match (event.duration_ms, primitive.default_duration_s()) {
            (Some(ms), Some(_)) if !(1.0..=longest_ms).contains(&ms) => {
                return Err(ReadError::new_field_error(
                    format!("{path}.duration_ms"),
                    ms,
                    format!("1 to {longest_ms}"),
                ));
            }
            (Some(ms), None) => {
                let allowed = format!("absent, because the primitive {} has no duration", primitive.name());
                return Err(ReadError::new_field_error(format!("{path}.duration_ms"), ms, allowed));
            }
            _ => {}
        }
        let own_envelope = read_envelope(event.envelope.as_deref(), primitive, path)?;
        let duration_s = event.duration_ms.map(|ms| 1e-3 * ms);
        let mut end_s = place.begin_s;
        for mut made in primitive.list_events(place.intensity, sharpness, duration_s) {
            if let (EventKind::Continuous { envelope, .. }, Some(own)) = (&mut made.kind, &own_envelope) {
                envelope.clone_from(own);
            }
            (made.time_s, made.dx_mm, made.dy_mm) = (made.time_s + place.begin_s, place.dx_mm, place.dy_mm);
            end_s = end_s.max(made.end_s());
            self.add_made_event(made, path)?;
        }
        Ok(end_s)
    }

    fn add_made_event(&mut self, event: HapticEvent, path: &str) -> Result<(), ReadError> {
        self.made += 1;
        if self.made > MAX_EVENTS {
            let (field, allowed) = (
                format!("the number of events in the file up to and including {path}"),
                format!(
                    "at \
                                             most {MAX_EVENTS}"
                ),
            );
            return Err(ReadError::new_field_error(field, self.made, allowed + ", with all repeats counted"));
        }
        if event.end_s() > MAX_DURATION_S {
            let (end_ms, most_ms) = ((1e3 * event.end_s()).round(), 1e3 * MAX_DURATION_S);
            let (field, allowed) = (format!("the time in ms at which {path} ends"), format!("0 to {most_ms}"));
            return Err(ReadError::new_field_error(field, end_ms, allowed));
        }
        self.list.add_event_within_limits(path, event);
        Ok(())
    }
}

fn read_envelope(
    envelope: Option<&[FilePoint]>,
    primitive: Primitive,
    path: &str,
) -> Result<Option<Vec<EnvelopePoint>>, ReadError> {
    let Some(points) = envelope else { return Ok(None) };
    if primitive.default_duration_s().is_none() {
        let allowed = format!("absent, because the primitive {} has no envelope", primitive.name());
        return Err(ReadError::new_field_error(format!("{path}.envelope"), "given", allowed));
    }
    if !(1..=MAX_ENVELOPE_POINTS).contains(&points.len()) {
        let field = format!("the number of points in {path}.envelope");
        return Err(ReadError::new_field_error(field, points.len(), format!("1 to {MAX_ENVELOPE_POINTS}")));
    }
    let mut before_ms = 0.0;
    let mut read = Vec::new();
    for (i, FilePoint { time_ms, level }) in points.iter().enumerate() {
        let latest_ms = 1e3 * MAX_DURATION_S;
        if !(before_ms..=latest_ms).contains(time_ms) {
            let least = if i == 0 { "0".to_owned() } else { format!("{before_ms} (the time of the previous point)") };
            let allowed = format!("{least} to {latest_ms}");
            return Err(ReadError::new_field_error(format!("{path}.envelope[{i}].time_ms"), time_ms, allowed));
        }
        if !(0.0..=1.0).contains(level) {
            return Err(ReadError::new_field_error(format!("{path}.envelope[{i}].level"), level, "0 to 1"));
        }
        before_ms = *time_ms;
        read.push(EnvelopePoint { time_s: 1e-3 * time_ms, level: *level });
    }
    Ok(Some(read))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<EventList, String> {
        read_own_text(text, FileFormat::Toml).map_err(|error| error.to_string())
    }

    #[test]
    fn sequences_and_loops_are_played_out() {
        let text = r#"
            version = 1
            name = "confirm"
            [[events]]
            primitive = "tick"
            intensity = 0.5
            repeat = { count = 3, period_ms = 100 }
            [[events]]
            time_ms = 500
            intensity = 0.5
            dx_mm = 10
            repeat = { count = 2 }
            [[events.events]]
            primitive = "buzz"
            duration_ms = 40
            envelope = [{ time_ms = 0, level = 1 }, { time_ms = 40, level = 0.5 }]
            [[events.events]]
            primitive = "click"
            pause_ms = 60
            sharpness = 1
            dx_mm = -2
        "#;
        let list = read(text).unwrap();
        assert_eq!((list.name.as_deref(), &list.warnings[..]), (Some("confirm"), &[][..]));
        let found: Vec<(f64, f64, f64)> =
            list.events.iter().map(|event| (event.time_s, event.intensity, event.dx_mm)).collect();
        let expected = [
            (0.0, 0.25, 0.0),
            (0.1, 0.25, 0.0),
            (0.2, 0.25, 0.0),
            (0.5, 0.5, 10.0),
            (0.6, 0.5, 8.0),
            (0.6, 0.5, 10.0),
            (0.7, 0.5, 8.0),
        ];
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            assert!((found.0 - expected.0).abs() < 1e-9 && (found.1, found.2) == (expected.1, expected.2), "{found:?}");
        }
        let EventKind::Continuous { duration_s, envelope } = &list.events[3].kind else { panic!("a vibration") };
        assert_eq!((*duration_s, envelope[1].level), (0.04, 0.5));
        assert_eq!(list.events[4].sharpness, 1.0);
        let json = r#"{"version": 1, "events": [{"primitive": "thud"}]}"#;
        assert_eq!(read_own_text(json, FileFormat::Json).unwrap().events.len(), 1);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let event = |rest: &str| format!("version = 1\n[[events]]\nprimitive = \"buzz\"\n{rest}");
        for (text, message) in [
            ("version = 2\nevents = []".to_owned(), "version is 2, but must be 1"),
            (event("intensity = 1.5"), "events[0].intensity is 1.5, but must be 0 to 1"),
            (event("intensity = nan"), "events[0].intensity is NaN, but must be 0 to 1"),
            (event("duration_ms = 0"), "events[0].duration_ms is 0, but must be 1 to 30000"),
            (event("repeat = { count = 0 }"), "events[0].repeat.count is 0, but must be 1 to 1000"),
            (event("repeat = { count = 900 }"), "at which events[0] ends is 30200"),
            (event("time_ms = 1\npause_ms = 2"), "events[0].pause_ms is 2, but must be absent with time_ms"),
            (
                event("envelope = [{ time_ms = 5, level = 1 }, { time_ms = 4, level = 1 }]"),
                "events[0].envelope[1].time_ms is 4, but must be 5 (the time of the previous point) to 30000",
            ),
            (event("[[events]]\nprimitive = \"click\"\nduration_ms = 5"), "the primitive click has no duration"),
            (event("[[events]]"), "events[1].primitive is missing, but must be given if `events` is missing"),
            (event("loudness = 1"), "events[0].loudness is not a known field; the known fields here are "),
            (event("sharpnes = 1"), "events[0].sharpnes is not a known field; did you mean sharpness?"),
            // A scene, given as an effect.
            (
                "[[actuator]]".to_owned(),
                "actuator is not a known field: this is a scene, but an effect file is needed, with the fields version",
            ),
            ("version = 1\nevnts = []".to_owned(), "evnts is not a known field; did you mean events?"),
            (event("intensity = \"much\""), "events[0].intensity is string \"much\", but must be a number"),
            (event("intensity = "), "the file is not a valid TOML file"),
        ] {
            let found = read(&text).unwrap_err();
            assert!(found.contains(message), "{message}: {found}");
        }
        let many = "version = 1\nrepeat = { count = 1000, period_ms = 1 }\n[[events]]\nprimitive = \"success\"";
        assert!(read(many).unwrap_err().contains(
            "the number of events in the file up to and including events[0] is 1001, but must be at most 1000"
        ));
        let empty = (0..4)
            .fold("[]".to_owned(), |inner, _| format!("[{{\"repeat\": {{\"count\": 1000}}, \"events\": {inner}}}]"));
        let empty = read_own_text(&format!("{{\"version\": 1, \"events\": {empty}}}"), FileFormat::Json);
        assert!(empty.unwrap_err().to_string().contains("at most 10000 events and sequences"));
        let deep =
            (0..9).fold("{\"primitive\": \"click\"}".to_owned(), |inner, _| format!("{{\"events\": [{inner}]}}"));
        let deep = format!("{{\"version\": 1, \"events\": [{deep}]}}");
        let found = read_own_text(&deep, FileFormat::Json).unwrap_err().to_string();
        assert!(found.contains("nested at most 8 levels deep"), "{found}");
    }
}
