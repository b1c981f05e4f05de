//! `cargo xtask advisories` finds what is in a database, in both workspaces, and passes where there is nothing.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A database with one advisory, on all versions of `package`, in a folder of its own.
fn database(package: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("advisories-on-{package}"));
    let _ = fs::remove_dir_all(&folder);
    let crates = folder.join("crates").join(package);
    fs::create_dir_all(&crates).unwrap();
    let text = format!(
        "```toml\n[advisory]\nid = \"RUSTSEC-2026-9999\"\npackage = \"{package}\"\ndate = \"2026-01-01\"\n\
         url = \"https://example.org\"\n\n[versions]\npatched = []\n```\n\n# Planted\n\nBy a test.\n"
    );
    fs::write(crates.join("RUSTSEC-2026-9999.md"), text).unwrap();
    let git = |arguments: &[&str]| {
        let mut git = Command::new("git");
        git.arg("-C").arg(&folder).args(["-c", "user.name=test", "-c", "user.email=test@example.org"]);
        assert!(git.args(arguments).status().unwrap().success(), "git {arguments:?}");
    };
    git(&["init", "--quiet"]);
    git(&["add", "."]);
    git(&["commit", "--quiet", "--message", "planted"]);
    folder
}

/// How the command ends with a database, and all that it says.
fn check(database: &Path) -> (bool, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_xtask")).args(["advisories", "--db"]).arg(database).output().unwrap();
    (
        output.status.success(),
        [output.stdout, output.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat(),
    )
}

fn is_locked(workspace: &str, package: &str) -> bool {
    let lock = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(workspace).join("Cargo.lock");
    fs::read_to_string(lock).unwrap().contains(&format!("name = \"{package}\"\n"))
}

/// One after the other, as they share what cargo-deny is told.
#[test]
#[ignore = "needs cargo-deny, which `cargo xtask ci` gets before it runs this"]
fn a_planted_advisory_is_found_in_each_workspace() {
    assert!(is_locked(".", "clap") && !is_locked("firmware", "clap"));
    assert!(is_locked("firmware", "cortex-m") && !is_locked(".", "cortex-m"));
    for package in ["clap", "cortex-m"] {
        let (passes, said) = check(&database(package));
        assert!(!passes && said.contains("RUSTSEC-2026-9999") && said.contains("Planted"), "{package}: {said}");
    }
    let (passes, said) = check(&database("no-crate-of-ours"));
    assert!(passes && said.contains("advisories as of 20"), "{said}");
}

#[test]
fn a_folder_that_is_no_database_is_refused() {
    let (passes, said) = check(Path::new(env!("CARGO_MANIFEST_DIR")));
    assert!(!passes && said.contains("no database of advisories"), "{said}");
}
