//! On a panel of two poles under one actuator, of which travel and amplitude are the same number, the limit 1.

use super::*;
use num_complex::Complex64;
use proptest::prelude::*;

const RATES: [f64; 2] = [10.0, 40.0];

fn residual() -> ResidualVibration {
    let mode = |rate_per_s: f64| {
        let mut travel = [0.0; MAX_ACTUATORS];
        travel[0] = 1.0;
        PoleDecayAndTravel { rate_per_s, travel }
    };
    ResidualVibration::new(RATES.map(mode).to_vec())
}

/// A steady motion of `size`, two thirds of it of the slow pole, that comes up soon, at a frequency.
fn motion(size: f64, drive_hz: f64) -> PlanMotion {
    let only = |value: f64, others: f64| {
        let mut all = [others; MAX_ACTUATORS];
        all[0] = value;
        all
    };
    let participation = |part: f64| Participation {
        steady: [Complex64::from(part * size), Complex64::ZERO],
        free_amplitude_after_rise_or_effect: 0.1 * part * size,
        gain_per_s: 1e3 * size,
    };
    let participations = vec![participation(2.0 / 3.0), participation(1.0 / 3.0)];
    PlanMotion {
        limit_m: only(1.0, f64::INFINITY),
        steady_m: only(size, 0.0),
        at_once_m: only(2.0 * size, 0.0),
        soft_m: only(size, 0.0),
        growth: only(1.0, 1.0),
        lines: vec![ForceLine {
            channel: 0,
            is_shared: false,
            harmonic: 1,
            drive_hz,
            phase_rad: 0.0,
            rise_s: 0.1,
            participations,
        }],
    }
}

fn drives(force_n: f64, frequency_hz: f64) -> Vec<Drive> {
    let (voltage_v, pulse_width) = (1000.0, 0.6);
    vec![Drive {
        actuator: "a".into(),
        frequency_hz,
        voltage_v,
        pulse_width,
        phase_rad: 0.0,
        force_phase_rad: 0.0,
        force_n,
    }]
}

#[test]
fn rails_that_are_up_make_the_difference_on_a_panel_at_rest() {
    let (residual, drives) = (residual(), drives(1.0, 100.0));
    let headroom = |size: f64, board: RailState| {
        residual.find_wait_and_force_fraction_within_travel_limits(&motion(size, 100.0), Some(&drives), 0.0, board)
    };
    assert_eq!(headroom(1.0, RailState::Down), StartHeadroom::ALL);
    // It goes twice as far when it begins at once, and nothing that a wait could mend is left.
    assert_eq!(headroom(1.0, RailState::Up), StartHeadroom::without_wait(0.5 * (1.0 + LIMIT_TOLERANCE)));
    assert_eq!(headroom(0.5, RailState::Up), StartHeadroom::ALL);
    assert_eq!(headroom(1.1, RailState::Down), StartHeadroom::without_wait((1.0 + LIMIT_TOLERANCE) / 1.1));
}

#[test]
fn a_touch_is_weaker_by_what_is_left_and_waits_where_that_doubles_it() {
    let (mut residual, drives) = (residual(), drives(1.0, 100.0));
    residual.record_drives_that_begin_in_place_of_others(
        1,
        &motion(0.9, 100.0),
        Some(&drives),
        RailState::Down,
        0.0,
        10.0,
    );
    residual.record_end_of_current_drives(5.0, Ending::AtItsBoundary);
    let left = |at_s: f64| residual.bound_travel_left_after_end_m(5.0, at_s)[0];
    // The steady part of both poles, from a period and a bit after the end on; what it was begun with has decayed.
    assert!((left(5.0) - 0.9).abs() < 1e-9, "{}", left(5.0));
    let end_s = 5.0 + LATE_S + 0.01;
    let expected = 0.6 * f64::exp(-10.0 * (5.3 - end_s)) + 0.3 * f64::exp(-40.0 * (5.3 - end_s));
    assert!((left(5.3) - expected).abs() < 1e-9, "{} {expected}", left(5.3));
    // 0.12 is left of the limit, and 0.8 is needed; 30 ms later more than twice as much.
    let headroom = |now_s: f64| {
        residual.find_wait_and_force_fraction_within_travel_limits(
            &motion(0.4, 200.0),
            Some(&drives),
            now_s,
            RailState::Up,
        )
    };
    assert!(
        (residual.max_force_fraction_that_fits_without_wait(&motion(0.4, 200.0), Some(&drives), 5.0, RailState::Up)
            - 0.12 / 0.8)
            .abs()
            < 1e-9
    );
    assert!(
        (headroom(5.0).force_fraction - (1.02 - left(5.03)) / 0.8).abs() < 1e-9 && headroom(5.0).wait_s == 0.03,
        "{:?}",
        headroom(5.0)
    );
    let later = headroom(5.1);
    assert!((later.force_fraction - (1.02 - left(5.1)) / 0.8).abs() < 1e-9 && later.wait_s == 0.0, "{later:?}");
    // 30 ms are the most it waits; and it does not wait again.
    let mut residual = super::tests::residual();
    residual.record_drives_that_begin_in_place_of_others(
        1,
        &motion(1.0, 100.0),
        Some(&drives),
        RailState::Down,
        0.0,
        10.0,
    );
    residual.record_end_of_drives_with_id(1, 4.99);
    let next = motion(0.4, 200.0);
    let headroom =
        residual.find_wait_and_force_fraction_within_travel_limits(&next, Some(&drives), 5.0, RailState::Driving);
    let now = residual.max_force_fraction_that_fits_without_wait(&next, Some(&drives), 5.0, RailState::Driving);
    assert!(
        headroom.force_fraction >= WORTH_WAITING * now && headroom.wait_s > 0.0 && headroom.wait_s <= LONGEST_WAIT_S,
        "{headroom:?} {now}"
    );
    residual.record_end_of_current_drives(5.0, Ending::AtItsBoundary);
    let then_s = 5.0 + headroom.wait_s;
    let then = residual.find_wait_and_force_fraction_within_travel_limits(&next, Some(&drives), then_s, RailState::Up);
    assert!(
        (then.force_fraction - headroom.force_fraction).abs() < 1e-9
            && then.wait_s < LONGEST_WAIT_S - headroom.wait_s + 1e-9,
        "{then:?}"
    );
    assert_eq!(
        residual.find_wait_and_force_fraction_within_travel_limits(
            &motion(0.01, 200.0),
            Some(&drives),
            5.0,
            RailState::Up
        ),
        StartHeadroom::ALL
    );
}

#[test]
fn what_goes_on_as_it_is_or_nearly_keeps_its_strength() {
    let (mut residual, first) = (residual(), drives(1.0, 100.0));
    residual.record_drives_that_begin_in_place_of_others(
        1,
        &motion(0.95, 100.0),
        Some(&first),
        RailState::Down,
        0.0,
        5.0,
    );
    let part = |next: &PlanMotion, drives: Option<&[Drive]>, board: RailState| {
        residual.max_force_fraction_that_fits_without_wait(next, drives, 2.0, board)
    };
    assert_eq!(part(&motion(0.95, 100.0), Some(&first), RailState::Driving), 1.0);
    // The same, a little weaker: of what is left only the difference counts.
    let weaker = drives(0.98, 100.0);
    assert_eq!(part(&motion(0.93, 100.0), Some(&weaker), RailState::Driving), 1.0);
    // As an effect, or when the board has ended it, it begins again, beside 0.95 of what is left.
    let fraction_after_restart = (1.0 + LIMIT_TOLERANCE - 0.95) / (2.0 * 0.95);
    for found in
        [part(&motion(0.95, 100.0), None, RailState::Driving), part(&motion(0.95, 100.0), Some(&first), RailState::Up)]
    {
        assert!((found - fraction_after_restart).abs() < 1e-9, "{found}");
    }
    // Another channel had the frequency: the board keeps in phase with that one.
    let mut other = motion(0.93, 100.0);
    other.lines[0].channel = 1;
    assert!(part(&other, Some(&weaker), RailState::Driving) < 0.1);
}

#[test]
fn the_force_of_a_change_is_the_largest_within_headroom() {
    // Twice the force at the same frequency: what is changed is as much as there was.
    let (mut residual, first) = (residual(), drives(0.4, 100.0));
    residual.record_drives_that_begin_in_place_of_others(
        1,
        &motion(0.4, 100.0),
        Some(&first),
        RailState::Down,
        0.0,
        5.0,
    );
    let next = motion(0.8, 100.0);
    let part =
        residual.max_force_fraction_that_fits_without_wait(&next, Some(&drives(0.8, 100.0)), 3.0, RailState::Driving);
    // SOFTENING_GROWTH (0.8 p - 0.4) + 0.8 p = 1.02.
    let expected = (1.0 + LIMIT_TOLERANCE + 0.4 * SOFTENING_GROWTH) / (0.8 * (1.0 + SOFTENING_GROWTH));
    assert!((part - expected).abs() < 2e-3 && part <= expected + 1e-9, "{part} {expected}");
}

#[test]
fn what_electrodes_make_grow_counts_for_more() {
    let (mut residual, drives) = (residual(), drives(1.0, 100.0));
    residual.record_drives_that_begin_in_place_of_others(
        1,
        &motion(0.5, 100.0),
        Some(&drives),
        RailState::Down,
        0.0,
        1.0,
    );
    residual.record_end_of_current_drives(1.0, Ending::AtItsBoundary);
    let mut next = motion(0.5, 200.0);
    next.growth[0] = 1.2;
    let left = residual.bound_travel_left_after_end_m(1.0, 1.0)[0];
    let part = residual.max_force_fraction_that_fits_without_wait(&next, Some(&drives), 1.0, RailState::Up);
    assert!((part - (1.0 + LIMIT_TOLERANCE - 1.2 * left)).abs() < 1e-9, "{part} {left}");
}

#[test]
fn weaker_until_there_is_headroom() {
    // What takes headroom by the root of its force: the first try is not enough.
    let tries = std::cell::RefCell::new(Vec::new());
    let weaker = |part: f64| -> Result<f64, ()> {
        tries.borrow_mut().push(part);
        Ok(part)
    };
    let (part, found) =
        find_fraction_and_plan_within_headroom(1.0, weaker, |part: &f64| (0.5 / part.sqrt()).min(1.0)).unwrap();
    assert!(found == part && part <= 0.25 && part > 0.2, "{:?}", tries.borrow());
    assert_eq!(find_fraction_and_plan_within_headroom(1.0, Ok::<_, ()>, |_| 0.0), Ok((0.0, 0.0)));
    assert_eq!(find_fraction_and_plan_within_headroom(1.0, |_| Err(()), |_| 0.5), Err(()));
    assert_eq!(find_fraction_and_plan_within_headroom(7.0, |_| Err(()), |_| 1.0), Ok((1.0, 7.0)));
}

/// What is near to what is driven has headroom, as little is left of the change; what is weaker by much has next to none.
#[test]
fn a_narrow_feasible_region_is_found() {
    let headroom = |part: &f64| match *part {
        part if part > 0.99 => 0.97,
        part if part > 0.95 => 0.99,
        part if part > 0.9 => 1.0,
        _ => 0.1,
    };
    let (part, _) = find_fraction_and_plan_within_headroom(1.0, Ok::<_, ()>, headroom).unwrap();
    assert!(part > 0.9, "{part}");
}

/// Growing takes the largest of its steps for which there is headroom, and never a step back.
#[test]
fn a_growing_touch_takes_no_step_back() {
    let up_to = |most: f64| move |part: &f64| if (0.5..=most).contains(part) { 1.0 } else { 0.2 };
    let from = |part: f64, most: f64| {
        find_larger_fraction_and_plan_within_headroom_if_any(part, Ok::<_, ()>, up_to(most))
            .unwrap()
            .map(|(part, _)| part)
    };
    assert_eq!(from(0.5, 1.0), Some(1.0));
    assert_eq!(from(0.5, 0.9), Some(0.8));
    assert_eq!(from(0.5, 0.7), Some(0.65));
    assert_eq!(from(0.5, 0.6), None);
    assert_eq!(find_larger_fraction_and_plan_within_headroom_if_any(0.5, |_| Err::<f64, _>(()), |_| 1.0), Err(()));
}

#[test]
fn drives_that_have_just_begun_go_on_for_a_moment() {
    let (mut residual, first) = (residual(), drives(1.0, 100.0));
    residual.record_drives_that_begin_in_place_of_others(
        1,
        &motion(1.0, 100.0),
        Some(&first),
        RailState::Down,
        0.0,
        5.0,
    );
    let next = (motion(1.0, 200.0), drives(1.0, 200.0));
    let headroom = |residual: &ResidualVibration, now_s: f64| {
        residual.find_wait_and_force_fraction_within_travel_limits(&next.0, Some(&next.1), now_s, RailState::Driving)
    };
    let found = headroom(&residual, 0.01);
    assert!(found.goes_on && (found.wait_s - (LONGEST_WAIT_S - 0.01)).abs() < 1e-9, "{found:?}");
    assert!(!headroom(&residual, LONGEST_WAIT_S).goes_on);
    // Its finger was lifted.
    residual.record_end_of_drives_with_id(2, 0.01);
    assert!(headroom(&residual, 0.01).goes_on);
    residual.record_end_of_drives_with_id(1, 0.01);
    assert!(!headroom(&residual, 0.01).goes_on);
}

#[test]
fn what_has_hardly_begun_leaves_no_more_than_its_time_brings() {
    let (mut residual, drives) = (residual(), drives(1.0, 1000.0));
    let mut slow = motion(0.9, 1000.0);
    slow.lines[0].participations.iter_mut().for_each(|participation| participation.gain_per_s = 1.0);
    residual.record_drives_that_begin_in_place_of_others(1, &slow, Some(&drives), RailState::Up, 0.0, 5.0);
    residual.record_end_of_current_drives(0.004, Ending::AtItsBoundary);
    // 1 a second on each pole for 4 ms, and as long as the end may take.
    let most = 2.0 * (0.004 + LATE_S + 1e-3);
    assert!((residual.bound_travel_left_after_end_m(0.004, 0.004)[0] - most).abs() < 1e-9);
    // While the rails rise it is less, with a stop no period more.
    let mut residual = super::tests::residual();
    residual.record_drives_that_begin_in_place_of_others(1, &slow, Some(&drives), RailState::Down, 0.0, 5.0);
    residual.record_end_of_current_drives(0.05, Ending::AtOnce);
    let time_s = 0.05 + LATE_S;
    assert!(
        (residual.bound_travel_left_after_end_m(0.05, 0.05)[0] - 2.0 * time_s * (time_s / 0.1).powi(2) / 3.0).abs()
            < 1e-9
    );
}

#[test]
fn an_effect_leaves_what_it_leaves_in_the_end_or_its_most_before() {
    let mut residual = residual();
    residual.record_drives_that_begin_in_place_of_others(1, &motion(0.5, 100.0), None, RailState::Up, 0.0, 0.2);
    assert!((residual.bound_travel_left_after_end_m(0.1, 0.1)[0] - 0.5).abs() < 1e-9);
    assert!((residual.bound_travel_left_after_end_m(0.3, 0.2)[0] - 0.05).abs() < 1e-9);
}

proptest! {
    /// Whatever is driven when it may be, no sum of what is left and what is driven is above the limit.
    #[test]
    fn no_order_of_touches_goes_beyond(touches in prop::collection::vec((0.05_f64..1.0, 40.0_f64..400.0, 0.005_f64..0.4, any::<bool>()), 1..30)) {
        let mut residual = residual();
        let (mut now_s, mut board) = (0.0, RailState::Down);
        for (id, (size, hz, hold_s, goes_on)) in (0..).zip(touches) {
            let whole = (motion(size, hz), drives(size, hz));
            let headroom = residual.find_wait_and_force_fraction_within_travel_limits(&whole.0, Some(&whole.1), now_s, board);
            prop_assert!((0.0..=LONGEST_WAIT_S).contains(&headroom.wait_s) && (0.0..=1.0).contains(&headroom.force_fraction), "{headroom:?}");
            if headroom.goes_on {
                now_s += headroom.wait_s;
            } else if headroom.wait_s > 0.0 {
                residual.record_end_of_current_drives(now_s, Ending::AtItsBoundary);
                now_s += headroom.wait_s;
                board = if board == RailState::Down { RailState::Down } else { RailState::Up };
            }
            let part = residual.max_force_fraction_that_fits_without_wait(&whole.0, Some(&whole.1), now_s, board);
            // No less than was promised, and with so much of it there is headroom for all.
            prop_assert!(headroom.goes_on || part >= headroom.force_fraction - 1e-9, "{part} {headroom:?}");
            let (motion, drives) = (motion(part * size, hz), drives(part * size, hz));
            prop_assert!(part == 0.0 || residual.max_force_fraction_that_fits_without_wait(&motion, Some(&drives), now_s, board) >= 1.0 - 1e-9);
            residual.record_drives_that_begin_in_place_of_others(id, &motion, Some(&drives), board, now_s, now_s + hold_s);
            now_s += hold_s;
            board = RailState::Driving;
            if !goes_on {
                residual.record_end_of_current_drives(now_s, Ending::AtItsBoundary);
                now_s += 0.01;
                board = RailState::Up;
            }
        }
    }
}
