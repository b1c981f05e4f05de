//! What a touch asks for, over HTTP and over the live socket.

use super::problem::Problem;
use crate::effects::{DesignError, EffectError, EffectRequest, Intensity, NamedEffect};
use crate::planner::{Grouping, Objective, Weigh};
use axum::http::StatusCode;
use serde::Deserialize;
use std::time::Duration;

/// Shortest touch in ms.
pub const MIN_DURATION_MS: u32 = 1;
/// Longest in ms. A finger held on a page is renewed within it, and nobody needs more from one request.
pub const MAX_DURATION_MS: u32 = 10_000;

/// Largest peak that may be asked for, in g: a thousand times what is felt as strong. More is a mistake of units or worse, and
/// would drive everything at its limits.
pub const MAX_INTENSITY_G: f64 = 1000.0;

/// A touch as the HTTP interface takes it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TouchRequest {
    /// In pixels of the scene's screen, from its left edge.
    pub x_px: f64,
    /// From its top edge.
    pub y_px: f64,
    /// Peak wanted in g.
    pub intensity_g: Option<f64>,
    /// The same in dB above the threshold of feeling.
    pub intensity_db: Option<f64>,
    /// How long, in ms; any number in the range.
    pub duration_ms: Option<f64>,
    /// Plays this instead of an even drive.
    pub effect: Option<NamedEffect>,
    /// How many pulses.
    pub count: Option<u32>,
    /// From one click, pulse or crest to the next, in ms.
    pub period_ms: Option<f64>,
    /// When the target begins to be wanted, in ms from now.
    pub from_ms: Option<f64>,
    /// When it ends.
    pub to_ms: Option<f64>,
    /// Other targets.
    pub also: Option<Vec<AlsoRequest>>,
    /// Places to be spared.
    pub quiet: Option<Vec<QuietRequest>>,
    /// What is made least, or most.
    pub objective: Option<Objective>,
    /// Which actuators share a frequency.
    pub grouping: Option<Grouping>,
    /// How accelerations of different frequencies count.
    pub weigh: Option<Weigh>,
    /// Whether to say what can be had where it cannot be had in full.
    pub trade: Option<bool>,
}

/// Another target.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AlsoRequest {
    /// In pixels of the scene's screen, from its left edge.
    pub x_px: f64,
    /// From its top edge.
    pub y_px: f64,
    /// Peak wanted in g; the touch's own intensity if absent.
    pub intensity_g: Option<f64>,
    /// When it begins to be wanted, in ms from now.
    pub from_ms: Option<f64>,
    /// When it ends.
    pub to_ms: Option<f64>,
}

/// A place to be spared.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuietRequest {
    /// Its middle in pixels of the scene's screen, from its left edge.
    pub x_px: f64,
    /// From its top edge.
    pub y_px: f64,
    /// Its radius in mm.
    pub radius_mm: f64,
    /// Most peak acceleration there in g.
    pub at_most_g: f64,
}

impl TouchRequest {
    /// What it should feel like.
    #[must_use]
    pub const fn feel(&self) -> Feel {
        Feel {
            intensity_g: self.intensity_g,
            intensity_db: self.intensity_db,
            duration_ms: self.duration_ms,
            effect: self.effect,
            count: self.count,
            period_ms: self.period_ms,
        }
    }
}

/// What touches should feel like, unchecked; fields as in [`TouchRequest`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[allow(missing_docs, reason = "documented at TouchRequest")]
pub struct Feel {
    pub intensity_g: Option<f64>,
    pub intensity_db: Option<f64>,
    pub duration_ms: Option<f64>,
    pub effect: Option<NamedEffect>,
    pub count: Option<u32>,
    pub period_ms: Option<f64>,
}

/// For how long, and how, a plan is driven.
#[derive(Clone, Copy, Debug)]
pub enum Manner {
    /// Evenly, for as long.
    Hold(Duration),
    /// As the board plays an effect.
    Effect(EffectRequest),
}

impl Feel {
    /// Strength and manner; a touch that says nothing of its length is held for `hold_ms`.
    ///
    /// # Errors
    /// [`Problem`] that names the field.
    pub fn check(&self, hold_ms: u32) -> Result<(Option<Intensity>, Manner), Problem> {
        check_intensity(self.intensity_g)?;
        let intensity = match (self.intensity_g, self.intensity_db) {
            (Some(_), Some(db)) => {
                let detail = "intensity_g and intensity_db are two ways to say the same: give one of them";
                let allowed = "absent with intensity_g".to_owned();
                return Err(Problem::body(detail.into()).at("intensity_db", db.into(), allowed, None));
            }
            (Some(g), None) => Some(Intensity::G(g)),
            (None, db) => db.map(Intensity::AboveThresholdDb),
        };
        let Some(effect) = self.effect else {
            let alone = [("count", self.count.map(f64::from)), ("period_ms", self.period_ms)];
            if let Some((field, value)) = alone.into_iter().find_map(|(field, value)| Some((field, value?))) {
                let detail = format!("{field} is {value}, but belongs to an effect and none is given");
                return Err(Problem::body(detail).at(field, value.into(), "absent without an effect".into(), None));
            }
            let duration_ms = self.duration_ms.unwrap_or_else(|| f64::from(hold_ms));
            if !(f64::from(MIN_DURATION_MS)..=f64::from(MAX_DURATION_MS)).contains(&duration_ms) {
                return Err(Problem::range("duration_ms", duration_ms, MIN_DURATION_MS, MAX_DURATION_MS));
            }
            return Ok((intensity, Manner::Hold(Duration::from_secs_f64(duration_ms / 1e3))));
        };
        let Feel { duration_ms, count, period_ms, .. } = *self;
        let request = EffectRequest { effect, duration_ms, count, period_ms };
        // Before anything is planned.
        request.envelope()?;
        Ok((intensity, Manner::Effect(request)))
    }
}

/// Refuses a peak that nothing can have.
///
/// # Errors
/// [`Problem`] with the range.
pub fn check_intensity(intensity_g: Option<f64>) -> Result<(), Problem> {
    match intensity_g {
        Some(g) if !(0.0..=MAX_INTENSITY_G).contains(&g) => Err(Problem::range("intensity_g", g, 0, MAX_INTENSITY_G)),
        _ => Ok(()),
    }
}

impl From<EffectError> for Problem {
    fn from(error: EffectError) -> Self {
        let (field, value, allowed) = error.parts();
        Self::new(StatusCode::BAD_REQUEST, "out-of-range", "A value is out of range", error.to_string()).at(
            field,
            value.into(),
            allowed,
            None,
        )
    }
}

impl From<DesignError> for Problem {
    fn from(error: DesignError) -> Self {
        match error {
            DesignError::Request(error) => error.into(),
            DesignError::Unbounded => {
                Self::new(StatusCode::UNPROCESSABLE_ENTITY, "no-plan", "This scene has no plan", error.to_string())
            }
        }
    }
}
