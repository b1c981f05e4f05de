//! How designs are chosen, and how they are looked at.

/// How designs are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointMethod {
    /// All combinations of some values of each variable.
    Grid,
    /// Each variable's range cut into as many parts as there are designs, each part used once (McKay, Beckman and Conover 1979).
    LatinHypercube,
    /// Sobol's sequence, which fills the space evenly however many there are.
    Sobol,
    /// Generations, each chosen from what was found before.
    Evolution,
}

impl PointMethod {
    /// The word in the file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Grid => "grid",
            Self::LatinHypercube => "latin_hypercube",
            Self::Sobol => "sobol",
            Self::Evolution => "evolution",
        }
    }
}

/// How the uncertain values of a design are sampled; the same for all designs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UncertaintySampling {
    /// All combinations of the least and the most of each.
    Corners,
    /// So many samples over all of them.
    LatinHypercube {
        /// How many.
        samples: usize,
    },
}

/// The section `[method]`.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyMethod {
    /// How designs are chosen.
    pub way: PointMethod,
    /// How many there are, of a grid as many as it has.
    pub designs: usize,
    /// Of random numbers.
    pub seed: u64,
    /// Values of each variable on a grid.
    pub levels: usize,
    /// Designs of a generation.
    pub population: usize,
    /// Evolutions beside each other, from seeds of their own and with wishes weighed differently.
    pub runs: usize,
    /// Designs that are looked at again thoroughly.
    pub finalists: usize,
    /// Designs of a chunk of work; what takes a second or so if `None`.
    pub chunk: Option<usize>,
    /// How uncertain values are sampled.
    pub robust: UncertaintySampling,
    /// Lowest frequency in Hz.
    pub from_hz: f64,
    /// Highest frequency in Hz.
    pub to_hz: f64,
    /// Whether every design is looked at as thoroughly as finalists are.
    pub thorough: bool,
}
