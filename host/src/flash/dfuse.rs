//! The protocol of the ROM bootloader over USB: DFU 1.1 with ST's extensions (AN3156).
//!
//! Why not the crate dfu-core (0.11): it only downloads. It has no request to read the flash, with which `era flash` looks at the image on
//! the board before and at every byte after. It erases and writes an image in one sweep, so that a board could start half an image after an update
//! that was cut off ([`super::program`] writes the first double word last). Its errors name neither address nor remedy. Erasing and writing, which it could do, are 40 of these lines; it would add 2 crates.

use std::time::Duration;

/// Requests of DFU 1.1, section 3.
pub mod request {
    /// Data or a command to the device.
    pub const DNLOAD: u8 = 1;
    /// Data from the device.
    pub const UPLOAD: u8 = 2;
    /// Status; also what makes the device carry out a command.
    pub const GETSTATUS: u8 = 3;
    /// Out of the error state.
    pub const CLRSTATUS: u8 = 4;
    /// Back to idle.
    pub const ABORT: u8 = 6;
}

/// States of DFU 1.1, section 6.1.2.
pub mod state {
    /// Waits for anything.
    pub const IDLE: u8 = 2;
    /// Busy with what was sent.
    pub const DOWNLOAD_BUSY: u8 = 4;
    /// Done, waits for more.
    pub const DOWNLOAD_IDLE: u8 = 5;
    /// About to leave.
    pub const MANIFEST: u8 = 7;
    /// Sends data.
    pub const UPLOAD_IDLE: u8 = 9;
    /// Something went wrong.
    pub const ERROR: u8 = 10;
}

/// Commands of AN3156, section 5, as the first byte of block 0.
pub mod command {
    /// Set the address pointer.
    pub const SET_ADDRESS: u8 = 0x21;
    /// Erase the page that holds an address.
    pub const ERASE: u8 = 0x41;
}

/// Block number of data at the address pointer: data goes to `(block - 2) * transfer size` behind it.
pub const FIRST_DATA_BLOCK: u16 = 2;
/// Most bytes in one transfer (AN3156, section 4).
pub const TRANSFER_SIZE: usize = 2048;

/// Longest that one look at the status is put off, whatever the device asks for.
const LONGEST_POLL: Duration = Duration::from_secs(1);
/// Looks at the status before a command is given up. A page takes 24.5 ms at most (data sheet DS12288, table 52), and
/// the device asks for one pause for each.
const MOST_POLLS: u32 = 30;

/// Why a transfer failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PipeError {
    /// The device refuses the request.
    #[error("the bootloader refused the request")]
    Stall,
    /// The device has gone.
    #[error("the device is no longer connected")]
    Gone,
    /// Anything else, in the system's words.
    #[error("{0}")]
    Other(String),
}

/// Control transfers to the bootloader's DFU interface.
pub trait ControlPipe {
    /// Reads up to `length` bytes.
    ///
    /// # Errors
    /// [`PipeError`].
    fn control_in(&mut self, request: u8, value: u16, length: u16) -> Result<Vec<u8>, PipeError>;

    /// Writes.
    ///
    /// # Errors
    /// [`PipeError`].
    fn control_out(&mut self, request: u8, value: u16, data: &[u8]) -> Result<(), PipeError>;

    /// Waits.
    fn pause(&mut self, time: Duration);
}

/// Why the bootloader did not do what it was told.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DfuError {
    /// The transfer failed.
    #[error(
        "{step} at {address:#010x} failed: {source}. Check the USB cable, then run the same command again: the board \
         waits in its bootloader"
    )]
    Pipe {
        /// What was done.
        step: &'static str,
        /// Where.
        address: u32,
        /// What happened.
        source: PipeError,
    },
    /// The device reports an error.
    #[error(
        "{step} at {address:#010x} failed: the bootloader reported the status {status}: {}",
        describe_status(*.status)
    )]
    Status {
        /// What was done.
        step: &'static str,
        /// Where.
        address: u32,
        /// `bStatus` of DFU 1.1, section 6.1.2.
        status: u8,
    },
    /// It is in a state in which it should not be.
    #[error(
        "{step} at {address:#010x}: the bootloader is in the unexpected state {state}. Switch the power of the board \
         off and on, then run the same command again"
    )]
    State {
        /// What was done.
        step: &'static str,
        /// Where.
        address: u32,
        /// `bState` of DFU 1.1, section 6.1.2.
        state: u8,
    },
}

const fn describe_status(status: u8) -> &'static str {
    match status {
        1 => "the address is not in the flash of the board (errTARGET)",
        3 => "the bootloader could not write (errWRITE)",
        4 => "the bootloader could not erase (errERASE)",
        6 => "the bootloader could not program (errPROG), because the flash at this address was not erased",
        7 => "the bytes that the bootloader reads back differ from the written bytes (errVERIFY)",
        8 => "the address is out of range (errADDRESS)",
        11 => "the flash is protected (errVENDOR). Remove the read protection with a debug probe; this erases the chip",
        _ => "see DFU 1.1, section 6.1.2",
    }
}

/// A bootloader that is ready for commands.
#[derive(Debug)]
pub struct Dfuse<P> {
    pipe: P,
}

/// What GETSTATUS gives.
struct Status {
    status: u8,
    state: u8,
    poll: Duration,
}

/// What is being done, for messages.
#[derive(Clone, Copy)]
struct DfuStep {
    name: &'static str,
    address: u32,
}

impl DfuStep {
    fn pipe_error(self, source: PipeError) -> DfuError {
        DfuError::Pipe { step: self.name, address: self.address, source }
    }

    fn state_error(self, state: u8) -> DfuError {
        DfuError::State { step: self.name, address: self.address, state }
    }
}

impl<P: ControlPipe> Dfuse<P> {
    /// Brings the device to idle, whatever it was doing.
    ///
    /// # Errors
    /// [`DfuError`].
    pub fn open(pipe: P) -> Result<Self, DfuError> {
        let mut this = Self { pipe };
        this.bring_to_idle(DfuStep { name: "starting", address: 0 })?;
        Ok(this)
    }

    /// Erases the page that holds `address`.
    ///
    /// # Errors
    /// [`DfuError`].
    pub fn erase_page_at(&mut self, address: u32) -> Result<(), DfuError> {
        self.send_command(DfuStep { name: "erasing", address }, command::ERASE)
    }

    /// Writes up to [`TRANSFER_SIZE`] bytes into erased flash: whole double words at the address of one.
    ///
    /// # Errors
    /// [`DfuError`].
    pub fn write(&mut self, address: u32, data: &[u8]) -> Result<(), DfuError> {
        let step = DfuStep { name: "writing", address };
        self.send_command(step, command::SET_ADDRESS)?;
        self.download_block(step, FIRST_DATA_BLOCK, data)
    }

    /// Reads up to [`TRANSFER_SIZE`] bytes.
    ///
    /// # Errors
    /// [`DfuError`].
    pub fn read(&mut self, address: u32, length: usize) -> Result<Vec<u8>, DfuError> {
        let step = DfuStep { name: "reading", address };
        self.send_command(step, command::SET_ADDRESS)?;
        self.bring_to_idle(step)?;
        let length = u16::try_from(length.min(TRANSFER_SIZE)).unwrap_or(u16::MAX);
        let data = self.pipe.control_in(request::UPLOAD, FIRST_DATA_BLOCK, length);
        let data = data.map_err(|error| self.find_reason_of_refusal(step, error))?;
        self.bring_to_idle(step)?;
        Ok(data)
    }

    /// Leaves the bootloader for the program whose vector table is at `address`. The device goes away, so what it
    /// answers last is not looked at.
    ///
    /// # Errors
    /// [`DfuError`], if it does not even take the address.
    pub fn leave_for_program_at(mut self, address: u32) -> Result<(), DfuError> {
        let step = DfuStep { name: "leaving the bootloader", address };
        self.send_command(step, command::SET_ADDRESS)?;
        self.pipe.control_out(request::DNLOAD, FIRST_DATA_BLOCK, &[]).map_err(|error| step.pipe_error(error))?;
        let _ = self.read_status(step);
        Ok(())
    }

    fn send_command(&mut self, step: DfuStep, command: u8) -> Result<(), DfuError> {
        let [a, b, c, d] = step.address.to_le_bytes();
        self.download_block(step, 0, &[command, a, b, c, d])
    }

    fn download_block(&mut self, step: DfuStep, block: u16, data: &[u8]) -> Result<(), DfuError> {
        let sent = self.pipe.control_out(request::DNLOAD, block, data);
        sent.map_err(|error| self.find_reason_of_refusal(step, error))?;
        self.wait_until_done(step)
    }

    /// Why a refused transfer was refused: that stands in the device's status.
    fn find_reason_of_refusal(&mut self, step: DfuStep, error: PipeError) -> DfuError {
        let status = if error == PipeError::Stall { self.wait_until_done(step).err() } else { None };
        status.unwrap_or_else(|| step.pipe_error(error))
    }

    /// Waits until the device has done what it was sent.
    fn wait_until_done(&mut self, step: DfuStep) -> Result<(), DfuError> {
        let mut last = state::DOWNLOAD_BUSY;
        for _ in 0..MOST_POLLS {
            let status = self.read_status(step)?;
            last = status.state;
            match status.state {
                state::DOWNLOAD_IDLE | state::IDLE => return Ok(()),
                state::ERROR => {
                    let _ = self.pipe.control_out(request::CLRSTATUS, 0, &[]);
                    return Err(DfuError::Status { step: step.name, address: step.address, status: status.status });
                }
                _ => self.pipe.pause(status.poll.min(LONGEST_POLL)),
            }
        }
        Err(step.state_error(last))
    }

    fn bring_to_idle(&mut self, step: DfuStep) -> Result<(), DfuError> {
        let mut last = state::ERROR;
        for _ in 0..MOST_POLLS {
            let status = self.read_status(step)?;
            last = status.state;
            let request = match status.state {
                state::IDLE => return Ok(()),
                state::ERROR => request::CLRSTATUS,
                state::DOWNLOAD_BUSY | state::MANIFEST => {
                    self.pipe.pause(status.poll.min(LONGEST_POLL));
                    continue;
                }
                _ => request::ABORT,
            };
            self.pipe.control_out(request, 0, &[]).map_err(|error| step.pipe_error(error))?;
        }
        Err(step.state_error(last))
    }

    fn read_status(&mut self, step: DfuStep) -> Result<Status, DfuError> {
        let answer = self.pipe.control_in(request::GETSTATUS, 0, 6).map_err(|error| step.pipe_error(error))?;
        let &[status, low, middle, high, state, _] = answer.as_slice() else {
            let text = format!("the status of the bootloader has {} bytes instead of 6", answer.len());
            return Err(step.pipe_error(PipeError::Other(text)));
        };
        let milliseconds = u32::from_le_bytes([low, middle, high, 0]);
        Ok(Status { status, state, poll: Duration::from_millis(u64::from(milliseconds)) })
    }
}
