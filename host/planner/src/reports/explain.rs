//! Why a plan is what it is, and what something else would give.

use crate::choose::candidates::Formulation;
use crate::model::levels::ReducedLevels;
use crate::model::{Accuracy, ModelError};
use crate::physics::charging::PeriodicCharging;
use crate::plan::{Plan, clamped_contrast_db};
use crate::request::{Grouping, Objective, PlanError, Request};
use crate::response::ResponseError;
use crate::scene::{MAX_ACTUATORS, SurfaceKind};
use crate::table::{PlanTable, TableOptions, acceleration_at_point_from_coordinates};
use crate::{HIGHEST_FELT_HZ, STANDARD_GRAVITY};
use serde::Serialize;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// Frequencies told of each actuator.
const PRINTED_CANDIDATES: usize = 4;
/// Pulse widths compared.
const WIDTHS: [f64; 4] = [0.5, 2.0 / 3.0, 0.8, 0.9];
/// Harmonics below this are rounding: a pulse width of 2/3 has no third one, and what is computed of it is -330 dB.
pub const LEAST_HARMONICS_DB: f64 = -180.0;
/// Places along each side at which one more actuator is tried.
const PLACES: [f64; 3] = [1.0 / 6.0, 0.5, 5.0 / 6.0];

/// A frequency that an actuator might have had.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Frequency {
    /// In Hz.
    pub frequency_hz: f64,
    /// Contrast in dB if it alone vibrated, harmonics included.
    pub contrast_db: f64,
    /// What it alone reaches at the target, in g.
    pub reach_g: f64,
    /// What limits it there.
    pub limit: &'static str,
    /// Whether the plan has it, or one nearer than a step of the grid.
    pub chosen: bool,
}

/// Of one actuator.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Candidates {
    /// Its `id`.
    pub actuator: String,
    /// Its most efficient frequencies, one per maximum of contrast over frequency, best first.
    pub frequencies: Vec<Frequency>,
}

/// What another choice would give.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Alternative {
    /// What is changed.
    pub change: String,
    /// Peak at the target in g.
    pub target_peak_g: f64,
    /// Contrast in dB.
    pub contrast_db: f64,
    /// Electrical power of all drives in mW.
    pub power_mw: f64,
    /// What limits it.
    pub limited_by: Option<String>,
    /// Of the objective reach: the least peak anywhere on the surface in g, which that objective makes as large as can be; the target's own
    /// peak is none of its goals.
    pub weakest_g: Option<f64>,
}

/// What a pulse width makes of the forces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PulseWidth {
    /// Part of its half period for which an electrode is on.
    pub pulse_width: f64,
    /// Fundamental's force over that of a full-width pulse at the same voltage of electrodes that charge at once: the mean over the drives.
    pub force: f64,
    /// Mean square over the surface of all drives' odd harmonics up to 1 kHz over that of their fundamentals, in dB; `null` below
    /// [`LEAST_HARMONICS_DB`]: there are none.
    pub harmonics_db: Option<f64>,
}

/// The whole of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Explanation {
    /// What each actuator had to choose from.
    pub candidates: Vec<Candidates>,
    /// What the plan's frequencies would do with other pulse widths.
    pub pulse_widths: Vec<PulseWidth>,
    /// Other objectives, groupings, one more actuator; the plan itself first.
    pub alternatives: Vec<Alternative>,
}

/// Why there is no explanation.
#[derive(Debug, thiserror::Error)]
pub enum ExplainError {
    /// No plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// No model of the panel with one more actuator.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// No response of it.
    #[error(transparent)]
    Response(#[from] ResponseError),
}

/// Explains the plan of a request: candidates, pulse widths and alternatives.
///
/// # Errors
/// [`ExplainError`].
pub fn explain_plan(table: &PlanTable, request: &Request) -> Result<Explanation, ExplainError> {
    let planned = table.plan_with_details(request)?;
    let formulation = Formulation::new(table, request);
    let plan = &planned.plan;
    let candidates =
        (0..table.entries.len()).map(|i| list_frequencies_of_largest_contrast(table, &formulation, plan, i)).collect();
    let pulse_widths =
        WIDTHS.iter().map(|width| evaluate_force_and_harmonics_of_pulse_width(table, plan, *width)).collect();
    let mut alternatives = vec![summarize_plan_as_alternative(table, "this plan".into(), &formulation, plan)];
    let mut add = |change: &str, request: Request| match table.plan_request(&request) {
        Ok(plan) => alternatives.push(summarize_plan_as_alternative(table, change.into(), &formulation, &plan)),
        // What does not go together is no alternative.
        Err(PlanError::Together { .. }) => {}
        Err(error) => alternatives.push(Alternative {
            change: format!("{change}: {error}"),
            target_peak_g: 0.0,
            contrast_db: 0.0,
            power_mw: 0.0,
            limited_by: None,
            weakest_g: None,
        }),
    };
    for objective in Objective::ALL.into_iter().filter(|objective| *objective != request.objective) {
        let name = format!("objective {}", objective.name());
        add(&name, Request { objective, grouping: Grouping::Distinct, ..request.clone() });
    }
    for (name, grouping) in
        [("distinct frequencies", Grouping::Distinct), ("one shared frequency, with phases", Grouping::Shared)]
    {
        if grouping != request.grouping && table.entries.len() > 1 {
            add(name, Request { grouping, objective: Objective::Contrast, ..request.clone() });
        }
    }
    if let Some(more) = describe_best_added_actuator_if_channel_left(table, request)? {
        alternatives.push(more);
    }
    Ok(Explanation { candidates, pulse_widths, alternatives })
}

/// The frequencies at which the contrast of an actuator alone has a maximum, best first.
fn list_frequencies_of_largest_contrast(
    table: &PlanTable,
    formulation: &Formulation<'_>,
    plan: &Plan,
    actuator: usize,
) -> Candidates {
    let step_hz = table.frequencies_hz.get(1).zip(table.frequencies_hz.first()).map_or(0.0, |(b, a)| b - a);
    let chosen_hz = plan.drives.get(actuator).map_or(f64::NAN, |drive| drive.frequency_hz);
    let contrast = |k: usize| -> Option<f64> {
        let entry = table.entry(actuator, k)?;
        let near = formulation.zone.mean_square_over_zone(&entry.acceleration);
        Some(clamped_contrast_db(
            near,
            formulation.mean_square_elsewhere_with_harmonics_per_n2(entry, &entry.widths[0]),
        ))
    };
    let values: Vec<Option<f64>> = (0..table.frequencies_hz.len()).map(contrast).collect();
    let is_peak = |k: usize| {
        let beside = |k: Option<usize>| k.and_then(|k| values.get(k).copied().flatten());
        values[k].is_some_and(|own| {
            let lower = |other: Option<f64>| other.is_none_or(|other| other <= own);
            lower(beside(k.checked_sub(1))) && lower(beside(k.checked_add(1)))
        })
    };
    let mut frequencies: Vec<Frequency> = (0..values.len())
        .filter(|k| is_peak(*k) || (table.frequencies_hz[*k] - chosen_hz).abs() <= 0.5 * step_hz)
        .filter_map(|k| {
            let entry = table.entry(actuator, k)?;
            let shape = formulation.zone.targets.first()?;
            Some(Frequency {
                frequency_hz: table.frequencies_hz[k],
                contrast_db: values[k]?,
                reach_g: acceleration_at_point_from_coordinates(shape, &entry.acceleration).norm() * entry.max_force_n
                    / STANDARD_GRAVITY,
                limit: entry.limit.name(),
                chosen: (table.frequencies_hz[k] - chosen_hz).abs() <= step_hz,
            })
        })
        .collect();
    frequencies.sort_by(|a, b| b.contrast_db.total_cmp(&a.contrast_db));
    // The chosen one is told whatever its rank.
    let rest = frequencies.split_off(frequencies.len().min(PRINTED_CANDIDATES));
    if !frequencies.iter().any(|frequency| frequency.chosen) {
        frequencies.extend(rest.into_iter().find(|frequency| frequency.chosen));
    }
    let id = table.scene.actuators.get(actuator).map_or_else(String::new, |actuator| actuator.id.clone());
    Candidates { actuator: id, frequencies }
}

/// The effect of a pulse width on force and harmonics of a plan.
fn evaluate_force_and_harmonics_of_pulse_width(table: &PlanTable, plan: &Plan, pulse_width: f64) -> PulseWidth {
    let solver = crate::response::CoordinateSolver::new(&table.model);
    let (mut fundamental, mut harmonics, mut driven) = (0.0, 0.0, Vec::new());
    for (i, drive) in plan.drives.iter().enumerate().filter(|(_, drive)| drive.force_n > 0.0) {
        let Some(electrodes) = table.electrodes.get(i) else { continue };
        let charging = electrodes.charging_at(drive.frequency_hz);
        driven.push(charging);
        let numbers = (0..).map(|k| f64::from(2 * k + 1));
        for n in numbers.take_while(|n| *n == 1.0 || n * drive.frequency_hz <= HIGHEST_FELT_HZ) {
            let hz = n * drive.frequency_hz;
            let Ok(coordinates) = solver.solve_coordinates_per_newton_at(hz) else { continue };
            let Some(q) = coordinates.get(i) else { continue };
            let force = drive.force_n
                * charging.force_harmonic_phasor_over_fundamental_amplitude(n, pulse_width).norm()
                * (std::f64::consts::TAU * hz).powi(2);
            let square = table.mean_square_over_surface(q) * force * force;
            if n == 1.0 { fundamental += square } else { harmonics += square }
        }
    }
    PulseWidth {
        pulse_width,
        force: mean_fundamental_over_that_of_instant_full_width_pulse(&driven, pulse_width),
        harmonics_db: (harmonics > 0.0 && fundamental > 0.0)
            .then(|| 10.0 * (harmonics / fundamental).log10())
            .filter(|db| *db >= LEAST_HARMONICS_DB),
    }
}

/// Fundamental over that of a full-width pulse of electrodes that charge at once, 4/pi of an electrode's steady force: the mean over drives.
#[expect(clippy::cast_precision_loss, reason = "at most four")]
fn mean_fundamental_over_that_of_instant_full_width_pulse(driven: &[PeriodicCharging], pulse_width: f64) -> f64 {
    if driven.iter().all(PeriodicCharging::is_instant) {
        return (FRAC_PI_2 * pulse_width).sin();
    }
    let each = driven.iter().map(|charging| charging.harmonic_amplitude_n(FRAC_PI_4, 1.0, pulse_width));
    each.sum::<f64>() / driven.len() as f64
}

/// The figures of an alternative plan.
fn summarize_plan_as_alternative(
    table: &PlanTable,
    change: String,
    formulation: &Formulation<'_>,
    plan: &Plan,
) -> Alternative {
    let power = |(i, drive): (usize, &crate::drive::Drive)| {
        formulation.electrical_power_w_per_n(i, drive.frequency_hz, drive.pulse_width) * drive.force_n
    };
    Alternative {
        change,
        target_peak_g: plan.predicted.target_peak_g,
        contrast_db: plan.predicted.contrast_db,
        power_mw: plan.drives.iter().enumerate().map(power).sum::<f64>() * 1e3,
        limited_by: plan.limited_by.clone(),
        weakest_g: (plan.objective == Objective::Reach).then(|| {
            table.compute_peak_at_each_grid_point_m_per_s2(plan).into_iter().flatten().fold(f64::INFINITY, f64::min)
                / STANDARD_GRAVITY
        }),
    }
}

/// The plan with one more actuator like the first, at the place of nine (three on a bar) with the largest peak, of equal ones
/// with the most contrast, whether or not it is better than the plan without it;
/// `None` if the board has no channel left.
fn describe_best_added_actuator_if_channel_left(
    table: &PlanTable,
    request: &Request,
) -> Result<Option<Alternative>, ExplainError> {
    let Some(like) = table.scene.actuators.first().filter(|_| table.scene.actuators.len() < MAX_ACTUATORS) else {
        return Ok(None);
    };
    let surface = &table.scene.surface;
    let rows: &[f64] = if surface.kind == SurfaceKind::Bar { &PLACES[1..2] } else { &PLACES };
    let mut best: Option<Alternative> = None;
    for (x, y) in rows.iter().flat_map(|y| PLACES.iter().map(move |x| (*x, *y))) {
        let Ok(place) =
            table.scene.surface_or_bar_axis_point_outside_cutouts(x * surface.length_m, y * surface.width_m)
        else {
            continue;
        };
        let (x_m, y_m) = place.coordinates_m();
        let is_taken = |other: &crate::scene::Actuator| (other.x_m - x_m).hypot(other.y_m - y_m) < 1e-3;
        if table.scene.actuators.iter().any(is_taken) {
            continue;
        }
        let mut scene = table.scene.clone();
        let mut more = like.clone();
        (more.id, more.x_m, more.y_m) = (String::from("one more"), x_m, y_m);
        scene.actuators.push(more);
        let options = TableOptions::for_preview();
        let levels = ReducedLevels::build(&scene, Accuracy::FAST, options.to_hz)?;
        let table = PlanTable::build(&scene, levels.fine, options)?;
        let request = Request { grouping: Grouping::Distinct, objective: Objective::Contrast, ..request.clone() };
        // Where this one has no plan another place may.
        let Ok(plan) = table.plan_request(&request) else { continue };
        let change = format!(
            "one more actuator like {}, at x = {:.0} mm, y = {:.0} mm (computed with a tolerance of 1 %)",
            like.id,
            x_m * 1e3,
            y_m * 1e3
        );
        let found = summarize_plan_as_alternative(&table, change, &Formulation::new(&table, &request), &plan);
        let is_better = |best: &Alternative| {
            let (more, less) = (found.target_peak_g, best.target_peak_g);
            more > less * (1.0 + 1e-6) || more >= less * (1.0 - 1e-6) && found.contrast_db > best.contrast_db
        };
        if best.as_ref().is_none_or(is_better) {
            best = Some(found);
        }
    }
    Ok(best)
}
