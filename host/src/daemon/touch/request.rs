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

/// A request to drive a touch.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
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
    /// Distance of the touch from the left edge of the scene's screen in pixels: 0 to `width_px`.
    pub x_px: f64,
    /// Distance of the touch from the top edge of the screen in pixels: 0 to `height_px`.
    pub y_px: f64,
    /// Wanted peak acceleration in g; 0.5 if `intensity_g` and `intensity_db` are absent. If the panel cannot reach this peak, the daemon drives the
    /// largest peak that is possible.
    pub intensity_g: Option<f64>,
    /// Wanted peak acceleration in dB above the threshold of feeling at the frequencies of the drives; absent with `intensity_g`.
    pub intensity_db: Option<f64>,
    /// Duration of the vibration in ms; 1000 if absent. With an effect, duration of the effect (default: buzz 200, swell 500, texture 1000); absent
    /// with effects that have no duration.
    pub duration_ms: Option<f64>,
    /// The effect that the board plays by its own clock; without an effect, the vibration has a constant intensity.
    pub effect: Option<NamedEffect>,
    /// Number of pulses of a `pulse_train`; 5 if absent.
    #[serde(default, deserialize_with = "crate::whole_numbers::deserialize_whole_number_or_null")]
    pub count: Option<u32>,
    /// Time from one click, pulse or crest to the next in ms: `double_click` 50 to 500 (default 120), `pulse_train` 10 to 1000 (default 60),
    /// `texture` 25 to 125 (default 50).
    pub period_ms: Option<f64>,
    /// Longest time in ms until the vibration of a `click` is below a tenth of its peak; 45 if absent. A `double_click` does not have this key: its clicks use 45 ms.
    pub crisp_ms: Option<f64>,
    /// Which property a `click` keeps if it cannot have both: the wanted peak (`strength`, the default), or the time `crisp_ms` (`crispness`).
    pub prefer: Option<Preference>,
    /// Begin of the time window of the target in ms from now; 0 if only `to_ms` is given. Not allowed with an effect.
    pub from_ms: Option<f64>,
    /// End of the time window of the target in ms from now, at least 1 ms after `from_ms`. If only `from_ms` is given, the window ends after
    /// `duration_ms`; without `duration_ms`, with the latest window of all targets. Not allowed with an effect.
    pub to_ms: Option<f64>,
    /// Further targets of the same touch.
    pub also: Option<Vec<OtherTarget>>,
    /// Zones in which the acceleration stays below a limit.
    pub quiet: Option<Vec<QuietZone>>,
    /// What the planner optimises: the smallest mean square of the acceleration elsewhere (`contrast`, the default), the largest minimum of the
    /// acceleration over the surface (`reach`), or the smallest electrical power (`power`).
    pub objective: Option<Objective>,
    /// Frequencies of the actuators: a different frequency for each actuator (`distinct`, the default), or one frequency for all actuators, with
    /// phases (`shared`). `shared` is possible only for one target, without quiet zones, with the objective `contrast`.
    pub grouping: Option<Grouping>,
    /// Weights of accelerations of different frequencies: equal weights (`equal`, the default), or weights by how strongly a finger feels the
    /// frequency (`felt`). The limits of quiet zones are in g in both cases.
    pub weigh: Option<Weigh>,
    /// Whether the answer has other possible results (`trade`) if the touch cannot be met completely. The computation takes up to some seconds after
    /// the drive has begun.
    pub trade: Option<bool>,
}

/// A further target of a touch.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, ToSchema)]
#[schema(as = Also)]
#[serde(deny_unknown_fields)]
pub struct OtherTarget {
    /// Distance of the target from the left edge of the scene's screen in pixels.
    pub x_px: f64,
    /// Distance of the target from the top edge of the screen in pixels.
    pub y_px: f64,
    /// Wanted peak acceleration of the target in g; the intensity of the touch if absent.
    pub intensity_g: Option<f64>,
    /// Begin of the time window of the target in ms from now; 0 if only `to_ms` is given. Not allowed with an effect.
    pub from_ms: Option<f64>,
    /// End of the time window of the target in ms from now, at least 1 ms after `from_ms`. If only `from_ms` is given, the window ends after
    /// `duration_ms`; without `duration_ms`, with the latest window of all targets. Not allowed with an effect.
    pub to_ms: Option<f64>,
}

/// A circular zone in which the acceleration stays below a limit.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, ToSchema)]
#[schema(as = QuietZone)]
#[serde(deny_unknown_fields)]
pub struct QuietZone {
    /// Distance of the centre of the zone from the left edge of the scene's screen in pixels.
    pub x_px: f64,
    /// Distance of the centre of the zone from the top edge of the screen in pixels.
    pub y_px: f64,
    /// Radius of the zone in mm.
    pub radius_mm: f64,
    /// Largest allowed peak acceleration at the centre and on the rim of the zone, in g.
    pub at_most_g: f64,
}

impl TouchRequest {
    /// What it should feel like.
    #[must_use]
    pub const fn requested_haptics(&self) -> RequestedHaptics {
        RequestedHaptics {
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
pub struct RequestedHaptics {
    pub intensity_g: Option<f64>,
    pub intensity_db: Option<f64>,
    pub duration_ms: Option<f64>,
    pub effect: Option<NamedEffect>,
    pub count: Option<u32>,
    pub period_ms: Option<f64>,
    pub crisp_ms: Option<f64>,
    pub prefer: Option<Preference>,
}

/// A finger on the screen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Finger {
    /// Number that the page gives the finger.
    #[serde(default, deserialize_with = "crate::whole_numbers::deserialize_whole_number")]
    pub id: i64,
    /// Distance from the left edge of the scene's screen in pixels.
    pub x_px: f64,
    /// Distance from the top edge of the scene's screen in pixels.
    pub y_px: f64,
    /// Wanted peak acceleration of this finger alone, in g.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intensity_g: Option<f64>,
    /// The effect that the board plays when the finger goes down. A panel plays one effect at a time: that of the newest finger that has an effect.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effect: Option<NamedEffect>,
}
