//! Builds in release mode that share what the tests of the workspace have compiled.

use crate::error::Error;
use crate::process::run_command;
use std::path::Path;
use std::process::Command;

/// Named with whatever is built: cargo compiles a library again for each set of features, and with these packages every library has
/// those that it has in `cargo test --workspace`. A test below checks that.
const SAME_FEATURES: [&str; 6] = ["-p", "era-host", "-p", "era-python", "-p", "workspace-hack"];

/// Builds programs of the workspace: each as its package and its name.
///
/// # Errors
/// [`Error::Start`], [`Error::Failed`].
pub fn build_release_programs_by_package_and_binary_name(root: &Path, programs: &[(&str, &str)]) -> Result<(), Error> {
    let mut build = Command::new("cargo");
    build.current_dir(root).args(["build", "--release", "--quiet"]).args(SAME_FEATURES);
    for (package, program) in programs {
        build.args(["-p", package, "--bin", program]);
    }
    run_command(&mut build)
}

#[cfg(test)]
mod tests {
    use super::SAME_FEATURES;
    use std::collections::BTreeSet;
    use std::path::Path;
    use std::process::Command;

    /// Libraries with their versions and features.
    fn list_libraries_with_features(arguments: &[&str]) -> BTreeSet<String> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let shape = ["tree", "--locked", "--prefix", "none", "--format", "{p} [{f}]"];
        let output = Command::new("cargo").current_dir(root).args(shape).args(arguments).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).unwrap();
        // The package itself has a feature more; what has been listed before ends with a mark.
        let lines =
            text.lines().map(|line| line.trim_end_matches(" (*)")).filter(|line| !line.starts_with("era-python "));
        lines.filter(|line| !line.is_empty()).map(str::to_owned).collect()
    }

    #[test]
    fn libraries_have_the_features_of_the_tests() {
        let tested = list_libraries_with_features(&["--workspace", "--edges", "normal,build,dev"]);
        assert!(tested.len() > 200);
        let builds: [&[&str]; 4] = [
            &["-p", "era-python", "--features", "as-tested"],
            &SAME_FEATURES,
            &[&SAME_FEATURES[..], &["-p", "era-bench"]].concat(),
            &[&SAME_FEATURES[..], &["-p", "era-load"]].concat(),
        ];
        for build in builds {
            let built = list_libraries_with_features(&[build, &["--edges", "normal,build"]].concat());
            let compiled_again: Vec<_> = built.difference(&tested).collect();
            assert!(
                compiled_again.is_empty(),
                "{build:?}: name these features in tools/workspace-hack: {compiled_again:?}"
            );
        }
        // What would be found without it.
        let alone = list_libraries_with_features(&["-p", "era-host", "--edges", "normal,build"]);
        assert!(!alone.is_subset(&tested), "tools/workspace-hack is not needed any more");
    }
}
