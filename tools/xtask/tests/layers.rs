//! Model, planner and studies are libraries of their own: whoever depends on them gets no runtime, no server and no port.

use std::path::Path;
use std::process::Command;

/// All libraries that a crate of this workspace is built with.
fn list_dependencies(crate_name: &str) -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("a repository");
    let mut tree = Command::new("cargo");
    tree.current_dir(root).args(["tree", "--locked", "--edges", "normal", "--prefix", "none", "--package", crate_name]);
    let output = tree.output().expect("cargo");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).expect("text");
    text.lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect()
}

#[test]
fn model_planner_and_studies_need_no_library_of_the_daemon() {
    const OF_THE_DAEMON: [&str; 5] = ["tokio", "axum", "hyper", "serialport", "clap"];
    let has = |crate_name: &str, library: &str| list_dependencies(crate_name).iter().any(|own| own == library);
    // The same question about the program finds all of them.
    assert!(OF_THE_DAEMON.iter().all(|library| has("era-host", library)));
    for crate_name in ["era-files", "era-model", "era-planner", "era-study"] {
        let found: Vec<&&str> = OF_THE_DAEMON.iter().filter(|library| has(crate_name, library)).collect();
        assert!(found.is_empty(), "{crate_name} depends on {found:?}");
    }
}
