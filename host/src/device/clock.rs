//! The board's clock as the host sees it, estimated in the manner of Klipper's clock synchronisation (its
//! `docs/Code_Overview.md` and `klippy/clocksync.py`).
//!
//! Every sample is a question sent at one time of the host, answered with the board's time, and read at a later time of the
//! host. A linear regression with decaying weights fits the board's time against the time of sending; the least half round
//! trip that was ever seen is how much later than its sending the board read its clock. A sample whose board time is late
//! beyond what the earlier ones allow was held up on the way and is left out.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Weight of a new sample in the averages: they look back over some 30 samples.
const DECAY: f64 = 1.0 / 30.0;
/// The least half round trip grows by this much for each second of its age, so that a lasting change is followed: 10 us
/// an hour.
const ROUND_TRIP_AGEING: f64 = 10e-6 / 3600.0;
/// A sample is late if it is off by more than this many standard deviations ...
const OUTLIER_DEVIATIONS: f64 = 5.0;
/// ... and by more than this, in s.
const OUTLIER_S: f64 = 0.5e-3;
/// For how long, in s, late samples are left out before they are believed: the clock itself has then jumped.
const DOUBT_S: f64 = 10.0;
/// Difference, in s, from which on the clock, or this computer, has stood still for a while: what is known of the rate stays, and the line is moved. An
/// oscillator that is 1 % off is 10 ms off after a second.
const JUMP_S: f64 = 20e-3;
/// Samples in a row that have to be as predicted before one that counts as that: where the rate is another one than was thought each sample is off, and
/// that is to be learnt.
const GOOD_BEFORE_JUMP: u64 = 4;
/// Standard deviation of a prediction that is assumed where none is known, in s.
const DEVIATION_AT_FIRST_S: f64 = 1e-3;
/// Spread of the times of sending, in s, from which on a rate is worked out: 0.1 ms of jitter over it are 0.2 %, which is
/// 2 ms over the second to the next sample, and halves with each that follows.
const LEAST_SPREAD_S: f64 = 0.05;
/// Samples that the residual is taken over.
const RESIDUALS: usize = 32;

/// How well the two clocks are known to agree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockQuality {
    /// Samples taken since the clock was last reset, those left out included.
    pub samples: u64,
    /// Samples left out as late.
    pub outliers: u64,
    /// How much faster than the host's the board's clock runs, in parts per million.
    pub rate_ppm: f64,
    /// Least half round trip in s: the offset between sending and the board's reading of its clock, and the bound on the
    /// error of that.
    pub half_round_trip_s: f64,
    /// Root mean square in s of the differences between what was predicted and what the board said, over the last 32 samples
    /// that were not left out.
    pub residual_rms_s: f64,
    /// Largest magnitude of them in s.
    pub residual_worst_s: f64,
}

/// The estimate.
#[derive(Clone, Debug)]
pub struct ClockSync {
    /// The host's time zero; times in s are since then.
    zero: Instant,
    fit: Option<ClockFit>,
}

/// When a question was sent and its answer read, in s, and what it said.
#[derive(Clone, Copy, Debug)]
struct ClockSample {
    sent_s: f64,
    received_s: f64,
    board_us: u64,
}

#[derive(Clone, Debug)]
struct ClockFit {
    /// The board's time zero in us: the first sample's.
    board_zero_us: u64,
    last: ClockSample,
    samples: u64,
    outliers: u64,
    least_half_s: f64,
    least_half_at_s: f64,
    /// Weighted means of the times of sending and of the board's times, in s.
    sent_mean: f64,
    board_mean: f64,
    variance: f64,
    covariance: f64,
    prediction_variance: f64,
    last_good_s: f64,
    /// Samples in a row, up to the last one, that were as predicted.
    good_in_a_row: u64,
    residuals: VecDeque<f64>,
}

impl ClockFit {
    fn board_seconds_per_host_second(&self) -> f64 {
        if self.variance < LEAST_SPREAD_S * LEAST_SPREAD_S { 1.0 } else { self.covariance / self.variance }
    }

    /// The board's time in s, of a question sent at `sent_s`.
    fn fitted_board_time_s_in_answer_to_request_sent_at(&self, sent_s: f64) -> f64 {
        self.board_mean + (sent_s - self.sent_mean) * self.board_seconds_per_host_second()
    }

    /// The board's time in s at `time_s` of the host: the fitted line, shifted if need be so that the last answer was given between its question and
    /// its arrival. So an estimate that cannot follow the clock is still right to a round trip.
    fn board_time_s_at_host_time_clamped_by_last_sample(&self, time_s: f64) -> f64 {
        let ClockSample { sent_s, received_s, board_us } = self.last;
        let least_s = microseconds_to_seconds(board_us - self.board_zero_us);
        let found_s = self.fitted_board_time_s_in_answer_to_request_sent_at(received_s - self.least_half_s);
        let true_s = found_s.clamp(least_s, least_s + (received_s - sent_s).max(0.0));
        self.fitted_board_time_s_in_answer_to_request_sent_at(time_s - self.least_half_s) + (true_s - found_s)
    }

    fn add_sample_shifting_fit_on_clock_jump_unless_late_outlier(
        &mut self,
        sent_s: f64,
        half_round_trip_s: f64,
        board_s: f64,
    ) {
        self.samples += 1;
        if half_round_trip_s < self.least_half_s + (sent_s - self.least_half_at_s) * ROUND_TRIP_AGEING {
            (self.least_half_s, self.least_half_at_s) = (half_round_trip_s, sent_s);
        }
        let off = board_s - self.fitted_board_time_s_in_answer_to_request_sent_at(sent_s);
        let limit = (OUTLIER_DEVIATIONS * self.prediction_variance.sqrt()).max(OUTLIER_S);
        if off.abs() > limit {
            if off > 0.0 && sent_s < self.last_good_s + DOUBT_S {
                self.outliers += 1;
                return;
            }
            let is_jump = off.abs() > JUMP_S && self.good_in_a_row >= GOOD_BEFORE_JUMP;
            self.good_in_a_row = 0;
            if is_jump {
                self.board_mean += off;
                self.last_good_s = sent_s;
                return;
            }
            // Early, which no delay can be, or late for long: the clock is another than it was thought to be.
            self.prediction_variance = DEVIATION_AT_FIRST_S * DEVIATION_AT_FIRST_S;
        } else {
            self.last_good_s = sent_s;
            self.good_in_a_row += 1;
            self.prediction_variance = (1.0 - DECAY) * (self.prediction_variance + off * off * DECAY);
        }
        if self.residuals.len() == RESIDUALS {
            self.residuals.pop_front();
        }
        self.residuals.push_back(off);
        let (sent_off, board_off) = (sent_s - self.sent_mean, board_s - self.board_mean);
        self.sent_mean += DECAY * sent_off;
        self.board_mean += DECAY * board_off;
        self.variance = (1.0 - DECAY) * (self.variance + sent_off * sent_off * DECAY);
        self.covariance = (1.0 - DECAY) * (self.covariance + sent_off * board_off * DECAY);
    }
}

impl ClockSync {
    /// An estimate without samples; `zero` is any time before the first sample.
    #[must_use]
    pub const fn new(zero: Instant) -> Self {
        Self { zero, fit: None }
    }

    /// Forgets all samples, because the board has restarted.
    pub fn forget_samples(&mut self) {
        self.fit = None;
    }

    /// Adds a question that was sent at `sent`, and whose answer `board_us`, the board's time, was read at `received`. A board whose clock has gone
    /// back has restarted, and all earlier samples are forgotten.
    pub fn add_sample_forgetting_earlier_if_board_clock_went_back(
        &mut self,
        sent: Instant,
        received: Instant,
        board_us: u64,
    ) {
        let sent_s = self.seconds_since_zero(sent);
        let received_s = self.seconds_since_zero(received).max(sent_s);
        let half_s = 0.5 * (received_s - sent_s);
        let last = ClockSample { sent_s, received_s, board_us };
        if self.fit.as_ref().is_some_and(|fit| board_us < fit.last.board_us) {
            self.forget_samples();
        }
        match &mut self.fit {
            Some(fit) => {
                fit.last = last;
                let board_s = microseconds_to_seconds(board_us - fit.board_zero_us);
                fit.add_sample_shifting_fit_on_clock_jump_unless_late_outlier(sent_s, half_s, board_s);
            }
            none => {
                *none = Some(ClockFit {
                    board_zero_us: board_us,
                    last,
                    samples: 1,
                    outliers: 0,
                    least_half_s: half_s,
                    least_half_at_s: sent_s,
                    sent_mean: sent_s,
                    board_mean: 0.0,
                    variance: 0.0,
                    covariance: 0.0,
                    prediction_variance: DEVIATION_AT_FIRST_S * DEVIATION_AT_FIRST_S,
                    // The first samples are believed whatever they say: there is nothing to doubt them by.
                    last_good_s: sent_s - DOUBT_S,
                    good_in_a_row: 0,
                    residuals: VecDeque::new(),
                });
            }
        }
    }

    /// The board's time in us at a time of the host; `None` without a sample, or for a time before the board's zero.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "`as` saturates")]
    pub fn board_time_us_at(&self, when: Instant) -> Option<u64> {
        let fit = self.fit.as_ref()?;
        // The board reads its clock half a round trip after the question was sent.
        let since_s = fit.board_time_s_at_host_time_clamped_by_last_sample(self.seconds_since_zero(when));
        fit.board_zero_us.checked_add_signed((since_s * 1e6).round() as i64)
    }

    /// How well the clocks agree; `None` before the second sample.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "at most 32 residuals")]
    pub fn quality_if_two_samples(&self) -> Option<ClockQuality> {
        let fit = self.fit.as_ref().filter(|fit| !fit.residuals.is_empty())?;
        let squares: f64 = fit.residuals.iter().map(|off| off * off).sum();
        Some(ClockQuality {
            samples: fit.samples,
            outliers: fit.outliers,
            rate_ppm: (fit.board_seconds_per_host_second() - 1.0) * 1e6,
            half_round_trip_s: fit.least_half_s,
            residual_rms_s: (squares / fit.residuals.len() as f64).sqrt(),
            residual_worst_s: fit.residuals.iter().fold(0.0, |worst, off| worst.max(off.abs())),
        })
    }

    fn seconds_since_zero(&self, when: Instant) -> f64 {
        let before = || -self.zero.saturating_duration_since(when).as_secs_f64();
        when.checked_duration_since(self.zero).map_or_else(before, |since: Duration| since.as_secs_f64())
    }
}

#[expect(clippy::cast_precision_loss, reason = "exact for 285 years")]
fn microseconds_to_seconds(microseconds: u64) -> f64 {
    microseconds as f64 / 1e6
}
