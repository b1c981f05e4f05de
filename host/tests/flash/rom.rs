//! The chip's ROM bootloader, in memory: the DFU state machine of AN3156, the flash's pages and double words, and a cable
//! that can be pulled.

use era::flash::dfuse::{ControlPipe, PipeError, command, request, state};
use era_shared::image::{FIRST_STAGE_SIZE, FLASH_SIZE, FLASH_START, IMAGE_START, MAGIC};
use std::time::Duration;

const DOUBLE_WORD: usize = 8;
const ERASED: u8 = 0xFF;
const ERR_TARGET: u8 = 1;
const ERR_PROG: u8 = 6;
const ERR_VENDOR: u8 = 11;

/// Where a chip finds itself after power-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// The first stage starts the firmware.
    Firmware,
    /// The first stage starts the bootloader.
    Bootloader,
    /// The processor locks up; the pin BOOT0 must help.
    Nothing,
}

/// What was sent and is done when the status is asked for.
#[derive(Clone, Debug)]
enum Pending {
    SetAddress(u32),
    Erase(u32),
    Write(u16, Vec<u8>),
    Leave,
}

pub struct Rom {
    pub flash: Vec<u8>,
    page_size: usize,
    state: u8,
    status: u8,
    pointer: u32,
    pending: Option<Pending>,
    /// Transfers until the cable is pulled.
    left: Option<u32>,
    pub transfers: u32,
    pub pages_erased: u32,
    /// Where it was told to go on leaving.
    pub left_for: Option<u32>,
    /// Answers reads and writes as a chip with read protection does.
    pub protected: bool,
    /// A byte of the flash that cannot be programmed to 0.
    pub worn: Option<u32>,
}

impl Rom {
    /// A chip whose flash holds `contents` from its start.
    pub fn new(page_size: usize, contents: &[u8]) -> Self {
        let mut flash = contents.to_vec();
        flash.resize(FLASH_SIZE as usize, ERASED);
        Self {
            flash,
            page_size,
            state: state::IDLE,
            status: 0,
            pointer: FLASH_START,
            pending: None,
            left: None,
            transfers: 0,
            pages_erased: 0,
            left_for: None,
            protected: false,
            worn: None,
        }
    }

    /// The name of its alternate setting.
    pub fn description(&self) -> String {
        let count = FLASH_SIZE as usize / self.page_size;
        format!("@Internal Flash   /0x08000000/{count}*0{}Kg", self.page_size / 1024)
    }

    /// Power goes after this many transfers, also in the middle of what the last of them started.
    pub fn cut_after(&mut self, transfers: u32) {
        self.left = Some(transfers);
    }

    /// Powered down and up: what the flash holds decides. `expected` is a complete image.
    pub fn power_up(&mut self) -> Start {
        (self.state, self.status, self.pointer, self.pending, self.left) = (state::IDLE, 0, FLASH_START, None, None);
        // The first stage does its part only if it is there: its own vectors are.
        if !self.plausible(FLASH_START) {
            return Start::Nothing;
        }
        let header = (FIRST_STAGE_SIZE + 0x200) as usize;
        let stack = self.word(IMAGE_START);
        let starts = (0x2000_0008..=0x2002_0000).contains(&stack) && self.flash[header..header + 8] == MAGIC;
        if starts { Start::Firmware } else { Start::Bootloader }
    }

    fn plausible(&self, address: u32) -> bool {
        self.word(address) != u32::MAX && self.word(address + 4) != u32::MAX
    }

    fn word(&self, address: u32) -> u32 {
        let at = (address - FLASH_START) as usize;
        u32::from_le_bytes(self.flash[at..at + 4].try_into().unwrap())
    }

    /// Counts a transfer; `Err` when the cable is out.
    fn transfer(&mut self) -> Result<(), PipeError> {
        if let Some(left) = &mut self.left {
            if *left == 0 {
                // What was under way is done by half.
                if let Some(pending) = self.pending.take() {
                    self.carry_out(&pending, true);
                }
                return Err(PipeError::Gone);
            }
            *left -= 1;
        }
        self.transfers += 1;
        Ok(())
    }

    fn fail(&mut self, status: u8) {
        (self.state, self.status) = (state::ERROR, status);
    }

    fn carry_out(&mut self, pending: &Pending, by_half: bool) {
        match pending {
            Pending::SetAddress(address) => self.pointer = *address,
            Pending::Erase(address) => match self.offset(*address, 1) {
                Some(offset) => {
                    let page = offset - offset % self.page_size;
                    let length = if by_half { self.page_size / 2 } else { self.page_size };
                    self.flash[page..page + length].fill(ERASED);
                    self.pages_erased += 1;
                }
                None => self.fail(ERR_TARGET),
            },
            Pending::Write(block, data) => {
                let start = self.pointer + (u32::from(*block) - 2) * 2048;
                let half = data.len() / 2;
                let data = if by_half { &data[..half - half % DOUBLE_WORD] } else { &data[..] };
                self.write(start, data);
            }
            Pending::Leave => self.left_for = Some(self.pointer),
        }
    }

    /// Only whole, erased double words can be programmed (RM0440, section 3.3.7).
    fn write(&mut self, start: u32, data: &[u8]) {
        let Some(offset) = self.offset(start, data.len()) else { return self.fail(ERR_TARGET) };
        if !offset.is_multiple_of(DOUBLE_WORD) || !data.len().is_multiple_of(DOUBLE_WORD) {
            return self.fail(ERR_PROG);
        }
        for (at, word) in (offset..).step_by(DOUBLE_WORD).zip(data.chunks(DOUBLE_WORD)) {
            if self.flash[at..at + DOUBLE_WORD].iter().any(|byte| *byte != ERASED) {
                return self.fail(ERR_PROG);
            }
            self.flash[at..at + DOUBLE_WORD].copy_from_slice(word);
        }
        if let Some(worn) = self.worn.and_then(|address| self.offset(address, 1)) {
            self.flash[worn] = ERASED;
        }
    }

    fn offset(&self, address: u32, length: usize) -> Option<usize> {
        let offset = address.checked_sub(FLASH_START)? as usize;
        (offset + length <= self.flash.len()).then_some(offset)
    }

    fn download(&mut self, block: u16, data: &[u8]) -> Result<(), PipeError> {
        if self.state != state::IDLE && self.state != state::DOWNLOAD_IDLE {
            self.fail(ERR_TARGET);
            return Err(PipeError::Stall);
        }
        if self.protected && !matches!(data, [command::SET_ADDRESS, ..]) {
            self.fail(ERR_VENDOR);
            return Err(PipeError::Stall);
        }
        let address = || Some(u32::from_le_bytes(data.get(1..5)?.try_into().ok()?));
        self.pending = Some(match (block, data) {
            (_, []) => Pending::Leave,
            (0, [command::SET_ADDRESS, ..]) => Pending::SetAddress(address().ok_or(PipeError::Stall)?),
            (0, [command::ERASE, ..]) => Pending::Erase(address().ok_or(PipeError::Stall)?),
            (2.., _) if data.len() <= 2048 => Pending::Write(block, data.to_vec()),
            _ => return Err(PipeError::Stall),
        });
        // dfuDNLOAD-SYNC, until the status is asked for.
        self.state = 3;
        Ok(())
    }

    fn status(&mut self) -> Vec<u8> {
        // The command is carried out now, and the answer says busy (AN3156, sections 5.1 to 5.3).
        if let Some(pending) = self.pending.take() {
            self.state = state::DOWNLOAD_BUSY;
            self.carry_out(&pending, false);
            let told = if self.left_for.is_some() { state::MANIFEST } else { state::DOWNLOAD_BUSY };
            return vec![0, 25, 0, 0, told, 0];
        }
        if self.state == state::DOWNLOAD_BUSY {
            self.state = state::DOWNLOAD_IDLE;
        }
        vec![self.status, 0, 0, 0, self.state, 0]
    }
}

impl ControlPipe for &mut Rom {
    fn control_in(&mut self, request: u8, value: u16, length: u16) -> Result<Vec<u8>, PipeError> {
        self.transfer()?;
        match request {
            request::GETSTATUS => Ok(self.status()),
            request::UPLOAD if self.protected => {
                self.fail(ERR_VENDOR);
                Err(PipeError::Stall)
            }
            request::UPLOAD if value >= 2 && matches!(self.state, state::IDLE | state::UPLOAD_IDLE) => {
                self.state = state::UPLOAD_IDLE;
                let start = self.pointer + (u32::from(value) - 2) * 2048;
                let offset = self.offset(start, usize::from(length)).ok_or(PipeError::Stall)?;
                Ok(self.flash[offset..offset + usize::from(length)].to_vec())
            }
            _ => Err(PipeError::Stall),
        }
    }

    fn control_out(&mut self, request: u8, value: u16, data: &[u8]) -> Result<(), PipeError> {
        self.transfer()?;
        match request {
            request::DNLOAD => self.download(value, data),
            request::CLRSTATUS if self.state == state::ERROR => {
                (self.state, self.status) = (state::IDLE, 0);
                Ok(())
            }
            request::ABORT if self.state != state::ERROR => {
                self.state = state::IDLE;
                Ok(())
            }
            _ => Err(PipeError::Stall),
        }
    }

    fn pause(&mut self, _: Duration) {}
}
