//! Why there is no effect.

use super::named::EffectError;

/// Why there is no effect.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DesignError {
    /// Its parameters.
    #[error(transparent)]
    Request(#[from] EffectError),
    /// A panel whose poles or response could not be found.
    #[error("no effect can be designed: a drive meets the resonance of an undamped mode")]
    Unbounded,
}
