//! A board of other protocol versions, behind a client or a pseudo-terminal.

use super::still_panel;
use era::device::sim::{Clock, SimBoard};
use era_shared::device::{Device, LinkReceiver};
use era_shared::link::{Decoder, FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::{BoardKind, Refusal, Reply};
use era_shared::safety::LinkId;
use serialport::{SerialPort, TTYPort};
use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

/// A board that speaks the versions `min` to `current` and refuses others as every version does.
pub struct Board {
    min: u8,
    current: u8,
    device: Device,
    board: SimBoard,
    port: LinkReceiver,
    decoder: Decoder,
    answers: VecDeque<u8>,
}

impl Board {
    pub fn speaking(min: u8, current: u8) -> Self {
        Self::posing_as(BoardKind::Simulated, min, current)
    }

    /// The same, which says that it is such a board.
    pub fn posing_as(kind: BoardKind, min: u8, current: u8) -> Self {
        let mut board = SimBoard::new(still_panel(), &[2000.0; 2], Clock::Wall(Instant::now())).with_board_kind(kind);
        let mut device = Device::new();
        device.restore_credit_and_complete_boot_to_discharging_or_fault(&mut board);
        let (port, decoder) = (LinkReceiver::new(LinkId(0)), Decoder::new());
        Self { min, current, device, board, port, decoder, answers: VecDeque::new() }
    }
}

impl Write for Board {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let Self { min, current, answers, decoder, .. } = self;
        let (min, current) = (*min, *current);
        let mut refused = false;
        decoder.feed_bytes(bytes, |frame| {
            let Ok(frame) = frame else { return };
            if !(min..=current).contains(&frame.version) {
                refused = true;
                let refusal = Refusal::Version { got: frame.version, device_min: min, device_current: current };
                let (mut out, reply) = ([0; MAX_ENCODED], Reply::Refused(refusal));
                let length =
                    encode_frame(current, FrameKind::Reply, frame.sequence, &reply, &mut out).expect("it fits");
                answers.extend(&out[..length]);
            }
        });
        if !refused {
            self.device.receive_bytes(&mut self.board, &mut self.port, bytes, |answer| {
                self.answers.extend(of_version(min, current, answer));
            });
        }
        Ok(bytes.len())
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// The same answer, with the versions of this board where it names any: the logic behind it is of the newest.
fn of_version(min: u8, current: u8, answer: &[u8]) -> Vec<u8> {
    let mut changed = None;
    Decoder::new().feed_bytes(answer, |frame| {
        let Ok(frame) = frame else { return };
        let mut reply = postcard::from_bytes(frame.body);
        match &mut reply {
            Ok(Reply::Hello(hello)) => (hello.protocol_min, hello.protocol_current) = (min, current),
            Ok(Reply::Welcome(welcome)) => (welcome.protocol_min, welcome.protocol_current) = (min, current),
            _ => return,
        }
        let mut out = [0; MAX_ENCODED];
        let length =
            encode_frame(frame.version, FrameKind::Reply, frame.sequence, &reply.expect("just seen"), &mut out);
        changed = Some(out[..length.expect("it fits")].to_vec());
    });
    changed.unwrap_or_else(|| answer.to_vec())
}

impl Read for Board {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.device.do_due_work_and_tell_next_due_us(&mut self.board);
        if self.answers.is_empty() {
            std::thread::sleep(Duration::from_millis(1));
            return Err(ErrorKind::TimedOut.into());
        }
        self.answers.read(buffer)
    }
}

/// Runs the board behind a pseudo-terminal for as long as the test's program does; the path of the port.
pub fn behind_a_terminal(mut board: impl Read + Write + Send + 'static) -> String {
    let (mut terminal, line) = TTYPort::pair().unwrap();
    terminal.set_timeout(Duration::from_millis(1)).unwrap();
    let path = line.name().unwrap();
    drop(line);
    std::thread::spawn(move || {
        let mut buffer = [0; 512];
        loop {
            match terminal.read(&mut buffer) {
                Ok(length) => board.write_all(&buffer[..length]).unwrap(),
                Err(_) => std::thread::sleep(Duration::from_micros(500)),
            }
            if let Ok(length) = board.read(&mut buffer) {
                let _ = terminal.write_all(&buffer[..length]);
            }
        }
    });
    path
}
