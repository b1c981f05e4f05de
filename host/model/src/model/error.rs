//! What can go wrong in the model.

/// Why there is no model, or no answer from it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// The mesh would have to be finer than is allowed.
    #[error(
        "waves at {max_hz} Hz are {wavelength_mm:.2} mm long on this surface and would need {unknowns} unknowns, more than \
         the {limit} allowed: ask for a lower frequency or a looser accuracy{}",
        if *is_short { "; waves hardly longer than the surface is thick: is youngs_modulus_pa right, which is in Pa?" } else { "" }
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
        "up to {max_hz:.0} Hz, which an answer needs, the surface has some {modes} modes, more than the {limit} allowed: ask \
         for a lower frequency"
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
    #[error("{what}: {value} Hz is not in the allowed range {min} to {max} Hz")]
    Frequency {
        /// Which one.
        what: &'static str,
        /// As given.
        value: f64,
        /// Least allowed.
        min: f64,
        /// Most allowed.
        max: f64,
    },
    /// A tolerance that is no tolerance.
    #[error("tolerance: {value} is not in the allowed range {min} to {max}")]
    Tolerance {
        /// As given.
        value: f64,
        /// Least allowed.
        min: f64,
        /// Most allowed.
        max: f64,
    },
    /// The matrices could not be factored, or the factors do not solve them.
    #[error("the panel's matrices could not be factored ({reason}): are its numbers physically possible?")]
    Factorisation {
        /// What was seen.
        reason: String,
    },
    /// A design of another panel.
    #[error("[{part}] is not that of the panel that was solved: only supports, masses and actuators may differ")]
    OtherPanel {
        /// What differs, as scene files name it.
        part: &'static str,
    },
    /// Whoever asked no longer waits.
    #[error("stopped before the end")]
    Stopped,
    /// The eigenvalue iteration did not settle.
    #[error("the modes up to {max_hz} Hz did not converge with {vectors} vectors")]
    NotConverged {
        /// Highest frequency wanted.
        max_hz: f64,
        /// Vectors used.
        vectors: usize,
    },
}
