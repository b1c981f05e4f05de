//! Tells the program which code it was made of: tables that are kept on disk are those of the same code only.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// What a table depends on.
const SOURCES: [&str; 4] = ["src/scene", "src/model", "src/response", "src/planner"];

fn main() -> io::Result<()> {
    let mut files = Vec::new();
    for source in SOURCES {
        println!("cargo::rerun-if-changed={source}");
        collect(Path::new(source), &mut files)?;
    }
    files.sort();
    let mut hash = 0xcbf2_9ce4_8422_2325;
    for file in files {
        hash = add(hash, file.to_string_lossy().as_bytes());
        hash = add(hash, &fs::read(file)?);
    }
    println!("cargo::rustc-env=ERA_CODE={hash:016x}");
    Ok(())
}

fn collect(directory: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(directory)? {
        let path = entry?.path();
        if path.is_dir() { collect(&path, files)? } else { files.push(path) }
    }
    Ok(())
}

/// FNV-1a of 64 bits: it has to tell versions apart, not to resist anybody.
fn add(hash: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(hash, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3))
}
