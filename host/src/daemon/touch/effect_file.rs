//! Effect files as clients send them, and what is played of them.

use super::answer::Achieved;
use super::check::check_intensity_range;
use super::request::Finger;
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::effect_files::own::{EffectFile, list_events_of_file};
use crate::effect_files::parts::{Part, cut_events_into_parts};
use crate::effect_files::view::ReadingView;
use crate::effect_files::{EventList, FileFormat, ReadError, read_effect_bytes};
use crate::planner::DEFAULT_INTENSITY_G;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Most parts of an effect that are played: each is a request to the board.
const MAX_PARTS: usize = 100;

/// An effect file, and the touched place at which the board plays it.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[schema(as = EffectFileRequest)]
#[schema(examples(
    json!({"x_px": 960, "y_px": 640, "effect": {"version": 1, "events": [
        {"primitive": "tick", "repeat": {"count": 3, "period_ms": 100}}, {"primitive": "thud", "pause_ms": 100}]}}),
    json!({"x_px": 960, "y_px": 640, "intensity_g": 0.3, "format": "ahap",
        "file": "{\"Pattern\": [{\"Event\": {\"Time\": 0, \"EventType\": \"HapticTransient\", \"EventParameters\": []}}]}"}),
))]
#[serde(deny_unknown_fields)]
pub struct EffectFileRequest {
    /// Distance of the touch from the left edge of the scene's screen in pixels: 0 to `width_px`.
    pub x_px: f64,
    /// Distance of the touch from the top edge of the screen in pixels: 0 to `height_px`.
    pub y_px: f64,
    /// Peak acceleration of intensity 1 in g; 0.5 if absent. If the panel cannot reach this peak, intensity 1 is the largest peak that it can
    /// reach.
    pub intensity_g: Option<f64>,
    /// The effect in the format of this program; absent with `file`.
    pub effect: Option<EffectFile>,
    /// The text of a file: TOML, JSON, AHAP, HJIF or Lofelt `.haptic`; absent with `effect`.
    pub file: Option<String>,
    /// The format of `file`; if absent, the daemon detects the format from the text.
    pub format: Option<FileFormat>,
}

/// An effect file that has been checked as far as that goes without planning.
#[derive(Clone, Debug)]
pub struct CheckedEffectFile {
    /// What was read.
    pub list: EventList,
    /// What is played.
    pub parts: Vec<Part>,
    /// What of the events is not.
    pub warnings: Vec<String>,
    /// The touched place, as it is shown.
    pub finger: Finger,
    /// The touched place in m.
    pub touched_m: (f64, f64),
    /// Peak of intensity 1 in g.
    pub asked_g: f64,
}

/// The answer to an effect file: the parts that the board plays, and the drives that the device achieves for the first part.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = PlayedEffectFile)]
pub struct PlayedEffectFileView {
    /// What was read, and what the panel makes of it.
    #[serde(flatten)]
    pub reading: ReadingView,
    /// Number of the request, which is also the number of its plan.
    pub plan_id: u64,
    /// The drives that the device achieves for the first part.
    pub device: Achieved,
}

impl CheckedEffectFile {
    /// The file of a request, on this scene.
    ///
    /// # Errors
    /// [`Problem`] that names the field.
    pub fn from_request(asked: EffectFileRequest, scene: &Scene) -> Result<Self, Problem> {
        check_intensity_range(asked.intensity_g)?;
        let finger = Finger { id: 0, x_px: asked.x_px, y_px: asked.y_px, intensity_g: asked.intensity_g, effect: None };
        let target = finger.check_on_scene(scene)?.target;
        let wrong = |field: &str, error: ReadError| Problem::bad_body(error.to_string()).with_field(field.to_owned());
        let has_file = asked.file.is_some();
        let list = match (asked.effect, &asked.file, asked.format) {
            (Some(effect), None, None) => {
                list_events_of_file(effect, FileFormat::Json).map_err(|error| wrong("effect", error))?
            }
            (None, Some(_), Some(format @ (FileFormat::Hmpg | FileFormat::Wav))) => {
                let detail = format!(
                    "format is {format}, but a request can contain only files in a text format: use `era effect \
                     --file` for a file in a binary format"
                );
                return Err(Problem::bad_body(detail).with_field("format".into()));
            }
            (None, Some(text), format) => {
                read_effect_bytes(text.as_bytes(), format).map_err(|error| wrong("file", error))?
            }
            (Some(_), None, Some(_)) => {
                let detail = "format is given, but is allowed only together with `file`";
                return Err(Problem::bad_body(detail.into()).with_field("format".into()));
            }
            (Some(_), Some(_), _) => {
                let detail = "`effect` and `file` are both given, but only one of them is allowed";
                return Err(Problem::bad_body(detail.into()).with_field("file".into()));
            }
            (None, None, _) => {
                let detail = "`effect` and `file` are both missing, but one of them must be given";
                return Err(Problem::bad_body(detail.into()).with_field("effect".into()));
            }
        };
        let (parts, warnings) =
            cut_events_into_parts(&list).map_err(|error| wrong(if has_file { "file" } else { "effect" }, error))?;
        if parts.len() > MAX_PARTS {
            let detail = format!(
                "the effect has {} parts that the board plays one after the other, but at most {MAX_PARTS} are allowed",
                parts.len()
            );
            return Err(Problem::new(ProblemKind::TooLarge, detail));
        }
        let asked_g = asked.intensity_g.unwrap_or(DEFAULT_INTENSITY_G);
        Ok(Self { list, parts, warnings, finger, touched_m: (target.x_m, target.y_m), asked_g })
    }
}
