//! A click's windows for a place.

use super::actuator::ClickActuator;
use super::bound::find_best_possible_peak;
use super::designer::{ClickDesigner, SLOT_SAMPLES};
use super::felt::{FINE_RECORD, felt_motion_from_means, shown_motion_from_means};
use super::measures::{ClickMeasures, measure_click};
use super::motion::simulate_windows;
use super::options::{ClickOptions, LATEST_PEAK_S};
use super::slots::compute_slot_responses_of_five_panels;
use super::sound::{SurfaceFigures, compute_surface_figures_if_anything_moves};
use super::window::{ClickWindow, LEAD_S};
use crate::PlanTable;
use crate::physics::limits::Limit;
use crate::physics::rise::PanelPoles;
use crate::plan::limitation::{Limitation, add_limitation_if_new};
use nalgebra::DVector;
use num_complex::Complex64;

/// Times that a click is weakened for its travel.
const WEAKENED: usize = 3;
/// Fraction of the wished peak that counts as reached.
const REACHED: f64 = 0.95;

/// A click.
#[derive(Clone, Debug)]
pub struct ClickDesign {
    /// By their begin; empty if no actuator moves the place.
    pub windows: Vec<ClickWindow>,
    /// In m/s^2, times from the burst's start.
    pub measures: ClickMeasures,
    /// Felt acceleration in m/s^2 as [`FINE_RECORD`] samples in 1 s, from [`LEAD_S`] after the burst's start on.
    pub felt_motion: Vec<f64>,
    /// Largest acceleration in m/s^2 of all motion below 1 kHz, felt or not: what an accelerometer shows.
    pub shown_peak: f64,
    /// Largest acceleration after the last window, over the peak.
    pub residual: f64,
    /// What keeps it below what was asked for.
    pub limits: Vec<Limitation>,
    /// Largest travel of every actuator's mass in m.
    pub travel_m: Vec<f64>,
    /// For each pole that vibrates: its pole, the largest amplitude while windows are on, and that after them.
    pub amplitudes: Vec<(Complex64, f64, f64)>,
    /// The strongest crisp click that these actuators can make here in m/s^2, if it was asked for ([`super::bound`]).
    pub best_possible: Option<f64>,
    /// What it does to the surface, if it was asked for and anything moves.
    pub surface: Option<SurfaceFigures>,
    /// Whether it is quiet at the time asked for, and its peak in time.
    pub is_crisp: bool,
}

impl ClickDesign {
    /// End of the last window in s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.windows.iter().map(|window| window.begin_s + window.width_s).fold(0.0, f64::max)
    }
}

/// Designs the windows of a click of `asked` m/s^2 for the place whose mode shapes are `shape`.
#[must_use]
pub fn design_click_windows(
    table: &PlanTable,
    poles: &PanelPoles,
    shape: &DVector<f64>,
    asked: f64,
    options: ClickOptions,
) -> Option<ClickDesign> {
    let residues = poles.residues_at_shape(shape);
    let panels = compute_slot_responses_of_five_panels(&residues, SLOT_SAMPLES);
    let actuators: Vec<ClickActuator> =
        table.electrodes.iter().enumerate().map(|(i, own)| ClickActuator::new(table, i, own)).collect();
    let designer = ClickDesigner { table, poles, shape, panels: &panels, actuators: &actuators, options };
    let mut part = 1.0;
    let mut travel_limit = None;
    let mut built = designer.design_for_peak(asked)?;
    for _ in 0..WEAKENED {
        let Some((actuator, excess)) = designer.find_largest_travel_excess(&built.motion) else { break };
        travel_limit = Some(actuator);
        part *= (0.97 / excess).min(0.97);
        built = designer.design_for_peak(asked * part)?;
    }
    if let Some((_, excess)) = designer.find_largest_travel_excess(&built.motion) {
        built = designer.weaken(&built, 0.9 / excess);
    }
    if options.force_fraction < 1.0 {
        built = designer.weaken(&built, options.force_fraction);
    }
    let means = built.motion.mean_acceleration.first().map_or(&[][..], Vec::as_slice);
    let felt = felt_motion_from_means(means);
    let shown_peak = shown_motion_from_means(means).iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let mut measures = measure_click(&felt);
    let end_s = built.windows.iter().map(|window| window.begin_s + window.width_s).fold(0.0, f64::max);
    let after = felt.iter().enumerate().filter(|(k, _)| index_to_time_s(*k) >= end_s).map(|(_, x)| x.abs());
    // What precedes the beginning is at the record's end.
    let residual =
        if measures.peak > 0.0 { after.take(felt.len() / 2).fold(0.0, f64::max) / measures.peak } else { 0.0 };
    measures.peak_s += LEAD_S;
    measures.quiet_s = measures.quiet_s.map(|quiet_s| if measures.peak > 0.0 { quiet_s + LEAD_S } else { quiet_s });
    let mut limits = Vec::new();
    if measures.peak < REACHED * asked {
        if built.saturated.is_empty() && travel_limit.is_none() && !built.lacks.current && !built.lacks.windows {
            add_limitation_if_new(
                &mut limits,
                if built.windows.is_empty() { Limitation::Node } else { Limitation::TooShort },
            );
        }
        for (actuator, limit) in &built.saturated {
            add_limitation_if_new(&mut limits, Limitation::for_actuator(table, *limit, *actuator));
        }
        if built.lacks.current {
            add_limitation_if_new(&mut limits, Limitation::Supply);
        }
        if built.lacks.windows {
            add_limitation_if_new(&mut limits, Limitation::Windows);
        }
    }
    if let Some(actuator) = travel_limit.filter(|_| measures.peak < REACHED * asked) {
        add_limitation_if_new(&mut limits, Limitation::for_actuator(table, Limit::Travel, actuator));
    }
    let best_possible = options.with_figures_for_comparison.then(|| {
        let forces: Vec<f64> = actuators.iter().map(|own| own.plateau_n).collect();
        find_best_possible_peak(&residues, &forces, options.crisp_s)
    });
    let best_possible = best_possible.flatten();
    let mut windows = built.windows;
    windows.iter_mut().for_each(|window| window.begin_s += LEAD_S);
    windows.sort_by(|a, b| a.begin_s.total_cmp(&b.begin_s));
    let surface = options
        .with_figures_for_comparison
        .then(|| compute_surface_figures_if_anything_moves(table, poles, &windows, &felt));
    let is_crisp = measures.peak > 0.0
        && measures.peak_s <= LATEST_PEAK_S
        && measures.quiet_s.is_some_and(|quiet_s| quiet_s <= options.crisp_s);
    Some(ClickDesign {
        windows,
        measures,
        felt_motion: felt,
        shown_peak,
        residual,
        limits,
        travel_m: built.motion.travel_m,
        amplitudes: built.motion.amplitudes,
        best_possible,
        surface: surface.flatten(),
        is_crisp,
    })
}

/// Felt acceleration in m/s^2 at the places whose mode shapes are `shapes`, as [`FINE_RECORD`] samples in 1 s from the burst's start on:
/// what windows do on a panel, which may be another than they were designed for.
#[must_use]
pub fn simulate_felt_motion_of_windows(
    table: &PlanTable,
    poles: &PanelPoles,
    shapes: &[DVector<f64>],
    windows: &[ClickWindow],
) -> Vec<Vec<f64>> {
    let motion = simulate_windows(table, poles, shapes, windows);
    motion.mean_acceleration.iter().map(|means| felt_motion_from_means(means)).collect()
}

#[expect(clippy::cast_precision_loss, reason = "some thousand samples")]
fn index_to_time_s(sample: usize) -> f64 {
    sample as f64 / FINE_RECORD as f64
}
