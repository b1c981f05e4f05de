//! Running other programs.

use crate::error::Error;
use serde::de::DeserializeOwned;
use std::process::{Command, Output, Stdio};

/// Runs a program: what it writes to its standard output.
///
/// # Errors
/// [`Error::Start`], [`Error::Failed`].
pub fn run_and_capture_stdout(command: &mut Command) -> Result<Vec<u8>, Error> {
    let Output { status, stdout, stderr } = command
        .stdin(Stdio::null())
        .output()
        .map_err(|source| Error::Start { command: format_command_line(command), source })?;
    if status.success() {
        return Ok(stdout);
    }
    let message = String::from_utf8_lossy(&stderr);
    let tail: Vec<&str> = message.trim_end().lines().rev().take(5).collect();
    let message = tail.into_iter().rev().collect::<Vec<_>>().join("\n");
    Err(Error::Failed { command: format_command_line(command), status, message })
}

/// Runs a program: what it prints, read as JSON.
///
/// # Errors
/// As [`run_and_capture_stdout`], and [`Error::Json`].
pub fn run_and_parse_json<T: DeserializeOwned>(command: &mut Command) -> Result<T, Error> {
    let text = run_and_capture_stdout(command)?;
    serde_json::from_slice(&text).map_err(|source| Error::Json { command: format_command_line(command), source })
}

/// A command as one would type it.
fn format_command_line(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}
