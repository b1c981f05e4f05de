//! Errors of the crates as the exceptions of `era/_errors.py`, and warnings.

use era::verify::VerifyError;
use era_model::model::ModelError;
use era_model::response::{CurveError, ResponseError};
use era_model::scene::{PlaceError, SceneError};
use era_model::transient::TransientError;
use era_model::transient::panel::{MotionError, TimesError};
use era_planner::PlanError;
use era_planner::cache::PrepareError;
use era_planner::effects::DesignError;
use era_planner::explain::ExplainError;
use era_planner::quick::QuickError;
use era_planner::table::{BandError, EmptyRegionError};
use era_study::result::GatherError;
use era_study::run::{FolderError, RunError};
use era_study::written::WriteError;
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::ffi::CString;
use std::io;
use std::path::Path;

/// An error, to become an exception.
#[derive(Debug)]
pub struct Raised {
    kind: RaisedKind,
    text: String,
    field: Option<String>,
    value: ArgumentValue,
    allowed: Option<String>,
}

/// Which exception.
#[derive(Clone, Copy, Debug)]
enum RaisedKind {
    Request,
    Model,
    Resonance,
    Simulation,
    /// With the system's number where the error is about the file that `value` names, and 0 elsewhere.
    Os(i32),
}

impl RaisedKind {
    /// The name of ours; `None` for one of Python's own.
    const fn name(self) -> Option<&'static str> {
        match self {
            RaisedKind::Request => Some("RequestError"),
            RaisedKind::Model => Some("ModelError"),
            RaisedKind::Resonance => Some("ResonanceError"),
            RaisedKind::Simulation => Some("SimulationError"),
            RaisedKind::Os(_) => None,
        }
    }
}

/// What was given.
#[derive(Clone, Debug, PartialEq)]
pub enum ArgumentValue {
    /// It is none of one value.
    None,
    /// A number.
    Number(f64),
    /// A count.
    Count(usize),
    /// A word.
    Word(String),
    /// A place in m.
    Place(f64, f64),
    /// Corners of a rectangle in m.
    Corners([f64; 4]),
}

impl From<f64> for ArgumentValue {
    fn from(value: f64) -> Self {
        ArgumentValue::Number(value)
    }
}

impl From<usize> for ArgumentValue {
    fn from(value: usize) -> Self {
        ArgumentValue::Count(value)
    }
}

impl From<&str> for ArgumentValue {
    fn from(value: &str) -> Self {
        ArgumentValue::Word(value.to_owned())
    }
}

/// A number, or the word for anything else.
impl From<serde_json::Value> for ArgumentValue {
    fn from(value: serde_json::Value) -> Self {
        let word = || value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        value.as_f64().map_or_else(|| ArgumentValue::Word(word()), ArgumentValue::Number)
    }
}

impl From<(f64, f64)> for ArgumentValue {
    fn from((x_m, y_m): (f64, f64)) -> Self {
        ArgumentValue::Place(x_m, y_m)
    }
}

impl<'py> IntoPyObject<'py> for ArgumentValue {
    type Target = PyAny;
    type Output = Bound<'py, PyAny>;
    type Error = PyErr;

    fn into_pyobject(self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        match self {
            ArgumentValue::None => Ok(py.None().into_bound(py)),
            ArgumentValue::Number(value) => Ok(value.into_pyobject(py)?.into_any()),
            ArgumentValue::Count(value) => Ok(value.into_pyobject(py)?.into_any()),
            ArgumentValue::Word(value) => Ok(value.into_pyobject(py)?.into_any()),
            ArgumentValue::Corners([x0, y0, x1, y1]) => Ok((x0, y0, x1, y1).into_pyobject(py)?.into_any()),
            ArgumentValue::Place(x_m, y_m) => Ok((x_m, y_m).into_pyobject(py)?.into_any()),
        }
    }
}

impl Raised {
    /// An argument with a wrong value.
    pub fn wrong_argument(
        field: impl Into<String>,
        value: impl Into<ArgumentValue>,
        allowed: impl Into<String>,
    ) -> Self {
        let (field, value, allowed) = (field.into(), value.into(), allowed.into());
        let given = match &value {
            ArgumentValue::None => String::from("None"),
            ArgumentValue::Number(value) => value.to_string(),
            ArgumentValue::Count(value) => value.to_string(),
            ArgumentValue::Word(value) => format!("{value:?}"),
            ArgumentValue::Place(x_m, y_m) => format!("({x_m}, {y_m})"),
            ArgumentValue::Corners([x0, y0, x1, y1]) => format!("({x0}, {y0}, {x1}, {y1})"),
        };
        let text = format!("{field} is {given}, but must be {allowed}");
        Self { kind: RaisedKind::Request, text, field: Some(field), value, allowed: Some(allowed) }
    }

    /// An argument whose value does not tell what is wrong with it; `text` is the whole message.
    pub fn wrong_argument_with_text(
        field: impl Into<String>,
        value: impl Into<ArgumentValue>,
        allowed: impl Into<String>,
        text: String,
    ) -> Self {
        let (field, value, allowed) = (field.into(), value.into(), allowed.into());
        Self { kind: RaisedKind::Request, text, field: Some(field), value, allowed: Some(allowed) }
    }

    /// A `grid` of so many points that a result would have too many values; `other_remedy` is what else makes the result smaller.
    pub fn grid_with_too_many_values(points: usize, values: &str, most: &str, other_remedy: &str) -> Self {
        let text = format!(
            "grid has {points} points, which makes {values} values, but the result may have at most {most} values: use \
             fewer points or {other_remedy}"
        );
        Self::wrong_argument_with_text("grid", points, format!("at most {most} values in the result"), text)
    }

    /// A place that is none of the surface: an argument in m, of which `field` is the x coordinate's name.
    pub fn place_off_surface(field: &str, (x_m, y_m): (f64, f64), error: PlaceError) -> Self {
        match error {
            PlaceError::Outside { field: "y_mm", max, .. } => {
                Self::wrong_argument(format!("{field}[1]"), y_m, format!("0 to {} m", max / 1e3))
            }
            PlaceError::Outside { max, .. } => {
                Self::wrong_argument(format!("{field}[0]"), x_m, format!("0 to {} m", max / 1e3))
            }
            PlaceError::Cutout { cutout, .. } => {
                Self::wrong_argument(field, (x_m, y_m), format!("on the surface, not in cutout[{cutout}] of the scene"))
            }
        }
    }

    /// Files and threads that are not to be had.
    pub fn unavailable_resource(error: impl ToString) -> Self {
        Self::without_field(RaisedKind::Os(0), &error)
    }

    /// A file that cannot be read or written: with the system's number and the file's name, as Python's own functions tell it.
    pub fn unusable_file(doing: &str, path: &Path, error: &io::Error) -> Self {
        let told = error.to_string();
        let name = path.display().to_string();
        match error.raw_os_error() {
            Some(errno) => {
                let reason = told.split(" (os error").next().unwrap_or(&told);
                let plain = Self::without_field(RaisedKind::Os(errno), &format!("cannot {doing}: {reason}"));
                Self { value: ArgumentValue::Word(name), ..plain }
            }
            None => Self::unavailable_resource(format!("cannot {doing} {name}: {told}")),
        }
    }

    fn without_field(kind: RaisedKind, error: &impl ToString) -> Self {
        Self { kind, text: error.to_string(), field: None, value: ArgumentValue::None, allowed: None }
    }

    fn with(
        kind: RaisedKind,
        error: &impl ToString,
        field: &str,
        value: impl Into<ArgumentValue>,
        allowed: Option<String>,
    ) -> Self {
        Self { field: Some(field.to_owned()), value: value.into(), allowed, ..Self::without_field(kind, error) }
    }
}

fn format_allowed_range_or_minimum(min: f64, max: f64) -> String {
    if max.is_finite() { format!("{min} to {max}") } else { format!("at least {min}") }
}

impl From<ModelError> for Raised {
    fn from(error: ModelError) -> Self {
        match &error {
            ModelError::Frequency { value, min, max, .. } => Self::with(
                RaisedKind::Request,
                &error,
                "frequency_hz",
                *value,
                Some(format!("above {min}, at most {max}")),
            ),
            ModelError::Tolerance { value, min, max } => Self::with(
                RaisedKind::Request,
                &error,
                "tolerance",
                *value,
                Some(format_allowed_range_or_minimum(*min, *max)),
            ),
            ModelError::TooFine { max_hz, unknowns, limit, .. } => {
                let allowed = format!(
                    "a lower frequency, at which the model of the panel has at most {limit} unknowns (not {unknowns})"
                );
                Self::with(RaisedKind::Model, &error, "frequency_hz", *max_hz, Some(allowed))
            }
            ModelError::TooManyModes { max_hz, modes, limit } => {
                let allowed = format!(
                    "a lower frequency, up to which the model of the panel has at most {limit} modes (not {modes})"
                );
                Self::with(RaisedKind::Model, &error, "frequency_hz", *max_hz, Some(allowed))
            }
            ModelError::Factorisation { .. }
            | ModelError::OtherPanel { .. }
            | ModelError::NotConverged { .. }
            | ModelError::Stopped => Self::without_field(RaisedKind::Model, &error),
        }
    }
}

impl From<ResponseError> for Raised {
    fn from(error: ResponseError) -> Self {
        let ResponseError::Unbounded { frequency_hz, .. } = &error;
        Self::with(RaisedKind::Resonance, &error, "frequency_hz", *frequency_hz, None)
    }
}

impl From<CurveError> for Raised {
    fn from(error: CurveError) -> Self {
        match error {
            CurveError::Model(error) => error.into(),
            CurveError::Response(error) => error.into(),
        }
    }
}

impl From<PrepareError> for Raised {
    fn from(error: PrepareError) -> Self {
        match error {
            PrepareError::Model(error) => error.into(),
            PrepareError::Response(error) => error.into(),
        }
    }
}

impl From<QuickError> for Raised {
    fn from(error: QuickError) -> Self {
        match error {
            QuickError::Model(error) => error.into(),
            QuickError::Response(error) => error.into(),
            QuickError::Plan(error) => error.into(),
        }
    }
}

impl From<MotionError> for Raised {
    fn from(error: MotionError) -> Self {
        match error {
            MotionError::Model(error) => error.into(),
            MotionError::Transient(error) => error.into(),
        }
    }
}

impl From<TimesError> for Raised {
    fn from(error: TimesError) -> Self {
        match &error {
            TimesError::Step { value } => {
                Self::with(RaisedKind::Request, &error, "step_s", *value, Some("above 0 s".into()))
            }
            TimesError::Duration { value, most_s } => Self::with(
                RaisedKind::Request,
                &error,
                "duration_s",
                *value,
                Some(format!("above 0 s and at most {most_s} s")),
            ),
        }
    }
}

impl From<TransientError> for Raised {
    fn from(error: TransientError) -> Self {
        match &error {
            TransientError::Range { what, value, min, max } => {
                Self::with(RaisedKind::Request, &error, what, *value, Some(format_allowed_range_or_minimum(*min, *max)))
            }
            TransientError::Unbounded { omega_rad_s } => {
                let frequency_hz = omega_rad_s / std::f64::consts::TAU;
                Self::with(RaisedKind::Resonance, &error, "frequency_hz", frequency_hz, None)
            }
            _ => Self::without_field(RaisedKind::Model, &error),
        }
    }
}

impl From<PlanError> for Raised {
    fn from(error: PlanError) -> Self {
        match &error {
            PlanError::Range { field, value, min, max } => Self::with(
                RaisedKind::Request,
                &error,
                field,
                *value,
                Some(format_allowed_range_or_minimum(*min, *max)),
            ),
            PlanError::Together { option, value, allowed } => {
                Self::with(RaisedKind::Request, &error, option, *value, Some(format!("with {allowed}")))
            }
            PlanError::Count { count } => {
                let most = era_planner::request::MAX_TARGETS;
                Self::with(
                    RaisedKind::Request,
                    &error,
                    "also",
                    *count,
                    Some(format_allowed_range_or_minimum(1.0, most as f64)),
                )
            }
            PlanError::Quiet { count } => {
                let most = era_planner::MAX_QUIET_ZONES;
                Self::with(
                    RaisedKind::Request,
                    &error,
                    "quiet",
                    *count,
                    Some(format_allowed_range_or_minimum(0.0, most as f64)),
                )
            }
            PlanError::Cutout(_) => Self::with(RaisedKind::Request, &error, "at_m", ArgumentValue::None, None),
            PlanError::EmptyZone => Self::with(RaisedKind::Request, &error, "zone_m", ArgumentValue::None, None),
            PlanError::Actuators { count } => {
                let most = era_model::scene::MAX_ACTUATORS;
                Self::with(RaisedKind::Request, &error, "actuator", *count, Some(format!("at most {most}")))
            }
            PlanError::NoActuators => Self::with(RaisedKind::Request, &error, "actuator", 0, Some("at least 1".into())),
            PlanError::NoFrequencies | PlanError::Stopped => Self::without_field(RaisedKind::Model, &error),
        }
    }
}

impl From<DesignError> for Raised {
    fn from(error: DesignError) -> Self {
        match &error {
            DesignError::Request(request) => {
                let (field, value, allowed) = request.field_value_and_allowed_range();
                Self::with(RaisedKind::Request, &error, field, value, Some(allowed))
            }
            DesignError::Unbounded => Self::without_field(RaisedKind::Resonance, &error),
        }
    }
}

impl From<ExplainError> for Raised {
    fn from(error: ExplainError) -> Self {
        match error {
            ExplainError::Plan(error) => error.into(),
            ExplainError::Model(error) => error.into(),
            ExplainError::Response(error) => error.into(),
        }
    }
}

impl From<BandError> for Raised {
    fn from(error: BandError) -> Self {
        let allowed =
            format!("a band between {} and {} Hz, at least {} Hz wide", error.least_hz, error.most_hz, error.needed_hz);
        let text = format!("from_hz = {}, to_hz = {}: {error}", error.from_hz, error.to_hz);
        Self::with(RaisedKind::Request, &text, "from_hz", error.from_hz, Some(allowed))
    }
}

impl From<EmptyRegionError> for Raised {
    fn from(error: EmptyRegionError) -> Self {
        Self::with(RaisedKind::Request, &format!("zone_m: {error}"), "zone_m", ArgumentValue::None, None)
    }
}

impl From<VerifyError> for Raised {
    fn from(error: VerifyError) -> Self {
        match error {
            VerifyError::Plan(error) => error.into(),
            VerifyError::Response(error) => error.into(),
            error => Self::without_field(RaisedKind::Simulation, &error),
        }
    }
}

impl From<FolderError> for Raised {
    fn from(error: FolderError) -> Self {
        match &error {
            FolderError::Io { doing, path, error } => Self::unusable_file(doing, path, error),
            FolderError::Other { path } => {
                let path = path.display().to_string();
                Self::with(
                    RaisedKind::Request,
                    &error,
                    "folder",
                    &*path,
                    Some("a new folder, or the folder of this study".into()),
                )
            }
        }
    }
}

impl From<RunError> for Raised {
    fn from(error: RunError) -> Self {
        let RunError::Folder(error) = error;
        error.into()
    }
}

impl From<GatherError> for Raised {
    fn from(error: GatherError) -> Self {
        match error {
            GatherError::Folder(error) => error.into(),
            GatherError::Missing { missing, .. } => Self::with(
                RaisedKind::Request,
                &error,
                "folder",
                missing,
                Some("a study folder with the results of all designs".into()),
            ),
        }
    }
}

impl From<WriteError> for Raised {
    fn from(error: WriteError) -> Self {
        match error {
            WriteError::Gather(error) => error.into(),
            WriteError::Folder(error) => error.into(),
            WriteError::Table(_) | WriteError::Refused(_) => Self::without_field(RaisedKind::Model, &error),
        }
    }
}

impl From<Raised> for PyErr {
    fn from(raised: Raised) -> Self {
        Python::attach(|py| build_python_exception(py, raised).unwrap_or_else(|error| error))
    }
}

fn build_python_exception(py: Python<'_>, raised: Raised) -> PyResult<PyErr> {
    let Raised { kind, text, field, value, allowed } = raised;
    let Some(name) = kind.name() else {
        return Ok(match (kind, value) {
            // Python makes `FileNotFoundError` and its like of the number.
            (RaisedKind::Os(errno), ArgumentValue::Word(path)) => PyOSError::new_err((errno, text, path)),
            _ => PyOSError::new_err(text),
        });
    };
    let instance = py.import("era._errors")?.getattr(name)?.call1((text,))?;
    instance.setattr("field", field)?;
    instance.setattr("value", value)?;
    instance.setattr("allowed", allowed)?;
    Ok(PyErr::from_value(instance))
}

/// The exception of a scene. One that was made from keywords has no lines.
pub fn build_scene_exception(py: Python<'_>, mut error: SceneError, has_lines: bool) -> PyErr {
    if !has_lines {
        error.mistakes.iter_mut().for_each(|mistake| mistake.line = 0);
    }
    let made = || -> PyResult<PyErr> {
        let errors = py.import("era._errors")?;
        let mistake = errors.getattr("Mistake")?;
        let mistakes = error.mistakes.iter().map(|found| {
            let line = (found.line > 0).then_some(found.line);
            mistake.call1((line, &found.text, &found.field, &found.value, &found.allowed))
        });
        let mistakes = PyTuple::new(py, mistakes.collect::<PyResult<Vec<_>>>()?)?;
        let instance = errors.getattr("SceneError")?.call1((error.to_string(),))?;
        if let Some(first) = error.mistakes.first() {
            instance.setattr("field", &first.field)?;
            instance.setattr("value", &first.value)?;
            instance.setattr("allowed", &first.allowed)?;
        }
        instance.setattr("mistakes", mistakes)?;
        Ok(PyErr::from_value(instance))
    };
    made().unwrap_or_else(|error| error)
}

/// Warns of what is wrong with an answer, as whoever called has it set up: once a place, always, or as an exception.
pub fn emit_model_warnings(py: Python<'_>, doubts: impl IntoIterator<Item = String>) -> PyResult<()> {
    let category = py.import("era._errors")?.getattr("ModelWarning")?;
    for doubt in doubts {
        // Text of Rust may hold a zero byte, one of C may not.
        let doubt = CString::new(doubt.replace('\0', " ")).unwrap_or_default();
        PyErr::warn(py, &category, &doubt, 1)?;
    }
    Ok(())
}
