//! The last word on every plan: what the actuators do with the forces that their gaps make of the voltages.
//!
//! The search takes the force of the mass at rest. Here the steady motion with the force as it depends on the travel
//! ([`crate::physics::softening`]) decides: where any actuator would travel beyond a third of its gap or be pulled in, or its voltage (its rail's)
//! break down the gap that is left, or the supply deliver more than it can, all forces are scaled down together until none does.
//! Where the electrodes soften much, [`crate::motion::strong_softening`] looks at the way there, and at what moves beside it.

use crate::chosen_drive::{ChosenDrive, VoltageAndPulseWidth};
use crate::motion::driven_panel::{
    SettledMotion, build_driven_panel, check_travel_with_harmonics_against_limits,
    find_actuator_of_motion_error_and_name_travel_as_limit,
};
use crate::motion::strong_softening::check_limits_during_rise_with_harmonics;
use crate::physics::limits::{
    Electrodes, HALVINGS, LEVELS, Limit, MAX_SOFTENING_FRACTION, MAX_TRAVEL_FRACTION, max_mean_supply_current_a,
    mean_supply_current_with_bleeders_a,
};
use crate::physics::softening::{MAX_LINES, solve_steady_motion_starting_from_scaled_known_motion};
use crate::scene::MAX_ACTUATORS;
use crate::table::{PlanTable, bound_travel_with_harmonics_and_overshoot_m_per_n};
use era_shared::supply::{RAILS, rail_index_of_channel};
use nalgebra::DVector;
use num_complex::Complex64;

/// Parts of the gap up to which motions are shown to stay: the third that is allowed, and less, where the softening is weaker.
const CLOSED: [f64; 3] = [MAX_TRAVEL_FRACTION, 0.2, 0.1];

/// The fraction of full force at a level.
fn force_fraction_of_level(level: u32) -> f64 {
    f64::from(level) / f64::from(LEVELS)
}

/// Derates drives until they are safe; `None` if they are safe at no scale, which a spring that is softened beyond
/// pull-in would cause. The rails rise within a tenth of a second, and an ERA whose resonance the softening moves
/// across its drive's frequency travels furthest on the way. All levels up to the last are therefore checked, and
/// then the rise itself, unless the softening is too weak to matter.
pub(crate) fn derate_drives_until_safe_and_settle_if_possible(
    table: &PlanTable,
    drives: &mut [ChosenDrive],
) -> Option<SettledMotion> {
    let plain = level_up_to_which_softening_needs_no_check(table, drives);
    let mut settled = settle_at_largest_steady_safe_scale_if_any(table, drives, plain)?;
    if settled.scale > force_fraction_of_level(plain)
        && let Err(limited) = check_limits_during_rise_with_harmonics(table, drives, &settled)
    {
        settled = settle_at_largest_rise_safe_scale_if_any(
            table,
            drives,
            force_fraction_of_level(plain),
            settled.scale,
            limited,
        )?;
    }
    for drive in drives.iter_mut() {
        drive.force_n *= settled.scale;
    }
    Some(settled)
}

/// A level up to which the softening is too weak to need a check, found by bisection.
fn level_up_to_which_softening_needs_no_check(table: &PlanTable, drives: &[ChosenDrive]) -> u32 {
    let (mut plain, mut above) = (0, LEVELS + 1);
    let mut next = LEVELS;
    while above - plain > 1 {
        if is_within_limits_by_weak_softening_bound(table, drives, force_fraction_of_level(next)) {
            plain = next;
        } else {
            above = next;
        }
        next = u32::midpoint(plain, above);
    }
    plain
}

/// The largest scale up to which all steady motions are within the limits.
fn settle_at_largest_steady_safe_scale_if_any(
    table: &PlanTable,
    drives: &[ChosenDrive],
    mut weak_level: u32,
) -> Option<SettledMotion> {
    let mut low = force_fraction_of_level(weak_level);
    let mut known = match solve_safe_motion_at_scale(table, drives, low, None) {
        Ok(settled) => settled,
        Err(_) => {
            (weak_level, low) = (0, 0.0);
            solve_safe_motion_at_scale(table, drives, 0.0, None).ok()?
        }
    };
    for level in weak_level + 1..=LEVELS {
        match solve_safe_motion_at_scale(table, drives, force_fraction_of_level(level), Some((&known, low))) {
            Ok(settled) => (known, low) = (settled, force_fraction_of_level(level)),
            Err(mut limited) => {
                let mut high = force_fraction_of_level(level);
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (low + high);
                    match solve_safe_motion_at_scale(table, drives, middle, Some((&known, low))) {
                        Ok(settled) => (known, low) = (settled, middle),
                        Err(closer) => (limited, high) = (closer, middle),
                    }
                }
                return Some(SettledMotion { limited: Some(limited), ..known });
            }
        }
    }
    Some(known)
}

/// The largest scale between `low_scale`, which needs no check, and `high_scale`, at which the rise breaks a limit, at which the
/// rise is safe.
fn settle_at_largest_rise_safe_scale_if_any(
    table: &PlanTable,
    drives: &[ChosenDrive],
    mut low_scale: f64,
    mut high_scale: f64,
    mut limited: (usize, Limit),
) -> Option<SettledMotion> {
    let mut known = None;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low_scale + high_scale);
        let found = solve_safe_motion_at_scale(table, drives, middle, None)
            .and_then(|settled| check_limits_during_rise_with_harmonics(table, drives, &settled).map(|()| settled));
        match found {
            Ok(settled) => (known, low_scale) = (Some(settled), middle),
            Err(closer) => (limited, high_scale) = (closer, middle),
        }
    }
    let known = known.or_else(|| solve_safe_motion_at_scale(table, drives, low_scale, None).ok())?;
    Some(SettledMotion { limited: Some(limited), ..known })
}

/// Whether the motion of the fundamentals is within the limits, by a bound that needs no nonlinear solution, for
/// forces times `force_scale`. With e the sum of the softenings times the receptances of what they soften, each turn from
/// force to travel to force adds at most e of the largest travel, all of them e / (1 - e). The softening is that of
/// gaps closed by a given fraction; motions begin at rest and grow steadily with the voltages, so none goes beyond
/// that fraction if those within it do not. The travel that switching on adds has a reserve for its own softening
/// (`SOFTENING_GROWTH` in `table/forces.rs`).
fn is_within_limits_by_weak_softening_bound(table: &PlanTable, drives: &[ChosenDrive], force_scale: f64) -> bool {
    let applied = compute_rail_voltages_and_pulse_widths_at_scale(table, drives, force_scale);
    let p = drives.len().min(MAX_ACTUATORS);
    let (mut travel, mut largest) = ([0.0; MAX_ACTUATORS], 0.0);
    for (j, drive) in drives.iter().enumerate().take(p) {
        let Some(entry) = drive.row.get(j) else { return false };
        let own =
            bound_travel_with_harmonics_and_overshoot_m_per_n(entry, applied[j].pulse_width, applied[j].voltage_v);
        travel.iter_mut().zip(own).for_each(|(travel, own)| *travel += own * drive.force_n * force_scale);
        largest += own.iter().take(p).copied().fold(0.0, f64::max) * drive.force_n * force_scale;
    }
    let is_within = |closed: f64| {
        let softening = |i: usize| {
            table
                .electrodes
                .get(i)
                .map_or(0.0, |electrodes| electrodes.max_softening_n_per_m(applied[i].voltage_v, closed))
        };
        let turn = |drive: &ChosenDrive| -> f64 {
            let into = |j: usize| drive.row.get(j).map_or(0.0, |entry| entry.travel.iter().map(|z| z.norm()).sum());
            (0..p).map(|j| into(j) * softening(j)).sum()
        };
        let most = drives.iter().map(turn).fold(0.0, f64::max);
        if most >= 1.0 || find_first_actuator_near_pull_in_if_any(table, &std::array::from_fn(softening)).is_some() {
            return false;
        }
        // Each mass goes as far as it does, and, at each frequency, as any other goes for what the turns add.
        let added = most / (1.0 - most) * largest;
        table.electrodes.iter().zip(travel).zip(&applied).take(p).all(|((electrodes, travel), applied)| {
            let travel = travel + added;
            travel <= closed * electrodes.gap_m
                && electrodes.first_violated_limit_if_any(travel, applied.voltage_v * (1.0 - 1e-12)).is_none()
        })
    };
    CLOSED.into_iter().any(is_within)
}

/// The first actuator whose mass is close to pull-in: steady softenings times static receptances reach 1 at pull-in,
/// whatever the frequency of its drive.
fn find_first_actuator_near_pull_in_if_any(
    table: &PlanTable,
    softening_n_per_m: &[f64; MAX_ACTUATORS],
) -> Option<usize> {
    // A mass that a press holds off its middle is held by less.
    let taken: [f64; MAX_ACTUATORS] = std::array::from_fn(|j| {
        let pressed = table.electrodes.get(j).map_or(1.0, Electrodes::softening_under_press_relative_to_rest);
        softening_n_per_m[j].max(0.0) * pressed
    });
    let p = table.electrodes.len().min(MAX_ACTUATORS);
    table.static_receptance.iter().take(p).position(|row| {
        let part: f64 = row.iter().zip(taken).take(p).map(|(g, softening)| g * softening).sum();
        part > MAX_SOFTENING_FRACTION || part.is_nan()
    })
}

/// The motion for forces times `force_scale` if it is within all limits; it is continued from the motion `known_motion_and_scale` at a lower
/// scale, if there is one.
fn solve_safe_motion_at_scale(
    table: &PlanTable,
    drives: &[ChosenDrive],
    force_scale: f64,
    known_motion_and_scale: Option<(&SettledMotion, f64)>,
) -> Result<SettledMotion, (usize, Limit)> {
    let applied = compute_rail_voltages_and_pulse_widths_at_scale(table, drives, force_scale);
    check_total_mean_supply_current_with_error_naming_actuator_0(table, drives, &applied)?;
    let problem = build_driven_panel(table, drives, applied);
    let (transducers, excitations) = (problem.transducers(), problem.excitations());
    let motion = match known_motion_and_scale {
        Some((known, low)) if low > 0.0 => solve_steady_motion_starting_from_scaled_known_motion(
            transducers,
            excitations,
            &problem.lines,
            &known.motion,
            force_scale / low,
        ),
        _ => problem.solve_steady_motion(),
    };
    let motion =
        motion.map_err(|error| find_actuator_of_motion_error_and_name_travel_as_limit(table, error, &applied))?;
    if let Some(actuator) = find_first_actuator_near_pull_in_if_any(table, &motion.softening_n_per_m) {
        return Err((actuator, Limit::PullIn));
    }
    let mut frequency_of_line = [0; MAX_LINES];
    for (place, leader) in frequency_of_line.iter_mut().zip(&problem.leaders) {
        *place = *leader;
    }
    let settled = SettledMotion {
        applied,
        motion,
        frequency_of_line,
        lines: problem.leaders.len(),
        scale: force_scale,
        limited: None,
        is_quieted: false,
    };
    check_travel_with_harmonics_against_limits(table, drives, &settled, &motion.largest_m)?;
    Ok(settled)
}

/// Voltages and pulse widths for the drives' forces times `force_scale`. A rail has the highest voltage that one of its
/// drives needs, and the others on it get narrower windows with the same fundamental: the force is proportional to V^2.
fn compute_rail_voltages_and_pulse_widths_at_scale(
    table: &PlanTable,
    drives: &[ChosenDrive],
    force_scale: f64,
) -> [VoltageAndPulseWidth; MAX_ACTUATORS] {
    let mut applied = [VoltageAndPulseWidth::default(); MAX_ACTUATORS];
    let mut rails_v = [0.0_f64; RAILS];
    for (i, (drive, electrodes)) in drives.iter().zip(&table.electrodes).enumerate().take(MAX_ACTUATORS) {
        let pulse_width = drive.width.pulse_width;
        let voltage_v = electrodes.voltage_for_force_v(drive.force_n * force_scale, drive.frequency_hz, pulse_width);
        let voltage_v = voltage_v.min(electrodes.max_voltage_v);
        applied[i] = VoltageAndPulseWidth { voltage_v, pulse_width };
        if let Some(rail_v) = rails_v.get_mut(rail_index_of_channel(i)) {
            *rail_v = rail_v.max(voltage_v);
        }
    }
    for (i, (applied, drive)) in applied.iter_mut().zip(drives).enumerate() {
        let rail_v = rails_v.get(rail_index_of_channel(i)).copied().unwrap_or(applied.voltage_v);
        if applied.voltage_v > 0.0 && rail_v > applied.voltage_v {
            let Some(electrodes) = table.electrodes.get(i) else { continue };
            let force_fraction = (applied.voltage_v / rail_v).powi(2);
            let charging = electrodes.charging_at(drive.frequency_hz);
            let pulse_width = charging.find_pulse_width_for_force_fraction(applied.pulse_width, force_fraction);
            *applied = VoltageAndPulseWidth { voltage_v: rail_v, pulse_width };
        }
    }
    applied
}

/// Checks the mean current of all electrodes, each charged once a period, and of the rails' bleeders against the supply.
fn check_total_mean_supply_current_with_error_naming_actuator_0(
    table: &PlanTable,
    drives: &[ChosenDrive],
    applied: &[VoltageAndPulseWidth; MAX_ACTUATORS],
) -> Result<(), (usize, Limit)> {
    let charged = drives.iter().zip(applied).enumerate();
    let amps = mean_supply_current_with_bleeders_a(
        &table.electrodes,
        charged.map(|(channel, (drive, applied))| (channel, applied.voltage_v, drive.frequency_hz)),
    );
    if amps <= max_mean_supply_current_a() { Ok(()) } else { Err((0, Limit::Supply)) }
}

/// Peak acceleration in m/s^2 of the steady motion at the point with mode shapes `shape`: equation 23 over the total
/// forces.
pub(crate) fn settled_peak_acceleration_at_point_m_per_s2(
    drives: &[ChosenDrive],
    settled: &SettledMotion,
    shape: &DVector<f64>,
) -> f64 {
    let line = |l: usize| {
        let row = &drives[settled.frequency_of_line[l]].row;
        let all = row.iter().zip(&settled.motion.force_n[l]);
        all.map(|(entry, force)| {
            crate::table::acceleration_at_point_from_coordinates(shape, &entry.acceleration) * force
        })
        .sum::<Complex64>()
        .norm()
    };
    (0..settled.lines).map(line).sum()
}
