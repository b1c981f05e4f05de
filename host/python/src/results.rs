//! What results have in common.

use crate::errors::Raised;
use era_model::model::{Accuracy, Bound as ErrorBound};
use numpy::{Element, PyArray, PyArray1, PyArrayMethods};
use pyo3::prelude::*;

/// Bounds as numbers, `NaN` where there is none.
pub fn bounds_or_nan(bounds: &[ErrorBound]) -> Vec<f64> {
    bounds.iter().map(|bound| bound.limit_if_known().unwrap_or(f64::NAN)).collect()
}

/// Why the first bound that is missing is.
pub fn first_reason_of_missing_bound(bounds: &[ErrorBound]) -> Option<&'static str> {
    bounds.iter().find_map(|bound| bound.reason_if_unknown())
}

/// The tolerance that was asked for, and whether the bounds meet it.
#[derive(Clone, Debug)]
pub struct ToleranceVerdict {
    pub tolerance: Option<f64>,
    pub is_met: Option<bool>,
    pub missing: Option<String>,
}

impl ToleranceVerdict {
    /// Compares bounds with the tolerance of `accuracy`.
    pub fn check_whether_bounds_meet_tolerance(bounds: &[ErrorBound], accuracy: Accuracy) -> Self {
        Self {
            tolerance: accuracy.tolerance_unless_time_limit_given(),
            is_met: ErrorBound::all_meet_tolerance_if_given_and_decidable(bounds, accuracy),
            missing: first_reason_of_missing_bound(bounds).map(str::to_owned),
        }
    }
}

/// Values as an array that takes them over and cannot be written to.
pub fn read_only_array<T: Element>(py: Python<'_>, values: Vec<T>) -> Py<PyArray1<T>> {
    let array = PyArray1::from_vec(py, values);
    make_array_read_only(&array);
    array.unbind()
}

/// The same with more than one index.
pub fn read_only_array_of_shape<T: Element, const N: usize>(
    py: Python<'_>,
    values: Vec<T>,
    shape: [usize; N],
) -> PyResult<Py<PyArray<T, numpy::ndarray::Dim<[usize; N]>>>>
where
    numpy::ndarray::Dim<[usize; N]>: numpy::ndarray::Dimension,
    [usize; N]: numpy::ndarray::IntoDimension<Dim = numpy::ndarray::Dim<[usize; N]>>,
{
    let array = PyArray1::from_vec(py, values).reshape(shape)?;
    make_array_read_only(&array);
    Ok(array.unbind())
}

/// Results are as they were found: whoever wants to change one takes a copy.
fn make_array_read_only<T: Element, D: numpy::ndarray::Dimension>(array: &Bound<'_, PyArray<T, D>>) {
    // Nobody else has it yet, so that nothing is borrowed.
    let _ = array.call_method1("setflags", (false,));
}

/// Values on a grid, `NaN` where there is no surface.
pub fn values_or_nan(values: impl IntoIterator<Item = Option<f64>>) -> Vec<f64> {
    values.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect()
}

/// The JSON of the command line as text.
pub fn serialise_to_json(value: &impl serde::Serialize) -> Result<String, Raised> {
    serde_json::to_string(value).map_err(|error| Raised::wrong_argument("result", &*error.to_string(), "JSON"))
}

/// JSON as Python's objects.
pub fn parse_json_to_python<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (text,))
}

/// The JSON of the command line as Python's objects.
pub fn convert_to_python_by_json<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyAny>> {
    parse_json_to_python(py, &serialise_to_json(value)?)
}
