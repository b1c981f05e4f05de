//! How strong an ERA may be driven: voltage, travel, breakdown of the air in the closing gap.

use crate::ELECTRODE_CABLE_F;
use crate::scene::{Actuator, EPS0};
use era_shared::limits::MAX_AVERAGE_MICROAMPS;
use serde::{Deserialize, Serialize};

/// Most mean current in A that the board's supply delivers for long.
#[must_use]
pub fn most_mean_current_a() -> f64 {
    f64::from(MAX_AVERAGE_MICROAMPS) * 1e-6
}

/// Part of the breakdown voltage that may be used.
pub(crate) const BREAKDOWN_MARGIN: f64 = 0.85;
/// Part of the gap that the mass may travel: beyond a third, one electrode alone can pull it in (static pull-in).
pub(crate) const TRAVEL_PART: f64 = 1.0 / 3.0;

/// Part of the gap beyond which a mass is taken to be on the electrode.
const MOST_PRESSED: f64 = 0.95;

/// Part of the static stiffness of a mass that electrodes may take away: the softening grows with the travel, and pulsates.
pub(crate) const HELD: f64 = 0.6;

/// Levels of the squared voltages that are looked at on the way up.
pub(crate) const LEVELS: u32 = 16;
/// Halvings of the interval in which the scale lies: to a thousandth of the whole.
pub(crate) const HALVINGS: u32 = 7;
/// Softening times receptance that is too weak to move a resonance across a drive.
pub(crate) const WEAK: f64 = 0.3;

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
    /// Those of an actuator, without a press.
    #[must_use]
    pub fn of(actuator: &Actuator) -> Self {
        Self {
            area_m2: actuator.electrode_area_m2,
            gap_m: actuator.air_gap_m,
            max_voltage_v: actuator.max_voltage_v,
            stop_m: actuator.stop_m.unwrap_or(f64::INFINITY),
            sag_m: 0.0,
        }
    }

    /// Least air gap in m that a motion of up to `travel_m` leaves under a press.
    #[must_use]
    pub fn gap_left_m(&self, travel_m: f64) -> f64 {
        self.gap_m - (self.sag_m + travel_m).min(self.stop_m)
    }

    /// Highest voltage in V that this gap holds, with a margin.
    #[must_use]
    pub fn holds_v(&self, travel_m: f64) -> f64 {
        BREAKDOWN_MARGIN * breakdown_v(self.gap_left_m(travel_m))
    }

    /// How many times as much of what holds a mass the electrodes take under a press as at rest. With u the part of the gap that it is off
    /// its middle: where springs hold it, the slope of their mean pull u / (1 - u^2)^2; where a stop does, that pull over what springs
    /// as stiff as the softening would bring back, so that they bring it back when the press ends.
    #[must_use]
    pub fn pressed_softening(&self) -> f64 {
        let u = (self.sag_m / self.gap_m).min(MOST_PRESSED);
        let left = 1.0 - u * u;
        if self.sag_m < self.stop_m { (1.0 + 3.0 * u * u) / left.powi(3) } else { left.powi(-2) }
    }

    /// Force while one electrode is on at 1 V and the mass at rest, in N/V^2: eps0 S / (2 g^2).
    #[must_use]
    pub fn newtons_per_volt_squared(&self) -> f64 {
        EPS0 * self.area_m2 / (2.0 * self.gap_m * self.gap_m)
    }

    /// Amplitude of the force's `harmonic`-th harmonic at 1 V, in N/V^2: 4/(n pi) |sin(n pi w/2)| times the force.
    #[must_use]
    pub fn harmonic_per_volt_squared(&self, harmonic: u32, pulse_width: f64) -> f64 {
        let n = f64::from(harmonic);
        let half = std::f64::consts::FRAC_PI_2;
        self.newtons_per_volt_squared() * (n * half * pulse_width).sin().abs() * 2.0 / (n * half)
    }

    /// Stiffness in N/m that the electrodes take off the spring of a mass at rest, the mean over a period, per N of the force's
    /// fundamental: 2 F / g while one of them is on, a part w of the time, over 4/pi sin(pi w/2) F.
    #[must_use]
    pub fn softening_per_newton(&self, pulse_width: f64) -> f64 {
        let angle = std::f64::consts::FRAC_PI_2 * pulse_width;
        angle / (self.gap_m * angle.sin())
    }

    /// Stiffness in N/m that an electrode at a voltage takes away at most, its mass a part of the gap off: F' = 2 F / (g - x), F
    /// grown by (g / (g - x))^2.
    #[must_use]
    pub fn softening(&self, voltage_v: f64, closed: f64) -> f64 {
        let force_n = self.newtons_per_volt_squared() * voltage_v * voltage_v;
        2.0 * force_n / self.gap_m / (1.0 - closed).powi(3)
    }

    /// Voltage whose force has a fundamental of `force_n` newtons.
    #[must_use]
    pub fn voltage_for(&self, force_n: f64, pulse_width: f64) -> f64 {
        (force_n / self.harmonic_per_volt_squared(1, pulse_width)).sqrt()
    }

    /// Largest amplitude of the force's fundamental in N, and what sets it, for an ERA whose mass moves by
    /// `travel_m_per_n` relative to its electrodes per newton.
    #[must_use]
    pub fn max_force(&self, travel_m_per_n: f64, pulse_width: f64) -> (f64, Limit) {
        let per_volt_squared = self.harmonic_per_volt_squared(1, pulse_width);
        let by_voltage = per_volt_squared * self.max_voltage_v * self.max_voltage_v;
        let by_travel = self.most_travel_m() / travel_m_per_n;
        let (most, limit) =
            if by_travel < by_voltage { (by_travel, Limit::Travel) } else { (by_voltage, Limit::Voltage) };
        // By how much a force's voltage is beyond what the gap that it closes holds.
        let beyond = |force: f64| (force / per_volt_squared).sqrt() - self.holds_v(force * travel_m_per_n);
        if beyond(most) <= 0.0 {
            return (most, limit);
        }
        // Voltage rises and the breakdown voltage falls with the force, so they cross once. Secants come near the crossing; halves find the
        // largest force that is not beyond it, from there or, where secants have gone elsewhere, from the ends.
        let (mut low, mut high) = (0.0, most);
        let near = crossing(&beyond, most);
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

    /// Mean current in A of electrodes that are each charged to `voltage_v` once a period.
    #[must_use]
    pub fn mean_current_a(&self, voltage_v: f64, frequency_hz: f64) -> f64 {
        let capacitance = EPS0 * self.area_m2 / self.gap_m + ELECTRODE_CABLE_F;
        2.0 * capacitance * voltage_v * frequency_hz
    }

    /// Most travel in m: a third of the gap, and no further than a stop.
    #[must_use]
    pub fn most_travel_m(&self) -> f64 {
        (self.gap_m * TRAVEL_PART).min(self.stop_m)
    }

    /// (s, b) such that V^2 + s x <= b keeps V within 85 % of breakdown in the gap that a press and a travel of x have closed: the tangent
    /// at the largest travel of the convex (0.85 V_b(g - x))^2, level where a stop holds the mass. In V^2/m and V^2.
    #[must_use]
    pub fn breakdown_line(&self) -> (f64, f64) {
        let x = self.most_travel_m();
        let volts = breakdown_v(self.gap_left_m(x));
        if self.sag_m + x >= self.stop_m || volts <= 0.0 {
            return (0.0, (BREAKDOWN_MARGIN * volts).powi(2));
        }
        let gap_cm = self.gap_left_m(x) * 100.0;
        let volts_per_m = (24.22 + 3.04 / gap_cm.sqrt()) * 1e5;
        let slope = BREAKDOWN_MARGIN * BREAKDOWN_MARGIN * 2.0 * volts * volts_per_m;
        (slope, (BREAKDOWN_MARGIN * volts).powi(2) + slope * x)
    }
}

/// How near secants come to a crossing, as a part of it.
const NEAR: f64 = 1e-12;
/// Secants that are drawn at most.
const SECANTS: usize = 12;

/// Where an increasing function of 0 to `most` crosses zero, if secants find it; else anywhere in between.
fn crossing(of: &impl Fn(f64) -> f64, most: f64) -> f64 {
    let (mut before, mut own) = (most, 0.75 * most);
    let (mut at_before, mut at_own) = (of(before), of(own));
    for _ in 0..SECANTS {
        let next = own - at_own * (own - before) / (at_own - at_before);
        if !next.is_finite() || (next - own).abs() <= 0.1 * NEAR * own {
            break;
        }
        (before, at_before) = (own, at_own);
        own = next.clamp(0.0, most);
        at_own = of(own);
    }
    own
}

/// Breakdown voltage of an air gap in V at 1 bar: 24.22 d + 6.08 sqrt(d) kV with d in cm, the usual engineering fit of
/// Paschen's curve right of its minimum. Below 10 um, where the fit ends, it goes down to zero with the gap.
#[must_use]
pub fn breakdown_v(gap_m: f64) -> f64 {
    let gap_cm = gap_m.max(0.0) * 100.0;
    (24.22 * gap_cm + 6.08 * gap_cm.sqrt()) * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const DEFAULT: Electrodes =
        Electrodes { area_m2: 1.9635e-3, gap_m: 0.5e-3, max_voltage_v: 2000.0, stop_m: f64::INFINITY, sag_m: 0.0 };

    #[test]
    fn force_of_the_default_era() {
        // A disc of 50 mm at 0.5 mm: 1.70 kV give 0.1 N.
        let force = DEFAULT.newtons_per_volt_squared() * 1700.0 * 1700.0;
        assert!((force - 0.1).abs() < 1e-3, "{force}");
        assert!(
            (DEFAULT.voltage_for(0.05, 0.8).powi(2) * DEFAULT.harmonic_per_volt_squared(1, 0.8) - 0.05).abs() < 1e-12
        );
    }

    #[test]
    fn two_thirds_has_no_third_harmonic() {
        assert!(DEFAULT.harmonic_per_volt_squared(3, 2.0 / 3.0) < 1e-12 * DEFAULT.harmonic_per_volt_squared(1, 1.0));
    }

    #[test]
    fn breakdown_in_the_closing_gap_matches_the_table() {
        // 0.85 V_b: 2.18 kV at rest, 2.02 at 50 um, 1.85 at 100 um, 1.62 at 167 um.
        for (travel_um, kilovolts) in [(0.0, 2.18), (50.0, 2.02), (100.0, 1.85), (143.0, 1.70), (167.0, 1.62)] {
            let volts = 0.85 * breakdown_v((500.0 - travel_um) * 1e-6);
            assert!((volts / 1e3 - kilovolts).abs() < 0.015, "{travel_um}: {volts}");
        }
    }

    #[test]
    fn each_limit_binds_where_it_should_and_is_kept() {
        for (travel_m_per_n, expected) in [(1e-7, Limit::Voltage), (1e-2, Limit::Travel), (1.2e-3, Limit::Breakdown)] {
            let (force, limit) = DEFAULT.max_force(travel_m_per_n, PULSE);
            assert_eq!(limit, expected, "{travel_m_per_n}");
            let (travel, volts) = (force * travel_m_per_n, DEFAULT.voltage_for(force, PULSE));
            assert!(travel <= DEFAULT.gap_m / 3.0 * (1.0 + 1e-12));
            assert!(volts <= 2000.0 * (1.0 + 1e-12));
            assert!(volts <= 0.85 * breakdown_v(DEFAULT.gap_m - travel) * (1.0 + 1e-9));
        }
    }

    const PULSE: f64 = 2.0 / 3.0;

    proptest! {
        /// The force holds, to rounding, and one of a part in 10^14 more does not: also with pressed gaps, stops, and masses that hardly move or close the gap.
        #[test]
        fn no_more_force_holds(
            travel in -8.0_f64..-1.0,
            gap_um in 50.0_f64..2000.0,
            sag in 0.0_f64..0.9,
            stop in 0.05_f64..1.5,
            volts in 200.0_f64..6000.0,
        ) {
            let gap_m = gap_um * 1e-6;
            let own = Electrodes { gap_m, max_voltage_v: volts, stop_m: stop * gap_m, sag_m: sag * gap_m, ..DEFAULT };
            let travel_m_per_n = 10.0_f64.powf(travel);
            let (force, limit) = own.max_force(travel_m_per_n, PULSE);
            let holds = |force: f64| own.voltage_for(force, PULSE) <= own.holds_v(force * travel_m_per_n);
            prop_assert!(force == 0.0 || holds(force * (1.0 - 1e-15)), "{force} {limit:?}");
            let otherwise = own.harmonic_per_volt_squared(1, PULSE) * volts * volts;
            let otherwise = otherwise.min(own.most_travel_m() / travel_m_per_n);
            match limit {
                Limit::Breakdown => prop_assert!(!holds(force * (1.0 + 1e-14)), "more than {force}"),
                _ => prop_assert!((force / otherwise - 1.0).abs() < 1e-14, "{force} of {otherwise}"),
            }
            prop_assert!(force <= otherwise);
        }
    }
}
