//! What a plan's motion is to the one before and the one after: how far masses go when it is switched on, with the rails up
//! or with them, and what it leaves when it ends.
//!
//! A plan is safe from rest, its rails rising. Its forces are those of the settled motion, softening included, so that the
//! panel beside them is linear: the steady motion is a sum over the panel's poles ([`SwitchOnModel`]), each of
//! which goes on by itself, and decays, once the forces have ended. [`crate::motion::residual`] adds up what several plans leave.

use crate::chosen_drive::{
    ChosenDrive, VoltageAndPulseWidth, window_phase_of_each_drive_keeping_relative_force_phases_rad,
};
use crate::drive::Drive;
use crate::motion::driven_panel::build_driven_panel;
use crate::motion::driven_panel::{UNMODELLED_TRAVEL, bound_harmonic_travel_of_each_mass_in_gaps_at_rest_m};
use crate::motion::strong_softening::CLOSING;
use crate::motion::strong_softening::{
    bound_travel_added_by_harmonics_and_combinations_m, largest_fundamental_travel_while_rails_rise_if_poles_known_m,
};
use crate::physics::limits::{Electrodes, MAX_TRAVEL_FRACTION};
use crate::physics::rise::{Participation, SwitchOnModel};
use crate::physics::softening::{Line, Motion};
use crate::scene::MAX_ACTUATORS;
use crate::table::{HARMONICS, PlanTable, SOFTENING_GROWTH};
use era_shared::limits::RAIL_SLOPE_MILLIVOLTS_PER_MS;
use num_complex::Complex64;

/// Part of the limit up to which travel that begins at once stands for travel that begins softly.
const WEAK: f64 = 0.5;

/// A burst of windows ends like a drive of this frequency in Hz: within one slot of 1 ms.
const WINDOWS_HZ: f64 = 1000.0;

/// Most softening, as a fraction of the static stiffness, that [`PlanMotion::growth`] is computed for: a growth of 4.5. Electrodes that soften
/// more pull the mass outwards, but windows last some ms only: 2000 random effects, with clicks 60 ms apart on panels whose electrodes take
/// 60 % of the stiffness, stay within the limit.
const MAX_SOFTENING_UNDER_FREE_MOTION: f64 = 0.95;

/// One number for each actuator.
pub type PerActuator = [f64; MAX_ACTUATORS];

/// How far a plan takes every mass, and what it leaves.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanMotion {
    /// Most travel allowed in m: a third of the gap; infinite for actuators that there are not.
    pub limit_m: PerActuator,
    /// Bound of the steady travel in m.
    pub steady_m: PerActuator,
    /// The same when the drives begin at once, their rails up, on a panel at rest.
    pub at_once_m: PerActuator,
    /// The same when the rails rise with them.
    pub soft_m: PerActuator,
    /// How many times as far masses go under it that already move: electrodes take a part c off what holds them, which a motion of the
    /// same energy grows by 1 / sqrt(1 - c) for.
    pub growth: PerActuator,
    /// The forces, frequency by frequency.
    pub lines: Vec<ForceLine>,
}

/// Forces at one frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceLine {
    /// The first actuator that is driven at it, or at the frequency of which it is a harmonic.
    pub channel: usize,
    /// Whether any other is.
    pub is_shared: bool,
    /// Which multiple of the drive's frequency.
    pub harmonic: u32,
    /// That frequency in Hz.
    pub drive_hz: f64,
    /// Its phase in rad.
    pub phase_rad: f64,
    /// How long its rail takes to rise, in s.
    pub rise_s: f64,
    /// What it does to every pole.
    pub participations: Vec<Participation>,
}

/// One drive of an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectForce {
    /// The actuator.
    pub channel: usize,
    /// In Hz.
    pub frequency_hz: f64,
    /// Amplitude of the force's fundamental at full level in N, the mass at rest.
    pub force_n: f64,
    /// Levels, -1 to 1, of its periods.
    pub levels: Vec<f64>,
}

/// How far a plan's drives, with their responses, take the masses and what they leave; `None` where that cannot be told: at a
/// resonance without damping, or without poles.
pub(crate) fn bound_travel_and_free_motion_of_drives_if_poles_known(
    table: &PlanTable,
    chosen: &[ChosenDrive],
    drives: &[Drive],
) -> Option<PlanMotion> {
    let onset = table.switch_on_model()?;
    let applied = list_voltage_and_pulse_width_of_each_actuator(drives);
    let problem = build_driven_panel(table, chosen, applied);
    let motion = problem
        .solve_steady_motion()
        .unwrap_or_else(|_| build_motion_with_forces_as_at_travel_limits(chosen, &problem.lines, &problem.leaders));
    let mut lines = Vec::new();
    let (mut steady_m, mut at_once_m) = ([0.0; MAX_ACTUATORS], [0.0; MAX_ACTUATORS]);
    for ((leader, force_n), travel_m) in problem.leaders.iter().zip(&motion.force_n).zip(&motion.travel_m) {
        let frequency_hz = chosen.get(*leader)?.frequency_hz;
        let added = onset.bound_overshoot_of_each_mass_under_instant_switch_on_m(force_n, frequency_hz, travel_m);
        for (i, travel) in travel_m.iter().enumerate() {
            steady_m[i] += UNMODELLED_TRAVEL * travel.norm();
            at_once_m[i] += UNMODELLED_TRAVEL * (travel.norm() + SOFTENING_GROWTH * added[i]);
        }
        let rise_s = rail_rise_time_s(applied.get(*leader)?);
        lines.push(build_force_line(
            chosen,
            *leader,
            1,
            rise_s,
            onset.participation_of_each_pole_under_steady_drive(force_n, frequency_hz, rise_s),
        ));
    }
    let harmonic_m = bound_harmonic_travel_of_each_mass_in_gaps_at_rest_m(chosen, &applied, 1.0, &HARMONICS);
    let harmonics = build_odd_harmonic_force_lines(onset, chosen, &applied);
    for (mode, k) in onset.list_decay_rate_and_travel_of_each_pole().iter().zip(0..) {
        let left: f64 = harmonics
            .iter()
            .filter_map(|line| line.participations.get(k))
            .map(Participation::amplitude_ringing_after_force_ends)
            .sum();
        add_per_actuator(&mut at_once_m, &mode.travel.map(|travel| travel * left));
    }
    add_per_actuator(&mut steady_m, &harmonic_m);
    add_per_actuator(&mut at_once_m, &harmonic_m);
    lines.extend(harmonics);
    let limit_m = travel_limit_of_each_actuator_m(table);
    // What the plan was made for, unless it is told better; of weak ones it need not be.
    let mut soft_m = limit_m;
    if at_once_m.iter().zip(&limit_m).any(|(at_once, limit)| *at_once > WEAK * limit) {
        let already_counted_m =
            bound_harmonic_travel_of_each_mass_in_gaps_at_rest_m(chosen, &applied, 1.0, &CLOSING.map(f64::from));
        let besides_m =
            bound_travel_added_by_harmonics_and_combinations_m(table, chosen, &problem, &motion, &already_counted_m);
        let besides_m =
            besides_m.map_or([f64::INFINITY; MAX_ACTUATORS], |besides_m| besides_m.map(|m| UNMODELLED_TRAVEL * m));
        add_per_actuator(&mut steady_m, &besides_m);
        add_per_actuator(&mut at_once_m, &besides_m);
        if let Some(Ok(risen_m)) =
            largest_fundamental_travel_while_rails_rise_if_poles_known_m(table, chosen, &problem, &motion)
        {
            for (i, soft) in soft_m.iter_mut().enumerate() {
                *soft = soft.min(UNMODELLED_TRAVEL * risen_m[i] + besides_m[i] + harmonic_m[i]);
            }
        }
    }
    soft_m.iter_mut().zip(&at_once_m).for_each(|(soft, at_once)| *soft = soft.min(*at_once));
    let softening_n_per_m = bound_softening_of_each_drive_at_travel_limit_n_per_m(table, chosen, &applied, &motion);
    let growth = compute_factor_by_which_softening_grows_existing_motion(table, &softening_n_per_m);
    Some(PlanMotion { limit_m, steady_m, at_once_m, soft_m, growth, lines })
}

/// The softening of steady drives whose masses go, together with an earlier motion, as far as the limit: at rest it is the mean of both
/// electrodes, and the mean of (1 - x cos)^-3 over a swing of x gaps is (1 + x^2 / 2) (1 - x^2)^(-5/2) times that, 1.42 times at a third.
fn bound_softening_of_each_drive_at_travel_limit_n_per_m(
    table: &PlanTable,
    chosen: &[ChosenDrive],
    applied: &[VoltageAndPulseWidth; MAX_ACTUATORS],
    motion: &Motion,
) -> PerActuator {
    let square = MAX_TRAVEL_FRACTION * MAX_TRAVEL_FRACTION;
    let grown = (1.0 + square / 2.0) * (1.0 - square).powf(-2.5);
    let mut softening_n_per_m = motion.softening_n_per_m;
    let drives = chosen.iter().zip(applied).zip(&table.electrodes);
    for (softening, ((drive, applied), own)) in softening_n_per_m.iter_mut().zip(drives) {
        let at_rest = own.mean_softening_n_per_m_per_n(drive.frequency_hz, applied.pulse_width) * drive.force_n;
        if drive.force_n > 0.0 {
            *softening = softening.max(grown * at_rest);
        }
    }
    softening_n_per_m
}

/// What softenings in N/m make of motions that there are already ([`PlanMotion::growth`]).
fn compute_factor_by_which_softening_grows_existing_motion(
    table: &PlanTable,
    softening_n_per_m: &PerActuator,
) -> PerActuator {
    table.static_receptance.map(|row| {
        let taken: f64 = row.iter().zip(softening_n_per_m).map(|(g, s)| if *s > 0.0 { g * s } else { 0.0 }).sum();
        (1.0 - taken.min(MAX_SOFTENING_UNDER_FREE_MOTION)).powf(-0.5)
    })
}

/// How far an effect takes the masses, which is known (`travel_m`), and what it leaves; `None` without poles.
#[must_use]
pub fn build_motion_of_effect_with_known_travel_if_poles_known(
    table: &PlanTable,
    pushes: &[EffectForce],
    travel_m: &PerActuator,
) -> Option<PlanMotion> {
    let onset = table.switch_on_model()?;
    let line = |push: &EffectForce| {
        let closed = travel_m.get(push.channel)? / table.electrodes.get(push.channel)?.gap_m;
        let force_n = push.force_n / (1.0 - closed.min(MAX_TRAVEL_FRACTION)).powi(2);
        let participations =
            onset.compute_participation_of_each_pole_in_effect(push.channel, force_n, push.frequency_hz, &push.levels);
        let (channel, drive_hz) = (push.channel, push.frequency_hz);
        Some(ForceLine {
            channel,
            is_shared: false,
            harmonic: 1,
            drive_hz,
            phase_rad: 0.0,
            rise_s: 0.0,
            participations,
        })
    };
    let lines = pushes.iter().map(line).collect::<Option<Vec<_>>>()?;
    let [steady_m, at_once_m, soft_m] = [*travel_m; 3];
    let mut softening_n_per_m = [0.0; MAX_ACTUATORS];
    for push in pushes {
        if let (Some(s), Some(own)) = (softening_n_per_m.get_mut(push.channel), table.electrodes.get(push.channel)) {
            // The effect's own travel is known, but together with an earlier motion the mass goes as far as the limit.
            let grown = (1.0 - MAX_TRAVEL_FRACTION).powi(-3);
            *s = push.force_n * own.mean_softening_n_per_m_per_n(push.frequency_hz, 1.0) * grown;
        }
    }
    let growth = compute_factor_by_which_softening_grows_existing_motion(table, &softening_n_per_m);
    Some(PlanMotion { limit_m: travel_limit_of_each_actuator_m(table), steady_m, at_once_m, soft_m, growth, lines })
}

/// How far a burst of single windows takes the masses, which is known (`travel_m`), and what it leaves; `None` without poles. `channel_and_voltage_of_windows` has the
/// channel and the voltage in V of each, `pole_amplitudes_during_and_after` the largest amplitude of each pole while they are on, and that after them.
#[must_use]
pub fn build_motion_of_voltage_windows_with_known_travel_if_poles_known(
    table: &PlanTable,
    channel_and_voltage_of_windows: impl Iterator<Item = (usize, f64)>,
    pole_amplitudes_during_and_after: &[(f64, f64)],
    travel_m: &PerActuator,
) -> Option<PlanMotion> {
    let onset = table.switch_on_model()?;
    let mut voltages_v = [0.0_f64; MAX_ACTUATORS];
    for (channel, voltage_v) in channel_and_voltage_of_windows {
        let highest = voltages_v.get_mut(channel)?;
        *highest = highest.max(voltage_v);
    }
    let mut softening_n_per_m = [0.0; MAX_ACTUATORS];
    let mut gains_per_s = vec![0.0; pole_amplitudes_during_and_after.len()];
    let used = voltages_v.iter().zip(&table.electrodes).zip(travel_m).enumerate();
    for (channel, ((voltage_v, own), travel_m)) in used.filter(|(_, ((voltage_v, _), _))| **voltage_v > 0.0) {
        let closed = (travel_m / own.gap_m).min(MAX_TRAVEL_FRACTION);
        // The burst's own travel is known, but together with an earlier motion the mass goes as far as the limit.
        softening_n_per_m[channel] = own.max_softening_n_per_m(*voltage_v, MAX_TRAVEL_FRACTION);
        let force_n = own.force_at_rest_n_per_v2() * voltage_v * voltage_v / (1.0 - closed).powi(2);
        let pushed = onset.compute_participation_of_each_pole_in_effect(channel, force_n, WINDOWS_HZ, &[]);
        gains_per_s.iter_mut().zip(pushed).for_each(|(gain, own)| *gain += own.gain_per_s);
    }
    // Twice, as a pole stands for its conjugate too.
    let participation = |((most, left), gain_per_s): (&(f64, f64), &f64)| Participation {
        steady: [(2.0 * most).into(), Complex64::ZERO],
        free_amplitude_after_rise_or_effect: 2.0 * left,
        gain_per_s: *gain_per_s,
    };
    let line = ForceLine {
        channel: voltages_v.iter().position(|voltage_v| *voltage_v > 0.0).unwrap_or(0),
        is_shared: true,
        harmonic: 1,
        drive_hz: WINDOWS_HZ,
        phase_rad: 0.0,
        rise_s: 0.0,
        participations: pole_amplitudes_during_and_after.iter().zip(&gains_per_s).map(participation).collect(),
    };
    let [steady_m, at_once_m, soft_m] = [*travel_m; 3];
    let growth = compute_factor_by_which_softening_grows_existing_motion(table, &softening_n_per_m);
    let limit_m = travel_limit_of_each_actuator_m(table);
    Some(PlanMotion { limit_m, steady_m, at_once_m, soft_m, growth, lines: vec![line] })
}

/// A third of every gap in m; infinite for actuators that there are not.
pub(crate) fn travel_limit_of_each_actuator_m(table: &PlanTable) -> PerActuator {
    let mut limits = [f64::INFINITY; MAX_ACTUATORS];
    for (limit, electrodes) in limits.iter_mut().zip(&table.electrodes) {
        *limit = Electrodes::max_travel_m(electrodes);
    }
    limits
}

/// What a plan's drives apply to the electrodes.
pub(crate) fn list_voltage_and_pulse_width_of_each_actuator(drives: &[Drive]) -> [VoltageAndPulseWidth; MAX_ACTUATORS] {
    let mut applied = [VoltageAndPulseWidth::default(); MAX_ACTUATORS];
    for (applied, drive) in applied.iter_mut().zip(drives) {
        *applied = VoltageAndPulseWidth { voltage_v: drive.voltage_v, pulse_width: drive.pulse_width };
    }
    applied
}

impl Participation {
    /// Amplitude that is left when the force ends.
    #[must_use]
    pub fn amplitude_ringing_after_force_ends(&self) -> f64 {
        self.steady.iter().map(|z| z.norm()).sum()
    }

    /// The same beside the steady motion of a part of a force that goes on in its place.
    #[must_use]
    pub fn amplitude_ringing_after_change_to_other_force(&self, next: &Self, next_fraction: f64) -> f64 {
        self.steady.iter().zip(&next.steady).map(|(z, next)| (z - next_fraction * next).norm()).sum()
    }
}

/// A motion that no force exceeds: those of masses that are all a third of their gaps off.
fn build_motion_with_forces_as_at_travel_limits(chosen: &[ChosenDrive], lines: &[Line], leaders: &[usize]) -> Motion {
    let grown = (1.0 - MAX_TRAVEL_FRACTION).powi(-2);
    let mut motion = Motion::REST;
    for ((line, leader), (force_n, travel_m)) in
        lines.iter().zip(leaders).zip(motion.force_n.iter_mut().zip(&mut motion.travel_m))
    {
        let hz = chosen.get(*leader).map(|drive| drive.frequency_hz);
        for (force, drive) in force_n.iter_mut().zip(chosen).filter(|(_, drive)| Some(drive.frequency_hz) == hz) {
            *force = Complex64::from_polar(grown * drive.force_n, drive.force_phase_rad);
        }
        for (travel, row) in travel_m.iter_mut().zip(&line.receptance) {
            *travel = row.iter().zip(force_n.iter()).map(|(g, force)| g * force).sum();
        }
    }
    motion
}

fn build_force_line(
    chosen: &[ChosenDrive],
    channel: usize,
    harmonic: u32,
    rise_s: f64,
    participations: Vec<Participation>,
) -> ForceLine {
    let (drive_hz, phase_rad) =
        chosen.get(channel).map_or((0.0, 0.0), |drive| (drive.frequency_hz, drive.force_phase_rad));
    let is_shared = chosen.iter().enumerate().any(|(i, drive)| i != channel && drive.frequency_hz == drive_hz);
    ForceLine { channel, is_shared, harmonic, drive_hz, phase_rad, rise_s, participations }
}

/// The lines of the odd harmonics of all drives.
fn build_odd_harmonic_force_lines(
    onset: &SwitchOnModel,
    chosen: &[ChosenDrive],
    applied: &[VoltageAndPulseWidth; MAX_ACTUATORS],
) -> Vec<ForceLine> {
    let mut lines = Vec::new();
    let window_phases = window_phase_of_each_drive_keeping_relative_force_phases_rad(chosen, applied);
    let driven = chosen.iter().zip(applied).enumerate().filter(|(_, (drive, _))| drive.force_n > 0.0);
    for (j, (drive, applied)) in driven {
        let Some(own) = drive.row.get(j) else { continue };
        for (n, harmonic) in HARMONICS.into_iter().zip((3..).step_by(2)) {
            let mut force_n = [Complex64::ZERO; MAX_ACTUATORS];
            let part =
                own.charging.force_harmonic_phasor_over_fundamental_amplitude(n, applied.pulse_width) * drive.force_n;
            force_n[j] = Complex64::cis(n * window_phases[j]) * part;
            let rise_s = rail_rise_time_s(applied);
            let participations =
                onset.participation_of_each_pole_under_steady_drive(&force_n, n * drive.frequency_hz, rise_s);
            lines.push(build_force_line(chosen, j, harmonic, rise_s, participations));
        }
    }
    lines
}

/// How long a rail takes to a drive's voltage.
fn rail_rise_time_s(applied: &VoltageAndPulseWidth) -> f64 {
    applied.voltage_v / f64::from(RAIL_SLOPE_MILLIVOLTS_PER_MS)
}

fn add_per_actuator(sum: &mut PerActuator, more: &PerActuator) {
    sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
}
