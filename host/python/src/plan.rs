//! `plan`: drives for a touch, or for several.

use crate::arguments::{Place, Tolerance, accuracy as asked};
use crate::errors::Raised;
use crate::request::{Also, Corners, Spared, Wishes};
use crate::results::{Asked, from_json};
use crate::scene::PyScene;
use crate::tables::{with_table, with_touched_table};
use era_model::model::Bound as ErrorBound;
use era_planner::effects::at_level;
use era_planner::explain::Explanation;
use era_planner::trade::Trade;
use era_planner::{Objective, Plan as Found, PlanTable, Report};
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
    /// Phase of its force in rad.
    phase_rad: f64,
    /// Amplitude of the force's fundamental in N, the mass at rest.
    force_n: f64,
}

#[pymethods]
impl Drive {
    fn __repr__(&self) -> String {
        format!(
            "<Drive {}: {:.2} Hz, {:.1} V, pulse width {:.3}, {:.4} N>",
            self.actuator, self.frequency_hz, self.voltage_v, self.pulse_width, self.force_n
        )
    }
}

impl Drive {
    /// Of the planner's.
    pub fn of(drive: &era_planner::Drive) -> Self {
        Self {
            actuator: drive.actuator.clone(),
            frequency_hz: drive.frequency_hz,
            voltage_v: drive.voltage_v,
            pulse_width: drive.pulse_width,
            phase_rad: drive.phase_rad,
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

#[pymethods]
impl Predicted {
    fn __repr__(&self) -> String {
        format!("<Predicted: {:.4} g at the target, contrast {:.2} dB>", self.target_peak_g, self.contrast_db)
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

#[pymethods]
impl TargetResult {
    fn __repr__(&self) -> String {
        format!("<TargetResult at ({}, {}) m: {:.4} of {:.4} g>", self.x_m, self.y_m, self.peak_g, self.wanted_g)
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

#[pymethods]
impl QuietResult {
    fn __repr__(&self) -> String {
        format!("<QuietResult at ({}, {}) m: {:.4} of {:.4} g>", self.x_m, self.y_m, self.peak_g, self.at_most_g)
    }
}

/// The drives for a touch, with what they should do.
#[pyclass(frozen, module = "era")]
pub struct Plan {
    found: Found,
    report: Report,
    trade: Option<Trade>,
    explanation: Option<Explanation>,
    asked: Asked,
}

#[pymethods]
impl Plan {
    /// The (first) target in m.
    #[getter]
    fn target_m(&self) -> (f64, f64) {
        self.found.target_m.into()
    }

    /// All targets with what they get.
    #[getter]
    fn targets(&self) -> Vec<TargetResult> {
        let of = |target: &era_planner::TargetResult| TargetResult {
            x_m: target.x_m,
            y_m: target.y_m,
            wanted_g: target.wanted_g,
            peak_g: target.peak_g,
        };
        self.found.targets.iter().map(of).collect()
    }

    /// The quiet zones with what is left in them.
    #[getter]
    fn quiet(&self) -> Vec<QuietResult> {
        let of = |zone: &era_planner::QuietResult| QuietResult {
            x_m: zone.x_m,
            y_m: zone.y_m,
            radius_m: zone.radius_m,
            at_most_g: zone.at_most_g,
            peak_g: zone.peak_g,
            harmonics_g: zone.harmonics_g,
        };
        self.found.quiet.iter().map(of).collect()
    }

    /// One for each actuator, in the scene's order.
    #[getter]
    fn drives(&self) -> Vec<Drive> {
        self.found.drives.iter().map(Drive::of).collect()
    }

    /// What it should do.
    #[getter]
    fn predicted(&self) -> Predicted {
        let predicted = self.found.predicted;
        Predicted {
            target_peak_g: predicted.target_peak_g,
            mean_elsewhere_g: predicted.mean_elsewhere_g,
            contrast_db: predicted.contrast_db,
            softened_peak_g: predicted.softened_peak_g,
            above_threshold_db: predicted.above_threshold_db,
        }
    }

    /// What keeps the intensity below what was asked for, as "voltage of left"; None if nothing does.
    #[getter]
    fn limited_by(&self) -> Option<&str> {
        self.found.limited_by.as_deref()
    }

    /// Upper bound on the error of `predicted.target_peak_g`, relative to it; None where there is none.
    #[getter]
    fn error_bound(&self) -> Option<f64> {
        self.found.error_bound
    }

    /// What was asked for of the bound.
    #[getter]
    fn tolerance(&self) -> Option<f64> {
        self.asked.tolerance
    }

    /// Whether the bound is within it; None where there is no bound.
    #[getter]
    fn tolerance_met(&self) -> Option<bool> {
        self.asked.is_met
    }

    /// By which part of its cost, or of its reach where the wishes are not met, another combination of the grid's frequencies could be
    /// better at most: 0 where the plan is proven to be the best.
    #[getter]
    fn optimality_gap(&self) -> f64 {
        self.found.optimality_gap
    }

    /// What is told besides: peak of the whole waveform, harmonics, when it is there and gone.
    #[getter]
    fn details<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &self.report)
    }

    /// What can be had of wishes that cannot all be had; None where there is nothing to choose.
    #[getter]
    fn trade<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &self.trade)
    }

    /// With `explain=True` why it is what it is: candidates, pulse widths, alternatives; None otherwise.
    #[getter]
    fn explanation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &self.explanation)
    }

    /// The plan as `era plan --json` prints it, lengths in mm.
    ///
    /// Returns
    /// -------
    /// dict
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        Ok(from_json(py, &self.found)?.cast_into::<PyDict>()?)
    }

    fn __repr__(&self) -> String {
        let drives: Vec<String> =
            self.found.drives.iter().map(|drive| format!("{} {:.1} Hz", drive.actuator, drive.frequency_hz)).collect();
        let ([x_m, y_m], predicted) = (self.found.target_m, self.found.predicted);
        format!(
            "<Plan at ({x_m}, {y_m}) m: {}; {:.4} g, contrast {:.2} dB>",
            drives.join(", "),
            predicted.target_peak_g,
            predicted.contrast_db
        )
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
#[pyo3(signature = (scene, at_m, intensity_g=None, *, intensity_db=None, also=Vec::new(), quiet=Vec::new(),
    objective="contrast".into(), grouping="distinct".into(), weigh="equal".into(), zone_m=None, explain=false,
    tolerance=None),
    text_signature = "(scene, at_m, intensity_g=None, *, intensity_db=None, also=(), quiet=(), objective='contrast', \
    grouping='distinct', weigh='equal', zone_m=None, explain=False, tolerance=None)")]
#[expect(clippy::too_many_arguments, reason = "keywords, each with a default")]
pub fn plan(
    py: Python<'_>,
    scene: &PyScene,
    at_m: Place,
    intensity_g: Option<f64>,
    intensity_db: Option<f64>,
    also: Vec<Also>,
    quiet: Vec<Spared>,
    objective: String,
    grouping: String,
    weigh: String,
    zone_m: Option<Corners>,
    explain: bool,
    tolerance: Option<Tolerance>,
) -> PyResult<Plan> {
    let scene = scene.scene();
    let accuracy = asked(tolerance, None)?;
    let wishes = Wishes { at_m, intensity_g, also, quiet, objective, grouping, weigh, zone_m };
    let request = wishes.request(&scene)?;
    // One setting for touches of any place is of the panel that nothing touches.
    let is_anywhere = request.objective == Objective::Reach;
    let places: Vec<(f64, f64)> = request.targets.iter().map(|target| (target.x_m, target.y_m)).collect();
    let plan_with = move |table: &PlanTable| -> Result<Plan, Raised> {
        let request = at_level(table, request, intensity_db)?;
        let (planned, trade) = table.planned_with_trade(&request)?;
        let report = table.report(&planned);
        let explanation = explain.then(|| table.explain(&request)).transpose()?;
        let found = planned.plan;
        let bound = found.error_bound.map_or(ErrorBound::Unknown("nothing moves at the target"), ErrorBound::AtMost);
        Ok(Plan { asked: Asked::of(&[bound], accuracy), found, report, trade, explanation })
    };
    if is_anywhere {
        with_table(py, &scene, accuracy, plan_with)
    } else {
        with_touched_table(py, &scene, accuracy, places, plan_with)
    }
}
