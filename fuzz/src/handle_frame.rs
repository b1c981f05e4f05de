//! The device logic through any script of frames, noise, time and faults on two links, with a watcher that checks after
//! every step what must hold of any device.

use crate::board::WatchedBoard;
use crate::decoder::encoded;
use crate::step::{LINKS, Step};
use era_shared::device::{Device, Port};
use era_shared::link::{Decoder, Frame, Kind, MAX_ENCODED};
use era_shared::protocol::{CURRENT_VERSION, Fault, FaultCode, Refusal, Reply, Request, speaks};
use era_shared::safety::{DEADMAN_MAX_MS, LinkId, State};

/// The watcher's own link: its questions keep nobody's session alive, as only the link that armed does.
const WATCHER: LinkId = LinkId(0xFE);

/// Runs one script.
///
/// # Panics
/// If the device does what no device may do.
pub fn run(input: &[u8]) {
    let mut bench = Bench::new();
    for step in Step::script(input) {
        bench.carry_out(&step);
    }
}

/// What an order may have asked for, as far as the watcher must know.
#[derive(Default)]
struct Order {
    /// A frame arrived, or bytes that may hold one.
    heard: bool,
    /// The request, if it was one in a well-formed frame of a spoken version.
    request: Option<Request>,
    /// Bytes that may hold any request.
    anything: bool,
}

struct Bench {
    device: Device,
    board: WatchedBoard,
    ports: [Port; LINKS],
    sequence: u16,
    fault: Option<Fault>,
    /// When any link last carried anything.
    heard_at_us: u64,
    /// Of the session that was armed last, as the device told it.
    deadman_ms: u16,
}

impl Bench {
    fn new() -> Self {
        let mut bench = Self {
            device: Device::new(),
            board: WatchedBoard::new(),
            ports: std::array::from_fn(|index| Port::new(LinkId(index as u8))),
            sequence: 0,
            fault: None,
            heard_at_us: 0,
            deadman_ms: DEADMAN_MAX_MS,
        };
        bench.device.start(&mut bench.board);
        assert!(bench.board.is_off(), "off at the start");
        bench
    }

    fn carry_out(&mut self, step: &Step) {
        let before = self.device.state();
        let mut order = Order::default();
        match step {
            Step::Request { link, body } => order = self.frame(*link, CURRENT_VERSION, Kind::Request as u8, body),
            Step::Frame { link, version, kind, body } => order = self.frame(*link, *version, *kind, body),
            Step::Bytes { link, bytes } => {
                for answer in self.send(*link, bytes) {
                    decoded(&answer);
                }
                order = Order { heard: true, anything: true, request: None };
            }
            Step::Wait { ms } => {
                self.device.poll(&mut self.board);
                for _ in 0..*ms {
                    self.board.now_us += 1_000;
                    self.device.poll(&mut self.board);
                }
                assert!(!self.is_silent_too_long() || self.board.is_off(), "live after the dead-man time");
            }
            Step::Late { ms } => {
                self.board.now_us += u64::from(*ms) * 1_000;
                // No question either: it would be the poll that is late.
                return;
            }
            Step::Fault { code, detail } => {
                // Silence is the device's own finding, the rest may be a board's.
                let of_boards = FaultCode::ALL.iter().filter(|code| **code != FaultCode::HostSilent);
                if let Some(code) = of_boards.cycle().nth(usize::from(*code)) {
                    let now_us = self.board.now_us;
                    self.device.raise(&mut self.board, *code, u32::from(*detail), now_us);
                    assert_eq!(self.device.state(), State::Fault, "{code:?} is a fault in every state");
                }
            }
            Step::Hardware { refuses } => {
                self.board.refuses_arming = refuses & 1 != 0;
                self.board.refuses_drives = refuses & 2 != 0;
            }
            Step::Reopen { link } => {
                if let Some(port) = self.ports.get_mut(*link) {
                    port.reset();
                }
            }
        }
        if order.heard {
            self.heard_at_us = self.board.now_us;
        }
        self.check(before, &order);
    }

    /// What holds after every step.
    fn check(&mut self, before: State, order: &Order) {
        let state = self.device.state();
        assert!(state.is_live() || self.board.is_off(), "energised in state {state:?}");
        assert!(
            state != State::Running || self.board.programs.iter().any(Option::is_some),
            "running without a channel that runs"
        );
        if !order.heard {
            assert!(state == before || !state.is_live(), "from {before:?} to {state:?} without being asked");
        }
        let fault = self.latched();
        // The question is a poll too: silence after a late step may have come to light by it.
        let state = self.device.state();
        assert_eq!(state == State::Fault, fault.is_some(), "state {state:?} with {fault:?}");
        let may_clear = order.anything || matches!(order.request, Some(Request::ClearFaults));
        if let (Some(first), false) = (self.fault, may_clear) {
            let kept = fault.is_some_and(|now| {
                (now.code, now.detail, now.at_us) == (first.code, first.detail, first.at_us) && now.count >= first.count
            });
            assert!(kept, "{first:?} became {fault:?}");
        }
        self.fault = fault;
    }

    /// Asks for the latched fault on the watcher's link, past the ports.
    fn latched(&mut self) -> Option<Fault> {
        let mut body = [0; 8];
        let body = postcard::to_slice(&Request::Faults, &mut body).expect("one byte");
        let frame = Frame { version: CURRENT_VERSION, kind: Kind::Request as u8, sequence: 0, body };
        let mut out = [0; MAX_ENCODED];
        let length = self.device.handle_frame(&mut self.board, WATCHER, &frame, &mut out).expect("an answer");
        match decoded(&out[..length]).2 {
            Reply::Faults { latched } => latched,
            other => panic!("{other:?} to a question for faults"),
        }
    }

    /// One well-formed frame, and its answer checked.
    fn frame(&mut self, link: usize, version: u8, kind: u8, body: &[u8]) -> Order {
        let body = body.get(..body.len().min(era_shared::link::MAX_BODY)).unwrap_or(body);
        let request = postcard::from_bytes::<Request>(body).ok();
        let request = request.filter(|_| speaks(version) && kind == Kind::Request as u8);
        self.sequence = self.sequence.wrapping_add(1);
        let (programs, state) = (self.board.programs, self.device.state());
        let too_late = state.is_live() && self.is_silent_too_long();
        // A zero first ends whatever the line held.
        let bytes = [&[0][..], &encoded(version, kind, self.sequence, body)].concat();
        let answers = self.send(link, &bytes);
        if kind == Kind::Reply as u8 {
            assert!(answers.is_empty(), "an answer was answered");
            return Order { heard: true, ..Order::default() };
        }
        assert_eq!(answers.len(), 1, "answers to one frame");
        let (said, sequence, reply) = decoded(&answers[0]);
        assert_eq!(sequence, self.sequence, "the answer's number");
        assert!(speaks(said) && (said == version || !speaks(version)), "answered in version {said}");
        let refused = matches!(reply, Reply::Refused(_));
        assert!(!too_late || request.is_none() || self.board.is_off(), "revived by {request:?}");
        assert!(request.is_some() || refused, "{reply:?} to what is no request");
        if let Some(request) = &request {
            self.judge(request, &reply);
        }
        // What is refused changes nothing, but for a fault that came to light.
        if refused && !matches!(reply, Reply::Refused(Refusal::Fault(_))) && self.device.state() == state {
            assert_eq!(self.board.programs, programs, "changed by what was refused: {reply:?}");
        }
        Order { heard: true, request, anything: false }
    }

    /// Whether the board is as the answer says.
    fn judge(&mut self, request: &Request, reply: &Reply) {
        let state = self.device.state();
        match (request, reply) {
            (_, Reply::Refused(refusal)) => {
                assert_ne!(*refusal, Refusal::Malformed, "to {request:?}");
                assert!(!matches!(refusal, Refusal::Version { .. }), "to {request:?}");
                if matches!(refusal, Refusal::Fault(_)) {
                    assert!(self.board.is_off(), "a fault, and still on");
                }
            }
            (Request::Hello { .. }, Reply::Hello(_))
            | (Request::KeepAlive, Reply::Alive { .. })
            | (Request::Status, Reply::Status(_))
            | (Request::Faults, Reply::Faults { .. })
            | (Request::Telemetry, Reply::Telemetry(_)) => {}
            (Request::Arm { .. }, Reply::Armed { deadman_ms }) => {
                assert!(state.is_live() && self.board.live, "armed, but {state:?}");
                self.deadman_ms = *deadman_ms;
            }
            (Request::Disarm, Reply::Disarmed) | (Request::Stop, Reply::Stopped) => {
                assert!(!state.is_live() && self.board.is_off(), "not off after {request:?}");
            }
            (Request::SetDrives { drives }, Reply::DrivesSet { achieved }) => {
                assert_eq!(achieved.len(), drives.len());
                assert_eq!(self.board.programs.iter().flatten().count(), drives.len());
                assert_eq!(state, if drives.is_empty() { State::Armed } else { State::Running });
            }
            (Request::ClearFaults, Reply::FaultsCleared) => assert_ne!(state, State::Fault),
            (request, reply) => panic!("{reply:?} to {request:?}"),
        }
    }

    /// Whether no link has carried anything for the dead-man time of the last session.
    fn is_silent_too_long(&self) -> bool {
        self.board.now_us - self.heard_at_us >= u64::from(self.deadman_ms) * 1_000
    }

    fn send(&mut self, link: usize, bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut answers = Vec::new();
        if let Some(port) = self.ports.get_mut(link) {
            self.device.receive(&mut self.board, port, bytes, |answer| answers.push(answer.to_vec()));
        }
        answers
    }
}

/// The one reply that `bytes` hold.
fn decoded(bytes: &[u8]) -> (u8, u16, Reply) {
    let mut found = Vec::new();
    Decoder::new().feed(bytes, |result| {
        let frame = result.expect("the device sends good frames");
        assert_eq!(frame.kind, Kind::Reply as u8);
        let (reply, rest) = postcard::take_from_bytes::<Reply>(frame.body).expect("the device sends known replies");
        assert!(rest.is_empty(), "{} bytes behind {reply:?}", rest.len());
        found.push((frame.version, frame.sequence, reply));
    });
    assert_eq!(found.len(), 1, "frames in one answer");
    found.remove(0)
}
