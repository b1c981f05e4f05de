//! State, first fault and dead-man timer in one place.

use super::table::{Action, Event, Outcome, State, transition};
use crate::limits::{DEADMAN_MAX_MS, DEADMAN_MIN_MS};
use crate::protocol::{Fault, FaultCode};

/// Which link a command came from (UART, USB, ...). Only the one that armed can drive, and its silence counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinkId(pub u8);

#[derive(Clone, Copy, Debug)]
struct Session {
    link: LinkId,
    deadman_us: u64,
    last_heard_us: u64,
}

/// The safety state of the board.
#[derive(Clone, Debug)]
pub struct Safety {
    state: State,
    fault: Option<Fault>,
    session: Option<Session>,
}

impl Default for Safety {
    fn default() -> Self {
        Self::new()
    }
}

impl Safety {
    /// As at power-on.
    #[must_use]
    pub const fn new() -> Self {
        Self { state: State::Boot, fault: None, session: None }
    }

    /// The state now.
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// The latched fault.
    #[must_use]
    pub const fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// Whether another link than `link` has armed the board.
    #[must_use]
    pub fn held_by_other(&self, link: LinkId) -> bool {
        self.session.is_some_and(|session| session.link != link)
    }

    /// Lets `event` happen and says what to do.
    ///
    /// # Errors
    /// The state in which the event is refused; nothing has changed.
    pub fn on(&mut self, event: Event) -> Result<Action, State> {
        match transition(self.state, event) {
            Outcome::Refuse => Err(self.state),
            Outcome::Go(next, action) => {
                self.state = next;
                if !next.is_live() {
                    self.session = None;
                }
                if event == Event::Clear {
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
        self.session = Some(Session { link, deadman_us, last_heard_us: now_us });
    }

    /// Notes a sign of life; only one from the link that armed counts.
    pub fn heard(&mut self, link: LinkId, now_us: u64) {
        if let Some(session) = self.session.as_mut().filter(|session| session.link == link) {
            session.last_heard_us = now_us;
        }
    }

    /// The silence in us if it has lasted too long. A live state without a session is a contradiction and counts as
    /// silence without end.
    #[must_use]
    pub fn silent_for_us(&self, now_us: u64) -> Option<u64> {
        if !self.state.is_live() {
            return None;
        }
        match self.session {
            None => Some(u64::MAX),
            Some(session) => {
                let silence = now_us.saturating_sub(session.last_heard_us);
                (silence >= session.deadman_us).then_some(silence)
            }
        }
    }

    /// Latches a fault (the first reason is kept, later ones are counted) and says what to do: always
    /// [`Action::Off`].
    pub fn raise(&mut self, code: FaultCode, detail: u32, now_us: u64) -> Action {
        match &mut self.fault {
            Some(fault) => fault.count = fault.count.saturating_add(1),
            none => *none = Some(Fault { code, at_us: now_us, detail, count: 1 }),
        }
        let event = if code == FaultCode::HostSilent { Event::HostSilent } else { Event::Fault };
        // The table refuses neither event in any state (tested), but a doubt must end in "off" all the same.
        self.on(event).unwrap_or(Action::Off)
    }
}
