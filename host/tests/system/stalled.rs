//! A machine that stands still for a while: the simulated device, which stands still with it, takes that for no silence of its host.

use crate::support::Daemon;
use crate::support::program::build_era_command;
use crate::{LONG_TOUCH, drive};
use serde_json::json;
use std::process::{Command, Stdio};
use std::time::Duration;

/// A daemon with its simulated device is stopped as a whole and goes on.
#[test]
fn a_stall_of_the_machine_is_no_silence_of_the_host() {
    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let mut command = build_era_command();
    command.args(["serve", "--listen", &free.to_string(), "--socket", "none", "--accuracy", "fast", "--device", "sim"]);
    let mut process = command.stderr(Stdio::null()).spawn().unwrap();
    let daemon = Daemon { url: format!("http://{free}"), sim: Default::default(), background: None };
    crate::wait_until("it serves", || Daemon::agent().get(format!("{}/v1/state", daemon.url)).call().is_ok());
    daemon.wait_for(|state| state["device"]["connected"] == true);
    drive(&daemon);
    let signal = |name: &str| Command::new("kill").args(["-s", name, &process.id().to_string()]).status().unwrap();
    for _ in 0..5 {
        signal("STOP");
        std::thread::sleep(Duration::from_millis(400));
        signal("CONT");
        std::thread::sleep(Duration::from_millis(100));
    }
    // The session may have ended the drive, as its answer was late; the board has no reason to.
    let state = daemon.wait_for(|state| state["device"]["connected"] == true);
    let driven = (0..200).any(|_| daemon.post("/v1/touch", LONG_TOUCH).0 == 200);
    let _ = process.kill();
    let _ = process.wait();
    assert_eq!((&state["device"]["fault"], &state["device"]["faults"]), (&json!(null), &json!(0)), "{state}");
    assert!(driven);
}
