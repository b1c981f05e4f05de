//! What surrounds the daemon where it is in daily use: completions, man pages, logs, the service manager.

mod config;
mod install;
mod logs;
mod manual;
mod notify;

use std::process::{Command, Output};

/// The program, away from the settings of whoever runs the tests.
fn era() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_era"));
    command.env("ERA_CACHE_DIR", env!("CARGO_TARGET_TMPDIR"));
    for variable in ["ERA_LOG", "NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"] {
        command.env_remove(variable);
    }
    command
}

fn run(arguments: &[&str]) -> Output {
    era().args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}
