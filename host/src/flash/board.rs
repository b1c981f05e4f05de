//! The board whose firmware runs: what it is, and its way to the bootloader.

use super::check::{CheckError, InstalledFirmware, check_idle};
use crate::device::client::request_name;
use crate::device::port::{PortError, run_port_calls_in_thread_abandoned_after_limit};
use crate::device::{Client, DeviceIdentity, LinkError, OpenDevice, Target, TargetError};
use era_shared::protocol::{BOOTLOADER_KEY, CURRENT_VERSION, MIN_VERSION, Reply, Request};
use std::time::{Duration, Instant};

/// How long a board may take from its start until its USB port is there and it answers.
const START: Duration = Duration::from_secs(10);
/// Beside the time that an answer may take, longest time for the calls on the port.
const CALLS: Duration = Duration::from_secs(1);
/// Between two looks for it.
const LOOK_AGAIN: Duration = Duration::from_millis(300);

/// Why the board cannot be talked to.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// It cannot be opened or found.
    #[error(transparent)]
    Target(#[from] TargetError),
    /// Its port cannot be opened.
    #[error(transparent)]
    Port(#[from] PortError),
    /// It does not answer, or not as it should.
    #[error("{0}")]
    Link(String),
    /// It is in use.
    #[error(transparent)]
    Check(#[from] CheckError),
    /// Its firmware is too old.
    #[error(
        "the board's firmware speaks ERA protocol version {0}, in which the host cannot start the bootloader. Hold \
        the pin BOOT0 (PB8) high while you switch the power on, then run `era flash` again; or write the firmware \
        with a debug probe (`era flash --probe`)"
    )]
    TooOld(u8),
}

/// A board that answers.
pub struct Board {
    /// What it said.
    pub identity: DeviceIdentity,
    /// There until a call on its port has not returned, or it has not answered.
    client: Option<Client>,
    // Last, so that the emulated board ends after the port was closed.
    device: OpenDevice,
}

impl Board {
    /// Finds the board, and asks who it is.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn open(target: &Target) -> Result<Self, BoardError> {
        let device = OpenDevice::start_emulator_or_check_board_port_opens(target)?;
        let hello = Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION };
        let (client, reply) = ask_within_limit(device.open_client()?, &device, &hello)?;
        match DeviceIdentity::from_reply_if_hello(reply.clone()) {
            Some(identity) => Ok(Self { identity, client: Some(client), device }),
            None => Err(unexpected_reply_error(&hello, &reply)),
        }
    }

    /// Waits for the board to start.
    ///
    /// # Errors
    /// The last [`BoardError`] when it takes too long.
    pub fn wait_for(target: &Target) -> Result<Self, BoardError> {
        let until = Instant::now() + START;
        loop {
            match Self::open(target) {
                Err(_) if Instant::now() < until => std::thread::sleep(LOOK_AGAIN),
                result => return result,
            }
        }
    }

    /// The port.
    #[must_use]
    pub fn path(&self) -> &str {
        self.device.port_path()
    }

    /// What runs on it.
    #[must_use]
    pub const fn installed_firmware(&self) -> InstalledFirmware {
        let DeviceIdentity { board, firmware, protocol_current, .. } = &self.identity;
        InstalledFirmware { board: Some(*board), firmware: *firmware, protocol_current: *protocol_current }
    }

    /// Makes sure that it can be taken out of service.
    ///
    /// # Errors
    /// [`BoardError::Check`] if it is armed or drives, and those of the link.
    pub fn check_idle(&mut self) -> Result<(), BoardError> {
        match self.send_request(&Request::Status)? {
            Reply::Status(status) => Ok(check_idle(status.state)?),
            other => Err(unexpected_reply_error(&Request::Status, &other)),
        }
    }

    fn send_request(&mut self, request: &Request) -> Result<Reply, BoardError> {
        let closed = || BoardError::Link("the link to the board was closed after an earlier error".into());
        let client = self.client.take().ok_or_else(closed)?;
        let (client, reply) = ask_within_limit(client, &self.device, request)?;
        self.client = Some(client);
        Ok(reply)
    }

    /// Sends it to its bootloader; its port then goes away.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn enter_bootloader(mut self) -> Result<(), BoardError> {
        let request = Request::Bootloader { key: BOOTLOADER_KEY };
        if self.identity.protocol_current < request.introduced_in_version() {
            return Err(BoardError::TooOld(self.identity.protocol_current));
        }
        match self.send_request(&request)? {
            Reply::Bootloader => Ok(()),
            other => Err(unexpected_reply_error(&request, &other)),
        }
    }

    /// The next bytes of its log; none if there are none now.
    ///
    /// # Errors
    /// [`BoardError::Link`].
    pub fn log(&mut self) -> Result<Vec<u8>, BoardError> {
        match self.send_request(&Request::Log)? {
            Reply::Log { bytes } => Ok(bytes.to_vec()),
            other => Err(unexpected_reply_error(&Request::Log, &other)),
        }
    }
}

/// Asks, no longer than an answer may take, as a call on the port may not return. After an error the client is gone, and the programs that have the
/// port open are named.
fn ask_within_limit(mut client: Client, device: &OpenDevice, request: &Request) -> Result<(Client, Reply), BoardError> {
    let limit = device.timing().retry_policy.longest_total_wait().saturating_mul(2).saturating_add(CALLS);
    let asked = request.clone();
    let (client, reply) = run_port_calls_in_thread_abandoned_after_limit(device.port_path(), limit, move |step| {
        let reply = step.name_and_run_call("read or write", || client.request(&asked));
        (client, reply)
    })?;
    match reply {
        Ok(reply) => Ok((client, reply)),
        Err(error) => Err(BoardError::Link(device.describe_link_error_for_emulator_or_name_programs_on_port(&error))),
    }
}

fn unexpected_reply_error(request: &Request, reply: &Reply) -> BoardError {
    BoardError::Link(LinkError::Unexpected { request: request_name(request), reply: format!("{reply:?}") }.to_string())
}
