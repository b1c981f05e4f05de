//! The files of a cache: their names, whose they are, how they are written, and which of them go.

use super::Key;
use super::file::Unusable;
use era_files::{NotOwn, Readers, check_own_folder, make_private_folder, remove_unfinished, replace_link_or_file};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Most files that are kept.
pub const MOST_FILES: usize = 64;
/// How tables' files end.
const ENDING: &str = "era-plan";

/// The name of a key's file.
pub(super) fn name(key: &Key) -> String {
    format!("{key}.{ENDING}")
}

/// Checks that nobody but this user and root can have put a file into a directory; one that is not there yet is nobody's.
pub(super) fn check_owner(directory: &Path) -> Result<(), Unusable> {
    match check_own_folder(directory) {
        Err(NotOwn::Io(error)) if error.kind() == ErrorKind::NotFound => Ok(()),
        checked => checked.map_err(|reason| Unusable::Directory { path: directory.to_owned(), reason }),
    }
}

/// Writes a file for its owner alone, whole or not at all, into a directory that is made for the owner alone if it is not there.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), Unusable> {
    if let Some(directory) = path.parent() {
        make_private_folder(directory)?;
        check_owner(directory)?;
    }
    Ok(replace_link_or_file(path, Readers::Owner, bytes)?)
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
    remove_unfinished(directory);
    let Ok(found) = fs::read_dir(directory) else { return };
    let mut files: Vec<(SystemTime, u64, PathBuf)> = found
        .filter_map(|entry| {
            let path = entry.ok()?.path();
            let own = path.extension().is_some_and(|ending| ending == ENDING);
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
