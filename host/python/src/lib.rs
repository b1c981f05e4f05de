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
mod sweep;
mod tables;
mod transient;
mod verify;

/// The compiled part of `era`.
#[pymodule]
mod _era {
    use crate::pickles::restored;
    use numpy::PyArray1;
    use pyo3::exceptions::PyValueError;
    use pyo3::prelude::*;
    use pyo3::types::PyDict;

    /// Makes an array, for which NumPy's interface is looked up: a signal that came while a first call looks for it would be taken
    /// for a mistake.
    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.py().import("numpy")?;
        PyArray1::<f64>::zeros(module.py(), 1, false);
        Ok(())
    }

    /// What pickle calls: a result of the fields that it was taken apart into.
    #[pyfunction]
    #[pyo3(signature = (result, fields, /))]
    fn _restore<'py>(py: Python<'py>, result: &str, fields: &Bound<'py, PyDict>) -> PyResult<Py<PyAny>> {
        match result {
            "Design" => restored::<Design>(py, fields),
            "Drive" => restored::<Drive>(py, fields),
            "Effect" => restored::<Effect>(py, fields),
            "Field" => restored::<Field>(py, fields),
            "Modes" => restored::<Modes>(py, fields),
            "Plan" => restored::<Plan>(py, fields),
            "Press" => restored::<Press>(py, fields),
            "Predicted" => restored::<Predicted>(py, fields),
            "QuietResult" => restored::<QuietResult>(py, fields),
            "Reach" => restored::<Reach>(py, fields),
            "Response" => restored::<Response>(py, fields),
            "Sweep" => restored::<Sweep>(py, fields),
            "TargetResult" => restored::<TargetResult>(py, fields),
            "Transient" => restored::<Transient>(py, fields),
            "Verification" => restored::<Verification>(py, fields),
            _ => Err(PyValueError::new_err(format!("this version of era has no result {result}"))),
        }
    }

    #[pymodule_export]
    use crate::design::Design;
    #[pymodule_export]
    use crate::effect::{Effect, effect};
    #[pymodule_export]
    use crate::field::{Field, field};
    #[pymodule_export]
    use crate::modes::{Modes, modes};
    #[pymodule_export]
    use crate::plan::{Drive, Plan, Predicted, QuietResult, TargetResult, plan};
    #[pymodule_export]
    use crate::press::{Press, press};
    #[pymodule_export]
    use crate::reach::{Reach, reach};
    #[pymodule_export]
    use crate::response::{Response, response};
    #[pymodule_export]
    use crate::scene::PyScene;
    #[pymodule_export]
    use crate::study::PyStudy;
    #[pymodule_export]
    use crate::sweep::{Sweep, sweep};
    #[pymodule_export]
    use crate::transient::{Transient, transient};
    #[pymodule_export]
    use crate::verify::{Verification, verify};
}
