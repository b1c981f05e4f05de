//! Hardware that is broken on purpose, where a target can.

use crate::bench::{Bench, Outcome};
use era::device::sim::{Defects, Knobs};
use serde_json::json;
use std::time::Duration;

impl Bench {
    /// Breaks the hardware in one way: on the simulated device by its knobs, on the emulated board by faults injected into
    /// it.
    ///
    /// # Errors
    /// If the emulator fails, or the target's hardware cannot be broken from here.
    pub fn break_it(&self, breakage: Breakage) -> Result<Broken<'_>, String> {
        if let Some(control) = self.device.sim() {
            control.set_knobs(Knobs { defects: breakage.defects(), ..Knobs::default() });
            // The device looks at its knobs every ms.
            std::thread::sleep(Duration::from_millis(20));
        } else {
            self.inject(&breakage.fault())?;
        }
        Ok(Broken(self))
    }

    fn inject(&self, fault: &serde_json::Value) -> Outcome {
        let board = self.device.emulated().ok_or("this target's hardware cannot be broken from here")?;
        let mut command = fault.clone();
        command["op"] = "inject".into();
        board.ask(&command).map(|_| ()).map_err(|error| error.to_string())
    }
}

/// A way to break the hardware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Breakage {
    /// The enclosure is opened.
    Interlock,
    /// The emergency stop is pressed.
    EmergencyStop,
    /// The bond to protective earth breaks.
    Earth,
    /// The first rail does not come up.
    Short,
    /// The supply delivers 1 mA on average.
    Leakage,
    /// The timer of the second channel stands still.
    StoppedTimer,
}

impl Breakage {
    fn defects(self) -> Defects {
        let none = Defects::default();
        match self {
            Breakage::Interlock => Defects { interlock_open: true, ..none },
            Breakage::EmergencyStop => Defects { stop_pressed: true, ..none },
            Breakage::Earth => Defects { earth_open: true, ..none },
            Breakage::Short => Defects { shorted_rail: Some(0), ..none },
            Breakage::Leakage => Defects { leakage_microamps: 1_000, ..none },
            Breakage::StoppedTimer => Defects { stopped_timer: Some(1), ..none },
        }
    }

    /// As the emulator's `inject` takes it.
    fn fault(self) -> serde_json::Value {
        match self {
            Breakage::Interlock => json!({"interlock": "open"}),
            Breakage::EmergencyStop => json!({"estop": "pressed"}),
            Breakage::Earth => json!({"earth": "open"}),
            Breakage::Short => json!({"rail_fault": {"rail": 1, "volts": 0}}),
            Breakage::Leakage => json!({"average_ma": 1.0}),
            Breakage::StoppedTimer => json!({"stall": {"timer": "TIM8", "on": true}}),
        }
    }
}

/// Mends the hardware when it is dropped.
#[derive(Debug)]
pub struct Broken<'a>(&'a Bench);

impl Drop for Broken<'_> {
    fn drop(&mut self) {
        if let Some(control) = self.0.device.sim() {
            control.set_knobs(Knobs::default());
            std::thread::sleep(Duration::from_millis(20));
        } else if let Err(error) = self.0.inject(&json!({"heal": true})) {
            // The next case will find the board broken, and say so.
            eprintln!("the emulated board could not be mended: {error}");
        }
    }
}
