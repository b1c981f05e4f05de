//! Hardware that is broken on purpose, where a target can.

use crate::bench::{Bench, CaseResult};
use era::device::sim::{BrokenElectrode, Defects, ElectrodeFault, SimKnobs};
use era_shared::waveform::Electrode;
use serde_json::json;
use std::time::Duration;

impl Bench {
    /// Breaks the hardware in one way: on the simulated device by its knobs, on the emulated board by faults injected into
    /// it.
    ///
    /// # Errors
    /// If the emulator fails, or the target's hardware cannot be broken from here.
    pub fn break_hardware(&self, breakage: Breakage) -> Result<BrokenHardware<'_>, String> {
        if let Some(control) = self.device.sim_control_if_simulated() {
            control.set_knobs(SimKnobs { defects: breakage.to_sim_defects(), ..SimKnobs::default() });
            // The device looks at its knobs every ms.
            std::thread::sleep(Duration::from_millis(20));
        } else {
            self.inject_fault(&breakage.to_emulator_fault())?;
        }
        Ok(BrokenHardware(self))
    }

    fn inject_fault(&self, fault: &serde_json::Value) -> CaseResult {
        let board =
            self.device.emulated_board_if_emulated().ok_or("this target's hardware cannot be broken from here")?;
        let mut command = fault.clone();
        command["op"] = "inject".into();
        board.send_bridge_command_and_await_answer(&command).map(|_| ()).map_err(|error| error.to_string())
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
    /// Electrode A of the first channel is not connected any more.
    OpenElectrode,
    /// It has a short to earth behind its resistor.
    ShortedElectrode,
    /// Its lower switch does not close.
    OpenLowerSwitch,
}

impl Breakage {
    fn to_sim_defects(self) -> Defects {
        let none = Defects::default();
        let broken = |fault| Some(BrokenElectrode { channel: 0, electrode: Electrode::A, fault });
        match self {
            Breakage::Interlock => Defects { interlock_open: true, ..none },
            Breakage::EmergencyStop => Defects { stop_pressed: true, ..none },
            Breakage::Earth => Defects { earth_open: true, ..none },
            Breakage::Short => Defects { shorted_rail: Some(0), ..none },
            Breakage::Leakage => Defects { leakage_microamps: 1_000, ..none },
            Breakage::StoppedTimer => Defects { stopped_timer: Some(1), ..none },
            Breakage::OpenElectrode => Defects { broken_electrode: broken(ElectrodeFault::Open), ..none },
            Breakage::ShortedElectrode => Defects { broken_electrode: broken(ElectrodeFault::Shorted), ..none },
            Breakage::OpenLowerSwitch => Defects { broken_electrode: broken(ElectrodeFault::LowerOpen), ..none },
        }
    }

    /// As the emulator's `inject` takes it.
    fn to_emulator_fault(self) -> serde_json::Value {
        match self {
            Breakage::Interlock => json!({"interlock": "open"}),
            Breakage::EmergencyStop => json!({"estop": "pressed"}),
            Breakage::Earth => json!({"earth": "open"}),
            Breakage::Short => json!({"rail_fault": {"rail": 1, "volts": 0}}),
            Breakage::Leakage => json!({"average_ma": 1.0}),
            Breakage::StoppedTimer => json!({"stall": {"timer": "TIM8", "on": true}}),
            Breakage::OpenElectrode => json!({"electrode": {"era": 1, "electrode": "a", "is": "open"}}),
            Breakage::ShortedElectrode => json!({"electrode": {"era": 1, "electrode": "a", "is": "shorted"}}),
            Breakage::OpenLowerSwitch => json!({"electrode": {"era": 1, "electrode": "a", "is": "lower_open"}}),
        }
    }
}

/// Mends the hardware when it is dropped.
#[derive(Debug)]
pub struct BrokenHardware<'a>(&'a Bench);

impl Drop for BrokenHardware<'_> {
    fn drop(&mut self) {
        if let Some(control) = self.0.device.sim_control_if_simulated() {
            control.set_knobs(SimKnobs::default());
            std::thread::sleep(Duration::from_millis(20));
        } else if let Err(error) = self.0.inject_fault(&json!({"heal": true})) {
            // The next case will find the board broken, and say so.
            eprintln!("the injected faults could not be removed from the emulated board: {error}");
        }
    }
}
