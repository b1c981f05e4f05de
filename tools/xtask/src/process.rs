//! Running other programs.

use crate::error::Error;
use std::process::{Command, Output, Stdio};

/// Runs `command` with its output shown.
///
/// # Errors
/// [`Error::Start`] or [`Error::Failed`].
pub fn run_command(command: &mut Command) -> Result<(), Error> {
    remove_cargo_pkg_and_manifest_variables(command);
    let status = command.status().map_err(|source| Error::Start { command: format_command(command), source })?;
    if status.success() { Ok(()) } else { Err(Error::Failed { command: format_command(command), status }) }
}

/// Runs `command` and returns what it writes to its standard output, without the line's end; the rest is shown.
///
/// # Errors
/// [`Error::Start`] or [`Error::Failed`].
pub fn capture_output(command: &mut Command) -> Result<String, Error> {
    remove_cargo_pkg_and_manifest_variables(command);
    let Output { status, stdout, .. } = command
        .stderr(Stdio::inherit())
        .output()
        .map_err(|source| Error::Start { command: format_command(command), source })?;
    if status.success() {
        Ok(String::from_utf8_lossy(&stdout).trim_end().to_owned())
    } else {
        Err(Error::Failed { command: format_command(command), status })
    }
}

/// Takes away what `cargo run` tells this program of itself. A build script of a library (ring's) watches these variables: without this, a build by
/// this program and one by hand would compile TLS and the host's crates again, by turns.
fn remove_cargo_pkg_and_manifest_variables(command: &mut Command) {
    for (name, _) in std::env::vars_os() {
        let is_told =
            name.to_str().is_some_and(|name| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_"));
        if is_told && !command.get_envs().any(|(own, _)| own == name) {
            command.env_remove(&name);
        }
    }
}

/// A command as one would type it.
pub fn format_command(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}

/// Runs a program without showing what it says; if it fails, that is the reason.
pub fn run_command_silently_returning_cause_line_on_failure(command: &mut Command) -> Result<(), String> {
    let shown = format_command(command);
    let output = command.output().map_err(|error| format!("cannot run `{shown}`: {error}"))?;
    if output.status.success() {
        return Ok(());
    }
    let text = String::from_utf8_lossy(&output.stderr);
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    // The line that names the cause, or the last one.
    let names_it = |line: &&&str| ["error", "E:", "fatal"].iter().any(|word| line.starts_with(word));
    let cause = lines.iter().find(names_it).or(lines.last()).copied().unwrap_or("there is no message");
    Err(format!("`{shown}` failed ({}): {cause}", output.status))
}

/// Whether Python can make an environment of its own: what the emulator and the reference need.
pub fn has_python_with_venv() -> bool {
    let mut python = Command::new("python3");
    python.args(["-c", "import venv, ensurepip"]).stdout(Stdio::null()).stderr(Stdio::null());
    python.status().is_ok_and(|status| status.success())
}
