//! What a service manager is told.
#![cfg(target_os = "linux")]

use crate::support::program::build_era_command;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// Ends the daemon whatever a test comes to.
struct Daemon(Child);

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// All that has been told by the time when `last` was.
fn until(socket: &UnixDatagram, last: &str, count: usize) -> Vec<String> {
    let (mut told, mut buffer): (Vec<String>, _) = (Vec::new(), [0; 4096]);
    while told.iter().filter(|line| *line == last).count() < count {
        let length = socket.recv(&mut buffer).unwrap_or_else(|error| panic!("{error} after {told:?}"));
        told.extend(std::str::from_utf8(&buffer[..length]).unwrap().lines().map(str::to_owned));
    }
    told
}

/// A socket as a service manager has it, in `folder`, and a daemon that is to notify it.
fn make_socket_and_serve_command_that_notifies_it(folder: &Path) -> (UnixDatagram, Command) {
    let path = folder.join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    // The first start computes a plan table.
    socket.set_read_timeout(Some(Duration::from_secs(120))).unwrap();
    let mut command = build_era_command();
    command.args(["serve", "--listen", "127.0.0.1:0", "--accuracy", "fast"]);
    command.env("NOTIFY_SOCKET", &path).stderr(Stdio::null());
    (socket, command)
}

#[test]
fn ready_alive_and_stopping_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let (socket, mut command) = make_socket_and_serve_command_that_notifies_it(folder.path());
    command.env("WATCHDOG_USEC", "400000");
    let mut daemon = Daemon(command.spawn().unwrap());
    let told = until(&socket, "READY=1", 1);
    assert!(told.iter().any(|line| line.starts_with("STATUS=serving on http://127.0.0.1:")), "{told:?}");
    assert!(!told.contains(&"WATCHDOG=1".to_owned()), "{told:?}");
    // For as long as it lives.
    until(&socket, "WATCHDOG=1", 6);
    let id = daemon.0.id().to_string();
    assert!(Command::new("kill").args(["-s", "TERM", &id]).status().unwrap().success());
    until(&socket, "STOPPING=1", 1);
    assert!(daemon.0.wait().unwrap().success());
}

/// No watchdog is asked for, or that of another process.
#[test]
fn nobody_who_did_not_ask_is_told_of_life() {
    let folder = tempfile::tempdir().unwrap();
    let (socket, mut command) = make_socket_and_serve_command_that_notifies_it(folder.path());
    command.env("WATCHDOG_USEC", "20000").env("WATCHDOG_PID", "1");
    let _daemon = Daemon(command.spawn().unwrap());
    until(&socket, "READY=1", 1);
    socket.set_read_timeout(Some(Duration::from_millis(300))).unwrap();
    assert!(socket.recv(&mut [0; 64]).is_err());
}
