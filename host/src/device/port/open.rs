//! An open port. No call on it waits without a limit: reading and writing never block, and what else there is has a thread of its own that is
//! left behind where it does not return.

use super::call_limit::{CurrentCall, await_end_of_calls_on_port, run_port_calls_in_thread_abandoned_after_limit};
use super::error::PortError;
use era_shared::link::UART_BAUD;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{FlockOperation, Mode, OFlags, fcntl_setfl, flock, open};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{
    ControlModes, InputModes, OptionalActions, QueueSelector, Termios, ioctl_tiocexcl, ioctl_tiocnxcl, tcdrain,
    tcflush, tcgetattr, tcsetattr,
};
use std::io::{ErrorKind, Read, Write};
use std::os::fd::OwnedFd;
use std::sync::mpsc::sync_channel;
use std::time::Duration;

/// Time a read waits for its first byte, and a write for room.
const WAIT: Duration = Duration::from_millis(2);
/// After another program has taken what had come: it has a read under way, and the port is ready for a moment each time.
const TAKEN: Duration = Duration::from_millis(1);
/// How often a port that is not to be had is tried.
const OPEN_TRIES: u32 = 10;
/// How long between two tries.
const OPEN_AGAIN: Duration = Duration::from_millis(10);
/// Longest time for opening and setting a port: a board on USB takes some ms.
const OPEN_LIMIT: Duration = Duration::from_secs(1);
/// When a port is closed, longest time for its device to take what was written last: a stop, most often.
const SENT: Duration = Duration::from_millis(20);
/// Longest time for closing one.
const CLOSE_LIMIT: Duration = Duration::from_millis(250);

/// An open port that this program has for itself. What its device has not taken 20 ms after it is closed is dropped: the system would wait
/// for that, up to 30 s.
#[derive(Debug)]
pub struct SerialPort {
    path: String,
    /// `Some` until the port is closed.
    line: Option<OwnedFd>,
    wait: Duration,
}

impl SerialPort {
    /// Opens the port at a path: 115 200 baud, 8 bits, no parity, bytes as they are.
    ///
    /// # Errors
    /// [`PortError`]; [`PortError::Late`] where the system does not return within 1 s.
    pub fn open(path: &str) -> Result<Self, PortError> {
        await_end_of_calls_on_port(path, OPEN_LIMIT)?;
        let own = path.to_owned();
        let line = run_port_calls_in_thread_abandoned_after_limit(path, OPEN_LIMIT, move |step| {
            let mut tries = 1;
            loop {
                match open_exclusively_in_raw_mode_or_get_failed_call(&own, step) {
                    // Whoever has just closed the port may still hold its lock for a moment: a process that was being forked
                    // meanwhile keeps it until it runs its program.
                    Err((_, Errno::BUSY | Errno::WOULDBLOCK)) if tries < OPEN_TRIES => {
                        tries += 1;
                        std::thread::sleep(OPEN_AGAIN);
                    }
                    result => return result,
                }
            }
        })?;
        match line {
            Ok(line) => Ok(Self { path: path.to_owned(), line: Some(line), wait: WAIT }),
            Err((call, error)) => Err(PortError::from_call_error(path, call, error.into())),
        }
    }

    /// From now on a read waits this long for its first byte, and a write for room.
    pub const fn set_io_timeout(&mut self, timeout: Duration) {
        self.wait = timeout;
    }

    fn require_open_fd(&self) -> std::io::Result<&OwnedFd> {
        self.line.as_ref().ok_or_else(|| ErrorKind::NotConnected.into())
    }

    /// Waits until the port is ready to be read or written, and returns whether it is.
    fn wait_until_ready_or_timeout(&self, wanted_events: PollFlags) -> std::io::Result<bool> {
        let mut lines = [PollFd::new(self.require_open_fd()?, wanted_events)];
        let wait = Timespec::try_from(self.wait).map_err(std::io::Error::other)?;
        Ok(poll(&mut lines, Some(&wait))? > 0)
    }
}

/// A pseudo-terminal: the end of a device that this program plays, and the path at which its host opens the other end.
///
/// # Errors
/// If the system has none.
pub fn open_pseudo_terminal() -> std::io::Result<(SerialPort, String)> {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    grantpt(&master)?;
    unlockpt(&master)?;
    fcntl_setfl(&master, OFlags::NONBLOCK)?;
    let path = ptsname(&master, Vec::new())?.into_string().map_err(std::io::Error::other)?;
    // Bytes as they are from the first one on; the other end is for its host to open.
    let line = open(&path, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK, Mode::empty())?;
    let mut settings = tcgetattr(&line)?;
    set_raw_mode_and_board_baud_rate(&mut settings)?;
    tcsetattr(&line, OptionalActions::Now, &settings)?;
    Ok((SerialPort { path: format!("{path} (side of the device)"), line: Some(master), wait: WAIT }, path))
}

fn open_exclusively_in_raw_mode_or_get_failed_call(
    path: &str,
    current_call: &CurrentCall,
) -> Result<OwnedFd, (&'static str, Errno)> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let line =
        current_call.name_and_run_call("open", || open(path, flags, Mode::empty())).map_err(|error| ("open", error))?;
    // For others that open it, and for those that ask for the lock as programs for serial ports do.
    current_call.name_and_run_call("ioctl", || ioctl_tiocexcl(&line)).map_err(|error| ("ioctl", error))?;
    let lock = FlockOperation::NonBlockingLockExclusive;
    current_call.name_and_run_call("flock", || flock(&line, lock)).map_err(|error| ("flock", error))?;
    let mut settings =
        current_call.name_and_run_call("tcgetattr", || tcgetattr(&line)).map_err(|error| ("tcgetattr", error))?;
    set_raw_mode_and_board_baud_rate(&mut settings).map_err(|error| ("tcsetattr", error))?;
    current_call
        .name_and_run_call("tcsetattr", || tcsetattr(&line, OptionalActions::Now, &settings))
        .map_err(|error| ("tcsetattr", error))?;
    Ok(line)
}

/// Sets raw bytes at the board's speed, without modem control.
fn set_raw_mode_and_board_baud_rate(settings: &mut Termios) -> Result<(), Errno> {
    settings.make_raw();
    settings.input_modes.remove(InputModes::IXOFF | InputModes::IXANY);
    settings.control_modes.remove(ControlModes::CSTOPB | ControlModes::CRTSCTS | ControlModes::PARODD);
    settings.control_modes.insert(ControlModes::CREAD | ControlModes::CLOCAL);
    settings.set_speed(UART_BAUD)
}

/// Waits until the device has taken what was written to it, and drops what it has not taken within 20 ms.
fn drain_output_or_drop_it_after_20_ms(line: &OwnedFd, current_call: &CurrentCall) {
    std::thread::scope(|scope| {
        let (ended, ends) = sync_channel(1);
        let drain = move || {
            let _ = ended.send(tcdrain(line));
        };
        // Once there is nothing more to be sent that returns, and so this thread ends.
        let thread = std::thread::Builder::new().name("drain".into()).spawn_scoped(scope, drain);
        let sent = current_call
            .name_and_run_call("tcdrain", || thread.is_ok() && matches!(ends.recv_timeout(SENT), Ok(Ok(()))));
        if !sent {
            // A port that is gone has nothing to drop.
            let _ = current_call.name_and_run_call("tcflush", || tcflush(line, QueueSelector::OFlush));
        }
    });
}

impl Read for SerialPort {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        if !self.wait_until_ready_or_timeout(PollFlags::IN)? {
            return Err(ErrorKind::TimedOut.into());
        }
        match rustix::io::read(self.require_open_fd()?, buffer) {
            Err(Errno::AGAIN) => {
                std::thread::sleep(TAKEN);
                Err(ErrorKind::WouldBlock.into())
            }
            result => Ok(result?),
        }
    }
}

impl Write for SerialPort {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if !self.wait_until_ready_or_timeout(PollFlags::OUT)? {
            return Err(ErrorKind::TimedOut.into());
        }
        match rustix::io::write(self.require_open_fd()?, bytes) {
            Err(Errno::AGAIN) => {
                std::thread::sleep(TAKEN);
                Err(ErrorKind::WouldBlock.into())
            }
            result => Ok(result?),
        }
    }

    /// Nothing: `tcdrain` would wait without a limit for a device that takes nothing, and the system sends what it has anyway.
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Drop for SerialPort {
    fn drop(&mut self) {
        let Some(line) = self.line.take() else { return };
        let closed = run_port_calls_in_thread_abandoned_after_limit(&self.path, CLOSE_LIMIT, move |step| {
            drain_output_or_drop_it_after_20_ms(&line, step);
            // A port that is gone has nobody to keep away.
            let _ = step.name_and_run_call("ioctl", || ioctl_tiocnxcl(&line));
            step.name_and_run_call("close", || drop(line));
        });
        if let Err(error) = closed {
            tracing::warn!(%error, "cannot close a port; it stays open until the program ends");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A last stop is written before a port is closed, and nothing waits for its answer.
    #[test]
    fn what_was_written_last_is_sent_before_the_port_is_closed() {
        for _ in 0..100 {
            let (mut device, path) = open_pseudo_terminal().unwrap();
            let mut port = SerialPort::open(&path).unwrap();
            assert_eq!(port.write(b"stop").unwrap(), 4);
            drop(port);
            device.set_io_timeout(Duration::from_secs(1));
            let mut heard = [0; 8];
            let length = device.read(&mut heard).unwrap();
            assert_eq!(&heard[..length], b"stop");
        }
    }
}
