//! A board whose time the test makes: slower than the host's, with jumps, or as quick as it can be worked out.

use super::old_board::behind_a_terminal;
use super::still_panel;
use era::device::Client;
use era::device::sim::{Clock, SimBoard};
use era_shared::device::{Device, LinkReceiver};
use era_shared::link::{Decoder, FrameKind};
use era_shared::protocol::Request;
use era_shared::safety::{LinkId, SafetyState};
use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Largest step of the board's time in us: its loop runs every ms.
const TICK_US: u64 = 1000;

/// The board, shared by its line and the test.
#[derive(Clone)]
pub struct TimedBoard(Arc<Mutex<Inner>>);

pub struct Inner {
    device: Device,
    board: SimBoard,
    port: LinkReceiver,
    decoder: Decoder,
    answers: VecDeque<u8>,
    now_us: u64,
    /// When the board wants to look again.
    due_us: u64,
    looked: Instant,
    /// The host's us to one of the board's.
    pub slower: u64,
    /// Added to the board's time when the first effect comes.
    pub jump_us: u64,
    /// Effects that have come.
    pub plays: u32,
    /// Whether it has ever driven.
    pub has_run: bool,
}

impl TimedBoard {
    /// Two channels for 2 kV, as quick as the host.
    pub fn new() -> Self {
        let mut board = SimBoard::new(still_panel(), &[2000.0; 2], Clock::Manual(0));
        let mut device = Device::new();
        device.restore_credit_and_complete_boot_to_discharging_or_fault(&mut board);
        Self(Arc::new(Mutex::new(Inner {
            device,
            board,
            port: LinkReceiver::new(LinkId(0)),
            decoder: Decoder::new(),
            answers: VecDeque::new(),
            now_us: 0,
            due_us: 0,
            looked: Instant::now(),
            slower: 1,
            jump_us: 0,
            plays: 0,
            has_run: false,
        })))
    }

    pub fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The path of a port with this board behind it.
    pub fn behind_a_terminal(&self) -> String {
        self.lock().looked = Instant::now();
        behind_a_terminal(self.clone())
    }

    /// A client of its own, before the board is behind a terminal.
    pub fn client(&self) -> Client {
        Client::new(Box::new(self.clone()), Duration::from_secs(1))
    }
}

impl Inner {
    /// Lets so much of the board's time pass.
    pub fn pass(&mut self, us: u64) {
        let until_us = self.now_us + us;
        while self.now_us < until_us {
            // Also when it asks to be: its timers' boundaries may be at the same place in every tick, too near to be written to.
            let next_us = self.due_us.clamp(self.now_us + 1, self.now_us + TICK_US);
            self.now_us = until_us.min(next_us);
            self.board.set_manual_time_us(self.now_us);
            self.due_us = self.device.do_due_work_and_tell_next_due_us(&mut self.board);
        }
        self.has_run |= self.device.state() == SafetyState::Running;
    }

    pub fn now_us(&self) -> u64 {
        self.now_us
    }

    fn catch_up(&mut self) {
        let elapsed_us = u64::try_from(self.looked.elapsed().as_micros()).unwrap() / self.slower;
        if elapsed_us > 0 {
            self.looked = Instant::now();
            self.pass(elapsed_us);
        }
    }
}

impl Write for TimedBoard {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let mut inner = self.lock();
        inner.catch_up();
        let mut plays = 0;
        inner.decoder.feed_bytes(bytes, |frame| {
            let request = frame.ok().filter(|frame| frame.kind == FrameKind::Request as u8);
            let request = request.and_then(|frame| postcard::from_bytes::<Request>(frame.body).ok());
            plays += u32::from(matches!(request, Some(Request::Play { .. } | Request::PlayOnce { .. })));
        });
        if inner.plays == 0 && plays > 0 {
            let jump_us = inner.jump_us;
            inner.now_us += jump_us;
            inner.pass(TICK_US);
        }
        inner.plays += plays;
        let Inner { device, board, port, answers, .. } = &mut *inner;
        device.receive_bytes(board, port, bytes, |answer| answers.extend(answer));
        Ok(bytes.len())
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Read for TimedBoard {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let mut inner = self.lock();
        inner.catch_up();
        if inner.answers.is_empty() {
            drop(inner);
            std::thread::sleep(Duration::from_millis(1));
            return Err(ErrorKind::TimedOut.into());
        }
        inner.answers.read(buffer)
    }
}
