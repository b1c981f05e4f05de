//! What is asked for as it comes, over HTTP and over the live socket; nothing of it is checked.

use crate::effects::NamedEffect;
use crate::planner::click::Preference;
use crate::planner::{Grouping, Objective, Weigh};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Shortest touch in ms.
pub const MIN_DURATION_MS: u32 = 1;
/// Longest in ms. A finger held on a page is renewed within it, and nobody needs more from one request.
pub const MAX_DURATION_MS: u32 = 10_000;

/// Largest peak that may be asked for, in g: a thousand times what is felt as strong. More is a mistake of units or worse, and
/// would drive everything at its limits.
pub const MAX_INTENSITY_G: f64 = 1000.0;

/// A touch as the HTTP interface takes it.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[schema(as = Touch)]
#[schema(examples(
    json!({"x_px": 960, "y_px": 640}),
    json!({"x_px": 960, "y_px": 640, "intensity_db": 20, "effect": "pulse_train", "count": 3, "period_ms": 50}),
    json!({"x_px": 480, "y_px": 640, "intensity_g": 0.3, "to_ms": 400,
        "also": [{"x_px": 1500, "y_px": 700, "from_ms": 300, "to_ms": 900}],
        "quiet": [{"x_px": 960, "y_px": 100, "radius_mm": 5, "at_most_g": 0.05}]}),
))]
#[serde(deny_unknown_fields)]
pub struct TouchRequest {
    /// In pixels of the scene's screen, from its left edge: 0 to its `width_px`.
    pub x_px: f64,
    /// From its top edge: 0 to its `height_px`.
    pub y_px: f64,
    /// Peak wanted in g; 0.5 if neither it nor `intensity_db` is given. What cannot be reached is delivered as far as it goes.
    pub intensity_g: Option<f64>,
    /// The same in dB above the threshold of feeling at the drives' frequencies; absent with `intensity_g`.
    pub intensity_db: Option<f64>,
    /// How long, in ms; any number in the range, 1000 if not given. With an effect its length (buzz 200, swell 500, texture 1000),
    /// absent with those that have none.
    pub duration_ms: Option<f64>,
    /// Plays this on the board's own clock instead of driving evenly.
    pub effect: Option<NamedEffect>,
    /// How many pulses a `pulse_train` has; 5 if not given.
    #[serde(default, deserialize_with = "crate::daemon::api::whole_numbers::deserialize_whole_number_or_null")]
    pub count: Option<u32>,
    /// From one click, pulse or crest to the next, in ms: `double_click` 50 to 500 (120 if not given), `pulse_train` 10 to 1000 (60),
    /// `texture` 25 to 125 (50).
    pub period_ms: Option<f64>,
    /// Longest time in ms until a `click` is below a tenth of its peak; 45 if not given. A double click keeps its own times.
    pub crisp_ms: Option<f64>,
    /// What a `click` is where it cannot be both: as strong as was asked for (`strength`, if not given), or quiet in time (`crispness`).
    pub prefer: Option<Preference>,
    /// When the target begins to be wanted, in ms from now; 0 if only `to_ms` is given. Not with an effect.
    pub from_ms: Option<f64>,
    /// When that ends, in ms from now, at least 1 later; `duration_ms`, or the latest of all, if only `from_ms` is given. Not with an
    /// effect.
    pub to_ms: Option<f64>,
    /// Other targets.
    pub also: Option<Vec<OtherTarget>>,
    /// Places to be spared.
    pub quiet: Option<Vec<QuietZone>>,
    /// What is made least, or most: least mean square elsewhere (`contrast`, if not given), the strongest minimum over the surface
    /// (`reach`), or least electrical power (`power`).
    pub objective: Option<Objective>,
    /// Which actuators share a frequency: own frequencies (`distinct`, if not given), or one shared with phases (`shared`), for one
    /// target, without quiet zones, for contrast.
    pub grouping: Option<Grouping>,
    /// How accelerations of different frequencies count: all the same (`equal`, if not given), or as they are felt (`felt`); quiet
    /// zones keep their limits in g.
    pub weigh: Option<Weigh>,
    /// Whether the answer says what can be had where it cannot be had in full; takes up to some seconds, after the drive has begun.
    pub trade: Option<bool>,
}

/// Another target.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[schema(as = Also)]
#[serde(deny_unknown_fields)]
pub struct OtherTarget {
    /// In pixels of the scene's screen, from its left edge.
    pub x_px: f64,
    /// From its top edge.
    pub y_px: f64,
    /// Peak wanted in g; the touch's own intensity if not given.
    pub intensity_g: Option<f64>,
    /// When it begins to be wanted, in ms from now; 0 if only `to_ms` is given. Not with an effect.
    pub from_ms: Option<f64>,
    /// When that ends, in ms from now, at least 1 later; `duration_ms`, or the latest of all, if only `from_ms` is given. Not with an
    /// effect.
    pub to_ms: Option<f64>,
}

/// A place to be spared.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[schema(as = QuietZone)]
#[serde(deny_unknown_fields)]
pub struct QuietZone {
    /// Its middle in pixels of the scene's screen, from its left edge.
    pub x_px: f64,
    /// From its top edge.
    pub y_px: f64,
    /// Its radius in mm.
    pub radius_mm: f64,
    /// Most peak acceleration at its middle and on its rim, in g.
    pub at_most_g: f64,
}

impl TouchRequest {
    /// What it should feel like.
    #[must_use]
    pub const fn requested_feel(&self) -> Feel {
        Feel {
            intensity_g: self.intensity_g,
            intensity_db: self.intensity_db,
            duration_ms: self.duration_ms,
            effect: self.effect,
            count: self.count,
            period_ms: self.period_ms,
            crisp_ms: self.crisp_ms,
            prefer: self.prefer,
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
    pub crisp_ms: Option<f64>,
    pub prefer: Option<Preference>,
}

/// One finger.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Finger {
    /// The page's number for it.
    #[serde(default, deserialize_with = "crate::daemon::api::whole_numbers::deserialize_whole_number")]
    pub id: i64,
    /// In pixels of the scene's screen.
    pub x_px: f64,
    /// In pixels of the scene's screen.
    pub y_px: f64,
    /// Peak wanted for it alone, in g.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intensity_g: Option<f64>,
    /// Played when it goes down; one panel plays one effect, the first finger's that has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effect: Option<NamedEffect>,
}
