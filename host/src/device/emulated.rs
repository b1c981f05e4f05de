//! The firmware image on the emulated board: a child process that bridges its UART to a pseudo-terminal.

use super::timing::{LinkTiming, RetryPolicy};
use crate::private_file::TOKEN_VARIABLE;
use era_shared::waveform::TimerRegisters;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Where the source was when this program was built; the emulator and the firmware are built and run from it.
const BUILT_IN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
/// Timers of the board's channels, in order.
pub const CHANNEL_TIMERS: [&str; 4] = ["TIM1", "TIM8", "TIM20", "TIM4"];
/// BDTR.MOE, which TIM4 has not.
const MAIN_OUTPUT: u32 = 1 << 15;

/// The step that builds the firmware, in messages.
const BUILDING: &str = "building the firmware (cargo xtask firmware)";

/// Emulated time may run ten times slower than real time on a busy machine, so its host waits longer; the board's
/// dead-man timer runs in its own time, and a sign of life every 50 ms keeps it content either way.
const TIMING: LinkTiming = LinkTiming {
    retry_policy: RetryPolicy {
        stop: Duration::from_secs(5),
        ..RetryPolicy::with_three_tries_of_constant_timeout(Duration::from_secs(5))
    },
    keep_alive: Duration::from_millis(50),
    status: Duration::from_millis(250),
    arming: Duration::from_secs(15),
};

/// Why the emulated board did not start or answer.
#[derive(Debug, thiserror::Error)]
pub enum EmulatedError {
    /// Not run from a checkout.
    #[error(
        "the emulated board needs the project's source: {path} is missing; set ERA_SOURCE to a checkout of the project"
    )]
    NoSource {
        /// What was looked for.
        path: PathBuf,
    },
    /// A step failed.
    #[error("the emulated board did not start, because {step} failed: {reason}")]
    Start {
        /// What was tried.
        step: &'static str,
        /// What happened.
        reason: String,
    },
    /// The bridge refused or broke off.
    #[error("the emulator did not carry out {op}: {reason}")]
    Control {
        /// What was asked.
        op: String,
        /// What happened.
        reason: String,
    },
}

/// A running emulated board; it ends when this is dropped.
#[derive(Debug)]
pub struct EmulatedBoard {
    path: String,
    elf: PathBuf,
    child: Child,
    control: Mutex<BridgePipes>,
}

#[derive(Debug)]
struct BridgePipes {
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl EmulatedBoard {
    /// Builds the firmware if need be and starts it in the emulator.
    ///
    /// # Errors
    /// [`EmulatedError`].
    pub fn find_or_build_firmware_and_start_emulator() -> Result<Self, EmulatedError> {
        let elf = find_firmware_in_environment_or_build(&find_source_root_in_environment_or_compiled_in_path()?)?;
        Self::start_image(elf)
    }

    /// The exit status of the board's process, if it has ended.
    pub fn exit_status_if_ended(&mut self) -> Option<String> {
        self.child.try_wait().ok().flatten().map(|status| status.to_string())
    }

    /// Starts a new emulator with the same image.
    ///
    /// # Errors
    /// [`EmulatedError`].
    pub fn start_another_with_same_image(&self) -> Result<Self, EmulatedError> {
        Self::start_image(self.elf.clone())
    }

    fn start_image(elf: PathBuf) -> Result<Self, EmulatedError> {
        let source = find_source_root_in_environment_or_compiled_in_path()?;
        tracing::info!("starting {} in the emulator", elf.display());
        let mut child = Command::new("python3")
            .arg(source.join("tools/emulator/launch.py"))
            .arg("--elf")
            .arg(&elf)
            .env_remove(TOKEN_VARIABLE)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| make_start_error("running python3 with tools/emulator/launch.py", error))?;
        let streams = child.stdin.take().zip(child.stdout.take());
        let (input, output) =
            streams.ok_or_else(|| make_start_error("opening the pipes of the emulator", "the pipes are missing"))?;
        let mut control = BridgePipes { input, output: BufReader::new(output) };
        let path = control.read_json_line().and_then(|first| match first["pty"].as_str() {
            Some(path) => Ok(path.to_owned()),
            None => Err(format!("the first line of the emulator's output, {first}, has no key \"pty\"")),
        });
        match path {
            Ok(path) => Ok(Self { path, elf, child, control: Mutex::new(control) }),
            Err(reason) => {
                let _ = child.kill();
                let _ = child.wait();
                Err(make_start_error("reading the first line that the emulator prints", reason))
            }
        }
    }

    /// Path of the serial port to open.
    #[must_use]
    pub fn port_path(&self) -> &str {
        &self.path
    }

    /// How long to wait for it.
    #[must_use]
    pub const fn timing(&self) -> LinkTiming {
        TIMING
    }

    /// The registers of the channels' timers, as they are now. TIM4 has no main output enable: whether its outputs reach
    /// the electrodes is up to the pins, and is told in its BDTR.
    ///
    /// # Errors
    /// [`EmulatedError::Control`].
    pub fn read_channel_timers_with_main_output_bit_masked_by_pins(
        &self,
    ) -> Result<Vec<TimerRegisters>, EmulatedError> {
        let answer = self.send_bridge_command_and_await_answer(&json!({"op": "timers"}))?;
        let pins = self.send_bridge_command_and_await_answer(&json!({"op": "pins"}))?;
        (1..)
            .zip(CHANNEL_TIMERS)
            .map(|(era, name)| {
                let register = |key: &str| {
                    let value = answer["timers"][name][key].as_u64().and_then(|value| u32::try_from(value).ok());
                    value.ok_or_else(|| EmulatedError::Control {
                        op: "timers".into(),
                        reason: format!(
                            "the answer has no 32-bit number for the register {key} of the timer {name}. The answer \
                             is {answer}"
                        ),
                    })
                };
                let at_pins = ["a", "b"].iter().any(|side| pins["pins"][format!("era{era}_{side}")]["mode"] == "timer");
                let pins_open = if at_pins { MAIN_OUTPUT } else { 0 };
                Ok(TimerRegisters {
                    cr1: register("cr1")?,
                    ccmr1: register("ccmr1")?,
                    ccmr2: register("ccmr2")?,
                    ccer: register("ccer")?,
                    psc: register("psc")?,
                    arr: register("arr")?,
                    ccr: [register("ccr1")?, register("ccr2")?, register("ccr3")?, register("ccr4")?],
                    bdtr: if name == "TIM4" { pins_open } else { register("bdtr")? & !(MAIN_OUTPUT ^ pins_open) },
                })
            })
            .collect()
    }

    /// Sends one command to the bridge (see `tools/emulator/bridge.py`) and returns its answer.
    ///
    /// # Errors
    /// [`EmulatedError::Control`].
    pub fn send_bridge_command_and_await_answer(&self, command: &Value) -> Result<Value, EmulatedError> {
        let op = command["op"].as_str().unwrap_or_default().to_owned();
        let mut control = self.control.lock().unwrap_or_else(PoisonError::into_inner);
        let failed = |reason: String| EmulatedError::Control { op: op.clone(), reason };
        writeln!(control.input, "{command}").and_then(|()| control.input.flush()).map_err(|e| failed(e.to_string()))?;
        let answer = control.read_json_line().map_err(failed)?;
        if answer["ok"] == true {
            return Ok(answer);
        }
        Err(failed(answer["error"].as_str().unwrap_or("the emulator gave no reason").to_owned()))
    }
}

impl Drop for EmulatedBoard {
    fn drop(&mut self) {
        // The bridge ends with its input; killing it makes sure of it.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl BridgePipes {
    fn read_json_line(&mut self) -> Result<Value, String> {
        let mut line = String::new();
        match self.output.read_line(&mut line) {
            Ok(0) => Err("the process of the emulator ended; its standard error has the reason".into()),
            Ok(_) => serde_json::from_str(&line).map_err(|error| format!("{error} in {line:?}")),
            Err(error) => Err(error.to_string()),
        }
    }
}

fn find_source_root_in_environment_or_compiled_in_path() -> Result<PathBuf, EmulatedError> {
    let root = std::env::var_os("ERA_SOURCE").map_or_else(|| PathBuf::from(BUILT_IN), PathBuf::from);
    let needed = root.join("tools/emulator/launch.py");
    if needed.exists() { Ok(root) } else { Err(EmulatedError::NoSource { path: needed }) }
}

/// The image to run: `ERA_FIRMWARE` if set, else built as for flashing.
fn find_firmware_in_environment_or_build(source: &Path) -> Result<PathBuf, EmulatedError> {
    if let Some(path) = std::env::var_os("ERA_FIRMWARE") {
        return Ok(path.into());
    }
    tracing::info!(
        "building the firmware and its build tool: this takes minutes at the first start, and seconds at later starts"
    );
    // Its input ends with this process, however that ends, and cargo with all that it started then does, too.
    let mut child = Command::new("python3")
        .arg(source.join("tools/emulator/leash.py"))
        .args(["cargo", "run", "--quiet", "--release", "--package", "xtask", "--", "firmware", "--print-path"])
        .current_dir(source)
        .env_remove(TOKEN_VARIABLE)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::inherit())
        .spawn()
        .map_err(|error| make_start_error(BUILDING, error))?;
    let leash = child.stdin.take();
    let output = child.wait_with_output().map_err(|error| make_start_error(BUILDING, error))?;
    drop(leash);
    let printed = String::from_utf8_lossy(&output.stdout);
    let path = printed.lines().last().map(str::trim).filter(|line| !line.is_empty());
    match path {
        Some(path) if output.status.success() => Ok(path.into()),
        _ => Err(make_start_error(BUILDING, output.status)),
    }
}

fn make_start_error(step: &'static str, reason: impl ToString) -> EmulatedError {
    EmulatedError::Start { step, reason: reason.to_string() }
}
