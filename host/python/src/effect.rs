//! `effect`: clicks, buzzes, pulses, textures for a place.

use crate::arguments::{GivenPlace, GivenTolerance, accuracy_from_either_tolerance_or_time_limit_or_balanced as asked};
use crate::errors::Raised;
use crate::pickles::{Reduced, pickled, reduce_for_pickle};
use crate::results::{parse_json_to_python, serialise_to_json};
use crate::scene::PyScene;
use crate::tables::run_with_table_touched_by_scene_finger;
use era_planner::click::ClickOptions;
use era_planner::effects::view::EffectView;
use era_planner::effects::{
    DesignError, EffectRequest, Intensity, NamedEffect, design_effect_of_windows_if_common_click_exists_else_of_drives,
    plan_request_with_intensity_for_targets_without_one,
};
use era_planner::rise::PanelPoles;
use era_planner::{PlanTable, Request, Target};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// An effect as the board would play it at a place, and what the panel would do.
#[pyclass(frozen, module = "era")]
pub struct Effect {
    /// Its name.
    #[pyo3(get)]
    name: String,
    /// The target in m.
    #[pyo3(get)]
    target_m: (f64, f64),
    /// What keeps it below what was asked for, as "voltage of left"; None if nothing does.
    #[pyo3(get)]
    limited_by: Option<String>,
    effect_json: String,
    plan_json: String,
}

pickled!(Effect { name, target_m, limited_by, effect_json, plan_json });

impl Effect {
    fn json_value_of_key<'py>(&self, py: Python<'py>, key: &str) -> PyResult<Bound<'py, PyAny>> {
        parse_json_to_python(py, &self.effect_json)?.get_item(key)
    }
}

#[pymethods]
impl Effect {
    /// What it should do at the target, as `era effect --json` prints it: a dict with `peak_g`, `peak_least_g`, `peak_most_g`, `peak_at_ms`,
    /// `quiet_ms`, `sound_db` and so on.
    #[getter(predicted)]
    fn prediction_as_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.json_value_of_key(py, "predicted")
    }

    /// What is played on each actuator, as `era effect --json` prints it: a list of dicts with `actuator`, `frequency_hz`, `voltage_v`, `segments`
    /// and so on.
    #[getter(drives)]
    fn drives_as_dicts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.json_value_of_key(py, "drives")
    }

    /// The windows of a click or a double click, as `era effect --json` prints them: a list of dicts with `actuator`, `electrode`, `begin_us`, `width_us` and
    /// `voltage_v`; an empty list for other effects.
    #[getter(windows)]
    fn windows_as_dicts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.json_value_of_key(py, "windows")
    }

    /// The effect as `era effect --json` prints it, with its plan in `plan`, lengths in mm.
    ///
    /// Returns
    /// -------
    /// dict
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let told = parse_json_to_python(py, &self.effect_json)?.cast_into::<PyDict>()?;
        told.set_item("plan", parse_json_to_python(py, &self.plan_json)?)?;
        Ok(told)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let peak_g: f64 = self.json_value_of_key(py, "predicted")?.get_item("peak_g")?.extract()?;
        let (x_m, y_m) = self.target_m;
        Ok(format!("<Effect {:?} at ({x_m}, {y_m}) m: peak {peak_g:.4} g>", self.name))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

/// An effect for a place: a click, a buzz, pulses, a texture, designed from the panel's own motion.
///
/// The same as `era effect`, bit for bit; with the scene's finger on the target, where it has one.
///
/// Parameters
/// ----------
/// scene : Scene
/// at_m : (float, float) or float
///     The target in m from the top left corner; on a bar x alone will do.
/// effect : {"click", "double_click", "buzz", "swell", "pulse_train", "texture"}
///     Which.
/// intensity_g : float, optional
///     Peak acceleration wanted in g, 0.5 unless given. What cannot be reached is designed as far as it goes.
/// intensity_db : float, optional
///     The same in dB above the threshold of feeling, -20 to 80.
/// duration_ms : float, optional
///     How long, in ms: buzz, swell, texture.
/// count : int, optional
///     How many pulses: pulse_train.
/// period_ms : float, optional
///     From one to the next, in ms: double_click, pulse_train, texture.
/// crisp_ms : float, optional
///     Longest time in ms until a click is below a tenth of its peak: 20 to 100, 45 unless given.
/// prefer : {"strength", "crispness"}, optional
///     What a click is where it cannot be both: as strong as was asked for, unless given.
/// tolerance : float or {"fast", "balanced", "reference"}, optional
///     What the mesh is chosen for, relative: 1e-8 to 0.1, 1e-3 unless given.
///
/// Returns
/// -------
/// Effect
///
/// Raises
/// ------
/// RequestError
///     An argument is out of range, the effect does not take it, or two do not go together.
/// ModelError
///     The panel cannot be modelled, no frequencies are usable, or a drive meets the resonance of an undamped mode.
///
/// Examples
/// --------
/// >>> import era
/// >>> found = era.effect(era.Scene.example("plate"), (0.1, 0.05), "click", 0.2)
/// >>> found.name, found.limited_by, found.predicted["peak_g"] > 0.1
/// ('click', None, True)
#[pyfunction]
#[pyo3(name = "effect", signature = (scene, at_m, effect, intensity_g=None, *, intensity_db=None, duration_ms=None, count=None, period_ms=None,
    crisp_ms=None, prefer=None, tolerance=None))]
#[expect(clippy::too_many_arguments, reason = "keywords, each with a default")]
pub fn design_effect_for_place(
    py: Python<'_>,
    scene: &PyScene,
    at_m: GivenPlace,
    effect: &str,
    intensity_g: Option<f64>,
    intensity_db: Option<f64>,
    duration_ms: Option<f64>,
    count: Option<u32>,
    period_ms: Option<f64>,
    crisp_ms: Option<f64>,
    prefer: Option<&str>,
    tolerance: Option<GivenTolerance>,
) -> PyResult<Effect> {
    let scene = scene.shared_scene();
    let accuracy = asked(tolerance, None)?;
    let (x_m, y_m) = at_m.check_place_on_surface_m(&scene, "at_m")?;
    let named: NamedEffect = serde_json::from_value(effect.into()).map_err(|_| {
        let allowed = "\"click\", \"double_click\", \"buzz\", \"swell\", \"pulse_train\" or \"texture\"";
        Raised::wrong_argument("effect", effect, allowed)
    })?;
    if let (Some(_), Some(intensity_db)) = (intensity_g, intensity_db) {
        return Err(Raised::wrong_argument("intensity_db", intensity_db, "None, because `intensity_g` is given").into());
    }
    let prefer = prefer.map(|prefer| {
        serde_json::from_value(prefer.into())
            .map_err(|_| Raised::wrong_argument("prefer", prefer, "\"strength\" or \"crispness\""))
    });
    let prefer = prefer.transpose()?;
    let request = EffectRequest { effect: named, duration_ms, count, period_ms, crisp_ms, prefer };
    request.build_envelope_or_plain_push_if_click().map_err(|error| Raised::from(DesignError::from(error)))?;
    let intensity = intensity_g.map(Intensity::G).or(intensity_db.map(Intensity::AboveThresholdDb));
    let target = Target { x_m, y_m, intensity_g };
    let design_with = move |table: &PlanTable| -> Result<Effect, Raised> {
        let rise = PanelPoles::find_poles_if_converged(&table.model).ok_or(DesignError::Unbounded)?;
        let plan = plan_request_with_intensity_for_targets_without_one(
            table,
            || Some(&rise),
            &Request::for_touch(&[target]),
            intensity,
        )?;
        let click = ClickOptions { with_best_possible: true, ..request.click_options() };
        let designed =
            design_effect_of_windows_if_common_click_exists_else_of_drives(table, &rise, &plan, request, click)?;
        Ok(Effect {
            name: named.name().to_owned(),
            target_m: plan.target_m.into(),
            limited_by: designed.limited_by.clone(),
            effect_json: serialise_to_json(&EffectView::new(&designed))?,
            plan_json: serialise_to_json(&plan)?,
        })
    };
    run_with_table_touched_by_scene_finger(py, &scene, accuracy, vec![(x_m, y_m)], design_with)
}
