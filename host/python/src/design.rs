//! `Design`: one design of a study, for optimisers that ask for points of their own.

use crate::pickles::{Reduced, pickled, reduce_for_pickle};
use crate::results::read_only_array;
use era_study::result::{constraint_names_and_signed_excesses_of_design, objective_names_and_losses_of_design};
use era_study::run::{DesignOutcome, DesignRow, Study};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// One design of a study: what it is, and what it is worth. Arrays are read-only.
#[pyclass(frozen, module = "era", get_all)]
pub struct Design {
    /// Where it is in the unit cube: float64 [dimension].
    point: Py<PyArray1<f64>>,
    /// The variables' values by the names of the table's columns: numbers, or the name of a choice.
    values: Py<PyDict>,
    /// The figures by the names of the table's columns; empty if it failed.
    figures: Py<PyDict>,
    /// Its figures that are wished for, in the order of `Study.objectives`: float64 [wish]. Less is better: what should be most has its sign changed.
    /// The worst of what may be off. NaN if it failed.
    objectives: Py<PyArray1<f64>>,
    /// By how much it is beyond each bound, in the figure's unit, in the order of `Study.constraints`: float64 [constraint]. It keeps those that are 0 or
    /// less. The worst of what may be off. NaN if it failed.
    constraints: Py<PyArray1<f64>>,
    /// Why it has no figures; None if it has.
    failed: Option<String>,
    /// The text of its scene's file; None if it is no scene.
    scene_text: Option<String>,
}

pickled!(Design { point, values, figures, objectives, constraints, failed, scene_text });

impl Design {
    /// Of a row of its study.
    pub fn from_row(py: Python<'_>, study: &Study, row: DesignRow) -> PyResult<Self> {
        let (values, figures) = (PyDict::new(py), PyDict::new(py));
        for column in study.space.table_columns() {
            match &column.words {
                Some(_) => values.set_item(&column.name, column.text_in_design_unless_scene_value_kept(&row.design))?,
                None => values.set_item(
                    &column.name,
                    column.number_or_choice_index_in_design_unless_scene_value_kept(&row.design),
                )?,
            }
        }
        if let Some(found) = row.figures_unless_failed() {
            for (wanted, value) in study.figures.iter().zip(&found.values) {
                figures.set_item(wanted.column_name(), value)?;
            }
        }
        let numbers =
            |told: Vec<(String, f64)>| read_only_array(py, told.into_iter().map(|(_, value)| value).collect());
        let failed = match &row.outcome {
            DesignOutcome::Found { .. } => None,
            DesignOutcome::Failed(reason) => Some(reason.clone()),
        };
        Ok(Self {
            values: values.unbind(),
            figures: figures.unbind(),
            objectives: numbers(objective_names_and_losses_of_design(study, &row)),
            constraints: numbers(constraint_names_and_signed_excesses_of_design(study, &row)),
            failed,
            scene_text: study.space.design_as_scene_text(&row.design).ok(),
            point: read_only_array(py, row.point),
        })
    }
}

#[pymethods]
impl Design {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        match &self.failed {
            Some(reason) => Ok(format!("<Design {}: failed: {reason}>", self.values.bind(py).repr()?)),
            None => Ok(format!("<Design {}: {}>", self.values.bind(py).repr()?, self.figures.bind(py).repr()?)),
        }
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}
