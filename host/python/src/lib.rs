//! The compiled part of the Python package `era`: the crates `era-model`, `era-planner` and `era-study`, and the simulated device of `era-host`,
//! for NumPy.
//!
//! `scene` is what there is, `document` its form as mappings; `modes` and the like are a function with its result each.
//! What they share: `arguments` in, `results` out, `errors` as exceptions, `run` for work without the interpreter's lock.

use pyo3::prelude::*;

mod arguments;
mod design;
mod document;
mod effect;
mod errors;
mod field;
mod modes;
mod pickles;
mod plan;
mod press;
mod reach;
mod request;
mod response;
mod results;
mod run;
mod scene;
mod study;
mod study_progress;
mod sweep;
mod tables;
mod transient;
mod verify;

/// The compiled part of `era`.
#[pymodule]
mod _era {
    use crate::pickles::restore_from_fields_making_arrays_read_only;
    use numpy::PyArray1;
    use pyo3::exceptions::PyValueError;
    use pyo3::prelude::*;
    use pyo3::types::PyDict;

    /// Makes an array, for which NumPy's interface is looked up: a signal that came while a first call looks for it would be taken
    /// for a mistake.
    #[pymodule_init]
    fn add_version_and_import_numpy_interface(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.py().import("numpy")?;
        PyArray1::<f64>::zeros(module.py(), 1, false);
        Ok(())
    }

    /// What pickle calls: a result of the fields that it was taken apart into.
    #[pyfunction]
    #[pyo3(name = "_restore", signature = (result, fields, /))]
    fn restore_result<'py>(py: Python<'py>, result: &str, fields: &Bound<'py, PyDict>) -> PyResult<Py<PyAny>> {
        match result {
            "Design" => restore_from_fields_making_arrays_read_only::<Design>(py, fields),
            "Drive" => restore_from_fields_making_arrays_read_only::<Drive>(py, fields),
            "Effect" => restore_from_fields_making_arrays_read_only::<Effect>(py, fields),
            "Field" => restore_from_fields_making_arrays_read_only::<Field>(py, fields),
            "Modes" => restore_from_fields_making_arrays_read_only::<Modes>(py, fields),
            "Plan" => restore_from_fields_making_arrays_read_only::<Plan>(py, fields),
            "Press" => restore_from_fields_making_arrays_read_only::<Press>(py, fields),
            "Predicted" => restore_from_fields_making_arrays_read_only::<Predicted>(py, fields),
            "QuietResult" => restore_from_fields_making_arrays_read_only::<QuietResult>(py, fields),
            "Reach" => restore_from_fields_making_arrays_read_only::<Reach>(py, fields),
            "Response" => restore_from_fields_making_arrays_read_only::<Response>(py, fields),
            "Sweep" => restore_from_fields_making_arrays_read_only::<Sweep>(py, fields),
            "TargetResult" => restore_from_fields_making_arrays_read_only::<TargetResult>(py, fields),
            "Transient" => restore_from_fields_making_arrays_read_only::<Transient>(py, fields),
            "Verification" => restore_from_fields_making_arrays_read_only::<Verification>(py, fields),
            _ => Err(PyValueError::new_err(format!(
                "this version of era has no result class `{result}`: update the package era"
            ))),
        }
    }

    #[pymodule_export]
    use crate::design::Design;
    #[pymodule_export]
    use crate::effect::{Effect, design_effect_for_place};
    #[pymodule_export]
    use crate::field::{Field, compute_peak_field};
    #[pymodule_export]
    use crate::modes::{Modes, compute_modes};
    #[pymodule_export]
    use crate::plan::{Drive, Plan, Predicted, QuietResult, TargetResult, plan_touch};
    #[pymodule_export]
    use crate::press::{Press, compute_actuator_gaps_and_safe_voltages_under_press};
    #[pymodule_export]
    use crate::reach::{Reach, compute_strongest_peak_and_best_contrast_maps};
    #[pymodule_export]
    use crate::response::{Response, compute_acceleration_response_per_newton_at_place};
    #[pymodule_export]
    use crate::scene::PyScene;
    #[pymodule_export]
    use crate::study::PyStudy;
    #[pymodule_export]
    use crate::sweep::{Sweep, compute_acceleration_sweep_per_newton_on_grid};
    #[pymodule_export]
    use crate::transient::{Transient, compute_transient_motion};
    #[pymodule_export]
    use crate::verify::{Verification, compare_plans_with_simulation};
}
