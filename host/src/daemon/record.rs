//! What is asked of the daemon and what becomes of it, line by line in a file: `era serve --record FILE`, `era replay FILE`.
//!
//! Written by a thread of its own. Where the disk is slower than the fingers, lines are left out and counted: nothing that
//! drives waits for a file.

use serde_json::{Value, json};
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

/// Lines that may wait for the disk.
const WAITING: usize = 4096;
/// Most of a recording that is lost when the machine is.
const FLUSH: Duration = Duration::from_secs(1);

/// Writes down.
#[derive(Debug)]
pub struct Recorder {
    lines: SyncSender<Value>,
    started: Instant,
    left_out: AtomicU64,
}

impl Recorder {
    /// Begins a new file; one that is there is not written over. `scene` is the scene's name.
    ///
    /// # Errors
    /// As the file system has it.
    pub fn start(path: &Path, scene: &str) -> std::io::Result<Self> {
        let file = std::fs::OpenOptions::new().write(true).create_new(true).open(path)?;
        let (lines, inbox) = sync_channel(WAITING);
        let named = path.display().to_string();
        std::thread::Builder::new().name("recorder".into()).spawn(move || {
            if let Err(error) = write(BufWriter::new(file), &inbox) {
                tracing::error!(%error, path = named, "nothing is recorded any more");
            }
        })?;
        let recorder = Self { lines, started: Instant::now(), left_out: AtomicU64::new(0) };
        recorder.line("begin", || {
            let version = env!("CARGO_PKG_VERSION");
            let since_1970 = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
            json!({"format": 1, "version": version, "scene": scene, "unix_s": since_1970.map_or(0, |time| time.as_secs())})
        });
        Ok(recorder)
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
        if self.lines.try_send(line).is_err() {
            self.left_out.fetch_add(left_out + 1, Ordering::Relaxed);
        }
    }
}

fn write(mut file: impl Write, inbox: &Receiver<Value>) -> std::io::Result<()> {
    loop {
        match inbox.recv_timeout(FLUSH) {
            Ok(line) => writeln!(file, "{line}")?,
            Err(RecvTimeoutError::Timeout) => file.flush()?,
            Err(RecvTimeoutError::Disconnected) => return file.flush(),
        }
    }
}
