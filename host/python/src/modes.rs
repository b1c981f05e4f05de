//! `modes`: frequencies, damping and shapes.

use crate::arguments::{self, GivenTolerance, GridSize};
use crate::errors::{Raised, emit_model_warnings};
use crate::pickles::{Reduced, pickled, reduce_for_pickle};
use crate::results::{ToleranceVerdict, bounds_or_nan, read_only_array, read_only_array_of_shape};
use crate::run::run_in_pool_interruptibly;
use crate::scene::PyScene;
use era_model::model::{PanelMode, compute_modes_with_error_bounds, validity};
use era_model::scene::Scene;
use era_planner::maps::shapes::ModeShapes;
use numpy::{Complex64, PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Most values of shapes, as the command line has it: 160 MB.
const MOST_VALUES: usize = 20_000_000;

/// Modes of a panel, ascending. Arrays are read-only.
#[pyclass(frozen, module = "era", get_all)]
pub struct Modes {
    /// Undamped frequencies in Hz: float64 [mode]; exactly 0 for motions that nothing holds.
    frequency_hz: Py<PyArray1<f64>>,
    /// Damping ratios of the poles that continue from the modes: float64 [mode]; above 1 for one that does not swing, 0 for motions that nothing holds, NaN where
    /// the pole is not known.
    damping_ratio: Py<PyArray1<f64>>,
    /// Moduli of these poles over 2 pi, in Hz; of two that do not swing their geometric mean: float64 [mode].
    pole_frequency_hz: Py<PyArray1<f64>>,
    /// These poles s in 1/s: complex128 [mode, 2], in column 0 with Im s >= 0, in column 1 the slower one of two that do not swing; NaN where there is none, or
    /// it is not known.
    poles_per_s: Py<PyArray2<Complex64>>,
    /// Upper bounds on the error of each pole, relative to its modulus: float64 [mode], NaN where there is none.
    pole_error_bound: Py<PyArray1<f64>>,
    /// Upper bounds on the error of each frequency, relative to it (in Hz for a motion that nothing holds): float64 [mode], NaN where
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
    /// What the surface's layers are together: a dict of `thickness_m`, `mass_kg_per_m2`, `loss_factor` and the bending stiffnesses, of a plate `d11_n_m`,
    /// `d12_n_m`, `d22_n_m` and `d66_n_m`, of a bar `bending_stiffness_n_m2` (E I); None without layers.
    layers: Option<Py<PyDict>>,
    /// Columns of the shapes' grid in m: float64 [column]; None without `grid`.
    x_m: Option<Py<PyArray1<f64>>>,
    /// Rows of the shapes' grid in m: float64 [row]; None without `grid`.
    y_m: Option<Py<PyArray1<f64>>>,
    /// Mass-normalised shapes in kg^-1/2: float64 [mode, row, column], NaN in cut-outs; None without `grid`.
    shape_per_sqrt_kg: Option<Py<PyArray3<f64>>>,
}

pickled!(Modes {
    frequency_hz,
    damping_ratio,
    pole_frequency_hz,
    poles_per_s,
    pole_error_bound,
    error_bound,
    error_bound_missing,
    tolerance,
    tolerance_met,
    unknowns,
    layers,
    x_m,
    y_m,
    shape_per_sqrt_kg
});

#[pymethods]
impl Modes {
    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        self.frequency_hz.bind(py).len()
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("<Modes: {}, {} unknowns>", self.__len__(py)?, self.unknowns))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

/// Both poles of each mode, one after the other.
fn list_pole_and_slower_pole_or_nan_of_each_mode(modes: &[PanelMode]) -> Vec<Complex64> {
    let unknown = Complex64::new(f64::NAN, f64::NAN);
    modes.iter().flat_map(|mode| [mode.pole.s, mode.pole.slower.unwrap_or(unknown)]).collect()
}

/// What a scene's layers are together.
fn laminate_as_dict_if_layered(py: Python<'_>, scene: &Scene) -> PyResult<Option<Py<PyDict>>> {
    let Some(laminate) = scene.surface.laminate_if_layered() else { return Ok(None) };
    let found = PyDict::new(py);
    found.set_item("thickness_m", laminate.thickness_m)?;
    found.set_item("mass_kg_per_m2", laminate.per_area_kg_m2)?;
    found.set_item("loss_factor", laminate.loss_factor)?;
    for (name, stiffness) in laminate.named_bending_stiffnesses(scene.surface.kind, scene.surface.width_m) {
        found.set_item(name, stiffness)?;
    }
    Ok(Some(found.unbind()))
}

/// All modes of a panel up to a frequency.
///
/// The same as `era modes`, bit for bit.
///
/// Parameters
/// ----------
/// scene : Scene
/// max_hz : float
///     Highest frequency in Hz.
/// grid : (int, int), optional
///     Columns and rows of a grid, border to border, for mode shapes; a bar has one row, its axis.
/// tolerance : float or {"fast", "balanced", "reference"}, optional
///     Of the bounds, relative: 1e-8 to 0.1, 1e-3 unless given.
/// within_s : float, optional
///     The most accurate answer that fits in this time, in s, instead of a tolerance.
///
/// Returns
/// -------
/// Modes
///
/// Raises
/// ------
/// RequestError
///     An argument is out of range.
/// ModelError
///     Too many unknowns or modes, or matrices that cannot be factored.
///
/// Warns
/// -----
/// ModelWarning
///     The panel is too thick for thin-plate theory.
///
/// Examples
/// --------
/// >>> import era
/// >>> found = era.modes(era.Scene.example("bar"), 300.0, tolerance=1e-6)
/// >>> bool((found.error_bound <= 1e-6).all()), found.tolerance_met
/// (True, True)
/// >>> found.frequency_hz.shape == found.damping_ratio.shape == (len(found),)
/// True
#[pyfunction]
#[pyo3(name = "modes", signature = (scene, max_hz, *, grid=None, tolerance=None, within_s=None))]
pub fn compute_modes(
    py: Python<'_>,
    scene: &PyScene,
    max_hz: f64,
    grid: Option<GridSize>,
    tolerance: Option<GivenTolerance>,
    within_s: Option<f64>,
) -> PyResult<Modes> {
    let scene = scene.shared_scene();
    let accuracy = arguments::accuracy_from_either_tolerance_or_time_limit_or_balanced(tolerance, within_s)?;
    let grid = grid
        .map(arguments::check_columns_and_rows)
        .transpose()?
        .map(|grid| scene.surface_grid_lines_or_bar_axis_line_m(grid));
    let doubts = validity::list_thin_plate_warnings(&scene, max_hz);
    let layers = laminate_as_dict_if_layered(py, &scene)?;
    let (found, shapes) = run_in_pool_interruptibly(py, move || {
        let found = compute_modes_with_error_bounds(&scene, accuracy, max_hz)?;
        let shapes = match grid {
            Some(grid) => {
                let values = grid.0.len() * grid.1.len() * found.answer.len();
                if values > MOST_VALUES {
                    let (points, most) = (grid.0.len() * grid.1.len(), MOST_VALUES.to_string());
                    let other = "a lower max_hz";
                    return Err(Raised::grid_with_too_many_values(points, &values.to_string(), &most, other));
                }
                Some(ModeShapes::compute(&scene, &found, max_hz, grid)?)
            }
            None => None,
        };
        Ok((found, shapes))
    })?;
    emit_model_warnings(py, doubts)?;
    let asked = ToleranceVerdict::check_whether_bounds_meet_tolerance(&found.bounds, accuracy);
    let (x_m, y_m, shape_per_sqrt_kg) = match shapes {
        Some(shapes) => {
            let sides = [shapes.frequencies_hz.len(), shapes.y_m.len(), shapes.x_m.len()];
            // Column by column of points x modes: mode by mode, as it is.
            let values = read_only_array_of_shape(py, shapes.shapes.data.into(), sides)?;
            (Some(read_only_array(py, shapes.x_m)), Some(read_only_array(py, shapes.y_m)), Some(values))
        }
        None => (None, None, None),
    };
    Ok(Modes {
        frequency_hz: read_only_array(py, found.answer.iter().map(|mode| mode.frequency_hz).collect()),
        damping_ratio: read_only_array(py, found.answer.iter().map(|mode| mode.damping_ratio).collect()),
        pole_frequency_hz: read_only_array(py, found.answer.iter().map(|mode| mode.pole.frequency_hz).collect()),
        poles_per_s: read_only_array_of_shape(
            py,
            list_pole_and_slower_pole_or_nan_of_each_mode(&found.answer),
            [found.answer.len(), 2],
        )?,
        pole_error_bound: read_only_array(
            py,
            bounds_or_nan(&found.answer.iter().map(|mode| mode.pole_bound).collect::<Vec<_>>()),
        ),
        error_bound: read_only_array(py, bounds_or_nan(&found.bounds)),
        error_bound_missing: asked.missing,
        tolerance: asked.tolerance,
        tolerance_met: asked.is_met,
        unknowns: found.model.count_unknowns(),
        layers,
        x_m,
        y_m,
        shape_per_sqrt_kg,
    })
}
