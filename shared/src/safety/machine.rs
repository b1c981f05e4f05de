//! State, first fault and dead-man timer in one place.

use super::table::{SafetyAction, SafetyEvent, SafetyState, Transition, look_up_transition};
use crate::limits::{DEADMAN_MAX_MS, DEADMAN_MIN_MS};
use crate::protocol::{Fault, FaultCode};

/// Which link a command came from (UART, USB, ...). Only the one that armed can drive, and its silence counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinkId(pub u8);

impl LinkId {
    /// The name of the link at this place: every link has a name of its own, or one could keep alive what another has armed. There are at most 256.
    #[must_use]
    pub const fn from_index(index: usize) -> Self {
        Self(index as u8)
    }
}

/// Whether a host that has been silent for `silence_us` has exceeded its dead-man time. Never more than [`DEADMAN_MAX_MS`] counts: a time that has
/// become longer by itself, because a bit of the memory has changed, must not keep a board live.
#[must_use]
pub const fn is_silence_over_deadman_or_its_maximum(silence_us: u64, deadman_us: u64) -> bool {
    silence_us >= deadman_us || silence_us >= DEADMAN_MAX_MS as u64 * 1000
}

#[derive(Clone, Copy, Debug)]
struct ArmedSession {
    link: LinkId,
    deadman_us: u64,
    last_heard_us: u64,
}

/// The safety state of the board.
#[derive(Clone, Debug)]
pub struct SafetyMachine {
    state: SafetyState,
    fault: Option<Fault>,
    /// The number of the fault that was latched last.
    fault_number: u32,
    session: Option<ArmedSession>,
}

impl Default for SafetyMachine {
    fn default() -> Self {
        Self::new()
    }
}

impl SafetyMachine {
    /// The state at power-on.
    #[must_use]
    pub const fn new() -> Self {
        Self { state: SafetyState::Boot, fault: None, fault_number: 0, session: None }
    }

    /// The state now.
    #[must_use]
    pub const fn state(&self) -> SafetyState {
        self.state
    }

    /// The latched fault.
    #[must_use]
    pub const fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// Has faults be numbered from the one after `boot_id`, which differs from start to start: whoever clears a fault of an earlier run by its
    /// number does not clear one of this run.
    pub const fn number_faults_after_boot_id(&mut self, boot_id: u32) {
        self.fault_number = boot_id;
    }

    /// The number of the fault that was latched last: the boot id plus how many faults were latched since the start.
    #[must_use]
    pub const fn sequence_number_of_last_latched_fault(&self) -> u32 {
        self.fault_number
    }

    /// Ends the session of a link that has been closed and opened again; whether it had one.
    pub fn close_session_of(&mut self, link: LinkId) -> bool {
        self.session.take_if(|session| session.link == link).is_some()
    }

    /// Whether another link than `link` has armed the board.
    #[must_use]
    pub fn is_armed_by_other_link(&self, link: LinkId) -> bool {
        self.session.is_some_and(|session| session.link != link)
    }

    /// Applies `event` to the state, and returns what the caller has to do.
    ///
    /// # Errors
    /// The state in which the event is refused; nothing has changed.
    pub fn apply_event(&mut self, event: SafetyEvent) -> Result<SafetyAction, SafetyState> {
        match look_up_transition(self.state, event) {
            Transition::Refuse => Err(self.state),
            Transition::Go(next, action) => {
                self.state = next;
                if !next.is_live() {
                    self.session = None;
                }
                if event == SafetyEvent::Clear {
                    self.fault = None;
                }
                Ok(action)
            }
        }
    }

    /// Starts, or renews, the session of the link that armed. `deadman_ms` must lie in
    /// [`DEADMAN_MIN_MS`]..=[`DEADMAN_MAX_MS`]; it is clamped to that whatever the caller checked.
    pub fn open_session(&mut self, link: LinkId, deadman_ms: u16, now_us: u64) {
        let deadman_us = u64::from(deadman_ms.clamp(DEADMAN_MIN_MS, DEADMAN_MAX_MS)) * 1000;
        self.session = Some(ArmedSession { link, deadman_us, last_heard_us: now_us });
    }

    /// Notes that the host at `link` is alive. Only the link that has armed the board counts.
    pub fn note_sign_of_life_if_link_has_armed(&mut self, link: LinkId, now_us: u64) {
        if let Some(session) = self.session.as_mut().filter(|session| session.link == link) {
            session.last_heard_us = now_us;
        }
    }

    /// The host's silence in us if it has exceeded the dead-man time. A live state without a session is a contradiction, and counts as
    /// endless silence.
    #[must_use]
    pub fn host_silence_us_if_over_deadman(&self, now_us: u64) -> Option<u64> {
        if !self.state.is_live() {
            return None;
        }
        match self.session {
            None => Some(u64::MAX),
            Some(session) => {
                let silence = now_us.saturating_sub(session.last_heard_us);
                is_silence_over_deadman_or_its_maximum(silence, session.deadman_us).then_some(silence)
            }
        }
    }

    /// Latches a fault: the first one is kept, later ones are counted. Returns what the caller has to do, which is always
    /// [`SafetyAction::Off`].
    pub fn latch_fault(&mut self, code: FaultCode, detail: u32, now_us: u64) -> SafetyAction {
        match &mut self.fault {
            Some(fault) => fault.count = fault.count.saturating_add(1),
            none => {
                *none = Some(Fault { code, at_us: now_us, detail, count: 1 });
                self.fault_number = self.fault_number.wrapping_add(1);
            }
        }
        let event = if code == FaultCode::HostSilent { SafetyEvent::HostSilent } else { SafetyEvent::Fault };
        // The table refuses neither event in any state (tested), but a doubt must end in "off" all the same.
        self.apply_event(event).unwrap_or(SafetyAction::Off)
    }
}
