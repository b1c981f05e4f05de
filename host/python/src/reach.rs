//! `reach`: what a panel's actuators can do at all, point by point.

use crate::arguments::{
    FourNumbers, GivenTolerance, accuracy_from_either_tolerance_or_time_limit_or_balanced as asked,
};
use crate::pickles::{Reduced, pickled, reduce_for_pickle};
use crate::request::check_zone_on_surface;
use crate::results::{read_only_array, read_only_array_of_shape, values_or_nan};
use crate::scene::PyScene;
use crate::tables::run_with_cached_plan_table_emitting_model_warnings;
use era_model::model::BarePanel;
use era_planner::TableOptions;
use era_planner::maps::ReachMaps;
use era_planner::table::PointView;
use era_planner::table::touched::TouchedPanel;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use std::borrow::Cow;

/// What can be had at every point, with a setting for every touch. Arrays are read-only; NaN is where there is no surface, and outside
/// the zone that was asked for.
#[pyclass(frozen, module = "era", get_all)]
pub struct Reach {
    /// The actuators' ids.
    actuators: Vec<String>,
    /// Columns in m, border to border: float64 [column].
    x_m: Py<PyArray1<f64>>,
    /// Rows in m, border to border: float64 [row].
    y_m: Py<PyArray1<f64>>,
    /// The strongest peak in g, of drives at distinct frequencies within all limits: float64 [row, column].
    strongest_g: Py<PyArray2<f64>>,
    /// The frequency of each actuator for it in Hz: float64 [actuator, row, column].
    strongest_hz: Py<PyArray3<f64>>,
    /// Contrast in dB of the drives that shake the rest least for a weak peak at the point: float64 [row, column].
    contrast_db: Py<PyArray2<f64>>,
    /// The frequency of each actuator for it in Hz: float64 [actuator, row, column].
    contrast_hz: Py<PyArray3<f64>>,
    /// Upper bounds on the error of `strongest_g`, relative to it, forces as they are: float64 [row, column]; NaN where there is none.
    error_bound: Py<PyArray2<f64>>,
}

pickled!(Reach { actuators, x_m, y_m, strongest_g, strongest_hz, contrast_db, contrast_hz, error_bound });

#[pymethods]
impl Reach {
    /// The least of `strongest_g` in g, and where that is in m.
    ///
    /// Returns
    /// -------
    /// (float, (float, float))
    #[pyo3(name = "weakest")]
    fn find_weakest_peak_g_and_point_m(&self, py: Python<'_>) -> PyResult<(f64, (f64, f64))> {
        use numpy::PyArrayMethods;
        let (values, x_m, y_m) = (self.strongest_g.bind(py), self.x_m.bind(py), self.y_m.bind(py));
        let (values, x_m, y_m) = (values.readonly(), x_m.readonly(), y_m.readonly());
        let places = values
            .as_array()
            .indexed_iter()
            .filter(|(_, value)| !value.is_nan())
            .map(|(at, value)| (*value, at))
            .collect::<Vec<_>>();
        let least = places.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        // There is a point: a zone without one was refused.
        let (value, (row, column)) = least.unwrap_or((f64::NAN, (0, 0)));
        Ok((value, (x_m.as_array()[column], y_m.as_array()[row])))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (least, (x_m, y_m)) = self.find_weakest_peak_g_and_point_m(py)?;
        let shape = self.strongest_g.bind(py).getattr("shape")?;
        Ok(format!("<Reach: {shape} (rows, columns), weakest place {least:.4} g at ({x_m}, {y_m}) m>"))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

/// What can be had at every point of the surface: the strongest peak, and the best contrast.
///
/// The same as `era field --reach`, bit for bit. With the scene's finger, where it has one, on each point while it is looked at: then there are no
/// contrasts (NaN), and of the weakest point alone an error bound.
///
/// Parameters
/// ----------
/// scene : Scene
/// zone_m : (float, float, float, float), optional
///     Opposite corners of a rectangle in m, x, y, x, y, instead of the whole surface; on a bar only x counts.
/// from_hz, to_hz : float, optional
///     Lowest and highest frequency in Hz, 40 and 400 unless given.
/// tolerance : float or {"fast", "balanced", "reference"}, optional
///     What the mesh is chosen for, relative: 1e-8 to 0.1, 1e-3 unless given.
///
/// Returns
/// -------
/// Reach
///
/// Raises
/// ------
/// RequestError
///     An argument is out of range, the zone has no point, the band too few frequencies, or the scene no actuator or more than four.
/// ModelError
///     The panel cannot be modelled, or no frequencies are usable.
///
/// Examples
/// --------
/// >>> import era
/// >>> found = era.reach(era.Scene.example("bar"), tolerance="fast")
/// >>> weakest_g, (x_m, y_m) = found.weakest()
/// >>> found.strongest_g.shape == (1, found.x_m.size), 0.0 < weakest_g < 100.0
/// (True, True)
#[pyfunction]
#[pyo3(name = "reach", signature = (scene, *, zone_m=None, from_hz=None, to_hz=None, tolerance=None))]
pub fn compute_strongest_peak_and_best_contrast_maps(
    py: Python<'_>,
    scene: &PyScene,
    zone_m: Option<FourNumbers>,
    from_hz: Option<f64>,
    to_hz: Option<f64>,
    tolerance: Option<GivenTolerance>,
) -> PyResult<Reach> {
    let scene = scene.shared_scene();
    let accuracy = asked(tolerance, None)?;
    let region = check_zone_on_surface(&scene, zone_m)?;
    let (maps, [x_m, y_m]) = run_with_cached_plan_table_emitting_model_warnings(py, &scene, accuracy, move |table| {
        let table = match (from_hz, to_hz) {
            (None, None) => Cow::Borrowed(table),
            _ => Cow::Owned(table.clone().restrict_to_band(from_hz, to_hz)?),
        };
        PointView::try_new(&table, region)?;
        let maps = match table.scene.finger {
            None => ReachMaps::compute(&table, region)?,
            Some(_) => {
                let options = TableOptions::default();
                let panel = BarePanel::build(&table.scene, accuracy, options.to_hz)?;
                ReachMaps::compute_with_finger_and_error_bound_of_weakest_point(
                    &table,
                    region,
                    TouchedPanel::new(&panel, &table.scene, &table),
                    accuracy,
                    options,
                )?
            }
        };
        Ok((maps, [table.grid.x_m.clone(), table.grid.y_m.clone()]))
    })?;
    let shape = [y_m.len(), x_m.len()];
    let by_actuator = |hz: &[Option<Vec<f64>>]| -> Vec<f64> {
        let of = |actuator: usize| hz.iter().map(move |hz| hz.as_ref().and_then(|hz| hz.get(actuator).copied()));
        values_or_nan((0..maps.actuators.len()).flat_map(of))
    };
    let shape_by_actuator = [maps.actuators.len(), shape[0], shape[1]];
    Ok(Reach {
        x_m: read_only_array(py, x_m),
        y_m: read_only_array(py, y_m),
        strongest_hz: read_only_array_of_shape(py, by_actuator(&maps.strongest_hz), shape_by_actuator)?,
        contrast_hz: read_only_array_of_shape(py, by_actuator(&maps.contrast_hz), shape_by_actuator)?,
        strongest_g: read_only_array_of_shape(py, values_or_nan(maps.strongest_g), shape)?,
        contrast_db: read_only_array_of_shape(py, values_or_nan(maps.contrast_db), shape)?,
        error_bound: read_only_array_of_shape(py, values_or_nan(maps.error_bound), shape)?,
        actuators: maps.actuators,
    })
}
