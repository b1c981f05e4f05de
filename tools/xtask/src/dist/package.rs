//! Debian's package, by cargo-deb: what is in it besides the program is made by the program itself. Its list is in `host/Cargo.toml`.

use super::{clear_folder, make_folder, write_file};
use crate::dependencies;
use crate::error::{Error, file_error};
use crate::process::{capture_output, run_command};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Shells, and what each calls the file of its completions.
const COMPLETIONS: [(&str, &str); 3] = [("bash", "era"), ("zsh", "_era"), ("fish", "era.fish")];
/// What `era install` says of its own files, which those of a package are not.
const WRITTEN_BY: &str = "# Written by `era install`";

/// Makes the package in the folder `out` with the pages of the `manual`, and returns its file.
///
/// # Errors
/// What could not be got, run or written; [`Error::Package`] where cargo-deb made none.
pub fn build_package(root: &Path, out: &Path, manual: &Path) -> Result<PathBuf, Error> {
    dependencies::install_crate_if_probe_command_fails(root, "cargo-deb", &["cargo", "deb", "--version"])?;
    make_packaged_files(root, manual)?;
    let mut deb = Command::new("cargo");
    deb.current_dir(root)
        .args(["deb", "--quiet", "--no-build", "--locked", "--strip", "-p", "era-host", "--output"])
        .arg(out);
    run_command(&mut deb)?;
    let packages = super::list_files_directly_in_folder_unsorted(out)?;
    let is_package = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "deb");
    packages.into_iter().find(is_package).ok_or_else(|| Error::Package("cargo deb made no package".into()))
}

/// Makes the files that `host/Cargo.toml` names below `target/deb`.
fn make_packaged_files(root: &Path, manual: &Path) -> Result<(), Error> {
    let stage = root.join("target/deb");
    clear_folder(&stage)?;
    let era = |arguments: &[&str]| {
        let mut command = Command::new(root.join("target/release/era"));
        command.current_dir(&stage).args(arguments);
        command
    };
    make_folder(&stage.join("completions"))?;
    for (shell, file) in COMPLETIONS {
        write_file(
            &stage.join("completions").join(file),
            &format!("{}\n", capture_output(&mut era(&["completions", shell]))?),
        )?;
    }
    run_command(&mut era(&["man", "--dir", "man"]))?;
    write_file(&stage.join("era.toml"), &format!("{}\n", capture_output(&mut era(&["config", "example"]))?))?;
    capture_output(&mut era(&["install", "--root", "installed", "--program", "/usr/bin/era"]))?;
    for file in ["udev/rules.d/70-era.rules", "systemd/system/era.service"] {
        let path = stage.join("installed/etc").join(file);
        let text = fs::read_to_string(&path).map_err(file_error("cannot read", &path))?;
        let kept: String =
            text.lines().filter(|line| !line.starts_with(WRITTEN_BY)).flat_map(|line| [line, "\n"]).collect();
        write_file(&stage.join(path.file_name().unwrap_or_default()), &kept)?;
    }
    run_command(Command::new("cp").arg("--recursive").arg(manual).arg(stage.join("html")))
}
