//! Where things are, and the Python environment of the peers.

use crate::error::Error;
use crate::process::output;
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
    pub own: PathBuf,
    /// Fewer and smaller cases.
    pub quick: bool,
}

impl Environment {
    /// Finds what is needed; with peers, makes the Python environment if it is missing or made of other packages.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::Start`], [`Error::Failed`].
    pub fn new(quick: bool, with_peers: bool) -> Result<Self, Error> {
        let own = std::env::current_exe().map_err(Error::file("era-bench"))?;
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
        let target = folder.parent().unwrap_or(folder).join("target");
        let scripts = folder.join("peers");
        let python = target.join("bench-venv/bin/python");
        if with_peers {
            prepare(&scripts.join("requirements.txt"), &target.join("bench-venv"), &python)?;
        }
        let scratch = target.join("bench");
        std::fs::create_dir_all(&scratch).map_err(Error::file(&scratch))?;
        Ok(Self { scripts, scratch, python, own, quick })
    }

    /// A command that runs one of the scripts.
    #[must_use]
    pub fn script(&self, name: &str) -> Command {
        let mut command = Command::new(&self.python);
        command.arg(self.scripts.join(name));
        command
    }
}

/// Makes the virtual environment `folder`, whose interpreter will be `python`.
fn prepare(requirements: &Path, folder: &Path, python: &Path) -> Result<(), Error> {
    let wanted = std::fs::read(requirements).map_err(Error::file(requirements))?;
    let made_of = folder.join("requirements.txt");
    if python.exists() && std::fs::read(&made_of).is_ok_and(|made_of| made_of == wanted) {
        return Ok(());
    }
    eprintln!("making the Python environment {}", folder.display());
    output(Command::new("python3").args(["-m", "venv", "--clear"]).arg(folder))?;
    output(Command::new(python).args(["-m", "pip", "install", "--quiet", "-r"]).arg(requirements))?;
    // Last, so that an environment that was not finished is made again.
    std::fs::write(&made_of, wanted).map_err(Error::file(&made_of))
}
