//! A design as JSON.

use super::design::{DesignedDrive, EffectDesign, EffectPrediction};
use super::effect_window::EffectWindow;
use super::named::NamedEffect;
use crate::drive::Drive;
use crate::plan::limitation::Limitation;
use era_shared::waveform::{FULL_LEVEL, Segment};
use serde::Serialize;

/// An effect as designed for a plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct EffectView {
    /// Which.
    pub name: NamedEffect,
    /// What is played on each drive of the plan, in its order; none for a click or a double click of single windows.
    pub drives: Vec<EffectDriveView>,
    /// The windows of a click or a double click of single windows, by their begin; none of other effects.
    pub windows: Vec<EffectWindow>,
    /// The largest force in N of each actuator, in the order of the scene, for which `best_possible_g` was computed; empty if it was not.
    pub best_possible_forces_n: Vec<f64>,
    /// What it should do at the first target.
    pub predicted: EffectPrediction,
    /// Whether anything keeps it below what was asked for.
    pub limited: bool,
    /// What does, as `voltage of left`; null if nothing does.
    pub limited_by: Option<String>,
    /// The same for programs; empty if nothing does.
    pub limits: Vec<Limitation>,
}

/// One drive's part of an effect.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "schema", schema(as = EffectDrive))]
pub struct EffectDriveView {
    /// At full level.
    #[serde(flatten)]
    pub drive: Drive,
    /// What the board plays, one after the other.
    pub segments: Vec<SegmentView>,
    /// How often it plays all of them.
    pub times: u16,
}

/// A part of an effect; levels as parts of the full force, -1 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "schema", schema(as = EffectSegment))]
#[serde(untagged)]
pub enum SegmentView {
    /// One level for a time.
    Hold {
        /// -1 to 1.
        level: f64,
        /// How long, in ms.
        duration_ms: u16,
    },
    /// From one level to another, evenly.
    Ramp {
        /// -1 to 1, at its beginning.
        from_level: f64,
        /// -1 to 1, at its end.
        to_level: f64,
        /// How long, in ms.
        duration_ms: u16,
    },
    /// One level for whole cycles of the drive.
    Cycles {
        /// -1 to 1.
        level: f64,
        /// How many.
        cycles: u16,
    },
}

impl EffectView {
    /// Effect, drives with their segments, and prediction.
    #[must_use]
    pub fn new(design: &EffectDesign) -> Self {
        Self {
            name: design.effect,
            drives: design.drives.iter().map(EffectDriveView::new).collect(),
            windows: design.windows.clone(),
            best_possible_forces_n: design.best_possible_forces_n.clone(),
            predicted: design.predicted,
            limited: design.limited_by.is_some(),
            limited_by: design.limited_by.clone(),
            limits: design.limits.clone(),
        }
    }
}

impl EffectDriveView {
    fn new(designed: &DesignedDrive) -> Self {
        Self {
            drive: designed.drive.clone(),
            segments: designed.effect.segments.iter().map(SegmentView::new).collect(),
            times: designed.effect.times,
        }
    }
}

impl SegmentView {
    fn new(segment: &Segment) -> Self {
        let part = |level: i16| f64::from(level) / f64::from(FULL_LEVEL);
        match *segment {
            Segment::Hold { level, milliseconds } => Self::Hold { level: part(level), duration_ms: milliseconds },
            Segment::Ramp { from, to, milliseconds } => {
                Self::Ramp { from_level: part(from), to_level: part(to), duration_ms: milliseconds }
            }
            Segment::Cycles { level, count } => Self::Cycles { level: part(level), cycles: count },
        }
    }
}

/// Segments in one line: `3 cycles at 1.00, 1 cycle at -0.61`.
#[must_use]
pub fn describe_segments(drive: &DesignedDrive) -> String {
    let part = |level: i16| f64::from(level) / f64::from(FULL_LEVEL);
    let one = |segment: &Segment| match *segment {
        Segment::Hold { level: 0, milliseconds } => format!("{milliseconds} ms of rest"),
        Segment::Hold { level, milliseconds } => format!("{milliseconds} ms at {:.2}", part(level)),
        Segment::Ramp { from, to, milliseconds } => {
            format!("{milliseconds} ms from level {:.2} to level {:.2}", part(from), part(to))
        }
        Segment::Cycles { level, count: 1 } => format!("1 cycle at {:.2}", part(level)),
        Segment::Cycles { level, count } => format!("{count} cycles at {:.2}", part(level)),
    };
    let segments: Vec<String> = drive.effect.segments.iter().map(one).collect();
    let times = if drive.effect.times > 1 {
        format!(
            "; this sequence is played {} times in \
        total",
            drive.effect.times
        )
    } else {
        String::new()
    };
    segments.join(", ") + &times
}
