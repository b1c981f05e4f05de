//! The files of a cache: their names, whose they are, how they are written, and which of them go.

use super::Key;
use super::file::UnusableFile;
use era_files::{NotOwn, Readers, check_own_folder, make_private_folder, remove_unfinished, replace_link_or_file};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Most files that are kept.
pub const MOST_FILES: usize = 64;
/// How tables' files end.
const ENDING: &str = "era-plan";

/// The file name for a key.
pub(super) fn file_name_for_key(key: &Key) -> String {
    format!("{key}.{ENDING}")
}

/// Checks that nobody but this user and root can have put a file into a directory; one that is not there yet is nobody's.
pub(super) fn check_directory_owned_and_writable_only_by_user_if_it_exists(
    directory: &Path,
) -> Result<(), UnusableFile> {
    match check_own_folder(directory) {
        Err(NotOwn::Io(error)) if error.kind() == ErrorKind::NotFound => Ok(()),
        checked => checked.map_err(|reason| UnusableFile::Directory { path: directory.to_owned(), reason }),
    }
}

/// Writes a file for its owner alone, whole or not at all. A missing directory is made for the owner alone.
pub(super) fn write_private_file_making_directory(path: &Path, bytes: &[u8]) -> Result<(), UnusableFile> {
    if let Some(directory) = path.parent() {
        make_private_folder(directory)?;
        check_directory_owned_and_writable_only_by_user_if_it_exists(directory)?;
    }
    Ok(replace_link_or_file(path, Readers::Owner, bytes)?)
}

/// Records that a file was used. In a read-only directory nothing is recorded.
pub(super) fn set_modified_time_to_now_if_possible(path: &Path) {
    let noted = fs::File::options().append(true).open(path).and_then(|file| file.set_modified(SystemTime::now()));
    if let Err(error) = noted {
        tracing::debug!("cannot record that the plan table {} was used: {error}", path.display());
    }
}

/// Deletes tables until at most `most_files` and `most_bytes` are left, least recently used first. Other files stay.
pub(super) fn remove_unfinished_files_and_least_recently_used_tables(
    directory: &Path,
    most_files: usize,
    most_bytes: u64,
) {
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
            tracing::debug!("cannot delete the plan table {}: {error}", path.display());
        }
    }
}
