//! How accurate an answer is asked to be.

use super::ModelError;
use std::str::FromStr;
use std::time::Duration;

/// A relative tolerance, by name or number, or the time that there is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accuracy {
    tolerance: f64,
    within: Option<Duration>,
}

/// Tightest tolerance that a mesh is chosen for.
const TIGHTEST: f64 = 1e-8;
/// Loosest.
const LOOSEST: f64 = 0.1;

impl Accuracy {
    /// 1e-2.
    pub const FAST: Accuracy = Accuracy { tolerance: 1e-2, within: None };
    /// 1e-3.
    pub const BALANCED: Accuracy = Accuracy { tolerance: 1e-3, within: None };
    /// 1e-6.
    pub const REFERENCE: Accuracy = Accuracy { tolerance: 1e-6, within: None };

    /// A tolerance between 1e-8 and 0.1.
    ///
    /// # Errors
    /// [`ModelError::Tolerance`] outside that range.
    pub fn from_tolerance(value: f64) -> Result<Self, ModelError> {
        if (TIGHTEST..=LOOSEST).contains(&value) {
            return Ok(Self { tolerance: value, within: None });
        }
        Err(ModelError::Tolerance { value, min: TIGHTEST, max: LOOSEST })
    }

    /// As accurate as can be had within a time, from the first level on: at least two levels are asked, however long they take.
    #[must_use]
    pub const fn best_within_time(time: Duration) -> Self {
        Self { tolerance: TIGHTEST, within: Some(time) }
    }

    /// The time that there is, if that is what was asked for.
    #[must_use]
    pub const fn time_limit(self) -> Option<Duration> {
        self.within
    }

    /// The relative tolerance; the tightest one where a time limit was given instead.
    #[must_use]
    pub const fn relative_tolerance_or_tightest(self) -> f64 {
        self.tolerance
    }

    /// The tolerance that was asked for; `None` where a time limit was.
    #[must_use]
    pub fn tolerance_unless_time_limit_given(self) -> Option<f64> {
        self.within.is_none().then_some(self.tolerance)
    }

    /// Order of the elements that usually meets it, for responses of panels with a damping of 1 %: 7 down to 1e-3, 9
    /// down to 1e-5, 11 below.
    #[must_use]
    pub fn choose_element_order_for_tolerance(self) -> usize {
        match self.tolerance {
            t if t >= 1e-3 => 7,
            t if t >= 1e-5 => 9,
            _ => 11,
        }
    }
}

impl FromStr for Accuracy {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "fast" => Ok(Self::FAST),
            "balanced" => Ok(Self::BALANCED),
            "reference" => Ok(Self::REFERENCE),
            other => Err(format!("{other:?} is not one of fast, balanced, reference")),
        }
    }
}
