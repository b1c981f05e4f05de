//! Files that grow by whole records.

use crate::replaced::{parent_folder, sync_folder};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::path::Path;

/// A file that grows. After a record that could not be written it is cut back, so that it holds whole records, the first of those that it was given.
#[derive(Debug)]
pub struct AppendedFile {
    file: File,
    whole_bytes: u64,
}

impl AppendedFile {
    /// Makes a file that only its owner may read. One that is there is not written over; one without a record, which a writer has left that was ended or
    /// had no room before its first, is taken over, unless its writer is still there (it holds a lock on it).
    ///
    /// # Errors
    /// As the file system has it.
    pub fn create_private(path: &Path) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        options.append(true).create_new(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let file = match options.open(path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists && has_no_records(path) => {
                let left = OpenOptions::new().append(true).open(path)?;
                lock_whole_file(&left)?;
                // Its writer may have begun meanwhile, and ended.
                if left.metadata()?.len() > 0 {
                    return Err(error);
                }
                left
            }
            opened => {
                let made = opened?;
                lock_whole_file(&made)?;
                made
            }
        };
        sync_folder(parent_folder(path))?;
        Ok(Self { file, whole_bytes: 0 })
    }

    /// Appends whole records.
    ///
    /// # Errors
    /// As the file system has it. Nothing of these records is in the file then, unless cutting it back has failed as well, which the error says.
    pub fn append_records(&mut self, records: &[u8]) -> io::Result<()> {
        match self.file.write_all(records) {
            Ok(()) => {
                self.whole_bytes += records.len() as u64;
                Ok(())
            }
            Err(error) => match self.file.set_len(self.whole_bytes) {
                Ok(()) => Err(error),
                Err(uncut) => Err(io::Error::new(
                    error.kind(),
                    format!(
                        "{error}; the file now ends with an incomplete record, because the program could not remove \
                         this record: {uncut}"
                    ),
                )),
            },
        }
    }

    /// Bytes of the records that it holds.
    #[must_use]
    pub fn whole_bytes(&self) -> u64 {
        self.whole_bytes
    }

    /// Forces the records onto the disk.
    ///
    /// # Errors
    /// As the file system has it.
    pub fn sync_records(&self) -> io::Result<()> {
        self.file.sync_data()
    }
}

/// Whether there is a file without a record as [`AppendedFile::create_private`] leaves it: of no bytes, of this process's user or root, and with no
/// right for others. A link to one is none.
#[must_use]
pub fn has_no_records(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok_and(|known| known.is_file() && known.len() == 0 && is_private(&known))
}

#[cfg(unix)]
fn is_private(known: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    crate::own::check_owner_and_mode(known).is_ok() && known.mode() & 0o077 == 0
}

/// Who may read a file is not told by a mode here.
#[cfg(not(unix))]
fn is_private(_: &std::fs::Metadata) -> bool {
    true
}

/// Locks a file until it is closed. File systems without locks do without.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`] where another writer has it.
fn lock_whole_file(file: &File) -> io::Result<()> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(io::ErrorKind::AlreadyExists.into()),
        Ok(()) | Err(TryLockError::Error(_)) => Ok(()),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_file_is_private_and_not_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("day.jsonl");
        let mut file = AppendedFile::create_private(&path).unwrap();
        file.append_records(b"one\n").unwrap();
        file.append_records(b"two\n").unwrap();
        file.sync_records().unwrap();
        assert_eq!((std::fs::read_to_string(&path).unwrap().as_str(), file.whole_bytes()), ("one\ntwo\n", 8));
        assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        assert_eq!(AppendedFile::create_private(&path).unwrap_err().kind(), io::ErrorKind::AlreadyExists);
    }

    #[test]
    fn a_file_without_a_record_is_taken_over_from_nobody_but_a_writer_that_has_gone() {
        let folder = tempfile::tempdir().unwrap();
        let is_there =
            |path: &Path| AppendedFile::create_private(path).unwrap_err().kind() == io::ErrorKind::AlreadyExists;
        let left = folder.path().join("left.jsonl");
        let first = AppendedFile::create_private(&left).unwrap();
        assert!(is_there(&left), "its writer is there");
        drop(first);
        let mut next = AppendedFile::create_private(&left).unwrap();
        assert!(is_there(&left), "its writer is there");
        next.append_records(b"one\n").unwrap();
        drop(next);
        assert!(is_there(&left), "it has a record");
        assert_eq!(std::fs::read_to_string(&left).unwrap(), "one\n");
        assert_eq!(std::fs::metadata(&left).unwrap().permissions().mode() & 0o777, 0o600);
        let open = folder.path().join("open.jsonl");
        std::fs::write(&open, "").unwrap();
        std::fs::set_permissions(&open, std::fs::Permissions::from_mode(0o644)).unwrap();
        assert!(is_there(&open), "others may read it");
        let link = folder.path().join("link.jsonl");
        std::os::unix::fs::symlink("nothing", &link).unwrap();
        assert!(is_there(&link));
    }
}
