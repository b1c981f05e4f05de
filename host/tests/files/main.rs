//! Files that the program writes and trusts: whole after a full disk, private whatever the umask is, and not believed where others could have changed them.
#![cfg(target_os = "linux")]

mod half_written;
mod private;
mod recordings;
mod trusted;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The program in a folder, with at most so many bytes in a file, which `prlimit` sees to: what a limit is to a program a full disk is, too.
fn run_limited(folder: &Path, bytes: Option<u64>, arguments: &[&str]) -> Output {
    let mut command = match bytes {
        Some(bytes) => {
            let mut command = Command::new("prlimit");
            command.arg(format!("--fsize={bytes}")).arg(env!("CARGO_BIN_EXE_era"));
            command
        }
        None => Command::new(env!("CARGO_BIN_EXE_era")),
    };
    // A cache that is there, so that tables are not computed over and over.
    command.env("ERA_CACHE_DIR", env!("CARGO_TARGET_TMPDIR")).env_remove("ERA_LOG").env_remove("XDG_RUNTIME_DIR");
    command.current_dir(folder).args(arguments).output().unwrap()
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
