//! The emulator bridge as a child process: started, asked, ended.

use crate::error::Error;
use crate::process::format_command;
use crate::repository_root;
use serde::Deserialize;
use serde_json::{Value, json};
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::thread;

/// How emulated time passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// With the clock on the wall.
    Wall,
    /// Only when told to.
    Paused,
}

/// The running bridge. It ends when this is dropped, as its standard input then closes.
pub struct Bridge {
    child: Child,
    commands: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
    terminal: PathBuf,
}

/// Times since the board was powered up.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct TimesSincePowerUp {
    /// Emulated, in s.
    pub virtual_s: f64,
    /// Emulated, in clocks of 170 MHz.
    pub clock: u64,
    /// On the wall, in s.
    pub wall_s: f64,
}

impl Bridge {
    /// Starts the bridge with an image and waits until the firmware is up.
    ///
    /// # Errors
    /// [`Error::Start`] or [`Error::Bridge`].
    pub fn start(image: &Path, pace: Pace) -> Result<Self, Error> {
        let mut python = Command::new("python3");
        python.arg(repository_root()?.join("tools/emulator/launch.py")).arg("--elf").arg(image);
        if pace == Pace::Paused {
            python.arg("--paused");
        }
        python.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = python.spawn().map_err(|source| Error::Start { command: format_command(&python), source })?;
        let (Some(commands), Some(answers)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(Error::Bridge("has no standard input and output".to_owned()));
        };
        let mut bridge =
            Self { child, commands: Some(commands), answers: BufReader::new(answers), terminal: PathBuf::new() };
        let ready = bridge.read_json_line()?;
        bridge.terminal = ready["pty"].as_str().unwrap_or_default().into();
        Ok(bridge)
    }

    /// The pseudo-terminal of the board's UART.
    pub fn terminal_path(&self) -> &Path {
        &self.terminal
    }

    /// One command (see `tools/emulator/bridge.py`) and its answer.
    ///
    /// # Errors
    /// [`Error::Bridge`] if the bridge refuses or has ended.
    pub fn send_command(&mut self, command: &Value) -> Result<Value, Error> {
        let commands = self.commands.as_mut().ok_or_else(|| Error::Bridge("its input is closed".to_owned()))?;
        writeln!(commands, "{command}").map_err(|error| Error::Bridge(error.to_string()))?;
        let answer = self.read_json_line()?;
        if answer["ok"] == true {
            return Ok(answer);
        }
        Err(Error::Bridge(format!("{command}: {}", answer["error"].as_str().unwrap_or("no reason given"))))
    }

    /// As [`Self::send_command`], with the answer understood.
    ///
    /// # Errors
    /// [`Error::Bridge`], also if the answer is another one.
    pub fn send_command_and_parse<T: for<'de> Deserialize<'de>>(&mut self, command: &Value) -> Result<T, Error> {
        let answer = self.send_command(command)?;
        serde_json::from_value(answer).map_err(|error| Error::Bridge(format!("{command}: {error}")))
    }

    /// The time.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn read_emulated_and_wall_times(&mut self) -> Result<TimesSincePowerUp, Error> {
        self.send_command_and_parse(&json!({"op": "time"}))
    }

    fn read_json_line(&mut self) -> Result<Value, Error> {
        let mut line = String::new();
        match self.answers.read_line(&mut line) {
            Ok(0) => Err(Error::Bridge("ended without an answer; its messages are above".to_owned())),
            Ok(_) => serde_json::from_str(&line).map_err(|error| Error::Bridge(format!("{error} in {line}"))),
            Err(error) => Err(Error::Bridge(error.to_string())),
        }
    }

    /// Connects the bridge's control channel with this program's input and output until the input ends.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn connect_control_channel_to_standard_io(mut self) -> Result<(), Error> {
        if let Some(mut commands) = self.commands.take() {
            // Not joined: it may wait for a key for ever, and ends with the program.
            thread::spawn(move || io::copy(&mut io::stdin().lock(), &mut commands));
        }
        io::copy(&mut self.answers, &mut io::stdout().lock()).map_err(|error| Error::Bridge(error.to_string()))?;
        Ok(())
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        drop(self.commands.take());
        // It ends by itself now; waiting keeps it from becoming a zombie.
        let _ = self.child.wait();
    }
}
