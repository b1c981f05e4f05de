//! Files that the program writes and trusts: whole after a full disk, private whatever the umask is, and not believed where others could have changed them.
#![cfg(target_os = "linux")]

mod half_written;
mod private;
#[allow(dead_code, reason = "each test program uses a part of this")]
#[path = "../support/program.rs"]
mod program;
mod recordings;
mod trusted;

use program::{ERA, ProgramOutput, build_era_command, build_isolated_command, run_command};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A command for the program, which may write at most so many bytes to a file. `prlimit` sees to that: what a limit is to a program a full disk is, too.
fn build_limited_command(bytes: Option<u64>) -> Command {
    let Some(bytes) = bytes else { return build_era_command() };
    let mut command = build_isolated_command("prlimit");
    command.arg(format!("--fsize={bytes}")).arg(ERA);
    command
}

/// Runs the program in a folder, with at most so many bytes in a file.
fn run_limited(folder: &Path, bytes: Option<u64>, arguments: &[&str]) -> ProgramOutput {
    run_command(build_limited_command(bytes).current_dir(folder).args(arguments))
}

/// All files below a folder, by their paths in it.
fn files_in(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(&next).into_iter().flatten().map(|entry| entry.unwrap().path()) {
            if entry.is_dir() {
                open.push(entry);
            } else {
                files.insert(entry.strip_prefix(folder).unwrap().to_owned(), fs::read(&entry).unwrap());
            }
        }
    }
    files
}
