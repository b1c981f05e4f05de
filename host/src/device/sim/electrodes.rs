//! The electrodes as capacitors: what they take from their rails, and what the supply delivers on average.

use super::rails::SimRail;
use era_shared::MAX_CHANNELS;
use era_shared::circuit::{BLEEDER_OHMS, ELECTRODE_OHMS, ELECTRODE_PICOFARADS, LOWER_SWITCH_OHMS, RAIL_PICOFARADS};
use era_shared::limits::{TEST_PAUSE_MICROSECONDS, TEST_PULSE_MICROSECONDS, TEST_PULSES};
use era_shared::safety::ElectrodePulses;
use era_shared::supply::{RAILS, rail_index_of_channel};
use era_shared::waveform::Electrode;
use std::collections::VecDeque;

/// Capacitance of a rail without its electrodes, and of one electrode with its cable and switches, in F.
const RAIL_F: f64 = RAIL_PICOFARADS as f64 * 1e-12;
const ELECTRODE_F: f64 = ELECTRODE_PICOFARADS[0] as f64 * 1e-12;
/// Resistance in ohm that charges an electrode, that discharges it through its lower switch, and of the two bleeders of a rail.
const UPPER_OHM: f64 = ELECTRODE_OHMS as f64;
const LOWER_OHM: f64 = LOWER_SWITCH_OHMS as f64;
const BLEEDERS_OHM: f64 = BLEEDER_OHMS as f64 / 2.0;
/// Time constant of the filter of the average current, and the time of the converter's mean behind it, in s.
const FILTER_S: f64 = 1e-3;
const MEAN_S: f64 = 1e-3;
/// Below this an electrode counts as discharged, in V.
const DISCHARGED_V: f64 = 1e-6;

/// How an electrode, or a switch of it, is broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElectrodeFault {
    /// The electrode, its cable or its upper switch is open.
    Open,
    /// It has a short to earth behind its resistor.
    Shorted,
    /// Its lower switch does not close.
    LowerOpen,
    /// Its lower switch is always closed.
    LowerStuck,
}

impl ElectrodeFault {
    /// What is between the rail and earth while the upper switch is closed, in ohm, if that conducts all the time.
    const fn ohms_from_rail_to_earth_while_on_if_conducting(self) -> Option<f64> {
        match self {
            ElectrodeFault::Shorted => Some(UPPER_OHM),
            ElectrodeFault::LowerStuck => Some(UPPER_OHM + LOWER_OHM),
            ElectrodeFault::Open | ElectrodeFault::LowerOpen => None,
        }
    }
}

/// One broken electrode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BrokenElectrode {
    /// From 0.
    pub channel: usize,
    /// Which of its electrodes.
    pub electrode: Electrode,
    /// How.
    pub fault: ElectrodeFault,
}

/// The electrodes' voltages and the current of the supply.
#[derive(Clone, Debug)]
pub struct SimElectrodes {
    volts: [[f64; 2]; MAX_CHANNELS],
    broken: Option<BrokenElectrode>,
    /// What the filter shows, in A, and its last values, one for each step of the last ms.
    filtered_a: f64,
    last_a: VecDeque<f64>,
}

impl SimElectrodes {
    /// Discharged, with steps of so many s.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    pub fn new(step_s: f64) -> Self {
        let steps = ((MEAN_S / step_s).round() as usize).max(1);
        Self {
            volts: [[0.0; 2]; MAX_CHANNELS],
            broken: None,
            filtered_a: 0.0,
            last_a: std::iter::repeat_n(0.0, steps).collect(),
        }
    }

    /// Breaks one electrode, or mends all.
    pub const fn set_broken(&mut self, broken: Option<BrokenElectrode>) {
        self.broken = broken;
    }

    /// Mean current of the supply over the last ms in A, as it is measured.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "some 40 steps")]
    pub fn mean_supply_current_over_last_ms_a(&self) -> f64 {
        self.last_a.iter().sum::<f64>() / self.last_a.len() as f64
    }

    fn fault_of(&self, channel: usize, electrode: Electrode) -> Option<ElectrodeFault> {
        let broken = self.broken.filter(|broken| broken.channel == channel && broken.electrode == electrode);
        broken.map(|broken| broken.fault)
    }

    /// One step, in which each electrode is on for a part. What a rail's supply does not deliver at once comes from the rail.
    pub fn step(
        &mut self,
        from_s: f64,
        step_s: f64,
        on_parts: &[[f64; 2]; MAX_CHANNELS],
        rails: &mut [SimRail; RAILS],
    ) {
        let to_s = from_s + step_s;
        let rail_volts = rails.map(|rail| rail.volts_at(from_s));
        let mut taken_c = [0.0; RAILS];
        for (channel, on_parts) in on_parts.iter().enumerate() {
            let rail = rail_index_of_channel(channel);
            let volts = rail_volts.get(rail).copied().unwrap_or(0.0);
            for (electrode, on_part) in [Electrode::A, Electrode::B].into_iter().zip(on_parts) {
                let charge_c = self.charge_then_discharge_electrode_returning_coulombs_taken(
                    channel,
                    electrode,
                    volts,
                    on_part * step_s,
                    step_s,
                );
                if let Some(taken_c) = taken_c.get_mut(rail) {
                    *taken_c += charge_c;
                }
            }
        }
        let mut delivered_c = 0.0;
        for ((rail, before_v), taken_c) in rails.iter_mut().zip(rail_volts).zip(taken_c) {
            if rail.is_fed() {
                let after_v = rail.volts_at(to_s);
                delivered_c += (after_v - before_v) * RAIL_F + after_v / BLEEDERS_OHM * step_s + taken_c;
            } else if taken_c > 0.0 {
                rail.lower_by(to_s, taken_c / RAIL_F);
            }
        }
        self.filtered_a += (delivered_c / step_s - self.filtered_a) * (1.0 - (-step_s / FILTER_S).exp());
        self.last_a.pop_front();
        self.last_a.push_back(self.filtered_a);
    }

    /// Charges an electrode for `on_s`, then discharges it for the rest of the step; what it takes from its rail, in C.
    fn charge_then_discharge_electrode_returning_coulombs_taken(
        &mut self,
        channel: usize,
        electrode: Electrode,
        rail_v: f64,
        on_s: f64,
        step_s: f64,
    ) -> f64 {
        let fault = self.fault_of(channel, electrode);
        let place = usize::from(electrode == Electrode::B);
        let Some(volts) = self.volts.get_mut(channel).and_then(|volts| volts.get_mut(place)) else { return 0.0 };
        if on_s <= 0.0 && *volts < DISCHARGED_V || fault == Some(ElectrodeFault::Open) {
            return 0.0;
        }
        if let Some(ohms) = fault.and_then(ElectrodeFault::ohms_from_rail_to_earth_while_on_if_conducting) {
            return rail_v / ohms * on_s;
        }
        let before_v = *volts;
        *volts += (rail_v - before_v) * (1.0 - (-on_s / (UPPER_OHM * ELECTRODE_F)).exp());
        let charge_c = (*volts - before_v) * ELECTRODE_F;
        if fault != Some(ElectrodeFault::LowerOpen) {
            *volts *= (-(step_s - on_s) / (LOWER_OHM * ELECTRODE_F)).exp();
        }
        charge_c
    }

    /// The self-test's pulses on one electrode, whose rail has no supply: they are over at once.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    pub fn apply_self_test_pulses_and_get_rail_mv_after_first_and_last(
        &mut self,
        time_s: f64,
        channel: usize,
        electrode: Electrode,
        rail: &mut SimRail,
    ) -> ElectrodePulses {
        let (pulse_s, pause_s) = (f64::from(TEST_PULSE_MICROSECONDS) / 1e6, f64::from(TEST_PAUSE_MICROSECONDS) / 1e6);
        let mut rail_v = rail.volts_at(time_s);
        let mut after_first_v = rail_v;
        for number in 0..TEST_PULSES {
            // All of it is taken from the rail's own capacitance; the rest of the time the lower switch discharges the electrode.
            let charge_c = self.charge_then_discharge_electrode_returning_coulombs_taken(
                channel,
                electrode,
                rail_v,
                pulse_s,
                pulse_s + pause_s,
            );
            rail_v = (rail_v - charge_c / RAIL_F).max(0.0) * (-(pulse_s + pause_s) / (BLEEDERS_OHM * RAIL_F)).exp();
            if number == 0 {
                after_first_v = rail_v;
            }
        }
        rail.lower_by(time_s, rail.volts_at(time_s) - rail_v);
        let millivolts = |volts: f64| (volts * 1e3).round() as u32;
        ElectrodePulses { after_first_millivolts: millivolts(after_first_v), after_last_millivolts: millivolts(rail_v) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use era_shared::supply::SupplyCommand;

    const ON_A: [[f64; 2]; MAX_CHANNELS] = [[1.0, 0.0], [0.0; 2], [0.0; 2], [0.0; 2]];

    /// 100 ms of 500 Hz at 1 kV: 116 pF x 1 kV x 500 Hz is 58 uA, and a bleeder of 50 Mohm takes 20 uA.
    fn mean_microamps(fault: Option<ElectrodeFault>) -> f64 {
        let step_s = 25e-6;
        let mut electrodes = SimElectrodes::new(step_s);
        electrodes.set_broken(fault.map(|fault| BrokenElectrode { channel: 0, electrode: Electrode::A, fault }));
        let mut rails = [SimRail::new_discharging_since(0.0, 0.0); RAILS];
        let supply = SupplyCommand {
            enabled: true,
            permitted: true,
            discharge: [false; RAILS],
            set_point_millivolts: [1_000_000, 0],
        };
        rails[0].apply_supply_command(0.0, &supply, 0, false);
        let (mut sum, mut count) = (0.0, 0);
        for step in 0..8_000_u32 {
            let on = if step % 80 < 40 { ON_A } else { Default::default() };
            electrodes.step(f64::from(step) * step_s, step_s, &on, &mut rails);
            if step >= 4_000 {
                sum += electrodes.mean_supply_current_over_last_ms_a();
                count += 1;
            }
        }
        sum / f64::from(count) * 1e6
    }

    #[test]
    fn an_electrode_takes_its_charge_and_what_is_broken_does_not() {
        let cases = [
            (None, 78.0),
            (Some(ElectrodeFault::Open), 20.0),
            (Some(ElectrodeFault::LowerOpen), 20.0),
            (Some(ElectrodeFault::Shorted), 520.0),
            (Some(ElectrodeFault::LowerStuck), 20.0 + 500.0 / 1.1),
        ];
        for (fault, expected) in cases {
            let seen = mean_microamps(fault);
            assert!((seen - expected).abs() < 0.01 * expected, "{fault:?}: {seen} uA, expected {expected}");
        }
    }
}
