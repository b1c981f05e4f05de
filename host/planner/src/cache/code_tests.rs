//! The key follows from all of the code: whatever changes of it, the key does.

use super::code::{
    FOLDERS, hash_source_code, list_files_of_package_and_dependencies_to_hash, list_package_and_its_local_dependencies,
};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn own() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn own_number(variables: &[(&str, &str)], compiler: &str, package: &Path) -> u64 {
    let variables = variables.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned()));
    hash_source_code(package, &list_files_of_package_and_dependencies_to_hash(package).unwrap(), variables, compiler)
        .unwrap()
}

/// A copy of all files that count, to be changed.
fn copy() -> (tempfile::TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let package = directory.path().join("host/planner");
    std::fs::create_dir_all(&package).unwrap();
    for file in list_files_of_package_and_dependencies_to_hash(own()).unwrap() {
        let to = package.join(&file);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::copy(own().join(&file), to).unwrap();
    }
    (directory, package)
}

/// Every source that a table was ever computed by, and the build script with this very function.
#[test]
fn all_code_counts() {
    let files: BTreeSet<PathBuf> = list_files_of_package_and_dependencies_to_hash(own()).unwrap().into_iter().collect();
    for file in [
        "../../Cargo.lock",
        "../../Cargo.toml",
        "./Cargo.toml",
        "./build.rs",
        "./src/lib.rs",
        "./src/cache/code.rs",
        "./src/table/build.rs",
        "../model/Cargo.toml",
        "../model/src/model/singular.rs",
        "../model/src/transient/propagator.rs",
        "../model/src/transient/reduced.rs",
        "../../shared/Cargo.toml",
        "../../shared/src/limits.rs",
        "../../shared/src/supply/mod.rs",
    ] {
        assert!(files.contains(Path::new(file)), "{file}");
    }
}

#[test]
fn every_change_of_the_code_changes_the_number() {
    let (_directory, package) = copy();
    let told = [("CARGO_CFG_TARGET_FEATURE", "fxsr,sse,sse2"), ("OPT_LEVEL", "3"), ("HOME", "/home/me")];
    let compiler = "rustc 1.95.0\nrelease: 1.95.0\n";
    let first = own_number(&told, compiler, &package);
    assert_eq!(first, own_number(&told, compiler, own()));
    let mut seen = BTreeSet::from([first]);
    for file in list_files_of_package_and_dependencies_to_hash(&package).unwrap() {
        let path = package.join(&file);
        let text = std::fs::read(&path).unwrap();
        std::fs::write(&path, [&text[..], b"\n"].concat()).unwrap();
        assert!(seen.insert(own_number(&told, compiler, &package)), "{}", file.display());
        std::fs::write(&path, &text).unwrap();
    }
    assert_eq!(first, own_number(&told, compiler, &package));
    // A new file, and the same one under another name.
    for name in ["src/new.rs", "../model/src/new.rs", "../../shared/src/new.rs"] {
        std::fs::write(package.join(name), "").unwrap();
        assert!(seen.insert(own_number(&told, compiler, &package)), "{name}");
        std::fs::remove_file(package.join(name)).unwrap();
    }
    for (name, value) in [
        ("CARGO_CFG_TARGET_FEATURE", "avx2,fma,fxsr,sse,sse2"),
        ("CARGO_FEATURE_FAST", "1"),
        ("CARGO_ENCODED_RUSTFLAGS", "-Ctarget-cpu=native"),
        ("CARGO_PKG_VERSION", "0.2.0"),
        ("OPT_LEVEL", "2"),
    ] {
        let changed: Vec<_> = told.into_iter().filter(|(known, _)| *known != name).chain([(name, value)]).collect();
        assert!(seen.insert(own_number(&changed, compiler, &package)), "{name}");
    }
    assert!(seen.insert(own_number(&told, "rustc 1.96.0\nrelease: 1.96.0\n", &package)));
    // What no compiler is told.
    let elsewhere = told.map(|(name, value)| (name, if name == "HOME" { "/home/you" } else { value }));
    assert_eq!(first, own_number(&elsewhere, compiler, &package));
}

/// A package of the workspace that the planner comes to depend on must not be forgotten.
#[test]
fn a_new_package_of_the_workspace_is_asked_for() {
    let (_directory, package) = copy();
    let lock = package.join("../../Cargo.lock");
    let text = std::fs::read_to_string(&lock).unwrap();
    let of = |text: &str| list_package_and_its_local_dependencies(text, "era-planner").unwrap();
    let expected: BTreeSet<String> = FOLDERS.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(of(&text), expected);
    let more = text.replace(
        "name = \"era-shared\"",
        "name = \"era-more\"\nversion = \"0.1.0\"\n\n[[package]]\nname = \"era-shared\"",
    );
    // Of another member of the workspace, which the planner does not use.
    assert_eq!(of(&more), expected);
    let used = more.replacen(" \"era-shared\",\n", " \"era-more\",\n \"era-shared\",\n", usize::MAX);
    assert!(of(&used).contains("era-more"));
    std::fs::write(&lock, used).unwrap();
    let error = list_files_of_package_and_dependencies_to_hash(&package).unwrap_err().to_string();
    assert!(error.contains("era-more"), "{error}");
    assert!(list_package_and_its_local_dependencies(&text, "era-nothing").is_err());
}
