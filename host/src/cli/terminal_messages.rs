//! What is told on standard error beside the log: errors, and how far a command is; as text or as lines of JSON.

use super::standard_error;
use serde_json::json;
use std::ffi::OsString;
use std::sync::OnceLock;
use std::time::SystemTime;
use tracing_subscriber::fmt::time::{FormatTime, SystemTime as Clock};

/// How the log is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// Text for people
    #[default]
    Text,
    /// One JSON object per line, with timestamp, level, message and the fields of the event
    Json,
}

/// The format of this process; text until it is set.
static FORMAT: OnceLock<LogFormat> = OnceLock::new();

/// Sets the format of this process, once.
pub fn set_log_format(format: LogFormat) {
    let _ = FORMAT.set(format);
}

/// The format that a command line asks for which could not be read.
pub fn find_requested_log_format(arguments: impl Iterator<Item = OsString>) -> LogFormat {
    let words: Vec<OsString> = arguments.collect();
    let is_json = words.iter().any(|word| word == "--log-format=json")
        || words.windows(2).any(|pair| pair[0] == "--log-format" && pair[1] == "json");
    if is_json { LogFormat::Json } else { LogFormat::Text }
}

/// Whether standard error is lines of JSON.
pub fn is_log_json() -> bool {
    FORMAT.get() == Some(&LogFormat::Json)
}

/// Prints a text that is not part of the log, such as the progress of a command; takes the arguments of `println!`.
macro_rules! tell {
    ($($text:tt)*) => { $crate::cli::terminal_messages::tell_text_in_log_format(&format!($($text)*)) };
}
pub(super) use tell;

/// Tells a text that is no part of the log.
pub fn tell_text_in_log_format(text: &str) {
    write_message_line_as_error_if_prefix_given(FORMAT.get().copied().unwrap_or_default(), None, text);
}

/// Tells why a command ended.
pub fn tell_why_command_failed(text: &str) {
    write_message_line_as_error_if_prefix_given(FORMAT.get().copied().unwrap_or_default(), Some("error: "), text);
}

/// Tells why a command did not begin: nothing has been set yet.
pub fn tell_why_command_did_not_start(format: LogFormat, text: &str) {
    write_message_line_as_error_if_prefix_given(format, Some(""), text);
}

/// A line; `error_prefix` is what goes before an error where people read it. Where standard error is closed (`2>&1 | head`),
/// nobody is told.
fn write_message_line_as_error_if_prefix_given(format: LogFormat, error_prefix: Option<&str>, text: &str) {
    let line = match format {
        LogFormat::Text => format!("{}{text}\n", error_prefix.unwrap_or_default()),
        LogFormat::Json => {
            let level = if error_prefix.is_some() { "ERROR" } else { "INFO" };
            format!("{}\n", json!({"timestamp": format_timestamp(), "level": level, "message": text}))
        }
    };
    // After what has been logged, and before whatever writes there by itself.
    standard_error::queue_for_standard_error_or_drop_if_full(line.as_bytes());
    standard_error::wait_until_queue_is_written_or_timeout();
}

/// Now, as the log writes it.
fn format_timestamp() -> String {
    let mut text = String::new();
    if Clock.format_time(&mut tracing_subscriber::fmt::format::Writer::new(&mut text)).is_err() {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        text = since.as_secs().to_string();
    }
    text
}
