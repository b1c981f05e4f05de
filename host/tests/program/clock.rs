//! The estimate of the board's clock against clocks that drift, links that jitter and boards that restart.

use era::device::ClockSync;
use proptest::prelude::*;
use std::time::{Duration, Instant};

/// A board whose clock runs at `rate` times the host's, behind a link.
struct Board {
    zero: Instant,
    rate: f64,
    offset_us: f64,
}

impl Board {
    fn us_at(&self, host_s: f64) -> f64 {
        self.offset_us + host_s * self.rate * 1e6
    }

    /// A question sent at `sent_s` that takes `there_s` to the board, whose answer takes `back_s`.
    fn ask(&self, clock: &mut ClockSync, sent_s: f64, there_s: f64, back_s: f64) {
        let at = |s: f64| self.zero + Duration::from_secs_f64(s);
        clock.add_sample_forgetting_earlier_if_board_clock_went_back(
            at(sent_s),
            at(sent_s + there_s + back_s),
            self.us_at(sent_s + there_s) as u64,
        );
    }

    /// How far the estimate is off at `host_s`, in s.
    fn error_s(&self, clock: &ClockSync, host_s: f64) -> f64 {
        let found = clock.board_time_us_at(self.zero + Duration::from_secs_f64(host_s)).expect("sampled");
        (found as f64 - self.us_at(host_s)) / 1e6
    }
}

/// When a session samples: every 50 ms at first, then every second.
fn times(count: usize) -> impl Iterator<Item = f64> {
    (0..count).map(|i| if i < 8 { 0.05 * i as f64 } else { 0.35 + (i - 7) as f64 })
}

proptest! {
    /// Once it has looked for a while, the estimate is right to the asymmetry of the shortest trip and the jitter, and it
    /// knows the rate; the residual that it reports is of the jitter's size.
    #[test]
    fn drift_and_jitter(
        drift_ppm in -2_000.0..2_000.0_f64,
        offset_s in 0.0..1e5_f64,
        trip_ms in 0.1..20.0_f64,
        jitter in prop::collection::vec((0.0..0.3e-3_f64, 0.0..0.3e-3_f64), 90),
    ) {
        let board = Board { zero: Instant::now(), rate: 1.0 + drift_ppm / 1e6, offset_us: offset_s * 1e6 };
        let mut clock = ClockSync::new(board.zero);
        let half_s = trip_ms / 2e3;
        let mut last_s = 0.0;
        for (sent_s, (there_s, back_s)) in times(jitter.len()).zip(&jitter) {
            board.ask(&mut clock, sent_s, half_s + there_s, half_s + back_s);
            last_s = sent_s;
        }
        let quality = clock.quality_if_two_samples().expect("sampled");
        prop_assert_eq!(quality.samples, jitter.len() as u64);
        prop_assert!((quality.rate_ppm - drift_ppm).abs() < 20.0, "{:?}", quality);
        // Half the jitter's mean is taken for the trip's; a second ahead the rate adds its own.
        for ahead_s in [0.0, 0.5, 1.0] {
            let error_s = board.error_s(&clock, last_s + ahead_s);
            prop_assert!(error_s.abs() < 0.3e-3, "{error_s} s, {ahead_s} s ahead: {:?}", quality);
        }
        prop_assert!(quality.residual_rms_s < 0.2e-3 && quality.residual_worst_s < 0.4e-3, "{:?}", quality);
        prop_assert!(quality.half_round_trip_s >= half_s - 1e-9, "{:?}", quality);
    }

    /// One answer in eight that was held up for long, on its way there or back, changes nothing to speak of.
    #[test]
    fn outliers(holds in prop::collection::vec(0.005..0.4_f64, 15), back in any::<bool>()) {
        let board = Board { zero: Instant::now(), rate: 1.0 + 40e-6, offset_us: 5e6 };
        let mut clock = ClockSync::new(board.zero);
        let mut held = holds.iter();
        let mut last_s = 0.0;
        for (i, sent_s) in times(120).enumerate() {
            let hold_s = if i % 8 == 7 { held.next().copied().unwrap_or(0.0) } else { 0.0 };
            let (there_s, back_s) = if back { (0.0, hold_s) } else { (hold_s, 0.0) };
            board.ask(&mut clock, sent_s, 1e-3 + there_s, 1e-3 + back_s);
            last_s = sent_s;
        }
        let quality = clock.quality_if_two_samples().expect("sampled");
        prop_assert_eq!(quality.outliers, if back { 0 } else { holds.len() as u64 });
        let error_s = board.error_s(&clock, last_s + 1.0);
        prop_assert!(error_s.abs() < 50e-6, "{error_s} s: {:?}", quality);
    }

    /// A restarted board begins at zero again: nothing of the old clock is left.
    #[test]
    fn restart(before in 10_usize..60, downtime_s in 0.1..5.0_f64) {
        let zero = Instant::now();
        let old = Board { zero, rate: 1.0 - 100e-6, offset_us: 3e8 };
        let mut clock = ClockSync::new(zero);
        for sent_s in times(before) {
            old.ask(&mut clock, sent_s, 1e-3, 1e-3);
        }
        let begun_s = times(before).last().unwrap_or(0.0) + downtime_s;
        let new = Board { zero, rate: 1.0 + 100e-6, offset_us: -begun_s * (1.0 + 100e-6) * 1e6 };
        for sent_s in times(20) {
            new.ask(&mut clock, begun_s + 0.01 + sent_s, 1e-3, 1e-3);
        }
        prop_assert_eq!(clock.quality_if_two_samples().expect("sampled").samples, 20);
        prop_assert!(new.error_s(&clock, begun_s + 14.0).abs() < 50e-6);
    }
}

#[test]
fn a_lasting_jump_is_believed_after_a_while() {
    let zero = Instant::now();
    let mut board = Board { zero, rate: 1.0, offset_us: 1e6 };
    let mut clock = ClockSync::new(zero);
    for i in 0..40 {
        board.ask(&mut clock, f64::from(i), 1e-3, 1e-3);
    }
    // Forward by 0.2 s: taken for delays at first, for the clock itself in the end. Between question and answer the board's
    // time is known all the same.
    board.offset_us += 0.2e6;
    for i in 40..45 {
        board.ask(&mut clock, f64::from(i), 1e-3, 1e-3);
    }
    assert_eq!(clock.quality_if_two_samples().expect("sampled").outliers, 5);
    assert!(board.error_s(&clock, 44.002).abs() < 2.1e-3, "right to a round trip");
    for i in 45..400 {
        board.ask(&mut clock, f64::from(i), 1e-3, 1e-3);
    }
    let error_s = board.error_s(&clock, 400.0);
    assert!(error_s.abs() < 1e-3, "{error_s}");
}

/// A computer that stands still for a while, and with it a simulated board, or one that sleeps beside a real one, says nothing of an oscillator. One whose
/// rate is another is found all the same.
#[test]
fn a_stall_is_no_rate() {
    for stall_s in [0.03, 0.2, 1.5, -0.2, -3600.0] {
        let mut board = Board { zero: Instant::now(), rate: 1.0 + 50e-6, offset_us: 5e9 };
        let mut clock = ClockSync::new(board.zero);
        for (number, sent_s) in times(80).enumerate() {
            // Two of them.
            if number == 30 || number == 45 {
                board.offset_us -= stall_s * 1e6;
            }
            board.ask(&mut clock, sent_s, 1e-3, 1e-3);
        }
        let quality = clock.quality_if_two_samples().expect("sampled");
        assert!((quality.rate_ppm - 50.0).abs() < 20.0 && quality.residual_worst_s < 1e-3, "{stall_s}: {quality:?}");
        assert!(board.error_s(&clock, 73.0).abs() < 0.2e-3, "{stall_s}");
    }
    let mut board = Board { zero: Instant::now(), rate: 1.0, offset_us: 5e9 };
    let mut clock = ClockSync::new(board.zero);
    for (number, sent_s) in times(160).enumerate() {
        if number == 30 {
            // From here on 5 % slow.
            board.offset_us += 0.05 * sent_s * 1e6;
            board.rate = 0.95;
        }
        board.ask(&mut clock, sent_s, 1e-3, 1e-3);
    }
    let quality = clock.quality_if_two_samples().expect("sampled");
    assert!((quality.rate_ppm + 50_000.0).abs() < 5_000.0, "{quality:?}");
}

#[test]
fn nothing_is_known_before_it_is_asked() {
    let zero = Instant::now();
    let mut clock = ClockSync::new(zero);
    assert_eq!((clock.board_time_us_at(zero), clock.quality_if_two_samples()), (None, None));
    clock.add_sample_forgetting_earlier_if_board_clock_went_back(zero, zero, 77);
    assert_eq!((clock.board_time_us_at(zero), clock.quality_if_two_samples()), (Some(77), None));
    clock.forget_samples();
    assert_eq!(clock.board_time_us_at(zero), None);
}
