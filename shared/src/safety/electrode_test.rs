//! What the self-test sees of each electrode alone.
//!
//! The rail stands at 50 V, its supply is disabled, and one electrode is switched to it several times. Each time it takes its charge
//! from the rail's own capacitance, so that the rail falls by C / (C + C_rail): 6 % for 116 pF at 1.8 nF. The rail's fall from after the
//! first pulse to after the last one therefore tells
//!
//! * whether the electrode is charged at all: otherwise the rail falls by its bleeders only,
//! * whether its lower switch discharges it: otherwise only the first pulse, which does not count, takes a charge,
//! * whether something draws current through its resistor of 1 Mohm, as a short or a lower switch that is on does: then the rail
//!   falls by far more.
//!
//! All of this is a ratio of two voltages of one divider. The supply's current would show the same much less clearly: 6 nC in some ms, in
//! steps of 0.5 uA and behind the supply's own regulation.

use crate::MAX_CHANNELS;
use crate::circuit::{
    BLEEDER_OHMS, ELECTRODE_OHMS, ELECTRODE_PICOFARADS, LOWER_SWITCH_OHMS, RAIL_PICOFARADS,
    RESISTANCE_TOLERANCE_PERCENT, TOLERANCE_PERCENT, add_percent, least_electrode_charge_permille, subtract_percent,
};
use crate::limits::{TEST_PAUSE_MICROSECONDS, TEST_PULSE_MICROSECONDS, TEST_PULSES};
use crate::protocol::FaultCode;
use crate::supply::FaultFinding;
use crate::waveform::Electrode;

/// What is added to the detail of an electrode that draws current, instead of taking no charge.
const DETAIL_DRAWS: u32 = 100;

/// How far a fall may be measured wrongly, in millionths of the voltage: two steps of the converter, 1.2 V, of at least 35 V. Each of the
/// two voltages is the mean of several conversions.
const MEASUREMENT_PPM: u64 = 35_000;

/// A rail's voltage around the pulses of one electrode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ElectrodePulses {
    /// After the first pulse, in mV.
    pub after_first_millivolts: u32,
    /// After the last one, in mV.
    pub after_last_millivolts: u32,
}

/// Parts that count in millionths: all of it.
const ONE_PPM: u64 = 1_000_000;

/// By how much a rail falls over the counted pulses if each takes `share_per_pulse_ppm` of what is left, in millionths.
const fn rail_fall_from_first_to_last_test_pulse_ppm(share_per_pulse_ppm: u64) -> u64 {
    let (mut left_ppm, mut pulse) = (ONE_PPM, 1);
    while pulse < TEST_PULSES {
        left_ppm = left_ppm * (ONE_PPM - share_per_pulse_ppm) / ONE_PPM;
        pulse += 1;
    }
    ONE_PPM - left_ppm
}

/// By how much a voltage falls at least in `elapsed_us` with this time constant, in millionths: 1 - exp(-x) > x - x^2 / 2.
const fn least_decay_ppm(elapsed_us: u64, time_constant_us: u64) -> u64 {
    let x_ppm = elapsed_us * ONE_PPM / time_constant_us;
    x_ppm - x_ppm * x_ppm / ONE_PPM / 2
}

/// The most that the bleeders take while the pulses are made, in millionths: 1 - exp(-x) < x.
const MOST_BLEED_PPM: u64 = {
    let elapsed_us = ((TEST_PULSES - 1) * (TEST_PULSE_MICROSECONDS + TEST_PAUSE_MICROSECONDS)) as u64;
    let ohms = subtract_percent(BLEEDER_OHMS as u64, RESISTANCE_TOLERANCE_PERCENT) / 2;
    elapsed_us * ONE_PPM / (ohms * subtract_percent(RAIL_PICOFARADS as u64, TOLERANCE_PERCENT) / 1_000_000)
};

/// A rail that falls by less over the pulses has charged no electrode, in millionths: half-way between what the bleeders take at most
/// and what the smallest electrode takes at least from the largest rail.
const fn missing_electrode_rail_fall_threshold_ppm(picofarads: u32) -> u64 {
    let (electrode, rail) = (
        subtract_percent(picofarads as u64, TOLERANCE_PERCENT),
        add_percent(RAIL_PICOFARADS as u64, TOLERANCE_PERCENT),
    );
    let charged_permille = least_electrode_charge_permille(TEST_PULSE_MICROSECONDS as u64 * 1_000) as u64;
    let share_ppm = electrode * charged_permille * 1_000 / (electrode + rail);
    let charged_ppm = rail_fall_from_first_to_last_test_pulse_ppm(share_ppm);
    assert!(
        charged_ppm >= MOST_BLEED_PPM + 2 * MEASUREMENT_PPM,
        "the test cannot detect an electrode with so small a capacitance"
    );
    (MOST_BLEED_PPM + charged_ppm) / 2
}

/// A rail that falls by more has been drawn down, in millionths: half-way between what the largest electrode takes at most from the
/// smallest rail, and what a path through the electrode's resistor and its lower switch takes at least from the largest.
const fn short_circuit_rail_fall_threshold_ppm(picofarads: u32) -> u64 {
    let (electrode, rail) = (
        add_percent(picofarads as u64, TOLERANCE_PERCENT),
        subtract_percent(RAIL_PICOFARADS as u64, TOLERANCE_PERCENT),
    );
    let charged_ppm =
        rail_fall_from_first_to_last_test_pulse_ppm(electrode * ONE_PPM / (electrode + rail)) + MOST_BLEED_PPM;
    let ohms = add_percent((ELECTRODE_OHMS + LOWER_SWITCH_OHMS) as u64, RESISTANCE_TOLERANCE_PERCENT);
    let time_constant_us = ohms * (add_percent(RAIL_PICOFARADS as u64, TOLERANCE_PERCENT) + electrode) / 1_000_000;
    let drawn_ppm = least_decay_ppm(((TEST_PULSES - 1) * TEST_PULSE_MICROSECONDS) as u64, time_constant_us);
    assert!(
        drawn_ppm >= charged_ppm + 2 * MEASUREMENT_PPM,
        "the test cannot distinguish a short circuit from an electrode with this capacitance"
    );
    (drawn_ppm + charged_ppm) / 2
}

/// What the pulses show of an electrode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElectrodeFinding {
    /// It takes its charge every time, and nothing more.
    Sound,
    /// It takes none, or none after the first: it, its cable or its upper switch is open, or its lower switch does not discharge it.
    NoCharge,
    /// It draws current while it is on: it is shorted, or its lower switch is on.
    Draws,
}

/// Judges the pulses of one electrode of a channel.
#[must_use]
pub fn judge_electrode_pulses(channel: usize, pulses: &ElectrodePulses) -> ElectrodeFinding {
    const LEAST_PPM: [u64; MAX_CHANNELS] = rail_fall_limits_of_channels_ppm(false);
    const MOST_PPM: [u64; MAX_CHANNELS] = rail_fall_limits_of_channels_ppm(true);
    let limit = |limits: [u64; MAX_CHANNELS]| limits.get(channel).copied().unwrap_or(0);
    let from = u64::from(pulses.after_first_millivolts);
    let fallen = from.saturating_sub(u64::from(pulses.after_last_millivolts));
    if fallen * ONE_PPM <= from * limit(LEAST_PPM) {
        ElectrodeFinding::NoCharge
    } else if fallen * ONE_PPM >= from * limit(MOST_PPM) {
        ElectrodeFinding::Draws
    } else {
        ElectrodeFinding::Sound
    }
}

/// What was found of all electrodes so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ElectrodeFindings {
    /// Of A and B of each channel whether it takes no charge; `None` if it has not been tried.
    takes_none: [[Option<bool>; 2]; MAX_CHANNELS],
}

impl ElectrodeFindings {
    /// Nothing has been tried.
    pub const NONE: Self = Self { takes_none: [[None; 2]; MAX_CHANNELS] };

    /// Adds a finding. A channel of which neither electrode takes a charge has no ERA: that is no fault as long as it is not driven
    /// ([`Self::has_no_era_connected`]).
    ///
    /// # Errors
    /// [`FaultCode::Electrode`] with 10 x the ERA's number, from 1, + 1 for A or 2 for B if it takes no charge although the other one does,
    /// and 100 more if it draws current.
    pub fn add_finding_and_report_faulty_electrode(
        &mut self,
        channel: usize,
        electrode: Electrode,
        finding: ElectrodeFinding,
    ) -> Result<(), FaultFinding> {
        if finding == ElectrodeFinding::Draws {
            return Err((FaultCode::Electrode, DETAIL_DRAWS + electrode_fault_detail(channel, Some(electrode))));
        }
        let Some(both) = self.takes_none.get_mut(channel) else { return Ok(()) };
        let [a, b] = both;
        *(if electrode == Electrode::A { a } else { b }) = Some(finding == ElectrodeFinding::NoCharge);
        match both {
            [Some(true), Some(false)] => {
                Err((FaultCode::Electrode, electrode_fault_detail(channel, Some(Electrode::A))))
            }
            [Some(false), Some(true)] => {
                Err((FaultCode::Electrode, electrode_fault_detail(channel, Some(Electrode::B))))
            }
            _ => Ok(()),
        }
    }

    /// Whether neither electrode of a channel takes a charge.
    #[must_use]
    pub fn has_no_era_connected(&self, channel: usize) -> bool {
        self.takes_none.get(channel).is_some_and(|both| *both == [Some(true); 2])
    }
}

/// The detail of a fault of one electrode, or of both.
#[must_use]
pub fn electrode_fault_detail(channel: usize, electrode: Option<Electrode>) -> u32 {
    let place = match electrode {
        None => 0,
        Some(Electrode::A) => 1,
        Some(Electrode::B) => 2,
    };
    u32::try_from(channel + 1).unwrap_or(0) * 10 + place
}

/// The least, or the most, that a rail falls for the electrodes of each channel.
const fn rail_fall_limits_of_channels_ppm(of_most: bool) -> [u64; MAX_CHANNELS] {
    let (mut limits, mut channel) = ([0; MAX_CHANNELS], 0);
    while channel < limits.len() {
        let picofarads = ELECTRODE_PICOFARADS[channel];
        limits[channel] = if of_most {
            short_circuit_rail_fall_threshold_ppm(picofarads)
        } else {
            missing_electrode_rail_fall_threshold_ppm(picofarads)
        };
        channel += 1;
    }
    limits
}
