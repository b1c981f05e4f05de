//! The program `era` as the tests start it: the settings of whoever runs the tests do not reach it.

use serde_json::Value;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The file of the program, for command lines that start it through another program.
pub const ERA: &str = env!("CARGO_BIN_EXE_era");

/// Variables from which libraries take a proxy (curl, Python's urllib and websockets, ureq).
pub const PROXY_VARIABLES: [&str; 6] =
    ["http_proxy", "HTTP_PROXY", "https_proxy", "HTTPS_PROXY", "all_proxy", "ALL_PROXY"];

/// All other variables that change what the program does or prints (docs/src/network.md), and what makes some libraries leave a proxy. `HOME`
/// and `TMPDIR` stay, and so does what says how many processors are used.
const OTHER_VARIABLES: [&str; 18] = [
    "CLICOLOR",
    "CLICOLOR_FORCE",
    "COLUMNS",
    "CREDENTIALS_DIRECTORY",
    "ERA_FIRMWARE",
    "ERA_LOG",
    "ERA_SOURCE",
    "ERA_TOKEN",
    "LINES",
    "NOTIFY_SOCKET",
    "NO_COLOR",
    "NO_PROXY",
    "WATCHDOG_PID",
    "WATCHDOG_USEC",
    "XDG_CACHE_HOME",
    "XDG_CONFIG_HOME",
    "XDG_RUNTIME_DIR",
    "no_proxy",
];

/// How a run of the program has ended, and what it has printed.
#[derive(Debug)]
pub struct ProgramOutput {
    /// Its exit code; `None` if a signal has ended it.
    pub code: Option<i32>,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub error: String,
}

impl ProgramOutput {
    pub fn is_success(&self) -> bool {
        self.code == Some(0)
    }

    /// Standard output as JSON, whatever the exit code is.
    #[track_caller]
    pub fn parse_json(&self) -> Value {
        serde_json::from_str(&self.out).unwrap_or_else(|error| panic!("{error}: {}{}", self.out, self.error))
    }
}

impl From<Output> for ProgramOutput {
    fn from(output: Output) -> Self {
        let [out, error] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
        Self { code: output.status.code(), out, error }
    }
}

/// A command for the program. Tests of what a variable does set this variable on it.
pub fn build_era_command() -> Command {
    build_isolated_command(ERA)
}

/// A command for another program that starts `era`, which gets the environment of [`build_era_command`].
pub fn build_isolated_command(program: impl AsRef<OsStr>) -> Command {
    let mut command = Command::new(program);
    // A cache that is there, so that tables are not computed over and over.
    command.env("ERA_CACHE_DIR", env!("CARGO_TARGET_TMPDIR"));
    for variable in OTHER_VARIABLES.iter().chain(&PROXY_VARIABLES) {
        command.env_remove(variable);
    }
    command
}

/// Runs a command to its end.
#[track_caller]
pub fn run_command(command: &mut Command) -> ProgramOutput {
    command.output().unwrap().into()
}

/// Runs the program with these arguments.
#[track_caller]
pub fn run_era(arguments: &[&str]) -> ProgramOutput {
    run_command(build_era_command().args(arguments))
}

/// Runs the program with these arguments, which succeeds; what it prints is JSON.
#[track_caller]
pub fn run_era_json(arguments: &[&str]) -> Value {
    let output = run_era(arguments);
    assert!(output.is_success(), "{arguments:?}: {}", output.error);
    output.parse_json()
}

/// The path of a file in the folder where tests may write.
pub fn make_scratch_path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
}
