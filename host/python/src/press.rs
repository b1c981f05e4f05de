//! `press`: what a finger's press does to the gaps of actuators.

use crate::arguments::{GivenTolerance, accuracy_from_either_tolerance_or_time_limit_or_balanced as asked};
use crate::errors::Raised;
use crate::pickles::{Reduced, pickled, reduce_for_pickle};
use crate::results::{parse_json_to_python, read_only_array, read_only_array_of_shape, serialise_to_json};
use crate::scene::PyScene;
use crate::tables::run_with_cached_plan_table_emitting_model_warnings;
use era_planner::PressedActuator;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// Greatest press in N, as the command line has it.
const MOST_N: f64 = 1000.0;

/// What a press does to the gaps of all actuators. Arrays are read-only.
#[pyclass(frozen, module = "era")]
pub struct Press {
    /// The press in N.
    #[pyo3(get)]
    force_n: f64,
    /// The actuators' ids.
    #[pyo3(get)]
    actuators: Vec<String>,
    /// Where a press moves each mass furthest, in m: float64 [actuator, 2].
    #[pyo3(get)]
    at_m: Py<PyArray2<f64>>,
    /// How far by itself, in m: float64 [actuator], NaN on a panel that nothing holds.
    #[pyo3(get)]
    alone_m: Py<PyArray1<f64>>,
    /// Upper bounds on the error of `alone_m`, relative to it: float64 [actuator], NaN where there is none.
    #[pyo3(get)]
    error_bound: Py<PyArray1<f64>>,
    /// How far with the electrodes' pull at the highest voltages, a stop holding it, in m: float64 [actuator].
    #[pyo3(get)]
    sag_m: Py<PyArray1<f64>>,
    /// Upper bounds on the error of `sag_m`, relative to it, and so of what is left of each gap: float64 [actuator], NaN where there is none.
    #[pyo3(get)]
    sag_error_bound: Py<PyArray1<f64>>,
    /// What is left of each gap on the nearer side, in m: float64 [actuator].
    #[pyo3(get)]
    gap_left_m: Py<PyArray1<f64>>,
    /// The highest voltage that is safe from breakdown there, in V: float64 [actuator].
    #[pyo3(get)]
    holds_v: Py<PyArray1<f64>>,
    report_json: String,
}

pickled!(Press {
    force_n,
    actuators,
    at_m,
    alone_m,
    error_bound,
    sag_m,
    sag_error_bound,
    gap_left_m,
    holds_v,
    report_json
});

#[pymethods]
impl Press {
    /// The press as `era press --json` prints it, lengths in mm and um, with stops.
    ///
    /// Returns
    /// -------
    /// dict
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        Ok(parse_json_to_python(py, &self.report_json)?.cast_into::<PyDict>()?)
    }

    fn __repr__(&self) -> String {
        format!("<Press: {} N on {}>", self.force_n, self.actuators.join(", "))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

/// What a steady press does to the gaps of actuators: how far masses go off their middle, and what voltage is still safe.
///
/// The same as `era press`, bit for bit, of the panel that nothing else touches.
///
/// Parameters
/// ----------
/// scene : Scene
/// force_n : float, optional
///     The press in N, 0 to 1000: the scene's (`press`) unless given.
/// tolerance : float or {"fast", "balanced", "reference"}, optional
///     What the mesh is chosen for, relative: 1e-8 to 0.1, 1e-3 unless given.
///
/// Returns
/// -------
/// Press
///
/// Raises
/// ------
/// RequestError
///     An argument is out of range, or the scene has no actuator or more than four.
/// ModelError
///     The panel cannot be modelled.
///
/// Warns
/// -----
/// ModelWarning
///     Gaps do not bear the press.
///
/// Examples
/// --------
/// >>> import era
/// >>> found = era.press(era.Scene.example("bar"), 1.0)
/// >>> found.force_n, found.sag_m.shape == (len(found.actuators),)
/// (1.0, True)
#[pyfunction]
#[pyo3(name = "press", signature = (scene, force_n=None, *, tolerance=None))]
pub fn compute_actuator_gaps_and_safe_voltages_under_press(
    py: Python<'_>,
    scene: &PyScene,
    force_n: Option<f64>,
    tolerance: Option<GivenTolerance>,
) -> PyResult<Press> {
    let mut scene = scene.shared_scene();
    let accuracy = asked(tolerance, None)?;
    if let Some(force_n) = force_n {
        if !(0.0..=MOST_N).contains(&force_n) {
            return Err(Raised::wrong_argument("force_n", force_n, format!("0 to {MOST_N}")).into());
        }
        Arc::make_mut(&mut scene).press_n = force_n;
    }
    let report = run_with_cached_plan_table_emitting_model_warnings(py, &scene, accuracy, |table| {
        Ok(era_planner::press_report::build_press_report(table))
    })?;
    let report_json = serialise_to_json(&report)?;
    let of = |figure: fn(&PressedActuator) -> f64| read_only_array(py, report.actuators.iter().map(figure).collect());
    let places = report.actuators.iter().flat_map(|own| own.at_mm.map(|at_mm| at_mm / 1e3)).collect();
    Ok(Press {
        force_n: report.force_n,
        actuators: report.actuators.iter().map(|own| own.actuator.clone()).collect(),
        at_m: read_only_array_of_shape(py, places, [report.actuators.len(), 2])?,
        alone_m: of(|own| own.alone_um.map_or(f64::NAN, |um| um / 1e6)),
        error_bound: of(|own| own.error_bound.unwrap_or(f64::NAN)),
        sag_m: of(|own| own.sag_um / 1e6),
        sag_error_bound: of(|own| own.sag_error_bound.unwrap_or(f64::NAN)),
        gap_left_m: of(|own| own.gap_left_um / 1e6),
        holds_v: of(|own| own.holds_v),
        report_json,
    })
}
