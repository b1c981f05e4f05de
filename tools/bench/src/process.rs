//! Running other programs.

use crate::error::Error;
use serde::de::DeserializeOwned;
use std::process::{Command, Output, Stdio};

/// What a program writes to its standard output.
///
/// # Errors
/// [`Error::Start`], [`Error::Failed`].
pub fn output(command: &mut Command) -> Result<Vec<u8>, Error> {
    let Output { status, stdout, stderr } =
        command.stdin(Stdio::null()).output().map_err(|source| Error::Start { command: shown(command), source })?;
    if status.success() {
        return Ok(stdout);
    }
    let message = String::from_utf8_lossy(&stderr);
    let tail: Vec<&str> = message.trim_end().lines().rev().take(5).collect();
    let message = tail.into_iter().rev().collect::<Vec<_>>().join("\n");
    Err(Error::Failed { command: shown(command), status, message })
}

/// What a program prints as JSON.
///
/// # Errors
/// As [`output`], and [`Error::Json`].
pub fn json<T: DeserializeOwned>(command: &mut Command) -> Result<T, Error> {
    let text = output(command)?;
    serde_json::from_slice(&text).map_err(|source| Error::Json { command: shown(command), source })
}

/// A command as one would type it.
fn shown(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}
