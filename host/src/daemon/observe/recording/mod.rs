//! What is asked of the daemon and what becomes of it, line by line in files: `era serve --record PATH`, `era replay FILE`.
//!
//! Written by a thread of its own. Where the disk is slower than the fingers, lines are left out and counted: nothing that
//! drives waits for a file. A file that is full is followed by another, and the oldest make way ([`KeptBytes`]).

mod files;

pub use files::KeptBytes;
use files::RecordingFiles;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Lines that may wait for the disk, ...
const WAITING: usize = 4096;
/// ... and bytes that these may have together.
const WAITING_BYTES: usize = 8_000_000;
/// How long after a line was written it is on the disk at the latest, whatever becomes of the machine's power.
const SYNCED_WITHIN: Duration = Duration::from_secs(3);

/// Writes down.
#[derive(Debug)]
pub struct Recorder {
    /// Until the end.
    lines: Option<SyncSender<RecordingLine>>,
    thread: Option<JoinHandle<()>>,
    started: Instant,
    waiting_bytes: Arc<AtomicUsize>,
    left_out: AtomicU64,
}

/// A line that waits.
#[derive(Debug)]
struct RecordingLine {
    /// Since the recording began.
    at: Duration,
    kind: String,
    left_out_before: u64,
    /// A JSON object, as text: what it takes is known.
    content: String,
}

impl RecordingLine {
    /// As it is written to a file that began at `file_start`.
    fn format_as_json_line(&self, file_start: Duration) -> String {
        let at_ms = self.at.saturating_sub(file_start).as_secs_f64() * 1e3;
        let mut head = json!({"at_ms": at_ms, "kind": self.kind});
        if self.left_out_before > 0 {
            head["left_out_before"] = self.left_out_before.into();
        }
        let head = head.to_string();
        match (head.strip_suffix('}'), self.content.strip_prefix('{')) {
            (Some(head), Some(content)) if content != "}" => format!("{head},{content}\n"),
            _ => format!("{head}\n"),
        }
    }
}

impl Recorder {
    /// Begins a new file; one that is there is not written over. In a folder (one that is there, or a path that ends in a slash)
    /// it is named after the time, so that each start has its own. `scene` is the scene's name.
    ///
    /// # Errors
    /// As the file system has it.
    pub fn start(path: &Path, scene: &str) -> std::io::Result<Self> {
        Self::start_with_kept_bytes(path, scene, KeptBytes::default())
    }

    /// The same, with how much is kept.
    ///
    /// # Errors
    /// As the file system has it.
    pub fn start_with_kept_bytes(path: &Path, scene: &str, kept: KeptBytes) -> std::io::Result<Self> {
        let files = RecordingFiles::create_first_file_and_remove_oldest_recordings(path, kept, scene)?;
        tracing::info!("recording to {}", files.current_path().display());
        let (lines, inbox) = sync_channel(WAITING);
        let waiting_bytes = Arc::<AtomicUsize>::default();
        let known = Arc::clone(&waiting_bytes);
        let thread = std::thread::Builder::new().name("recorder".into()).spawn(move || {
            let mut files = files;
            if let Err(error) = write_lines(&mut files, &inbox, &known) {
                tracing::error!(%error, path = %files.current_path().display(), "the recording ends because of an error");
            }
        })?;
        Ok(Self {
            lines: Some(lines),
            thread: Some(thread),
            started: Instant::now(),
            waiting_bytes,
            left_out: AtomicU64::new(0),
        })
    }

    /// Whether the path means a folder with a file for each start: it is one, or ends in a slash.
    #[must_use]
    pub fn is_folder_path(path: &Path) -> bool {
        path.as_os_str().to_string_lossy().ends_with(std::path::is_separator) || path.is_dir()
    }

    /// A line of a kind, with its time in ms since the recording began.
    pub fn queue_line_or_count_as_left_out_if_full(&self, kind: &str, content: impl FnOnce() -> Value) {
        let left_out_before = self.left_out.swap(0, Ordering::Relaxed);
        let at = self.started.elapsed();
        let line = RecordingLine { at, kind: kind.into(), left_out_before, content: content().to_string() };
        let bytes = line.content.len();
        let before = self.waiting_bytes.fetch_add(bytes, Ordering::Relaxed);
        let has_room = before + bytes <= WAITING_BYTES;
        if !has_room || self.lines.as_ref().is_none_or(|lines| lines.try_send(line).is_err()) {
            self.waiting_bytes.fetch_sub(bytes, Ordering::Relaxed);
            self.left_out.fetch_add(left_out_before + 1, Ordering::Relaxed);
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

/// Writes lines as they come until there are no more. After an error the file ends with a whole line.
fn write_lines(
    files: &mut RecordingFiles,
    inbox: &Receiver<RecordingLine>,
    waiting_bytes: &AtomicUsize,
) -> std::io::Result<()> {
    // The first line that is not yet forced onto the disk.
    let mut unsynced: Option<Instant> = None;
    loop {
        let wait = unsynced.map_or(Duration::MAX, |since| SYNCED_WITHIN.saturating_sub(since.elapsed()));
        match inbox.recv_timeout(wait) {
            Ok(line) => {
                // What waits is written at once.
                for line in std::iter::once(line).chain(inbox.try_iter()) {
                    waiting_bytes.fetch_sub(line.content.len(), Ordering::Relaxed);
                    files.begin_next_file_if_line_does_not_fit(line.content.len(), line.at)?;
                    files.buffer_line(&line.format_as_json_line(files.start_of_current_file_in_recording()));
                }
                files.write_buffered_lines()?;
                unsynced.get_or_insert_with(Instant::now);
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return files.sync_written_lines_to_disk(),
        }
        if unsynced.is_some_and(|since| since.elapsed() >= SYNCED_WITHIN) {
            files.sync_written_lines_to_disk()?;
            unsynced = None;
        }
    }
}
