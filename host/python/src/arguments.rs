//! What functions are asked for, as the crates take it.

use crate::errors::{ArgumentValue, Raised};
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
pub enum GivenTolerance {
    /// 1e-8 to 0.1.
    Number(f64),
    /// `fast`, `balanced` or `reference`.
    Name(String),
}

impl GivenTolerance {
    /// The accuracy that the crates take.
    pub fn into_accuracy(self) -> Result<Accuracy, Raised> {
        match self {
            GivenTolerance::Number(value) => Ok(Accuracy::from_tolerance(value)?),
            GivenTolerance::Name(name) => {
                let allowed = "1e-8 to 0.1, \"fast\", \"balanced\" or \"reference\"";
                name.parse().map_err(|_| Raised::wrong_argument("tolerance", name.as_str(), allowed))
            }
        }
    }
}

/// `tolerance` and `within_s`: the latter comes first, balanced if there is neither.
pub fn accuracy_from_either_tolerance_or_time_limit_or_balanced(
    tolerance: Option<GivenTolerance>,
    within_s: Option<f64>,
) -> Result<Accuracy, Raised> {
    match (tolerance, within_s) {
        (Some(_), Some(within_s)) => {
            Err(Raised::wrong_argument("within_s", within_s, "None, because `tolerance` is given"))
        }
        (_, Some(within_s)) => {
            let time = Duration::try_from_secs_f64(within_s).ok().filter(|time| !time.is_zero());
            time.map(Accuracy::best_within_time)
                .ok_or_else(|| Raised::wrong_argument("within_s", within_s, "a time above 0 s"))
        }
        (Some(tolerance), None) => tolerance.into_accuracy(),
        (None, None) => Ok(Accuracy::BALANCED),
    }
}

/// Real numbers of whatever NumPy makes an array of: a number, a sequence, an array, a series. They are copied: another thread may write to
/// an array meanwhile.
pub struct RealNumbers {
    values: Vec<f64>,
    shape: Vec<usize>,
    /// Where the first masked entry is.
    first_masked: Option<usize>,
}

impl RealNumbers {
    /// The numbers of `given`, which is one of `what` in messages.
    ///
    /// # Errors
    /// `TypeError` where NumPy finds no real numbers in it.
    pub fn read_numbers_from_python_argument(given: &Bound<'_, PyAny>, what: &str) -> PyResult<Self> {
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
    fn refuse_masked_entries(&self, field: &str) -> Result<(), Raised> {
        let Some(at) = self.first_masked else { return Ok(()) };
        let (entry, allowed) = (format!("{field}[{at}]"), "a number: remove masked entries with compressed()");
        let text = format!("{entry} is masked, but must be {allowed}");
        Err(Raised::wrong_argument_with_text(entry, "masked", allowed, text))
    }

    /// Exactly `N` numbers, in rows or not.
    fn to_array_if_of_length_n<const N: usize>(&self) -> Option<[f64; N]> {
        self.values.as_slice().try_into().ok()
    }
}

/// A place in m: two coordinates, or one along a bar.
pub struct GivenPlace(RealNumbers);

impl<'py> FromPyObject<'_, 'py> for GivenPlace {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let what = "a place must be two numbers (x_m, y_m), or x_m alone on a bar";
        let numbers = RealNumbers::read_numbers_from_python_argument(&given, what)?;
        if numbers.shape.len() > 1 || !matches!(numbers.values.len(), 1 | 2) {
            return Err(PyTypeError::new_err(format!("{what}; the shape of the given value is {:?}", numbers.shape)));
        }
        Ok(Self(numbers))
    }
}

impl GivenPlace {
    /// Where it is on the surface; `field` is what the argument is called.
    pub fn check_place_on_surface_m(&self, scene: &Scene, field: &str) -> Result<(f64, f64), Raised> {
        self.0.refuse_masked_entries(field)?;
        let at = match self.0.values[..] {
            [x_m, y_m] => (x_m, y_m),
            [x_m] if scene.surface.kind == SurfaceKind::Bar => (x_m, 0.0),
            // `extract` let one or two numbers pass.
            _ => {
                let x_m = self.0.values.first().copied().unwrap_or(f64::NAN);
                return Err(Raised::wrong_argument(field, x_m, "two coordinates (x_m, y_m) on a plate"));
            }
        };
        check_coordinates_on_surface_m(scene, field, at)
    }
}

/// Where two coordinates in m are on the surface; `field` is what the argument is called.
fn check_coordinates_on_surface_m(scene: &Scene, field: &str, at: (f64, f64)) -> Result<(f64, f64), Raised> {
    let place = scene
        .surface_or_bar_axis_point_outside_cutouts(at.0, at.1)
        .map_err(|error| Raised::place_off_surface(field, at, error))?;
    Ok(place.coordinates_m())
}

/// Another target: a place in m, and its peak in g, which may be left to the plan.
pub struct GivenTarget {
    numbers: RealNumbers,
}

impl<'py> FromPyObject<'_, 'py> for GivenTarget {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let what = "an entry of `also` must be (x_m, y_m) or (x_m, y_m, peak_g)";
        // A peak of None is left to the plan.
        let own = match given.extract::<Vec<Bound<'_, PyAny>>>().as_deref() {
            Ok([x_m, y_m, peak_g]) if peak_g.is_none() => (x_m, y_m).into_pyobject(given.py())?.into_any(),
            _ => given.to_owned(),
        };
        let numbers = RealNumbers::read_numbers_from_python_argument(&own, what)?;
        if numbers.shape.len() != 1 || !matches!(numbers.values.len(), 2 | 3) {
            return Err(PyTypeError::new_err(format!("{what}; the shape of the given value is {:?}", numbers.shape)));
        }
        Ok(Self { numbers })
    }
}

impl GivenTarget {
    /// Its place on the surface in m, and its peak in g; `field` is what the argument is called.
    pub fn check_place_m_and_get_peak_g(
        &self,
        scene: &Scene,
        field: &str,
    ) -> Result<((f64, f64), Option<f64>), Raised> {
        self.numbers.refuse_masked_entries(field)?;
        let at = |k: usize| self.numbers.values.get(k).copied();
        let place =
            check_coordinates_on_surface_m(scene, field, (at(0).unwrap_or(f64::NAN), at(1).unwrap_or(f64::NAN)))?;
        Ok((place, at(2)))
    }
}

/// Four numbers: a quiet zone (a place in m, its radius in m, the most peak acceleration there in g), or two opposite corners in m.
pub struct FourNumbers(RealNumbers);

impl<'py> FromPyObject<'_, 'py> for FourNumbers {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let what = "`zone_m`, or an entry of `quiet`, must be four numbers";
        let numbers = RealNumbers::read_numbers_from_python_argument(&given, what)?;
        if numbers.to_array_if_of_length_n::<4>().is_none() {
            return Err(PyTypeError::new_err(format!("{what}; the shape of the given value is {:?}", numbers.shape)));
        }
        Ok(Self(numbers))
    }
}

impl FourNumbers {
    /// The numbers; `field` is what the argument is called.
    pub fn check_unmasked_numbers(&self, field: &str) -> Result<[f64; 4], Raised> {
        self.0.refuse_masked_entries(field)?;
        self.0
            .to_array_if_of_length_n()
            .ok_or_else(|| Raised::wrong_argument(field, self.0.values.len(), "four numbers"))
    }

    /// The same where the first two are a place on the surface.
    pub fn four_numbers_checking_first_two_are_place_on_surface(
        &self,
        scene: &Scene,
        field: &str,
    ) -> Result<[f64; 4], Raised> {
        let [x_m, y_m, radius_m, at_most_g] = self.check_unmasked_numbers(field)?;
        let (x_m, y_m) = check_coordinates_on_surface_m(scene, field, (x_m, y_m))?;
        Ok([x_m, y_m, radius_m, at_most_g])
    }
}

/// A point of the unit cube.
pub struct UnitCubePoint(RealNumbers);

impl<'py> FromPyObject<'_, 'py> for UnitCubePoint {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Ok(Self(RealNumbers::read_numbers_from_python_argument(&given, "a point must be one row of real numbers")?))
    }
}

impl UnitCubePoint {
    /// Its numbers, one from 0 to 1 for each dimension.
    pub fn check_in_unit_cube(self, dimensions: usize) -> Result<Vec<f64>, Raised> {
        self.0.refuse_masked_entries("point")?;
        let point = self.0.values;
        if point.len() != dimensions {
            return Err(Raised::wrong_argument(
                "len(point)",
                point.len(),
                format!("{dimensions}, the number of dimensions"),
            ));
        }
        match point.iter().position(|part| !(0.0..=1.0).contains(part)) {
            Some(at) => Err(Raised::wrong_argument(format!("point[{at}]"), point[at], "0 to 1")),
            None => Ok(point),
        }
    }
}

/// Frequencies in Hz: one, or any number of them in a row.
pub struct GivenFrequencies(RealNumbers);

impl<'py> FromPyObject<'_, 'py> for GivenFrequencies {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let what = "frequencies must be a real number or one row of real numbers";
        let numbers = RealNumbers::read_numbers_from_python_argument(&given, what)?;
        if numbers.shape.len() > 1 {
            return Err(PyTypeError::new_err(format!("{what}; the shape of the given value is {:?}", numbers.shape)));
        }
        Ok(Self(numbers))
    }
}

/// The frequencies, each from `least_hz` up.
pub fn check_frequencies_hz(GivenFrequencies(given): GivenFrequencies, least_hz: f64) -> Result<Vec<f64>, Raised> {
    given.refuse_masked_entries("frequency_hz")?;
    let frequencies_hz = given.values;
    if frequencies_hz.is_empty() || frequencies_hz.len() > MOST_FREQUENCIES {
        let allowed = format!("1 to {MOST_FREQUENCIES} frequencies");
        return Err(Raised::wrong_argument("len(frequency_hz)", frequencies_hz.len(), allowed));
    }
    let wrong = frequencies_hz.iter().position(|hz| !(hz.is_finite() && *hz >= least_hz));
    match wrong {
        None => Ok(frequencies_hz),
        Some(at) => {
            let allowed = if least_hz > 0.0 { "above 0 Hz" } else { "at least 0 Hz" };
            Err(Raised::wrong_argument(format!("frequency_hz[{at}]"), frequencies_hz[at], allowed))
        }
    }
}

/// Columns and rows of a grid, in a sequence of any kind.
#[derive(Clone, Copy)]
pub struct GridSize {
    columns: i64,
    rows: i64,
}

impl GridSize {
    /// The size that is used where none is given.
    pub const fn from_columns_and_rows(columns: i64, rows: i64) -> Self {
        Self { columns, rows }
    }
}

impl<'py> FromPyObject<'_, 'py> for GridSize {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let counts: Vec<i64> = given.extract()?;
        match counts[..] {
            [columns, rows] => Ok(Self { columns, rows }),
            _ => Err(PyTypeError::new_err(format!(
                "a grid must be two whole numbers (columns, rows), not {} numbers",
                counts.len()
            ))),
        }
    }
}

/// Columns and rows of a grid.
pub fn check_columns_and_rows(GridSize { columns, rows }: GridSize) -> Result<(usize, usize), Raised> {
    let lines = |field: &str, count: i64| {
        let lines = usize::try_from(count).ok().filter(|count| (1..=MOST_LINES).contains(count));
        #[expect(clippy::cast_precision_loss, reason = "to be shown")]
        lines.ok_or_else(|| {
            Raised::wrong_argument(field, ArgumentValue::Number(count as f64), format!("1 to {MOST_LINES}"))
        })
    };
    Ok((lines("grid[0]", columns)?, lines("grid[1]", rows)?))
}

/// Responses are to actuators.
pub fn refuse_scene_without_actuators(scene: &Scene) -> Result<(), Raised> {
    if scene.actuators.is_empty() { Err(era_planner::PlanError::NoActuators.into()) } else { Ok(()) }
}
