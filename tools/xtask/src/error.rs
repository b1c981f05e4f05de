//! What can go wrong in a developer command.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The machine lacks something that could not be installed.
    #[error("`{command}` needs the following, which is missing on this machine:{list}")]
    Missing {
        /// What needs it.
        command: String,
        /// All that is missing and how it is installed, in lines.
        list: String,
    },
    /// No environment of Python.
    #[error(transparent)]
    Python(python_environment::Error),
    /// A waveform is not as it must be.
    #[error("at least one waveform breaks its limits; the table shows which limit")]
    Waveforms,
    /// Advisories were asked for, and there is no database of them.
    #[error("{0}")]
    NoAdvisories(String),
    /// This program is not in a checkout.
    #[error("{0} is not inside the repository")]
    NoRepository(PathBuf),
    /// A program could not be started.
    #[error("cannot run `{command}`")]
    Start {
        /// With its arguments.
        command: String,
        /// Why.
        source: io::Error,
    },
    /// A program failed.
    #[error("`{command}` failed ({status})")]
    Failed {
        /// With its arguments.
        command: String,
        /// How it ended.
        status: std::process::ExitStatus,
    },
    /// The daemon did not plan.
    #[error("`{command}` made no first plan; its log:\n{said}")]
    NoFirstPlan {
        /// With its arguments.
        command: String,
        /// Its log.
        said: String,
    },
    /// A file could not be used.
    #[error("{what} {path}")]
    File {
        /// What was tried, as in "cannot read".
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The compiler's standard library sources could not be had.
    #[error("cannot get the sources of the standard library for rustc {compiler}: {reason}")]
    NoSources {
        /// Version of the compiler.
        compiler: String,
        /// What is wrong.
        reason: String,
    },
    /// Neither way gave the compilation target.
    #[error(
        "cannot get the target {target}, neither from rustup ({rustup}) nor from its sources ({source})",
        target = crate::triple::TARGET
    )]
    NoTarget {
        /// Why the first way failed.
        rustup: String,
        /// Why the second way failed.
        source: Box<Error>,
    },
    /// The build ended well but named no image.
    #[error("cargo built no executable named {0}")]
    NoImage(&'static str),
    /// The image is not what it should be.
    #[error("{path} is not a firmware image: {reason}")]
    Image {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// Miri is not installed.
    #[error("Miri is not installed; `{0}` installs Miri")]
    NoMiri(&'static str),
    /// The image's stack cannot be bounded.
    #[error("cannot compute a bound for the stack of {path}")]
    Stack {
        /// The image.
        path: PathBuf,
        /// Why.
        source: crate::stack::StackError,
    },
    /// The file of budgets is not what it should be.
    #[error("{path} is not a valid file of budgets")]
    Budget {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<toml::de::Error>,
    },
    /// Something takes more than it may.
    #[error("over the budget of firmware/budget.toml: {0}")]
    OverBudget(String),
    /// The emulator bridge ended or said something unexpected.
    #[error("the emulator bridge: {0}")]
    Bridge(String),
    /// The emulated board did not answer.
    #[error("no answer from the emulated board within {0:?}")]
    Silent(Duration),
    /// An engine found an input that fails.
    #[error(
        "fuzzing {target} found an input that fails (log: {log}); run this input again with \
         `cargo xtask fuzz --target {target} --input FILE`\n  {said}"
    )]
    Found {
        /// The target.
        target: &'static str,
        /// What the engine said of it, with the input's file.
        said: String,
        /// All that the engine said.
        log: PathBuf,
    },
    /// The emulated board did not reply to a request in its own time.
    #[error("the emulated board did not behave as expected: {0}")]
    NoReply(String),
    /// The report found differences.
    #[error("{0} steps of the report are not as expected")]
    Report(usize),
    /// Planted mistakes that no test detects.
    #[error("no test detects these planted mistakes: {0}")]
    Mutations(String),
    /// A run with a planted mistake that says nothing about it.
    #[error("{0}")]
    Unjudged(String),
    /// What detects planted mistakes fails without one.
    #[error("failures in {what} without a planted mistake: {reason}")]
    NotSound {
        /// What fails.
        what: &'static str,
        /// What it says.
        reason: String,
    },
    /// A manifest is not what it should be.
    #[error("{path} is not a valid manifest")]
    Manifest {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<toml::de::Error>,
    },
    /// A source is not Rust.
    #[error("cannot parse {path}")]
    Source {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: syn::Error,
    },
    /// Files import each other in circles.
    #[error("{0} circles of imports between files that are not parent and child")]
    Circles(usize),
    /// A file uses a folder that comes after its own (`house::order`).
    #[error("imports against the order of folders: {0}")]
    FolderOrder(String),
    /// What a release has is not as it must be.
    #[error("the release: {0}")]
    Package(String),
    /// A message could not be put into a frame.
    #[error("cannot encode the request: {0:?}")]
    Encode(era_shared::link::EncodeError),
}

/// Makes the error of a file from the system's: `what` was tried with the file at `path`, as in "cannot read".
pub fn file_error(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Error + use<> {
    let path = path.to_owned();
    move |source| Error::File { what, path, source }
}
