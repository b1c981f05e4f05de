//! A click's brake: after a push at full level for whole cycles, up to three levels that leave least behind.
//!
//! The motion after the last cycle is linear in the levels, so the least energy left at the targets is a least-squares
//! problem with at most three unknowns between -1 and 1. One level can only cancel what is in phase with it; with two the
//! free motion of one pole, amplitude and phase, goes to nothing. Which number and length of levels is best depends on
//! damping and frequencies: the one after which the targets are quiet soonest is taken.

use super::motion::{Channel, sample_motion_under_level_of_each_period_and_get_step_s};
use crate::physics::rise::TransientResponse;
use era_shared::waveform::{FULL_LEVEL, Segment};
use num_complex::Complex64;

/// Levels and cycles of each, tried besides no brake at all.
const BRAKES: [(usize, u16); 7] = [(1, 1), (1, 2), (1, 3), (2, 1), (2, 2), (3, 1), (3, 2)];
/// How much sooner quiet a longer brake must be to be taken, as a part of the click's length.
const SOONER: f64 = 0.03;
/// Least decay rate in 1/s that counts in an energy, which is infinite without any.
const LEAST_RATE: f64 = 0.1;
/// How long after its push a click is looked at, in s.
const LOOK_S: f64 = 0.3;
/// Rounds of the least squares between bounds; each brings a factor, and levels are rounded to 1/1000.
const LEAST_SQUARES_ROUNDS: usize = 60;

/// The segments of a click on one drive: `push_cycles` and the brake, `most_cycles` together. `responses_and_quiet_levels` holds its fundamental's motion at every
/// target, with the size below which that is quiet.
#[must_use]
pub fn design_push_and_brake_segments(
    responses_and_quiet_levels: &[(TransientResponse, f64)],
    channel: Channel,
    push_cycles: u16,
    most_cycles: u16,
) -> Vec<Segment> {
    let period_s = channel.period_s();
    let alone = vec![Segment::Cycles { level: FULL_LEVEL, count: push_cycles }];
    let (mut best, mut best_s) =
        (alone.clone(), last_time_any_target_is_not_quiet_s(responses_and_quiet_levels, channel, &alone));
    let worth_s = SOONER * f64::from(push_cycles) * period_s;
    let fits =
        |(count, cycles): &(usize, u16)| *count * usize::from(*cycles) + usize::from(push_cycles) <= most_cycles.into();
    for (count, cycles) in BRAKES.into_iter().filter(fits) {
        // A brake that takes as long as the decay without it brakes nothing.
        #[expect(clippy::cast_precision_loss, reason = "at most three")]
        let length_s = (f64::from(push_cycles) + count as f64 * f64::from(cycles)) * period_s;
        if length_s >= best_s {
            continue;
        }
        let mut tried = alone.clone();
        let forces = solve_brake_force_fractions(responses_and_quiet_levels, period_s, push_cycles, count, cycles);
        let levels = forces.into_iter().map(|force| level_in_thousandths(channel.level_for_force_fraction(force)));
        tried.extend(levels.collect::<Vec<i16>>().into_iter().map(|level| Segment::Cycles { level, count: cycles }));
        while matches!(tried.last(), Some(Segment::Cycles { level: 0, .. })) {
            tried.pop();
        }
        let tried_s = last_time_any_target_is_not_quiet_s(responses_and_quiet_levels, channel, &tried);
        if tried_s < best_s - worth_s {
            (best, best_s) = (tried, tried_s);
        }
    }
    best
}

/// When all targets are quiet, in s from the start.
#[expect(clippy::cast_precision_loss, reason = "sample numbers")]
fn last_time_any_target_is_not_quiet_s(
    responses_and_quiet_levels: &[(TransientResponse, f64)],
    channel: Channel,
    segments: &[Segment],
) -> f64 {
    let levels = segments.iter().flat_map(list_level_of_each_cycle_or_none_if_ramp_or_hold);
    let forces: Vec<f64> = levels.map(|level| channel.force_fraction_of_level(level)).collect();
    let last = |(ringing, quiet): &(TransientResponse, f64)| {
        let (samples, step_s) =
            sample_motion_under_level_of_each_period_and_get_step_s(ringing, &forces, channel.period_s(), LOOK_S);
        samples.iter().rposition(|x| x.abs() > *quiet).map_or(0.0, |i| i as f64 * step_s)
    };
    responses_and_quiet_levels.iter().map(last).fold(0.0, f64::max)
}

fn list_level_of_each_cycle_or_none_if_ramp_or_hold(segment: &Segment) -> Vec<f64> {
    match *segment {
        Segment::Cycles { level, count } => vec![f64::from(level) / f64::from(FULL_LEVEL); usize::from(count)],
        _ => Vec::new(),
    }
}

/// The best `level_count` levels of `cycles_per_level` each, as parts of the full force.
fn solve_brake_force_fractions(
    responses_and_quiet_levels: &[(TransientResponse, f64)],
    period_s: f64,
    push_cycles: u16,
    level_count: usize,
    cycles_per_level: u16,
) -> Vec<f64> {
    let section_s = f64::from(cycles_per_level) * period_s;
    // Free motion at the end of the last section: of the push, and of each section at level 1.
    let mut pushed: Vec<Vec<Complex64>> = Vec::with_capacity(responses_and_quiet_levels.len());
    let mut braked: Vec<Vec<Vec<Complex64>>> = vec![Vec::with_capacity(responses_and_quiet_levels.len()); level_count];
    for (ringing, _) in responses_and_quiet_levels {
        #[expect(clippy::cast_precision_loss, reason = "at most three")]
        let after = |length_s: f64, sections: usize| -> Vec<Complex64> {
            let one = |(s, c): &(Complex64, Complex64)| {
                let rest_s = sections as f64 * section_s;
                c * ((s * (rest_s + length_s)).exp() - (s * rest_s).exp())
            };
            ringing.free.iter().map(one).collect()
        };
        pushed.push(after(f64::from(push_cycles) * period_s, level_count));
        for (i, braked) in braked.iter_mut().enumerate() {
            braked.push(after(section_s, level_count - 1 - i));
        }
    }
    let product = |x: &[Vec<Complex64>], y: &[Vec<Complex64>]| -> f64 {
        responses_and_quiet_levels
            .iter()
            .zip(x.iter().zip(y))
            .map(|((ringing, _), (x, y))| integrate_free_motion_product(ringing, x, y))
            .sum()
    };
    let matrix: Vec<Vec<f64>> = braked.iter().map(|x| braked.iter().map(|y| product(x, y)).collect()).collect();
    let right: Vec<f64> = braked.iter().map(|x| -product(x, &pushed)).collect();
    let mut found = vec![0.0_f64; level_count];
    // A convex problem between bounds: coordinate by coordinate, over-relaxed as neighbours are much alike.
    for _ in 0..LEAST_SQUARES_ROUNDS {
        for i in 0..level_count {
            let rest: f64 = (0..level_count).filter(|j| *j != i).map(|j| matrix[i][j] * found[j]).sum();
            if matrix[i][i] > 0.0 {
                let wanted = (right[i] - rest) / matrix[i][i];
                found[i] = (found[i] + 1.5 * (wanted - found[i])).clamp(-1.0, 1.0);
            }
        }
    }
    found
}

#[expect(clippy::cast_possible_truncation, reason = "-1000 to 1000")]
pub(super) fn level_in_thousandths(level: f64) -> i16 {
    (level * f64::from(FULL_LEVEL)).round() as i16
}

/// Integral from now on of the product of two free motions Re sum x e^(s t) and Re sum y e^(s t).
fn integrate_free_motion_product(ringing: &TransientResponse, x: &[Complex64], y: &[Complex64]) -> f64 {
    let rate = |s: Complex64| Complex64::new(s.re.min(-LEAST_RATE), s.im);
    let mut sum = 0.0;
    for ((s, _), x) in ringing.free.iter().zip(x) {
        for ((u, _), y) in ringing.free.iter().zip(y) {
            let (s, u) = (rate(*s), rate(*u));
            sum -= (x * y / (s + u) + x * y.conj() / (s + u.conj())).re;
        }
    }
    0.5 * sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::charging::PeriodicCharging;
    use crate::scene::ChargingTimes;

    /// A drive at 150 Hz whose electrodes have these times.
    fn make_channel_with_charging_times(times: ChargingTimes) -> Channel {
        let charging = PeriodicCharging::new(times, 150.0);
        Channel { actuator: 0, frequency_hz: 150.0, pulse_width: 2.0 / 3.0, charging }
    }

    /// A mode of `hz` and `ratio` driven at `drive_hz`: w^2-independent coefficients of a sine from rest.
    fn mode(hz: f64, ratio: f64, drive_hz: f64) -> TransientResponse {
        let (w, jw) = (std::f64::consts::TAU * hz, Complex64::new(0.0, std::f64::consts::TAU * drive_hz));
        let s = Complex64::new(-ratio * w, w * (1.0 - ratio * ratio).sqrt());
        // Acceleration of q'' + 2 z w q' + w^2 q = sin: g = s / (s - s*), both of a pair in one.
        let g = s / (s - s.conj());
        let minus_j = Complex64::new(0.0, -1.0);
        let transform = 0.5 * (minus_j / (s - jw) + minus_j.conj() / (s + jw));
        let steady = minus_j * jw * jw / (jw * jw + 2.0 * ratio * w * jw + w * w);
        TransientResponse { omega_rad_s: jw.im, steady, free: vec![(s, 2.0 * s * g * transform)] }
    }

    #[test]
    fn from_rest() {
        let ringing = mode(150.0, 0.03, 140.0);
        assert!(ringing.value_at(0.0).abs() < 1e-9, "a sine of force begins at zero: {}", ringing.value_at(0.0));
        let displacement = ringing.acceleration_to_displacement();
        assert!(displacement.value_at(0.0).abs() < 1e-12 && displacement.value_at(1e-6).abs() < 1e-12);
    }

    /// On resonance one level is enough and nearly nothing is left; off it, more levels are taken and do the same.
    #[test]
    fn a_mode_is_stopped() {
        for (hz, ratio) in [(150.0, 0.01), (150.0, 0.04), (165.0, 0.02), (120.0, 0.02)] {
            let (ringing, period_s) = (mode(hz, ratio, 150.0), 1.0 / 150.0);
            let (samples, _) =
                sample_motion_under_level_of_each_period_and_get_step_s(&ringing, &[1.0; 3], period_s, 0.0);
            let quiet = 0.1 * samples.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            let targets = [(ringing, quiet)];
            let ideal = make_channel_with_charging_times(ChargingTimes::default());
            let found = design_push_and_brake_segments(&targets, ideal, 3, u16::MAX);
            assert!(found.len() > 1, "{hz} {ratio}: {found:?}");
            let (braked_s, alone_s) = (
                last_time_any_target_is_not_quiet_s(&targets, ideal, &found),
                last_time_any_target_is_not_quiet_s(&targets, ideal, &found[..1]),
            );
            // e-folding in 1/(z w): to a tenth takes 2.3 of them, or all of the look.
            assert!(braked_s < 0.05 && alone_s > 1.5 * braked_s, "{hz} {ratio}: {braked_s} {alone_s} {found:?}");
            // Behind resistors the levels are others, and their forces the same.
            let resistors =
                make_channel_with_charging_times(ChargingTimes { rise_s: 300e-6, hold_s: 0.0, fall_s: 30e-6 });
            let behind = design_push_and_brake_segments(&targets, resistors, 3, u16::MAX);
            assert_eq!(behind.len(), found.len());
            for (behind, ideal) in behind.iter().zip(&found).skip(1) {
                let [behind, ideal] = [behind, ideal].map(|it| list_level_of_each_cycle_or_none_if_ramp_or_hold(it)[0]);
                assert!((resistors.force_fraction_of_level(behind) - ideal).abs() < 1.5e-3, "{behind} {ideal}");
                assert!(ideal.abs() > 0.95 || behind.abs() > ideal.abs() + 0.005, "{behind} {ideal}");
            }
            let untold = last_time_any_target_is_not_quiet_s(&targets, resistors, &found);
            assert!(untold >= last_time_any_target_is_not_quiet_s(&targets, resistors, &behind), "{hz} {ratio}");
        }
    }

    #[test]
    fn what_stops_by_itself_is_not_braked() {
        let targets = [(mode(150.0, 0.7, 150.0), 0.07)];
        let found = design_push_and_brake_segments(
            &targets,
            make_channel_with_charging_times(ChargingTimes::default()),
            3,
            u16::MAX,
        );
        assert!(found.len() <= 2, "{found:?}");
    }
}
