//! How accurate an answer is asked to be, and what mesh that takes.

use super::ModelError;
use std::str::FromStr;

/// A relative tolerance, by name or number.
///
/// It chooses the mesh: the error of conforming cubic elements falls as h^4, and the sizes below were set so that the
/// reference values in `host/tests/model_reference.rs` are met with room. No error bound is computed for an answer yet;
/// the program says so wherever it prints one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accuracy {
    tolerance: f64,
}

/// Tightest tolerance that a mesh is chosen for.
const TIGHTEST: f64 = 1e-8;
/// Loosest.
const LOOSEST: f64 = 0.1;

impl Accuracy {
    /// 1e-2.
    pub const FAST: Accuracy = Accuracy { tolerance: 1e-2 };
    /// 1e-3.
    pub const BALANCED: Accuracy = Accuracy { tolerance: 1e-3 };
    /// 1e-6.
    pub const REFERENCE: Accuracy = Accuracy { tolerance: 1e-6 };

    /// A tolerance between 1e-8 and 0.1.
    ///
    /// # Errors
    /// [`ModelError::Tolerance`] outside that range.
    pub fn tolerance(value: f64) -> Result<Self, ModelError> {
        if (TIGHTEST..=LOOSEST).contains(&value) {
            return Ok(Self { tolerance: value });
        }
        Err(ModelError::Tolerance { value, min: TIGHTEST, max: LOOSEST })
    }

    /// The tolerance as a number.
    #[must_use]
    pub const fn value(self) -> f64 {
        self.tolerance
    }

    /// Cells along the longer side of the panel: 24 at 1e-2, 48 at 1e-3, 96 at 1e-6 and below.
    #[must_use]
    pub fn cells(self) -> f64 {
        match self.tolerance {
            t if t > 3e-3 => 24.0,
            t if t > 1e-4 => 48.0,
            _ => 96.0,
        }
    }

    /// Cells per bending wave at the highest frequency. A cubic beam element's frequency is off by (k h)^4/1440, with
    /// k h = 2 pi / n: 8e-4 for 6 cells, 1e-4 for 10, 1e-6 for 32.
    #[must_use]
    pub fn cells_per_wave(self) -> f64 {
        let kh = (1440.0 * self.tolerance * 0.1).powf(0.25);
        (std::f64::consts::TAU / kh).clamp(6.0, 32.0)
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
