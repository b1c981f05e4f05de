//! Further checks for drives whose electrodes soften the springs noticeably: the motion while the rails rise, and
//! motion beside the fundamentals.
//!
//! [`crate::motion::settle`] takes the steady motion of the fundamentals and adds what harmonics move in gaps at rest.
//! If the electrodes take a large fraction of the springs' stiffness, masses may travel further while the rails rise
//! than they do in the end, harmonics close the gaps further for the fundamentals, and the pulsation of the springs
//! makes motion at sums and differences of the frequencies.

use crate::chosen_drive::{ChosenDrive, VoltageAndPulseWidth};
use crate::motion::driven_panel::{DrivenPanel, SettledMotion, bound_harmonic_travel_of_each_mass_in_gaps_at_rest_m};
use crate::motion::driven_panel::{
    build_driven_panel, check_travel_with_harmonics_against_limits,
    find_actuator_of_motion_error_and_name_travel_as_limit,
};
use crate::physics::limits::Limit;
use crate::physics::softening::{
    Line, Motion, MotionError, TimeResponse, compute_travel_receptance, find_largest_travel_while_rails_rise_m,
    solve_steady_motion,
};
use crate::response::CoordinateSolver;
use crate::scene::MAX_ACTUATORS;
use crate::table::{PlanTable, acceleration_at_point_from_coordinates, compute_travel_of_each_actuator};
use era_shared::limits::RAIL_SLOPE_MILLIVOLTS_PER_MS;
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Harmonics whose motion is among what closes the gaps; a seventh's force is at most a seventh of the fundamental's.
pub(crate) const CLOSING: [u32; 2] = [3, 5];
/// Pulse width below which the third harmonic of the force is above an eighth of the fundamental: it changed a peak by 0.2 % at 0.56.
const NARROW: f64 = 0.6;
/// That part, which stands for the width where electrodes charge through resistors.
const STRONG_THIRD: f64 = 0.125;
/// Lowest frequency in Hz at which a difference of frequencies counts as motion.
const LOWEST_HZ: f64 = 1.0;
/// Part of the gap's third below which motion at a sum or difference is left out.
const NO_COMBINATION: f64 = 1e-3;

/// Checks that the masses stay within the limits while the rails rise to the voltages of a steady motion, with
/// harmonics and combination tones; the error names the actuator and limit.
pub(crate) fn check_limits_during_rise_with_harmonics(
    table: &PlanTable,
    drives: &[ChosenDrive],
    settled: &SettledMotion,
) -> Result<(), (usize, Limit)> {
    let (applied, motion) = (&settled.applied, &settled.motion);
    let problem = build_driven_panel(table, drives, *applied);
    let named = |error| find_actuator_of_motion_error_and_name_travel_as_limit(table, error, applied);
    // Without poles nothing is known of the way.
    let risen = largest_fundamental_travel_while_rails_rise_if_poles_known_m(table, drives, &problem, motion)
        .ok_or((0, Limit::Travel))?;
    let mut travel_m = risen.map_err(named)?;
    check_travel_with_harmonics_against_limits(table, drives, settled, &travel_m)?;
    let already_counted_m =
        bound_harmonic_travel_of_each_mass_in_gaps_at_rest_m(drives, applied, settled.scale, &CLOSING.map(f64::from));
    let besides_m =
        bound_travel_added_by_harmonics_and_combinations_m(table, drives, &problem, motion, &already_counted_m)
            .map_err(named)?;
    travel_m.iter_mut().zip(besides_m).for_each(|(travel, beside)| *travel += beside);
    check_travel_with_harmonics_against_limits(table, drives, settled, &travel_m)
}

/// Largest travel of the masses in m while the rails rise to the voltages of a steady motion, without harmonics;
/// `None` without poles.
pub(crate) fn largest_fundamental_travel_while_rails_rise_if_poles_known_m(
    table: &PlanTable,
    drives: &[ChosenDrive],
    problem: &DrivenPanel,
    motion: &Motion,
) -> Option<Result<[f64; MAX_ACTUATORS], MotionError>> {
    let onset = table.switch_on_model()?;
    let following: Vec<TimeResponse> = problem
        .lines
        .iter()
        .zip(&problem.leaders)
        .map(|(line, leader)| {
            onset.split_receptance_into_near_poles_and_instant_part(drives[*leader].frequency_hz, &line.receptance)
        })
        .collect();
    let volts_per_s = f64::from(RAIL_SLOPE_MILLIVOLTS_PER_MS);
    let mut rise_s = [1e-3_f64; MAX_ACTUATORS];
    for (rise_s, excitation) in rise_s.iter_mut().zip(problem.excitations()) {
        *rise_s = (excitation.voltage_v / volts_per_s).max(*rise_s);
    }
    let (transducers, excitations) = (problem.transducers(), problem.excitations());
    let risen =
        find_largest_travel_while_rails_rise_m(transducers, excitations, &problem.lines, &following, &rise_s, motion);
    Some(risen.map(|mut travel_m| {
        for (leader, force_n) in problem.leaders.iter().zip(&motion.force_n) {
            let left =
                onset.bound_transients_of_instantly_following_poles_m(drives[*leader].frequency_hz, force_n, &rise_s);
            travel_m.iter_mut().zip(left).for_each(|(travel, left)| *travel += left);
        }
        travel_m
    }))
}

/// Travel in m that harmonics which close the gaps, and motion at sums and differences of frequencies, add to a
/// steady motion; `already_counted_harmonic_travel_m` is that of the harmonics of [`CLOSING`] in gaps at rest, which is counted elsewhere.
pub(crate) fn bound_travel_added_by_harmonics_and_combinations_m(
    table: &PlanTable,
    drives: &[ChosenDrive],
    problem: &DrivenPanel,
    motion: &Motion,
    already_counted_harmonic_travel_m: &[f64; MAX_ACTUATORS],
) -> Result<[f64; MAX_ACTUATORS], MotionError> {
    let solver = CoordinateSolver::new(&table.model);
    let lines = build_fundamental_and_harmonic_lines(table, drives, problem, &solver);
    let all = solve_steady_motion(problem.transducers(), problem.excitations(), &lines)?;
    let mut besides_m = bound_combination_tone_travel_m(table, drives, problem, &all, &solver);
    for (i, beside) in besides_m.iter_mut().enumerate() {
        *beside += (all.largest_m[i] - motion.largest_m[i] - already_counted_harmonic_travel_m[i]).max(0.0);
    }
    Ok(besides_m)
}

/// The fundamentals' lines, then those of the harmonics of [`CLOSING`].
fn build_fundamental_and_harmonic_lines(
    table: &PlanTable,
    drives: &[ChosenDrive],
    problem: &DrivenPanel,
    solver: &CoordinateSolver<'_>,
) -> Vec<Line> {
    let mut lines = problem.lines.clone();
    for (line, leader) in problem.lines.iter().zip(&problem.leaders) {
        for harmonic in CLOSING {
            if let Ok(coordinates) =
                solver.solve_coordinates_per_newton_at(f64::from(harmonic) * drives[*leader].frequency_hz)
            {
                lines.push(Line {
                    harmonic,
                    receptance: compute_travel_receptance(&table.model, &coordinates),
                    ..*line
                });
            }
        }
    }
    lines
}

/// Frequencies in Hz and peak accelerations in m/s^2, at the point with mode shapes `shape`, of the third and fifth
/// harmonics in moving gaps: the pulsation of a spring at twice the drive's frequency turns its motion into force at
/// three times that frequency. `None` if no such motion is found.
pub(crate) fn solve_third_and_fifth_harmonic_hz_and_peaks_if_any_m_per_s2(
    table: &PlanTable,
    drives: &[ChosenDrive],
    settled: &SettledMotion,
    shape: &DVector<f64>,
) -> Option<Vec<(f64, f64)>> {
    let problem = build_driven_panel(table, drives, settled.applied);
    let solver = CoordinateSolver::new(&table.model);
    let lines = build_fundamental_and_harmonic_lines(table, drives, &problem, &solver);
    let motion = solve_steady_motion(problem.transducers(), problem.excitations(), &lines).ok()?;
    let mut found = Vec::new();
    for (line, force_n) in lines.iter().zip(&motion.force_n).filter(|(line, _)| line.harmonic > 1) {
        let hz = f64::from(line.harmonic) * drives.get(*problem.leaders.get(line.frequency)?)?.frequency_hz;
        let omega = TAU * hz;
        let coordinates = solver.solve_coordinates_per_newton_at(hz).ok()?;
        let at = coordinates
            .iter()
            .zip(force_n)
            .map(|(q, force)| acceleration_at_point_from_coordinates(shape, q) * force)
            .sum::<Complex64>();
        found.push((hz, at.norm() * omega * omega));
    }
    Some(found)
}

/// The steady motion with harmonics that close the gaps, if a window is narrower than [`NARROW`] or makes as strong a third harmonic;
/// `None` otherwise.
/// Harmonics of such windows pull when the mass is where all odd harmonics meet, and the spring's pulsation turns
/// each of them into force at the fundamental: for a mass above its resonance the third moves it by a ninth of the
/// fundamental, and reduces the softening by as much.
pub(crate) fn solve_motion_with_harmonics_if_pulses_are_narrow(
    table: &PlanTable,
    drives: &[ChosenDrive],
    settled: &SettledMotion,
) -> Option<SettledMotion> {
    let is_narrow = |(i, (applied, drive)): (usize, (&VoltageAndPulseWidth, &ChosenDrive))| {
        let charging = drive.row.get(i).map(|own| own.charging).filter(|charging| !charging.is_instant());
        let is_strong = charging.map_or(applied.pulse_width < NARROW, |charging| {
            charging.force_harmonic_phasor_over_fundamental_amplitude(3.0, applied.pulse_width).norm() > STRONG_THIRD
        });
        applied.voltage_v > 0.0 && is_strong
    };
    settled.applied.iter().zip(drives).enumerate().any(is_narrow).then_some(())?;
    let problem = build_driven_panel(table, drives, settled.applied);
    let lines = build_fundamental_and_harmonic_lines(table, drives, &problem, &CoordinateSolver::new(&table.model));
    let motion = solve_steady_motion(problem.transducers(), problem.excitations(), &lines).ok()?;
    Some(SettledMotion { motion, ..*settled })
}

/// Bound on the travel in m at sums and differences of frequencies: the spring of an actuator that is driven at f pulsates
/// at 2 f, and what moves it at f' is felt at 2 f + f' and 2 f - f' too.
fn bound_combination_tone_travel_m(
    table: &PlanTable,
    drives: &[ChosenDrive],
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
                let Ok(coordinates) = solver.solve_coordinates_per_newton_at(hz.max(LOWEST_HZ)) else { continue };
                let Some(q) = coordinates.get(i) else { continue };
                let moved = compute_travel_of_each_actuator(&table.model, q);
                for ((sum, z), electrodes) in travel_m.iter_mut().zip(moved).zip(&table.electrodes) {
                    let own = z.norm() * force_n;
                    *sum += if own > NO_COMBINATION * electrodes.max_travel_m() { own } else { 0.0 };
                }
            }
        }
    }
    travel_m
}
