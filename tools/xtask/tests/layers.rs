//! Who may know what: model, planner and studies are libraries of their own, so that whoever depends on them gets no runtime, no server and no port;
//! only one file of the daemon has the board drive; and the crosscheck knows nothing of the project's code.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// All libraries that a crate of this workspace is built with.
fn list_dependencies(crate_name: &str) -> Vec<String> {
    let mut tree = Command::new("cargo");
    tree.current_dir(repository_root()).args([
        "tree",
        "--locked",
        "--edges",
        "normal",
        "--prefix",
        "none",
        "--package",
        crate_name,
    ]);
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

fn repository_root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("a repository")
}

/// All files below a folder whose names end in this.
fn list_files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(list_files(&path, ending));
        } else if path.to_string_lossy().ends_with(ending) {
            found.push(path);
        }
    }
    found
}

/// The files of the daemon that contain a text, as paths from the folder of the daemon on, in order.
fn list_daemon_files_with(text: &str) -> Vec<String> {
    let root = repository_root().join("host/src/daemon");
    let contains = |path: &PathBuf| fs::read_to_string(path).expect("a source file").contains(text);
    let name = |path: PathBuf| path.strip_prefix(&root).expect("a file below").to_string_lossy().into_owned();
    let mut found: Vec<String> = list_files(&root, ".rs").into_iter().filter(contains).map(name).collect();
    found.sort();
    found
}

#[test]
fn only_the_drive_task_has_the_board_drive() {
    assert_eq!(list_daemon_files_with(".begin_drive_arming_if_needed("), ["drive/equipment.rs"]);
    let of_the_task = ["drive/activity.rs", "drive/sustained.rs", "drive/task.rs"];
    for call in [".begin_drive_retrying_once_after_required_rest(", ".end_drive_no_later_than(", ".move_drive_end_to("]
    {
        let found = list_daemon_files_with(call);
        assert!(
            !found.is_empty() && found.iter().all(|file| of_the_task.contains(&file.as_str())),
            "{call}: {found:?}"
        );
    }
}

#[test]
fn the_crosscheck_imports_nothing_of_the_project() {
    let files = list_files(&repository_root().join("tools/crosscheck"), ".py");
    assert!(files.len() > 20, "{files:?}");
    for file in files {
        let text = fs::read_to_string(&file).expect("a source file");
        for line in
            text.lines().map(str::trim_start).filter(|line| line.starts_with("import ") || line.starts_with("from "))
        {
            let first = line.split([' ', '.', ',']).nth(1).unwrap_or_default();
            assert!(!["era", "_era", "emulator", "xtask"].contains(&first), "{}: {line}", file.display());
        }
    }
}
