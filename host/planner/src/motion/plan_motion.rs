//! What a plan's motion is to the one before and the one after: how far masses go when it is switched on, with the rails up
//! or with them, and what it leaves when it ends.
//!
//! A plan is safe from rest, its rails rising. Its forces are those of the settled motion, softening included, so that the
//! panel beside them is linear: the steady motion is a sum over the panel's poles ([`Onset`]), each of
//! which goes on by itself, and decays, once the forces have ended. [`crate::motion::residual`] adds up what several plans leave.

use crate::chosen_drive::Chosen;
use crate::drive::Drive;
use crate::motion::driven_panel::build_driven_panel;
use crate::motion::driven_panel::{Applied, LEFT_OUT, harmonics_m};
use crate::motion::strong_softening::CLOSING;
use crate::motion::strong_softening::{bound_added_travel_m, compute_rise_travel_m};
use crate::physics::limits::{Electrodes, HELD, TRAVEL_PART};
use crate::physics::rise::{Onset, Participation};
use crate::physics::softening::{Line, Motion};
use crate::scene::MAX_ACTUATORS;
use crate::table::{GROWN, HARMONICS, PlanTable, harmonic_part};
use era_shared::limits::RAIL_SLOPE_MILLIVOLTS_PER_MS;
use num_complex::Complex64;

/// Part of the limit up to which travel that begins at once stands for travel that begins softly.
const WEAK: f64 = 0.5;

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
pub struct Push {
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
pub(crate) fn predict_drive_motion(table: &PlanTable, chosen: &[Chosen], drives: &[Drive]) -> Option<PlanMotion> {
    let onset = table.onset()?;
    let applied = applied(drives);
    let problem = build_driven_panel(table, chosen, applied);
    let motion = problem.settled().unwrap_or_else(|_| at_most(chosen, &problem.lines, &problem.leaders));
    let mut lines = Vec::new();
    let (mut steady_m, mut at_once_m) = ([0.0; MAX_ACTUATORS], [0.0; MAX_ACTUATORS]);
    for ((leader, force_n), travel_m) in problem.leaders.iter().zip(&motion.force_n).zip(&motion.travel_m) {
        let frequency_hz = chosen.get(*leader)?.frequency_hz;
        let added = onset.overshoots_at_once(force_n, frequency_hz, travel_m);
        for (i, travel) in travel_m.iter().enumerate() {
            steady_m[i] += LEFT_OUT * travel.norm();
            at_once_m[i] += LEFT_OUT * (travel.norm() + GROWN * added[i]);
        }
        let rise_s = rise_s(applied.get(*leader)?);
        lines.push(line(chosen, *leader, 1, rise_s, onset.participations(force_n, frequency_hz, rise_s)));
    }
    let harmonic_m = harmonics_m(chosen, &applied, 1.0, &HARMONICS);
    let harmonics = harmonics(onset, chosen, &applied);
    for (mode, k) in onset.decaying_modes().iter().zip(0..) {
        let left: f64 = harmonics.iter().filter_map(|line| line.participations.get(k)).map(Participation::left).sum();
        add(&mut at_once_m, &mode.travel.map(|travel| travel * left));
    }
    add(&mut steady_m, &harmonic_m);
    add(&mut at_once_m, &harmonic_m);
    lines.extend(harmonics);
    let limit_m = travel_limits_m(table);
    // What the plan was made for, unless it is told better; of weak ones it need not be.
    let mut soft_m = limit_m;
    if at_once_m.iter().zip(&limit_m).any(|(at_once, limit)| *at_once > WEAK * limit) {
        let alone_m = harmonics_m(chosen, &applied, 1.0, &CLOSING.map(f64::from));
        let besides_m = bound_added_travel_m(table, chosen, &problem, &motion, &alone_m);
        let besides_m = besides_m.map_or([f64::INFINITY; MAX_ACTUATORS], |besides_m| besides_m.map(|m| LEFT_OUT * m));
        add(&mut steady_m, &besides_m);
        add(&mut at_once_m, &besides_m);
        if let Some(Ok(risen_m)) = compute_rise_travel_m(table, chosen, &problem, &motion) {
            for (i, soft) in soft_m.iter_mut().enumerate() {
                *soft = soft.min(LEFT_OUT * risen_m[i] + besides_m[i] + harmonic_m[i]);
            }
        }
    }
    soft_m.iter_mut().zip(&at_once_m).for_each(|(soft, at_once)| *soft = soft.min(*at_once));
    let growth = compute_growth(table, &motion.softening_n_per_m);
    Some(PlanMotion { limit_m, steady_m, at_once_m, soft_m, growth, lines })
}

/// What softenings in N/m make of motions that there are already ([`PlanMotion::growth`]).
fn compute_growth(table: &PlanTable, softening_n_per_m: &PerActuator) -> PerActuator {
    table.static_receptance.map(|row| {
        let taken: f64 = row.iter().zip(softening_n_per_m).map(|(g, s)| if *s > 0.0 { g * s } else { 0.0 }).sum();
        (1.0 - taken.min(HELD)).powf(-0.5)
    })
}

/// How far an effect takes the masses, which is known (`travel_m`), and what it leaves; `None` without poles.
#[must_use]
pub fn predict_effect_motion(table: &PlanTable, pushes: &[Push], travel_m: &PerActuator) -> Option<PlanMotion> {
    let onset = table.onset()?;
    let line = |push: &Push| {
        let closed = travel_m.get(push.channel)? / table.electrodes.get(push.channel)?.gap_m;
        let force_n = push.force_n / (1.0 - closed.min(TRAVEL_PART)).powi(2);
        let participations = onset.played(push.channel, force_n, push.frequency_hz, &push.levels);
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
            let closed = (travel_m.get(push.channel)? / own.gap_m).min(TRAVEL_PART);
            *s = push.force_n * own.softening_per_newton(1.0) / (1.0 - closed).powi(3);
        }
    }
    let growth = compute_growth(table, &softening_n_per_m);
    Some(PlanMotion { limit_m: travel_limits_m(table), steady_m, at_once_m, soft_m, growth, lines })
}

/// A third of every gap in m; infinite for actuators that there are not.
pub(crate) fn travel_limits_m(table: &PlanTable) -> PerActuator {
    let mut limits = [f64::INFINITY; MAX_ACTUATORS];
    for (limit, electrodes) in limits.iter_mut().zip(&table.electrodes) {
        *limit = Electrodes::most_travel_m(electrodes);
    }
    limits
}

/// What a plan's drives apply to the electrodes.
pub(crate) fn applied(drives: &[Drive]) -> [Applied; MAX_ACTUATORS] {
    let mut applied = [Applied::default(); MAX_ACTUATORS];
    for (applied, drive) in applied.iter_mut().zip(drives) {
        *applied = Applied { voltage_v: drive.voltage_v, pulse_width: drive.pulse_width };
    }
    applied
}

impl Participation {
    /// Amplitude that is left when the force ends.
    #[must_use]
    pub fn left(&self) -> f64 {
        self.steady.iter().map(|z| z.norm()).sum()
    }

    /// The same beside the steady motion of a part of a force that goes on in its place.
    #[must_use]
    pub fn left_beside(&self, next: &Self, part: f64) -> f64 {
        self.steady.iter().zip(&next.steady).map(|(z, next)| (z - part * next).norm()).sum()
    }
}

/// A motion that no force exceeds: those of masses that are all a third of their gaps off.
fn at_most(chosen: &[Chosen], lines: &[Line], leaders: &[usize]) -> Motion {
    let grown = (1.0 - TRAVEL_PART).powi(-2);
    let mut motion = Motion::REST;
    for ((line, leader), (force_n, travel_m)) in
        lines.iter().zip(leaders).zip(motion.force_n.iter_mut().zip(&mut motion.travel_m))
    {
        let hz = chosen.get(*leader).map(|drive| drive.frequency_hz);
        for (force, drive) in force_n.iter_mut().zip(chosen).filter(|(_, drive)| Some(drive.frequency_hz) == hz) {
            *force = Complex64::from_polar(grown * drive.force_n, drive.phase_rad);
        }
        for (travel, row) in travel_m.iter_mut().zip(&line.receptance) {
            *travel = row.iter().zip(force_n.iter()).map(|(g, force)| g * force).sum();
        }
    }
    motion
}

fn line(
    chosen: &[Chosen],
    channel: usize,
    harmonic: u32,
    rise_s: f64,
    participations: Vec<Participation>,
) -> ForceLine {
    let (drive_hz, phase_rad) = chosen.get(channel).map_or((0.0, 0.0), |drive| (drive.frequency_hz, drive.phase_rad));
    let is_shared = chosen.iter().enumerate().any(|(i, drive)| i != channel && drive.frequency_hz == drive_hz);
    ForceLine { channel, is_shared, harmonic, drive_hz, phase_rad, rise_s, participations }
}

/// The lines of the odd harmonics of all drives.
fn harmonics(onset: &Onset, chosen: &[Chosen], applied: &[Applied; MAX_ACTUATORS]) -> Vec<ForceLine> {
    let mut lines = Vec::new();
    let driven = chosen.iter().zip(applied).enumerate().filter(|(_, (drive, _))| drive.force_n > 0.0);
    for (j, (drive, applied)) in driven {
        for (n, harmonic) in HARMONICS.into_iter().zip((3..).step_by(2)) {
            let mut force_n = [Complex64::ZERO; MAX_ACTUATORS];
            let amplitude = harmonic_part(n, applied.pulse_width) * drive.force_n;
            force_n[j] = Complex64::cis(n * drive.phase_rad) * amplitude;
            let rise_s = rise_s(applied);
            let participations = onset.participations(&force_n, n * drive.frequency_hz, rise_s);
            lines.push(line(chosen, j, harmonic, rise_s, participations));
        }
    }
    lines
}

/// How long a rail takes to a drive's voltage.
fn rise_s(applied: &Applied) -> f64 {
    applied.voltage_v / f64::from(RAIL_SLOPE_MILLIVOLTS_PER_MS)
}

fn add(sum: &mut PerActuator, more: &PerActuator) {
    sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
}
