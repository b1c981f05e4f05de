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
    /// The number, if there is one.
    #[must_use]
    pub fn value(self) -> Option<f64> {
        match self {
            Bound::AtMost(value) => Some(value),
            Bound::Unknown(_) => None,
        }
    }

    /// Why there is none.
    #[must_use]
    pub fn reason(self) -> Option<&'static str> {
        match self {
            Bound::AtMost(_) => None,
            Bound::Unknown(reason) => Some(reason),
        }
    }

    /// Whether all bounds are within what was asked for; `None` where nothing was, or where one is missing and none is above it.
    #[must_use]
    pub fn are_met(bounds: &[Bound], accuracy: Accuracy) -> Option<bool> {
        let tolerance = accuracy.asked()?;
        if bounds.iter().filter_map(|bound| bound.value()).any(|bound| bound > tolerance) {
            return Some(false);
        }
        bounds.iter().all(|bound| bound.value().is_some()).then_some(true)
    }
}
