//! Why a port cannot be used, and what to do about it.

use super::users::{PortDenial, PortUsers};
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
    #[error("the port {path} is in use{}", .users.clause_naming_users_or_unknown_program_and_advice_to_end_it())]
    Busy {
        /// The port.
        path: String,
        /// Who has it open.
        users: PortUsers,
    },
    /// The system does not let this user open it.
    #[error("{}", .denial.explain_denial_and_advise(.path))]
    Denied {
        /// The port.
        path: String,
        /// Why this user may not.
        denial: PortDenial,
    },
    /// A call has not returned.
    #[error("the call `{call}` on the port {path} did not return within {waited:.1?}{}", .users.sentence_about_visible_or_hidden_users_of_faulty_port_or_empty())]
    Late {
        /// The port.
        path: String,
        /// The call, by its name in the manual.
        call: &'static str,
        /// How long was waited.
        waited: Duration,
        /// Who else has it open.
        users: PortUsers,
    },
    /// A file of another kind.
    #[error("{path} is not a serial port: name the board's serial port, or auto")]
    NoPort {
        /// The file.
        path: String,
    },
    /// Anything else.
    #[error("the call `{call}` on the port {path} failed: {source}{}", cable_advice_if_board_has_gone(.source))]
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
    /// The error of a call of the system on the port at `path`.
    #[must_use]
    pub fn from_call_error(path: &str, call: &'static str, source: io::Error) -> Self {
        let path = path.to_owned();
        match source.kind() {
            io::ErrorKind::NotFound => Self::Missing { path },
            io::ErrorKind::PermissionDenied => {
                let denial = PortDenial::look_up_port_group_and_current_user(&path);
                Self::Denied { path, denial }
            }
            // TIOCEXCL of whoever has it open, or its lock.
            io::ErrorKind::ResourceBusy | io::ErrorKind::WouldBlock => {
                let users = PortUsers::find_for_port(&path);
                Self::Busy { path, users }
            }
            io::ErrorKind::IsADirectory => Self::NoPort { path },
            _ if source.raw_os_error() == Some(rustix::io::Errno::NOTTY.raw_os_error()) => Self::NoPort { path },
            _ => Self::Failed { path, call, source },
        }
    }
}

/// The sentence after an error of a call: what the system says of a board that has gone is about its cable, and nothing else is.
fn cable_advice_if_board_has_gone(error: &io::Error) -> &'static str {
    let is_gone = |errno: rustix::io::Errno| error.raw_os_error() == Some(errno.raw_os_error());
    if [rustix::io::Errno::IO, rustix::io::Errno::NXIO, rustix::io::Errno::NODEV].into_iter().any(is_gone) {
        ". Check the cable and the power of the board"
    } else {
        ""
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::io::Errno;

    #[test]
    fn only_what_is_said_of_a_board_that_has_gone_sends_to_its_cable() {
        for (error, is_gone) in
            [(Errno::IO, true), (Errno::NXIO, true), (Errno::NODEV, true), (Errno::MFILE, false), (Errno::NOMEM, false)]
        {
            let told = PortError::from_call_error("/dev/ttyACM0", "open", error.into()).to_string();
            assert_eq!(told.contains("cable"), is_gone, "{told}");
        }
    }
}
