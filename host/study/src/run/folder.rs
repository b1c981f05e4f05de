//! A study's folder: rows of each task in a file of its own, written once and whole.
//!
//! A file is written beside its place and renamed, so that it is there whole or not at all, whoever is killed or runs out of room; two
//! who do the same task write the same bytes, and no two write to the same file beside it, on whatever machines they are. What is read is checked: the
//! study that it belongs to, and a hash of the task and its rows.

use super::row::DesignRow;
use super::task::StudyTask;
use era_files::{Readers, replace_file};
use sha2::{Digest, Sha256};
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// How a file of rows begins.
const MAGIC: &[u8; 16] = b"era study rows 2";
/// The file that says which study a folder belongs to.
const KEY: &str = "study.key";
/// The folder of the tasks' rows.
const ROWS: &str = "rows";
/// Bytes of a hash.
const HASH: usize = 32;

/// A study's folder.
#[derive(Debug)]
pub struct StudyFolder {
    path: PathBuf,
    key: [u8; HASH],
}

/// Why a folder cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// A file cannot be read or written.
    #[error("cannot {doing} {}: {error}", path.display())]
    Io {
        /// What was done.
        doing: &'static str,
        /// With which file.
        path: PathBuf,
        /// What went wrong.
        error: io::Error,
    },
    /// It has the results of something else.
    #[error(
        "the folder \"{}\" has results of another study, or of another version of the study, the scene or this program: \
         name another folder, or delete this folder",
        path.display()
    )]
    Other {
        /// The folder.
        path: PathBuf,
    },
}

impl StudyFolder {
    /// Opens a study's folder, made if it is not there.
    ///
    /// # Errors
    /// [`FolderError`].
    pub fn open_or_create_refusing_folder_of_other_study(path: &Path, key: [u8; HASH]) -> Result<Self, FolderError> {
        let folder = Self { path: path.into(), key };
        let rows = folder.path.join(ROWS);
        fs::create_dir_all(&rows).map_err(|error| FolderError::Io {
            doing: "create the folder",
            path: rows.clone(),
            error,
        })?;
        let own = format_hex(&key);
        let known = folder.path.join(KEY);
        // What a loss of power leaves need not be text.
        match fs::read(&known).map(|bytes| String::from_utf8_lossy(&bytes).into_owned()) {
            Ok(text) if text.trim() == own => Ok(folder),
            Ok(text) if !is_complete_hex_key(&text) && folder.is_without_rows_of_other_studies()? => {
                tracing::warn!("the file \"{}\" is incomplete, so the program writes the file again", known.display());
                folder.write_key_file()
            }
            Ok(_) => Err(FolderError::Other { path: folder.path }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => folder.write_key_file(),
            Err(error) => Err(FolderError::Io { doing: "read", path: known, error }),
        }
    }

    fn write_key_file(self) -> Result<Self, FolderError> {
        self.write_file_atomically(KEY, format!("{}\n", format_hex(&self.key)).as_bytes())?;
        Ok(self)
    }

    /// Whether no file of rows in the folder begins with another study's key.
    fn is_without_rows_of_other_studies(&self) -> Result<bool, FolderError> {
        let rows = self.path.join(ROWS);
        let failed = |error| FolderError::Io { doing: "read", path: rows.clone(), error };
        for entry in fs::read_dir(&rows).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            let mut start = Vec::new();
            let read =
                fs::File::open(&path).and_then(|file| file.take((MAGIC.len() + HASH) as u64).read_to_end(&mut start));
            read.map_err(|error| FolderError::Io { doing: "read", path, error })?;
            let key = start.strip_prefix(MAGIC.as_slice()).filter(|key| key.len() == HASH);
            if key.is_some_and(|key| key != self.key) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The rows of a task, if they are there and whole.
    ///
    /// # Errors
    /// [`FolderError`] where the file is there and cannot be read.
    pub fn load_task_rows_if_complete(&self, task: StudyTask) -> Result<Option<Vec<DesignRow>>, FolderError> {
        let path = self.path.join(ROWS).join(task.rows_file_name());
        let bytes = match fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(FolderError::Io { doing: "read", path, error }),
        };
        let rows = decode_task_rows_if_of_study_and_task(&self.key, task, &bytes);
        if rows.is_none() {
            tracing::warn!(
                "the file \"{}\" is incomplete or damaged, so the program computes the designs of this file again",
                path.display()
            );
        }
        Ok(rows)
    }

    /// Writes the rows of a task.
    ///
    /// # Errors
    /// [`FolderError`]; nothing of them is left then.
    pub fn write_task_rows(&self, task: StudyTask, rows: &[DesignRow]) -> Result<(), FolderError> {
        let encoded = encode_task_rows(&self.key, task, rows);
        let name = format!("{ROWS}/{}", task.rows_file_name());
        let failed = |error| FolderError::Io { doing: "encode the rows of", path: self.path.join(&name), error };
        self.write_file_atomically(&name, &encoded.map_err(failed)?)
    }

    /// Keeps the rows of a task as somebody else has [`encode_task_rows`] them; says whether they are rows of this study and task.
    ///
    /// # Errors
    /// As [`StudyFolder::write_task_rows`].
    pub fn write_encoded_rows_if_of_this_study_and_task(
        &self,
        task: StudyTask,
        bytes: &[u8],
    ) -> Result<bool, FolderError> {
        let is_own = decode_task_rows_if_of_study_and_task(&self.key, task, bytes).is_some();
        if is_own {
            self.write_file_atomically(&format!("{ROWS}/{}", task.rows_file_name()), bytes)?;
        }
        Ok(is_own)
    }

    /// Writes a file of the folder, whole or not at all.
    ///
    /// # Errors
    /// [`FolderError`].
    pub fn write_file_atomically(&self, name: &str, bytes: &[u8]) -> Result<(), FolderError> {
        let path = self.path.join(name);
        replace_file(&path, Readers::ByUmask, bytes).map_err(|error| FolderError::Io { doing: "write", path, error })
    }
}

/// Rows as their file has them: which study they are of, a hash of their task and themselves, and themselves.
///
/// # Errors
/// Rows that postcard does not take, of which there are none.
pub fn encode_task_rows(key: &[u8; HASH], task: StudyTask, rows: &[DesignRow]) -> io::Result<Vec<u8>> {
    let body = postcard::to_allocvec(rows).map_err(io::Error::other)?;
    Ok([MAGIC.as_slice(), key, &hash_task_rows(task, &body), &body].concat())
}

fn hash_task_rows(task: StudyTask, body: &[u8]) -> [u8; HASH] {
    // Names have no zero in them.
    Sha256::new().chain_update(task.to_string()).chain_update([0]).chain_update(body).finalize().into()
}

/// The rows in a file's bytes, if they are of this study and task, and whole.
#[must_use]
pub fn decode_task_rows_if_of_study_and_task(
    key: &[u8; HASH],
    task: StudyTask,
    bytes: &[u8],
) -> Option<Vec<DesignRow>> {
    let rest = bytes.strip_prefix(MAGIC.as_slice())?.strip_prefix(key.as_slice())?;
    let (told, body) = rest.split_at_checked(HASH)?;
    if hash_task_rows(task, body) != told {
        return None;
    }
    postcard::from_bytes(body).ok()
}

/// Whether the text of a folder's key is a whole one, of whatever study.
fn is_complete_hex_key(text: &str) -> bool {
    let key = text.trim();
    key.len() == 2 * HASH && key.bytes().all(|digit| digit.is_ascii_hexdigit())
}

/// Bytes in hexadecimal digits.
pub(super) fn format_hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::row::DesignOutcome;
    use crate::space::{Design, VariableSetting};

    fn make_task_rows() -> Vec<DesignRow> {
        let design = Design { settings: vec![VariableSetting::Number(0.1), VariableSetting::Place([1.5, 2.5])] };
        vec![DesignRow { point: vec![0.25, 0.75], design, outcome: DesignOutcome::Failed("no such place".into()) }]
    }

    #[test]
    fn rows_come_back_unless_a_byte_of_them_has_changed() {
        let place = tempfile::tempdir().unwrap();
        let folder = StudyFolder::open_or_create_refusing_folder_of_other_study(place.path(), [7; 32]).unwrap();
        let task = StudyTask::Designs { chunk: 3 };
        assert_eq!(folder.load_task_rows_if_complete(task).unwrap(), None);
        folder.write_task_rows(task, &make_task_rows()).unwrap();
        assert_eq!(folder.load_task_rows_if_complete(task).unwrap(), Some(make_task_rows()));
        let file = place.path().join("rows").join(task.rows_file_name());
        let whole = fs::read(&file).unwrap();
        for at in [0, 20, 60, whole.len() - 1] {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            fs::write(&file, &bytes).unwrap();
            assert_eq!(folder.load_task_rows_if_complete(task).unwrap(), None, "{at}");
        }
        fs::write(&file, &whole[..whole.len() - 1]).unwrap();
        assert_eq!(folder.load_task_rows_if_complete(task).unwrap(), None);
        // Nor are they another task's.
        let other = StudyTask::Designs { chunk: 4 };
        fs::write(place.path().join("rows").join(other.rows_file_name()), &whole).unwrap();
        assert_eq!(folder.load_task_rows_if_complete(other).unwrap(), None);
        assert!(
            !folder.write_encoded_rows_if_of_this_study_and_task(other, &whole).unwrap()
                && folder.write_encoded_rows_if_of_this_study_and_task(task, &whole).unwrap()
        );
        assert_eq!(folder.load_task_rows_if_complete(task).unwrap(), Some(make_task_rows()));
    }

    #[test]
    fn a_folder_belongs_to_one_study() {
        let place = tempfile::tempdir().unwrap();
        StudyFolder::open_or_create_refusing_folder_of_other_study(place.path(), [7; 32]).unwrap();
        assert!(StudyFolder::open_or_create_refusing_folder_of_other_study(place.path(), [7; 32]).is_ok());
        let refused = StudyFolder::open_or_create_refusing_folder_of_other_study(place.path(), [8; 32]).unwrap_err();
        assert!(matches!(refused, FolderError::Other { .. }), "{refused}");
        assert!(refused.to_string().contains(&place.path().display().to_string()));
    }

    /// A machine that lost its power may leave a key of no bytes, or of zeros. It is written anew, unless there are rows of another study.
    #[test]
    fn a_damaged_key_is_written_again_beside_rows_of_the_same_study_only() {
        let place = tempfile::tempdir().unwrap();
        let key = place.path().join(KEY);
        let task = StudyTask::Designs { chunk: 0 };
        StudyFolder::open_or_create_refusing_folder_of_other_study(place.path(), [7; 32])
            .unwrap()
            .write_task_rows(task, &make_task_rows())
            .unwrap();
        let whole = fs::read(&key).unwrap();
        for damaged in [&b""[..], &whole[..20], &[0; 65], &[0xff, 0xfe, 0]] {
            fs::write(&key, damaged).unwrap();
            let folder = StudyFolder::open_or_create_refusing_folder_of_other_study(place.path(), [7; 32]).unwrap();
            assert_eq!(
                (fs::read(&key).unwrap(), folder.load_task_rows_if_complete(task).unwrap()),
                (whole.clone(), Some(make_task_rows()))
            );
            fs::write(&key, damaged).unwrap();
            assert!(matches!(
                StudyFolder::open_or_create_refusing_folder_of_other_study(place.path(), [8; 32]),
                Err(FolderError::Other { .. })
            ));
        }
    }

    /// A place that cannot be written to stands for one without room: the error names it, and nothing half-written is left.
    #[test]
    fn what_cannot_be_written_is_reported_and_leaves_nothing() {
        let place = tempfile::tempdir().unwrap();
        let folder = StudyFolder::open_or_create_refusing_folder_of_other_study(place.path(), [7; 32]).unwrap();
        let task = StudyTask::Designs { chunk: 0 };
        // A folder in the file's place: the rename fails after all has been written.
        fs::create_dir(place.path().join("rows").join(task.rows_file_name())).unwrap();
        let refused = folder.write_task_rows(task, &make_task_rows()).unwrap_err();
        assert!(refused.to_string().contains(&task.rows_file_name()), "{refused}");
        let left: Vec<String> = fs::read_dir(place.path().join("rows"))
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        assert_eq!(left, [task.rows_file_name()]);
        fs::write(place.path().join("no-folder"), "").unwrap();
        let refused =
            StudyFolder::open_or_create_refusing_folder_of_other_study(&place.path().join("no-folder"), [7; 32])
                .unwrap_err();
        assert!(refused.to_string().contains("no-folder"), "{refused}");
    }
}
