//! A bound on an error, or why there is none.

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
}
