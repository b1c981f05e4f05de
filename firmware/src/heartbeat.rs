//! The heartbeat LED, driven from the device's own tick: while it blinks, silence is being watched for.

use crate::outputs::set_low_output;
use crate::pins::HEARTBEAT;
use era_shared::safety::State;

/// Blinks in a rhythm that tells the safety state.
pub struct Heartbeat {
    milliseconds: u32,
}

impl Heartbeat {
    /// An LED that is off.
    pub fn new() -> Self {
        set_low_output(HEARTBEAT);
        Self { milliseconds: 0 }
    }

    /// To be called once a millisecond.
    pub fn tick(&mut self, state: State) {
        // Period and on-time in ms: slow flashes while off, even blinking while high voltage may be present, fast for a
        // fault.
        let (period, on) = match state {
            State::Boot | State::Safe => (2_000, 100),
            State::Armed => (1_000, 500),
            State::Running => (250, 125),
            State::Fault => (100, 50),
        };
        self.milliseconds = (self.milliseconds + 1) % period;
        if self.milliseconds == 0 || self.milliseconds == on {
            HEARTBEAT.port.bsrr().write(|w| {
                if self.milliseconds == 0 { w.set_bs(HEARTBEAT.number, true) } else { w.set_br(HEARTBEAT.number, true) }
            });
        }
    }
}
