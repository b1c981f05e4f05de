//! Actuators that share a frequency, with phases: the least energy elsewhere for a wanted peak at the target, proven.
//!
//! A group S of actuators vibrates at one frequency with complex forces u; groups are at frequencies of their own, some
//! distance apart. At the target a group makes |sum_i h_i u_i|, and the peaks of groups add (thesis, equation 23);
//! elsewhere it leaves the mean square u^H E u, and mean squares of groups add. Limits are |u_i| <= U_i and, for every
//! actuator's mass, the travel that all groups together give it: sum over groups of |sum_j G_ij u_j| <= t_i.
//!
//! - `scores`: without limits a group's best is s = h^T E^-1 conj(h) (peak squared over energy) with u ~ E^-1 conj(h),
//!   and the least energy of a choice of groups and frequencies for a peak a is a^2 / sum s.
//! - `program`, `barrier`, `leaf`: with limits a choice of groups and frequencies leaves a convex problem, solved by
//!   an interior-point method whose dual value proves how far from the optimum it may be.
//! - `bounds`, `search`, `enumerate`: the best choice, by dynamic programming over the sorted frequencies and the subsets of
//!   actuators, and where limits bind by a ranked enumeration with bounds from the Lagrangian relaxation.

mod barrier;
mod bounds;
mod enumerate;
mod leaf;
mod program;
#[cfg(test)]
mod scene_tests;
mod scores;
mod search;
mod small;
#[cfg(test)]
mod tests;

use crate::scene::MAX_ACTUATORS;
use num_complex::Complex64;

/// Number of subsets of the actuators; a subset is a bit mask, bit i for actuator i.
const SUBSETS: usize = 1 << MAX_ACTUATORS;

/// One complex number per actuator.
pub type PerActuator = [Complex64; MAX_ACTUATORS];
/// One complex number per pair of actuators, row by row.
pub type PerPair = [PerActuator; MAX_ACTUATORS];

const ZERO: Complex64 = Complex64::ZERO;

/// What the actuators do at every frequency of a grid, seen from one target. Entries of actuators beyond `actuators` are
/// of no account. All slices are as long as `frequencies_hz`.
#[derive(Clone, Copy, Debug)]
pub struct Field<'a> {
    /// Ascending, in Hz.
    pub frequencies_hz: &'a [f64],
    /// How many there are: 1 to [`MAX_ACTUATORS`].
    pub actuators: usize,
    /// Acceleration at the target per newton of each actuator, in m/s^2/N.
    pub gain: &'a [PerActuator],
    /// Mean over elsewhere of conj(H_i) H_j in (m/s^2/N)^2: Hermitian, positive (semi)definite. Only the lower triangle is
    /// read.
    pub energy: &'a [PerPair],
    /// Most force amplitude of each actuator on its own in N; 0 where it cannot be driven (unbounded response).
    pub max_force_n: &'a [[f64; MAX_ACTUATORS]],
    /// Travel of actuator i's mass relative to its electrodes per newton of actuator j, in m/N: `travel[k][i][j]`.
    pub travel: &'a [PerPair],
    /// Most travel of each actuator's mass in m, more than 0; infinite where there is no limit.
    pub max_travel_m: [f64; MAX_ACTUATORS],
}

/// Which actuators may have a frequency in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grouping {
    /// All share one.
    Shared,
    /// Any grouping, all on their own and all together included.
    Mixed,
}

/// Actuators at one frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Group {
    /// Bit i is set for actuator i.
    pub members: u8,
    /// Index into the grid.
    pub frequency: usize,
    /// Complex force amplitudes in N, zero for who is no member; in phase at the target, where their sum is real.
    pub forces_n: PerActuator,
}

/// The best drives.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Every actuator is in one of them.
    pub groups: Vec<Group>,
    /// Mean square elsewhere in (m/s^2)^2.
    pub energy: f64,
    /// Peak at the target in m/s^2: what is wanted, or the most that there is less a part of [`REACH_SLACK`].
    pub reached: f64,
    /// No choice has an energy below `energy * (1 - proven_gap)` for the same peak, or, if the wish is not met, a peak
    /// above `reached / (1 - proven_gap)`. Rounding (1e-9 and below) unless the search met its limit of work.
    pub proven_gap: f64,
    /// Convex problems solved on the way; 0 if no limit binds.
    pub solved: usize,
}

/// Where the wish cannot be met, part of the most there is that is given up, so that the least energy for it is a
/// well-posed problem. Not felt (1e-8 dB).
pub const REACH_SLACK: f64 = 1e-9;

/// The least energy elsewhere for a peak of `wanted` m/s^2 at the target, over all frequencies of the grid and all
/// groupings allowed, frequencies of different groups at least `spacing_hz` apart; the most peak there is if the wish is
/// beyond reach. Without a positive finite wish the forces are zero.
///
/// `None` if there is no frequency at which anything can be driven, or if the field's slices differ in length.
#[must_use]
pub fn best(field: &Field<'_>, grouping: Grouping, wanted: f64, spacing_hz: f64) -> Option<Found> {
    let count = field.frequencies_hz.len();
    let lengths = [field.gain.len(), field.energy.len(), field.max_force_n.len(), field.travel.len()];
    if !(1..=MAX_ACTUATORS).contains(&field.actuators) || lengths.iter().any(|length| *length != count) {
        return None;
    }
    search::best(field, grouping, wanted, spacing_hz)
}
