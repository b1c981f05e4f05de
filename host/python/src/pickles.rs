//! Results go to other processes, and into files, by pickle: each is taken apart into a dict of its fields, and made of one again.

use pyo3::PyClass;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The function of the compiled part that makes results of their fields.
const RESTORE: &str = "_restore";

/// A result as its fields.
pub trait PickledFields: PyClass + Sized {
    /// The fields by their names.
    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>>;

    /// The result that has these fields.
    fn from_fields(fields: &Bound<'_, PyDict>) -> PyResult<Self>;
}

/// Implements [`PickledFields`] for a result, with all fields that it has (the compiler sees one that is left out).
macro_rules! pickled {
    ($result:ident { $($field:ident),+ $(,)? }) => {
        impl $crate::pickles::PickledFields for $result {
            fn fields<'py>(
                &self,
                py: pyo3::Python<'py>,
            ) -> pyo3::PyResult<pyo3::Bound<'py, pyo3::types::PyDict>> {
                use pyo3::types::PyDictMethods;
                let fields = pyo3::types::PyDict::new(py);
                $(fields.set_item(stringify!($field), &self.$field)?;)+
                Ok(fields)
            }

            fn from_fields(fields: &pyo3::Bound<'_, pyo3::types::PyDict>) -> pyo3::PyResult<Self> {
                use pyo3::types::PyAnyMethods;
                Ok(Self { $($field: fields.as_any().get_item(stringify!($field))?.extract()?),+ })
            }
        }
    };
}
pub(crate) use pickled;

/// What pickle is told: the function that makes the result again, and what that takes.
pub type Reduced<'py> = (Bound<'py, PyAny>, (String, Bound<'py, PyDict>));

/// A result taken apart.
pub fn reduce_for_pickle<'py, T: PickledFields>(py: Python<'py>, result: &T) -> PyResult<Reduced<'py>> {
    let restore = py.import("era._era")?.getattr(RESTORE)?;
    Ok((restore, (T::type_object(py).name()?.to_string(), result.fields(py)?)))
}

/// A result of its fields. Arrays are locked again: pickle makes them anew, and forgets that.
pub fn restore_from_fields_making_arrays_read_only<'py, T>(
    py: Python<'py>,
    fields: &Bound<'py, PyDict>,
) -> PyResult<Py<PyAny>>
where
    T: PickledFields + Into<PyClassInitializer<T>>,
{
    for value in fields.values() {
        if value.hasattr("setflags")? {
            value.call_method1("setflags", (false,))?;
        }
    }
    let wrong = |error: PyErr| {
        let wrong = PyValueError::new_err("the pickle was not made by this version of era");
        wrong.set_cause(py, Some(error));
        wrong
    };
    let result = T::from_fields(fields).map_err(wrong)?;
    Ok(Py::new(py, result)?.into_any())
}
