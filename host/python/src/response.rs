//! `response`: curves at a point.

use crate::arguments::{self, GivenFrequencies, GivenPlace, GivenTolerance, refuse_scene_without_actuators};
use crate::errors::emit_model_warnings;
use crate::pickles::{Reduced, pickled, reduce_for_pickle};
use crate::results::{ToleranceVerdict, bounds_or_nan, read_only_array, read_only_array_of_shape};
use crate::run::run_in_pool_interruptibly;
use crate::scene::PyScene;
use era_model::model::validity;
use era_model::response::compute_acceleration_curves_per_newton_with_error_bounds;
use num_complex::Complex64;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

/// Harmonic response of a point to each actuator. Arrays are read-only.
#[pyclass(frozen, module = "era", get_all)]
pub struct Response {
    /// The point in m.
    at_m: (f64, f64),
    /// The actuators' ids.
    actuators: Vec<String>,
    /// In Hz: float64 [frequency].
    frequency_hz: Py<PyArray1<f64>>,
    /// Phasors of the acceleration in m/s^2 for a force of 1 N at that actuator alone, e^(+j w t): complex128 [actuator, frequency].
    acceleration_m_s2_per_n: Py<PyArray2<Complex64>>,
    /// Upper bounds on the error, relative to the largest magnitude on the actuator's curve: float64 [actuator], NaN where there is none.
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

pickled!(Response {
    at_m,
    actuators,
    frequency_hz,
    acceleration_m_s2_per_n,
    error_bound,
    error_bound_missing,
    tolerance,
    tolerance_met,
    unknowns
});

#[pymethods]
impl Response {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (count, (x_m, y_m)) = (self.frequency_hz.bind(py).len()?, self.at_m);
        Ok(format!("<Response: {} actuators, {count} frequencies at ({x_m}, {y_m}) m>", self.actuators.len()))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

/// Harmonic response of a point to 1 N at each actuator alone.
///
/// The same as `era response`, bit for bit; with the scene's finger on the point, where it has one.
///
/// Parameters
/// ----------
/// scene : Scene
/// at_m : (float, float) or float
///     The point in m from the top left corner; on a bar x alone will do.
/// frequency_hz : array_like [frequency]
///     In Hz, 0 and up.
/// tolerance : float or {"fast", "balanced", "reference"}, optional
///     Of the bounds, relative: 1e-8 to 0.1, 1e-3 unless given.
/// within_s : float, optional
///     The most accurate answer that fits in this time, in s, instead of a tolerance.
///
/// Returns
/// -------
/// Response
///
/// Raises
/// ------
/// RequestError
///     An argument is out of range, or the scene has no actuator.
/// ResonanceError
///     A frequency is that of an undamped mode.
/// ModelError
///     Too many unknowns or modes, or matrices that cannot be factored.
///
/// Examples
/// --------
/// >>> import era, numpy as np
/// >>> plate = era.Scene.example("plate")
/// >>> found = era.response(plate, (0.1, 0.05), np.arange(40.0, 401.0))
/// >>> found.acceleration_m_s2_per_n.shape, found.acceleration_m_s2_per_n.dtype
/// ((2, 361), dtype('complex128'))
/// >>> bool((found.error_bound <= 1e-3).all())
/// True
#[pyfunction]
#[pyo3(name = "response", signature = (scene, at_m, frequency_hz, *, tolerance=None, within_s=None))]
pub fn compute_acceleration_response_per_newton_at_place(
    py: Python<'_>,
    scene: &PyScene,
    at_m: GivenPlace,
    frequency_hz: GivenFrequencies,
    tolerance: Option<GivenTolerance>,
    within_s: Option<f64>,
) -> PyResult<Response> {
    let scene = scene.shared_scene();
    let at_m = at_m.check_place_on_surface_m(&scene, "at_m")?;
    let frequencies_hz = arguments::check_frequencies_hz(frequency_hz, 0.0)?;
    let accuracy = arguments::accuracy_from_either_tolerance_or_time_limit_or_balanced(tolerance, within_s)?;
    refuse_scene_without_actuators(&scene)?;
    emit_model_warnings(
        py,
        validity::list_thin_plate_warnings(&scene, frequencies_hz.iter().copied().fold(0.0, f64::max)),
    )?;
    // With the finger on the point, where the scene has one.
    let scene = scene.replace_finger_by_masses_and_supports_at_places(&[at_m]);
    let actuators = scene.actuators.iter().map(|actuator| actuator.id.clone()).collect();
    let (found, frequencies_hz) = run_in_pool_interruptibly(py, move || {
        Ok((
            compute_acceleration_curves_per_newton_with_error_bounds(&scene, accuracy, at_m, &frequencies_hz)?,
            frequencies_hz,
        ))
    })?;
    let asked = ToleranceVerdict::check_whether_bounds_meet_tolerance(&found.bounds, accuracy);
    let shape = [found.answer.len(), frequencies_hz.len()];
    Ok(Response {
        at_m,
        actuators,
        frequency_hz: read_only_array(py, frequencies_hz),
        acceleration_m_s2_per_n: read_only_array_of_shape(py, found.answer.concat(), shape)?,
        error_bound: read_only_array(py, bounds_or_nan(&found.bounds)),
        error_bound_missing: asked.missing,
        tolerance: asked.tolerance,
        tolerance_met: asked.is_met,
        unknowns: found.model.count_unknowns(),
    })
}
