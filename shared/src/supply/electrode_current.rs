//! Whether the drives take from the supply what their electrodes should take.
//!
//! An electrode takes C V each time it is switched to its rail. What the supply delivers on average is therefore
//!
//! sum over the channels of C V x (charges in a second) + V / R of each rail's bleeders + C_rail dV/dt of each rail,
//!
//! by conservation of charge, whatever the supply does from one ms to the next: 2 C V f for each ERA that is driven at a frequency f. An
//! electrode that is open, or one that its lower switch does not discharge, takes less; one that is shorted, or that is switched to
//! its rail and to ground together, takes more.
//!
//! Charges are counted by the [`crate::waveform::Sequencer`] from the periods that its timers have gone through, so that envelopes,
//! narrow windows, gaps and window sequences count for what they are. Measured and expected charge are summed with equal weights, which
//! fall with e^(-t / [`ELECTRODE_MEAN_MICROSECONDS`]); only these sums are compared. They may differ by the tolerances of the circuit, by an
//! offset of the measurement, and by what is on its way: charges that are counted but not taken yet, and a supply that is late by some ms.

use super::watch::ConditionTime;
use super::{FaultFinding, RAILS, SensorReadings, SupplyCommand, rail_index_of_channel};
use crate::MAX_CHANNELS;
use crate::circuit::{
    BLEEDER_OHMS, ELECTRODE_PICOFARADS, LEAKAGE_OHMS, RAIL_PICOFARADS, RESISTANCE_TOLERANCE_PERCENT, SUPPLY_RISE_MS,
    TOLERANCE_PERCENT, add_percent, subtract_percent,
};
use crate::limits::{
    CURRENT_OFFSET_MICROAMPS, CURRENT_TOLERANCE_PERCENT, ELECTRODE_FAULT_AFTER_MS, ELECTRODE_MEAN_MICROSECONDS,
    OVER_VOLTAGE_MILLIVOLTS,
};
use crate::protocol::FaultCode;
use crate::waveform::ElectrodeCharges;

/// How late the measured current may be, in us, as the time constant of a lag: 5 ms of the supply, 1 ms of the filter, 1 ms of the
/// converter's mean, and a ms from one look to the next; twice that, since nothing of it may come later. A power of two.
const LATE_MICROSECONDS: u64 = 1 << 14;
const _: () = assert!(LATE_MICROSECONDS >= 2 * (1_000 * SUPPLY_RISE_MS as u64 + 3_000));
/// Two looks that are further apart than this, in us, are not compared: the measured current is the mean of the last ms.
const LONGEST_STEP_US: u64 = 2_500;
/// After a discharge switch has been closed nothing is compared for so long, in us: it takes an unknown charge, and opens within a ms;
/// 5 ms for the supply that pushes against it, and the filter.
const AFTER_DISCHARGE_US: u64 = 1_000 * SUPPLY_RISE_MS as u64 + 3_000;
/// A channel whose electrodes have not been charged for so long, in us, has no charges that are on their way: the longest period, at whose end
/// its charges are counted, and three times the mean's time, of which 5 % of their weight is left.
const FORGOTTEN_US: u64 = 1_000_000 + 3 * ELECTRODE_MEAN_MICROSECONDS;
/// More than the measurement's full scale, in uA: keeps a reading that is none from overflowing the sums.
const MOST_MICROAMPS: u32 = 10_000;

/// What is added to the detail: too little, or too much; 1000 x the ERA's number if one alone has driven lately; then the measured mean.
const DETAIL_TOO_LITTLE: u32 = 10_000;
const DETAIL_TOO_MUCH: u32 = 20_000;
const DETAIL_ERA: u32 = 1_000;

/// A sum whose parts count less the older they are.
#[derive(Clone, Copy, Debug, Default)]
struct FadingSum(u64);

impl FadingSum {
    /// Lets the sum fade for `elapsed_us` and adds `part` to it.
    const fn fade_by_elapsed_time_and_add(&mut self, part: u64, elapsed_us: u64) {
        // 2 mA over 131 ms are 2.6e11 fC; times 2500 us that is far below 2^64.
        self.0 = self.0 - self.0 * elapsed_us / ELECTRODE_MEAN_MICROSECONDS + part;
    }
}

/// A sum of charges in fC, at once and as it is if everything comes late.
#[derive(Clone, Copy, Debug, Default)]
struct LateSum {
    at_once: FadingSum,
    late: u64,
}

impl LateSum {
    /// Lets both sums fade for `elapsed_us` and adds `part_fc`, a charge in fC, to them.
    const fn fade_and_add_to_immediate_and_delayed_sums(&mut self, part_fc: u64, elapsed_us: u64) {
        self.at_once.fade_by_elapsed_time_and_add(part_fc, elapsed_us);
        let rise = self.at_once.0.saturating_sub(self.late) * elapsed_us / LATE_MICROSECONDS;
        let fall = self.late.saturating_sub(self.at_once.0) * elapsed_us / LATE_MICROSECONDS;
        self.late = self.late + rise - fall;
    }

    /// The smaller of the two sums in fC.
    fn smaller_of_immediate_and_delayed_sum_fc(&self) -> u64 {
        self.at_once.0.min(self.late)
    }

    /// The larger of the two sums in fC.
    fn larger_of_immediate_and_delayed_sum_fc(&self) -> u64 {
        self.at_once.0.max(self.late)
    }
}

/// What counts of a rail's voltage, in mV.
#[derive(Clone, Copy, Debug, Default)]
struct RailHistory {
    last: i64,
    /// The fading sum of its changes: what its capacitance has taken from the supply, over the capacitance. What a discharge switch takes is no
    /// change.
    changed: i64,
    /// The highest voltage of late, fading: that of charges that are on their way.
    highest: i64,
}

impl RailHistory {
    const NONE: Self = Self { last: 0, changed: 0, highest: 0 };

    /// Takes note of the rail's voltage `elapsed_us` after the last one.
    fn update_fading_change_and_highest_voltage(&mut self, millivolts: u32, elapsed_us: u64) {
        const MEAN_US: i64 = ELECTRODE_MEAN_MICROSECONDS as i64;
        let elapsed_us = i64::try_from(elapsed_us).unwrap_or(MEAN_US);
        let now = i64::from(millivolts);
        self.changed += now - self.last - self.changed * elapsed_us / MEAN_US;
        self.highest = now.max(self.highest - self.highest * elapsed_us / MEAN_US);
        self.last = now;
    }
}

/// Compares the measured average current with what the drives should take, once a ms while the board is live.
#[derive(Clone, Debug)]
pub struct ElectrodeCurrentMonitor {
    last_us: Option<u64>,
    not_before_us: u64,
    /// In fC, as all charges.
    measured: FadingSum,
    bleeders: FadingSum,
    leakage: FadingSum,
    least: LateSum,
    most: LateSum,
    rails: [RailHistory; RAILS],
    /// When each channel last charged an electrode.
    charged_us: [Option<u64>; MAX_CHANNELS],
    too_little: ConditionTime,
    too_much: ConditionTime,
}

impl Default for ElectrodeCurrentMonitor {
    fn default() -> Self {
        Self::new()
    }
}

impl ElectrodeCurrentMonitor {
    /// A monitor that has not seen anything.
    #[must_use]
    pub const fn new() -> Self {
        const NOTHING: LateSum = LateSum { at_once: FadingSum(0), late: 0 };
        Self {
            last_us: None,
            not_before_us: 0,
            measured: FadingSum(0),
            bleeders: FadingSum(0),
            leakage: FadingSum(0),
            least: NOTHING,
            most: NOTHING,
            rails: [RailHistory::NONE; RAILS],
            charged_us: [None; MAX_CHANNELS],
            too_little: ConditionTime::NONE,
            too_much: ConditionTime::NONE,
        }
    }

    /// Forgets everything, for the next session.
    pub fn forget_history(&mut self) {
        *self = Self::new();
    }

    /// The fault that the current shows, if there is one. `supply` is the command that was in force when it was measured, `charges` what the
    /// channels have charged since the last call.
    ///
    /// Detail: 10 000 for too little or 20 000 for too much, + 1000 x the ERA's number if only one has driven lately, + the measured mean in
    /// uA (999 at most).
    pub fn update_and_find_electrode_current_fault(
        &mut self,
        now_us: u64,
        readings: &SensorReadings,
        supply: &SupplyCommand,
        charges: &[ElectrodeCharges; MAX_CHANNELS],
    ) -> Option<FaultFinding> {
        let elapsed_us = self.last_us.replace(now_us).map_or(u64::MAX, |last_us| now_us.saturating_sub(last_us));
        if supply.discharge.contains(&true) {
            self.not_before_us = now_us + AFTER_DISCHARGE_US;
        }
        // What is not compared is left out on both sides.
        if now_us < self.not_before_us || elapsed_us > LONGEST_STEP_US {
            for (rail, millivolts) in self.rails.iter_mut().zip(readings.rail_millivolts) {
                rail.last = i64::from(millivolts);
            }
            return None;
        }
        self.add_measured_and_expected_charges(now_us, elapsed_us, readings, supply, charges);
        let (least, most) = self.least_and_most_expected_charge_fc();
        let measured = self.measured.0;
        let too_little = add_percent(measured, CURRENT_TOLERANCE_PERCENT) < least;
        let too_much = subtract_percent(measured, CURRENT_TOLERANCE_PERCENT) > most;
        if self.too_little.count_or_forgive_time_and_has_lasted(too_little, elapsed_us, ELECTRODE_FAULT_AFTER_MS) {
            return Some((FaultCode::Electrode, DETAIL_TOO_LITTLE + self.encode_driven_era_and_mean_microamps()));
        }
        if self.too_much.count_or_forgive_time_and_has_lasted(too_much, elapsed_us, ELECTRODE_FAULT_AFTER_MS) {
            return Some((FaultCode::Electrode, DETAIL_TOO_MUCH + self.encode_driven_era_and_mean_microamps()));
        }
        None
    }

    fn add_measured_and_expected_charges(
        &mut self,
        now_us: u64,
        elapsed_us: u64,
        readings: &SensorReadings,
        supply: &SupplyCommand,
        charges: &[ElectrodeCharges; MAX_CHANNELS],
    ) {
        // uA times us is pC.
        let measured_pc = u64::from(readings.average_microamps.min(MOST_MICROAMPS)) * elapsed_us;
        self.measured.fade_by_elapsed_time_and_add(measured_pc * 1_000, elapsed_us);
        let (mut bleeders, mut leakage) = (0, 0);
        for (rail, millivolts) in self.rails.iter_mut().zip(readings.rail_millivolts) {
            // What is above that has been found by others.
            let millivolts = millivolts.min(OVER_VOLTAGE_MILLIVOLTS);
            let millivolt_us = u64::from(millivolts) * elapsed_us;
            rail.update_fading_change_and_highest_voltage(millivolts, elapsed_us);
            // mV times us over ohm is nC; each rail has two bleeders.
            bleeders += millivolt_us * 2 * 1_000_000 / u64::from(BLEEDER_OHMS);
            leakage += millivolt_us * 1_000_000 / u64::from(LEAKAGE_OHMS);
        }
        self.bleeders.fade_by_elapsed_time_and_add(bleeders, elapsed_us);
        self.leakage.fade_by_elapsed_time_and_add(leakage, elapsed_us);
        let (mut least, mut most) = (0, 0);
        for (channel, charge) in charges.iter().enumerate() {
            let of_rail =
                |values: &[u32; RAILS]| u64::from(values.get(rail_index_of_channel(channel)).copied().unwrap_or(0));
            let (set, seen) = (of_rail(&supply.set_point_millivolts), of_rail(&readings.rail_millivolts));
            // pF times mV is fC.
            let picofarads = u64::from(ELECTRODE_PICOFARADS.get(channel).copied().unwrap_or(0));
            least += picofarads * set.min(seen) * u64::from(charge.least_permille) / 1_000;
            most += picofarads * set.max(seen) * u64::from(charge.most_permille) / 1_000;
            if let Some(charged_us) = self.charged_us.get_mut(channel).filter(|_| charge.most_permille > 0) {
                *charged_us = Some(now_us);
            }
        }
        self.least.fade_and_add_to_immediate_and_delayed_sums(least, elapsed_us);
        self.most.fade_and_add_to_immediate_and_delayed_sums(most, elapsed_us);
        for charged_us in &mut self.charged_us {
            *charged_us = charged_us.filter(|at_us| now_us.saturating_sub(*at_us) < FORGOTTEN_US);
        }
    }

    /// The least and the most that the measured sum may be, in fC.
    fn least_and_most_expected_charge_fc(&self) -> (u64, u64) {
        let positive = |value: i64| u64::try_from(value).unwrap_or(0);
        let (mut risen, mut fallen, mut on_its_way) = (0, 0, 0);
        for rail in &self.rails {
            risen += u64::from(RAIL_PICOFARADS) * positive(rail.changed);
            fallen += u64::from(RAIL_PICOFARADS) * positive(-rail.changed);
        }
        for (channel, _) in self.charged_us.iter().enumerate().filter(|(_, charged)| charged.is_some()) {
            let highest = self.rails.get(rail_index_of_channel(channel)).map_or(0, |rail| positive(rail.highest));
            let picofarads = u64::from(ELECTRODE_PICOFARADS.get(channel).copied().unwrap_or(0));
            // A charge of each electrode.
            on_its_way += 2 * picofarads * highest;
        }
        // uA times us is pC.
        let offset = u64::from(CURRENT_OFFSET_MICROAMPS) * ELECTRODE_MEAN_MICROSECONDS * 1_000;
        let least = subtract_percent(self.least.smaller_of_immediate_and_delayed_sum_fc(), TOLERANCE_PERCENT)
            + subtract_percent(self.bleeders.0, RESISTANCE_TOLERANCE_PERCENT);
        let most = add_percent(self.most.larger_of_immediate_and_delayed_sum_fc() + risen, TOLERANCE_PERCENT)
            + add_percent(self.bleeders.0, RESISTANCE_TOLERANCE_PERCENT)
            + self.leakage.0;
        let allowed_less = on_its_way + offset + add_percent(fallen, TOLERANCE_PERCENT);
        (least.saturating_sub(allowed_less), most + on_its_way + offset)
    }

    /// Who has driven lately, if it is one, and the measured mean.
    fn encode_driven_era_and_mean_microamps(&self) -> u32 {
        let mut driven = (1..).zip(&self.charged_us).filter(|(_, charged)| charged.is_some()).map(|(era, _)| era);
        let era: u32 = match (driven.next(), driven.next()) {
            (Some(era), None) => era,
            _ => 0,
        };
        let mean_microamps = self.measured.0 / ELECTRODE_MEAN_MICROSECONDS / 1_000;
        era * DETAIL_ERA + u32::try_from(mean_microamps).unwrap_or(u32::MAX).min(DETAIL_ERA - 1)
    }
}
