//! Where things are, and the Python environment of the peers.

use crate::error::Error;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Places and choices that every measurement needs.
#[derive(Clone, Debug)]
pub struct Environment {
    /// Scripts of the peers.
    pub scripts: PathBuf,
    /// What is written in between.
    pub scratch: PathBuf,
    /// The environment's interpreter.
    pub python: PathBuf,
    /// This program.
    pub own_program: PathBuf,
    /// Fewer and smaller cases.
    pub quick: bool,
}

impl Environment {
    /// Finds what is needed; with peers, makes the Python environment if it is missing or made of other packages.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::Python`].
    pub fn find_program_and_prepare_peers(quick: bool, with_peers: bool) -> Result<Self, Error> {
        let own_program = std::env::current_exe().map_err(Error::file_error("era-bench"))?;
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
        let target = folder.ancestors().nth(2).unwrap_or(folder).join("target");
        let scripts = folder.join("peers");
        let python = target.join("bench-venv/bin/python");
        if with_peers {
            python_environment::ensure_environment_and_return_interpreter(
                &scripts.join("requirements.txt"),
                &target.join("bench-venv"),
            )?;
        }
        let scratch = target.join("bench");
        std::fs::create_dir_all(&scratch).map_err(Error::file_error(&scratch))?;
        Ok(Self { scripts, scratch, python, own_program, quick })
    }

    /// A command that runs the script of this file name, without arguments.
    #[must_use]
    pub fn make_script_command(&self, file_name: &str) -> Command {
        let mut command = Command::new(&self.python);
        command.arg(self.scripts.join(file_name));
        command
    }
}
