//! The commands of xtask build programs and the Python package with the features that every library has in `cargo test --workspace`, so
//! that nothing is compiled twice.

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
    let lines = text.lines().map(|line| line.trim_end_matches(" (*)")).filter(|line| !line.starts_with("era-python "));
    lines.filter(|line| !line.is_empty()).map(str::to_owned).collect()
}

#[test]
fn libraries_have_the_features_of_the_tests() {
    let tested = list_libraries_with_features(&["--workspace", "--edges", "normal,build,dev"]);
    assert!(tested.len() > 200);
    let builds: [&[&str]; 4] = [
        &["-p", "era-python", "--features", "as-tested"],
        &["-p", "era-host", "-p", "era-python", "-p", "workspace-hack"],
        &["-p", "era-host", "-p", "era-python", "-p", "workspace-hack", "-p", "era-bench"],
        &["-p", "era-host", "-p", "era-python", "-p", "workspace-hack", "-p", "era-load"],
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
