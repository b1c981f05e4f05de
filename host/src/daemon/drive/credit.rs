//! How strong a drive may be that goes on and on, so that no channel's credit ever runs out.

use crate::planner::drive::SiDrive;
use era_shared::protocol::{ChargeRule, CreditReply};

/// Part of the rest of its credit that a channel uses up in a second, at most: 1 / 20 s. What is left falls as exp(-t / 20 s),
/// so that it is never gone, and the force falls so slowly that nobody feels a step: from the largest, which begins to be thinned
/// with 19 s of credit left, by 2 % a second at first.
const USED_PER_S: f64 = 1.0 / 20.0;
/// Credit in s that is left alone: taps and effects go on beside a long drag, and a board refuses drives below 0.1 s.
const KEPT_S: f64 = 1.0;
/// Least part of what is earned that is driven with where less than [`KEPT_S`] is left: a half brings a second back in 20 s.
const LEAST_EARNED: f64 = 0.5;
/// Part by which a drive's force has to be too large before it is made less, ...
const TOO_STRONG: f64 = 0.02;
/// ... and by which it may be larger before it is: changes up come from touches that ask for less in between.
const TOO_WEAK: f64 = 0.1;

/// The part of the forces of `drives` that every channel's credit allows for ever, on channels for at most `max_voltages_v`. A board
/// that charges by time, whatever the force, gains nothing by less.
#[must_use]
pub fn find_force_fraction_allowed_by_credit(drives: &[SiDrive], max_voltages_v: &[f64], credit: &CreditReply) -> f64 {
    if credit.rule != ChargeRule::ForceSquared {
        return 1.0;
    }
    let of = |drive: &SiDrive| {
        let channel = usize::from(drive.channel);
        let (Some(max_voltage_v), Some(left)) = (max_voltages_v.get(channel), credit.channels.get(channel)) else {
            return 1.0;
        };
        let allowed =
            compute_allowed_squared_force_fraction(f64::from(credit.earned_ppm) / 1e6, f64::from(left.left_ms) / 1e3);
        let charge = compute_squared_force_fraction(drive, *max_voltage_v);
        if charge <= allowed { 1.0 } else { (allowed / charge).sqrt() }
    };
    drives.iter().map(of).fold(1.0, f64::min)
}

/// Whether a drive with `driven_fraction` of its forces is to be changed to have `wanted_fraction` of them.
#[must_use]
pub fn is_force_change_worthwhile(driven_fraction: f64, wanted_fraction: f64) -> bool {
    wanted_fraction < driven_fraction * (1.0 - TOO_STRONG)
        || wanted_fraction > driven_fraction * (1.0 + TOO_WEAK)
        || (wanted_fraction >= 1.0 && driven_fraction < 1.0)
}

/// Most charge, as a part of the largest force's, for `earned_charge_rate` all the time and `credit_left_s` of credit.
fn compute_allowed_squared_force_fraction(earned_charge_rate: f64, credit_left_s: f64) -> f64 {
    (earned_charge_rate + (credit_left_s - KEPT_S) * USED_PER_S).max(LEAST_EARNED * earned_charge_rate)
}

/// (F / F_max)^2, which a board charges; see `docs/src/safety.md`.
fn compute_squared_force_fraction(drive: &SiDrive, max_voltage_v: f64) -> f64 {
    let force = (drive.voltage_v / max_voltage_v).powi(2) * (std::f64::consts::FRAC_PI_2 * drive.pulse_width).sin();
    force * force
}

#[cfg(test)]
mod tests {
    use super::*;
    use era_shared::protocol::ChannelCredit;

    const EARNED_PPM: u32 = 100_000;

    fn drive(channel: u8, voltage_v: f64) -> SiDrive {
        SiDrive { channel, frequency_hz: 150.0, voltage_v, pulse_width: 0.98, phase_rad: 0.0 }
    }

    fn credit(left_ms: [u32; 2]) -> CreditReply {
        let channels = left_ms.map(|left_ms| ChannelCredit { left_ms, charge_ppm: 0 }).into_iter().collect();
        CreditReply { rule: ChargeRule::ForceSquared, earned_ppm: EARNED_PPM, channels }
    }

    /// The board's account for an hour of the largest force, looked at four times a second.
    #[test]
    fn an_hour_at_the_largest_force_never_empties_the_account() {
        for begin_s in [60.0_f64, 2.0, 0.0] {
            let (mut left_s, mut is, mut least_s) = (begin_s, 1.0, f64::INFINITY);
            let mut changes = 0;
            for look in 0..4 * 3600 {
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 60 s in ms")]
                let told = (left_s * 1e3) as u32;
                let wanted = find_force_fraction_allowed_by_credit(&[drive(0, 2000.0)], &[2000.0], &credit([told, 0]));
                if look == 0 || is_force_change_worthwhile(is, wanted) {
                    (is, changes) = (wanted, changes + 1);
                }
                let used = is * is - f64::from(EARNED_PPM) / 1e6;
                left_s = (left_s - 0.25 * used).clamp(0.0, 60.0);
                if look > 4 * 30 {
                    least_s = least_s.min(left_s);
                }
            }
            assert!(least_s > 0.3, "{least_s} s left of {begin_s} s");
            assert!((0.25..0.35).contains(&is), "{is} after an hour");
            assert!(changes < 200, "{changes} changes");
        }
    }

    #[test]
    fn what_is_earned_is_never_thinned_and_the_poorest_channel_counts() {
        let of = |volts: [f64; 2], left_ms| {
            find_force_fraction_allowed_by_credit(
                &[drive(0, volts[0]), drive(1, volts[1])],
                &[2000.0; 2],
                &credit(left_ms),
            )
        };
        // Half the voltage is a quarter of the force, and a sixteenth of the charge: less than the tenth that is earned.
        assert_eq!(of([1000.0; 2], [1100; 2]), 1.0);
        assert_eq!(of([2000.0; 2], [60_000; 2]), 1.0);
        assert_eq!(of([2000.0; 2], [20_000; 2]), 1.0);
        let poor = of([2000.0; 2], [60_000, 3000]);
        // 0.1 of what is earned and 2 s over 20 s.
        assert!((poor - 0.2_f64.sqrt()).abs() < 1e-3, "{poor}");
        let by_time = CreditReply { rule: ChargeRule::Time, ..credit([100; 2]) };
        assert_eq!(find_force_fraction_allowed_by_credit(&[drive(0, 2000.0)], &[2000.0], &by_time), 1.0);
    }
}
