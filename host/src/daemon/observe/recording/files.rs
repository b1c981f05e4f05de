//! The files of a recording: one after the other, none larger than it may be, and the oldest of them removed.

use super::Recorder;
use era_files::{AppendedFile, make_private_folder};
use serde_json::json;
use std::collections::VecDeque;
use std::io::{ErrorKind, Result};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime, SystemTime as Clock};

/// Files of one name, or begun in one second.
const SAME_NAME: u32 = 10_000;
/// How names of a folder's files end.
const ENDING: &str = "Z.jsonl";

/// How much is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeptBytes {
    /// Bytes of one file, after which the next one is begun.
    pub file_bytes: u64,
    /// Bytes of all files together: the oldest are removed before that. Those of earlier starts count as well.
    pub total_bytes: u64,
}

impl Default for KeptBytes {
    /// A day of touches, one each second, and a week.
    fn default() -> Self {
        Self { file_bytes: 256_000_000, total_bytes: 2_000_000_000 }
    }
}

/// The file that is written, and those before it.
#[derive(Debug)]
pub struct RecordingFiles {
    /// As the recording was asked for.
    wanted: PathBuf,
    is_in_folder: bool,
    kept: KeptBytes,
    scene: String,
    /// All, the oldest first, with their bytes; the last is written.
    all: VecDeque<(PathBuf, u64)>,
    file: AppendedFile,
    /// When the file was begun, since the recording was.
    began: Duration,
    /// Whole lines that are not written yet.
    waiting: String,
}

impl RecordingFiles {
    /// Begins the first one; a file that is there is not written over.
    ///
    /// # Errors
    /// As the file system has it.
    pub fn create_first_file_and_remove_oldest_recordings(wanted: &Path, kept: KeptBytes, scene: &str) -> Result<Self> {
        let is_in_folder = Recorder::is_folder_path(wanted);
        if is_in_folder {
            make_private_folder(wanted)?;
        }
        let mut all = if is_in_folder {
            list_earlier_recordings_and_bytes(wanted)?
        } else {
            list_numbered_files_and_bytes(wanted)?
        };
        let (path, file) = if is_in_folder {
            create_file_named_by_time(wanted)?
        } else {
            (wanted.to_owned(), AppendedFile::create_private(wanted)?)
        };
        all.push_back((path, 0));
        let (wanted, scene) = (wanted.to_owned(), scene.to_owned());
        let mut files =
            Self { wanted, is_in_folder, kept, scene, all, file, began: Duration::ZERO, waiting: String::new() };
        files.buffer_header_line_of_file();
        files.write_buffered_lines()?;
        files.remove_oldest_files();
        Ok(files)
    }

    /// The file that is written.
    #[must_use]
    pub fn current_path(&self) -> &Path {
        self.all.back().map_or(&self.wanted, |(path, _)| path)
    }

    /// When it was begun, since the recording was.
    #[must_use]
    pub const fn start_of_current_file_in_recording(&self) -> Duration {
        self.began
    }

    /// Begins the next one at this time if so many bytes more would be too many for this one.
    ///
    /// # Errors
    /// As the file system has it.
    pub fn begin_next_file_if_line_does_not_fit(&mut self, more_bytes: usize, start: Duration) -> Result<()> {
        let has = self.all.back().map_or(0, |(_, bytes)| *bytes);
        if has + (self.waiting.len() + more_bytes) as u64 <= self.kept.file_bytes {
            return Ok(());
        }
        self.write_buffered_lines()?;
        self.sync_written_lines_to_disk()?;
        let (path, file) = if self.is_in_folder {
            create_file_named_by_time(&self.wanted)?
        } else {
            create_next_numbered_file(&self.wanted)?
        };
        (self.file, self.began) = (file, start);
        self.all.push_back((path, 0));
        self.remove_oldest_files();
        self.buffer_header_line_of_file();
        Ok(())
    }

    /// A whole line, which is written with the next [`Self::write_buffered_lines`].
    pub fn buffer_line(&mut self, line: &str) {
        self.waiting.push_str(line);
    }

    /// Writes what waits.
    ///
    /// # Errors
    /// As the file system has it; the file ends with a whole line then.
    pub fn write_buffered_lines(&mut self) -> Result<()> {
        // Half a line is none: what was written before it is worth keeping.
        let written = self.file.append_records(self.waiting.as_bytes());
        if let Some((_, bytes)) = self.all.back_mut() {
            *bytes = self.file.whole_bytes();
        }
        self.waiting.clear();
        written
    }

    /// Waits until it is on the disk.
    ///
    /// # Errors
    /// As the file system has it.
    pub fn sync_written_lines_to_disk(&mut self) -> Result<()> {
        self.file.sync_records()
    }

    fn buffer_header_line_of_file(&mut self) {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
        let (version, scene) = (env!("CARGO_PKG_VERSION"), &self.scene);
        let line = json!({
            "at_ms": 0.0, "kind": "begin", "format": 1, "version": version, "scene": scene, "unix_s": since_1970,
        });
        self.buffer_line(&format!("{line}\n"));
    }

    /// Makes room for one more whole file; never removes the one that is written.
    fn remove_oldest_files(&mut self) {
        let most = self.kept.total_bytes.saturating_sub(self.kept.file_bytes);
        while self.all.len() > 1 && self.all.iter().rev().skip(1).map(|(_, bytes)| bytes).sum::<u64>() > most {
            let Some((path, _)) = self.all.pop_front() else { return };
            if let Err(error) = std::fs::remove_file(&path) {
                tracing::warn!(%error, "cannot remove the old recording \"{}\"", path.display());
            }
        }
    }
}

/// The first of some names, from a number on, that is free.
fn create_file_with_first_free_number(
    first_number: u32,
    make_path: impl Fn(u32) -> PathBuf,
) -> Result<(PathBuf, AppendedFile)> {
    let mut number = first_number;
    loop {
        let path = make_path(number);
        match AppendedFile::create_private(&path) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists && number - first_number < SAME_NAME => number += 1,
            file => return file.map(|file| (path, file)),
        }
    }
}

/// A new file named after the time (UTC, to a second), and where another has that name, with a number behind.
fn create_file_named_by_time(folder: &Path) -> Result<(PathBuf, AppendedFile)> {
    let mut time = String::new();
    let _ = Clock.format_time(&mut Writer::new(&mut time));
    // 2026-01-31T09:30:00.000000Z; some file systems have no colons.
    let time: String = time.chars().take_while(|c| *c != '.').filter(|c| *c != ':').collect();
    create_file_with_first_free_number(1, |number| {
        folder.join(if number == 1 { format!("{time}{ENDING}") } else { format!("{time}Z-{number}.jsonl") })
    })
}

/// `day.jsonl` is followed by `day-2.jsonl`, and that by `day-3.jsonl`, whatever of them has been removed.
fn create_next_numbered_file(first: &Path) -> Result<(PathBuf, AppendedFile)> {
    let last = list_numbered_files_and_bytes(first)?.pop_back().and_then(|(path, _)| parse_file_number(first, &path));
    let (stem, ending) = split_stem_and_ending(first);
    create_file_with_first_free_number(last.unwrap_or(1).saturating_add(1), |number| {
        first.with_file_name(format!("{stem}-{number}{ending}"))
    })
}

/// The files that have followed this one, the oldest first, with their bytes.
fn list_numbered_files_and_bytes(first: &Path) -> Result<VecDeque<(PathBuf, u64)>> {
    let folder = first.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = first.with_file_name(entry?.file_name());
        if let (Some(number), Ok(known)) = (parse_file_number(first, &path), std::fs::symlink_metadata(&path))
            && known.is_file()
        {
            found.push((number, path, known.len()));
        }
    }
    found.sort();
    Ok(found.into_iter().map(|(_, path, bytes)| (path, bytes)).collect())
}

/// The number of a file that has followed this one.
fn parse_file_number(first: &Path, path: &Path) -> Option<u32> {
    let (stem, ending) = split_stem_and_ending(first);
    let name = path.file_name()?.to_str()?;
    let number = name.strip_prefix(&format!("{stem}-"))?.strip_suffix(&ending)?;
    number.parse().ok().filter(|own: &u32| *own >= 2 && own.to_string() == number)
}

/// A file's name before its ending, and the ending with its dot.
fn split_stem_and_ending(path: &Path) -> (String, String) {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let ending = path.extension().map(|ending| format!(".{}", ending.to_string_lossy())).unwrap_or_default();
    (stem, ending)
}

/// What earlier starts have left in a folder, the oldest first: files whose names this program gives.
fn list_earlier_recordings_and_bytes(folder: &Path) -> Result<VecDeque<(PathBuf, u64)>> {
    let is_own = |name: &str| {
        let is_time = |text: &str| text.len() == 17 && text.chars().all(|c| c.is_ascii_digit() || c == '-' || c == 'T');
        let is_numbered = |rest: &str| {
            let number = rest.strip_prefix("Z-").and_then(|rest| rest.strip_suffix(".jsonl"));
            number.is_some_and(|number| number.chars().all(|c| c.is_ascii_digit()))
        };
        name.split_once('Z').is_some_and(|(time, _)| is_time(time))
            && name.get(17..).is_some_and(|rest| rest == ENDING || is_numbered(rest))
    };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let metadata = entry.metadata()?;
        if metadata.is_file() && entry.file_name().to_str().is_some_and(is_own) {
            found.push((metadata.modified()?, entry.path(), metadata.len()));
        }
    }
    found.sort();
    Ok(found.into_iter().map(|(_, path, bytes)| (path, bytes)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::Recording;

    /// Bytes of a folder's files, and their names in order.
    fn names(folder: &Path) -> (u64, Vec<String>) {
        let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
        let mut all: Vec<(String, u64)> =
            entries.map(|entry| (entry.file_name().into_string().unwrap(), entry.metadata().unwrap().len())).collect();
        all.sort();
        (all.iter().map(|(_, bytes)| bytes).sum(), all.into_iter().map(|(name, _)| name).collect())
    }

    #[test]
    fn what_is_recorded_has_an_end() {
        let kept = KeptBytes { file_bytes: 20_000, total_bytes: 60_000 };
        for is_in_folder in [false, true] {
            let folder = tempfile::tempdir().unwrap();
            let foreign = folder.path().join("notes.jsonl");
            std::fs::write(&foreign, "mine").unwrap();
            let path = if is_in_folder { folder.path().to_owned() } else { folder.path().join("day.jsonl") };
            for _ in 0..2 {
                let recorder = Recorder::start_with_kept_bytes(&path, "desk", kept).unwrap();
                for i in 0..1000 {
                    recorder.queue_line_or_count_as_left_out_if_full(
                        "touch",
                        || json!({"id": i, "body": {"x_px": 1, "y_px": 2, "duration_ms": 1000}}),
                    );
                    if i % 100 == 99 {
                        // The disk has time.
                        std::thread::sleep(Duration::from_millis(20));
                    }
                }
                drop(recorder);
            }
            if !is_in_folder {
                // In the order in which they were begun, though the first and others of them have been removed.
                let numbered = list_numbered_files_and_bytes(&path).unwrap();
                let begins: Vec<SystemTime> =
                    numbered.iter().map(|(path, _)| std::fs::metadata(path).unwrap().modified().unwrap()).collect();
                assert!(begins.len() > 1 && begins.is_sorted(), "{numbered:?}");
            }
            let (bytes, names) = names(folder.path());
            assert!((20_000..=61_000).contains(&bytes), "{bytes} {names:?}");
            assert!(foreign.exists() && names.len() > 2, "{names:?}");
            for name in names.iter().filter(|name| *name != "notes.jsonl") {
                let text = std::fs::read_to_string(folder.path().join(name)).unwrap();
                Recording::parse(text.as_bytes()).unwrap_or_else(|error| panic!("{name}: {error}"));
            }
        }
    }
}
