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
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
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
    /// The effect in the format of this program; absent with `file` and `file_base64`.
    pub effect: Option<EffectFile>,
    /// The text of a file: TOML, JSON, AHAP, HJIF or Lofelt `.haptic`; absent with `effect` and `file_base64`.
    pub file: Option<String>,
    /// The bytes of a file of any format, such as HMPG or WAV, in base64 (RFC 4648, with padding); absent with `effect` and `file`.
    pub file_base64: Option<String>,
    /// The format of `file` or `file_base64`; if absent, the daemon detects the format from the content.
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
        let (field, read) = match (asked.effect, asked.file, asked.file_base64) {
            (Some(_), None, None) if asked.format.is_some() => {
                let detail = "format is given, but is allowed only together with `file` or `file_base64`";
                return Err(Problem::bad_body(detail.into()).with_field("format".into()));
            }
            (Some(effect), None, None) => ("effect", list_events_of_file(effect, FileFormat::Json)),
            (None, Some(_), None) if matches!(asked.format, Some(FileFormat::Hmpg | FileFormat::Wav)) => {
                let detail = "`file` is text, but the formats hmpg and wav are no text: use `file_base64`";
                return Err(Problem::bad_body(detail.into()).with_field("file".into()));
            }
            (None, Some(text), None) => ("file", read_effect_bytes(text.as_bytes(), asked.format)),
            (None, None, Some(text)) => {
                let bytes = BASE64.decode(text).map_err(|error| {
                    let detail = format!("file_base64 is not base64 text (RFC 4648, with padding): {error}");
                    Problem::bad_body(detail).with_field("file_base64".into())
                })?;
                ("file_base64", read_effect_bytes(&bytes, asked.format))
            }
            (None, None, None) => {
                let detail = "`effect`, `file` and `file_base64` are missing, but one of them must be given";
                return Err(Problem::bad_body(detail.into()).with_field("effect".into()));
            }
            (effect, ..) => {
                let detail = "more than one of `effect`, `file` and `file_base64` is given, but only one is allowed";
                let field = if effect.is_some() { "effect" } else { "file" };
                return Err(Problem::bad_body(detail.into()).with_field(field.into()));
            }
        };
        let list = read.map_err(|error| wrong(field, error))?;
        let (parts, warnings) = cut_events_into_parts(&list).map_err(|error| wrong(field, error))?;
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
