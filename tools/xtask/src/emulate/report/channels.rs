//! Which timer drives which electrodes.

use era_shared::waveform::OutputPair;

/// A channel's timer (the pin table in `firmware/src/pins.rs`).
#[derive(Clone, Copy, Debug)]
pub struct Channel {
    /// Its timer.
    pub timer: &'static str,
    /// Which of the timer's channels are connected to the electrodes.
    pub outputs: OutputPair,
    /// Whether it has a main output enable and a break.
    pub has_break: bool,
}

/// In the order of the channels.
pub const CHANNELS: [Channel; 4] = [
    Channel { timer: "TIM1", outputs: OutputPair { a: 1, b: 3 }, has_break: true },
    Channel { timer: "TIM8", outputs: OutputPair { a: 1, b: 4 }, has_break: true },
    Channel { timer: "TIM20", outputs: OutputPair { a: 1, b: 3 }, has_break: true },
    Channel { timer: "TIM4", outputs: OutputPair { a: 1, b: 4 }, has_break: false },
];
