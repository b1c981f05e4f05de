//! What every format is read into: a list of events with their times.

use super::error::ReadError;
use super::format::FileFormat;
use serde::Serialize;

/// Most events of a file, with all loops played out.
pub const MAX_EVENTS: usize = 1000;
/// Longest effect in s.
pub const MAX_DURATION_S: f64 = 30.0;
/// Most points of all envelopes together.
const MAX_POINTS: usize = 100_000;
/// Most warnings that are kept.
const MAX_WARNINGS: usize = 100;

/// An effect as it was read.
#[derive(Clone, Debug, PartialEq)]
pub struct EventList {
    /// What the file calls it.
    pub name: Option<String>,
    /// What it was read from.
    pub format: FileFormat,
    /// By their times.
    pub events: Vec<HapticEvent>,
    /// What of the file was left out or changed, and why.
    pub warnings: Vec<String>,
    points: usize,
    warnings_left_out: usize,
}

/// An event.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HapticEvent {
    /// From the effect's begin in s.
    pub time_s: f64,
    /// Strength, 0 to 1.
    pub intensity: f64,
    /// 0 (dull) to 1 (sharp).
    pub sharpness: f64,
    /// To the right of the touched place, in mm.
    pub dx_mm: f64,
    /// Below the touched place, in mm.
    pub dy_mm: f64,
    /// Whether it is one pulse, or lasts.
    #[serde(flatten)]
    pub kind: EventKind,
}

/// Whether an event is one pulse, or lasts.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum EventKind {
    /// One pulse.
    Transient,
    /// A vibration that lasts.
    Continuous {
        /// How long in s.
        duration_s: f64,
        /// What the intensity is multiplied by over time, straight lines between points; 1 if empty.
        envelope: Vec<EnvelopePoint>,
    },
}

/// A point of an envelope.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EnvelopePoint {
    /// From the event's begin in s; two points at one time are a step.
    pub time_s: f64,
    /// What the intensity is multiplied by, 0 to 1.
    pub level: f64,
}

impl HapticEvent {
    /// A pulse at the touched place.
    #[must_use]
    pub const fn new_transient(time_s: f64, intensity: f64, sharpness: f64) -> Self {
        Self { time_s, intensity, sharpness, dx_mm: 0.0, dy_mm: 0.0, kind: EventKind::Transient }
    }

    /// A vibration at the touched place.
    #[must_use]
    pub const fn new_continuous(
        (time_s, duration_s): (f64, f64),
        intensity: f64,
        sharpness: f64,
        envelope: Vec<EnvelopePoint>,
    ) -> Self {
        let kind = EventKind::Continuous { duration_s, envelope };
        Self { time_s, intensity, sharpness, dx_mm: 0.0, dy_mm: 0.0, kind }
    }

    /// When it ends, in s from the effect's begin.
    #[must_use]
    pub const fn end_s(&self) -> f64 {
        match self.kind {
            EventKind::Transient => self.time_s,
            EventKind::Continuous { duration_s, .. } => self.time_s + duration_s,
        }
    }
}

/// The level of an envelope at a time: before its first point that of the first, after its last that of the last.
#[must_use]
pub fn envelope_level_at(envelope: &[EnvelopePoint], time_s: f64) -> f64 {
    let after = envelope.partition_point(|point| point.time_s <= time_s);
    let before = after.checked_sub(1).and_then(|i| envelope.get(i));
    match (before, envelope.get(after)) {
        (Some(from), Some(to)) => {
            from.level + (to.level - from.level) * (time_s - from.time_s) / (to.time_s - from.time_s)
        }
        (Some(only), None) | (None, Some(only)) => only.level,
        (None, None) => 1.0,
    }
}

/// Mean over time of the straight lines between an envelope's points; of a single point its level, and of none `None`.
#[must_use]
pub fn find_mean_level(envelope: &[EnvelopePoint]) -> Option<f64> {
    let area = |pair: &[EnvelopePoint]| match pair {
        [from, to] => (to.time_s - from.time_s, 0.5 * (from.level + to.level) * (to.time_s - from.time_s)),
        _ => (0.0, 0.0),
    };
    let (time, sum) = envelope.windows(2).map(area).fold((0.0, 0.0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
    if time > 0.0 { Some(sum / time) } else { envelope.first().map(|first| first.level) }
}

/// The sharpness that stands for a frequency: 65 Hz is 0 and 300 Hz is 1, as in the reference software of ISO/IEC 23090-31.
#[must_use]
pub fn sharpness_from_hz(frequency_hz: f64) -> f64 {
    ((frequency_hz - 65.0) / (300.0 - 65.0)).clamp(0.0, 1.0)
}

impl EventList {
    /// A list without events.
    #[must_use]
    pub fn new(format: FileFormat, name: Option<String>) -> Self {
        let name = name.filter(|name| !name.trim().is_empty());
        Self { name, format, events: Vec::new(), warnings: Vec::new(), points: 0, warnings_left_out: 0 }
    }

    /// Says what was left out or changed; once, if it is said of many.
    pub fn warn(&mut self, warning: impl Into<String>) {
        let warning = warning.into();
        if self.warnings.contains(&warning) {
            return;
        }
        if self.warnings.len() < MAX_WARNINGS {
            self.warnings.push(warning);
        } else {
            self.warnings_left_out += 1;
        }
    }

    /// A number of the file within a range: a value outside counts as the nearest value of the range, as in Core Haptics.
    pub fn clamp_with_warning(&mut self, field: &str, value: f64, (min, max): (f64, f64)) -> f64 {
        if (min..=max).contains(&value) {
            return value;
        }
        let nearest = if value > max { max } else { min };
        let allowed = if max < f64::MAX { format!("{min} to {max}") } else { format!("at least {min}") };
        self.warn(format!("{field} is {value}, but must be {allowed}: {nearest} is used"));
        nearest
    }

    /// Adds an event that the file calls `field`, as far as it is within the limits.
    pub fn add_event_within_limits(&mut self, field: &str, mut event: HapticEvent) {
        let numbers = [event.time_s, event.intensity, event.sharpness, event.end_s()];
        if numbers.iter().any(|number| !number.is_finite()) {
            return self.warn(format!("{field} is left out: one of its values is not a finite number"));
        }
        event.time_s = self.clamp_with_warning(&format!("time of {field} in s"), event.time_s, (0.0, f64::MAX));
        event.intensity = self.clamp_with_warning(&format!("intensity of {field}"), event.intensity, (0.0, 1.0));
        event.sharpness = self.clamp_with_warning(&format!("sharpness of {field}"), event.sharpness, (0.0, 1.0));
        if event.time_s >= MAX_DURATION_S {
            return self.warn(format!(
                "{field} is left out: it begins at {} s, but an effect may last at most {MAX_DURATION_S} s",
                event.time_s
            ));
        }
        let end_s = event.end_s();
        if let EventKind::Continuous { duration_s, envelope } = &mut event.kind {
            if *duration_s <= 0.0 {
                return self.warn(format!("{field} is left out: its duration is {duration_s} s, but must be above 0"));
            }
            *duration_s = duration_s.min(MAX_DURATION_S - event.time_s);
            self.points += envelope.len();
            if self.points > MAX_POINTS {
                return self
                    .warn(format!("{field} is left out: all envelopes together have more than {MAX_POINTS} points"));
            }
        }
        if end_s > MAX_DURATION_S {
            self.warn(format!(
                "{field} is cut: it ends after {end_s} s, but an effect may last at most {MAX_DURATION_S} s"
            ));
        }
        if event.intensity <= 0.0 {
            return self.warn(format!("{field} is left out: its intensity is 0"));
        }
        if self.events.len() >= MAX_EVENTS {
            self.points = MAX_POINTS + 1;
            return self.warn(format!("all events after the first {MAX_EVENTS} are left out"));
        }
        self.events.push(event);
    }

    /// Whether nothing is taken any more, so that nothing need be worked out for it.
    #[must_use]
    pub const fn is_full(&self) -> bool {
        self.points > MAX_POINTS
    }

    /// The list in the order of the events' times.
    ///
    /// # Errors
    /// [`ReadError::NoEvents`].
    pub fn finish(mut self) -> Result<Self, ReadError> {
        if self.events.is_empty() {
            return Err(ReadError::NoEvents { format: self.format, warnings: self.warnings });
        }
        if self.warnings_left_out > 0 {
            self.warnings.push(format!("number of further warnings, which are not shown: {}", self.warnings_left_out));
        }
        self.events.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        Ok(self)
    }

    /// When the last event ends, in s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.events.iter().map(HapticEvent::end_s).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_envelope_is_straight_between_points_and_steps_at_two() {
        let point = |time_s, level| EnvelopePoint { time_s, level };
        let envelope = [point(0.1, 0.2), point(0.3, 0.6), point(0.3, 1.0), point(0.5, 0.0)];
        for (time_s, level) in [(0.0, 0.2), (0.2, 0.4), (0.3, 1.0), (0.4, 0.5), (0.9, 0.0)] {
            assert!((envelope_level_at(&envelope, time_s) - level).abs() < 1e-12, "{time_s}");
        }
        assert_eq!(envelope_level_at(&[], 3.0), 1.0);
    }

    #[test]
    fn what_is_beyond_the_limits_is_said() {
        let mut list = EventList::new(FileFormat::Ahap, None);
        list.add_event_within_limits("A", HapticEvent::new_transient(-1.0, 3.0, 0.5));
        list.add_event_within_limits("B", HapticEvent::new_continuous((29.0, 5.0), 0.5, 0.5, Vec::new()));
        list.add_event_within_limits("C", HapticEvent::new_transient(31.0, 1.0, 0.5));
        list.add_event_within_limits("D", HapticEvent::new_transient(f64::NAN, 1.0, 0.5));
        list.add_event_within_limits("E", HapticEvent::new_continuous((0.0, 0.0), 0.5, 0.5, Vec::new()));
        for _ in 0..MAX_EVENTS {
            list.add_event_within_limits("F", HapticEvent::new_transient(1.0, 1.0, 0.5));
        }
        let list = list.finish().unwrap();
        assert_eq!((list.events.len(), list.duration_s()), (MAX_EVENTS, MAX_DURATION_S));
        assert_eq!(list.events[0], HapticEvent::new_transient(0.0, 1.0, 0.5));
        let said = list.warnings.join("\n");
        for part in [
            "time of A in s is -1, but must be at least 0: 0 is used",
            "intensity of A is 3, but must be 0 to 1: 1 is used",
            "B is cut: it ends after 34 s",
            "C is left out: it begins at 31 s",
            "D is left out: one of its values is not a finite number",
            "E is left out: its duration is 0 s",
            "all events after the first 1000 are left out",
        ] {
            assert!(said.contains(part), "{part}: {said}");
        }
    }
}
