//! What driving costs: by the square of the force, in integers, against the same in f64.

mod support;

use era_shared::limits::{BURST_MAX_MS, DUTY_CREDIT_MS, DUTY_PERCENT, REST_MS};
use era_shared::safety::{CreditCharge, DriveBudget};
use era_shared::waveform::TimerPeriod;
use proptest::prelude::*;
use std::f64::consts::FRAC_PI_2;
use support::reduce_case_count_under_miri;

/// What rounding may add to a charge, in parts of the largest.
const ROUNDED: f64 = 3e-5;
/// As the board's channels.
const HIGHEST_MILLIVOLTS: u32 = 2_000_000;

/// (F / F_max)^2 of windows of `width` ticks.
fn compute_squared_force_fraction(ticks: u32, width: u32, millivolts: u32, max_millivolts: u32) -> f64 {
    let voltage = (f64::from(millivolts) / f64::from(max_millivolts)).min(1.0);
    let pulse_width = f64::from(2 * width) / f64::from(ticks);
    (voltage.powi(2) * (FRAC_PI_2 * pulse_width).sin()).powi(2)
}

fn make_credit_charge(ticks: u32, width: u32, millivolts: u32, max_millivolts: u32) -> CreditCharge {
    CreditCharge::from_period(&TimerPeriod::with_windows(7, ticks, width, false), millivolts, max_millivolts)
}

fn convert_charge_to_fraction(charge: CreditCharge) -> f64 {
    f64::from(charge.as_ppm()) / 1e6
}

fn make_charges_of_first_channel(charge: CreditCharge) -> [Option<CreditCharge>; 4] {
    [Some(charge), None, None, None]
}

/// Windows as the timers have them: up to 65 535 ticks, less than half of them on.
fn generate_period_and_width_ticks() -> impl Strategy<Value = (u32, u32)> {
    (8_u32..=TimerPeriod::MOST_TICKS).prop_flat_map(|ticks| (Just(ticks), 0..ticks.div_ceil(2)))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(reduce_case_count_under_miri(20_000)))]

    #[test]
    fn a_charge_is_the_square_of_the_force_rounded_up(
        (ticks, width) in generate_period_and_width_ticks(), max in 1_u32..4_000_000, share in 0.0..1.05_f64,
        reversed in any::<bool>(),
    ) {
        let millivolts = (share * f64::from(max)) as u32;
        let period = TimerPeriod::with_windows(3, ticks, width, reversed);
        let charged = convert_charge_to_fraction(CreditCharge::from_period(&period, millivolts, max));
        let exact = compute_squared_force_fraction(ticks, width, millivolts, max);
        prop_assert!(charged >= exact - 1e-12 && charged < exact + ROUNDED, "{charged}, {exact}");
        prop_assert_eq!(charged == 0.0, width == 0 || millivolts == 0);
    }

    #[test]
    fn more_voltage_and_wider_pulses_never_cost_less(
        (ticks, width) in generate_period_and_width_ticks(),
        (other_ticks, other_width) in generate_period_and_width_ticks(),
        max in 1_u32..4_000_000, at in any::<u32>(), more in 0_u32..100,
    ) {
        let millivolts = at % (max + max / 10 + 1);
        let here = make_credit_charge(ticks, width, millivolts, max);
        prop_assert!(make_credit_charge(ticks, width, millivolts + more, max) >= here);
        let wider = (width + more).min(ticks.div_ceil(2) - 1);
        prop_assert!(make_credit_charge(ticks, wider, millivolts, max) >= here);
        // At other frequencies, too: by the part of the period.
        let (first, second) = (width * other_ticks, other_width * ticks);
        let other = make_credit_charge(other_ticks, other_width, millivolts, max);
        let in_order = if first >= second { here >= other } else { here <= other };
        prop_assert!(in_order, "{here:?}, {other:?}");
    }

    /// Any drives, at any times: never more credit than the exposure leaves, never less than by what rounding adds.
    #[test]
    fn credit_is_what_exposure_leaves(
        steps in prop::collection::vec(
            (1_u64..3_000_000, any::<bool>(), generate_period_and_width_ticks(), 0..=HIGHEST_MILLIVOLTS), 1..60),
    ) {
        let mut budget = DriveBudget::new();
        let full_s = f64::from(DUTY_CREDIT_MS) / 1e3;
        let (mut now_us, mut exact_s, mut least_s) = (0, full_s, full_s);
        let mut before = 0.0;
        for (elapsed_us, drives, (ticks, width), millivolts) in steps {
            now_us += elapsed_us;
            let drive = drives.then(|| make_credit_charge(ticks, width, millivolts, HIGHEST_MILLIVOLTS));
            budget.account_and_find_channels_to_stop(now_us, [None, drive, None, None]);
            let driven_cost = compute_squared_force_fraction(ticks, width, millivolts, HIGHEST_MILLIVOLTS);
            let cost = if drives { driven_cost } else { 0.0 };
            let charged = if drives { f64::max(before, cost) } else { 0.0 };
            before = cost;
            let elapsed_s = elapsed_us as f64 / 1e6;
            let after = |credit_s: f64, cost: f64| {
                ((credit_s + elapsed_s * f64::from(DUTY_PERCENT) / 100.0).min(full_s) - elapsed_s * cost).max(0.0)
            };
            exact_s = after(exact_s, charged);
            least_s = after(least_s, if drives { charged + ROUNDED } else { 0.0 });
            let left_s = f64::from(budget.remaining_credit_ms(1)) / 1e3;
            prop_assert!(left_s <= exact_s + 1e-9 && left_s > least_s - 1.001e-3, "{left_s}, {exact_s}, {least_s}");
        }
        prop_assert_eq!(budget.remaining_credit_ms(0), DUTY_CREDIT_MS);
    }

    /// At the largest force a budget is what it was when every drive cost its time: the old rule, written out.
    #[test]
    fn at_the_largest_force_it_is_charged_by_time(
        steps in prop::collection::vec((1_u64..200_000, any::<bool>()), 1..400), burst_ms in 1_u16..=BURST_MAX_MS,
    ) {
        let mut budget = DriveBudget::new();
        budget.set_burst_limit(burst_ms);
        let (rest_us, full_us) = (u64::from(REST_MS) * 1000, u64::from(DUTY_CREDIT_MS) * 1000);
        let (mut now_us, mut credit_us, mut burst_us, mut rested_us) = (0, full_us, 0_u64, rest_us);
        for (tens_us, drives) in steps {
            let elapsed_us = tens_us * 10;
            now_us += elapsed_us;
            credit_us = (credit_us + elapsed_us * u64::from(DUTY_PERCENT) / 100).min(full_us);
            if drives {
                credit_us = credit_us.saturating_sub(elapsed_us);
                burst_us += elapsed_us;
                rested_us = 0;
            } else {
                rested_us += elapsed_us;
                burst_us = if rested_us >= rest_us { 0 } else { burst_us };
            }
            let limit_us = u64::from(burst_ms) * 1000;
            let spent = drives && (burst_us >= limit_us || credit_us == 0);
            let resting_us = if burst_us >= limit_us { rest_us - rested_us.min(rest_us) } else { 0 };
            let missing_us = rest_us.saturating_sub(credit_us) * 100 / u64::from(DUTY_PERCENT);
            let wait_ms = resting_us.max(missing_us).div_ceil(1000) as u32;
            let drive = drives.then_some(CreditCharge::FULL);
            prop_assert_eq!(budget.account_and_find_channels_to_stop(now_us, [drive, None, None, None]), [spent, false, false, false]);
            prop_assert_eq!(budget.required_wait_ms(0), (wait_ms > 0).then_some(wait_ms));
            prop_assert_eq!(u64::from(budget.remaining_credit_ms(0)), credit_us / 1000);
        }
    }
}

#[test]
fn nothing_costs_nothing_and_the_most_costs_its_time() {
    assert_eq!(make_credit_charge(1_000, 400, 0, HIGHEST_MILLIVOLTS), CreditCharge::NONE);
    assert_eq!(make_credit_charge(1_000, 0, HIGHEST_MILLIVOLTS, HIGHEST_MILLIVOLTS), CreditCharge::NONE);
    assert_eq!(make_credit_charge(1_000, 400, 0, 0), CreditCharge::NONE);
    // A window of 1 - 1e-4 of the half period: less than a millionth is missing.
    assert_eq!(make_credit_charge(60_000, 29_998, HIGHEST_MILLIVOLTS, HIGHEST_MILLIVOLTS), CreditCharge::FULL);
    assert_eq!(make_credit_charge(60_000, 29_998, u32::MAX, HIGHEST_MILLIVOLTS), CreditCharge::FULL, "above the limit");
    assert_eq!(make_credit_charge(60_000, 29_998, 1, 0), CreditCharge::FULL, "no limit known");
    // Half the voltage: a sixteenth. A third of the half period: a quarter.
    assert_eq!(make_credit_charge(60_000, 29_998, 1_000_000, HIGHEST_MILLIVOLTS).as_ppm(), 62_500);
    assert!(
        (convert_charge_to_fraction(make_credit_charge(60_000, 10_000, HIGHEST_MILLIVOLTS, HIGHEST_MILLIVOLTS)) - 0.25)
            .abs()
            < ROUNDED
    );
    // The least that there is costs something.
    assert_eq!(make_credit_charge(TimerPeriod::MOST_TICKS, 1, 1, u32::MAX).as_ppm(), 1);
    assert_eq!((CreditCharge::FULL.as_ppm(), CreditCharge::NONE.as_ppm()), (1_000_000, 0));
}

/// The strongest drives whose square is a tenth, for an hour without a rest: what is earned keeps pace, however irregular the board's
/// looks are. Twice that runs out when it should.
#[test]
fn a_tenth_of_the_exposure_never_runs_out() {
    let share = f64::from(DUTY_PERCENT) / 100.0;
    for (ticks, width) in [(60_000, 29_000), (56_667, 18_888), (43_000, 8_000)] {
        let sine = (FRAC_PI_2 * f64::from(2 * width) / f64::from(ticks)).sin();
        let volts_share = ((share - ROUNDED).sqrt() / sine).sqrt();
        assert!(volts_share < 1.0);
        let millivolts = (volts_share * f64::from(HIGHEST_MILLIVOLTS)) as u32;
        let weak = make_credit_charge(ticks, width, millivolts, HIGHEST_MILLIVOLTS);
        assert!(
            convert_charge_to_fraction(weak) <= share && convert_charge_to_fraction(weak) > share - 1e-4,
            "{weak:?}"
        );
        let mut budget = DriveBudget::new();
        budget.set_burst_limit(BURST_MAX_MS);
        let (mut now_us, mut least_ms) = (0_u64, u32::MAX);
        let mut elapsed_us = 1_000;
        let end_us = if cfg!(miri) { 1_000_000 } else { 3_600_000_000 };
        while now_us < end_us {
            // 1.000 to 1.998 ms.
            elapsed_us = 1_000 + (elapsed_us * 7 + 13) % 999;
            now_us += elapsed_us;
            budget.account_and_find_channels_to_stop(now_us, make_charges_of_first_channel(weak));
            least_ms = least_ms.min(budget.remaining_credit_ms(0));
        }
        // What one look costs, before what it earns is there: the first is rounded down.
        assert!(least_ms >= DUTY_CREDIT_MS - 1, "{least_ms}");
        let twice = CreditCharge::from_period(
            &TimerPeriod::with_windows(1, ticks, width, false),
            (f64::from(millivolts) * 2_f64.powf(0.25)) as u32,
            HIGHEST_MILLIVOLTS,
        );
        let mut budget = DriveBudget::new();
        let mut seconds = 0;
        while budget.remaining_credit_ms(0) > 0 && seconds < 10_000 {
            seconds += 1;
            budget.account_and_find_channels_to_stop(seconds * 1_000_000, make_charges_of_first_channel(twice));
        }
        assert!(seconds.abs_diff(600) <= 2, "{seconds} s for 60 s of credit at a tenth net");
    }
}

/// A drive that becomes weaker between two looks is charged at what it was, one that becomes stronger at what it is.
#[test]
fn a_change_between_two_looks_costs_the_greater() {
    let quarter = make_credit_charge(60_000, 10_000, HIGHEST_MILLIVOLTS, HIGHEST_MILLIVOLTS);
    let spent_ms = |order: [CreditCharge; 2]| {
        let mut budget = DriveBudget::new();
        budget.account_and_find_channels_to_stop(0, make_charges_of_first_channel(order[0]));
        budget.account_and_find_channels_to_stop(10_000_000, make_charges_of_first_channel(order[1]));
        DUTY_CREDIT_MS - budget.remaining_credit_ms(0)
    };
    assert_eq!(spent_ms([CreditCharge::FULL, quarter]), 10_000);
    assert_eq!(spent_ms([quarter, CreditCharge::FULL]), 10_000);
    assert!(spent_ms([quarter, quarter]).abs_diff(2_500) <= 1);
    let mut budget = DriveBudget::new();
    budget.account_and_find_channels_to_stop(0, make_charges_of_first_channel(CreditCharge::FULL));
    budget.account_and_find_channels_to_stop(10_000_000, [None; 4]);
    assert_eq!(budget.remaining_credit_ms(0), DUTY_CREDIT_MS, "what has ended costs nothing more");
}
