//! A closer look at drives whose electrodes soften what they move: the way to the steady motion, and what moves beside it.
//!
//! [`crate::motion::settle`] takes the fundamentals' steady motion and adds what harmonics move in gaps at rest. Where the electrodes take
//! a good part of the springs' stiffness, rails that rise make masses go further than they do in the end, harmonics close the gaps
//! further for the fundamentals, and the springs' pulsation makes motion at sums and differences of the frequencies.

use crate::chosen_drive::Chosen;
use crate::motion::driven_panel::{Applied, DrivenPanel, Settled, harmonics_m};
use crate::motion::driven_panel::{build_driven_panel, check_limits, locate_failure};
use crate::physics::limits::Limit;
use crate::physics::softening::{Line, Motion, NotSafe, TimeResponse, rise, settle, travel_receptance};
use crate::response::CoordinateSolver;
use crate::scene::MAX_ACTUATORS;
use crate::table::{PlanTable, at_point, travel_by};
use era_shared::limits::RAIL_SLOPE_MILLIVOLTS_PER_MS;
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Harmonics whose motion is among what closes the gaps; a seventh's force is at most a seventh of the fundamental's.
pub(crate) const CLOSING: [u32; 2] = [3, 5];
/// Pulse width below which the third harmonic of the force is above an eighth of the fundamental: it changed a peak by 0.2 % at 0.56.
const NARROW: f64 = 0.6;
/// Lowest frequency in Hz at which a difference of frequencies counts as motion.
const LOWEST_HZ: f64 = 1.0;
/// Part of the gap's third below which motion at a sum or difference is left out.
const NO_COMBINATION: f64 = 1e-3;

/// Whether the masses stay within the limits while the rails rise to the voltages of a steady motion, with all that moves
/// beside it.
pub(crate) fn check_rise_and_harmonics(
    table: &PlanTable,
    drives: &[Chosen],
    settled: &Settled,
) -> Result<(), (usize, Limit)> {
    let (applied, motion) = (&settled.applied, &settled.motion);
    let problem = build_driven_panel(table, drives, *applied);
    let named = |error| locate_failure(table, error, applied);
    // Without poles nothing is known of the way.
    let risen = compute_rise_travel_m(table, drives, &problem, motion).ok_or((0, Limit::Travel))?;
    let mut travel_m = risen.map_err(named)?;
    check_limits(table, drives, settled, &travel_m)?;
    let alone_m = harmonics_m(drives, applied, settled.scale, &CLOSING.map(f64::from));
    let besides_m = bound_added_travel_m(table, drives, &problem, motion, &alone_m).map_err(named)?;
    travel_m.iter_mut().zip(besides_m).for_each(|(travel, beside)| *travel += beside);
    check_limits(table, drives, settled, &travel_m)
}

/// How far masses go while the rails rise to the voltages of a steady motion, in m, without harmonics; `None` without
/// poles.
pub(crate) fn compute_rise_travel_m(
    table: &PlanTable,
    drives: &[Chosen],
    problem: &DrivenPanel,
    motion: &Motion,
) -> Option<Result<[f64; MAX_ACTUATORS], NotSafe>> {
    let onset = table.onset()?;
    let following: Vec<TimeResponse> = problem
        .lines
        .iter()
        .zip(&problem.leaders)
        .map(|(line, leader)| onset.time_response(drives[*leader].frequency_hz, &line.receptance))
        .collect();
    let volts_per_s = f64::from(RAIL_SLOPE_MILLIVOLTS_PER_MS);
    let mut rise_s = [1e-3_f64; MAX_ACTUATORS];
    for (rise_s, excitation) in rise_s.iter_mut().zip(problem.excitations()) {
        *rise_s = (excitation.voltage_v / volts_per_s).max(*rise_s);
    }
    let (transducers, excitations) = (problem.transducers(), problem.excitations());
    let risen = rise(transducers, excitations, &problem.lines, &following, &rise_s, motion);
    Some(risen.map(|mut travel_m| {
        for (leader, force_n) in problem.leaders.iter().zip(&motion.force_n) {
            let left = onset.beyond(drives[*leader].frequency_hz, force_n, &rise_s);
            travel_m.iter_mut().zip(left).for_each(|(travel, left)| *travel += left);
        }
        travel_m
    }))
}

/// What comes to the travel of a steady motion in m by harmonics that close the gaps for it, and at sums and differences of
/// frequencies; `alone_m` are the harmonics of [`CLOSING`] in gaps at rest, which are counted later on.
pub(crate) fn bound_added_travel_m(
    table: &PlanTable,
    drives: &[Chosen],
    problem: &DrivenPanel,
    motion: &Motion,
    alone_m: &[f64; MAX_ACTUATORS],
) -> Result<[f64; MAX_ACTUATORS], NotSafe> {
    let solver = CoordinateSolver::new(&table.model);
    let lines = lines_with_harmonics(table, drives, problem, &solver);
    let all = settle(problem.transducers(), problem.excitations(), &lines)?;
    let mut besides_m = bound_combination_travel_m(table, drives, problem, &all, &solver);
    for (i, beside) in besides_m.iter_mut().enumerate() {
        *beside += (all.largest_m[i] - motion.largest_m[i] - alone_m[i]).max(0.0);
    }
    Ok(besides_m)
}

/// The fundamentals' lines, then those of the harmonics of [`CLOSING`].
fn lines_with_harmonics(
    table: &PlanTable,
    drives: &[Chosen],
    problem: &DrivenPanel,
    solver: &CoordinateSolver<'_>,
) -> Vec<Line> {
    let mut lines = problem.lines.clone();
    for (line, leader) in problem.lines.iter().zip(&problem.leaders) {
        for harmonic in CLOSING {
            if let Ok(coordinates) = solver.solve_at_frequency(f64::from(harmonic) * drives[*leader].frequency_hz) {
                lines.push(Line { harmonic, receptance: travel_receptance(&table.model, &coordinates), ..*line });
            }
        }
    }
    lines
}

/// Peak accelerations in m/s^2 at the point with mode shapes `shape` of the third and fifth harmonics as they are in moving gaps,
/// with their frequencies in Hz: the springs' pulsation at twice a drive's frequency turns its motion into force at three times
/// that. `None` where no such motion is found.
pub(crate) fn find_moving_harmonics(
    table: &PlanTable,
    drives: &[Chosen],
    settled: &Settled,
    shape: &DVector<f64>,
) -> Option<Vec<(f64, f64)>> {
    let problem = build_driven_panel(table, drives, settled.applied);
    let solver = CoordinateSolver::new(&table.model);
    let lines = lines_with_harmonics(table, drives, &problem, &solver);
    let motion = settle(problem.transducers(), problem.excitations(), &lines).ok()?;
    let mut found = Vec::new();
    for (line, force_n) in lines.iter().zip(&motion.force_n).filter(|(line, _)| line.harmonic > 1) {
        let hz = f64::from(line.harmonic) * drives.get(*problem.leaders.get(line.frequency)?)?.frequency_hz;
        let omega = TAU * hz;
        let coordinates = solver.solve_at_frequency(hz).ok()?;
        let at = coordinates.iter().zip(force_n).map(|(q, force)| at_point(shape, q) * force).sum::<Complex64>();
        found.push((hz, at.norm() * omega * omega));
    }
    Some(found)
}

/// A steady motion with the harmonics' own among what closes the gaps, where windows are [`NARROW`]. Those pull when the mass is
/// where all odd harmonics meet, and the spring's pulsation turns each of them into force at the fundamental: of a mass above its
/// resonance the third moves it by a ninth of the fundamental, and takes as much off what the softening does.
pub(crate) fn settle_with_harmonics(table: &PlanTable, drives: &[Chosen], settled: &Settled) -> Option<Settled> {
    let is_narrow = |applied: &&Applied| applied.voltage_v > 0.0 && applied.pulse_width < NARROW;
    settled.applied.iter().find(is_narrow)?;
    let problem = build_driven_panel(table, drives, settled.applied);
    let lines = lines_with_harmonics(table, drives, &problem, &CoordinateSolver::new(&table.model));
    let motion = settle(problem.transducers(), problem.excitations(), &lines).ok()?;
    Some(Settled { motion, ..*settled })
}

/// Bound on the travel in m at sums and differences of frequencies: the spring of an actuator that is driven at f pulsates
/// at 2 f, and what moves it at f' is felt at 2 f + f' and 2 f - f' too.
fn bound_combination_travel_m(
    table: &PlanTable,
    drives: &[Chosen],
    problem: &DrivenPanel,
    motion: &Motion,
    solver: &CoordinateSolver<'_>,
) -> [f64; MAX_ACTUATORS] {
    let mut travel_m = [0.0; MAX_ACTUATORS];
    for (i, excitation) in problem.excitations().iter().enumerate().filter(|(_, e)| e.voltage_v > 0.0) {
        for (l, leader) in problem.leaders.iter().enumerate().filter(|(l, _)| *l != excitation.frequency) {
            let force_n = (motion.pulsating_n_per_m[i] * motion.travel_m[l][i]).norm();
            let (own_hz, other_hz) = (drives[i].frequency_hz, drives[*leader].frequency_hz);
            for hz in [2.0 * own_hz + other_hz, (2.0 * own_hz - other_hz).abs()] {
                let Ok(coordinates) = solver.solve_at_frequency(hz.max(LOWEST_HZ)) else { continue };
                let Some(q) = coordinates.get(i) else { continue };
                let moved = travel_by(&table.model, q);
                for ((sum, z), electrodes) in travel_m.iter_mut().zip(moved).zip(&table.electrodes) {
                    let own = z.norm() * force_n;
                    *sum += if own > NO_COMBINATION * electrodes.most_travel_m() { own } else { 0.0 };
                }
            }
        }
    }
    travel_m
}
