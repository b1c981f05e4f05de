//! Travel of the actuators while an effect plays, and what keeps it within bounds.
//!
//! Stepped in time, as the electrodes' force depends on the travel: a plateau P while an electrode is on is P / (1 - u)^2
//! towards it at a travel u of the gap, and P / (1 + u)^2 away from it.

use super::part::Part;
use crate::planner::PlanTable;
use crate::planner::limits::{BREAKDOWN_MARGIN, Electrodes, TRAVEL_PART, breakdown_v};
use crate::planner::rise::{RiseTimes, Stepper};
use era_shared::supply::rail_of;
use era_shared::waveform::Effect;
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// Step in s: some sixty in a period of 400 Hz.
const STEP_S: f64 = 40e-6;
/// Longest part of an effect that is looked at, in s; overshoots come at its beginning.
const LONGEST_S: f64 = 0.2;
/// After the end, in s: half a period of the slowest drives.
const AFTER_S: f64 = 0.01;
/// Part of the travel allowed that may be used, for the steps and for cycles that fall together otherwise.
const USED: f64 = 0.92;
/// Times over its period at which each drive may begin.
const OFFSETS: u32 = 2;
/// Halvings in the search for a strength that fits: to 1/64.
const HALVINGS: usize = 6;

/// Lowers all drives until no actuator travels beyond a third of its gap, or closes it below what its voltage takes; says
/// whether it had to.
pub fn keep_within_travel(table: &PlanTable, rise: &RiseTimes, parts: &mut [Part], effects: &[Effect]) -> bool {
    let rows: Vec<DVector<f64>> = (0..table.electrodes.len()).map(|actuator| travel_row(table, actuator)).collect();
    let rest = rise.stepper(&rows, STEP_S);
    let levels: Vec<Vec<f64>> = parts.iter().zip(effects).map(|(part, effect)| part.levels(effect)).collect();
    let combinations = OFFSETS.pow(u32::try_from(parts.len().saturating_sub(1)).unwrap_or(0));
    let fits = |scale: f64| {
        (0..combinations).all(|combination| {
            let travels = largest(rest.clone(), &table.electrodes, parts, &levels, scale, combination);
            table.electrodes.iter().zip(&travels).enumerate().all(|(actuator, (electrodes, travel))| {
                let allowed = USED * TRAVEL_PART * electrodes.gap_m;
                let volts = rail_v(&table.electrodes, parts, actuator, scale);
                *travel <= allowed && volts <= BREAKDOWN_MARGIN * breakdown_v(electrodes.gap_m - travel / USED)
            })
        })
    };
    if is_surely_small(rise, &rows, &table.electrodes, parts, &levels) || fits(1.0) {
        return false;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        *(if fits(middle) { &mut low } else { &mut high }) = middle;
    }
    parts.iter_mut().for_each(|part| part.drive.force_n *= low);
    true
}

/// Whether all travels are so small that nothing has to be stepped: a bound of the fundamentals' travel, from the steady
/// motion and all of the free motion that every change of level adds, against 1/50 of the gap. The factor of sixteen from
/// there to a third of it is for harmonics, of a third of the fundamental at most and a resonance of their own at worst.
fn is_surely_small(
    rise: &RiseTimes,
    rows: &[DVector<f64>],
    all: &[Electrodes],
    parts: &[Part],
    levels: &[Vec<f64>],
) -> bool {
    rows.iter().zip(all).enumerate().all(|(actuator, (row, electrodes))| {
        let bounds = parts.iter().zip(levels).map(|(part, levels)| {
            let ringing = rise.ringings(row, &[part.drive])?.pop()?.displacement();
            let ends = levels.first().map_or(0.0, |x| x.abs()) + levels.last().map_or(0.0, |x| x.abs());
            let changes = ends + levels.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum::<f64>();
            let free: f64 = ringing.free.iter().map(|(_, c)| c.norm()).sum();
            Some(part.drive.force_n * (ringing.steady.norm() + changes * free))
        });
        let travel = bounds.sum::<Option<f64>>();
        let volts = rail_v(all, parts, actuator, 1.0);
        travel.is_some_and(|travel| {
            travel < 0.02 * electrodes.gap_m && volts <= BREAKDOWN_MARGIN * breakdown_v(electrodes.gap_m - travel)
        })
    })
}

/// Voltage across an actuator's gap: the highest that is asked of its rail.
fn rail_v(electrodes: &[Electrodes], parts: &[Part], actuator: usize, scale: f64) -> f64 {
    let on_its_rail = parts.iter().filter(|part| rail_of(part.drive.actuator) == rail_of(actuator));
    let volts = |part: &Part| {
        let electrodes = electrodes.get(part.drive.actuator)?;
        Some(electrodes.voltage_for(part.drive.force_n * scale, part.channel.pulse_width))
    };
    on_its_rail.filter_map(volts).fold(0.0, f64::max)
}

/// Travel of an actuator per unit of each coordinate.
fn travel_row(table: &PlanTable, actuator: usize) -> DVector<f64> {
    let n = table.model.order();
    let mut unit = DVector::from_element(n, Complex64::ZERO);
    DVector::from_fn(n, |i, _| {
        unit[i] = Complex64::ONE;
        let travel = table.model.travel(actuator, &unit).re;
        unit[i] = Complex64::ZERO;
        travel
    })
}

/// Largest travel of every actuator in m; not looked at any further once one is beyond a third of its gap. The digits of
/// `combination` say when within its period each drive but the first begins.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss, reason = "small counts")]
fn largest(
    mut stepper: Stepper,
    electrodes: &[Electrodes],
    parts: &[Part],
    levels: &[Vec<f64>],
    scale: f64,
    combination: u32,
) -> Vec<f64> {
    let mut rest = combination;
    let delays_s: Vec<f64> = (0..)
        .zip(parts)
        .map(|(i, part)| {
            let digit = if i == 0 { 0 } else { rest % OFFSETS };
            rest /= if i == 0 { 1 } else { OFFSETS };
            f64::from(digit) / f64::from(OFFSETS) * part.channel.period_s()
        })
        .collect();
    let ends = parts.iter().zip(levels).zip(&delays_s).map(|((p, l), d)| d + l.len() as f64 * p.channel.period_s());
    let steps = ((ends.fold(0.0, f64::max).min(LONGEST_S) + AFTER_S) / STEP_S).ceil() as usize;
    let (mut travel, mut most) = (vec![0.0; electrodes.len()], vec![0.0_f64; electrodes.len()]);
    let mut forces = vec![0.0; electrodes.len()];
    for i in 0..steps {
        if most.iter().zip(electrodes).any(|(most, electrodes)| *most > TRAVEL_PART * electrodes.gap_m) {
            break;
        }
        let time_s = i as f64 * STEP_S;
        forces.fill(0.0);
        for ((part, levels), delay_s) in parts.iter().zip(levels).zip(&delays_s) {
            let actuator = part.drive.actuator;
            let (a, b) = on(part, levels, time_s - delay_s);
            let width = part.channel.pulse_width;
            let plateau_n = part.drive.force_n * scale * FRAC_PI_4 / (FRAC_PI_2 * width).sin();
            let u = (travel[actuator] / electrodes[actuator].gap_m).clamp(-0.5, 0.5);
            forces[actuator] += plateau_n * (a / ((1.0 - u) * (1.0 - u)) - b / ((1.0 + u) * (1.0 + u)));
        }
        stepper.step(&forces, &mut travel);
        most.iter_mut().zip(&travel).for_each(|(most, travel)| *most = most.max(travel.abs()));
    }
    most
}

/// Parts of the step from `time_s` on, counted from the drive's start, for which its electrodes A and B are on.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small counts")]
fn on(part: &Part, levels: &[f64], time_s: f64) -> (f64, f64) {
    if time_s < 0.0 {
        return (0.0, 0.0);
    }
    let periods = time_s * part.channel.frequency_hz;
    let level = levels.get(periods as usize).copied().unwrap_or(0.0);
    let step = STEP_S * part.channel.frequency_hz;
    // In periods: windows in the middle of each half, as wide as the level takes.
    let width = (level.abs() * (FRAC_PI_2 * part.channel.pulse_width).sin()).asin() / FRAC_PI_2;
    let from = periods.fract();
    let overlap =
        |middle: f64| ((from + step).min(middle + 0.25 * width) - from.max(middle - 0.25 * width)).max(0.0) / step;
    if level >= 0.0 { (overlap(0.25), overlap(0.75)) } else { (overlap(0.75), overlap(0.25)) }
}
