//! Puts the repository's `memory.x` where the linker looks for it, and notes the commit.

use std::path::PathBuf;
use std::process::Command;
use std::{env, fs};

fn main() {
    let memory = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets this")).join("../memory.x");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets this"));
    fs::copy(&memory, out.join("memory.x")).expect("cannot copy memory.x from the root of the repository");
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed={}", memory.display());

    // Without git, or outside a checkout, the firmware says that it does not know. A tree with changes is not the commit: a plus takes the
    // place of the last digit.
    let mut commit = git(&["rev-parse", "--short=8", "HEAD"]).unwrap_or_default();
    let changes = git(&["status", "--porcelain", "--untracked-files=normal", "--", ".", "../shared", "../memory.x"]);
    if commit.len() >= 8 && changes.is_none_or(|changes| !changes.is_empty()) {
        commit.replace_range(7.., "+");
    }
    println!("cargo:rustc-env=ERA_COMMIT={commit}");
    let settings = ["Cargo.toml", "Cargo.lock", ".cargo/config.toml", "../shared/Cargo.toml"];
    for sources in ["src", "../shared/src"].into_iter().chain(settings) {
        println!("cargo:rerun-if-changed={sources}");
    }
    // Where HEAD lies differs between a checkout and one of git's worktrees.
    for file in ["HEAD", "logs/HEAD"] {
        if let Some(path) = git(&["rev-parse", "--git-path", file]) {
            println!("cargo:rerun-if-changed={path}");
        }
    }
}

/// What git answers, if there is git, and this is a checkout.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}
