//! When a position passes a detent, without the rattle of a position that rests on one.

/// How far a position must be from a detent that it has passed, in steps, before it can pass the same detent again.
pub const HYSTERESIS: f64 = 0.25;

/// Follows a position among detents, which are at the whole numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetentTracker {
    /// The detent below the gap in which the position was last.
    gap: f64,
    /// The detent from which it has not yet been as far as [`HYSTERESIS`].
    near: Option<NearDetent>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct NearDetent {
    detent: f64,
    /// It has come down there, or it cannot go on behind it: to leave it to either side passes nothing.
    is_stood_on: bool,
}

impl DetentTracker {
    /// That of a position that has just come: it has passed nothing, and stands on a detent that is as near as [`HYSTERESIS`].
    #[must_use]
    pub fn new(position: f64) -> Self {
        let detent = position.round();
        let is_near = (position - detent).abs() < HYSTERESIS;
        Self { gap: position.floor(), near: is_near.then_some(NearDetent { detent, is_stood_on: true }) }
    }

    /// Moves on to a position; whether that passes a detent, or several. Behind the `ends`, if there are any, nothing is passed.
    pub fn move_to_position_and_check_if_detent_passed(
        &mut self,
        position: f64,
        first_and_last_detent: Option<[f64; 2]>,
    ) -> bool {
        if let Some(near) = self.near {
            if (position - near.detent).abs() < HYSTERESIS {
                return false;
            }
            self.near = None;
            if near.is_stood_on {
                self.gap = if position > near.detent { near.detent } else { near.detent - 1.0 };
            }
        }
        let gap = position.floor();
        if gap == self.gap {
            return false;
        }
        let passed_last = if gap > self.gap { gap } else { gap + 1.0 };
        self.gap = gap;
        let is_near = (position - passed_last).abs() < HYSTERESIS;
        let is_stood_on =
            first_and_last_detent.is_some_and(|first_and_last_detent| first_and_last_detent.contains(&passed_last));
        self.near = is_near.then_some(NearDetent { detent: passed_last, is_stood_on });
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn count_passes(path: &[f64], ends: Option<[f64; 2]>) -> usize {
        let mut tracker = DetentTracker::new(path[0]);
        path.iter().filter(|position| tracker.move_to_position_and_check_if_detent_passed(**position, ends)).count()
    }

    /// From one position to another in steps of at most `step`.
    fn make_stepped_path(from: f64, to: f64, step: f64) -> Vec<f64> {
        let mut path = vec![from];
        while (to - path[path.len() - 1]).abs() > step {
            path.push(path[path.len() - 1] + step.copysign(to - from));
        }
        path.push(to);
        path
    }

    #[test]
    fn a_detent_is_passed_where_it_is() {
        let mut tracker = DetentTracker::new(0.5);
        for (position, passes) in [
            (0.99, false),
            (1.0, true),
            (1.2, false),
            (0.9, false),
            (1.1, false),
            // Back beyond the hysteresis.
            (0.74, true),
            (1.0, true),
            (1.25, false),
            // Several at once are one.
            (5.5, true),
            (4.99, true),
        ] {
            assert_eq!(tracker.move_to_position_and_check_if_detent_passed(position, None), passes, "at {position}");
        }
        // Who comes down on a detent leaves it without passing it.
        assert_eq!((count_passes(&[3.1, 2.7, 2.1], None), count_passes(&[2.9, 3.9], None)), (0, 0));
    }

    #[test]
    fn an_end_is_felt_once() {
        let ends = Some([0.0, 4.0]);
        assert_eq!(count_passes(&[3.5, 4.01, 4.01, 4.01], ends), 1);
        assert_eq!(count_passes(&[3.5, 4.01, 3.5, 3.2], ends), 1, "it is not felt when it is left");
        assert_eq!(count_passes(&[3.5, 4.01, 3.5, 4.01], ends), 2, "it is felt again when it is reached again");
        assert_eq!(count_passes(&[0.5, -0.01, -0.01, 0.5], ends), 1);
        assert_eq!(count_passes(&[-0.01, 0.5, 1.5], ends), 1, "who comes down there does not feel it");
    }

    proptest! {
        /// However often it is told of, and however far it goes between: as many as it has passed, but for the one that it stood on.
        #[test]
        fn a_slow_slide_passes_each_detent_once(from in -20.0..20.0, to in -20.0..20.0, step in 0.01..0.99) {
            let between = |detent: &i32| {
                let detent = f64::from(*detent);
                let is_between = if to > from { from < detent && detent <= to } else { to < detent && detent <= from };
                is_between && (detent - from).abs() >= HYSTERESIS
            };
            let wanted = (-25..25).filter(between).count();
            prop_assert_eq!(count_passes(&make_stepped_path(from, to, step), None), wanted);
        }

        /// Wherever it rests, and whatever it was before: within a quarter of a step it passes nothing, or, where it came in between, once.
        #[test]
        fn what_rattles_passes_nothing(rest in -5.0..5.0, noise in prop::collection::vec(0.0..0.2499, 1..60), from in -9.0..9.0) {
            let rattle: Vec<f64> = noise.iter().map(|part| rest + part).collect();
            prop_assert_eq!(count_passes(&rattle, None), 0);
            let mut came: Vec<f64> = make_stepped_path(from, rest, 0.1);
            let before = count_passes(&came, None);
            came.extend(&rattle);
            prop_assert!(count_passes(&came, None) - before <= 1);
        }

        /// Never more often than it crosses one.
        #[test]
        fn a_random_path_passes_no_more_than_it_crosses(path in prop::collection::vec(-9.0..9.0_f64, 1..60)) {
            let crosses = path.windows(2).filter(|pair| pair[0].floor() != pair[1].floor()).count();
            prop_assert!(count_passes(&path, None) <= crosses);
        }
    }
}
