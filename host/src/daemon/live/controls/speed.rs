//! How fast a finger moves, from where it was when.

use std::time::{Duration, Instant};

/// Time constant of the mean speed: three messages of a page that sends 60 a second, so that their uneven times are not felt.
const SMOOTHING: Duration = Duration::from_millis(50);
/// A finger that has not moved for so long rests: three messages in which it could have.
pub const REST: Duration = Duration::from_millis(50);

/// Follows a finger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedTracker {
    x_px: f64,
    y_px: f64,
    speed_px_s: f64,
    seen: Instant,
    moved: Instant,
}

impl SpeedTracker {
    /// That of a finger that has just come.
    #[must_use]
    pub const fn new(x_px: f64, y_px: f64, now: Instant) -> Self {
        Self { x_px, y_px, speed_px_s: 0.0, seen: now, moved: now }
    }

    /// Moves on, or stays.
    pub fn move_finger(&mut self, x_px: f64, y_px: f64, now: Instant) {
        let way_px = (x_px - self.x_px).hypot(y_px - self.y_px);
        let time = now.saturating_duration_since(self.seen).as_secs_f64();
        let smoothing = SMOOTHING.as_secs_f64();
        // The exponential mean over time of a speed that is even between two messages. Of messages that come together, which have no time between
        // them, the way counts all the same.
        let kept = (-time / smoothing).exp();
        let part_per_s = if time > 0.0 { -(-time / smoothing).exp_m1() / time } else { 1.0 / smoothing };
        self.speed_px_s = self.speed_px_s * kept + way_px * part_per_s;
        if way_px > 0.0 {
            self.moved = now;
        } else if self.find_time_when_moving_stroke_will_rest() <= now {
            self.speed_px_s = 0.0;
        }
        (self.x_px, self.y_px, self.seen) = (x_px, y_px, now);
    }

    /// Mean speed in px/s.
    #[must_use]
    pub const fn speed_px_s(&self) -> f64 {
        self.speed_px_s
    }

    /// From when on it rests, if it does not move before.
    #[must_use]
    pub fn find_time_when_moving_stroke_will_rest(&self) -> Instant {
        self.moved + REST
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Speed after a finger has moved evenly for a second, seen at these times.
    fn speed_after(times_s: &[f64], speed_px_s: f64) -> f64 {
        let start = Instant::now();
        let mut tracker = SpeedTracker::new(0.0, 0.0, start);
        for time in times_s {
            tracker.move_finger(speed_px_s * time, 0.0, start + Duration::from_secs_f64(*time));
        }
        tracker.speed_px_s()
    }

    #[test]
    fn a_finger_that_stays_rests_at_once_after_its_time() {
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let mut tracker = SpeedTracker::new(0.0, 0.0, start);
        assert_eq!(tracker.speed_px_s(), 0.0);
        tracker.move_finger(10.0, 0.0, at(10));
        tracker.move_finger(10.0, 0.0, at(59));
        assert!(tracker.speed_px_s() > 0.0);
        tracker.move_finger(10.0, 0.0, at(60));
        assert_eq!((tracker.speed_px_s(), tracker.find_time_when_moving_stroke_will_rest()), (0.0, at(60)));
        // Messages that come together.
        tracker.move_finger(15.0, 0.0, at(70));
        let before = tracker.speed_px_s();
        tracker.move_finger(15.0, 5.0, at(70));
        assert!(tracker.speed_px_s() > before && tracker.speed_px_s() < 1000.0, "{}", tracker.speed_px_s());
    }

    proptest! {
        /// An even motion has its speed, however unevenly it is told of.
        #[test]
        fn messages_at_uneven_times_give_the_same_speed(
            gaps in prop::collection::vec(0.0..0.045, 40..80), speed_px_s in 1.0..5000.0_f64,
        ) {
            let mut time = 0.0;
            let times: Vec<f64> = gaps.iter().map(|gap| { time += gap; time }).collect();
            prop_assume!(time > 0.5);
            let found = speed_after(&times, speed_px_s);
            prop_assert!((found / speed_px_s - 1.0).abs() < 1e-3, "{found} for {speed_px_s}");
        }
    }
}
