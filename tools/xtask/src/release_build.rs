//! Builds in release mode that share what the tests of the workspace have compiled.

use crate::error::Error;
use crate::process::run_command;
use std::path::Path;
use std::process::Command;

/// Named with whatever is built: cargo compiles a library again for each set of features, and with these packages every library has
/// those that it has in `cargo test --workspace`. `tools/xtask/tests/shared_build.rs` checks that.
const SAME_FEATURES: [&str; 6] = ["-p", "era-host", "-p", "era-python", "-p", "workspace-hack"];

/// Builds programs of the workspace: each as its package and its name.
///
/// # Errors
/// [`Error::Start`], [`Error::Failed`].
pub fn build_programs(root: &Path, programs: &[(&str, &str)]) -> Result<(), Error> {
    let mut build = Command::new("cargo");
    build.current_dir(root).args(["build", "--release", "--quiet"]).args(SAME_FEATURES);
    for (package, program) in programs {
        build.args(["-p", package, "--bin", program]);
    }
    run_command(&mut build)
}
