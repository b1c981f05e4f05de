//! Why a port cannot be used, and what to do about it.

use super::users::{Permission, Users};
use std::io;
use std::time::Duration;

/// Why a port cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// The list of USB ports does not have the board.
    #[error("{what} is connected. Check the cable and the power of the board")]
    NotConnected {
        /// "no ERA board", or which one.
        what: String,
    },
    /// There is no such file.
    #[error("there is no port {path}. Check the cable and the power of the board, or name another port")]
    Missing {
        /// The port.
        path: String,
    },
    /// Another program has the port for itself.
    #[error("the port {path} is in use{}", .users.as_advice())]
    Busy {
        /// The port.
        path: String,
        /// Who has it open.
        users: Users,
    },
    /// The system does not let this user open it.
    #[error("{}", .permission.as_advice(.path))]
    Denied {
        /// The port.
        path: String,
        /// Who may.
        permission: Permission,
    },
    /// A call has not returned.
    #[error("the call {call} on the port {path} has not returned for {waited:.1?}{}", .users.as_cause())]
    Late {
        /// The port.
        path: String,
        /// The call, by its name in the manual.
        call: &'static str,
        /// How long was waited.
        waited: Duration,
        /// Who else has it open.
        users: Users,
    },
    /// A file of another kind.
    #[error("{path} is no serial port: name the board's, or auto")]
    NoPort {
        /// The file.
        path: String,
    },
    /// Anything else.
    #[error("the call {call} on the port {path} failed: {source}. Check the cable and the power of the board")]
    Failed {
        /// The port.
        path: String,
        /// The call, by its name in the manual.
        call: &'static str,
        /// Why.
        source: io::Error,
    },
}

impl PortError {
    /// What a call's error means.
    #[must_use]
    pub fn of_call(path: &str, call: &'static str, source: io::Error) -> Self {
        let path = path.to_owned();
        match source.kind() {
            io::ErrorKind::NotFound => Self::Missing { path },
            io::ErrorKind::PermissionDenied => {
                let permission = Permission::of(&path);
                Self::Denied { path, permission }
            }
            // TIOCEXCL of whoever has it open, or its lock.
            io::ErrorKind::ResourceBusy | io::ErrorKind::WouldBlock => {
                let users = Users::of(&path);
                Self::Busy { path, users }
            }
            io::ErrorKind::IsADirectory => Self::NoPort { path },
            _ if source.raw_os_error() == Some(rustix::io::Errno::NOTTY.raw_os_error()) => Self::NoPort { path },
            _ => Self::Failed { path, call, source },
        }
    }
}
