//! `sweep`: responses all over the surface.

use crate::arguments::{self, GivenFrequencies, GivenTolerance, GridSize, refuse_scene_without_actuators};
use crate::errors::{Raised, emit_model_warnings};
use crate::pickles::{Reduced, pickled, reduce_for_pickle};
use crate::results::{ToleranceVerdict, bounds_or_nan, read_only_array, read_only_array_of_shape};
use crate::run::run_in_pool_interruptibly;
use crate::scene::PyScene;
use era_model::model::{Accuracy, BoundedAnswer, validity};
use era_model::response::sweep::{AccelerationSweep as Found, Arithmetic};
use era_model::response::{MOST_SWEEP_VALUES, SINGLE_DOES, compute_acceleration_sweep_per_newton_with_error_bounds};
use era_model::scene::Scene;
use num_complex::Complex;
use numpy::{Element, PyArray1};
use pyo3::prelude::*;
use std::sync::Arc;

/// Harmonic response of a grid of points to each actuator. Arrays are read-only.
#[pyclass(frozen, module = "era", get_all)]
pub struct Sweep {
    /// The actuators' ids.
    actuators: Vec<String>,
    /// In Hz: float64 [frequency].
    frequency_hz: Py<PyArray1<f64>>,
    /// Columns in m, border to border: float64 [column].
    x_m: Py<PyArray1<f64>>,
    /// Rows in m, border to border: float64 [row].
    y_m: Py<PyArray1<f64>>,
    /// Phasors of the acceleration in m/s^2 for a force of 1 N at that actuator alone, e^(+j w t): complex64, or complex128 below
    /// a tolerance of 1e-5, [frequency, actuator, row, column]; 0 in cut-outs.
    acceleration_m_s2_per_n: Py<PyAny>,
    /// Upper bounds on the error anywhere, relative to the largest magnitude on that point's curve: float64 [actuator], NaN where
    /// there is none.
    error_bound: Py<PyArray1<f64>>,
    /// Why bounds are missing; None where all are there.
    error_bound_missing: Option<String>,
    /// What was asked for of the bounds; None where a time was.
    tolerance: Option<f64>,
    /// Whether all bounds are within it; None where one is missing and none is above it.
    tolerance_met: Option<bool>,
    /// Unknowns of the mesh that answered.
    unknowns: usize,
}

pickled!(Sweep {
    actuators,
    frequency_hz,
    x_m,
    y_m,
    acceleration_m_s2_per_n,
    error_bound,
    error_bound_missing,
    tolerance,
    tolerance_met,
    unknowns
});

#[pymethods]
impl Sweep {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let shape = self.acceleration_m_s2_per_n.bind(py).getattr("shape")?;
        Ok(format!("<Sweep: {shape} (frequency, actuator, row, column)>"))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

/// What was asked for.
struct SweepQuestion {
    scene: Arc<Scene>,
    accuracy: Accuracy,
    x_m: Vec<f64>,
    y_m: Vec<f64>,
    frequencies_hz: Vec<f64>,
}

/// Harmonic response of every point of a grid to 1 N at each actuator alone.
///
/// The same as `era sweep`, bit for bit.
///
/// Parameters
/// ----------
/// scene : Scene
/// frequency_hz : array_like [frequency]
///     In Hz, above 0.
/// grid : (int, int), default (49, 33)
///     Columns and rows, border to border; a bar has one row, its axis.
/// tolerance : float or {"fast", "balanced", "reference"}, optional
///     Of the bounds, relative: 1e-8 to 0.1, 1e-3 unless given.
/// within_s : float, optional
///     The most accurate answer that fits in this time, in s, instead of a tolerance.
///
/// Returns
/// -------
/// Sweep
///
/// Raises
/// ------
/// RequestError
///     An argument is out of range, there are more than 7e7 values, or the scene has no actuator.
/// ResonanceError
///     A frequency is that of an undamped mode.
/// ModelError
///     Too many unknowns or modes, or matrices that cannot be factored.
///
/// Examples
/// --------
/// >>> import era, numpy as np
/// >>> found = era.sweep(era.Scene.example("plate"), np.arange(100.0, 200.0, 20.0), grid=(7, 5))
/// >>> found.acceleration_m_s2_per_n.shape, found.acceleration_m_s2_per_n.dtype
/// ((5, 2, 5, 7), dtype('complex64'))
#[pyfunction]
#[pyo3(name = "sweep", signature = (scene, frequency_hz, *, grid=GridSize::from_columns_and_rows(49, 33), tolerance=None, within_s=None),
    text_signature = "(scene, frequency_hz, *, grid=(49, 33), tolerance=None, within_s=None)")]
pub fn compute_acceleration_sweep_per_newton_on_grid(
    py: Python<'_>,
    scene: &PyScene,
    frequency_hz: GivenFrequencies,
    grid: GridSize,
    tolerance: Option<GivenTolerance>,
    within_s: Option<f64>,
) -> PyResult<Sweep> {
    let scene = scene.shared_scene();
    let frequencies_hz = arguments::check_frequencies_hz(frequency_hz, f64::MIN_POSITIVE)?;
    let accuracy = arguments::accuracy_from_either_tolerance_or_time_limit_or_balanced(tolerance, within_s)?;
    let (x_m, y_m) = scene.surface_grid_lines_or_bar_axis_line_m(arguments::check_columns_and_rows(grid)?);
    refuse_scene_without_actuators(&scene)?;
    check_number_of_values(&scene, x_m.len() * y_m.len(), frequencies_hz.len())?;
    emit_model_warnings(
        py,
        validity::list_thin_plate_warnings(&scene, frequencies_hz.iter().copied().fold(0.0, f64::max)),
    )?;
    let question = SweepQuestion { scene, accuracy, x_m, y_m, frequencies_hz };
    if accuracy.relative_tolerance_or_tightest() >= SINGLE_DOES {
        sweep_in_precision::<f32>(py, question)
    } else {
        sweep_in_precision::<f64>(py, question)
    }
}

fn sweep_in_precision<T>(py: Python<'_>, question: SweepQuestion) -> PyResult<Sweep>
where
    T: Arithmetic + Into<f64>,
    Complex<T>: Element,
{
    type Answer<T> = (BoundedAnswer<Found<T>>, Vec<Complex<T>>, SweepQuestion);
    let work = move |question: SweepQuestion| -> Result<Answer<T>, Raised> {
        let SweepQuestion { scene, accuracy, x_m, y_m, frequencies_hz } = &question;
        let found =
            compute_acceleration_sweep_per_newton_with_error_bounds::<T>(scene, *accuracy, (x_m, y_m), frequencies_hz)?;
        let values = found.answer.re.iter().zip(&found.answer.im).map(|(re, im)| Complex::new(*re, *im)).collect();
        Ok((found, values, question))
    };
    let (found, values, question) = run_in_pool_interruptibly(py, move || work(question))?;
    let SweepQuestion { scene, accuracy, x_m, y_m, frequencies_hz } = question;
    let asked = ToleranceVerdict::check_whether_bounds_meet_tolerance(&found.bounds, accuracy);
    let shape = [frequencies_hz.len(), scene.actuators.len(), y_m.len(), x_m.len()];
    Ok(Sweep {
        actuators: scene.actuators.iter().map(|actuator| actuator.id.clone()).collect(),
        frequency_hz: read_only_array(py, frequencies_hz),
        x_m: read_only_array(py, x_m),
        y_m: read_only_array(py, y_m),
        acceleration_m_s2_per_n: read_only_array_of_shape(py, values, shape)?.into_any(),
        error_bound: read_only_array(py, bounds_or_nan(&found.bounds)),
        error_bound_missing: asked.missing,
        tolerance: asked.tolerance,
        tolerance_met: asked.is_met,
        unknowns: found.model.count_unknowns(),
    })
}

#[expect(clippy::cast_precision_loss, reason = "a size to be refused")]
fn check_number_of_values(scene: &Scene, points: usize, frequencies: usize) -> Result<(), Raised> {
    let values = points as f64 * frequencies as f64 * scene.actuators.len() as f64;
    if values <= MOST_SWEEP_VALUES {
        return Ok(());
    }
    let (values, most) = (format!("{values:e}"), format!("{MOST_SWEEP_VALUES:e}"));
    Err(Raised::grid_with_too_many_values(points, &values, &most, "fewer frequencies"))
}
