//! Limits that several actuators use up together, as rows sum_j r_j u_j <= b over their forces.
//!
//! - Travel: what all actuators together do to one's gap, sum_j |G_ij(f_j)| u_j <= g_i / 3.
//! - Breakdown: the square of an actuator's voltage, u_i / c_i, at most the square of what the gap holds when it is
//!   closed as far as the travel goes. That square is a convex function of the gap, and its tangent at two thirds of the
//!   gap stays below it: V^2 + s x <= b is safe everywhere, exact where the travel is at its limit, and 2 % of the
//!   voltage short at rest.
//! - Pull-in: the stiffness that electrodes take off their springs, in proportion to their forces, times what a mass yields to
//!   steady forces there; beyond 1 it is pulled in, and up to [`HELD`] is allowed.
//! - Rails: actuators on one rail have its voltage, the highest that one of them asks for.

use crate::physics::limits::{Electrodes, HELD, Limit};
use crate::physics::softening::Transducer;
use crate::scene::MAX_ACTUATORS;
use crate::table::{Entry, Width};
use era_shared::supply::rail_index_of_channel;

/// One row.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Row {
    /// Whose gap.
    actuator: usize,
    kind: Kind,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
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
    rows: Vec<Row>,
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
        let lines: Vec<(f64, f64)> = electrodes.iter().map(Electrodes::breakdown_line).collect();
        let mut limits = Self {
            rows: Vec::new(),
            allowed: Vec::new(),
            slopes: lines.iter().map(|(slope, _)| *slope).collect(),
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
                (Row { actuator, kind: Kind::Travel }, electrodes[actuator].most_travel_m()),
                (Row { actuator, kind: Kind::PullIn }, HELD + counted.sum::<f64>()),
            ];
            let on_its_rail = (0..p).filter(|driver| rail_index_of_channel(*driver) == rail_index_of_channel(actuator));
            rows.extend(
                on_its_rail.map(|driver| (Row { actuator, kind: Kind::Breakdown { driver } }, lines[actuator].1)),
            );
            for (row, allowed) in rows {
                let most: f64 = (0..p)
                    .map(|j| {
                        let load = |entry: &Entry| {
                            let of = |width: &Width| limits.load_of(row, j, width) * width.max_force_n;
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

    /// What one newton of actuator `j`, driven as `width` says, takes of every row.
    pub fn loads<'a>(&'a self, j: usize, width: &'a Width) -> impl Iterator<Item = f64> + 'a {
        self.rows.iter().map(move |row| self.load_of(*row, j, width))
    }

    fn load_of(&self, row: Row, j: usize, width: &Width) -> f64 {
        let travel = width.travel_m_per_n.get(row.actuator).copied().unwrap_or(0.0);
        let Some(electrodes) = self.electrodes.get(j) else { return 0.0 };
        match row.kind {
            Kind::Travel => travel,
            Kind::PullIn => {
                self.static_receptance[row.actuator].get(j).copied().unwrap_or(f64::INFINITY)
                    * electrodes.softening_per_newton(width.pulse_width)
                    * electrodes.pressed_softening()
            }
            Kind::Breakdown { driver } => {
                let voltage =
                    if driver == j { 1.0 / electrodes.harmonic_per_volt_squared(1, width.pulse_width) } else { 0.0 };
                voltage + self.slopes.get(row.actuator).copied().unwrap_or(0.0) * travel
            }
        }
    }

    /// The rows of which forces, one per actuator with its pulse width, use at least this part.
    #[must_use]
    pub fn used(&self, forces: &[(Width, f64)], part: f64) -> Vec<usize> {
        let load = |row: Row| {
            forces.iter().enumerate().map(move |(j, (width, force_n))| self.load_of(row, j, width) * force_n)
        };
        let is_used = |(at, row): &(usize, &Row)| load(**row).sum::<f64>() >= part * self.allowed[*at];
        self.rows.iter().enumerate().filter(is_used).map(|(at, _)| at).collect()
    }

    /// What a row is about: whose gap, and which limit.
    #[must_use]
    pub fn name(&self, row: usize) -> Option<(usize, Limit)> {
        let row = self.rows.get(row)?;
        let limit = match row.kind {
            Kind::Travel => Limit::Travel,
            Kind::Breakdown { .. } => Limit::Breakdown,
            Kind::PullIn => Limit::PullIn,
        };
        Some((row.actuator, limit))
    }
}
