//! The device logic through any script of frames, noise, time and faults on two links, with a watcher that checks after
//! every step what must hold of any device.

use crate::board::{WatchedBoard, outside};
use crate::decoder::encode_unchecked_frame;
use crate::step::{LINKS, Step};
use era_shared::device::{Device, LinkReceiver};
use era_shared::limits::{DEADMAN_MAX_MS, DISCHARGED_MILLIVOLTS};
use era_shared::link::{Decoder, Frame, FrameKind, LinkArrival, MAX_ENCODED};
use era_shared::protocol::{
    BOOTLOADER_KEY, CURRENT_VERSION, Fault, FaultCode, Refusal, Reply, Request, is_version_supported,
};
use era_shared::safety::{LinkId, SafetyEvent, SafetyState};

/// The watcher's own link: its questions keep nobody's session alive, as only the link that armed does.
const WATCHER: LinkId = LinkId(0xFE);

/// Runs one script.
///
/// # Panics
/// If the device does what no device may do.
pub fn run_script_with_safety_checks(input: &[u8]) {
    let mut bench = Bench::new();
    for step in Step::decode_script(input) {
        bench.perform_step_and_check_device(&step);
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
    ports: [LinkReceiver; LINKS],
    sequence: u16,
    fault: Option<Fault>,
    /// Faults that were latched so far.
    fault_number: u32,
    /// When any link last carried anything.
    heard_at_us: u64,
    /// Of the session that was armed last, as the device told it.
    deadman_ms: u16,
}

impl Bench {
    fn new() -> Self {
        let mut bench = Self {
            device: Device::new(),
            board: WatchedBoard::default(),
            ports: LinkReceiver::new_for_each_link(),
            sequence: 0,
            fault: None,
            fault_number: 0,
            heard_at_us: 0,
            deadman_ms: DEADMAN_MAX_MS,
        };
        bench.device.restore_credit_and_complete_boot_to_discharging_or_fault(&mut bench.board);
        assert!(bench.board.is_off(), "off at the start");
        bench
    }

    fn perform_step_and_check_device(&mut self, step: &Step) {
        let before = self.device.state();
        let mut order = Order::default();
        match step {
            Step::Request { link, body } => {
                order = self.send_frame_and_check_reply(*link, CURRENT_VERSION, FrameKind::Request as u8, body);
            }
            Step::Frame { link, version, kind, body } => {
                order = self.send_frame_and_check_reply(*link, *version, *kind, body);
            }
            Step::Bytes { link, bytes } => {
                self.send_bytes_and_tell_whether_answered(*link, bytes);
                order = Order { heard: true, anything: true, request: None };
            }
            Step::Wait { ms } => {
                self.advance_time_us(u64::from(*ms) * 1_000);
                assert!(!self.is_deadman_time_over() || self.board.is_off(), "live after the dead-man time");
                let open = self.board.wrong & outside::LOOPS != 0;
                assert!(*ms < 2 || !open || self.board.is_off(), "live with an open loop");
                let charged = self
                    .board
                    .compute_rail_voltages_millivolts()
                    .iter()
                    .any(|millivolts| *millivolts >= DISCHARGED_MILLIVOLTS);
                assert!(
                    *ms < 2 || !charged || self.device.state() != SafetyState::Safe,
                    "called safe with charged rails"
                );
            }
            Step::Late { ms } => {
                self.board.now_us += u64::from(*ms) * 1_000;
                // No question either: it would be the poll that is late.
                return;
            }
            Step::Fault { code, detail } => {
                let (code, now_us) = (select_board_fault_code(*code), self.board.now_us);
                self.device.switch_all_off_and_latch_fault(&mut self.board, code, u32::from(*detail), now_us);
                assert_eq!(self.device.state(), SafetyState::Fault, "{code:?} is a fault in every state");
            }
            Step::Hardware { refuses } => self.board.refused = *refuses,
            Step::Outside { wrong } => self.board.wrong = *wrong,
            Step::Trip { code } => self.board.trip = Some((select_board_fault_code(*code), 0)),
            Step::Reopen { link } => {
                if let Some(port) = self.ports.get_mut(*link) {
                    self.device.handle_received_bytes_or_link_reopening(
                        &mut self.board,
                        port,
                        &LinkArrival::Reopened,
                        |_| {},
                    );
                }
            }
        }
        if order.heard {
            self.heard_at_us = self.board.now_us;
        }
        self.assert_safety_rules_after_step(before, &order);
    }

    /// What holds after every step.
    fn assert_safety_rules_after_step(&mut self, before: SafetyState, order: &Order) {
        let state = self.device.state();
        assert!(state.is_live() || self.board.is_off(), "energised in state {state:?}");
        assert!(state != SafetyState::Running || self.board.connected, "running with the electrodes disconnected");
        assert!(
            order.heard || before.is_live() || !state.is_live(),
            "from {before:?} to {state:?} without being asked"
        );
        let (number, fault) = self.read_fault_number_and_latched_fault();
        // The question is a poll too: silence after a late step may have come to light by it.
        let state = self.device.state();
        assert_eq!(state == SafetyState::Fault, fault.is_some(), "state {state:?} with {fault:?}");
        let may_clear = order.anything
            || match order.request {
                Some(Request::ClearFaults) => true,
                // Only the fault that its sender knows.
                Some(Request::ClearFault { number }) => number == self.fault_number,
                _ => false,
            };
        if let (Some(first), false) = (self.fault, may_clear) {
            let kept = fault.is_some_and(|now| {
                (now.code, now.detail, now.at_us) == (first.code, first.detail, first.at_us) && now.count >= first.count
            });
            assert!(kept && number == self.fault_number, "{first:?} became {fault:?}");
        }
        let is_new = fault.is_some() && self.fault.is_none();
        assert!(number >= self.fault_number + u32::from(is_new), "fault {number} after {}", self.fault_number);
        (self.fault, self.fault_number) = (fault, number);
    }

    /// Asks for the latched fault and its number on the watcher's link, past the ports.
    fn read_fault_number_and_latched_fault(&mut self) -> (u32, Option<Fault>) {
        let mut body = [0; 8];
        let body = postcard::to_slice(&Request::NumberedFault, &mut body).expect("one byte");
        let frame = Frame { version: CURRENT_VERSION, kind: FrameKind::Request as u8, sequence: 0, body };
        let mut out = [0; MAX_ENCODED];
        let length = self.device.answer_frame(&mut self.board, WATCHER, &frame, &mut out).expect("an answer");
        match decode_reply_frame(&out[..length]).2 {
            Reply::NumberedFault { number, latched } => (number, latched),
            other => panic!("{other:?} to a question for faults"),
        }
    }

    /// Bytes that may end frames with any requests; whether any was answered. What is answered is well-formed, and all that
    /// is known of the session from then on is the longest dead-man time there is.
    fn send_bytes_and_tell_whether_answered(&mut self, link: usize, bytes: &[u8]) -> bool {
        let answers = self.send_bytes_and_collect_answers(link, bytes);
        for answer in &answers {
            decode_reply_frame(answer);
        }
        if !answers.is_empty() {
            self.deadman_ms = DEADMAN_MAX_MS;
        }
        !answers.is_empty()
    }

    /// One well-formed frame, and its answer checked.
    fn send_frame_and_check_reply(&mut self, link: usize, version: u8, kind: u8, body: &[u8]) -> Order {
        let body = body.get(..body.len().min(era_shared::link::MAX_BODY)).unwrap_or(body);
        let request = postcard::from_bytes::<Request>(body).ok();
        let request = request.filter(|request| {
            is_version_supported(version)
                && kind == FrameKind::Request as u8
                && request.introduced_in_version() <= version
        });
        self.sequence = self.sequence.wrapping_add(1);
        // A zero first ends whatever the line held, which may have been a whole frame but for its end: any request.
        let anything = self.send_bytes_and_tell_whether_answered(link, &[0]);
        let state = self.device.state();
        let too_late = state.is_live() && self.is_deadman_time_over();
        let answers =
            self.send_bytes_and_collect_answers(link, &encode_unchecked_frame(version, kind, self.sequence, body));
        if kind == FrameKind::Reply as u8 {
            assert!(answers.is_empty(), "an answer was answered");
            return Order { heard: true, anything, ..Order::default() };
        }
        assert_eq!(answers.len(), 1, "answers to one frame");
        let (said, sequence, reply) = decode_reply_frame(&answers[0]);
        assert_eq!(sequence, self.sequence, "the answer's number");
        assert!(
            is_version_supported(said) && (said == version || !is_version_supported(version)),
            "answered in version {said}"
        );
        let refused = matches!(reply, Reply::Refused(_));
        assert!(!too_late || request.is_none() || self.board.is_off(), "revived by {request:?}");
        assert!(request.is_some() || refused, "{reply:?} to what is no request");
        if let Some(request) = &request {
            self.check_reply_and_board_state(request, &reply);
        }
        if version == 1 {
            assert!(is_version_1_reply(&reply), "{reply:?} to a host of version 1");
        }
        Order { heard: true, request, anything }
    }

    /// Whether the board is as the answer says.
    fn check_reply_and_board_state(&mut self, request: &Request, reply: &Reply) {
        let state = self.device.state();
        match (request, reply) {
            (_, Reply::Refused(refusal)) => {
                let wrong_key = matches!(request, Request::Bootloader { key } if *key != BOOTLOADER_KEY);
                assert!(wrong_key || *refusal != Refusal::Malformed, "to {request:?}");
                assert!(!matches!(refusal, Refusal::Version { .. }), "to {request:?}");
                if matches!(refusal, Refusal::Fault(_)) {
                    assert!(self.board.is_off(), "a fault, and still on");
                }
            }
            (Request::Hello { .. }, Reply::Hello(_) | Reply::Welcome(_))
            | (Request::KeepAlive, Reply::Alive { .. })
            | (Request::Status, Reply::Status(_))
            | (Request::Faults, Reply::Faults { .. })
            | (Request::Telemetry, Reply::Telemetry(_))
            | (Request::Clock, Reply::Clock { .. })
            | (Request::Details, Reply::Details(_))
            | (Request::Log, Reply::Log { .. })
            | (Request::Credit, Reply::Credit(_))
            | (Request::NumberedFault, Reply::NumberedFault { .. }) => {}
            (Request::Arm { .. }, Reply::Armed { deadman_ms })
            | (Request::ArmWith { .. }, Reply::ArmedWith { deadman_ms, .. }) => {
                assert!(state.is_live(), "armed, but {state:?}");
                self.deadman_ms = *deadman_ms;
            }
            (Request::Disarm, Reply::Disarmed)
            | (Request::Stop, Reply::Stopped)
            | (Request::Bootloader { .. }, Reply::Bootloader) => {
                assert!(!state.is_live() && self.board.is_off(), "not off after {request:?}");
            }
            (Request::SetDrives { drives }, Reply::DrivesSet { achieved })
            | (Request::Prepare { drives }, Reply::Prepared { achieved }) => {
                assert_eq!(achieved.len(), drives.len());
                assert!(state.is_live(), "drives set, but {state:?}");
            }
            (Request::Play { .. }, Reply::Playing) => assert!(state.is_live(), "playing, but {state:?}"),
            // What was played already is answered whatever has become of it.
            (Request::PlayOnce { .. }, Reply::Playing) | (Request::PlayWindows(_), Reply::WindowsPlaying { .. }) => {}
            (Request::ClearFaults | Request::ClearFault { .. }, Reply::FaultsCleared) => {
                assert_ne!(state, SafetyState::Fault);
            }
            (request, reply) => panic!("{reply:?} to {request:?}"),
        }
    }

    /// Polls the device whenever it wants to be polled.
    fn advance_time_us(&mut self, us: u64) {
        let end_us = self.board.now_us + us;
        loop {
            let due_us = self.device.do_due_work_and_tell_next_due_us(&mut self.board);
            if self.board.now_us >= end_us {
                return;
            }
            assert!(due_us <= self.board.now_us + 1_000, "the device wants to be left alone until {due_us}");
            // A wish that lies in the past is granted a little later, or time would stand still.
            self.board.now_us = due_us.max(self.board.now_us + 10).min(end_us);
        }
    }

    /// Whether no link has carried anything for the dead-man time of the last session.
    fn is_deadman_time_over(&self) -> bool {
        self.board.now_us - self.heard_at_us >= u64::from(self.deadman_ms) * 1_000
    }

    fn send_bytes_and_collect_answers(&mut self, link: usize, bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut answers = Vec::new();
        if let Some(port) = self.ports.get_mut(link) {
            self.device.receive_bytes(&mut self.board, port, bytes, |answer| answers.push(answer.to_vec()));
        }
        answers
    }
}

/// A fault that a board can find; silence is the device's own finding.
fn select_board_fault_code(code: u8) -> FaultCode {
    let of_boards = FaultCode::ALL.into_iter().filter(|code| *code != FaultCode::HostSilent);
    of_boards.cycle().nth(usize::from(code)).unwrap_or(FaultCode::ReadBack)
}

/// Whether a host of version 1 has every word of this reply: its last variants were these.
fn is_version_1_reply(reply: &Reply) -> bool {
    let state = |state: SafetyState| !matches!(state, SafetyState::Arming | SafetyState::Discharging);
    let fault = |fault: &Fault| fault.code.number() <= FaultCode::ReadBack.number();
    match reply {
        Reply::Alive { state: now } => state(*now),
        Reply::Status(status) => state(status.state) && status.fault.iter().all(fault),
        Reply::Telemetry(telemetry) => state(telemetry.state),
        Reply::Faults { latched } => latched.iter().all(fault),
        Reply::Refused(Refusal::Fault(latched)) => fault(latched),
        Reply::Refused(Refusal::State { state: now, event }) => {
            state(*now) && !matches!(event, SafetyEvent::Discharged | SafetyEvent::TestPassed)
        }
        Reply::Refused(
            Refusal::Version { .. }
            | Refusal::Malformed
            | Refusal::Drive { .. }
            | Refusal::DuplicateChannel { .. }
            | Refusal::OtherLink
            | Refusal::Deadman { .. },
        )
        | Reply::Hello(_)
        | Reply::Armed { .. }
        | Reply::Disarmed
        | Reply::DrivesSet { .. }
        | Reply::Stopped
        | Reply::FaultsCleared => true,
        _ => false,
    }
}

/// The one reply that `bytes` hold.
fn decode_reply_frame(bytes: &[u8]) -> (u8, u16, Reply) {
    let mut found = Vec::new();
    Decoder::new().feed_bytes(bytes, |result| {
        let frame = result.expect("the device sends good frames");
        assert_eq!(frame.kind, FrameKind::Reply as u8);
        let (reply, rest) = postcard::take_from_bytes::<Reply>(frame.body).expect("the device sends known replies");
        assert!(rest.is_empty(), "{} bytes behind {reply:?}", rest.len());
        found.push((frame.version, frame.sequence, reply));
    });
    assert_eq!(found.len(), 1, "frames in one answer");
    found.remove(0)
}
