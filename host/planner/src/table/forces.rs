//! How hard an actuator may be driven at a frequency: travel, switching on, pulse widths, force limits.

use super::entry::{Entry, HARMONICS, Width};
use crate::PULSE_WIDTH;
use crate::model::ReducedModel;
use crate::physics::limits::{Electrodes, HALVINGS, HELD, LEVELS, Limit, TRAVEL_PART, WEAK};
use crate::physics::rise::Onset;
use crate::physics::softening::{Excitation, Line, Transducer, settle};
use crate::scene::MAX_ACTUATORS;
use era_shared::limits::RAIL_SLOPE_MILLIVOLTS_PER_MS;
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::FRAC_PI_2;

/// Pulse widths to choose from. At 2/3 there is no third harmonic and no ninth, at 4/5 no fifth, at 6/7 no seventh; 0.72
/// has the least of all together.
pub(super) const WIDTHS: [f64; 4] = [PULSE_WIDTH, 0.72, 0.8, 6.0 / 7.0];
/// Least time between the two electrodes' windows in s: the board's guard of 200 us, and a tenth more for its rounding.
const GUARD_S: f64 = 220e-6;
/// No pulse is wider: beyond it nothing is gained (sin(pi w/2) is above 0.998).
pub const WIDEST: f64 = 0.96;
/// What the electrodes' pull makes of a motion of switching on that is as large as the gap allows: 1.24 times was seen in the
/// simulation of random panels.
pub(crate) const GROWN: f64 = 1.5;

/// Travel of every actuator for the model's coordinates.
pub(crate) fn travel_by(model: &ReducedModel, displacement: &DVector<Complex64>) -> [Complex64; MAX_ACTUATORS] {
    let mut travel = [Complex64::ZERO; MAX_ACTUATORS];
    for (other, travel) in travel.iter_mut().enumerate().take(model.count_actuators()) {
        *travel = model.actuator_travel(other, displacement);
    }
    travel
}

/// Most travel of every actuator per N of the fundamental with this pulse width, when the rail rises to `rail_v`.
pub(crate) fn travel_m_per_n(entry: &Entry, pulse_width: f64, rail_v: f64) -> [f64; MAX_ACTUATORS] {
    // A rail that rises no higher is up sooner, and leaves up to that much more of the free motions.
    let sooner = if rail_v > 0.0 { (entry.onset_v / rail_v).max(1.0) } else { 1.0 };
    let overshoot = entry.overshoot.map(|overshoot| overshoot * sooner);
    let motion = MotionPerN { travel: &entry.travel, harmonics: &entry.harmonic_travel, overshoot: &overshoot };
    travel_of(motion, pulse_width)
}

/// What the `first` few odd harmonics add to the travel of every actuator at most, per N of the fundamental.
pub(crate) fn harmonics_m_per_n(entry: &Entry, pulse_width: f64, first: usize) -> [f64; MAX_ACTUATORS] {
    harmonics_of(entry.harmonic_travel.get(..first).unwrap_or(&entry.harmonic_travel), pulse_width)
}

fn harmonics_of(harmonics: &[[f64; MAX_ACTUATORS]], pulse_width: f64) -> [f64; MAX_ACTUATORS] {
    let mut out = [0.0; MAX_ACTUATORS];
    for (n, row) in HARMONICS.iter().zip(harmonics) {
        let part = harmonic_part(*n, pulse_width).abs();
        out.iter_mut().zip(row).for_each(|(out, travel)| *out += part * travel);
    }
    out
}

/// What a newton of an actuator does to all masses.
#[derive(Clone, Copy)]
pub(super) struct MotionPerN<'a> {
    pub travel: &'a [Complex64; MAX_ACTUATORS],
    pub harmonics: &'a [[f64; MAX_ACTUATORS]; HARMONICS.len()],
    pub overshoot: &'a [f64; MAX_ACTUATORS],
}

/// What switching on adds to the travel of every mass when the rail rises to `onset_v`.
pub(super) fn overshoots(
    onset: Option<&Onset>,
    actuator: usize,
    frequency_hz: f64,
    onset_v: f64,
    travel: &[Complex64; MAX_ACTUATORS],
) -> [f64; MAX_ACTUATORS] {
    let rise_s = onset_v / f64::from(RAIL_SLOPE_MILLIVOLTS_PER_MS);
    // Without poles: a single one's whole motion.
    let added =
        onset.map_or(travel.map(|z| z.norm()), |onset| onset.overshoots(actuator, frequency_hz, rise_s, travel));
    added.map(|added| GROWN * added)
}

/// The same, and the voltage, for the most force that leaves room for it. Where travel limits the force the rail is up sooner,
/// which takes more room again.
pub(super) fn overshoots_at_most(
    onset: Option<&Onset>,
    actuator: usize,
    frequency_hz: f64,
    electrodes: &Electrodes,
    travel: &[Complex64; MAX_ACTUATORS],
) -> ([f64; MAX_ACTUATORS], f64) {
    const NEARLY: f64 = 0.9;
    let mut onset_v = electrodes.max_voltage_v;
    let mut overshoot = overshoots(onset, actuator, frequency_hz, onset_v, travel);
    for _ in 0..2 {
        let own = travel.get(actuator).map_or(0.0, |z| z.norm()) + overshoot.get(actuator).copied().unwrap_or(0.0);
        let (force_n, _) = electrodes.max_force(own, WIDEST);
        let most_v = electrodes.voltage_for(force_n, WIDEST);
        if most_v >= NEARLY * onset_v {
            break;
        }
        onset_v = most_v;
        overshoot = overshoots(onset, actuator, frequency_hz, onset_v, travel);
    }
    (overshoot, onset_v)
}

fn travel_of(motion: MotionPerN<'_>, pulse_width: f64) -> [f64; MAX_ACTUATORS] {
    let mut out = harmonics_of(motion.harmonics, pulse_width);
    for (out, (travel, overshoot)) in out.iter_mut().zip(motion.travel.iter().zip(motion.overshoot)) {
        *out += travel.norm() + overshoot;
    }
    out
}

/// What an actuator has for making force, and what it may take of what holds its mass.
#[derive(Clone, Copy)]
pub(super) struct Driver<'a> {
    pub electrodes: &'a Electrodes,
    pub transducer: &'a Transducer,
    /// Its mass's travel per steady force in m/N.
    pub static_receptance: f64,
}

pub(super) fn width_of(
    driver: Driver<'_>,
    actuator: usize,
    motion: MotionPerN<'_>,
    pulse_width: f64,
    [harmonics, felt_harmonics]: [f64; 2],
) -> Width {
    let Driver { electrodes, transducer, static_receptance } = driver;
    let travel_m_per_n = travel_of(motion, pulse_width);
    let own = travel_m_per_n.get(actuator).copied().unwrap_or(0.0);
    let most = electrodes.max_force(own, pulse_width);
    // What a bias already took off its spring is in the model.
    let by_pull_in = (HELD / static_receptance + transducer.counted_n_per_m)
        / (electrodes.softening_per_newton(pulse_width) * electrodes.pressed_softening());
    let most = if by_pull_in < most.0 { (by_pull_in, Limit::PullIn) } else { most };
    let receptance = motion.travel.get(actuator).copied().unwrap_or_default();
    let (max_force_n, limit) =
        safe_alone(electrodes, transducer, receptance, own - receptance.norm(), pulse_width, most);
    Width { pulse_width, harmonics, felt_harmonics, travel_m_per_n, max_force_n, limit }
}

/// `most` force, or as much of it as leaves an ERA that is driven alone within its limits on the whole way up to it, when its
/// force grows as its gap closes. `receptance` is its own travel in m/N, `harmonics` what harmonics and switching on add at most.
fn safe_alone(
    electrodes: &Electrodes,
    transducer: &Transducer,
    receptance: Complex64,
    harmonics: f64,
    pulse_width: f64,
    most: (f64, Limit),
) -> (f64, Limit) {
    let voltage_at = |force_n: f64| electrodes.voltage_for(force_n, pulse_width).min(electrodes.max_voltage_v);
    if electrodes.softening(voltage_at(most.0), TRAVEL_PART) * receptance.norm() <= WEAK {
        return most;
    }
    let mut matrix = [[Complex64::ZERO; MAX_ACTUATORS]; MAX_ACTUATORS];
    matrix[0][0] = receptance;
    let line = [Line { frequency: 0, harmonic: 1, receptance: matrix }];
    let violated = |force_n: f64| -> Option<Limit> {
        let voltage_v = voltage_at(force_n);
        let excitation = [Excitation { frequency: 0, voltage_v, pulse_width, phase_rad: 0.0 }];
        match settle(std::slice::from_ref(transducer), &excitation, &line) {
            Ok(motion) => electrodes.violated(motion.largest_m[0] + harmonics * force_n, voltage_v * (1.0 - 1e-12)),
            Err(_) => Some(Limit::Travel),
        }
    };
    let mut low = 0.0;
    for level in 1..=LEVELS {
        let mut high = most.0 * f64::from(level) / f64::from(LEVELS);
        let Some(mut limit) = violated(high) else {
            low = high;
            continue;
        };
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            match violated(middle) {
                None => low = middle,
                Some(closer) => (limit, high) = (closer, middle),
            }
        }
        return (low, limit);
    }
    most
}

/// Of `quieter` pulse widths the one whose harmonics move the panel least, and the widest.
pub(super) fn widths(frequency_hz: f64, quieter: &[f64], width: impl Fn(f64) -> Width) -> [Width; 2] {
    let widest = (1.0 - 2.0 * frequency_hz * GUARD_S).min(WIDEST);
    let usable = quieter.iter().filter(|pulse_width| **pulse_width <= widest).map(|pulse_width| width(*pulse_width));
    let quiet = usable.min_by(|a, b| a.harmonics.total_cmp(&b.harmonics)).unwrap_or_else(|| width(widest));
    [quiet, width(widest)]
}

/// Amplitude of a harmonic's force over the fundamental's: sin(n pi w/2) / (n sin(pi w/2)).
pub(crate) fn harmonic_part(n: f64, pulse_width: f64) -> f64 {
    (n * FRAC_PI_2 * pulse_width).sin() / (n * (FRAC_PI_2 * pulse_width).sin())
}
