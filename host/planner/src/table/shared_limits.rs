//! Limits that several actuators use up together, as rows sum_j r_j u_j <= b over their forces.
//!
//! - Travel: what all actuators together do to one's gap, sum_j |G_ij(f_j)| u_j <= g_i / 3.
//! - Breakdown: the square of an actuator's voltage, u_i / c_i, at most the square of what the gap holds when it is
//!   closed as far as the travel goes. That square is a convex function of the gap, and its tangent at two thirds of the
//!   gap stays below it: V^2 + s x <= b is safe everywhere, exact where the travel is at its limit, and 2 % of the
//!   voltage short at rest.
//! - Pull-in: the stiffness that electrodes take off their springs, in proportion to their forces, times what a mass yields to
//!   steady forces there; beyond 1 it is pulled in, and up to [`MAX_SOFTENING_FRACTION`] is allowed.
//! - Rails: actuators on one rail have its voltage, the highest that one of them asks for.

use crate::physics::limits::{BreakdownTangent, Electrodes, Limit, MAX_SOFTENING_FRACTION};
use crate::physics::softening::Transducer;
use crate::scene::MAX_ACTUATORS;
use crate::table::{Entry, PulseOption};
use era_shared::supply::rail_index_of_channel;

/// One row.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LimitRow {
    /// Whose gap.
    actuator: usize,
    kind: LimitKind,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum LimitKind {
    Travel,
    /// Under the voltage of this actuator's drive, which the rail has.
    Breakdown {
        driver: usize,
    },
    PullIn,
}

/// The rows that can bind in a scene.
#[derive(Clone, Debug, Default)]
pub struct SharedLimits {
    rows: Vec<LimitRow>,
    /// What each row allows: metres, square volts, or a part of the static stiffness.
    pub allowed: Vec<f64>,
    /// Of each actuator the slope of the tangent in V^2/m.
    slopes: Vec<f64>,
    /// Of each actuator N per V^2 at a pulse width of 1.
    electrodes: Vec<Electrodes>,
    /// Travel of every actuator (row) per steady force on every one, in m/N.
    static_receptance: [[f64; MAX_ACTUATORS]; MAX_ACTUATORS],
}

impl SharedLimits {
    /// The rows for a table's entries, without those that bind nowhere.
    #[must_use]
    pub fn new(
        electrodes: &[Electrodes],
        transducers: &[Transducer],
        static_receptance: [[f64; MAX_ACTUATORS]; MAX_ACTUATORS],
        entries: &[Vec<Option<Entry>>],
    ) -> Self {
        let tangents: Vec<BreakdownTangent> =
            electrodes.iter().map(Electrodes::tangent_of_squared_breakdown_voltage_over_travel).collect();
        let mut limits = Self {
            rows: Vec::new(),
            allowed: Vec::new(),
            slopes: tangents.iter().map(|tangent| tangent.slope_v2_per_m).collect(),
            electrodes: electrodes.to_vec(),
            static_receptance,
        };
        let p = electrodes.len().min(MAX_ACTUATORS);
        if p < 2 {
            // One actuator alone: the limits of its candidates say it all.
            return limits;
        }
        for actuator in 0..p {
            // What a bias already took off is in the model.
            let counted = static_receptance[actuator].iter().zip(transducers).map(|(g, own)| g * own.counted_n_per_m);
            let mut rows = vec![
                (LimitRow { actuator, kind: LimitKind::Travel }, electrodes[actuator].max_travel_m()),
                (LimitRow { actuator, kind: LimitKind::PullIn }, MAX_SOFTENING_FRACTION + counted.sum::<f64>()),
            ];
            let on_its_rail = (0..p).filter(|driver| rail_index_of_channel(*driver) == rail_index_of_channel(actuator));
            rows.extend(on_its_rail.map(|driver| {
                (LimitRow { actuator, kind: LimitKind::Breakdown { driver } }, tangents[actuator].bound_v2)
            }));
            for (row, allowed) in rows {
                let most: f64 = (0..p)
                    .map(|j| {
                        let load = |entry: &Entry| {
                            let of = |width: &PulseOption| {
                                limits.load_per_n_on_limit_in_unit_of_limit(row, j, width) * width.max_force_n
                            };
                            entry.widths.iter().map(of).fold(0.0, f64::max)
                        };
                        entries.get(j).into_iter().flatten().flatten().map(load).fold(0.0, f64::max)
                    })
                    .sum();
                if most > allowed {
                    limits.rows.push(row);
                    limits.allowed.push(allowed);
                }
            }
        }
        limits
    }

    /// What one newton of actuator `actuator` with the pulse option `pulse` uses of every row.
    pub fn load_per_n_on_each_limit_in_unit_of_limit<'a>(
        &'a self,
        actuator: usize,
        pulse: &'a PulseOption,
    ) -> impl Iterator<Item = f64> + 'a {
        self.rows.iter().map(move |row| self.load_per_n_on_limit_in_unit_of_limit(*row, actuator, pulse))
    }

    fn load_per_n_on_limit_in_unit_of_limit(&self, row: LimitRow, actuator: usize, pulse: &PulseOption) -> f64 {
        let travel = pulse.travel_m_per_n.get(row.actuator).copied().unwrap_or(0.0);
        let Some(electrodes) = self.electrodes.get(actuator) else { return 0.0 };
        match row.kind {
            LimitKind::Travel => travel,
            LimitKind::PullIn => {
                self.static_receptance[row.actuator].get(actuator).copied().unwrap_or(f64::INFINITY)
                    * pulse.softening_n_per_m_per_n
                    * electrodes.softening_under_press_relative_to_rest()
            }
            LimitKind::Breakdown { driver } => {
                let voltage = if driver == actuator { pulse.square_volts_per_n } else { 0.0 };
                voltage + self.slopes.get(row.actuator).copied().unwrap_or(0.0) * travel
            }
        }
    }

    /// Indices of the rows of which the given forces, one per actuator with its pulse option, use at least the
    /// fraction `fraction`.
    #[must_use]
    pub fn find_limit_rows_used_above_fraction(&self, forces: &[(PulseOption, f64)], fraction: f64) -> Vec<usize> {
        let load = |row: LimitRow| {
            forces
                .iter()
                .enumerate()
                .map(move |(j, (width, force_n))| self.load_per_n_on_limit_in_unit_of_limit(row, j, width) * force_n)
        };
        let is_used = |(at, row): &(usize, &LimitRow)| load(**row).sum::<f64>() >= fraction * self.allowed[*at];
        self.rows.iter().enumerate().filter(is_used).map(|(at, _)| at).collect()
    }

    /// The actuator whose gap a row is about, and the kind of its limit; `None` if the row does not exist.
    #[must_use]
    pub fn actuator_and_limit_of_row_if_in_range(&self, row_index: usize) -> Option<(usize, Limit)> {
        let row = self.rows.get(row_index)?;
        let limit = match row.kind {
            LimitKind::Travel => Limit::Travel,
            LimitKind::Breakdown { .. } => Limit::Breakdown,
            LimitKind::PullIn => Limit::PullIn,
        };
        Some((row.actuator, limit))
    }
}
