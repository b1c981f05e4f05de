//! What functions are asked for, as the crates take it.

use crate::errors::{Raised, Value};
use era_model::model::Accuracy;
use era_model::scene::{Scene, SurfaceKind};
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyBytes, PyString};
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

/// Real numbers of whatever NumPy makes an array of: a number, a sequence, an array, a series. They are copied: another thread may write to
/// an array meanwhile.
pub struct Numbers {
    values: Vec<f64>,
    shape: Vec<usize>,
    /// Where the first masked entry is.
    first_masked: Option<usize>,
}

impl Numbers {
    /// The numbers of `given`, which is one of `what` in messages.
    ///
    /// # Errors
    /// `TypeError` where NumPy finds no real numbers in it.
    pub fn read(given: &Bound<'_, PyAny>, what: &str) -> PyResult<Self> {
        let numpy = given.py().import("numpy")?;
        let refuse = |problem: &str| PyTypeError::new_err(format!("{what}, not {problem}"));
        if given.is_none() {
            // NumPy would make it "not a number".
            return Err(refuse("None"));
        }
        // Values below a mask are of no account, in rows of a list too, and NumPy's other conversions would take them for measured ones.
        let masked = numpy.getattr("ma")?;
        let made = masked.call_method1("asanyarray", (given,)).map_err(|_| refuse("entries of different lengths"))?;
        let mask = masked.call_method1("getmaskarray", (&made,))?;
        let first_masked =
            if mask.call_method0("any")?.extract()? { Some(mask.call_method0("argmax")?.extract()?) } else { None };
        let array = masked.call_method1("getdata", (&made,))?;
        let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
        let flat = array.call_method0("ravel")?;
        // NumPy would leave out imaginary parts, with a warning, read numbers from text, and count days.
        match kind.as_str() {
            "i" | "u" | "f" => {}
            "c" => return Err(refuse("complex numbers")),
            "U" | "S" => return Err(refuse("text")),
            "O" => {
                for entry in flat.try_iter()? {
                    let entry = entry?;
                    let is_other = entry.is_instance_of::<PyString>()
                        || entry.is_instance_of::<PyBytes>()
                        || entry.is_instance_of::<PyBool>();
                    if is_other {
                        return Err(refuse(&entry.repr()?.to_string()));
                    }
                }
            }
            _ => return Err(refuse(&format!("an array of the type {}", array.getattr("dtype")?))),
        }
        let float = numpy.getattr("float64")?;
        let Ok(flat) = flat.call_method1("astype", (float,)) else { return Err(refuse(&flat.repr()?.to_string())) };
        let flat: PyReadonlyArray1<'_, f64> = flat.extract()?;
        let values = flat.as_array().iter().copied().collect();
        Ok(Self { values, shape: array.getattr("shape")?.extract()?, first_masked })
    }

    /// Refuses masked entries; `field` is what the argument is called.
    fn need_no_mask(&self, field: &str) -> Result<(), Raised> {
        let Some(at) = self.first_masked else { return Ok(()) };
        Err(Raised::argument(format!("{field}[{at}]"), "masked", "a number: compressed() leaves masked entries out"))
    }

    /// Exactly `N` numbers, in rows or not.
    fn exactly<const N: usize>(&self) -> Option<[f64; N]> {
        self.values.as_slice().try_into().ok()
    }
}

/// A place in m: two coordinates, or one along a bar.
pub struct Place(Numbers);

impl<'py> FromPyObject<'_, 'py> for Place {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let what = "a place is two numbers (x_m, y_m), or x_m alone on a bar";
        let numbers = Numbers::read(&given, what)?;
        if numbers.shape.len() > 1 || !matches!(numbers.values.len(), 1 | 2) {
            return Err(PyTypeError::new_err(format!("{what}, not an array of the shape {:?}", numbers.shape)));
        }
        Ok(Self(numbers))
    }
}

impl Place {
    /// Where it is on the surface; `field` is what the argument is called.
    pub fn on(&self, scene: &Scene, field: &str) -> Result<(f64, f64), Raised> {
        self.0.need_no_mask(field)?;
        let at = match self.0.values[..] {
            [x_m, y_m] => (x_m, y_m),
            [x_m] if scene.surface.kind == SurfaceKind::Bar => (x_m, 0.0),
            // `extract` let one or two numbers pass.
            _ => {
                let x_m = self.0.values.first().copied().unwrap_or(f64::NAN);
                return Err(Raised::argument(field, x_m, "two coordinates (x_m, y_m) on a plate"));
            }
        };
        locate(scene, field, at)
    }
}

/// Where two coordinates in m are on the surface; `field` is what the argument is called.
fn locate(scene: &Scene, field: &str, at: (f64, f64)) -> Result<(f64, f64), Raised> {
    let place = scene.place(at.0, at.1).map_err(|error| Raised::place(field, at, error))?;
    Ok(place.xy_m())
}

/// Another target: a place in m, and its peak in g, which may be left to the plan.
pub struct Also {
    numbers: Numbers,
}

impl<'py> FromPyObject<'_, 'py> for Also {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let what = "another target is (x_m, y_m) or (x_m, y_m, peak_g)";
        // A peak of None is left to the plan.
        let own = match given.extract::<Vec<Bound<'_, PyAny>>>().as_deref() {
            Ok([x_m, y_m, peak_g]) if peak_g.is_none() => (x_m, y_m).into_pyobject(given.py())?.into_any(),
            _ => given.to_owned(),
        };
        let numbers = Numbers::read(&own, what)?;
        if numbers.shape.len() != 1 || !matches!(numbers.values.len(), 2 | 3) {
            return Err(PyTypeError::new_err(format!("{what}, not an array of the shape {:?}", numbers.shape)));
        }
        Ok(Self { numbers })
    }
}

impl Also {
    /// Its place on the surface in m, and its peak in g; `field` is what the argument is called.
    pub fn on(&self, scene: &Scene, field: &str) -> Result<((f64, f64), Option<f64>), Raised> {
        self.numbers.need_no_mask(field)?;
        let at = |k: usize| self.numbers.values.get(k).copied();
        let place = locate(scene, field, (at(0).unwrap_or(f64::NAN), at(1).unwrap_or(f64::NAN)))?;
        Ok((place, at(2)))
    }
}

/// Four numbers: a quiet zone (a place in m, its radius in m, the most peak acceleration there in g), or two opposite corners in m.
pub struct Four(Numbers);

impl<'py> FromPyObject<'_, 'py> for Four {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let what = "four numbers are needed";
        let numbers = Numbers::read(&given, what)?;
        if numbers.exactly::<4>().is_none() {
            return Err(PyTypeError::new_err(format!("{what}, not an array of the shape {:?}", numbers.shape)));
        }
        Ok(Self(numbers))
    }
}

impl Four {
    /// The numbers; `field` is what the argument is called.
    pub fn numbers(&self, field: &str) -> Result<[f64; 4], Raised> {
        self.0.need_no_mask(field)?;
        self.0.exactly().ok_or_else(|| Raised::argument(field, self.0.values.len(), "four numbers"))
    }

    /// The same where the first two are a place on the surface.
    pub fn around_place(&self, scene: &Scene, field: &str) -> Result<[f64; 4], Raised> {
        let [x_m, y_m, radius_m, at_most_g] = self.numbers(field)?;
        let (x_m, y_m) = locate(scene, field, (x_m, y_m))?;
        Ok([x_m, y_m, radius_m, at_most_g])
    }
}

/// A point of the unit cube.
pub struct Point(Numbers);

impl<'py> FromPyObject<'_, 'py> for Point {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Ok(Self(Numbers::read(&given, "a point is real numbers in one row")?))
    }
}

impl Point {
    /// Its numbers, one from 0 to 1 for each dimension.
    pub fn in_unit_cube(self, dimensions: usize) -> Result<Vec<f64>, Raised> {
        self.0.need_no_mask("point")?;
        let point = self.0.values;
        if point.len() != dimensions {
            return Err(Raised::argument(
                "len(point)",
                point.len(),
                format!("{dimensions}, as many as there are dimensions"),
            ));
        }
        match point.iter().position(|part| !(0.0..=1.0).contains(part)) {
            Some(at) => Err(Raised::argument(format!("point[{at}]"), point[at], "0 to 1")),
            None => Ok(point),
        }
    }
}

/// Frequencies in Hz: one, or any number of them in a row.
pub struct Frequencies(Numbers);

impl<'py> FromPyObject<'_, 'py> for Frequencies {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let what = "frequencies are real numbers in one row";
        let numbers = Numbers::read(&given, what)?;
        if numbers.shape.len() > 1 {
            return Err(PyTypeError::new_err(format!("{what}, not an array of the shape {:?}", numbers.shape)));
        }
        Ok(Self(numbers))
    }
}

/// The frequencies, each from `least_hz` up.
pub fn frequencies(Frequencies(given): Frequencies, least_hz: f64) -> Result<Vec<f64>, Raised> {
    given.need_no_mask("frequency_hz")?;
    let frequencies_hz = given.values;
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

/// Columns and rows of a grid, in a sequence of any kind.
#[derive(Clone, Copy)]
pub struct Grid {
    columns: i64,
    rows: i64,
}

impl Grid {
    /// What is not asked for otherwise.
    pub const fn usual(columns: i64, rows: i64) -> Self {
        Self { columns, rows }
    }
}

impl<'py> FromPyObject<'_, 'py> for Grid {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let counts: Vec<i64> = given.extract()?;
        match counts[..] {
            [columns, rows] => Ok(Self { columns, rows }),
            _ => {
                Err(PyTypeError::new_err(format!("a grid is two whole numbers (columns, rows), not {}", counts.len())))
            }
        }
    }
}

/// Columns and rows of a grid.
pub fn grid(Grid { columns, rows }: Grid) -> Result<(usize, usize), Raised> {
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
