//! Files that grow by whole records.

use crate::replaced::{folder_of, sync_folder};
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;

/// A file that grows. After a record that could not be written it is cut back, so that it holds whole records, the first of those that it was given.
#[derive(Debug)]
pub struct AppendedFile {
    file: File,
    whole_bytes: u64,
}

impl AppendedFile {
    /// Makes a file that only its owner may read; one that is there is not written over.
    ///
    /// # Errors
    /// As the file system has it.
    pub fn create_private(path: &Path) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        options.append(true).create_new(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let file = match options.open(path) {
            // What a writer has left that was ended, or had no room, before its first record.
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists && is_empty_file(path) => {
                // Not written to: it may be somebody else's, or open for all to read.
                std::fs::remove_file(path)?;
                options.open(path)?
            }
            opened => opened?,
        };
        sync_folder(folder_of(path))?;
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
                    format!("{error}; its end is no whole record, as it cannot be cut back: {uncut}"),
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

/// Whether there is a file of no bytes; a link to one is none.
#[must_use]
pub fn is_empty_file(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok_and(|known| known.is_file() && known.len() == 0)
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
        // One without a record, of a disk that was full, is nobody's recording.
        let left = folder.path().join("left.jsonl");
        std::fs::write(&left, "").unwrap();
        std::fs::set_permissions(&left, std::fs::Permissions::from_mode(0o644)).unwrap();
        AppendedFile::create_private(&left).unwrap().append_records(b"one\n").unwrap();
        assert_eq!(std::fs::metadata(&left).unwrap().permissions().mode() & 0o777, 0o600);
        let link = folder.path().join("link.jsonl");
        std::os::unix::fs::symlink("nothing", &link).unwrap();
        assert_eq!(AppendedFile::create_private(&link).unwrap_err().kind(), io::ErrorKind::AlreadyExists);
    }
}
