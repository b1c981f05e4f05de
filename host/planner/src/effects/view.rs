//! A design as JSON.

use super::design::{Design, DesignedDrive};
use era_shared::waveform::{FULL_LEVEL, Segment};
use serde_json::{Value, json};

/// Effect, drives with their segments, and prediction.
#[must_use]
pub fn json(design: &Design) -> Value {
    json!({
        "name": design.effect,
        "drives": design.drives.iter().map(drive).collect::<Vec<_>>(),
        "predicted": design.predicted,
        "limited": design.limited_by.is_some(),
        "limited_by": design.limited_by,
        "limits": design.limits,
    })
}

fn drive(designed: &DesignedDrive) -> Value {
    let mut value = json!(designed.drive);
    value["segments"] = designed.effect.segments.iter().map(segment).collect();
    value["times"] = designed.effect.times.into();
    value
}

/// Levels as parts of the full force, -1 to 1.
fn segment(segment: &Segment) -> Value {
    let part = |level: i16| f64::from(level) / f64::from(FULL_LEVEL);
    match *segment {
        Segment::Hold { level, milliseconds } => json!({ "level": part(level), "duration_ms": milliseconds }),
        Segment::Ramp { from, to, milliseconds } => {
            json!({ "from_level": part(from), "to_level": part(to), "duration_ms": milliseconds })
        }
        Segment::Cycles { level, count } => json!({ "level": part(level), "cycles": count }),
    }
}

/// Segments in one line: `3 cycles at 1.00, 1 cycle at -0.61`.
#[must_use]
pub fn text(drive: &DesignedDrive) -> String {
    let part = |level: i16| f64::from(level) / f64::from(FULL_LEVEL);
    let one = |segment: &Segment| match *segment {
        Segment::Hold { level: 0, milliseconds } => format!("{milliseconds} ms of nothing"),
        Segment::Hold { level, milliseconds } => format!("{milliseconds} ms at {:.2}", part(level)),
        Segment::Ramp { from, to, milliseconds } => {
            format!("{milliseconds} ms from {:.2} to {:.2}", part(from), part(to))
        }
        Segment::Cycles { level, count: 1 } => format!("1 cycle at {:.2}", part(level)),
        Segment::Cycles { level, count } => format!("{count} cycles at {:.2}", part(level)),
    };
    let segments: Vec<String> = drive.effect.segments.iter().map(one).collect();
    let times = if drive.effect.times > 1 { format!(", {} times", drive.effect.times) } else { String::new() };
    segments.join(", ") + &times
}
