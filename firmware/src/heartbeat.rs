//! The heartbeat LED, driven from the device's own tick: while it blinks, silence is being watched for.

use crate::outputs::{set_level, set_low_output};
use crate::pins::HEARTBEAT;
use era_shared::safety::State;

/// Blinks in a rhythm that tells the safety state.
pub struct Heartbeat {
    on: bool,
}

impl Heartbeat {
    /// An LED that is off.
    pub fn new() -> Self {
        set_low_output(HEARTBEAT);
        Self { on: false }
    }

    /// To be called every ms or so.
    pub fn show(&mut self, state: State, now_us: u64) {
        // Period and on-time in ms: slow flashes while off, even blinking while high voltage may be present, fast for a
        // fault.
        let (period_ms, on_ms) = match state {
            State::Boot | State::Safe => (2_000, 100),
            State::Arming | State::Armed | State::Discharging => (1_000, 500),
            State::Running => (250, 125),
            State::Fault => (100, 50),
        };
        let on = now_us / 1000 % period_ms < on_ms;
        if on != self.on {
            self.on = on;
            set_level(HEARTBEAT, on);
        }
    }
}
