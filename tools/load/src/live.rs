//! The live socket's other end.

use crate::http::connect_tcp;
use serde_json::Value;
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};
use tungstenite::protocol::{CloseFrame, Role};
use tungstenite::{Message, WebSocket};

/// A live socket.
#[derive(Debug)]
pub struct Live(WebSocket<TcpStream>);

impl Live {
    /// Opens one that is told what `message_kinds` names.
    ///
    /// # Errors
    /// What went wrong, for people.
    pub fn open(address: SocketAddr, message_kinds: &str) -> Result<Self, String> {
        let stream = connect_tcp(address).map_err(|error| error.to_string())?;
        let (socket, _) = tungstenite::client(format!("ws://{address}/v1/live?send={message_kinds}"), stream)
            .map_err(|error| error.to_string())?;
        Ok(Self(socket))
    }

    /// The same socket for a thread that only says something, while this one is read.
    ///
    /// # Errors
    /// What went wrong, for people.
    pub fn clone_writer(&self) -> Result<Self, String> {
        let stream = self.0.get_ref().try_clone().map_err(|error| error.to_string())?;
        Ok(Self(WebSocket::from_raw_socket(stream, Role::Client, None)))
    }

    /// Says something.
    ///
    /// # Errors
    /// What went wrong, for people.
    pub fn send(&mut self, message: &Value) -> Result<(), String> {
        self.send_text(&message.to_string())
    }

    /// Says something that need not be JSON.
    ///
    /// # Errors
    /// What went wrong, for people.
    pub fn send_text(&mut self, message: &str) -> Result<(), String> {
        self.0.send(Message::text(message)).map_err(|error| error.to_string())
    }

    /// Waits for what the daemon says next; `null` is a sign of life.
    ///
    /// # Errors
    /// What went wrong, for people: nothing came for a while, or the socket is closed.
    pub fn read(&mut self) -> Result<Value, String> {
        match self.0.read().map_err(|error| error.to_string())? {
            Message::Text(text) => serde_json::from_str(&text).map_err(|error| error.to_string()),
            Message::Close(frame) => Err(describe_close(frame.as_ref())),
            _ => Ok(Value::Null),
        }
    }

    /// What the daemon says next, if that comes in time.
    ///
    /// # Errors
    /// What went wrong, for people.
    pub fn read_next_json_message_until_none_if_late_or_not_text(
        &mut self,
        until: Instant,
    ) -> Result<Option<Value>, String> {
        use std::io::ErrorKind::{TimedOut, WouldBlock};
        let left = until.saturating_duration_since(Instant::now());
        // None at all would mean no end.
        let left = left.max(Duration::from_micros(1));
        self.0.get_ref().set_read_timeout(Some(left)).map_err(|error| error.to_string())?;
        match self.0.read() {
            Ok(Message::Text(text)) => serde_json::from_str(&text).map(Some).map_err(|error| error.to_string()),
            Ok(Message::Close(frame)) => Err(describe_close(frame.as_ref())),
            Ok(_) => Ok(None),
            Err(tungstenite::Error::Io(error)) if matches!(error.kind(), TimedOut | WouldBlock) => Ok(None),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Whether the daemon has ended it, read until nothing comes for `quiet`, but no longer than for `max_messages` messages.
    pub fn is_closed_by_daemon_reading_until_quiet(&mut self, quiet: Duration, max_messages: usize) -> bool {
        // A socket that cannot be set up is none.
        if self.0.get_ref().set_read_timeout(Some(quiet)).is_err() {
            return true;
        }
        for _ in 0..max_messages {
            match self.0.read() {
                Ok(Message::Close(_)) => return true,
                Ok(_) => {}
                Err(tungstenite::Error::Io(error)) => {
                    use std::io::ErrorKind::{TimedOut, WouldBlock};
                    return !matches!(error.kind(), TimedOut | WouldBlock);
                }
                Err(_) => return true,
            }
        }
        false
    }
}

fn describe_close(frame: Option<&CloseFrame>) -> String {
    let reason = frame.map_or_else(|| "without a reason".into(), |frame| format!("with {frame}"));
    format!("the daemon has closed the socket {reason}")
}
