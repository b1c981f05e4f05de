//! The serial link to the board as a host has it: through the pseudo-terminal, in time with the clock on the wall.

use super::link::{encode_request_frame, find_reply_with_sequence_among_frames};
use crate::error::Error;
use era_shared::link::MAX_ENCODED;
use era_shared::protocol::{CURRENT_VERSION, MIN_VERSION, Reply, Request, WelcomeReply};
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::Path;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// How long the emulated board may take to answer on the wall clock. It answers within 30 ms on a quiet machine.
const ANSWER_LIMIT: Duration = Duration::from_secs(10);

/// An open pseudo-terminal.
pub struct Terminal {
    port: File,
    bytes: mpsc::Receiver<Vec<u8>>,
    sequence: u16,
}

impl Terminal {
    /// Opens it.
    ///
    /// # Errors
    /// [`Error::File`].
    pub fn open(path: &Path) -> Result<Self, Error> {
        let file_error = |source| Error::File { what: "cannot open", path: path.to_path_buf(), source };
        let port = OpenOptions::new().read(true).write(true).open(path).map_err(file_error)?;
        let mut reader = port.try_clone().map_err(file_error)?;
        let (sender, bytes) = mpsc::channel();
        // A file has no time-out for reading, a channel has. The thread ends with the bridge.
        thread::spawn(move || {
            let mut buffer = [0; MAX_ENCODED];
            while let Ok(count @ 1..) = reader.read(&mut buffer) {
                if sender.send(buffer.iter().take(count).copied().collect()).is_err() {
                    break;
                }
            }
        });
        Ok(Self { port, bytes, sequence: 0 })
    }

    /// Says hello.
    ///
    /// # Errors
    /// [`Error::Silent`] without an answer, [`Error::Bridge`] if the terminal is gone.
    pub fn send_hello(&mut self) -> Result<WelcomeReply, Error> {
        self.sequence = self.sequence.wrapping_add(1);
        let request = Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION };
        let frame = encode_request_frame(CURRENT_VERSION, self.sequence, &request)?;
        self.port.write_all(&frame).map_err(|error| Error::Bridge(error.to_string()))?;
        let end = Instant::now() + ANSWER_LIMIT;
        let mut answer = Vec::new();
        loop {
            let left = end.saturating_duration_since(Instant::now());
            answer.extend(self.bytes.recv_timeout(left).map_err(|_| Error::Silent(ANSWER_LIMIT))?);
            if let Some(Reply::Welcome(welcome)) = find_reply_with_sequence_among_frames(&answer, self.sequence) {
                return Ok(welcome);
            }
        }
    }
}
