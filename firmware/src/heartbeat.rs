//! The heartbeat LED, driven from the device's own tick: while it blinks, silence is being watched for.

use crate::outputs::{configure_as_low_output, set_pin_level};
use crate::pins::HEARTBEAT;
use era_shared::safety::SafetyState;

/// Blinks in a rhythm that tells the safety state.
pub struct Heartbeat {
    on: bool,
}

impl Heartbeat {
    /// An LED that is off.
    pub fn new() -> Self {
        configure_as_low_output(HEARTBEAT);
        Self { on: false }
    }

    /// Sets the LED for this state and time. To be called every ms or so.
    pub fn update_led(&mut self, state: SafetyState, now_us: u64) {
        // Period and on-time in ms: slow flashes while off, even blinking while high voltage may be present, fast for a
        // fault.
        let (period_ms, on_ms) = match state {
            SafetyState::Boot | SafetyState::Safe => (2_000, 100),
            SafetyState::Arming | SafetyState::Armed | SafetyState::Discharging => (1_000, 500),
            SafetyState::Running => (250, 125),
            SafetyState::Fault => (100, 50),
        };
        let on = now_us / 1000 % period_ms < on_ms;
        if on != self.on {
            self.on = on;
            set_pin_level(HEARTBEAT, on);
        }
    }
}
