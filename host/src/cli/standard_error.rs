//! Standard error, written by a thread of its own. Where nobody takes what is written (a pager that waits, a terminal that was stopped with
//! Ctrl-S), whoever says something goes on all the same, above all the thread that keeps a board alive; where nobody is there any more it is lost.

use std::io::Write;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

/// Texts that wait to be written; more are lost, and counted.
const MOST: usize = 4096;
/// How long the end of the program waits for them.
const LAST: Duration = Duration::from_millis(500);

enum Text {
    Bytes(Vec<u8>),
    /// Answered when all earlier texts are written.
    Mark(SyncSender<()>),
}

static QUEUE: OnceLock<Option<SyncSender<Text>>> = OnceLock::new();
static LOST: AtomicU64 = AtomicU64::new(0);

/// Nothing where the system gives no thread.
fn get_or_start_writer_queue() -> Option<&'static SyncSender<Text>> {
    let start = || {
        let (texts, waiting) = sync_channel(MOST);
        std::thread::Builder::new().name("log".into()).spawn(move || write_queued_texts(&waiting)).ok().map(|_| texts)
    };
    QUEUE.get_or_init(start).as_ref()
}

fn write_queued_texts(waiting: &Receiver<Text>) {
    for text in waiting {
        match text {
            Text::Bytes(bytes) => {
                let mut out = std::io::stderr().lock();
                let lost = LOST.swap(0, Ordering::Relaxed);
                // That it is closed can be told nobody.
                if lost > 0 {
                    let _ = writeln!(out, "(standard error accepted no text for a while: {lost} lines are lost)");
                }
                let _ = out.write_all(&bytes);
            }
            Text::Mark(written) => {
                let _ = written.try_send(());
            }
        }
    }
}

/// Has the bytes written after all that were given before, and does not wait for it.
pub fn queue_for_standard_error_or_drop_if_full(bytes: &[u8]) {
    match get_or_start_writer_queue() {
        Some(queue) => {
            if let Err(TrySendError::Full(_)) = queue.try_send(Text::Bytes(bytes.to_vec())) {
                LOST.fetch_add(1, Ordering::Relaxed);
            }
        }
        None => {
            let _ = std::io::stderr().write_all(bytes);
        }
    }
}

/// Waits until all that was given is written, and no longer than 0.5 s.
pub fn wait_until_queue_is_written_or_timeout() {
    let Some(queue) = QUEUE.get().and_then(Option::as_ref) else { return };
    let (written, is_written) = sync_channel(1);
    if queue.try_send(Text::Mark(written)).is_ok() {
        let _ = is_written.recv_timeout(LAST);
    }
}

/// What logs write to: a line at a time.
pub struct Later;

impl Write for Later {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        queue_for_standard_error_or_drop_if_full(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}
