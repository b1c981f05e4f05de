//! How strong an ERA may be driven: voltage, travel, breakdown of the air in the closing gap.

use crate::physics::charging::PeriodicCharging;
use crate::physics::secants::{NEAR, approximate_zero_of_increasing_function_by_secants};
use crate::scene::{Actuator, ChargingTimes, EPS0};
use era_shared::circuit::{BLEEDER_OHMS, ELECTRODE_PICOFARADS};
use era_shared::limits::MAX_AVERAGE_MICROAMPS;
use era_shared::supply::{RAILS, rail_index_of_channel};
use serde::{Deserialize, Serialize};

/// What of the supply's current plans leave to the board's rounding, in uA: the board counts the charges and the bleeders of each rail in
/// whole uA, rounded up (below 3 uA in all), and frequencies in whole ticks of its timers (5e-5 of them: 0.03 uA).
const ROUNDED_UP_MICROAMPS: u32 = 4;

/// Largest mean current in A that plans take from the board's supply: what it delivers continuously, less the board's rounding, so that
/// the board refuses no plan.
#[must_use]
pub fn max_mean_supply_current_a() -> f64 {
    f64::from(MAX_AVERAGE_MICROAMPS - ROUNDED_UP_MICROAMPS) * 1e-6
}

/// Mean current in A that drives take from the supply: each electrode is charged once a period, and the rails have bleeders.
/// `channels_rail_volts_and_hz` holds the channel, the rail's voltage in V and the frequency in Hz of each.
#[must_use]
pub fn mean_supply_current_with_bleeders_a(
    electrodes: &[Electrodes],
    channels_rail_volts_and_hz: impl Iterator<Item = (usize, f64, f64)>,
) -> f64 {
    let (mut amps, mut rails_v) = (0.0, [0.0_f64; RAILS]);
    for (channel, voltage_v, frequency_hz) in channels_rail_volts_and_hz {
        amps += electrodes.get(channel).map_or(0.0, |own| own.mean_current_a(channel, voltage_v, frequency_hz));
        if let Some(rail_v) = rails_v.get_mut(rail_index_of_channel(channel)) {
            *rail_v = rail_v.max(voltage_v);
        }
    }
    // Two in parallel: 2 kV take 40 uA.
    amps + rails_v.iter().sum::<f64>() * 2.0 / f64::from(BLEEDER_OHMS)
}

/// Part of the breakdown voltage that may be used.
pub(crate) const BREAKDOWN_MARGIN: f64 = 0.85;
/// Part of the gap that the mass may travel: beyond a third, one electrode alone can pull it in (static pull-in).
pub(crate) const MAX_TRAVEL_FRACTION: f64 = 1.0 / 3.0;

/// Part of the gap beyond which a mass is taken to be on the electrode.
const MOST_PRESSED: f64 = 0.95;

/// Part of the static stiffness of a mass that electrodes may take away: the softening grows with the travel, and pulsates.
pub(crate) const MAX_SOFTENING_FRACTION: f64 = 0.6;

/// Levels of the squared voltages that are looked at on the way up.
pub(crate) const LEVELS: u32 = 16;
/// Halvings of the interval in which the scale lies: to a thousandth of the whole.
pub(crate) const HALVINGS: u32 = 7;
/// Softening times receptance that is too weak to move a resonance across a drive.
pub(crate) const WEAK_SOFTENING: f64 = 0.3;

/// Electrodes of one ERA.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Electrodes {
    /// Area of one electrode in m^2.
    pub area_m2: f64,
    /// Air gap on each side at rest in m.
    pub gap_m: f64,
    /// Highest voltage in V.
    pub max_voltage_v: f64,
    /// Where a stop holds the mass, from its middle, in m; infinite without one.
    pub stop_m: f64,
    /// How far a press may move the mass off its middle, in m, at most [`Electrodes::stop_m`].
    pub sag_m: f64,
    /// Capacitance of one electrode with its cable and its switches in F, the mass at rest.
    pub capacitance_f: f64,
    /// How they charge and discharge.
    pub charging: ChargingTimes,
}

/// The tangent of a squared breakdown voltage: V^2 + `slope_v2_per_m` x <= `bound_v2` for a voltage V at a travel of x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BreakdownTangent {
    /// By how much the squared voltage falls with the travel, in V^2/m.
    pub slope_v2_per_m: f64,
    /// The squared voltage that is allowed without travel, in V^2.
    pub bound_v2: f64,
}

/// What keeps an actuator from being driven harder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Limit {
    #[default]
    /// The scene's `max_voltage_v`.
    Voltage,
    /// A third of the air gap.
    Travel,
    /// Breakdown of the air gap when the mass has closed it as far as it travels.
    Breakdown,
    /// The current of the board's supply.
    Supply,
    /// The electrodes' mean pull takes nearly all of the stiffness that brings a mass back to its middle.
    #[serde(rename = "pull-in")]
    PullIn,
}

impl Limit {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Voltage, Self::Travel, Self::Breakdown, Self::Supply, Self::PullIn];

    /// As printed in `limited_by`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Limit::Voltage => "voltage",
            Limit::Travel => "travel",
            Limit::Breakdown => "breakdown",
            Limit::Supply => "supply",
            Limit::PullIn => "pull-in",
        }
    }
}

impl Electrodes {
    /// The electrodes of an actuator, without a press.
    #[must_use]
    pub fn from_actuator(actuator: &Actuator) -> Self {
        Self {
            area_m2: actuator.electrode_area_m2,
            gap_m: actuator.air_gap_m,
            max_voltage_v: actuator.max_voltage_v,
            stop_m: actuator.stop_m.unwrap_or(f64::INFINITY),
            sag_m: 0.0,
            capacitance_f: actuator.capacitance_of_electrode_with_cable_f(),
            charging: actuator.charging,
        }
    }

    /// Smallest air gap in m that remains in a motion of up to `travel_m` under a press.
    #[must_use]
    pub fn remaining_gap_under_press_m(&self, travel_m: f64) -> f64 {
        self.gap_m - (self.sag_m + travel_m).min(self.stop_m)
    }

    /// Highest voltage in V that the remaining gap withstands, with a margin.
    #[must_use]
    pub fn breakdown_voltage_of_remaining_gap_with_margin_v(&self, travel_m: f64) -> f64 {
        BREAKDOWN_MARGIN * breakdown_voltage_v(self.remaining_gap_under_press_m(travel_m))
    }

    /// How many times as much of what holds a mass the electrodes take under a press as at rest. With u the part of the gap that it is off
    /// its middle: where springs hold it, the slope of their mean pull u / (1 - u^2)^2; where a stop does, that pull over what springs
    /// as stiff as the softening would bring back, so that they bring it back when the press ends.
    #[must_use]
    pub fn softening_under_press_relative_to_rest(&self) -> f64 {
        let u = (self.sag_m / self.gap_m).min(MOST_PRESSED);
        let left = 1.0 - u * u;
        if self.sag_m < self.stop_m { (1.0 + 3.0 * u * u) / left.powi(3) } else { left.powi(-2) }
    }

    /// Force while one electrode is on at 1 V and the mass at rest, in N/V^2: eps0 S / (2 g^2).
    #[must_use]
    pub fn force_at_rest_n_per_v2(&self) -> f64 {
        EPS0 * self.area_m2 / (2.0 * self.gap_m * self.gap_m)
    }

    /// Their voltage under windows of this frequency.
    #[must_use]
    pub const fn charging_at(&self, frequency_hz: f64) -> PeriodicCharging {
        PeriodicCharging::new(self.charging, frequency_hz)
    }

    /// Amplitude of the force's `harmonic`-th harmonic at 1 V, in N/V^2, under windows of this frequency.
    #[must_use]
    pub fn harmonic_force_n_per_v2(&self, harmonic: u32, frequency_hz: f64, pulse_width: f64) -> f64 {
        let charging = self.charging_at(frequency_hz);
        charging.harmonic_amplitude_n(self.force_at_rest_n_per_v2(), f64::from(harmonic), pulse_width)
    }

    /// Stiffness in N/m that the electrodes take off the spring of a mass at rest, the mean over a period, per N of the force's
    /// fundamental: 2 F / g while one of them is on, a part w of the time, over 4/pi sin(pi w/2) F. Of electrodes behind resistors the mean
    /// square of the voltage stands for the part of the time.
    #[must_use]
    pub fn mean_softening_n_per_m_per_n(&self, frequency_hz: f64, pulse_width: f64) -> f64 {
        let charging = self.charging_at(frequency_hz);
        if charging.is_instant() {
            let angle = std::f64::consts::FRAC_PI_2 * pulse_width;
            return angle / (self.gap_m * angle.sin());
        }
        let fundamental = charging.force_harmonic_phasor_per_n_at_rail_voltage(1.0, pulse_width).norm();
        2.0 * charging.mean_sum_of_squared_electrode_voltages_over_rail_squared(pulse_width)
            / (self.gap_m * fundamental)
    }

    /// Stiffness in N/m that an electrode at a voltage takes away at most, its mass a part of the gap off: F' = 2 F / (g - x), F
    /// grown by (g / (g - x))^2.
    #[must_use]
    pub fn max_softening_n_per_m(&self, voltage_v: f64, closed_fraction: f64) -> f64 {
        let force_n = self.force_at_rest_n_per_v2() * voltage_v * voltage_v;
        2.0 * force_n / self.gap_m / (1.0 - closed_fraction).powi(3)
    }

    /// Voltage whose force has a fundamental of `force_n` newtons.
    #[must_use]
    pub fn voltage_for_force_v(&self, force_n: f64, frequency_hz: f64, pulse_width: f64) -> f64 {
        (force_n / self.harmonic_force_n_per_v2(1, frequency_hz, pulse_width)).sqrt()
    }

    /// Largest amplitude of the force's fundamental in N, and the limit that sets it, for an ERA whose mass moves by
    /// `travel_m_per_n` relative to its electrodes per newton.
    #[must_use]
    pub fn find_max_force_n_and_limit(&self, travel_m_per_n: f64, frequency_hz: f64, pulse_width: f64) -> (f64, Limit) {
        let per_volt_squared = self.harmonic_force_n_per_v2(1, frequency_hz, pulse_width);
        let by_voltage = per_volt_squared * self.max_voltage_v * self.max_voltage_v;
        let by_travel = self.max_travel_m() / travel_m_per_n;
        let (most, limit) =
            if by_travel < by_voltage { (by_travel, Limit::Travel) } else { (by_voltage, Limit::Voltage) };
        // By how much a force's voltage is beyond what the gap that it closes holds.
        let beyond = |force: f64| {
            (force / per_volt_squared).sqrt()
                - self.breakdown_voltage_of_remaining_gap_with_margin_v(force * travel_m_per_n)
        };
        if beyond(most) <= 0.0 {
            return (most, limit);
        }
        // Voltage rises and the breakdown voltage falls with the force, so they cross once. Secants come near the crossing; halves find the
        // largest force that is not beyond it, from there or, where secants have gone elsewhere, from the ends.
        let (mut low, mut high) = (0.0, most);
        let near = approximate_zero_of_increasing_function_by_secants(&beyond, most);
        for side in [near * (1.0 - NEAR), near * (1.0 + NEAR)] {
            match beyond(side) <= 0.0 {
                true if side > low => low = side,
                false if side < high => high = side,
                _ => {}
            }
        }
        loop {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if beyond(middle) <= 0.0 { low = middle } else { high = middle }
        }
        (low, Limit::Breakdown)
    }

    /// Mean current in A of electrodes that are each charged to `voltage_v` once a period. Their capacitance counts as never less than
    /// that which the board counts for their channel.
    #[must_use]
    pub fn mean_current_a(&self, channel: usize, voltage_v: f64, frequency_hz: f64) -> f64 {
        let board_picofarads = ELECTRODE_PICOFARADS.get(channel).copied().unwrap_or(0);
        let counted_f = self.capacitance_f.max(f64::from(board_picofarads) * 1e-12);
        2.0 * counted_f * voltage_v * frequency_hz
    }

    /// Electrical power in W of electrodes that are each charged to `voltage_v` once a period, half of it lost in charging and half in
    /// discharging: 2 C V^2 f.
    #[must_use]
    pub fn mean_power_w(&self, voltage_v: f64, frequency_hz: f64) -> f64 {
        2.0 * self.capacitance_f * voltage_v * voltage_v * frequency_hz
    }

    /// Most travel in m: a third of the gap, and no further than a stop.
    #[must_use]
    pub fn max_travel_m(&self) -> f64 {
        (self.gap_m * MAX_TRAVEL_FRACTION).min(self.stop_m)
    }

    /// The tangent s, b such that V^2 + s x <= b keeps V within 85 % of breakdown in the gap that a press and a travel of x have closed: the
    /// tangent at the largest travel of the convex (0.85 V_b(g - x))^2, level where a stop holds the mass.
    #[must_use]
    pub fn tangent_of_squared_breakdown_voltage_over_travel(&self) -> BreakdownTangent {
        let x = self.max_travel_m();
        let volts = breakdown_voltage_v(self.remaining_gap_under_press_m(x));
        if self.sag_m + x >= self.stop_m || volts <= 0.0 {
            return BreakdownTangent { slope_v2_per_m: 0.0, bound_v2: (BREAKDOWN_MARGIN * volts).powi(2) };
        }
        let gap_cm = self.remaining_gap_under_press_m(x) * 100.0;
        let volts_per_m = (24.22 + 3.04 / gap_cm.sqrt()) * 1e5;
        let slope_v2_per_m = BREAKDOWN_MARGIN * BREAKDOWN_MARGIN * 2.0 * volts * volts_per_m;
        BreakdownTangent { slope_v2_per_m, bound_v2: (BREAKDOWN_MARGIN * volts).powi(2) + slope_v2_per_m * x }
    }
}

/// Breakdown voltage of an air gap in V at 1 bar: 24.22 d + 6.08 sqrt(d) kV with d in cm, the usual engineering fit of
/// Paschen's curve right of its minimum. Below 10 um, where the fit ends, it goes down to zero with the gap.
#[must_use]
pub fn breakdown_voltage_v(gap_m: f64) -> f64 {
    let gap_cm = gap_m.max(0.0) * 100.0;
    (24.22 * gap_cm + 6.08 * gap_cm.sqrt()) * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const DEFAULT: Electrodes = Electrodes {
        area_m2: 1.9635e-3,
        gap_m: 0.5e-3,
        max_voltage_v: 2000.0,
        stop_m: f64::INFINITY,
        sag_m: 0.0,
        capacitance_f: 116e-12,
        charging: ChargingTimes { rise_s: 0.0, hold_s: 0.0, fall_s: 0.0 },
    };

    #[test]
    fn force_of_the_default_era() {
        // A disc of 50 mm at 0.5 mm: 1.70 kV give 0.1 N.
        let force = DEFAULT.force_at_rest_n_per_v2() * 1700.0 * 1700.0;
        assert!((force - 0.1).abs() < 1e-3, "{force}");
        assert!(
            (DEFAULT.voltage_for_force_v(0.05, HZ, 0.8).powi(2) * DEFAULT.harmonic_force_n_per_v2(1, HZ, 0.8) - 0.05)
                .abs()
                < 1e-12
        );
    }

    /// By hand: 0.46 uC for each cycle of an ERA and 40 uA for each rail, at 2 kV.
    #[test]
    fn supply_current_of_four_eras_by_hand() {
        let all =
            |hz: f64| mean_supply_current_with_bleeders_a(&[DEFAULT; 4], (0..4).map(|channel| (channel, 2000.0, hz)));
        assert!((all(200.0) - (4.0 * 0.464e-6 * 200.0 + 80e-6)).abs() < 1e-9, "{}", all(200.0));
        // One rail, one bleeder pair.
        let alone = mean_supply_current_with_bleeders_a(&[DEFAULT; 4], [(2, 2000.0, 200.0)].into_iter());
        assert!((alone - (0.464e-6 * 200.0 + 40e-6)).abs() < 1e-9, "{alone}");
        // Small electrodes count as the board counts them, in current but not in power.
        let small = Electrodes { capacitance_f: 20e-12, ..DEFAULT };
        assert_eq!(small.mean_current_a(0, 2000.0, 200.0), DEFAULT.mean_current_a(0, 2000.0, 200.0));
        assert!((small.mean_power_w(2000.0, 200.0) - 2.0 * 20e-12 * 4e6 * 200.0).abs() < 1e-12);
        let large = Electrodes { capacitance_f: 300e-12, ..DEFAULT };
        assert!((large.mean_current_a(0, 2000.0, 200.0) - 2.0 * 300e-12 * 2000.0 * 200.0).abs() < 1e-12);
    }

    #[test]
    fn two_thirds_has_no_third_harmonic() {
        let force = |n: u32, width: f64| DEFAULT.harmonic_force_n_per_v2(n, HZ, width);
        assert!(force(3, 2.0 / 3.0) < 1e-12 * force(1, 1.0));
    }

    #[test]
    fn breakdown_in_the_closing_gap_matches_the_table() {
        // 0.85 V_b: 2.18 kV at rest, 2.02 at 50 um, 1.85 at 100 um, 1.62 at 167 um.
        for (travel_um, kilovolts) in [(0.0, 2.18), (50.0, 2.02), (100.0, 1.85), (143.0, 1.70), (167.0, 1.62)] {
            let volts = 0.85 * breakdown_voltage_v((500.0 - travel_um) * 1e-6);
            assert!((volts / 1e3 - kilovolts).abs() < 0.015, "{travel_um}: {volts}");
        }
    }

    #[test]
    fn each_limit_binds_where_it_should_and_is_kept() {
        for (travel_m_per_n, expected) in [(1e-7, Limit::Voltage), (1e-2, Limit::Travel), (1.2e-3, Limit::Breakdown)] {
            let (force, limit) = DEFAULT.find_max_force_n_and_limit(travel_m_per_n, HZ, PULSE);
            assert_eq!(limit, expected, "{travel_m_per_n}");
            let (travel, volts) = (force * travel_m_per_n, DEFAULT.voltage_for_force_v(force, HZ, PULSE));
            assert!(travel <= DEFAULT.gap_m / 3.0 * (1.0 + 1e-12));
            assert!(volts <= 2000.0 * (1.0 + 1e-12));
            assert!(volts <= 0.85 * breakdown_voltage_v(DEFAULT.gap_m - travel) * (1.0 + 1e-9));
        }
    }

    const PULSE: f64 = 2.0 / 3.0;
    const HZ: f64 = 200.0;

    proptest! {
        /// The force holds, to rounding, and one of a part in 10^14 more does not: also with pressed gaps, stops, and masses that hardly move or close the gap.
        #[test]
        fn no_more_force_holds(
            travel in -8.0_f64..-1.0,
            gap_um in 50.0_f64..2000.0,
            sag in 0.0_f64..0.9,
            stop in 0.05_f64..1.5,
            volts in 200.0_f64..6000.0,
            rise_us in prop_oneof![Just(0.0_f64), 10.0_f64..300.0],
        ) {
            let gap_m = gap_um * 1e-6;
            let charging = ChargingTimes { rise_s: rise_us * 1e-6, hold_s: 0.0, fall_s: 0.1e-6 * rise_us };
            let own = Electrodes { gap_m, max_voltage_v: volts, stop_m: stop * gap_m, sag_m: sag * gap_m, charging, ..DEFAULT };
            let travel_m_per_n = 10.0_f64.powf(travel);
            let (force, limit) = own.find_max_force_n_and_limit(travel_m_per_n, HZ, PULSE);
            let holds = |force: f64| own.voltage_for_force_v(force, HZ, PULSE) <= own.breakdown_voltage_of_remaining_gap_with_margin_v(force * travel_m_per_n);
            prop_assert!(force == 0.0 || holds(force * (1.0 - 1e-15)), "{force} {limit:?}");
            let otherwise = own.harmonic_force_n_per_v2(1, HZ, PULSE) * volts * volts;
            let otherwise = otherwise.min(own.max_travel_m() / travel_m_per_n);
            match limit {
                Limit::Breakdown => prop_assert!(!holds(force * (1.0 + 1e-14)), "more than {force}"),
                _ => prop_assert!((force / otherwise - 1.0).abs() < 1e-14, "{force} of {otherwise}"),
            }
            prop_assert!(force <= otherwise);
        }
    }
}
