//! What functions are asked for, as the crates take it.

use crate::errors::{Raised, Value};
use era_model::model::Accuracy;
use era_model::scene::{Scene, SurfaceKind};
use numpy::{AllowTypeChange, PyArrayLike1};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use std::time::Duration;

/// Most frequencies in one response.
const MOST_FREQUENCIES: usize = 1_000_000;
/// Most columns or rows of a grid.
const MOST_LINES: usize = 10_000;

/// `tolerance`: a number, or the name of one.
#[derive(FromPyObject)]
pub enum Tolerance {
    /// 1e-8 to 0.1.
    Number(f64),
    /// `fast`, `balanced` or `reference`.
    Name(String),
}

impl Tolerance {
    /// As the crates take it.
    pub fn accuracy(self) -> Result<Accuracy, Raised> {
        match self {
            Tolerance::Number(value) => Ok(Accuracy::tolerance(value)?),
            Tolerance::Name(name) => {
                let allowed = "1e-8 to 0.1, \"fast\", \"balanced\" or \"reference\"";
                name.parse().map_err(|_| Raised::argument("tolerance", name.as_str(), allowed))
            }
        }
    }
}

/// `tolerance` and `within_s`: the latter comes first, balanced if there is neither.
pub fn accuracy(tolerance: Option<Tolerance>, within_s: Option<f64>) -> Result<Accuracy, Raised> {
    match (tolerance, within_s) {
        (Some(_), Some(within_s)) => Err(Raised::argument("within_s", within_s, "None where there is a tolerance")),
        (_, Some(within_s)) => {
            let time = Duration::try_from_secs_f64(within_s).ok().filter(|time| !time.is_zero());
            time.map(Accuracy::within).ok_or_else(|| Raised::argument("within_s", within_s, "a time above 0 s"))
        }
        (Some(tolerance), None) => tolerance.accuracy(),
        (None, None) => Ok(Accuracy::BALANCED),
    }
}

/// A place in m: two coordinates, or one along a bar.
#[derive(Clone, Copy, FromPyObject)]
pub enum Place {
    /// x and y.
    Plane(f64, f64),
    /// x.
    Line(f64),
}

impl Place {
    /// Where it is on the surface; `field` is what the argument is called.
    pub fn on(self, scene: &Scene, field: &str) -> Result<(f64, f64), Raised> {
        let at = match self {
            Place::Plane(x_m, y_m) => (x_m, y_m),
            Place::Line(x_m) if scene.surface.kind == SurfaceKind::Bar => (x_m, 0.0),
            Place::Line(x_m) => return Err(Raised::argument(field, x_m, "two coordinates (x_m, y_m) on a plate")),
        };
        let place = scene.place(at.0, at.1).map_err(|error| Raised::place(field, at, error))?;
        Ok(place.xy_m())
    }
}

/// Frequencies in Hz, of an array or anything that makes one. They are copied: another thread may write to the array meanwhile.
pub struct Frequencies(Vec<f64>);

impl<'py> FromPyObject<'_, 'py> for Frequencies {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        // NumPy would leave out imaginary parts, with a warning.
        let kind = given.getattr("dtype").and_then(|kind| kind.getattr("kind")?.extract::<String>());
        if kind.is_ok_and(|kind| kind == "c") {
            return Err(PyTypeError::new_err("frequencies are real numbers"));
        }
        let array: PyArrayLike1<'_, f64, AllowTypeChange> = given.extract()?;
        Ok(Self(array.as_array().iter().copied().collect()))
    }
}

/// The frequencies, each from `least_hz` up.
pub fn frequencies(Frequencies(frequencies_hz): Frequencies, least_hz: f64) -> Result<Vec<f64>, Raised> {
    if frequencies_hz.is_empty() || frequencies_hz.len() > MOST_FREQUENCIES {
        let allowed = format!("1 to {MOST_FREQUENCIES} frequencies");
        return Err(Raised::argument("len(frequency_hz)", frequencies_hz.len(), allowed));
    }
    let wrong = frequencies_hz.iter().position(|hz| !(hz.is_finite() && *hz >= least_hz));
    match wrong {
        None => Ok(frequencies_hz),
        Some(at) => {
            let allowed = if least_hz > 0.0 { "above 0 Hz" } else { "0 Hz and above" };
            Err(Raised::argument(format!("frequency_hz[{at}]"), frequencies_hz[at], allowed))
        }
    }
}

/// Columns and rows of a grid.
pub fn grid((columns, rows): (i64, i64)) -> Result<(usize, usize), Raised> {
    let lines = |field: &str, count: i64| {
        let lines = usize::try_from(count).ok().filter(|count| (1..=MOST_LINES).contains(count));
        #[expect(clippy::cast_precision_loss, reason = "to be shown")]
        lines.ok_or_else(|| Raised::argument(field, Value::Number(count as f64), format!("1 to {MOST_LINES}")))
    };
    Ok((lines("grid[0]", columns)?, lines("grid[1]", rows)?))
}

/// Responses are to actuators.
pub fn need_actuators(scene: &Scene) -> Result<(), Raised> {
    if scene.actuators.is_empty() { Err(era_planner::PlanError::NoActuators.into()) } else { Ok(()) }
}
