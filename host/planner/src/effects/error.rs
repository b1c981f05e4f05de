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
        "the effect cannot be designed, because a drive excites an undamped mode at its resonance frequency: add \
         damping to the scene"
    )]
    Unbounded,
}
