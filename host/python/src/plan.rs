//! `plan`: drives for a touch, or for several.

use crate::arguments::{
    FourNumbers, GivenPlace, GivenTarget, GivenTolerance,
    accuracy_from_either_tolerance_or_time_limit_or_balanced as asked,
};
use crate::errors::Raised;
use crate::pickles::{Reduced, pickled, reduce_for_pickle};
use crate::request::PlanArguments;
use crate::results::{ToleranceVerdict, parse_json_to_python, serialise_to_json};
use crate::scene::PyScene;
use crate::tables::{run_with_cached_plan_table_emitting_model_warnings, run_with_table_touched_by_scene_finger};
use era_model::model::Bound as ErrorBound;
use era_planner::effects::set_missing_target_peaks_from_level_if_given;
use era_planner::{Objective, Plan as Found, PlanTable};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// An actuator's drive.
#[pyclass(frozen, module = "era", get_all)]
pub struct Drive {
    /// The actuator's id.
    actuator: String,
    /// Fundamental of its force in Hz.
    frequency_hz: f64,
    /// Electrode voltage in V.
    voltage_v: f64,
    /// Part of its half period for which an electrode is on.
    pulse_width: f64,
    /// Phase of its windows in rad.
    phase_rad: f64,
    /// Phase in rad of the fundamental of its force, which lags behind the windows of electrodes that charge through resistors.
    force_phase_rad: f64,
    /// Amplitude of the force's fundamental in N, the mass at rest.
    force_n: f64,
}

pickled!(Drive { actuator, frequency_hz, voltage_v, pulse_width, phase_rad, force_phase_rad, force_n });

#[pymethods]
impl Drive {
    fn __repr__(&self) -> String {
        format!(
            "<Drive {}: {:.2} Hz, {:.1} V, pulse width {:.3}, {:.4} N>",
            self.actuator, self.frequency_hz, self.voltage_v, self.pulse_width, self.force_n
        )
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

impl Drive {
    /// Of the planner's.
    pub fn from_planned_drive(drive: &era_planner::Drive) -> Self {
        Self {
            actuator: drive.actuator.clone(),
            frequency_hz: drive.frequency_hz,
            voltage_v: drive.voltage_v,
            pulse_width: drive.pulse_width,
            phase_rad: drive.phase_rad,
            force_phase_rad: drive.force_phase_rad,
            force_n: drive.force_n,
        }
    }
}

/// What a plan should do.
#[pyclass(frozen, module = "era", get_all)]
pub struct Predicted {
    /// Peak acceleration at the (first) target in g: the drives' amplitudes added up, forces those of masses at rest.
    target_peak_g: f64,
    /// Mean over the rest of the surface of the peak acceleration in g.
    mean_elsewhere_g: f64,
    /// 10 log10 of the mean square acceleration within 10 mm of the targets over that of the rest.
    contrast_db: f64,
    /// The peak with forces as they become when the masses move, in g.
    softened_peak_g: f64,
    /// How far the target's peak is above the threshold of feeling in dB; None where nothing moves.
    above_threshold_db: Option<f64>,
}

pickled!(Predicted { target_peak_g, mean_elsewhere_g, contrast_db, softened_peak_g, above_threshold_db });

#[pymethods]
impl Predicted {
    fn __repr__(&self) -> String {
        format!("<Predicted: {:.4} g at the target, contrast {:.2} dB>", self.target_peak_g, self.contrast_db)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

/// A target's share of a plan.
#[pyclass(frozen, module = "era", get_all)]
pub struct TargetResult {
    /// In m.
    x_m: f64,
    /// In m.
    y_m: f64,
    /// Peak wanted in g.
    wanted_g: f64,
    /// Peak predicted in g.
    peak_g: f64,
}

pickled!(TargetResult { x_m, y_m, wanted_g, peak_g });

#[pymethods]
impl TargetResult {
    fn __repr__(&self) -> String {
        format!("<TargetResult at ({}, {}) m: {:.4} of {:.4} g>", self.x_m, self.y_m, self.peak_g, self.wanted_g)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

/// A quiet zone of a plan.
#[pyclass(frozen, module = "era", get_all)]
pub struct QuietResult {
    /// In m.
    x_m: f64,
    /// In m.
    y_m: f64,
    /// In m.
    radius_m: f64,
    /// Allowed, in g.
    at_most_g: f64,
    /// Largest peak in it, in g.
    peak_g: f64,
    /// Most that odd harmonics up to 1 kHz add to that, in g.
    harmonics_g: f64,
}

pickled!(QuietResult { x_m, y_m, radius_m, at_most_g, peak_g, harmonics_g });

#[pymethods]
impl QuietResult {
    fn __repr__(&self) -> String {
        format!(
            "<QuietResult at ({}, {}) m: peak {:.4} g, allowed {:.4} g>",
            self.x_m, self.y_m, self.peak_g, self.at_most_g
        )
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

/// The drives for a touch, with what they should do.
#[pyclass(frozen, module = "era")]
pub struct Plan {
    /// The (first) target in m.
    #[pyo3(get)]
    target_m: (f64, f64),
    /// All targets with what they get.
    #[pyo3(get)]
    targets: Vec<Py<TargetResult>>,
    /// The quiet zones with what is left in them.
    #[pyo3(get)]
    quiet: Vec<Py<QuietResult>>,
    /// One for each actuator, in the scene's order.
    #[pyo3(get)]
    drives: Vec<Py<Drive>>,
    /// What it should do.
    #[pyo3(get)]
    predicted: Py<Predicted>,
    /// What keeps the intensity below what was asked for, as "voltage of left"; None if nothing does.
    #[pyo3(get)]
    limited_by: Option<String>,
    /// Upper bound on the error of `predicted.target_peak_g`, relative to it; None where there is none.
    #[pyo3(get)]
    error_bound: Option<f64>,
    /// What was asked for of the bound.
    #[pyo3(get)]
    tolerance: Option<f64>,
    /// Whether the bound is within it; None where there is no bound.
    #[pyo3(get)]
    tolerance_met: Option<bool>,
    /// By which part of its cost, or of its reach where the wishes are not met, another combination of the grid's frequencies could be
    /// better at most: 0 where the plan is proven to be the best.
    #[pyo3(get)]
    optimality_gap: f64,
    /// What the getters below read.
    details_json: String,
    trade_json: String,
    explanation_json: String,
    plan_json: String,
}

pickled!(Plan {
    target_m,
    targets,
    quiet,
    drives,
    predicted,
    limited_by,
    error_bound,
    tolerance,
    tolerance_met,
    optimality_gap,
    details_json,
    trade_json,
    explanation_json,
    plan_json,
});

impl Plan {
    fn new(py: Python<'_>, found: &Found, asked: ToleranceVerdict, told: [String; 3]) -> PyResult<Self> {
        let target = |own: &era_planner::TargetResult| {
            Py::new(py, TargetResult { x_m: own.x_m, y_m: own.y_m, wanted_g: own.wanted_g, peak_g: own.peak_g })
        };
        let quiet = |own: &era_planner::QuietResult| {
            let (x_m, y_m, radius_m) = (own.x_m, own.y_m, own.radius_m);
            let (at_most_g, peak_g, harmonics_g) = (own.at_most_g, own.peak_g, own.harmonics_g);
            Py::new(py, QuietResult { x_m, y_m, radius_m, at_most_g, peak_g, harmonics_g })
        };
        let predicted = found.predicted;
        let predicted = Predicted {
            target_peak_g: predicted.target_peak_g,
            mean_elsewhere_g: predicted.mean_elsewhere_g,
            contrast_db: predicted.contrast_db,
            softened_peak_g: predicted.softened_peak_g,
            above_threshold_db: predicted.above_threshold_db,
        };
        let [details_json, trade_json, explanation_json] = told;
        Ok(Self {
            target_m: found.target_m.into(),
            targets: found.targets.iter().map(target).collect::<PyResult<_>>()?,
            quiet: found.quiet.iter().map(quiet).collect::<PyResult<_>>()?,
            drives: found
                .drives
                .iter()
                .map(|drive| Py::new(py, Drive::from_planned_drive(drive)))
                .collect::<PyResult<_>>()?,
            predicted: Py::new(py, predicted)?,
            limited_by: found.limited_by.clone(),
            error_bound: found.error_bound,
            tolerance: asked.tolerance,
            tolerance_met: asked.is_met,
            optimality_gap: found.optimality_gap,
            details_json,
            trade_json,
            explanation_json,
            plan_json: serialise_to_json(found)?,
        })
    }
}

#[pymethods]
impl Plan {
    /// What is told besides: peak of the whole waveform, harmonics, when it is there and gone.
    #[getter(details)]
    fn harmonics_and_timing_report_as_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        parse_json_to_python(py, &self.details_json)
    }

    /// What can be had of wishes that cannot all be had; None where there is nothing to choose.
    #[getter(trade)]
    fn trade_off_as_dict_or_none<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        parse_json_to_python(py, &self.trade_json)
    }

    /// With `explain=True` why it is what it is: candidates, pulse widths, alternatives; None otherwise.
    #[getter(explanation)]
    fn explanation_as_dict_if_asked_for<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        parse_json_to_python(py, &self.explanation_json)
    }

    /// The plan as `era plan --json` prints it, lengths in mm.
    ///
    /// Returns
    /// -------
    /// dict
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        Ok(parse_json_to_python(py, &self.plan_json)?.cast_into::<PyDict>()?)
    }

    fn __repr__(&self) -> String {
        let drives: Vec<String> = self
            .drives
            .iter()
            .map(|drive| format!("{} {:.1} Hz", drive.get().actuator, drive.get().frequency_hz))
            .collect();
        let ((x_m, y_m), predicted) = (self.target_m, self.predicted.get());
        format!(
            "<Plan at ({x_m}, {y_m}) m: {}; {:.4} g, contrast {:.2} dB>",
            drives.join(", "),
            predicted.target_peak_g,
            predicted.contrast_db
        )
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

/// The drives for a touch: who vibrates at what frequency, how strong, and what should be felt.
///
/// The same as `era plan`, bit for bit; with the scene's finger on the targets, where it has one and the objective is not "reach".
/// Tables of the last panels are kept in memory, so that a second plan takes some ms.
///
/// Parameters
/// ----------
/// scene : Scene
/// at_m : (float, float) or float
///     The target in m from the top left corner; on a bar x alone will do.
/// intensity_g : float, optional
///     Peak acceleration wanted in g, 0.5 unless given. What cannot be reached is planned as far as it goes.
/// intensity_db : float, optional
///     The same in dB above the threshold of feeling, -20 to 80; for targets of `also` without a peak of their own as well.
/// also : sequence of (float, float) or (float, float, float), optional
///     Other targets in m, each with a peak in g of its own or without.
/// quiet : sequence of (float, float, float, float), optional
///     Places to be spared: x, y, radius in m, most peak acceleration there in g.
/// objective : {"contrast", "reach", "power"}
///     What is made least, or most.
/// grouping : {"distinct", "shared"}
///     Whether all actuators share a frequency.
/// weigh : {"equal", "felt"}
///     How accelerations of different frequencies count.
/// zone_m : (float, float, float, float), optional
///     For "reach": opposite corners of a rectangle in m, x, y, x, y, instead of the whole surface.
/// explain : bool, default False
///     Say why, in `explanation`; takes several plans.
/// tolerance : float or {"fast", "balanced", "reference"}, optional
///     What the mesh is chosen for, relative: 1e-8 to 0.1, 1e-3 unless given.
///
/// Returns
/// -------
/// Plan
///
/// Raises
/// ------
/// RequestError
///     An argument is out of range, does not go with another, or the scene has no actuator or more than four.
/// ModelError
///     The panel cannot be modelled, or no frequencies are usable.
///
/// Warns
/// -----
/// ModelWarning
///     The panel is too thick for thin-plate theory, or its gaps do not bear its press.
///
/// Examples
/// --------
/// >>> import era
/// >>> found = era.plan(era.Scene.example("plate"), (0.1, 0.05), intensity_g=0.3)
/// >>> [drive.actuator for drive in found.drives], found.limited_by
/// (['left', 'right'], None)
/// >>> abs(found.predicted.target_peak_g - 0.3) < 1e-6, found.optimality_gap
/// (True, 0.0)
#[pyfunction]
#[pyo3(name = "plan", signature = (scene, at_m, intensity_g=None, *, intensity_db=None, also=Vec::new(), quiet=Vec::new(),
    objective="contrast".into(), grouping="distinct".into(), weigh="equal".into(), zone_m=None, explain=false,
    tolerance=None),
    text_signature = "(scene, at_m, intensity_g=None, *, intensity_db=None, also=(), quiet=(), objective='contrast', \
    grouping='distinct', weigh='equal', zone_m=None, explain=False, tolerance=None)")]
#[expect(clippy::too_many_arguments, reason = "keywords, each with a default")]
pub fn plan_touch(
    py: Python<'_>,
    scene: &PyScene,
    at_m: GivenPlace,
    intensity_g: Option<f64>,
    intensity_db: Option<f64>,
    also: Vec<GivenTarget>,
    quiet: Vec<FourNumbers>,
    objective: String,
    grouping: String,
    weigh: String,
    zone_m: Option<FourNumbers>,
    explain: bool,
    tolerance: Option<GivenTolerance>,
) -> PyResult<Plan> {
    let scene = scene.shared_scene();
    let accuracy = asked(tolerance, None)?;
    let wishes = PlanArguments { at_m, intensity_g, also, quiet, objective, grouping, weigh, zone_m };
    let request = wishes.build_plan_request(&scene)?;
    // One setting for touches of any place is of the panel that nothing touches.
    let is_anywhere = request.objective == Objective::Reach;
    let places: Vec<(f64, f64)> = request.targets.iter().map(|target| (target.x_m, target.y_m)).collect();
    let plan_with = move |table: &PlanTable| -> Result<(Found, ToleranceVerdict, [String; 3]), Raised> {
        let request = set_missing_target_peaks_from_level_if_given(table, request, intensity_db)?;
        let (planned, trade) = era_planner::trade::plan_and_improve_by_exploring_trade_offs(table, &request)?;
        let report = era_planner::report::build_harmonics_and_timing_report_at_first_target(table, &planned);
        let explanation = explain.then(|| era_planner::explain::explain_plan(table, &request)).transpose()?;
        let found = planned.plan;
        let bound = found.error_bound.map_or(ErrorBound::Unknown("no drive moves the target"), ErrorBound::AtMost);
        let told = [serialise_to_json(&report)?, serialise_to_json(&trade)?, serialise_to_json(&explanation)?];
        Ok((found, ToleranceVerdict::check_whether_bounds_meet_tolerance(&[bound], accuracy), told))
    };
    let (found, asked, told) = if is_anywhere {
        run_with_cached_plan_table_emitting_model_warnings(py, &scene, accuracy, plan_with)?
    } else {
        run_with_table_touched_by_scene_finger(py, &scene, accuracy, places, plan_with)?
    };
    Plan::new(py, &found, asked, told)
}
