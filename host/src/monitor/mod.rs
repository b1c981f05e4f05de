//! The firmware's log: defmt frames, made into text with the tables in the image that the board runs.
//!
//! The board keeps its last log lines in a ring, which `Request::Log` drains; a debug probe reads the same ring through
//! RTT. The text of the lines is in the ELF file only, so it must be of the very same build.

use defmt_decoder::{DecodeError, Frame, Location, StreamDecoder, Table};
use std::collections::BTreeMap;
use std::fmt;

/// Why the log cannot be read.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum MonitorError {
    /// The file holds no tables.
    #[error(
        "the image contains no texts of log messages{0}: build the image with `cargo xtask firmware`, or name another image with \
         --elf"
    )]
    NoTable(String),
}

/// The texts of an image's log lines.
#[derive(Debug)]
pub struct LogTable {
    table: Table,
    places: BTreeMap<u64, Location>,
}

impl LogTable {
    /// Takes them out of an ELF file.
    ///
    /// # Errors
    /// [`MonitorError::NoTable`].
    pub fn from_elf(elf: &[u8]) -> Result<Self, MonitorError> {
        let table = Table::parse(elf)
            .map_err(|error| MonitorError::NoTable(format!(" that this program can read ({error:#})")))?
            .filter(|table| !table.is_empty())
            .ok_or_else(|| MonitorError::NoTable(String::new()))?;
        // Without debug information lines have no place in the source, but are still readable.
        let places = table.get_locations(elf).unwrap_or_default();
        Ok(Self { table, places })
    }

    /// A decoder for one stream of frames.
    #[must_use]
    pub fn decoder(&self) -> LogDecoder<'_> {
        LogDecoder { stream: self.table.new_stream_decoder(), places: &self.places }
    }
}

/// One line of the log.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct LogLine {
    /// The board's time since its start, as it prints it (in s).
    pub uptime_s: Option<String>,
    /// `error`, `warn`, `info`, `debug` or `trace`.
    pub level: Option<&'static str>,
    /// The text.
    pub message: String,
    /// File and line in the firmware's source.
    pub place: Option<String>,
}

impl LogLine {
    fn damaged() -> Self {
        let message =
            "(a damaged log line: bytes were lost, or the board does not run the image with which the log is decoded)"
                .into();
        Self { uptime_s: None, level: None, message, place: None }
    }
}

impl fmt::Display for LogLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (uptime, level) = (self.uptime_s.as_deref().unwrap_or("-"), self.level.unwrap_or("-"));
        write!(f, "{uptime:>12} {level:5} {}", self.message)?;
        match &self.place {
            Some(place) => write!(f, "  [{place}]"),
            None => Ok(()),
        }
    }
}

/// Makes lines of bytes, however these were cut.
pub struct LogDecoder<'t> {
    stream: Box<dyn StreamDecoder + 't>,
    places: &'t BTreeMap<u64, Location>,
}

impl LogDecoder<'_> {
    /// Takes the next bytes of the stream and gives the lines that they complete to `line`.
    pub fn feed(&mut self, bytes: &[u8], mut line: impl FnMut(LogLine)) {
        self.stream.received(bytes);
        loop {
            match self.stream.decode() {
                Ok(frame) => line(format_frame(&frame, self.places)),
                Err(DecodeError::Malformed) => line(LogLine::damaged()),
                Err(DecodeError::UnexpectedEof) => return,
            }
        }
    }
}

fn format_frame(frame: &Frame<'_>, places: &BTreeMap<u64, Location>) -> LogLine {
    let place = places.get(&frame.index()).map(|place| {
        // From the crate's folder on: what is above it differs from machine to machine.
        let path = place.file.to_string_lossy().replace('\\', "/");
        let source = path.rfind("/src/").unwrap_or(0);
        let start = path.get(..source).and_then(|above| above.rfind('/')).map_or(0, |slash| slash + 1);
        let short = path.get(start..).unwrap_or(&path);
        format!("{short}:{}", place.line)
    });
    LogLine {
        uptime_s: frame.display_timestamp().map(|time| time.to_string()),
        level: frame.level().map(|level| level.as_str()),
        message: frame.display_message().to_string(),
        place,
    }
}
