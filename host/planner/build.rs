//! Tells the program which code it was made of: tables that are kept on disk are those of the same code only.

#[path = "src/cache/code.rs"]
mod code;

use std::io;
use std::path::Path;
use std::process::Command;

fn main() -> io::Result<()> {
    // Build scripts run in their package's folder.
    let package = Path::new(".");
    let files = code::list_files_of_package_and_dependencies_to_hash(package)?;
    for file in &files {
        println!("cargo::rerun-if-changed={}", file.display());
    }
    // New files, too.
    for (_, folder) in code::FOLDERS {
        println!("cargo::rerun-if-changed={folder}/src");
    }
    let variables =
        std::env::vars_os().filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)));
    let rustc = std::env::var_os("RUSTC")
        .ok_or_else(|| io::Error::other("the environment variable RUSTC, which cargo sets, is missing"))?;
    let version = Command::new(rustc).arg("-vV").output()?;
    let number = code::hash_source_code(package, &files, variables, &String::from_utf8_lossy(&version.stdout))?;
    println!("cargo::rustc-env=ERA_CODE={number:016x}");
    Ok(())
}
