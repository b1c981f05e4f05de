//! Puts the repository's `memory.x` where the linker looks for it, and notes the commit.

use std::path::PathBuf;
use std::process::Command;
use std::{env, fs};

fn main() {
    let memory = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("set by cargo")).join("../memory.x");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("set by cargo"));
    fs::copy(&memory, out.join("memory.x")).expect("memory.x at the repository root");
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed={}", memory.display());

    // Without git, or outside a checkout, the firmware says that it does not know.
    let commit = Command::new("git")
        .args(["rev-parse", "--short=8", "HEAD"])
        .output()
        .ok()
        .filter(|output| output.status.success())
        .and_then(|output| String::from_utf8(output.stdout).ok())
        .unwrap_or_default();
    println!("cargo:rustc-env=ERA_COMMIT={}", commit.trim());
    println!("cargo:rerun-if-changed=../.git/HEAD");
    println!("cargo:rerun-if-changed=../.git/logs/HEAD");
}
