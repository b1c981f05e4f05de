//! `cargo xtask miri`: the tests of `shared` under Miri, which finds undefined behaviour, also that of dependencies.

use crate::error::Error;
use crate::process::run;
use crate::root;
use std::path::Path;
use std::process::{Command, Stdio};

/// What gets the component where rustup has it.
const HINT: &str = "rustup toolchain install nightly --component miri --component rust-src";

/// Runs the tests, or says what is missing. Nothing is installed: Miri goes with a nightly compiler, which is not this
/// project's.
///
/// # Errors
/// [`Error::NoMiri`] if there is none, and what the tests end with.
pub fn command() -> Result<(), Error> {
    if !is_here() {
        return Err(Error::NoMiri(HINT));
    }
    let root = root()?;
    run(Command::new("cargo")
        .args(["+nightly", "miri", "test", "-p", "era-shared"])
        .current_dir(&root)
        .env("CARGO_TARGET_DIR", root.join("target/miri"))
        // Property tests look for files with failures of before, which Miri would keep from them.
        .env("MIRIFLAGS", "-Zmiri-disable-isolation")
        // Miri is a thousand times slower; tests that set their own number of cases know that.
        .env("PROPTEST_CASES", "10"))
}

/// As [`command`], but where there is no Miri it says so and goes on.
///
/// # Errors
/// What the tests end with.
pub fn if_here() -> Result<(), Error> {
    if is_here() {
        command()
    } else {
        println!("skipped: miri (not installed; {HINT})");
        Ok(())
    }
}

/// Whether both components are there: without the sources, Miri would fetch them.
fn is_here() -> bool {
    let sysroot = Command::new("rustc").args(["+nightly", "--print", "sysroot"]).stderr(Stdio::null()).output();
    let sources = sysroot.is_ok_and(|output| {
        let sysroot = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        output.status.success() && Path::new(&sysroot).join("lib/rustlib/src/rust/library").exists()
    });
    let mut version = Command::new("cargo");
    version.args(["+nightly", "miri", "--version"]).stdout(Stdio::null()).stderr(Stdio::null());
    sources && version.status().is_ok_and(|status| status.success())
}
