//! What surrounds the daemon where it is in daily use: completions, man pages, logs, the service manager.

mod config;
mod install;
mod logs;
mod manual;
mod notify;

use std::process::{Command, Output};

/// The program, away from the settings of whoever runs the tests.
fn make_era_command() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_era"));
    command.env("ERA_CACHE_DIR", env!("CARGO_TARGET_TMPDIR"));
    for variable in ["ERA_LOG", "NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"] {
        command.env_remove(variable);
    }
    command
}

fn run_era(arguments: &[&str]) -> Output {
    make_era_command().args(arguments).output().unwrap()
}

fn decode_utf8(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}
