//! How strongly an actuator may be driven at a frequency: travel, overshoot when it is switched on, pulse widths, force
//! limits.

use super::entry::{Entry, HARMONICS, PulseOption};
use crate::PULSE_WIDTH;
use crate::model::ReducedModel;
use crate::physics::charging::PeriodicCharging;
use crate::physics::limits::{
    Electrodes, HALVINGS, LEVELS, Limit, MAX_SOFTENING_FRACTION, MAX_TRAVEL_FRACTION, WEAK_SOFTENING,
};
use crate::physics::rise::SwitchOnModel;
use crate::physics::softening::{Excitation, Line, Transducer, solve_steady_motion};
use crate::scene::MAX_ACTUATORS;
use era_shared::limits::RAIL_SLOPE_MILLIVOLTS_PER_MS;
use nalgebra::DVector;
use num_complex::Complex64;

/// Pulse widths to choose from. Of electrodes that charge at once, at 2/3 there is no third harmonic and no ninth, at 4/5 no fifth, at 6/7 no seventh; 0.72
/// has the least of all together.
pub(super) const WIDTHS: [f64; 4] = [PULSE_WIDTH, 0.72, 0.8, 6.0 / 7.0];
/// Least time between the two electrodes' windows in s: the board's guard of 200 us, and a tenth more for its rounding.
const GUARD_S: f64 = 220e-6;
/// No pulse is wider: beyond it nothing is gained (sin(pi w/2) is above 0.998).
pub const WIDEST_PULSE: f64 = 0.96;
/// What the electrodes' pull makes of a motion of switching on that is as large as the gap allows: 1.24 times was seen in the
/// simulation of random panels.
pub(crate) const SOFTENING_GROWTH: f64 = 1.5;

/// Travel of every actuator for the given coordinates of a model.
pub(crate) fn compute_travel_of_each_actuator(
    model: &ReducedModel,
    displacement: &DVector<Complex64>,
) -> [Complex64; MAX_ACTUATORS] {
    let mut travel = [Complex64::ZERO; MAX_ACTUATORS];
    for (other, travel) in travel.iter_mut().enumerate().take(model.count_actuators()) {
        *travel = model.actuator_mass_travel_against_electrodes(other, displacement);
    }
    travel
}

/// Largest travel of every actuator in m per N of the fundamental with this pulse width, if the rail rises to
/// `rail_v`: fundamental, harmonics and the overshoot when the drive is switched on.
pub(crate) fn bound_travel_with_harmonics_and_overshoot_m_per_n(
    entry: &Entry,
    pulse_width: f64,
    rail_v: f64,
) -> [f64; MAX_ACTUATORS] {
    // A rail that rises no higher is up sooner, and leaves up to that much more of the free motions.
    let sooner = if rail_v > 0.0 { (entry.onset_v / rail_v).max(1.0) } else { 1.0 };
    let overshoot = entry.overshoot.map(|overshoot| overshoot * sooner);
    let motion = MotionPerN {
        travel: &entry.travel,
        harmonics: &entry.harmonic_travel,
        overshoot: &overshoot,
        charging: entry.charging,
    };
    sum_fundamental_harmonic_and_overshoot_travel_m_per_n(motion, pulse_width)
}

/// Largest travel in m that the `harmonic_count` odd harmonics add to every actuator, per N of the fundamental.
pub(crate) fn bound_travel_by_harmonics_above_fundamental_m_per_n(
    entry: &Entry,
    pulse_width: f64,
    harmonic_count: usize,
) -> [f64; MAX_ACTUATORS] {
    sum_weighted_harmonic_travel_of_each_actuator(
        entry.harmonic_travel.get(..harmonic_count).unwrap_or(&entry.harmonic_travel),
        entry.charging,
        pulse_width,
    )
}

/// Sum over harmonics of the travel of every actuator, weighted with the amplitude of the harmonic at this pulse
/// width.
fn sum_weighted_harmonic_travel_of_each_actuator(
    harmonics: &[[f64; MAX_ACTUATORS]],
    charging: PeriodicCharging,
    pulse_width: f64,
) -> [f64; MAX_ACTUATORS] {
    let mut out = [0.0; MAX_ACTUATORS];
    for (n, row) in HARMONICS.iter().zip(harmonics) {
        let part = charging.force_harmonic_phasor_over_fundamental_amplitude(*n, pulse_width).norm();
        out.iter_mut().zip(row).for_each(|(out, travel)| *out += part * travel);
    }
    out
}

/// Travel of all masses per newton of one actuator.
#[derive(Clone, Copy)]
pub(super) struct MotionPerN<'a> {
    pub travel: &'a [Complex64; MAX_ACTUATORS],
    pub harmonics: &'a [[f64; MAX_ACTUATORS]; HARMONICS.len()],
    pub overshoot: &'a [f64; MAX_ACTUATORS],
    pub charging: PeriodicCharging,
}

/// How much further every mass travels while the drive is switched on than in the steady motion, in m/N, if the rail
/// rises to `onset_v`.
pub(super) fn bound_overshoot_of_each_mass_or_whole_motion_m_per_n(
    onset: Option<&SwitchOnModel>,
    actuator: usize,
    frequency_hz: f64,
    onset_v: f64,
    travel: &[Complex64; MAX_ACTUATORS],
) -> [f64; MAX_ACTUATORS] {
    let rise_s = onset_v / f64::from(RAIL_SLOPE_MILLIVOLTS_PER_MS);
    // Without poles: a single one's whole motion.
    let added = onset.map_or(travel.map(|z| z.norm()), |onset| {
        onset.bound_overshoot_of_each_mass_m_per_n(actuator, frequency_hz, rise_s, travel)
    });
    added.map(|added| SOFTENING_GROWTH * added)
}

/// The overshoots at the largest force that leaves headroom for them, and the rail voltage in V of that force. If
/// travel limits the force, the rail is up sooner, which increases the overshoot again.
pub(super) fn compute_travel_overshoots_m_per_n_and_rail_voltage_at_max_force(
    onset: Option<&SwitchOnModel>,
    actuator: usize,
    frequency_hz: f64,
    electrodes: &Electrodes,
    travel: &[Complex64; MAX_ACTUATORS],
) -> ([f64; MAX_ACTUATORS], f64) {
    const NEARLY: f64 = 0.9;
    let mut onset_v = electrodes.max_voltage_v;
    let mut overshoot =
        bound_overshoot_of_each_mass_or_whole_motion_m_per_n(onset, actuator, frequency_hz, onset_v, travel);
    for _ in 0..2 {
        let own = travel.get(actuator).map_or(0.0, |z| z.norm()) + overshoot.get(actuator).copied().unwrap_or(0.0);
        let (force_n, _) = electrodes.find_max_force_n_and_limit(own, frequency_hz, WIDEST_PULSE);
        let most_v = electrodes.voltage_for_force_v(force_n, frequency_hz, WIDEST_PULSE);
        if most_v >= NEARLY * onset_v {
            break;
        }
        onset_v = most_v;
        overshoot =
            bound_overshoot_of_each_mass_or_whole_motion_m_per_n(onset, actuator, frequency_hz, onset_v, travel);
    }
    (overshoot, onset_v)
}

/// Sum of the moduli of fundamental, harmonics and overshoot for every actuator.
fn sum_fundamental_harmonic_and_overshoot_travel_m_per_n(
    motion: MotionPerN<'_>,
    pulse_width: f64,
) -> [f64; MAX_ACTUATORS] {
    let mut out = sum_weighted_harmonic_travel_of_each_actuator(motion.harmonics, motion.charging, pulse_width);
    for (out, (travel, overshoot)) in out.iter_mut().zip(motion.travel.iter().zip(motion.overshoot)) {
        *out += travel.norm() + overshoot;
    }
    out
}

/// Electrodes and transducer of an actuator, and the static receptance of its mass.
#[derive(Clone, Copy)]
pub(super) struct DriverModel<'a> {
    pub electrodes: &'a Electrodes,
    pub transducer: &'a Transducer,
    /// Its mass's travel per steady force in m/N.
    pub static_receptance: f64,
}

/// The pulse option of an actuator for one pulse width, with the largest force that voltage, travel, breakdown,
/// pull-in and softening allow.
pub(super) fn build_pulse_option_with_max_force(
    driver: DriverModel<'_>,
    actuator: usize,
    motion: MotionPerN<'_>,
    frequency_hz: f64,
    pulse_width: f64,
    [harmonics, felt_harmonics]: [f64; 2],
) -> PulseOption {
    let DriverModel { electrodes, transducer, static_receptance } = driver;
    let travel_m_per_n = sum_fundamental_harmonic_and_overshoot_travel_m_per_n(motion, pulse_width);
    let own = travel_m_per_n.get(actuator).copied().unwrap_or(0.0);
    let most = electrodes.find_max_force_n_and_limit(own, frequency_hz, pulse_width);
    // What a bias already took off its spring is in the model.
    let by_pull_in = (MAX_SOFTENING_FRACTION / static_receptance + transducer.counted_n_per_m)
        / (electrodes.mean_softening_n_per_m_per_n(frequency_hz, pulse_width)
            * electrodes.softening_under_press_relative_to_rest());
    let most = if by_pull_in < most.0 { (by_pull_in, Limit::PullIn) } else { most };
    let receptance = motion.travel.get(actuator).copied().unwrap_or_default();
    let (max_force_n, limit) = find_max_softened_force_n_and_limit(
        electrodes,
        transducer,
        receptance,
        own - receptance.norm(),
        (frequency_hz, pulse_width),
        most,
    );
    PulseOption { harmonics, felt_harmonics, travel_m_per_n, max_force_n, limit, ..PulseOption::default() }
        .with_pulse_width_keeping_max_force(electrodes, frequency_hz, pulse_width)
}

/// The largest force up to `force_n_and_limit`, and its limit, at which an ERA that is driven alone stays within its limits, with
/// a force that grows as its gap closes. All levels up to that force are checked. `own_receptance` is its own travel in
/// m/N, `added_m_per_n` the travel that harmonics and switching on add at most.
fn find_max_softened_force_n_and_limit(
    electrodes: &Electrodes,
    transducer: &Transducer,
    own_receptance: Complex64,
    added_m_per_n: f64,
    (frequency_hz, pulse_width): (f64, f64),
    force_n_and_limit: (f64, Limit),
) -> (f64, Limit) {
    let voltage_at =
        |force_n: f64| electrodes.voltage_for_force_v(force_n, frequency_hz, pulse_width).min(electrodes.max_voltage_v);
    if electrodes.max_softening_n_per_m(voltage_at(force_n_and_limit.0), MAX_TRAVEL_FRACTION) * own_receptance.norm()
        <= WEAK_SOFTENING
    {
        return force_n_and_limit;
    }
    let mut matrix = [[Complex64::ZERO; MAX_ACTUATORS]; MAX_ACTUATORS];
    matrix[0][0] = own_receptance;
    let line = [Line { frequency: 0, harmonic: 1, receptance: matrix }];
    let violated = |force_n: f64| -> Option<Limit> {
        let voltage_v = voltage_at(force_n);
        let excitation = [Excitation { frequency: 0, frequency_hz, voltage_v, pulse_width, phase_rad: 0.0 }];
        match solve_steady_motion(std::slice::from_ref(transducer), &excitation, &line) {
            Ok(motion) => electrodes
                .first_violated_limit_if_any(motion.largest_m[0] + added_m_per_n * force_n, voltage_v * (1.0 - 1e-12)),
            Err(_) => Some(Limit::Travel),
        }
    };
    let mut low = 0.0;
    for level in 1..=LEVELS {
        let mut high = force_n_and_limit.0 * f64::from(level) / f64::from(LEVELS);
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
    force_n_and_limit
}

/// Of the pulse widths `candidate_pulse_widths` the one whose harmonics move the panel least, and the widest one that the board's
/// guard time allows.
pub(super) fn choose_quietest_and_widest_pulse(
    frequency_hz: f64,
    candidate_pulse_widths: &[f64],
    build_option_of_width: impl Fn(f64) -> PulseOption,
) -> [PulseOption; 2] {
    let widest = (1.0 - 2.0 * frequency_hz * GUARD_S).min(WIDEST_PULSE);
    let usable = candidate_pulse_widths
        .iter()
        .filter(|pulse_width| **pulse_width <= widest)
        .map(|pulse_width| build_option_of_width(*pulse_width));
    let quiet =
        usable.min_by(|a, b| a.harmonics.total_cmp(&b.harmonics)).unwrap_or_else(|| build_option_of_width(widest));
    [quiet, build_option_of_width(widest)]
}
