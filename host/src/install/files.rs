//! Files that say who wrote them: others are neither overwritten nor removed, unless by force.

use era_files::{Readers, replace_link_or_file};
use std::fmt;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// First line of every file that is written here.
pub const MARK: &str = "# Written by `era install`, which may replace or remove it.";

/// What was done with a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileChange {
    /// It was not there.
    Written,
    /// Another text was there.
    Replaced,
    /// It was there with the same text.
    Unchanged,
    /// It is gone.
    Removed,
    /// It was not there to be removed.
    Absent,
}

impl fmt::Display for FileChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            FileChange::Written => "wrote",
            FileChange::Replaced => "replaced",
            FileChange::Unchanged => "unchanged",
            FileChange::Removed => "removed",
            FileChange::Absent => "absent",
        })
    }
}

/// Why a file was not written or removed.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// It is somebody else's.
    #[error("{} was not written by `era install`, so the command leaves this file as it is; --force replaces the \
    file, and --force with --remove removes the file", .0.display())]
    Foreign(PathBuf),
    /// The system says no.
    #[error("cannot {what} {}: {source}{}", path.display(), if source.kind() == ErrorKind::PermissionDenied { ". Run the command as root (sudo), or use --print to see the files" } else { "" })]
    Io {
        /// What was tried.
        what: &'static str,
        /// With which file.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
}

/// Makes sure that a file may be written or removed.
///
/// # Errors
/// [`FileError::Foreign`] if it is somebody else's, and those of reading it.
pub fn check_writable(path: &Path, is_forced: bool) -> Result<(), FileError> {
    match read_present(path)? {
        Some(text) if !is_forced && !has_mark(&text) => Err(FileError::Foreign(path.to_path_buf())),
        _ => Ok(()),
    }
}

/// Writes a file as a whole, with its folders.
///
/// # Errors
/// [`FileError`].
pub fn write_marked(path: &Path, text: &str, is_forced: bool) -> Result<FileChange, FileError> {
    check_writable(path, is_forced)?;
    let before = read_present(path)?;
    if before.as_deref() == Some(text.as_bytes()) {
        return Ok(FileChange::Unchanged);
    }
    let failed = |source| FileError::Io { what: "write", path: path.to_path_buf(), source };
    let folder = path.parent().unwrap_or(Path::new("/"));
    std::fs::create_dir_all(folder).map_err(failed)?;
    // Nobody reads half a file, and a link is replaced rather than followed.
    replace_link_or_file(path, Readers::Everybody, text.as_bytes()).map_err(failed)?;
    Ok(if before.is_some() { FileChange::Replaced } else { FileChange::Written })
}

/// Removes a file; its folders stay.
///
/// # Errors
/// [`FileError`].
pub fn remove_marked(path: &Path, is_forced: bool) -> Result<FileChange, FileError> {
    check_writable(path, is_forced)?;
    match std::fs::remove_file(path) {
        Ok(()) => Ok(FileChange::Removed),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(FileChange::Absent),
        Err(source) => Err(FileError::Io { what: "remove", path: path.to_path_buf(), source }),
    }
}

fn read_present(path: &Path) -> Result<Option<Vec<u8>>, FileError> {
    match std::fs::read(path) {
        Ok(text) => Ok(Some(text)),
        // A link to nowhere is something all the same.
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(path.is_symlink().then(Vec::new)),
        Err(source) => Err(FileError::Io { what: "read", path: path.to_path_buf(), source }),
    }
}

fn has_mark(text: &[u8]) -> bool {
    text.split(|byte| *byte == b'\n').next() == Some(MARK.as_bytes())
}
