//! `cargo xtask miri`: the tests of `shared` under Miri, which finds undefined behaviour, also that of dependencies.

use crate::error::Error;
use crate::process::run_command;
use crate::repository_root;
use std::path::Path;
use std::process::{Command, Stdio};

/// What gets the component where rustup has it.
const HINT: &str = "rustup toolchain install nightly --component miri --component rust-src";

/// Tests that reach every message and the device logic, in seconds; all of them take the better part of an hour.
const SHORT: [&[&str]; 2] = [
    &["--test", "golden_v1", "--test", "golden_v2", "--test", "golden_v3", "--test", "golden_v4"],
    &["--test", "device", "--", "--exact", "a_session_from_hello_to_disarm"],
];

/// Runs all tests, or says what is missing. Nothing is installed: Miri goes with a nightly compiler, which is not this
/// project's.
///
/// # Errors
/// [`Error::NoMiri`] if there is none, and what the tests end with.
pub fn run_all_miri_tests_failing_if_not_installed() -> Result<(), Error> {
    if are_miri_and_rust_src_installed() { run_miri_tests(&[]) } else { Err(Error::NoMiri(HINT)) }
}

/// Runs a few tests, or says that there is no Miri and goes on.
///
/// # Errors
/// What the tests end with.
pub fn run_short_miri_tests_if_installed() -> Result<(), Error> {
    if are_miri_and_rust_src_installed() {
        return SHORT.into_iter().try_for_each(run_miri_tests);
    }
    println!("skipped: miri (not installed; {HINT})");
    Ok(())
}

fn run_miri_tests(test_arguments: &[&str]) -> Result<(), Error> {
    let root = repository_root()?;
    run_command(
        Command::new("cargo")
            .args(["+nightly", "miri", "test", "-p", "era-shared"])
            .args(test_arguments)
            .current_dir(&root)
            .env("CARGO_TARGET_DIR", root.join("target/miri"))
            // Property tests look for files with failures of before, which Miri would keep from them.
            .env("MIRIFLAGS", "-Zmiri-disable-isolation")
            // Miri is a thousand times slower; tests that set their own number of cases know that.
            .env("PROPTEST_CASES", "10"),
    )
}

/// Whether both components are there: without the sources, Miri would fetch them.
fn are_miri_and_rust_src_installed() -> bool {
    let sysroot = Command::new("rustc").args(["+nightly", "--print", "sysroot"]).stderr(Stdio::null()).output();
    let sources = sysroot.is_ok_and(|output| {
        let sysroot = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        output.status.success() && Path::new(&sysroot).join("lib/rustlib/src/rust/library").exists()
    });
    let mut version = Command::new("cargo");
    version.args(["+nightly", "miri", "--version"]).stdout(Stdio::null()).stderr(Stdio::null());
    sources && version.status().is_ok_and(|status| status.success())
}
