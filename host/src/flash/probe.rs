//! A debug probe, through the program `probe-rs`, if it is installed.

use crate::private_file::TOKEN_VARIABLE;
use era_shared::image::{CHIP_STM32G474, HEADER_LENGTH, HEADER_OFFSET, IMAGE_START, ImageHeader};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Output, Stdio};
use std::sync::mpsc::sync_channel;
use std::time::Duration;

/// The chip by the name that probe-rs gives it.
pub const CHIP: &str = "STM32G474RETx";
/// DBGMCU_IDCODE, whose low 12 bits are DEV_ID (RM0440, section 47.6.1).
const IDCODE: u32 = 0xE004_2000;
const DEV_ID: u32 = 0xFFF;

/// The chip's unique identifier, 96 bits (RM0440, section 48.1).
const UNIQUE_ID: u32 = 0x1FFF_7590;

/// Longest time in which the program lists probes or reads some bytes, which takes a second or two.
const READ_LIMIT: Duration = Duration::from_secs(30);

/// Why the probe did not do it.
#[derive(Debug, thiserror::Error)]
pub enum ProbeError {
    /// The program is missing.
    #[error("probe-rs is not installed ({0}). Install probe-rs as described at https://probe.rs, or use --dfu")]
    NotInstalled(std::io::Error),
    /// No probe.
    #[error("probe-rs finds no debug probe. Connect a probe and check that this user may use the probe, or use --dfu")]
    NoProbe,
    /// It failed, and has said why.
    #[error(
        "{command} failed ({status}){}{}. To repair an interrupted update, run the same `era` command again",
        if .said.is_empty() { "" } else { ": " },
        .said
    )]
    Failed {
        /// What was run.
        command: String,
        /// How it ended.
        status: ExitStatus,
        /// What it wrote to standard error, where that was not shown.
        said: String,
    },
    /// It does not end.
    #[error(
        "{command} did not end within {limit:?}, so the program stopped this command. Disconnect the probe, connect \
         it again, and run the same `era` command again"
    )]
    Late {
        /// What was run.
        command: String,
        /// How long it may take.
        limit: Duration,
    },
    /// Another chip, or an answer that cannot be understood.
    #[error(
        "the chip that is connected to the probe has the device ID {found}, but an STM32G474 has {CHIP_STM32G474:#05x}: nothing was changed"
    )]
    OtherChip {
        /// As read.
        found: String,
    },
}

/// `probe-rs`. Which probe it uses, where there are several, the variable `PROBE_RS_PROBE` says.
#[derive(Clone, Debug)]
pub struct ProbeRs {
    program: PathBuf,
    /// For what shows nothing while it runs.
    limit: Duration,
}

impl Default for ProbeRs {
    fn default() -> Self {
        Self::new("probe-rs")
    }
}

impl ProbeRs {
    /// The program under another name or path.
    pub fn new(program: impl Into<PathBuf>) -> Self {
        Self { program: program.into(), limit: READ_LIMIT }
    }

    /// The same with another limit for what shows nothing while it runs.
    #[must_use]
    pub fn with_time_limit(self, limit: Duration) -> Self {
        Self { limit, ..self }
    }

    /// Finds a probe.
    ///
    /// # Errors
    /// [`ProbeError::NotInstalled`], [`ProbeError::NoProbe`], [`ProbeError::Failed`].
    pub fn check_probe_connected(&self) -> Result<(), ProbeError> {
        let listed = self.run_and_capture_output(Command::new(&self.program).arg("list"))?;
        // One line for each, as `[0]: STLink V3 -- 0483:374e:... (ST-LINK)`.
        if listed.lines().any(|line| line.trim_start().starts_with('[')) { Ok(()) } else { Err(ProbeError::NoProbe) }
    }

    /// Checks that the chip is the right one.
    ///
    /// # Errors
    /// [`ProbeError::OtherChip`] and those of running the program.
    pub fn check_chip(&self) -> Result<(), ProbeError> {
        let answer = self.read_memory_as_text("b32", IDCODE, 1)?;
        let code = answer.split_whitespace().last().and_then(|word| u32::from_str_radix(word, 16).ok());
        match code.map(|code| code & DEV_ID) {
            Some(id) if id == u32::from(CHIP_STM32G474) => Ok(()),
            Some(id) => Err(ProbeError::OtherChip { found: format!("{id:#05x}") }),
            None => Err(ProbeError::OtherChip { found: format!("{:?}", answer.trim()) }),
        }
    }

    /// The header of the image on the board, if there is one.
    ///
    /// # Errors
    /// Those of running the program.
    pub fn read_header_on_board(&self) -> Result<Option<ImageHeader>, ProbeError> {
        let bytes = self.read_bytes(IMAGE_START + HEADER_OFFSET, HEADER_LENGTH)?;
        Ok(ImageHeader::parse(&bytes).ok())
    }

    /// The chip's unique identifier, which a board's hello also tells.
    ///
    /// # Errors
    /// Those of running the program.
    pub fn read_board_id(&self) -> Result<Vec<u8>, ProbeError> {
        self.read_bytes(UNIQUE_ID, 12)
    }

    /// Writes, reads back and starts the image; shows the program's own progress on standard error.
    ///
    /// # Errors
    /// Those of running the program.
    pub fn write_and_start_image(&self, image: &Path) -> Result<(), ProbeError> {
        let download = ["download", "--chip", CHIP, "--verify"];
        self.run_showing_output(Command::new(&self.program).args(download).arg(image).stdout(std::io::stderr()))?;
        self.run_showing_output(Command::new(&self.program).args(["reset", "--chip", CHIP]).stdout(std::io::stderr()))
    }

    /// Shows the log until interrupted, without stopping the board.
    ///
    /// # Errors
    /// Those of running the program.
    pub fn show_log_until_interrupted(&self, image: &Path) -> Result<(), ProbeError> {
        self.run_showing_output(Command::new(&self.program).args(["attach", "--chip", CHIP]).arg(image))
    }

    fn read_bytes(&self, address: u32, count: usize) -> Result<Vec<u8>, ProbeError> {
        let answer = self.read_memory_as_text("b8", address, count)?;
        Ok(answer.split_whitespace().filter_map(|word| u8::from_str_radix(word, 16).ok()).collect())
    }

    fn read_memory_as_text(&self, width: &str, address: u32, count: usize) -> Result<String, ProbeError> {
        let (address, count) = (format!("{address:#010x}"), count.to_string());
        self.run_and_capture_output(Command::new(&self.program).args(["read", "--chip", CHIP, width, &address, &count]))
    }

    fn run_and_capture_output(&self, command: &mut Command) -> Result<String, ProbeError> {
        command.env_remove(TOKEN_VARIABLE).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let child = command.spawn().map_err(ProbeError::NotInstalled)?;
        let (id, (sender, ended)) = (child.id(), sync_channel(1));
        let waiting = std::thread::Builder::new().spawn(move || sender.send(child.wait_with_output()));
        waiting.map_err(ProbeError::NotInstalled)?;
        let Ok(output) = ended.recv_timeout(self.limit) else {
            end_program(id);
            return Err(ProbeError::Late { command: format_command(command), limit: self.limit });
        };
        let Output { status, stdout, stderr } = output.map_err(ProbeError::NotInstalled)?;
        if status.success() {
            return Ok(String::from_utf8_lossy(&stdout).into_owned());
        }
        let said = String::from_utf8_lossy(&stderr).trim().to_owned();
        Err(ProbeError::Failed { command: format_command(command), status, said })
    }

    fn run_showing_output(&self, command: &mut Command) -> Result<(), ProbeError> {
        let status = command.env_remove(TOKEN_VARIABLE).status().map_err(ProbeError::NotInstalled)?;
        if status.success() {
            return Ok(());
        }
        Err(ProbeError::Failed { command: format_command(command), status, said: String::new() })
    }
}

/// Ends a program that has not ended by itself.
fn end_program(id: u32) {
    #[cfg(unix)]
    if let Some(process) = i32::try_from(id).ok().and_then(rustix::process::Pid::from_raw) {
        // It may have ended meanwhile.
        let _ = rustix::process::kill_process(process, rustix::process::Signal::KILL);
    }
    #[cfg(not(unix))]
    let _ = id;
}

fn format_command(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}
