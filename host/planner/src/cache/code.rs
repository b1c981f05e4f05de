//! A number for all the code that a program is made of. The build script includes this file; here it is for tests.
//!
//! What tables depend on is not listed, as a list would be wrong one day: everything counts that the compiler reads for the
//! package and for the packages of this workspace that it is made of (`Cargo.lock` names them), besides the lock file with its
//! checksums of all the others, the compiler and what it was told. A comment that changes makes tables be computed again, which
//! costs a second.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Packages of the workspace and their folders, seen from this package's own.
pub const FOLDERS: [(&str, &str); 4] =
    [("era-planner", "."), ("era-files", "../files"), ("era-model", "../model"), ("era-shared", "../../shared")];

/// What of a folder the compiler reads. Tests and examples are of other programs.
const READ: [&str; 3] = ["Cargo.toml", "build.rs", "src"];

/// Variables of a build script that tell what the compiler is told, by how their names begin: target, its features, the
/// package's, optimisation, flags.
const BUILD_VARIABLE_PREFIXES: [&str; 7] =
    ["CARGO_CFG_", "CARGO_FEATURE_", "CARGO_ENCODED_RUSTFLAGS", "CARGO_PKG_VERSION", "TARGET", "OPT_LEVEL", "PROFILE"];

/// The packages without a registry that `package` is made of, itself included, by a `Cargo.lock`'s text.
///
/// # Errors
/// A message if the package is not in there.
pub fn list_package_and_its_local_dependencies(cargo_lock: &str, package: &str) -> Result<BTreeSet<String>, String> {
    let quoted = |line: &str| line.split('"').nth(1).unwrap_or_default().to_owned();
    // Name, whether it is from elsewhere, and what it depends on.
    let packages: Vec<(String, bool, Vec<String>)> = cargo_lock
        .split("[[package]]")
        .skip(1)
        .map(|text| {
            let of = |key: &str| text.lines().find(|line| line.starts_with(key)).map(quoted);
            let needs =
                text.split_once("dependencies = [").map_or("", |(_, rest)| rest.split(']').next().unwrap_or(""));
            // "name", or "name version" where there are several.
            let needs = needs.lines().map(quoted).filter_map(|need| need.split(' ').next().map(str::to_owned));
            (of("name = ").unwrap_or_default(), of("source = ").is_some(), needs.collect())
        })
        .collect();
    let mut found = BTreeSet::new();
    let mut open = vec![package.to_owned()];
    while let Some(name) = open.pop() {
        if let Some((_, false, needs)) = packages.iter().find(|(known, ..)| *known == name)
            && found.insert(name)
        {
            open.extend(needs.iter().cloned());
        }
    }
    if found.is_empty() { Err(format!("Cargo.lock does not contain the package {package}")) } else { Ok(found) }
}

/// All files that count, seen from the package's folder, in order.
///
/// # Errors
/// [`io::Error`]; a package of the workspace whose folder is not in [`FOLDERS`] is one.
pub fn list_files_of_package_and_dependencies_to_hash(package_folder: &Path) -> io::Result<Vec<PathBuf>> {
    let lock = PathBuf::from("../../Cargo.lock");
    let packages =
        list_package_and_its_local_dependencies(&fs::read_to_string(package_folder.join(&lock))?, FOLDERS[0].0)
            .map_err(io::Error::other)?;
    let mut files = vec![lock, PathBuf::from("../../Cargo.toml")];
    for package in packages {
        let Some((_, folder)) = FOLDERS.iter().find(|(name, _)| *name == package) else {
            let text =
                format!("{} depends on {package}, but FOLDERS in code.rs has no folder of {package}", FOLDERS[0].0);
            return Err(io::Error::other(text));
        };
        for part in READ {
            append_files_below_as_paths_relative_to_root(package_folder, &Path::new(folder).join(part), &mut files)?;
        }
    }
    files.sort();
    Ok(files)
}

fn append_files_below_as_paths_relative_to_root(
    root: &Path,
    folder_or_file: &Path,
    files: &mut Vec<PathBuf>,
) -> io::Result<()> {
    let full = root.join(folder_or_file);
    if full.is_dir() {
        for entry in fs::read_dir(full)? {
            append_files_below_as_paths_relative_to_root(root, &folder_or_file.join(entry?.file_name()), files)?;
        }
    } else if full.exists() {
        files.push(folder_or_file.to_owned());
    }
    Ok(())
}

/// The number: FNV-1a of 64 bits over the names and contents of files, variables that tell what the compiler is told, and the
/// compiler's own words on its version. It has to tell versions apart, not to resist anybody.
///
/// # Errors
/// [`io::Error`] of a file.
pub fn hash_source_code(
    package_folder: &Path,
    files: &[PathBuf],
    unfiltered_variables: impl Iterator<Item = (String, String)>,
    compiler: &str,
) -> io::Result<u64> {
    let mut hash = 0xcbf2_9ce4_8422_2325;
    // With its length, so that no two lists of texts are one.
    let mut add = |bytes: &[u8]| {
        let length = (bytes.len() as u64).to_le_bytes();
        for byte in length.iter().chain(bytes) {
            hash = (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    };
    for file in files {
        add(file.to_string_lossy().as_bytes());
        add(&fs::read(package_folder.join(file))?);
    }
    let mut told: Vec<(String, String)> = unfiltered_variables
        .filter(|(name, _)| BUILD_VARIABLE_PREFIXES.iter().any(|told| name.starts_with(told)))
        .collect();
    told.sort();
    for (name, value) in told {
        add(name.as_bytes());
        add(value.as_bytes());
    }
    add(compiler.as_bytes());
    Ok(hash)
}
