//! `verify`: prediction against the simulated device.

use crate::arguments::{GivenPlace, GivenTolerance, accuracy_from_either_tolerance_or_time_limit_or_balanced as asked};
use crate::errors::Raised;
use crate::pickles::{Reduced, pickled, reduce_for_pickle};
use crate::results::{parse_json_to_python, read_only_array, read_only_array_of_shape, serialise_to_json};
use crate::scene::PyScene;
use crate::tables::run_with_cached_plan_table_emitting_model_warnings;
use era::verify::{SimulationComparison, compare_plans_at_points_with_simulation, spread_points_over};
use era_planner::{DEFAULT_INTENSITY_G, Target};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyList;

/// Most points: a day of simulation.
const MOST_POINTS: u32 = 100_000;

/// Points, predicted and simulated. Arrays are read-only, relative differences are of the prediction.
#[pyclass(frozen, module = "era")]
pub struct Verification {
    /// The points in m: float64 [point, 2].
    #[pyo3(get)]
    xy_m: Py<PyArray2<f64>>,
    /// Sum of the amplitudes at the drives' frequencies with forces of the moving masses, predicted, in g: float64 [point].
    #[pyo3(get)]
    predicted_g: Py<PyArray1<f64>>,
    /// The same in the record of the simulated device, in g: float64 [point].
    #[pyo3(get)]
    simulated_g: Py<PyArray1<f64>>,
    /// Relative difference of the two: float64 [point].
    #[pyo3(get)]
    difference: Py<PyArray1<f64>>,
    /// Predicted with forces of masses at rest, in g: float64 [point].
    #[pyo3(get)]
    linear_g: Py<PyArray1<f64>>,
    /// Peak of the whole waveform up to 1 kHz, predicted, in g: float64 [point].
    #[pyo3(get)]
    predicted_band_g: Py<PyArray1<f64>>,
    /// The same in the record of the simulated device, in g: float64 [point].
    #[pyo3(get)]
    simulated_band_g: Py<PyArray1<f64>>,
    /// Relative difference of the two: float64 [point].
    #[pyo3(get)]
    band_difference: Py<PyArray1<f64>>,
    /// The plans' upper bounds on the relative error of the model: float64 [point], NaN where there is none.
    #[pyo3(get)]
    error_bound: Py<PyArray1<f64>>,
    /// Largest magnitude of `difference` and `band_difference`.
    #[pyo3(get)]
    largest_difference: f64,
    /// What is known of each point, as the command line's JSON.
    points_json: String,
    count: usize,
}

pickled!(Verification {
    xy_m,
    predicted_g,
    simulated_g,
    difference,
    linear_g,
    predicted_band_g,
    simulated_band_g,
    band_difference,
    error_bound,
    largest_difference,
    points_json,
    count
});

#[pymethods]
impl Verification {
    /// All that is known of each point, as `era verify --json` prints it, lengths in mm.
    ///
    /// Returns
    /// -------
    /// list of dict
    fn to_dicts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        Ok(parse_json_to_python(py, &self.points_json)?.cast_into::<PyList>()?)
    }

    fn __len__(&self) -> usize {
        self.count
    }

    fn __repr__(&self) -> String {
        format!("<Verification: {} points, largest difference {:.2} %>", self.count, self.largest_difference * 100.0)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

/// How many points, or which.
#[derive(FromPyObject)]
pub enum GivenPoints {
    Count(u32),
    Places(Vec<GivenPlace>),
}

/// Plans touches and runs them on the simulated device, faster than real time, and compares.
///
/// The same as `era verify`, bit for bit.
///
/// Parameters
/// ----------
/// scene : Scene
/// points : int or sequence of (float, float), default 10
///     How many, spread over the surface, fewer where it has cut-outs; or the points themselves in m.
/// intensity_g : float, default 0.5
///     Peak acceleration wanted at each, in g.
/// tolerance : float or {"fast", "balanced", "reference"}, optional
///     What the mesh is chosen for, relative: 1e-8 to 0.1, 1e-3 unless given.
///
/// Returns
/// -------
/// Verification
///
/// Raises
/// ------
/// RequestError, ModelError
///     As `plan`.
/// SimulationError
///     A plan drives nothing, or the panel does not settle.
///
/// Examples
/// --------
/// >>> import era
/// >>> found = era.verify(era.Scene.example("plate"), points=[(0.1, 0.05)], intensity_g=0.2)
/// >>> found.predicted_g.shape, found.largest_difference < 0.05
/// ((1,), True)
#[pyfunction]
#[pyo3(name = "verify", signature = (scene, *, points=GivenPoints::Count(10), intensity_g=DEFAULT_INTENSITY_G, tolerance=None),
    text_signature = "(scene, *, points=10, intensity_g=0.5, tolerance=None)")]
pub fn compare_plans_with_simulation(
    py: Python<'_>,
    scene: &PyScene,
    points: GivenPoints,
    intensity_g: f64,
    tolerance: Option<GivenTolerance>,
) -> PyResult<Verification> {
    let scene = scene.shared_scene();
    let accuracy = asked(tolerance, None)?;
    let places = match points {
        GivenPoints::Count(count) if (1..=MOST_POINTS).contains(&count) => spread_points_over(&scene, count),
        GivenPoints::Count(count) => {
            return Err(Raised::wrong_argument("points", f64::from(count), format!("1 to {MOST_POINTS}")).into());
        }
        GivenPoints::Places(places) => {
            let on = |(i, place): (usize, GivenPlace)| place.check_place_on_surface_m(&scene, &format!("points[{i}]"));
            places.into_iter().enumerate().map(on).collect::<Result<_, _>>()?
        }
    };
    let target = |&(x_m, y_m): &(f64, f64)| Target { x_m, y_m, intensity_g: Some(intensity_g) };
    let targets: Vec<Target> = places.iter().map(target).collect();
    let found = run_with_cached_plan_table_emitting_model_warnings(py, &scene, accuracy, move |table| {
        Ok(compare_plans_at_points_with_simulation(table, &targets)?)
    })?;
    let of = |figure: fn(&SimulationComparison) -> f64| read_only_array(py, found.iter().map(figure).collect());
    let largest = |c: &SimulationComparison| c.difference.abs().max(c.band_difference.abs());
    Ok(Verification {
        xy_m: read_only_array_of_shape(
            py,
            places.iter().flat_map(|(x_m, y_m)| [*x_m, *y_m]).collect(),
            [places.len(), 2],
        )?,
        predicted_g: of(|c| c.predicted_g),
        simulated_g: of(|c| c.simulated_g),
        difference: of(|c| c.difference),
        linear_g: of(|c| c.linear_g),
        predicted_band_g: of(|c| c.predicted_band_g),
        simulated_band_g: of(|c| c.simulated_band_g),
        band_difference: of(|c| c.band_difference),
        error_bound: of(|c| c.error_bound.unwrap_or(f64::NAN)),
        largest_difference: found.iter().map(largest).fold(0.0, f64::max),
        points_json: serialise_to_json(&found)?,
        count: found.len(),
    })
}
