//! The device's behaviour: what a frame does, and what silence does. The firmware and the simulated device run this
//! code unchanged.

mod answers;
mod live;

use crate::MAX_CHANNELS;
use crate::board::Board;
use crate::link::{DecodeError, Decoder, Frame, Kind, MAX_ENCODED, encode};
use crate::protocol::{
    AchievedDrive, CURRENT_VERSION, FaultCode, LinkCounters, MIN_VERSION, Refusal, Reply, Request, for_version, speaks,
};
use crate::safety::{Budget, Event, LinkId, Safety, SelfTest, State};
use crate::supply::{RailControl, Supply, Watch};
use crate::waveform::{Goal, Sequencer};

/// One goal per channel; `None` is off.
type Goals = [Option<Goal>; MAX_CHANNELS];

/// The receiving side of one link: its decoder and its name.
#[derive(Clone, Debug)]
pub struct Port {
    id: LinkId,
    decoder: Decoder,
}

impl Port {
    /// A port that has received nothing.
    #[must_use]
    pub const fn new(id: LinkId) -> Self {
        Self { id, decoder: Decoder::new() }
    }

    /// Forgets a frame that was begun: for a link that was closed and opened again.
    pub fn reset(&mut self) {
        self.decoder.reset();
    }
}

/// The device over a [`Board`].
#[derive(Clone, Debug)]
pub struct Device {
    safety: Safety,
    counters: LinkCounters,
    /// When the senses are looked at next, in us.
    next_tick_us: u64,
    /// When the supply was last switched off, in us: the rails must be discharged in time.
    off_since_us: u64,
    /// They were not.
    still_charged: bool,
    /// What is measured of the rails was found wrong.
    distrusted: bool,
    self_test: Option<SelfTest>,
    /// Drives that were set while arming, to begin once it is done.
    held: Option<Goals>,
    /// There while the timers run.
    sequencer: Option<Sequencer>,
    connected: bool,
    rails: RailControl,
    /// What the supply was last told.
    supply: Supply,
    /// The rails as they were last measured.
    measured_millivolts: [u32; crate::supply::RAILS],
    watch: Watch,
    budget: Budget,
    active: [Option<AchievedDrive>; MAX_CHANNELS],
}

impl Default for Device {
    fn default() -> Self {
        Self::new()
    }
}

impl Device {
    /// A device that has not started: everything but questions is refused until [`Device::start`].
    #[must_use]
    pub const fn new() -> Self {
        Self {
            safety: Safety::new(),
            counters: LinkCounters { good_frames: 0, bad_frames: 0, refused: 0 },
            next_tick_us: 0,
            off_since_us: 0,
            still_charged: false,
            distrusted: false,
            self_test: None,
            held: None,
            sequencer: None,
            connected: false,
            rails: RailControl::new(),
            supply: Supply {
                enabled: false,
                discharge: [true; crate::supply::RAILS],
                set_point_millivolts: [0; crate::supply::RAILS],
            },
            measured_millivolts: [0; crate::supply::RAILS],
            watch: Watch::new(),
            budget: Budget::new(),
            active: [None; MAX_CHANNELS],
        }
    }

    /// Ends start-up: outputs off, then `Discharging` until the rails are seen to be harmless, or `Fault` if the previous
    /// run ended in one.
    pub fn start(&mut self, board: &mut impl Board) {
        // Only Boot accepts this event, so a second call changes nothing but switches off once more.
        let now_us = board.now_us();
        let _ = self.safety.on(Event::BootComplete);
        self.off_since_us = now_us;
        self.all_off(board, now_us);
        if let Some((code, detail)) = board.info().fault_before_reset {
            self.raise(board, code, detail, 0);
        }
    }

    /// The safety state.
    #[must_use]
    pub const fn state(&self) -> State {
        self.safety.state()
    }

    /// Takes bytes as they come from a link and gives every answer, ready for the wire, to `send`.
    pub fn receive(&mut self, board: &mut impl Board, port: &mut Port, bytes: &[u8], mut send: impl FnMut(&[u8])) {
        let id = port.id;
        port.decoder.feed(bytes, |result| {
            let mut out = [0_u8; MAX_ENCODED];
            if let Some(length) = self.handle_result(board, id, result, &mut out)
                && let Some(answer) = out.get(..length)
            {
                send(answer);
            }
        });
    }

    /// Everything off, and the reason latched: for faults that the board itself finds.
    pub fn raise(&mut self, board: &mut impl Board, code: FaultCode, detail: u32, now_us: u64) {
        // Off before anything is noted down.
        self.all_off(board, now_us);
        self.distrusted |= matches!(
            code,
            FaultCode::OverVoltage | FaultCode::RailImplausible | FaultCode::RailCollapsed | FaultCode::DischargeFailed
        );
        let _off_already = self.safety.raise(code, detail, now_us);
    }

    /// Carries out one frame and writes the answer, a whole encoded frame, to `out`; returns its length. Frames that are
    /// not requests are not answered: answering an answer could go on for ever.
    pub fn handle_frame(
        &mut self,
        board: &mut impl Board,
        link: LinkId,
        frame: &Frame<'_>,
        out: &mut [u8; MAX_ENCODED],
    ) -> Option<usize> {
        if frame.kind == Kind::Reply as u8 {
            return None;
        }
        let (reply, version) = if !speaks(frame.version) {
            let refusal =
                Refusal::Version { got: frame.version, device_min: MIN_VERSION, device_current: CURRENT_VERSION };
            (Reply::Refused(refusal), frame.version.clamp(MIN_VERSION, CURRENT_VERSION))
        } else if frame.kind != Kind::Request as u8 {
            (Reply::Refused(Refusal::Malformed), frame.version)
        } else {
            let reply = match postcard::from_bytes::<Request>(frame.body) {
                Ok(request) if request.since() <= frame.version => {
                    self.answer(board, link, &request, frame.version).unwrap_or_else(Reply::Refused)
                }
                _ => Reply::Refused(Refusal::Malformed),
            };
            (for_version(reply, frame.version), frame.version)
        };
        if matches!(reply, Reply::Refused(_)) {
            self.counters.refused = self.counters.refused.wrapping_add(1);
        }
        encode(version, Kind::Reply, frame.sequence, &reply, out).ok()
    }

    fn handle_result(
        &mut self,
        board: &mut impl Board,
        link: LinkId,
        result: Result<Frame<'_>, DecodeError>,
        out: &mut [u8; MAX_ENCODED],
    ) -> Option<usize> {
        match result {
            Ok(frame) => {
                self.counters.good_frames = self.counters.good_frames.wrapping_add(1);
                self.handle_frame(board, link, &frame, out)
            }
            Err(_) => {
                // A broken frame's sequence number cannot be trusted, so the host's time-out has to notice it.
                self.counters.bad_frames = self.counters.bad_frames.wrapping_add(1);
                None
            }
        }
    }

    /// Everything off, and everything forgotten that could switch it on again.
    fn all_off(&mut self, board: &mut impl Board, now_us: u64) {
        board.outputs_off();
        if self.supply.enabled {
            // Only from the moment at which it was switched off: asking again does not give the discharge more time.
            (self.off_since_us, self.still_charged) = (now_us, false);
        }
        self.supply = Supply { discharge: [true; crate::supply::RAILS], ..Supply::default() };
        board.set_supply(&self.supply);
        self.self_test = None;
        self.held = None;
        self.sequencer = None;
        self.connected = false;
        self.rails.reset();
        self.watch.reset();
        self.active = [None; MAX_CHANNELS];
    }
}
