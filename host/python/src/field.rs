//! `field`: a touch over the whole surface.

use crate::arguments::{GivenPlace, GivenTolerance, accuracy_from_either_tolerance_or_time_limit_or_balanced as asked};
use crate::pickles::{Reduced, pickled, reduce_for_pickle};
use crate::results::{ToleranceVerdict, read_only_array, read_only_array_of_shape, values_or_nan};
use crate::scene::PyScene;
use crate::tables::run_with_table_touched_by_scene_finger;
use era_planner::{STANDARD_GRAVITY, Target};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

/// Peak acceleration over the surface. Arrays are read-only.
#[pyclass(frozen, module = "era", get_all)]
pub struct Field {
    /// The target in m.
    target_m: (f64, f64),
    /// Columns in m, border to border: float64 [column].
    x_m: Py<PyArray1<f64>>,
    /// Rows in m, border to border: float64 [row].
    y_m: Py<PyArray1<f64>>,
    /// Peak of the drives' amplitudes added up, in m/s^2: float64 [row, column], NaN in cut-outs.
    acceleration_m_s2: Py<PyArray2<f64>>,
    /// The same in g.
    peak_g: Py<PyArray2<f64>>,
    /// Frequency of each actuator's drive in Hz: float64 [actuator].
    frequency_hz: Py<PyArray1<f64>>,
    /// 10 log10 of the mean square acceleration within 10 mm of the target over that of the rest.
    contrast_db: f64,
    /// Upper bound on the error at any point, relative to the largest value; None where there is none.
    error_bound: Option<f64>,
    /// Why there is none; None where there is one.
    error_bound_missing: Option<String>,
    /// What was asked for of the bound.
    tolerance: Option<f64>,
    /// Whether the bound is within it; None where there is none.
    tolerance_met: Option<bool>,
}

pickled!(Field {
    target_m,
    x_m,
    y_m,
    acceleration_m_s2,
    peak_g,
    frequency_hz,
    contrast_db,
    error_bound,
    error_bound_missing,
    tolerance,
    tolerance_met
});

#[pymethods]
impl Field {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let shape = self.peak_g.bind(py).getattr("shape")?;
        let (x_m, y_m) = self.target_m;
        Ok(format!("<Field: {shape} (row, column), touch at ({x_m}, {y_m}) m>"))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

/// Peak acceleration over the whole surface for a touch.
///
/// The same as `era field`, bit for bit; with the scene's finger on the target, where it has one.
///
/// Parameters
/// ----------
/// scene : Scene
/// at_m : (float, float) or float
///     The target in m from the top left corner; on a bar x alone will do.
/// intensity_g : float, optional
///     Peak acceleration wanted in g, 0.5 unless given.
/// tolerance : float or {"fast", "balanced", "reference"}, optional
///     What the mesh is chosen for, relative: 1e-8 to 0.1, 1e-3 unless given.
///
/// Returns
/// -------
/// Field
///
/// Raises
/// ------
/// RequestError, ModelError
///     As `plan`.
///
/// Examples
/// --------
/// >>> import era
/// >>> found = era.field(era.Scene.example("plate"), (0.1, 0.05), 0.3)
/// >>> found.peak_g.shape == (found.y_m.size, found.x_m.size), found.error_bound < 1e-2
/// (True, True)
#[pyfunction]
#[pyo3(name = "field", signature = (scene, at_m, intensity_g=None, *, tolerance=None))]
pub fn compute_peak_field(
    py: Python<'_>,
    scene: &PyScene,
    at_m: GivenPlace,
    intensity_g: Option<f64>,
    tolerance: Option<GivenTolerance>,
) -> PyResult<Field> {
    let scene = scene.shared_scene();
    let accuracy = asked(tolerance, None)?;
    let (x_m, y_m) = at_m.check_place_on_surface_m(&scene, "at_m")?;
    let target = Target { x_m, y_m, intensity_g };
    let (plan, values, bound, [x_m, y_m]) =
        run_with_table_touched_by_scene_finger(py, &scene, accuracy, vec![(x_m, y_m)], move |table| {
            let plan = table.plan(&[target])?;
            let values = values_or_nan(table.compute_peak_at_each_grid_point_m_per_s2(&plan));
            let bound = era_planner::plan::bound_field_error_relative_to_largest_peak(table, &plan);
            Ok((plan, values, bound, [table.grid.x_m.clone(), table.grid.y_m.clone()]))
        })?;
    let asked = ToleranceVerdict::check_whether_bounds_meet_tolerance(&[bound], accuracy);
    let in_g = values.iter().map(|peak| peak / STANDARD_GRAVITY).collect();
    let shape = [y_m.len(), x_m.len()];
    Ok(Field {
        target_m: plan.target_m.into(),
        x_m: read_only_array(py, x_m),
        y_m: read_only_array(py, y_m),
        acceleration_m_s2: read_only_array_of_shape(py, values, shape)?,
        peak_g: read_only_array_of_shape(py, in_g, shape)?,
        frequency_hz: read_only_array(py, plan.drives.iter().map(|drive| drive.frequency_hz).collect()),
        contrast_db: plan.predicted.contrast_db,
        error_bound: bound.limit_if_known(),
        error_bound_missing: asked.missing,
        tolerance: asked.tolerance,
        tolerance_met: asked.is_met,
    })
}
