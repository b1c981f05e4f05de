//! What a target's timers do at the electrodes, where that can be observed, and the checks that need it.

use era::device::emulated::{CHANNEL_TIMERS, EmulatedBoard, EmulatedError};
use era::device::sim::{ActivePeriod, SimOutputs};
use era_shared::waveform::{ElectrodeWindows, TimerRegisters};
use serde_json::json;
use std::collections::BTreeMap;

/// A check that needs more than the device's answers: what its outputs do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum OutputCheck {
    /// Timers energise electrodes in the state running, and in no other.
    Energised,
    /// Every electrode's pin is held low.
    PinsLow,
    /// The electrodes' windows are those of the drives.
    Windows,
    /// Two drives of one frequency have the distance of their phases.
    Phase,
    /// Those channels drive that play an effect.
    Effects,
}

impl OutputCheck {
    /// All checks of outputs.
    pub const ALL: [OutputCheck; 5] =
        [OutputCheck::Energised, OutputCheck::PinsLow, OutputCheck::Windows, OutputCheck::Phase, OutputCheck::Effects];

    /// As reports name it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            OutputCheck::Energised => "energised",
            OutputCheck::PinsLow => "pins low",
            OutputCheck::Windows => "windows",
            OutputCheck::Phase => "phase",
            OutputCheck::Effects => "effects",
        }
    }
}

/// Checks of outputs, and whether each was observed.
pub(crate) type CheckRecord = BTreeMap<OutputCheck, bool>;

/// What the timer of one channel does at one time.
#[derive(Clone, Debug)]
pub struct ChannelOutputs {
    /// Whether it counts and reaches the electrodes.
    pub energised: bool,
    /// Its windows, or why it has none.
    pub windows: Result<ElectrodeWindows, String>,
    /// Ticks since its period began.
    pub position_ticks: f64,
    /// The pins of its electrodes that are not outputs held low, each with what it is.
    pub pins_not_low: Vec<String>,
}

pub(crate) fn read_emulated_outputs(board: &EmulatedBoard) -> Result<Vec<ChannelOutputs>, EmulatedError> {
    let registers = board.read_channel_timers_with_main_output_bit_masked_by_pins()?;
    let timers = board.send_bridge_command_and_await_answer(&json!({"op": "timers"}))?;
    let pins = board.send_bridge_command_and_await_answer(&json!({"op": "pins"}))?;
    let convert = |((era, timer), registers): ((u32, &str), &TimerRegisters)| {
        let names = [format!("era{era}_a"), format!("era{era}_b")];
        let not_low = names.iter().filter_map(|name| {
            let pin = &pins["pins"][name];
            (pin["mode"] != "output" || pin["high"] != false).then(|| format!("{name}: {pin}"))
        });
        let no_counter =
            || EmulatedError::Control { op: "timers".into(), reason: format!("{timer}'s register cnt is missing") };
        Ok(ChannelOutputs {
            energised: registers.is_counting_with_outputs_enabled(),
            windows: ElectrodeWindows::from_registers(registers).map_err(|error| format!("{error:?}")),
            position_ticks: timers["timers"][timer]["cnt"].as_f64().ok_or_else(no_counter)?,
            pins_not_low: not_low.collect(),
        })
    };
    (1..).zip(CHANNEL_TIMERS).zip(&registers).map(convert).collect()
}

pub(crate) fn convert_simulated_outputs(outputs: &SimOutputs) -> Vec<ChannelOutputs> {
    let convert = |(era, active): (u32, &Option<ActivePeriod>)| {
        let energised = outputs.connected && active.is_some();
        let pins = [format!("era{era}_a: driven by its timer"), format!("era{era}_b: driven by its timer")];
        ChannelOutputs {
            energised,
            windows: active.map(|active| active.windows).ok_or_else(|| "the timer does not run".into()),
            position_ticks: active.map_or(0.0, |active| active.position_ticks),
            pins_not_low: if energised { pins.into() } else { Vec::new() },
        }
    };
    (1..).zip(&outputs.active_periods).map(convert).collect()
}
