//! ERAs, and what voltage does to their springs.

use serde::{Deserialize, Serialize};

/// Permittivity of vacuum in F/m (CODATA 2018); air differs by 0.06 %.
pub const EPS0: f64 = 8.854_187_812_8e-12;
/// Capacitance in F that a scene's actuators have beside each electrode if it names none: with the 35 pF of the default electrode the
/// 116 pF that the board's drive stage is designed for (cable 65 pF, switches 10 pF, transformer of the gate 6 pF).
pub const DEFAULT_CABLE_CAPACITANCE_F: f64 = 81e-12;

/// How an ERA is mounted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Mount {
    /// Housing on the surface, moving mass inside: equal and opposite force on surface and mass.
    Inertial,
    /// Between base and surface: the mass rides on the surface, force on the surface alone.
    Grounded,
}

/// How fast an electrode follows its switches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ChargingTimes {
    /// Time constant in s with which it rises to its rail's voltage while its window lasts; 0: at once, and the others are of no account.
    pub rise_s: f64,
    /// From the end of a window until it begins to fall, in s.
    pub hold_s: f64,
    /// Time constant in s with which it then falls; 0: at once.
    pub fall_s: f64,
}

impl ChargingTimes {
    /// Whether the electrode follows its switches at once.
    #[must_use]
    pub fn is_instant(&self) -> bool {
        self.rise_s <= 0.0
    }
}

/// An ERA.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Actuator {
    /// Its name.
    pub id: String,
    /// In m.
    pub x_m: f64,
    /// In m.
    pub y_m: f64,
    /// How it is mounted.
    pub mount: Mount,
    /// In kg.
    pub moving_mass_kg: f64,
    /// Of its springs in N/m.
    pub stiffness_n_per_m: f64,
    /// Of its springs in N s/m.
    pub damping_n_s_per_m: f64,
    /// In kg.
    pub housing_mass_kg: f64,
    /// Of one electrode in m^2.
    pub electrode_area_m2: f64,
    /// On each side at rest in m.
    pub air_gap_m: f64,
    /// In V.
    pub max_voltage_v: f64,
    /// Where a stop holds the mass, from its middle to either side, in m; `None` without one.
    pub stop_m: Option<f64>,
    /// Root mean square of the voltage that is on one electrode or the other, in V; what its springs are softened by.
    pub bias_voltage_v: f64,
    /// Capacitance of what hangs on each electrode, its cable and its switches, in F.
    pub cable_capacitance_f: f64,
    /// How its electrodes charge and discharge.
    pub charging: ChargingTimes,
}

impl Actuator {
    /// What electrodes in turn take off the springs, in N/m.
    ///
    /// The electrode at distance g - x pulls with eps0 A V^2 / (2 (g - x)^2), the one at g + x the other way. At x = 0 either
    /// force changes with x at the rate eps0 A V^2 / g^3, as a spring of negative stiffness does. As one or the other is on,
    /// that is the rate whichever it is, and its mean over time has the mean square of the voltage.
    #[must_use]
    pub fn softening_n_per_m(&self) -> f64 {
        EPS0 * self.electrode_area_m2 * self.bias_voltage_v.powi(2) / self.air_gap_m.powi(3)
    }

    /// Capacitance of one electrode with its cable and its switches in F, the mass at rest.
    #[must_use]
    pub fn capacitance_of_electrode_with_cable_f(&self) -> f64 {
        EPS0 * self.electrode_area_m2 / self.air_gap_m + self.cable_capacitance_f
    }

    /// Stiffness between its mass and its electrodes in N/m: that of its springs less the electrodes' softening.
    #[must_use]
    pub fn effective_stiffness_n_per_m(&self) -> f64 {
        self.stiffness_n_per_m - self.softening_n_per_m()
    }

    /// Voltage in V at which nothing is left of its springs and an electrode pulls the mass in: sqrt(k g^3 / (eps0 A)).
    #[must_use]
    pub fn voltage_at_which_softening_cancels_springs_v(&self) -> f64 {
        (self.stiffness_n_per_m * self.air_gap_m.powi(3) / (EPS0 * self.electrode_area_m2)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn softening_of_the_default_era() {
        let era = Actuator {
            id: "era".into(),
            x_m: 0.0,
            y_m: 0.0,
            mount: Mount::Inertial,
            moving_mass_kg: 0.01,
            stiffness_n_per_m: 5000.0,
            damping_n_s_per_m: 1.1,
            housing_mass_kg: 0.0,
            electrode_area_m2: 1.9635e-3,
            air_gap_m: 0.5e-3,
            max_voltage_v: 2000.0,
            stop_m: None,
            bias_voltage_v: 1700.0,
            cable_capacitance_f: DEFAULT_CABLE_CAPACITANCE_F,
            charging: ChargingTimes::default(),
        };
        // 2 F / g with F = 0.1 N at 1.7 kV: 400 N/m, 8 % of its springs.
        assert!((era.softening_n_per_m() - 400.0).abs() < 4.0, "{}", era.softening_n_per_m());
        assert_eq!(era.effective_stiffness_n_per_m(), 5000.0 - era.softening_n_per_m());
        // The board counts 116 pF.
        assert!(
            (era.capacitance_of_electrode_with_cable_f() - 116e-12).abs() < 1e-12,
            "{}",
            era.capacitance_of_electrode_with_cable_f()
        );
        let at_pull_in = Actuator { bias_voltage_v: era.voltage_at_which_softening_cancels_springs_v(), ..era };
        assert!(at_pull_in.effective_stiffness_n_per_m().abs() < 1e-9);
    }

    /// The rate is the derivative of the two electrodes' mean force, by differences.
    #[test]
    fn softening_is_the_derivative_of_the_force() {
        let (area, gap, volts) = (1e-3, 0.4e-3, 900.0_f64);
        let pull = |x: f64| EPS0 * area * volts * volts / (2.0 * (gap - x).powi(2));
        // Half the time each.
        let force = |x: f64| 0.5 * (pull(x) - pull(-x));
        let h = 1e-8;
        let rate = (force(h) - force(-h)) / (2.0 * h);
        let expected = EPS0 * area * volts * volts / gap.powi(3);
        assert!((rate / expected - 1.0).abs() < 1e-6, "{rate} {expected}");
    }
}
