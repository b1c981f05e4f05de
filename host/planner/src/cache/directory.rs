//! The files of a cache: their names, how they are written, and which of them go.

use super::Key;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;

/// Most files that are kept.
pub const MOST_FILES: usize = 64;
/// Most bytes that are kept, in one file or all of them.
pub const MOST_BYTES: u64 = 256 << 20;
/// How tables' files end.
const ENDING: &str = "era-plan";
/// How those end that are being written.
const UNFINISHED: &str = "era-plan-part";

/// Tells files apart that a process writes at the same time.
static NEXT: AtomicU64 = AtomicU64::new(0);

/// The name of a key's file.
pub(super) fn name(key: &Key) -> String {
    format!("{key}.{ENDING}")
}

/// Writes a file that is there whole or not at all: under another name first. It is not forced onto the disk; what a
/// crash of the machine leaves of it has another hash.
pub(super) fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    if let Some(directory) = path.parent() {
        fs::create_dir_all(directory)?;
    }
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    let unfinished = path.with_extension(format!("{}-{number}.{UNFINISHED}", std::process::id()));
    let written = fs::File::create(&unfinished)
        .and_then(|mut file| file.write_all(bytes))
        .and_then(|()| fs::rename(&unfinished, path));
    if written.is_err() {
        // It may not even exist.
        let _ = fs::remove_file(&unfinished);
    }
    written
}

/// Notes that a file was used. A directory that is read only keeps its order.
pub(super) fn touch(path: &Path) {
    let noted = fs::File::options().append(true).open(path).and_then(|file| file.set_modified(SystemTime::now()));
    if let Err(error) = noted {
        tracing::debug!("{}: use is not noted: {error}", path.display());
    }
}

/// Deletes tables until at most `most_files` and `most_bytes` are left, those first that were not used for longest. Other
/// files are left alone.
pub(super) fn tidy(directory: &Path, most_files: usize, most_bytes: u64) {
    let Ok(found) = fs::read_dir(directory) else { return };
    let mut files: Vec<(SystemTime, u64, PathBuf)> = found
        .filter_map(|entry| {
            let path = entry.ok()?.path();
            let own = path.extension().is_some_and(|ending| ending == ENDING || ending == UNFINISHED);
            let data = path.metadata().ok().filter(|data| own && data.is_file())?;
            Some((data.modified().ok()?, data.len(), path))
        })
        .collect();
    // The latest first.
    files.sort_by(|a, b| b.cmp(a));
    let mut bytes = 0_u64;
    for (i, (_, size, path)) in files.iter().enumerate() {
        bytes = bytes.saturating_add(*size);
        if (i >= most_files || bytes > most_bytes)
            && let Err(error) = fs::remove_file(path)
        {
            tracing::debug!("{} is not deleted: {error}", path.display());
        }
    }
}
