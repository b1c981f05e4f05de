//! The compiled part of the Python package `era`: the crates `era-model`, `era-planner` and `era-study`, and the simulated device of `era-host`,
//! for NumPy.
//!
//! `scene` is what there is, `document` its form as mappings; `modes` and the like are a function with its result each.
//! What they share: `arguments` in, `results` out, `errors` as exceptions, `run` for work without the interpreter's lock.

use pyo3::prelude::*;

mod arguments;
mod document;
mod errors;
mod field;
mod modes;
mod plan;
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
    use numpy::PyArray1;
    use pyo3::prelude::*;

    /// Makes an array, for which NumPy's interface is looked up: a signal that came while a first call looks for it would be taken
    /// for a mistake.
    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.py().import("numpy")?;
        PyArray1::<f64>::zeros(module.py(), 1, false);
        Ok(())
    }

    #[pymodule_export]
    use crate::field::{Field, field};
    #[pymodule_export]
    use crate::modes::{Modes, modes};
    #[pymodule_export]
    use crate::plan::{Drive, Plan, Predicted, QuietResult, TargetResult, plan};
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
