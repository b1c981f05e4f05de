//! Python environments with pinned packages, of the peers that are measured and of the independent reference.

use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};

/// Why there is no environment.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A program could not be started.
    #[error("cannot run `{command}`")]
    Start {
        /// With its arguments.
        command: String,
        /// Why.
        source: io::Error,
    },
    /// A program failed; it said why on standard error.
    #[error("`{command}` failed ({status})")]
    Failed {
        /// With its arguments.
        command: String,
        /// How it ended.
        status: ExitStatus,
    },
    /// A file could not be read or written.
    #[error("cannot use {path}")]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// Makes the virtual environment `folder` with the packages that `requirements` names, unless it is there and made of them.
/// Returns its interpreter.
///
/// # Errors
/// [`Error`].
pub fn ensure_environment_and_return_interpreter(requirements: &Path, folder: &Path) -> Result<PathBuf, Error> {
    let file = |path: &Path| {
        let path = path.to_path_buf();
        move |source| Error::File { path, source }
    };
    let python = folder.join("bin/python");
    let wanted = std::fs::read(requirements).map_err(file(requirements))?;
    let made_of = folder.join("requirements.txt");
    if python.exists() && std::fs::read(&made_of).is_ok_and(|made_of| made_of == wanted) {
        return Ok(python);
    }
    eprintln!("making the Python environment {}", folder.display());
    run_command_hiding_standard_output(Command::new("python3").args(["-m", "venv", "--clear"]).arg(folder))?;
    run_command_hiding_standard_output(
        Command::new(&python).args(["-m", "pip", "install", "--quiet", "-r"]).arg(requirements),
    )?;
    // Last, so that an environment that was not finished is made again.
    std::fs::write(&made_of, wanted).map_err(file(&made_of))?;
    Ok(python)
}

fn run_command_hiding_standard_output(command: &mut Command) -> Result<(), Error> {
    let command_line = format!("{command:?}");
    let status = command.stdout(Stdio::null()).status();
    let status = status.map_err(|source| Error::Start { command: command_line.clone(), source })?;
    if status.success() { Ok(()) } else { Err(Error::Failed { command: command_line, status }) }
}
