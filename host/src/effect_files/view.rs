//! What was read of a file, and what a panel makes of it, as answers have it.

use super::events::EventList;
use super::format::FileFormat;
use super::panel::{PanelEffect, PanelPart, PartKind, ScaleView};
use serde::Serialize;
use utoipa::ToSchema;

/// What was read of an effect file, and what the panel makes of it.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = EffectFileReading)]
pub struct ReadingView {
    /// What the file calls it; null if it has no name.
    pub name: Option<String>,
    /// What the file was read as.
    pub format: FileFormat,
    /// How many events it has, with all loops played out.
    pub event_count: usize,
    /// From its begin to the end of its last event, in ms.
    pub duration_ms: f64,
    /// What of the file is left out or changed, and why.
    pub warnings: Vec<String>,
    /// Where something is played.
    pub places: Vec<PlaceView>,
    /// What intensity 1 is, by place and kind.
    pub scales: Vec<ScaleView>,
    /// What is played, by its begin.
    pub parts: Vec<PartView>,
}

/// A place of an effect.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = EffectPlace)]
pub struct PlaceView {
    /// From the left edge in mm.
    pub x_mm: f64,
    /// From the top edge in mm.
    pub y_mm: f64,
}

/// One thing that is played.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = EffectPart)]
pub struct PartView {
    /// From the effect's begin, in ms.
    pub begin_ms: usize,
    /// For how long it is driven, in ms.
    pub duration_ms: f64,
    /// Number of its place, from 0.
    pub place: usize,
    /// How it is made.
    pub kind: PartKind,
    /// 0 to 1; of an envelope the largest.
    pub intensity: f64,
    /// 0 to 1, as it was asked for.
    pub sharpness: f64,
    /// Peak that it makes, in g.
    pub peak_g: f64,
    /// When its peak comes, in ms from the part's begin.
    pub peak_at_ms: f64,
    /// What keeps it below what was asked for; null if nothing does.
    pub limited_by: Option<String>,
}

impl ReadingView {
    /// Of a file that was read as `list`, with the warnings of its parts.
    #[must_use]
    pub fn new(list: &EventList, warnings: &[String], effect: &PanelEffect) -> Self {
        let place = |place: &super::panel::PanelPlace| PlaceView { x_mm: 1e3 * place.x_m, y_mm: 1e3 * place.y_m };
        Self {
            name: list.name.clone(),
            format: list.format,
            event_count: list.events.len(),
            duration_ms: 1e3 * list.duration_s(),
            warnings: list.warnings.iter().chain(warnings).cloned().collect(),
            places: effect.places.iter().map(place).collect(),
            scales: effect.scales.clone(),
            parts: effect.parts.iter().map(PartView::new).collect(),
        }
    }
}

impl PartView {
    fn new(part: &PanelPart) -> Self {
        let PanelPart { begin_ms, place, kind, intensity, sharpness, ref design } = *part;
        Self {
            begin_ms,
            duration_ms: design.length_ms,
            place,
            kind,
            intensity,
            sharpness,
            peak_g: design.predicted.peak_g,
            peak_at_ms: design.predicted.peak_at_ms,
            limited_by: design.limited_by.clone(),
        }
    }
}
