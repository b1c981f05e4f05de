//! What is told of a plan besides its drives, by those who have the time: harmonics, rise and decay.

use crate::motion::harmonics::compute_drive_harmonics_on_finest_model;
use crate::motion::harmonics_at::compute_harmonics_at_place_refining_model_until_accurate;
use crate::motion::strong_softening::solve_third_and_fifth_harmonic_hz_and_peaks_if_any_m_per_s2;
use crate::perception::threshold_multiple_to_db_unless_at_rest;
use crate::plan::{Plan, Planned};
use crate::table::PlanTable;
use crate::transient::panel::SwitchedForce;
use crate::{HIGHEST_FELT_HZ, STANDARD_GRAVITY};
use serde::Serialize;

/// What is told of a plan's first target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FirstTargetReport {
    /// Peak of the whole waveform at most: softened fundamentals and all odd harmonics up to what is felt, the third and fifth as
    /// they are in moving gaps, in g.
    pub waveform_peak_g: f64,
    /// The harmonics' part of it, in g.
    pub harmonics_g: f64,
    /// Bound on the relative error of `harmonics_g`, which lie above the band of the plan's own bound; `null` where it is not known.
    pub harmonics_error_bound: Option<f64>,
    /// How far the strongest of the harmonics, drives at one frequency together, is above the threshold of feeling, in dB; negative below it, `null` where nothing
    /// moves but rounding.
    pub strongest_harmonic_db: Option<f64>,
    /// What it may be off by, up or down, in dB; `null` where that is not known.
    pub strongest_harmonic_error_db: Option<f64>,
    /// When it is there, and gone.
    #[serde(flatten)]
    pub times: Times,
}

/// When a plan's first target vibrates, and when it has stopped.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Times {
    /// When it has 90 % of its steady peak and keeps it, in ms from switching on with rails that are up; `null` if never. Of an effect: when it
    /// has its peak, in ms from the effect's start.
    pub reaches_90_ms: Option<f64>,
    /// When it has decayed to 10 % after switching off, in ms; `null` if never. Of an effect: from its end, and `null` if not within 300 ms.
    pub decays_to_10_ms: Option<f64>,
}

/// Rise and decay times of a plan at its first target.
#[must_use]
pub fn compute_rise_and_decay_times_at_first_target(table: &PlanTable, plan: &Plan) -> Times {
    let shape = plan.targets.first().map(|target| table.model.shape_deflections_at(target.x_m, target.y_m));
    let drives: Vec<SwitchedForce> = plan
        .drives
        .iter()
        .enumerate()
        .filter(|(_, drive)| drive.force_n > 0.0)
        .map(|(actuator, drive)| SwitchedForce {
            actuator,
            frequency_hz: drive.frequency_hz,
            force_n: drive.force_n,
            phase_rad: drive.force_phase_rad,
        })
        .collect();
    let timing = table.panel_poles().zip(shape).map(|(rise, shape)| rise.find_rise_and_decay_times(&shape, &drives));
    let ms = |seconds: Option<f64>| seconds.map(|seconds| seconds * 1e3);
    Times {
        reaches_90_ms: ms(timing.and_then(|timing| timing.reaches_90_s)),
        decays_to_10_ms: ms(timing.and_then(|timing| timing.decays_to_10_s)),
    }
}

/// The report on a plan.
#[must_use]
pub fn build_harmonics_and_timing_report_at_first_target(table: &PlanTable, planned: &Planned) -> FirstTargetReport {
    let shape = planned.shapes.first();
    let motions = compute_drive_harmonics_on_finest_model(table, &planned.drives, &planned.settled);
    let harmonics: Vec<(f64, f64)> =
        shape.map(|shape| motions.harmonic_hz_and_peaks_at_point(shape).collect()).unwrap_or_default();
    // What comes to them in moving gaps.
    let moving = shape.and_then(|shape| {
        solve_third_and_fifth_harmonic_hz_and_peaks_if_any_m_per_s2(table, &planned.drives, &planned.settled, shape)
    });
    let at_rest = |hz: f64| harmonics.iter().filter(|(own, _)| *own == hz).map(|(_, peak)| peak).sum::<f64>();
    let felt = moving.iter().flatten().filter(|(hz, _)| *hz <= HIGHEST_FELT_HZ);
    let more_m_per_s2: f64 = felt.map(|(hz, peak)| (peak - at_rest(*hz)).max(0.0)).sum();
    let target = planned.plan.targets.first();
    let at = target.map(|target| {
        compute_harmonics_at_place_refining_model_until_accurate(
            table,
            &planned.drives,
            &planned.settled,
            (target.x_m, target.y_m),
            target.peak_g * STANDARD_GRAVITY,
        )
    });
    let sum_m_per_s2 = at.map_or(0.0, |at| at.sum_m_per_s2);
    let bound_db = |part: f64| -20.0 * (1.0 - part).log10();
    FirstTargetReport {
        waveform_peak_g: planned.plan.predicted.softened_peak_g + (sum_m_per_s2 + more_m_per_s2) / STANDARD_GRAVITY,
        harmonics_g: sum_m_per_s2 / STANDARD_GRAVITY,
        harmonics_error_bound: at.and_then(|at| at.sum_bound.limit_if_known()),
        strongest_harmonic_db: at.and_then(|at| threshold_multiple_to_db_unless_at_rest(at.strongest)),
        // A level goes further down than up by the same part; where all of it may be wrong, by any amount.
        strongest_harmonic_error_db: at
            .and_then(|at| at.strongest_bound.limit_if_known())
            .filter(|part| *part < 1.0)
            .map(bound_db),
        times: compute_rise_and_decay_times_at_first_target(table, &planned.plan),
    }
}
