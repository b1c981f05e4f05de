//! A bound on an error, or why there is none.

use super::Accuracy;

/// A bound on an error, or why there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// The error is at most this.
    AtMost(f64),
    /// Nothing is known, for this reason.
    Unknown(&'static str),
}

impl Bound {
    /// The largest possible error; `None` if no bound is known.
    #[must_use]
    pub fn limit_if_known(self) -> Option<f64> {
        match self {
            Bound::AtMost(value) => Some(value),
            Bound::Unknown(_) => None,
        }
    }

    /// Why no bound is known; `None` if one is.
    #[must_use]
    pub fn reason_if_unknown(self) -> Option<&'static str> {
        match self {
            Bound::AtMost(_) => None,
            Bound::Unknown(reason) => Some(reason),
        }
    }

    /// Whether all bounds are within what was asked for; `None` where nothing was, or where one is missing and none is above it.
    #[must_use]
    pub fn all_meet_tolerance_if_given_and_decidable(bounds: &[Bound], accuracy: Accuracy) -> Option<bool> {
        let tolerance = accuracy.tolerance_unless_time_limit_given()?;
        if bounds.iter().filter_map(|bound| bound.limit_if_known()).any(|bound| bound > tolerance) {
            return Some(false);
        }
        bounds.iter().all(|bound| bound.limit_if_known().is_some()).then_some(true)
    }
}
