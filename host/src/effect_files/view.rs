//! What was read of a file, and what a panel makes of it, as answers have it.

use super::events::EventList;
use super::format::FileFormat;
use super::panel::{PanelEffect, PanelPart, PartKind, ScaleView};
use serde::Serialize;
use utoipa::ToSchema;

/// The contents of an effect file as they were read, and the parts that the board plays.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = EffectFileReading)]
pub struct ReadingView {
    /// Name of the effect in the file; null without a name.
    pub name: Option<String>,
    /// Format as which the file was read.
    pub format: FileFormat,
    /// Number of events, with all repeats counted.
    pub event_count: usize,
    /// Time from the begin of the effect to the end of its last event, in ms.
    pub duration_ms: f64,
    /// What of the file is left out or changed, and why.
    pub warnings: Vec<String>,
    /// The places at which parts are played.
    pub places: Vec<PlaceView>,
    /// Peak acceleration of intensity 1, for each place and kind.
    pub scales: Vec<ScaleView>,
    /// The parts that the board plays, in the order of their begins.
    pub parts: Vec<PartView>,
}

/// A place at which a part of an effect is played.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = EffectPlace)]
pub struct PlaceView {
    /// Distance from the left edge of the surface in mm.
    pub x_mm: f64,
    /// Distance from the top edge of the surface in mm.
    pub y_mm: f64,
}

/// A part of an effect.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = EffectPart)]
pub struct PartView {
    /// Begin of the part in ms from the begin of the effect.
    pub begin_ms: usize,
    /// Time for which the part is driven, in ms.
    pub duration_ms: f64,
    /// Number of the place in `places`, from 0.
    pub place: usize,
    /// How the panel produces the part.
    pub kind: PartKind,
    /// Intensity, 0 to 1; for an envelope, the largest intensity.
    pub intensity: f64,
    /// Sharpness in the file, 0 to 1.
    pub sharpness: f64,
    /// Predicted peak acceleration in g.
    pub peak_g: f64,
    /// Time of the peak in ms from the begin of the part.
    pub peak_at_ms: f64,
    /// The limit that keeps the peak below the wanted peak; null if the peak reaches it.
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
