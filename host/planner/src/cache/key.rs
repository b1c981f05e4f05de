//! What a table follows from, as one number.

use crate::TableOptions;
use crate::model::Accuracy;
use crate::scene::Scene;
use sha2::{Digest, Sha256};
use std::fmt;

/// Version of the file's form; what it is about is in the key.
pub(super) const FORMAT: u32 = 1;
/// Hash of all the code of this program, the compiler and what it was told, as the build found them (`code.rs`).
const CODE: &str = env!("ERA_CODE");

/// SHA-256 of a scene as it was understood (comments and the order of keys are of no account), tolerance, frequencies,
/// version and code.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Key(pub(super) [u8; 32]);

impl Key {
    /// The key of a table; `None` for a scene that has no such form, which no scene is known to do.
    #[must_use]
    pub fn new(scene: &Scene, accuracy: Accuracy, options: TableOptions) -> Option<Self> {
        let TableOptions { from_hz, to_hz, step_hz } = options;
        let numbers = [accuracy.relative_tolerance_or_tightest(), from_hz, to_hz, step_hz];
        let from = (FORMAT, env!("CARGO_PKG_VERSION"), CODE, numbers, scene);
        let bytes = postcard::to_allocvec(&from).ok()?;
        Some(Self(Sha256::digest(bytes).into()))
    }
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Key({self})")
    }
}
