//! Running other programs.

use crate::error::Error;
use std::process::{Command, Output, Stdio};

/// Runs `command` with its output shown.
///
/// # Errors
/// [`Error::Start`] or [`Error::Failed`].
pub fn run(command: &mut Command) -> Result<(), Error> {
    let status = command.status().map_err(|source| Error::Start { command: shown(command), source })?;
    if status.success() { Ok(()) } else { Err(Error::Failed { command: shown(command), status }) }
}

/// Runs `command` and returns what it writes to its standard output, without the line's end; the rest is shown.
///
/// # Errors
/// [`Error::Start`] or [`Error::Failed`].
pub fn output(command: &mut Command) -> Result<String, Error> {
    let Output { status, stdout, .. } =
        command.stderr(Stdio::inherit()).output().map_err(|source| Error::Start { command: shown(command), source })?;
    if status.success() {
        Ok(String::from_utf8_lossy(&stdout).trim_end().to_owned())
    } else {
        Err(Error::Failed { command: shown(command), status })
    }
}

/// A command as one would type it.
pub fn shown(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}
