//! What is asked of the daemon and what becomes of it, line by line in a file: `era serve --record FILE`, `era replay FILE`.
//!
//! Written by a thread of its own. Where the disk is slower than the fingers, lines are left out and counted: nothing that
//! drives waits for a file.

use era_files::{AppendedFile, make_private_folder};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Instant;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime, SystemTime};

/// Starts in one second that have a file each.
const SAME_SECOND: u32 = 100;
/// Lines that may wait for the disk.
const WAITING: usize = 4096;

/// Writes down.
#[derive(Debug)]
pub struct Recorder {
    /// Until the end.
    lines: Option<SyncSender<Value>>,
    thread: Option<JoinHandle<()>>,
    started: Instant,
    left_out: AtomicU64,
}

impl Recorder {
    /// Begins a new file; one that is there is not written over. In a folder (one that is there, or a path that ends in a slash)
    /// it is named after the time, so that each start has its own. `scene` is the scene's name.
    ///
    /// # Errors
    /// As the file system has it.
    pub fn start(path: &Path, scene: &str) -> std::io::Result<Self> {
        let (path, file) = if Self::is_folder(path) {
            in_folder(path)?
        } else {
            (path.to_owned(), AppendedFile::create_private(path)?)
        };
        tracing::info!("recording to {}", path.display());
        let (lines, inbox) = sync_channel(WAITING);
        let named = path.display().to_string();
        let thread = std::thread::Builder::new().name("recorder".into()).spawn(move || {
            if let Err(error) = write_lines(file, &inbox) {
                tracing::error!(%error, path = named, "nothing is recorded any more");
            }
        })?;
        let recorder =
            Self { lines: Some(lines), thread: Some(thread), started: Instant::now(), left_out: AtomicU64::new(0) };
        recorder.line("begin", || {
            let version = env!("CARGO_PKG_VERSION");
            let since_1970 = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
            json!({"format": 1, "version": version, "scene": scene, "unix_s": since_1970.map_or(0, |time| time.as_secs())})
        });
        Ok(recorder)
    }

    /// Whether the path means a folder with a file for each start: it is one, or ends in a slash.
    #[must_use]
    pub fn is_folder(path: &Path) -> bool {
        path.as_os_str().to_string_lossy().ends_with(std::path::is_separator) || path.is_dir()
    }

    /// A line of a kind, with its time in ms since the recording began.
    pub fn line(&self, kind: &str, content: impl FnOnce() -> Value) {
        let mut line = json!({"at_ms": self.started.elapsed().as_secs_f64() * 1e3, "kind": kind});
        let left_out = self.left_out.swap(0, Ordering::Relaxed);
        if left_out > 0 {
            line["left_out_before"] = left_out.into();
        }
        if let (Value::Object(line), Value::Object(content)) = (&mut line, content()) {
            line.extend(content);
        }
        if self.lines.as_ref().is_none_or(|lines| lines.try_send(line).is_err()) {
            self.left_out.fetch_add(left_out + 1, Ordering::Relaxed);
        }
    }
}

impl Drop for Recorder {
    /// Waits for the last lines.
    fn drop(&mut self) {
        drop(self.lines.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A new file named after the time (UTC, to a second), and where another start in that second has it, with a number behind.
fn in_folder(folder: &Path) -> std::io::Result<(PathBuf, AppendedFile)> {
    make_private_folder(folder)?;
    let mut time = String::new();
    let _ = SystemTime.format_time(&mut Writer::new(&mut time));
    // 2026-01-31T09:30:00.000000Z; some file systems have no colons.
    let time: String = time.chars().take_while(|c| *c != '.').filter(|c| *c != ':').collect();
    let mut number = 1;
    loop {
        let behind = if number == 1 { String::new() } else { format!("-{number}") };
        let path = folder.join(format!("{time}Z{behind}.jsonl"));
        match AppendedFile::create_private(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists && number < SAME_SECOND => number += 1,
            file => return file.map(|file| (path, file)),
        }
    }
}

/// Writes lines as they come until there are no more. After an error the file ends with a whole line.
fn write_lines(mut file: AppendedFile, inbox: &Receiver<Value>) -> std::io::Result<()> {
    let mut text = String::new();
    while let Ok(line) = inbox.recv() {
        text.clear();
        // What waits is written at once.
        for line in std::iter::once(line).chain(inbox.try_iter()) {
            let _ = writeln!(text, "{line}");
        }
        file.append_records(text.as_bytes())?;
    }
    file.sync_records()
}
