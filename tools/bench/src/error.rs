//! What can go wrong in a measurement.

use std::io;
use std::path::PathBuf;
use std::process::ExitStatus;

/// Why a measurement failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A program could not be started.
    #[error("cannot run `{command}`: {source}")]
    Start {
        /// With its arguments.
        command: String,
        /// Why.
        source: io::Error,
    },
    /// A program failed.
    #[error("`{command}` failed ({status}): {message}")]
    Failed {
        /// With its arguments.
        command: String,
        /// How it ended.
        status: ExitStatus,
        /// The end of what it wrote to its standard error.
        message: String,
    },
    /// A program printed something else than was expected.
    #[error("`{command}` printed no such JSON as was expected: {source}")]
    Json {
        /// With its arguments.
        command: String,
        /// Where.
        source: serde_json::Error,
    },
    /// No environment for the peers.
    #[error(transparent)]
    Python(#[from] python_environment::Error),
    /// The scene that measurements start from is not what they take it to be.
    #[error("the starting plate has no line {0:?}")]
    Scene(&'static str),
    /// Brute force found a better combination, or a worse one.
    #[error("with {actuators} actuators the search differs from brute force by {difference:e}")]
    NotTheBest {
        /// How many.
        actuators: usize,
        /// Relative difference.
        difference: f64,
    },
    /// No plan.
    #[error(transparent)]
    Plan(#[from] era_planner::PlanError),
    /// The same, as a file.
    #[error(transparent)]
    Parse(#[from] era_model::scene::SceneError),
    /// No model.
    #[error(transparent)]
    Model(#[from] era_model::model::ModelError),
    /// No response.
    #[error(transparent)]
    Response(#[from] era_model::response::ResponseError),
    /// No response with a bound.
    #[error(transparent)]
    Curves(#[from] era_model::response::CurveError),
    /// No motion in time.
    #[error(transparent)]
    Transient(#[from] era_model::transient::TransientError),
    /// A design cannot be looked at.
    #[error(transparent)]
    Quick(#[from] era_planner::quick::QuickError),
    /// No threads.
    #[error("cannot start threads: {0}")]
    Threads(String),
    /// A document without a place for a part.
    #[error("{path} has no `{start}` with a `<!-- end -->` after it")]
    NoRoom {
        /// The file.
        path: PathBuf,
        /// What was looked for.
        start: String,
    },
    /// No plot.
    #[error("cannot draw {path}: {reason}")]
    Plot {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
}

impl Error {
    /// Makes an [`Error::File`] of an input or output error; for `map_err`.
    pub fn file_error(path: impl Into<PathBuf>) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |source| Self::File { path, source }
    }
}
