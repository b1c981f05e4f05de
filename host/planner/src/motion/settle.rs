//! The last word on every plan: what the actuators do with the forces that their gaps make of the voltages.
//!
//! The search takes the force of the mass at rest. Here the steady motion with the force as it depends on the travel
//! ([`crate::physics::softening`]) decides: where any actuator would travel beyond a third of its gap or be pulled in, or its voltage (its rail's)
//! break down the gap that is left, or the supply deliver more than it can, all forces are scaled down together until none does.
//! Where the electrodes soften much, [`crate::motion::strong_softening`] looks at the way there, and at what moves beside it.

use crate::chosen_drive::Chosen;
use crate::motion::driven_panel::{Applied, Settled, build_driven_panel, check_limits, locate_failure};
use crate::motion::strong_softening::check_rise_and_harmonics;
use crate::physics::limits::{Electrodes, HALVINGS, HELD, LEVELS, Limit, TRAVEL_PART, most_mean_current_a};
use crate::physics::softening::{MAX_LINES, follow};
use crate::scene::MAX_ACTUATORS;
use crate::table::{PlanTable, travel_m_per_n};
use era_shared::supply::{RAILS, rail_index_of_channel};
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::FRAC_PI_2;

/// Parts of the gap up to which motions are shown to stay: the third that is allowed, and less, where the softening is weaker.
const CLOSED: [f64; 3] = [TRAVEL_PART, 0.2, 0.1];

fn part_of(level: u32) -> f64 {
    f64::from(level) / f64::from(LEVELS)
}

/// Makes drives safe; `None` if they are at no scale, which a softened spring beyond pull-in would be.
///
/// The rails rise within a tenth of a second, and an ERA whose resonance the softening moves across its drive's frequency
/// goes furthest on the way. So all levels up to the last are looked at, and then the way itself, unless the softening is
/// too weak to move anything that far.
pub(crate) fn settle_drives(table: &PlanTable, drives: &mut [Chosen]) -> Option<Settled> {
    let plain = find_weak_softening_level(table, drives);
    let mut settled = find_steady_scale(table, drives, plain)?;
    if settled.scale > part_of(plain)
        && let Err(limited) = check_rise_and_harmonics(table, drives, &settled)
    {
        settled = find_rise_safe_scale(table, drives, part_of(plain), settled.scale, limited)?;
    }
    for drive in drives.iter_mut() {
        drive.force_n *= settled.scale;
    }
    Some(settled)
}

/// A level up to which nothing needs looking at, found by halving.
fn find_weak_softening_level(table: &PlanTable, drives: &[Chosen]) -> u32 {
    let (mut plain, mut above) = (0, LEVELS + 1);
    let mut next = LEVELS;
    while above - plain > 1 {
        if is_weakly_softened(table, drives, part_of(next)) {
            plain = next;
        } else {
            above = next;
        }
        next = u32::midpoint(plain, above);
    }
    plain
}

/// The largest scale up to which there are steady motions within the limits.
fn find_steady_scale(table: &PlanTable, drives: &[Chosen], mut plain: u32) -> Option<Settled> {
    let mut low = part_of(plain);
    let mut known = match settle_at_scale(table, drives, low, None) {
        Ok(settled) => settled,
        Err(_) => {
            (plain, low) = (0, 0.0);
            settle_at_scale(table, drives, 0.0, None).ok()?
        }
    };
    for level in plain + 1..=LEVELS {
        match settle_at_scale(table, drives, part_of(level), Some((&known, low))) {
            Ok(settled) => (known, low) = (settled, part_of(level)),
            Err(mut limited) => {
                let mut high = part_of(level);
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (low + high);
                    match settle_at_scale(table, drives, middle, Some((&known, low))) {
                        Ok(settled) => (known, low) = (settled, middle),
                        Err(closer) => (limited, high) = (closer, middle),
                    }
                }
                return Some(Settled { limited: Some(limited), ..known });
            }
        }
    }
    Some(known)
}

/// The largest scale between one that needs no looking at and one that is not safe on the way to it, at which the way is.
fn find_rise_safe_scale(
    table: &PlanTable,
    drives: &[Chosen],
    mut low: f64,
    mut high: f64,
    mut limited: (usize, Limit),
) -> Option<Settled> {
    let mut known = None;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        let found = settle_at_scale(table, drives, middle, None)
            .and_then(|settled| check_rise_and_harmonics(table, drives, &settled).map(|()| settled));
        match found {
            Ok(settled) => (known, low) = (Some(settled), middle),
            Err(closer) => (limited, high) = (closer, middle),
        }
    }
    let known = known.or_else(|| settle_at_scale(table, drives, low, None).ok())?;
    Some(Settled { limited: Some(limited), ..known })
}

/// Whether the fundamentals' motion on the way is within the limits for the sum e of the softenings times the receptances of what they
/// soften: each turn of force to travel to force adds at most e of the largest travel, all of them e / (1 - e). The
/// softening is that of gaps closed by a part; as all motions begin at rest and grow steadily with the voltages, none goes
/// beyond that part if those within it do not. For forces times `scale`. What switching on adds has room for its own softening
/// in the figure itself (`GROWN` in `table/forces.rs`).
fn is_weakly_softened(table: &PlanTable, drives: &[Chosen], scale: f64) -> bool {
    let applied = compute_applied(table, drives, scale);
    let p = drives.len().min(MAX_ACTUATORS);
    let (mut travel, mut largest) = ([0.0; MAX_ACTUATORS], 0.0);
    for (j, drive) in drives.iter().enumerate().take(p) {
        let Some(entry) = drive.row.get(j) else { return false };
        let own = travel_m_per_n(entry, applied[j].pulse_width, applied[j].voltage_v);
        travel.iter_mut().zip(own).for_each(|(travel, own)| *travel += own * drive.force_n * scale);
        largest += own.iter().take(p).copied().fold(0.0, f64::max) * drive.force_n * scale;
    }
    let is_within = |closed: f64| {
        let softening = |i: usize| {
            table.electrodes.get(i).map_or(0.0, |electrodes| electrodes.softening(applied[i].voltage_v, closed))
        };
        let turn = |drive: &Chosen| -> f64 {
            let into = |j: usize| drive.row.get(j).map_or(0.0, |entry| entry.travel.iter().map(|z| z.norm()).sum());
            (0..p).map(|j| into(j) * softening(j)).sum()
        };
        let most = drives.iter().map(turn).fold(0.0, f64::max);
        if most >= 1.0 || find_pulled_in_actuator(table, &std::array::from_fn(softening)).is_some() {
            return false;
        }
        // Each mass goes as far as it does, and, at each frequency, as any other goes for what the turns add.
        let added = most / (1.0 - most) * largest;
        table.electrodes.iter().zip(travel).zip(&applied).take(p).all(|((electrodes, travel), applied)| {
            let travel = travel + added;
            travel <= closed * electrodes.gap_m
                && electrodes.violated(travel, applied.voltage_v * (1.0 - 1e-12)).is_none()
        })
    };
    CLOSED.into_iter().any(is_within)
}

/// An actuator whose mass is hardly held any more: steady softenings times what masses yield to steady forces, which at 1
/// pull one in whatever the frequency of its drive.
fn find_pulled_in_actuator(table: &PlanTable, softening_n_per_m: &[f64; MAX_ACTUATORS]) -> Option<usize> {
    // A mass that a press holds off its middle is held by less.
    let taken: [f64; MAX_ACTUATORS] = std::array::from_fn(|j| {
        let pressed = table.electrodes.get(j).map_or(1.0, Electrodes::pressed_softening);
        softening_n_per_m[j].max(0.0) * pressed
    });
    let p = table.electrodes.len().min(MAX_ACTUATORS);
    table.static_receptance.iter().take(p).position(|row| {
        let part: f64 = row.iter().zip(taken).take(p).map(|(g, softening)| g * softening).sum();
        part > HELD || part.is_nan()
    })
}

/// The motion for forces times `scale`, if it is within all limits; from one `known` at a lower scale, if there is one.
fn settle_at_scale(
    table: &PlanTable,
    drives: &[Chosen],
    scale: f64,
    known: Option<(&Settled, f64)>,
) -> Result<Settled, (usize, Limit)> {
    let applied = compute_applied(table, drives, scale);
    check_supply_current(table, drives, &applied)?;
    let problem = build_driven_panel(table, drives, applied);
    let (transducers, excitations) = (problem.transducers(), problem.excitations());
    let motion = match known {
        Some((known, low)) if low > 0.0 => follow(transducers, excitations, &problem.lines, &known.motion, scale / low),
        _ => problem.settled(),
    };
    let motion = motion.map_err(|error| locate_failure(table, error, &applied))?;
    if let Some(actuator) = find_pulled_in_actuator(table, &motion.softening_n_per_m) {
        return Err((actuator, Limit::PullIn));
    }
    let mut frequency_of_line = [0; MAX_LINES];
    for (place, leader) in frequency_of_line.iter_mut().zip(&problem.leaders) {
        *place = *leader;
    }
    let settled = Settled {
        applied,
        motion,
        frequency_of_line,
        lines: problem.leaders.len(),
        scale,
        limited: None,
        is_quieted: false,
    };
    check_limits(table, drives, &settled, &motion.largest_m)?;
    Ok(settled)
}

/// Voltages and pulse widths for the drives' forces times `scale`. A rail has the highest voltage that is asked of it, and
/// the others on it get narrower windows of the same fundamental: V^2 sin(pi w/2) is the force's measure.
fn compute_applied(table: &PlanTable, drives: &[Chosen], scale: f64) -> [Applied; MAX_ACTUATORS] {
    let mut applied = [Applied::default(); MAX_ACTUATORS];
    let mut rails_v = [0.0_f64; RAILS];
    for (i, (drive, electrodes)) in drives.iter().zip(&table.electrodes).enumerate().take(MAX_ACTUATORS) {
        let pulse_width = drive.width.pulse_width;
        let voltage_v = electrodes.voltage_for(drive.force_n * scale, pulse_width).min(electrodes.max_voltage_v);
        applied[i] = Applied { voltage_v, pulse_width };
        if let Some(rail_v) = rails_v.get_mut(rail_index_of_channel(i)) {
            *rail_v = rail_v.max(voltage_v);
        }
    }
    for (i, applied) in applied.iter_mut().enumerate().take(drives.len()) {
        let rail_v = rails_v.get(rail_index_of_channel(i)).copied().unwrap_or(applied.voltage_v);
        if applied.voltage_v > 0.0 && rail_v > applied.voltage_v {
            let part = (applied.voltage_v / rail_v).powi(2) * (FRAC_PI_2 * applied.pulse_width).sin();
            *applied = Applied { voltage_v: rail_v, pulse_width: part.asin() / FRAC_PI_2 };
        }
    }
    applied
}

/// The mean current of all electrodes, each charged once a period.
fn check_supply_current(
    table: &PlanTable,
    drives: &[Chosen],
    applied: &[Applied; MAX_ACTUATORS],
) -> Result<(), (usize, Limit)> {
    let current = |((drive, applied), electrodes): ((&Chosen, &Applied), &Electrodes)| {
        electrodes.mean_current_a(applied.voltage_v, drive.frequency_hz)
    };
    let amps: f64 = drives.iter().zip(applied).zip(&table.electrodes).map(current).sum();
    if amps <= most_mean_current_a() { Ok(()) } else { Err((0, Limit::Supply)) }
}

/// Peak acceleration in m/s^2 at the point with mode shapes `shape`, of the steady motion: equation 23 over the total
/// forces.
pub(crate) fn settled_peak_m_per_s2(drives: &[Chosen], settled: &Settled, shape: &DVector<f64>) -> f64 {
    let line = |l: usize| {
        let row = &drives[settled.frequency_of_line[l]].row;
        let all = row.iter().zip(&settled.motion.force_n[l]);
        all.map(|(entry, force)| crate::table::at_point(shape, &entry.acceleration) * force).sum::<Complex64>().norm()
    };
    (0..settled.lines).map(line).sum()
}
