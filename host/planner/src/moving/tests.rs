//! On a panel of two poles under one actuator, of which travel and amplitude are the same number, the limit 1.

use super::*;
use num_complex::Complex64;
use proptest::prelude::*;

const RATES: [f64; 2] = [10.0, 40.0];

fn moving() -> Moving {
    let ring = |rate_per_s: f64| {
        let mut travel = [0.0; MAX_ACTUATORS];
        travel[0] = 1.0;
        Ring { rate_per_s, travel }
    };
    Moving::new(RATES.map(ring).to_vec())
}

/// A steady motion of `size`, two thirds of it of the slow pole, that comes up soon, at a frequency.
fn swing(size: f64, drive_hz: f64) -> Swing {
    let only = |value: f64, others: f64| {
        let mut all = [others; MAX_ACTUATORS];
        all[0] = value;
        all
    };
    let share = |part: f64| Share {
        steady: [Complex64::from(part * size), Complex64::ZERO],
        afterwards: 0.1 * part * size,
        gain_per_s: 1e3 * size,
    };
    let shares = vec![share(2.0 / 3.0), share(1.0 / 3.0)];
    Swing {
        limit_m: only(1.0, f64::INFINITY),
        steady_m: only(size, 0.0),
        at_once_m: only(2.0 * size, 0.0),
        soft_m: only(size, 0.0),
        lines: vec![SwingLine {
            channel: 0,
            is_shared: false,
            harmonic: 1,
            drive_hz,
            phase_rad: 0.0,
            rise_s: 0.1,
            shares,
        }],
    }
}

fn drives(force_n: f64, frequency_hz: f64) -> Vec<Drive> {
    let (voltage_v, pulse_width) = (1000.0, 0.6);
    vec![Drive { actuator: "a".into(), frequency_hz, voltage_v, pulse_width, phase_rad: 0.0, force_n }]
}

#[test]
fn rails_that_are_up_make_the_difference_on_a_panel_at_rest() {
    let (moving, drives) = (moving(), drives(1.0, 100.0));
    let fits = |size: f64, board: Board| moving.fits(&swing(size, 100.0), Some(&drives), 0.0, board);
    assert_eq!(fits(1.0, Board::Down), Verdict::AtOnce);
    assert_eq!(fits(1.0, Board::Up), Verdict::Softly { after_s: 0.0 });
    assert_eq!(fits(0.5, Board::Up), Verdict::AtOnce);
    // Nothing is as long as the wait that it would take.
    assert_eq!(fits(1.1, Board::Down), Verdict::TooFar { part: 1.1 });
}

#[test]
fn a_touch_waits_until_the_one_before_leaves_room_and_no_longer() {
    let (mut moving, drives) = (moving(), drives(1.0, 100.0));
    moving.begin(1, &swing(0.9, 100.0), Some(&drives), Board::Down, 0.0, 10.0);
    moving.end(5.0, Ending::AtItsBoundary);
    let left = |at_s: f64| moving.left_at(5.0, at_s)[0];
    // The steady part of both poles, from a period and a bit after the end on; what it was begun with has decayed.
    assert!((left(5.0) - 0.9).abs() < 1e-9, "{}", left(5.0));
    let end_s = 5.0 + LATE_S + 0.01;
    let expected = 0.6 * f64::exp(-10.0 * (5.3 - end_s)) + 0.3 * f64::exp(-40.0 * (5.3 - end_s));
    assert!((left(5.3) - expected).abs() < 1e-9, "{} {expected}", left(5.3));
    let next = swing(0.8, 200.0);
    let Verdict::Softly { after_s } = moving.fits(&next, Some(&drives), 5.0, Board::Up) else { panic!() };
    let then = left(5.0 + after_s) + 0.8;
    assert!(then <= 1.0 + CONCEDED && left(5.0 + after_s - 0.01) + 0.8 > 1.0 + CONCEDED, "{after_s} {then}");
    assert_eq!(moving.fits(&next, Some(&drives), 5.0 + after_s, Board::Down), Verdict::AtOnce);
    assert_eq!(moving.fits(&swing(0.05, 200.0), Some(&drives), 5.0, Board::Up), Verdict::AtOnce);
}

#[test]
fn what_goes_on_as_it_is_or_nearly_is_not_held_up() {
    let (mut moving, first) = (moving(), drives(1.0, 100.0));
    moving.begin(1, &swing(0.95, 100.0), Some(&first), Board::Down, 0.0, 5.0);
    assert_eq!(moving.fits(&swing(0.95, 100.0), Some(&first), 2.0, Board::Driving), Verdict::AtOnce);
    // The same, a little weaker: of what is left only the difference counts.
    let weaker = drives(0.98, 100.0);
    assert_eq!(moving.fits(&swing(0.93, 100.0), Some(&weaker), 2.0, Board::Driving), Verdict::AtOnce);
    // As an effect, or when the board has ended it, it begins anew.
    assert!(matches!(moving.fits(&swing(0.95, 100.0), None, 2.0, Board::Driving), Verdict::Softly { .. }));
    assert!(matches!(moving.fits(&swing(0.95, 100.0), Some(&first), 2.0, Board::Up), Verdict::Softly { .. }));
    // Another channel had the frequency: the board keeps in phase with that one.
    let mut other = swing(0.93, 100.0);
    other.lines[0].channel = 1;
    assert!(matches!(moving.fits(&other, Some(&weaker), 2.0, Board::Driving), Verdict::Softly { .. }));
}

#[test]
fn drives_that_have_just_begun_go_on_until_they_are_felt() {
    let (mut moving, first) = (moving(), drives(1.0, 100.0));
    moving.begin(1, &swing(1.0, 100.0), Some(&first), Board::Down, 0.0, 5.0);
    let next = (swing(1.0, 200.0), drives(1.0, 200.0));
    let fits = |moving: &Moving, now_s: f64| moving.fits(&next.0, Some(&next.1), now_s, Board::Driving);
    let Verdict::Later { after_s } = fits(&moving, 0.1) else { panic!() };
    assert!((after_s - (FELT_S - 0.1)).abs() < 1e-9);
    assert!(matches!(fits(&moving, 0.1 + after_s), Verdict::Softly { .. }));
    // Its finger was lifted.
    moving.end_of(2, 0.1);
    assert!(matches!(fits(&moving, 0.1), Verdict::Later { .. }));
    moving.end_of(1, 0.1);
    assert!(matches!(fits(&moving, 0.1), Verdict::Softly { .. }));
}

#[test]
fn what_has_hardly_begun_leaves_no_more_than_its_time_brings() {
    let (mut moving, drives) = (moving(), drives(1.0, 1000.0));
    let mut slow = swing(0.9, 1000.0);
    slow.lines[0].shares.iter_mut().for_each(|share| share.gain_per_s = 1.0);
    moving.begin(1, &slow, Some(&drives), Board::Up, 0.0, 5.0);
    moving.end(0.004, Ending::AtItsBoundary);
    // 1 a second on each pole for 4 ms, and as long as the end may take.
    let most = 2.0 * (0.004 + LATE_S + 1e-3);
    assert!((moving.left_at(0.004, 0.004)[0] - most).abs() < 1e-9);
    // While the rails rise it is less, with a stop no period more.
    let mut moving = super::tests::moving();
    moving.begin(1, &slow, Some(&drives), Board::Down, 0.0, 5.0);
    moving.end(0.05, Ending::AtOnce);
    let time_s = 0.05 + LATE_S;
    assert!((moving.left_at(0.05, 0.05)[0] - 2.0 * time_s * (time_s / 0.1).powi(2) / 3.0).abs() < 1e-9);
}

#[test]
fn an_effect_leaves_what_it_leaves_in_the_end_or_its_most_before() {
    let mut moving = moving();
    moving.begin(1, &swing(0.5, 100.0), None, Board::Up, 0.0, 0.2);
    assert!((moving.left_at(0.1, 0.1)[0] - 0.5).abs() < 1e-9);
    assert!((moving.left_at(0.3, 0.2)[0] - 0.05).abs() < 1e-9);
}

proptest! {
    /// Whatever is driven when it may be, no sum of what is left and what is driven is above the limit.
    #[test]
    fn no_order_of_touches_goes_beyond(touches in prop::collection::vec((0.05_f64..1.0, 40.0_f64..400.0, 0.005_f64..0.4, any::<bool>()), 1..30)) {
        let mut moving = moving();
        let (mut now_s, mut board) = (0.0, Board::Down);
        for (id, (size, hz, hold_s, goes_on)) in (0..).zip(touches) {
            let (swing, drives) = (swing(size, hz), drives(size, hz));
            match moving.fits(&swing, Some(&drives), now_s, board) {
                Verdict::AtOnce => {}
                Verdict::Later { after_s } => { now_s += after_s; continue; }
                Verdict::Softly { after_s } => {
                    moving.end(now_s, Ending::AtItsBoundary);
                    now_s += after_s;
                    board = Board::Down;
                    let left = moving.left_at(now_s, now_s)[0];
                    prop_assert!(left + size <= 1.0 + CONCEDED + 1e-9, "{left} {size}");
                    prop_assert_eq!(moving.fits(&swing, Some(&drives), now_s, board), Verdict::AtOnce);
                }
                // Nothing that is within its limits takes that long here.
                Verdict::TooFar { part } => prop_assert!(false, "{part}"),
            }
            moving.begin(id, &swing, Some(&drives), board, now_s, now_s + hold_s);
            now_s += hold_s;
            board = Board::Driving;
            if !goes_on {
                moving.end(now_s, Ending::AtItsBoundary);
                now_s += 0.01;
                board = Board::Up;
            }
        }
    }
}
