//! What can go wrong with a load.

use std::io;
use std::path::Path;

/// Why a load could not be put on, or what it showed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The daemon could not be started, or ended at once.
    #[error("`{command}` does not serve; its log:\n{said}")]
    NoDaemon {
        /// With its arguments.
        command: String,
        /// Its log.
        said: String,
    },
    /// The system refused something.
    #[error("{what}: {source}")]
    System {
        /// What was tried, as in "cannot read".
        what: String,
        /// Why.
        source: io::Error,
    },
    /// A serial line could not be made.
    #[error("no pseudo-terminal: {0}")]
    Line(#[from] serialport::Error),
    /// The example scene has no plan table.
    #[error("no plan is possible for the example scene: {0}")]
    Scene(String),
    /// The daemon did not answer as it should.
    #[error("{0}")]
    Answer(String),
    /// The run found something.
    #[error("the daemon did not withstand the load: {0}")]
    NotStood(String),
    /// What was measured is not what is asked.
    #[error("these aims are not met: {0}")]
    Missed(String),
}

impl Error {
    /// The system refused `what`.
    pub fn system_error(what: impl Into<String>) -> impl FnOnce(io::Error) -> Self {
        let what = what.into();
        move |source| Self::System { what, source }
    }

    /// Something about the file at `path`.
    pub fn file_error(path: &Path) -> impl FnOnce(io::Error) -> Self {
        Self::system_error(path.display().to_string())
    }
}
