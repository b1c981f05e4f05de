//! The device's behaviour: what a frame does, and what silence does. The firmware and the simulated device run this
//! code unchanged.

use crate::MAX_CHANNELS;
use crate::board::{Board, Programs};
use crate::link::{DecodeError, Decoder, Frame, Kind, MAX_ENCODED, encode};
use crate::protocol::{
    AchievedDrive, CURRENT_VERSION, ChannelDrive, ChannelStatus, FaultCode, HelloReply, LinkCounters, MIN_VERSION,
    Refusal, Reply, Request, StatusReply, TelemetryReply, speaks,
};
use crate::safety::{Action, DEADMAN_DEFAULT_MS, DEADMAN_MAX_MS, DEADMAN_MIN_MS, Event, LinkId, Safety, State};
use crate::waveform::{DriveError, program};
use heapless::Vec;

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
#[derive(Clone, Debug, Default)]
pub struct Device {
    safety: Safety,
    active: [Option<AchievedDrive>; MAX_CHANNELS],
    counters: LinkCounters,
}

impl Device {
    /// A device that has not started: everything but questions is refused until [`Device::start`].
    #[must_use]
    pub const fn new() -> Self {
        Self {
            safety: Safety::new(),
            active: [None; MAX_CHANNELS],
            counters: LinkCounters { good_frames: 0, bad_frames: 0, refused: 0 },
        }
    }

    /// Ends start-up: outputs off, then `Safe`, or `Fault` if the previous run ended in one.
    pub fn start(&mut self, board: &mut impl Board) {
        // Only Boot accepts this event, so a second call changes nothing but switches off once more.
        let action = self.safety.on(Event::BootComplete).unwrap_or(Action::Off);
        let _ = self.carry_out(board, action, &Programs::default());
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

    /// To be called at least every few ms: switches everything off when the host that armed has fallen silent.
    pub fn poll(&mut self, board: &mut impl Board) {
        let now_us = board.now_us();
        if let Some(silence_us) = self.safety.silent_for_us(now_us) {
            let silence_ms = u32::try_from(silence_us / 1000).unwrap_or(u32::MAX);
            self.raise(board, FaultCode::HostSilent, silence_ms, now_us);
        }
    }

    /// Everything off, and the reason latched: for faults that the board itself finds.
    pub fn raise(&mut self, board: &mut impl Board, code: FaultCode, detail: u32, now_us: u64) {
        // Off before anything is noted down.
        board.outputs_off();
        self.active = [None; MAX_CHANNELS];
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
                Ok(request) => self.answer(board, link, &request).unwrap_or_else(Reply::Refused),
                Err(_) => Reply::Refused(Refusal::Malformed),
            };
            (reply, frame.version)
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

    fn answer(&mut self, board: &mut impl Board, link: LinkId, request: &Request) -> Result<Reply, Refusal> {
        // Silence that has lasted too long is acted on before the frame that ends it: a late keep-alive must not
        // revive a drive.
        self.poll(board);
        let now_us = board.now_us();
        self.safety.heard(link, now_us);
        match request {
            Request::Hello { .. } => Ok(Reply::Hello(hello(board))),
            Request::Arm { deadman_ms } => self.arm(board, link, *deadman_ms, now_us),
            Request::Disarm => self.step(board, Event::Disarm, &Programs::default()).map(|()| Reply::Disarmed),
            Request::SetDrives { drives } => self.set_drives(board, link, drives),
            Request::Stop => self.step(board, Event::Stop, &Programs::default()).map(|()| Reply::Stopped),
            Request::KeepAlive => Ok(Reply::Alive { state: self.state() }),
            Request::Status => Ok(Reply::Status(self.status(board, now_us))),
            Request::Faults => Ok(Reply::Faults { latched: self.safety.fault() }),
            Request::ClearFaults => self.step(board, Event::Clear, &Programs::default()).map(|()| Reply::FaultsCleared),
            Request::Telemetry => {
                let measured = board.measure();
                Ok(Reply::Telemetry(TelemetryReply {
                    uptime_us: now_us,
                    state: self.state(),
                    acceleration_peak_mm_per_s2: measured.acceleration_peak_mm_per_s2,
                    rail_millivolts: measured.rail_millivolts,
                }))
            }
        }
    }

    fn arm(
        &mut self,
        board: &mut impl Board,
        link: LinkId,
        deadman_ms: Option<u16>,
        now_us: u64,
    ) -> Result<Reply, Refusal> {
        if self.safety.held_by_other(link) {
            return Err(Refusal::OtherLink);
        }
        let deadman_ms = deadman_ms.unwrap_or(DEADMAN_DEFAULT_MS);
        if !(DEADMAN_MIN_MS..=DEADMAN_MAX_MS).contains(&deadman_ms) {
            return Err(Refusal::Deadman { requested_ms: deadman_ms, min_ms: DEADMAN_MIN_MS, max_ms: DEADMAN_MAX_MS });
        }
        self.step(board, Event::Arm, &Programs::default())?;
        self.safety.open_session(link, deadman_ms, now_us);
        Ok(Reply::Armed { deadman_ms })
    }

    fn set_drives(&mut self, board: &mut impl Board, link: LinkId, drives: &[ChannelDrive]) -> Result<Reply, Refusal> {
        if self.safety.held_by_other(link) {
            return Err(Refusal::OtherLink);
        }
        // All are computed and checked before any is applied.
        let mut programs = Programs::default();
        let mut achieved = Vec::new();
        let limits = &board.info().channels;
        for drive in drives {
            let refuse = |error| Refusal::Drive { channel: drive.channel, error };
            let channels = u8::try_from(limits.len()).unwrap_or(u8::MAX);
            let no_such_channel = DriveError::NoSuchChannel { channels };
            let index = usize::from(drive.channel);
            let limit = limits.get(index).ok_or(refuse(no_such_channel))?;
            let place = programs.get_mut(index).ok_or(refuse(no_such_channel))?;
            if place.is_some() {
                return Err(Refusal::DuplicateChannel { channel: drive.channel });
            }
            let planned = program(limit, drive).map_err(refuse)?;
            *place = Some(planned);
            // As long as `drives`, which has the same capacity.
            let _ = achieved.push(planned.achieved);
        }
        let event = if drives.is_empty() { Event::Rest } else { Event::Drive };
        self.step(board, event, &programs)?;
        self.active = programs.map(|entry| entry.map(|planned| planned.achieved));
        Ok(Reply::DrivesSet { achieved })
    }

    /// Lets an event happen and carries out what the table says, or refuses.
    fn step(&mut self, board: &mut impl Board, event: Event, programs: &Programs) -> Result<(), Refusal> {
        let action = self.safety.on(event).map_err(|state| Refusal::State { state, event })?;
        self.carry_out(board, action, programs).map_err(|code| {
            let now_us = board.now_us();
            self.raise(board, code, event as u32, now_us);
            self.safety.fault().map_or(Refusal::Malformed, Refusal::Fault)
        })
    }

    fn carry_out(&mut self, board: &mut impl Board, action: Action, programs: &Programs) -> Result<(), FaultCode> {
        match action {
            Action::Keep => Ok(()),
            Action::Off => {
                board.outputs_off();
                self.active = [None; MAX_CHANNELS];
                Ok(())
            }
            Action::Enable => board.arm(),
            Action::Apply => board.apply(programs),
        }
    }

    fn status(&self, board: &impl Board, uptime_us: u64) -> StatusReply {
        let info = board.info();
        StatusReply {
            state: self.state(),
            uptime_us,
            boot_id: info.boot_id,
            fault: self.safety.fault(),
            channels: self
                .active
                .iter()
                .take(info.channels.len())
                .map(|drive| ChannelStatus { drive: *drive })
                .collect(),
            link: self.counters,
        }
    }
}

fn hello(board: &impl Board) -> HelloReply {
    let info = board.info();
    HelloReply {
        protocol_min: MIN_VERSION,
        protocol_current: CURRENT_VERSION,
        board: info.board,
        board_id: info.board_id,
        boot_id: info.boot_id,
        reset_cause: info.reset_cause,
        firmware: info.firmware,
        channels: info.channels.clone(),
        default_deadman_ms: DEADMAN_DEFAULT_MS,
    }
}
