//! What can go wrong in the model.

/// Why there is no model, or no answer from it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// The mesh would have to be finer than is allowed.
    #[error(
        "at {max_hz} Hz the bending waves of this surface are {wavelength_mm:.2} mm long; a mesh for these waves needs \
         {unknowns} unknowns, but at most {limit} are allowed: choose a lower frequency or a larger tolerance{}",
        if *is_short { "; the waves are hardly longer than the thickness of the surface: check that youngs_modulus_pa is correct and in Pa" } else { "" }
    )]
    TooFine {
        /// Highest frequency asked for.
        max_hz: f64,
        /// Bending wavelength there.
        wavelength_mm: f64,
        /// Whether a thin surface's theory has an end there.
        is_short: bool,
        /// Unknowns of the mesh.
        unknowns: usize,
        /// Most allowed.
        limit: usize,
    },
    /// More modes than are computed in a time worth waiting for.
    #[error(
        "the computation needs all modes of this surface up to {max_hz:.0} Hz (about {modes} modes), but at \
         most {limit} modes are allowed: choose a lower frequency"
    )]
    TooManyModes {
        /// Frequency up to which they are needed.
        max_hz: f64,
        /// About how many there are.
        modes: usize,
        /// Most allowed.
        limit: usize,
    },
    /// A frequency that is no frequency.
    #[error("{what} is {value} Hz, but must be above {min} Hz and at most {max} Hz")]
    Frequency {
        /// Which one.
        what: &'static str,
        /// As given.
        value: f64,
        /// Limit below, itself not allowed.
        min: f64,
        /// Most allowed.
        max: f64,
    },
    /// A tolerance that is no tolerance.
    #[error("tolerance is {value:?}, but must be {min:?} to {max:?}")]
    Tolerance {
        /// As given.
        value: f64,
        /// Least allowed.
        min: f64,
        /// Most allowed.
        max: f64,
    },
    /// The matrices could not be factored, or the factors do not solve them.
    #[error(
        "a computation with the matrices of the panel failed ({reason}): check that the values in the scene are \
         physically \
         possible"
    )]
    Factorisation {
        /// What was seen.
        reason: String,
    },
    /// A design of another panel.
    #[error(
        "[{part}] is not the same as in the scene for which the model was computed; only supports, masses and actuators may \
         differ from that scene"
    )]
    OtherPanel {
        /// What differs, as scene files name it.
        part: &'static str,
    },
    /// Whoever asked no longer waits.
    #[error("the computation was stopped before its end")]
    Stopped,
    /// The eigenvalue iteration did not settle.
    #[error(
        "the computation of the modes up to {max_hz} Hz did not converge with {vectors} basis vectors: choose a lower \
         frequency"
    )]
    NotConverged {
        /// Highest frequency wanted.
        max_hz: f64,
        /// Vectors used.
        vectors: usize,
    },
}
