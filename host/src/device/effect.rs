//! The effects that have names.

use era_shared::protocol::AchievedDrive;
use era_shared::waveform::{Effect, FULL_LEVEL, Segment};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Cycles of a click's push: three build up most of what a panel with a loss factor of some per cent can do in so short a
/// time.
const PUSH: u16 = 3;
/// Reversed cycles that brake it. Fewer than built it up: it has decayed meanwhile.
const BRAKE: u16 = 2;
/// Between the clicks of a double click, in ms: clearly two, and still one gesture.
const BETWEEN_MS: u16 = 80;

/// An effect by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum NamedEffect {
    /// Three cycles, braked by two reversed ones.
    Click,
    /// Two clicks, 80 ms apart.
    DoubleClick,
    /// Rises for 200 ms, holds for 100 ms, falls for 200 ms.
    Swell,
    /// Five pulses of 30 ms, 30 ms apart.
    PulseTrain,
}

impl NamedEffect {
    /// What the board plays.
    #[must_use]
    pub fn effect(self) -> Effect {
        match self {
            NamedEffect::Click => Effect::click(PUSH, BRAKE),
            NamedEffect::DoubleClick => {
                let click = [
                    Segment::Cycles { level: FULL_LEVEL, count: PUSH },
                    Segment::Cycles { level: -FULL_LEVEL, count: BRAKE },
                    Segment::Hold { level: 0, milliseconds: BETWEEN_MS },
                ];
                Effect { segments: click.into_iter().collect(), times: 2 }
            }
            NamedEffect::Swell => Effect::swell(200, 100, 200),
            NamedEffect::PulseTrain => Effect::pulse_train(30, 30, 5),
        }
    }
}

/// How long an effect lasts on a drive.
#[must_use]
#[allow(clippy::cast_precision_loss, reason = "nanohertz up to 1e12 are exact in an f64")]
pub fn length(effect: &Effect, drive: &AchievedDrive) -> Duration {
    let period_s = 1e9 / drive.frequency_nanohertz.max(1) as f64;
    let seconds = |segment: &Segment| match *segment {
        Segment::Hold { milliseconds, .. } | Segment::Ramp { milliseconds, .. } => f64::from(milliseconds) / 1e3,
        Segment::Cycles { count, .. } => f64::from(count) * period_s,
    };
    let once: f64 = effect.segments.iter().map(seconds).sum();
    Duration::try_from_secs_f64(once * f64::from(effect.times)).unwrap_or(Duration::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum;

    #[test]
    fn named_effects_are_what_the_board_takes() {
        let drive = AchievedDrive {
            channel: 0,
            frequency_nanohertz: 200_000_000_000,
            pulse_width_ppm: 0,
            phase_microturns: 0,
            guard_ns: 0,
            voltage_millivolts: 0,
        };
        let lengths_ms = [25, 210, 500, 300];
        for (named, wanted_ms) in NamedEffect::value_variants().iter().zip(lengths_ms) {
            let effect = named.effect();
            assert!(effect.is_valid(), "{named:?}");
            assert_eq!(length(&effect, &drive), Duration::from_millis(wanted_ms), "{named:?}");
        }
    }
}
