//! What a panel makes of an effect at a place.
//!
//! Intensity 1 is the peak that is asked for, or what the panel can do at the place, if that is less; all events of a kind are weakened alike, so
//! that their intensities keep their ratios. A pulse is designed once per kind and place; weaker ones are the same with less voltage.

use super::parts::{Part, PartContent, PulseKind};
use crate::effects::{
    DesignError, EffectDesign, EffectRequest, NamedEffect, design_effect,
    design_effect_of_windows_if_common_click_exists_else_of_drives, design_effect_with_given_envelope,
};
use crate::planner::click::{ClickOptions, Preference};
use crate::planner::rise::PanelPoles;
use crate::planner::{Plan, PlanError, PlanTable, Target};
use crate::scene::PlaceError;
use era_shared::waveform::Effect;
use serde::Serialize;
use utoipa::ToSchema;

/// Longest time in s until a tick is quiet.
const TICK_CRISP_S: f64 = 0.03;

/// An effect for a panel.
#[derive(Clone, Debug)]
pub struct PanelEffect {
    /// The places, the touched one first if anything is played there.
    pub places: Vec<PanelPlace>,
    /// What intensity 1 is, by place and kind.
    pub scales: Vec<ScaleView>,
    /// What is played, by its begin.
    pub parts: Vec<PanelPart>,
}

/// A place with its plan at intensity 1.
#[derive(Clone, Debug)]
pub struct PanelPlace {
    /// From the left edge in m.
    pub x_m: f64,
    /// From the top edge in m.
    pub y_m: f64,
    /// For a steady drive.
    pub plan: Plan,
}

/// One thing that is played.
#[derive(Clone, Debug)]
pub struct PanelPart {
    /// From the effect's begin in ms.
    pub begin_ms: usize,
    /// Index of its place.
    pub place: usize,
    /// How it is made.
    pub kind: PartKind,
    /// 0 to 1.
    pub intensity: f64,
    /// 0 to 1, as it was asked for.
    pub sharpness: f64,
    /// What the board plays.
    pub design: EffectDesign,
}

/// How the panel produces a part of an effect: `tick` (single windows, quiet after 30 ms), `click` (single windows, quiet after 45 ms), `thud` (a push
/// of a few cycles with a brake), or `envelope` (segments at the frequencies of the plan).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PartKind {
    /// Single windows, quiet after 30 ms even if they are weaker: sharpness from 2/3 on.
    Tick,
    /// Single windows, quiet after 45 ms: sharpness from 1/3 to 2/3.
    Click,
    /// A push of a few cycles with a brake: sharpness below 1/3.
    Thud,
    /// Segments at the frequencies of the place's plan, whatever the sharpness.
    Envelope,
}

/// The peak acceleration that intensity 1 has on this panel.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[schema(as = EffectScale)]
pub struct ScaleView {
    /// Number of the place in `places`, from 0.
    pub place: usize,
    /// How the panel produces the parts of this scale.
    pub kind: PartKind,
    /// Wanted peak acceleration in g.
    pub asked_g: f64,
    /// Predicted peak acceleration in g.
    pub peak_g: f64,
    /// The limit that keeps the peak below the wanted peak; null if the peak reaches it.
    pub limited_by: Option<String>,
    /// Time in ms after which a pulse stays below a tenth of its peak; null for envelopes, and if this takes longer than 300 ms after the end of the pulse.
    pub quiet_ms: Option<f64>,
    /// Frequencies of the drives in Hz; empty for single windows (`tick` and `click`).
    pub frequencies_hz: Vec<f64>,
}

/// Why an effect cannot be played on this panel.
#[derive(Debug, thiserror::Error)]
pub enum PanelEffectError {
    /// A place without a plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A place beside the touched one that is not on the surface.
    #[error(
        "the place at dx_mm {}, dy_mm {} from the touched place is not on the surface: {error}",
        .offset_mm.0,
        .offset_mm.1
    )]
    Offset {
        /// To the right of the touched place, and below it, in mm.
        offset_mm: (f64, f64),
        /// Why not.
        error: PlaceError,
    },
    /// A part without a design.
    #[error(transparent)]
    Design(#[from] DesignError),
}

impl PartKind {
    /// As in answers.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tick => "tick",
            Self::Click => "click",
            Self::Thud => "thud",
            Self::Envelope => "envelope",
        }
    }
}

/// Where a part is played, in m.
#[must_use]
pub fn place_of_part_m(part: &Part, touched_m: (f64, f64)) -> (f64, f64) {
    (touched_m.0 + 1e-3 * part.offset_mm.0, touched_m.1 + 1e-3 * part.offset_mm.1)
}

/// Designs all parts for a touched place, in m. Without `plays_windows`, as boards with older firmware are, every pulse is a push with a brake.
///
/// # Errors
/// [`PanelEffectError`].
pub fn design_parts_for_panel(
    table: &PlanTable,
    poles: &PanelPoles,
    parts: &[Part],
    touch: ((f64, f64), f64),
    plays_windows: bool,
) -> Result<PanelEffect, PanelEffectError> {
    let mut designer = PartDesigner::new(table, poles, touch, plays_windows);
    parts.iter().try_for_each(|part| designer.add_part(part))?;
    Ok(designer.effect)
}

/// Designs one part after the other, so that whoever asks can end in between.
#[derive(Debug)]
pub struct PartDesigner<'a> {
    table: &'a PlanTable,
    poles: &'a PanelPoles,
    touched_m: (f64, f64),
    asked_g: f64,
    plays_windows: bool,
    /// At intensity 1.
    pulses: Vec<(usize, PartKind, EffectDesign)>,
    /// What has been designed.
    pub effect: PanelEffect,
}

impl<'a> PartDesigner<'a> {
    /// Nothing is designed yet; arguments as of [`design_parts_for_panel`].
    #[must_use]
    pub const fn new(
        table: &'a PlanTable,
        poles: &'a PanelPoles,
        (touched_m, asked_g): ((f64, f64), f64),
        plays_windows: bool,
    ) -> Self {
        let effect = PanelEffect { places: Vec::new(), scales: Vec::new(), parts: Vec::new() };
        Self { table, poles, touched_m, asked_g, plays_windows, pulses: Vec::new(), effect }
    }

    /// Designs a part behind those before it.
    ///
    /// # Errors
    /// [`PanelEffectError`].
    pub fn add_part(&mut self, part: &Part) -> Result<(), PanelEffectError> {
        let Self { table, poles, touched_m, asked_g, plays_windows, pulses, effect } = self;
        let (table, poles, asked_g) = (*table, *poles, *asked_g);
        let (x_m, y_m) = place_of_part_m(part, *touched_m);
        let known = effect.places.iter().position(|place| (place.x_m, place.y_m) == (x_m, y_m));
        let place = match known {
            Some(place) => place,
            None => {
                if part.offset_mm != (0.0, 0.0) {
                    let place = table.scene.surface_or_bar_axis_point_outside_cutouts(x_m, y_m);
                    place.map_err(|error| PanelEffectError::Offset { offset_mm: part.offset_mm, error })?;
                }
                let plan = table.plan(&[Target { x_m, y_m, intensity_g: Some(asked_g) }])?;
                effect.places.push(PanelPlace { x_m, y_m, plan });
                effect.places.len() - 1
            }
        };
        let Some(PanelPlace { plan, .. }) = effect.places.get(place) else { return Ok(()) };
        let (kind, design) = match &part.content {
            PartContent::Envelope(segments) => {
                let envelope = Effect { segments: segments.iter().copied().collect(), times: 1 };
                (PartKind::Envelope, design_effect_with_given_envelope(table, poles, plan, envelope)?)
            }
            PartContent::Pulse(kind, intensity) => {
                let kind = match kind {
                    PulseKind::Tick if *plays_windows => PartKind::Tick,
                    PulseKind::Click if *plays_windows => PartKind::Click,
                    _ => PartKind::Thud,
                };
                let known = pulses.iter().position(|(of, own, _)| (*of, *own) == (place, kind));
                let known = match known {
                    Some(known) => known,
                    None => {
                        pulses.push((place, kind, design_pulse(table, poles, plan, kind)?));
                        pulses.len() - 1
                    }
                };
                let Some((_, _, full)) = pulses.get(known) else { return Ok(()) };
                (kind, full.scale_copy_to_force_fraction(*intensity))
            }
        };
        if !effect.scales.iter().any(|scale| (scale.place, scale.kind) == (place, kind)) {
            let full = pulses.iter().find(|(of, own, _)| (*of, *own) == (place, kind)).map(|(_, _, full)| full);
            effect.scales.push(describe_scale((place, kind), asked_g, plan, full));
        }
        let Part { begin_ms, intensity, sharpness, .. } = *part;
        effect.parts.push(PanelPart { begin_ms, place, kind, intensity, sharpness, design });
        Ok(())
    }
}

fn design_pulse(
    table: &PlanTable,
    poles: &PanelPoles,
    plan: &Plan,
    kind: PartKind,
) -> Result<EffectDesign, DesignError> {
    let request = EffectRequest::with_defaults(NamedEffect::Click);
    match kind {
        PartKind::Tick => {
            let options =
                ClickOptions { crisp_s: TICK_CRISP_S, preference: Preference::Crispness, ..ClickOptions::default() };
            design_effect_of_windows_if_common_click_exists_else_of_drives(table, poles, plan, request, options)
        }
        PartKind::Click => design_effect_of_windows_if_common_click_exists_else_of_drives(
            table,
            poles,
            plan,
            request,
            ClickOptions::default(),
        ),
        PartKind::Thud | PartKind::Envelope => design_effect(table, poles, plan, request),
    }
}

fn describe_scale(
    (place, kind): (usize, PartKind),
    asked_g: f64,
    plan: &Plan,
    pulse: Option<&EffectDesign>,
) -> ScaleView {
    let drives = |drives: &mut dyn Iterator<Item = f64>| drives.collect::<Vec<f64>>();
    match pulse {
        Some(full) => ScaleView {
            place,
            kind,
            asked_g,
            peak_g: full.predicted.peak_g,
            limited_by: full.limited_by.clone(),
            quiet_ms: full.predicted.quiet_ms,
            frequencies_hz: drives(&mut full.drives.iter().map(|designed| designed.drive.frequency_hz)),
        },
        None => ScaleView {
            place,
            kind,
            asked_g,
            peak_g: plan.predicted.target_peak_g,
            limited_by: plan.limited_by.clone(),
            quiet_ms: None,
            frequencies_hz: drives(&mut plan.drives.iter().map(|drive| drive.frequency_hz)),
        },
    }
}
