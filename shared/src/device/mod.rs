//! The device's behaviour: what a frame does, and what silence does. The firmware and the simulated device run this
//! code unchanged.

mod answers;
mod live;
mod windows;

use crate::MAX_CHANNELS;
use crate::board::{Board, KeptRun};
use crate::link::{DecodeError, Decoder, Frame, FrameKind, LinkArrival, MAX_ENCODED, encode_frame};
use crate::protocol::{
    AchievedDrive, CURRENT_VERSION, FaultCode, LinkCounters, MIN_VERSION, Refusal, Reply, Request,
    is_version_supported, translate_for_version,
};
use crate::safety::{DriveBudget, ElectrodeFindings, LinkId, SafetyEvent, SafetyMachine, SafetyState, SelfTest};
use crate::supply::{ElectrodeCurrentMonitor, RAILS, RailControl, ReferenceMonitor, SupplyCommand, SupplyMonitor};
use crate::waveform::{ChannelGoal, Sequencer};
use heapless::Deque;

/// One goal per channel; `None` is off.
type Goals = [Option<ChannelGoal>; MAX_CHANNELS];

/// The receiving side of one link: its decoder and its name.
#[derive(Clone, Debug)]
pub struct LinkReceiver {
    id: LinkId,
    decoder: Decoder,
}

impl LinkReceiver {
    /// A port that has received nothing.
    #[must_use]
    pub const fn new(id: LinkId) -> Self {
        Self { id, decoder: Decoder::new() }
    }

    /// One for each of so many links, in their order; each has a name of its own.
    #[must_use]
    pub fn new_for_each_link<const LINKS: usize>() -> [Self; LINKS] {
        core::array::from_fn(|index| Self::new(LinkId::from_index(index)))
    }

    /// Discards the bytes of an incomplete frame, after a link was closed and opened again.
    pub fn discard_partial_frame(&mut self) {
        self.decoder.discard_partial_frame();
    }
}

/// Numbers of effects and sequences that are remembered, so that a repeated request is not played again: more than a host sends
/// until it gives a request up.
const REMEMBERED: usize = 16;

/// The device over a [`Board`].
#[derive(Clone, Debug)]
pub struct Device {
    safety: SafetyMachine,
    counters: LinkCounters,
    /// When the readings are checked next, in us.
    next_tick_us: u64,
    /// Whether the readings have been checked since [`Device::take_tick_done`] was last asked.
    tick_done: bool,
    /// When the supply was last switched off, in us: the rails must be discharged in time.
    off_since_us: u64,
    /// The most that the rails may have stood at then, in mV.
    off_millivolts: [u32; RAILS],
    /// Whether the rails fell more slowly than their discharge switches make them fall.
    discharges_slowly: bool,
    /// Whether the rails were not discharged in time.
    still_charged: bool,
    /// Whether the measurement of the rails was found wrong.
    distrusted: bool,
    self_test: Option<SelfTest>,
    /// Drives that were set while arming; they begin when the self-test has passed.
    held: Option<Goals>,
    /// `Some` while the timers run.
    sequencer: Option<Sequencer>,
    connected: bool,
    rails: RailControl,
    /// The last command to the supply.
    supply: SupplyCommand,
    /// The rails as they were last measured.
    measured_millivolts: [u32; RAILS],
    watch: SupplyMonitor,
    current: ElectrodeCurrentMonitor,
    /// What the last self-test has found of the electrodes.
    electrodes: ElectrodeFindings,
    reference: ReferenceMonitor,
    budget: DriveBudget,
    active: [Option<AchievedDrive>; MAX_CHANNELS],
    /// What was played last, by link and number: the start of a sequence that was answered, or `None` for an effect.
    played: Deque<(LinkId, u32, Option<u64>), REMEMBERED>,
    /// The board restarts into its bootloader in a moment.
    restarting: bool,
}

impl Default for Device {
    fn default() -> Self {
        Self::new()
    }
}

impl Device {
    /// A device that has not started: everything but questions is refused until [`Device::restore_credit_and_complete_boot_to_discharging_or_fault`].
    #[must_use]
    pub const fn new() -> Self {
        Self {
            safety: SafetyMachine::new(),
            counters: LinkCounters { good_frames: 0, bad_frames: 0, refused: 0 },
            next_tick_us: 0,
            tick_done: false,
            off_since_us: 0,
            off_millivolts: [0; RAILS],
            discharges_slowly: false,
            still_charged: false,
            distrusted: false,
            self_test: None,
            held: None,
            sequencer: None,
            connected: false,
            rails: RailControl::new(),
            supply: SupplyCommand::OFF,
            measured_millivolts: [0; RAILS],
            watch: SupplyMonitor::new(),
            current: ElectrodeCurrentMonitor::new(),
            electrodes: ElectrodeFindings::NONE,
            reference: ReferenceMonitor::new(),
            budget: DriveBudget::new(),
            active: [None; MAX_CHANNELS],
            played: Deque::new(),
            restarting: false,
        }
    }

    /// Ends start-up: outputs off, then `Discharging` until the rails are seen to be harmless, or `Fault` if the previous
    /// run ended in one.
    pub fn restore_credit_and_complete_boot_to_discharging_or_fault(&mut self, board: &mut impl Board) {
        // Only Boot accepts this event, so a second call changes nothing but switches off once more.
        let now_us = board.now_us();
        let _ = self.safety.apply_event(SafetyEvent::BootComplete);
        self.safety.number_faults_after_boot_id(board.info().boot_id);
        self.off_since_us = now_us;
        if let Some(kept) = board.info().kept_before_reset {
            self.budget.restore_credit(kept.credit_ms);
            self.distrusted = kept.is_measurement_distrusted;
        }
        self.switch_all_off(board, now_us);
        if let Some((code, detail)) = board.info().fault_before_reset {
            self.switch_all_off_and_latch_fault(board, code, detail, 0);
        }
    }

    /// The safety state.
    #[must_use]
    pub const fn state(&self) -> SafetyState {
        self.safety.state()
    }

    /// Whether the checks of a ms have run since this was last asked. Only then does the task of the device do its work: one that goes round without
    /// them must not feed the watchdog.
    pub const fn take_tick_done(&mut self) -> bool {
        core::mem::replace(&mut self.tick_done, false)
    }

    /// Takes bytes that a link has received, and gives every answer to `send_answer` as an encoded frame.
    pub fn receive_bytes(
        &mut self,
        board: &mut impl Board,
        port: &mut LinkReceiver,
        bytes: &[u8],
        mut send_answer: impl FnMut(&[u8]),
    ) {
        let id = port.id;
        port.decoder.feed_bytes(bytes, |result| {
            let mut out = [0_u8; MAX_ENCODED];
            if let Some(length) = self.count_decoded_frame_and_answer_if_valid(board, id, result, &mut out)
                && let Some(answer) = out.get(..length)
            {
                send_answer(answer);
            }
        });
    }

    /// Carries out what a link reports; answers go out as in [`Self::receive_bytes`].
    pub fn handle_received_bytes_or_link_reopening(
        &mut self,
        board: &mut impl Board,
        port: &mut LinkReceiver,
        arrival: &LinkArrival,
        send_answer: impl FnMut(&[u8]),
    ) {
        match arrival {
            LinkArrival::Bytes(bytes) => self.receive_bytes(board, port, bytes, send_answer),
            LinkArrival::Reopened => self.reset_reopened_link_and_stop_if_it_had_armed(board, port),
        }
    }

    /// Takes note that the other end of a link is new: what came before does not belong to what comes now. If this link has armed the
    /// board, whoever did so is gone, and everything is switched off.
    fn reset_reopened_link_and_stop_if_it_had_armed(&mut self, board: &mut impl Board, port: &mut LinkReceiver) {
        port.decoder.discard_partial_frame();
        if self.safety.close_session_of(port.id) {
            // Accepted in every state.
            let _ = self.handle_safety_event(board, SafetyEvent::Stop, &Goals::default());
        }
    }

    /// Switches everything off and latches a fault that the board itself has found.
    pub fn switch_all_off_and_latch_fault(
        &mut self,
        board: &mut impl Board,
        code: FaultCode,
        detail: u32,
        now_us: u64,
    ) {
        // Part of what the next start is told.
        self.distrusted |= code.casts_doubt_on_rail_measurement();
        // Off before anything else is noted down.
        self.switch_all_off(board, now_us);
        let _off_already = self.safety.latch_fault(code, detail, now_us);
    }

    /// Carries out one frame's request and writes the answer to `out` as an encoded frame; returns its length. A reply is not
    /// answered: answering an answer could go on for ever.
    pub fn answer_frame(
        &mut self,
        board: &mut impl Board,
        link: LinkId,
        frame: &Frame<'_>,
        out: &mut [u8; MAX_ENCODED],
    ) -> Option<usize> {
        if frame.kind == FrameKind::Reply as u8 {
            return None;
        }
        let (reply, version) = if !is_version_supported(frame.version) {
            let refusal =
                Refusal::Version { got: frame.version, device_min: MIN_VERSION, device_current: CURRENT_VERSION };
            (Reply::Refused(refusal), frame.version.clamp(MIN_VERSION, CURRENT_VERSION))
        } else if frame.kind != FrameKind::Request as u8 {
            (Reply::Refused(Refusal::Malformed), frame.version)
        } else {
            let reply = match postcard::from_bytes::<Request>(frame.body) {
                Ok(request) if request.introduced_in_version() <= frame.version => self
                    .do_due_work_answer_request_and_note_sign_of_life(board, link, &request, frame.version)
                    .unwrap_or_else(Reply::Refused),
                _ => Reply::Refused(Refusal::Malformed),
            };
            (translate_for_version(reply, frame.version), frame.version)
        };
        if matches!(reply, Reply::Refused(_)) {
            self.counters.refused = self.counters.refused.wrapping_add(1);
        }
        encode_frame(version, FrameKind::Reply, frame.sequence, &reply, out).ok()
    }

    fn count_decoded_frame_and_answer_if_valid(
        &mut self,
        board: &mut impl Board,
        link: LinkId,
        result: Result<Frame<'_>, DecodeError>,
        out: &mut [u8; MAX_ENCODED],
    ) -> Option<usize> {
        match result {
            Ok(frame) => {
                self.counters.good_frames = self.counters.good_frames.wrapping_add(1);
                self.answer_frame(board, link, &frame, out)
            }
            Err(_) => {
                // A broken frame's sequence number cannot be trusted, so the host's time-out has to notice it.
                self.counters.bad_frames = self.counters.bad_frames.wrapping_add(1);
                None
            }
        }
    }

    /// Switches everything off, and forgets everything that could switch it on again.
    fn switch_all_off(&mut self, board: &mut impl Board, now_us: u64) {
        board.switch_outputs_off();
        if self.supply.is_enabled_or_any_discharge_open() {
            // Only from the moment at which it was switched off: asking again does not give the discharge more time.
            (self.off_since_us, self.discharges_slowly, self.still_charged) = (now_us, false, false);
            let set_millivolts = self.supply.set_point_millivolts;
            self.off_millivolts = core::array::from_fn(|rail| {
                let number = |values: &[u32; RAILS]| values.get(rail).copied().unwrap_or(0);
                number(&set_millivolts).max(number(&self.measured_millivolts))
            });
            // A rail that is not where it was set may be measured wrongly: a broken divider shows nothing.
            self.distrusted |= self.watch.is_any_rail_off_set_point_or_was_lately();
        }
        self.supply = SupplyCommand::OFF;
        board.apply_supply_command(&self.supply);
        self.self_test = None;
        self.held = None;
        self.sequencer = None;
        self.connected = false;
        self.rails.zero_targets_and_set_points();
        self.watch.forget_history();
        self.current.forget_history();
        self.active = [None; MAX_CHANNELS];
        // Whoever repeats a request now is told that nothing is live.
        self.played.clear();
        self.store_run_record_for_next_boot(board, false);
    }

    fn store_run_record_for_next_boot(&self, board: &mut impl Board, is_live: bool) {
        board.store_run_record_for_next_boot(KeptRun {
            is_live,
            is_measurement_distrusted: self.distrusted,
            credit_ms: core::array::from_fn(|channel| self.budget.remaining_credit_ms(channel)),
        });
    }
}
