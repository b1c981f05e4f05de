//! Why there is no effect.

use super::named::EffectError;

/// Why there is no effect.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DesignError {
    /// Its parameters.
    #[error(transparent)]
    Request(#[from] EffectError),
    /// A panel whose poles or response could not be found.
    #[error(
        "the effect cannot be designed, because a drive has the resonance frequency of a mode without damping: add \
         damping to the scene"
    )]
    Unbounded,
}
