//! One frequency for all actuators, each with a phase of its own: the least energy elsewhere for a wanted peak at the
//! target, proven.
//!
//! At a frequency the actuators' forces are phasors u. At the target they make |sum_i h_i u_i|, elsewhere the mean square
//! u^H E u. Limits are |u_i| <= U_i and, for every actuator's mass, its travel |sum_j G_ij u_j| <= t_i, G the receptances.
//!
//! - `unlimited`: without limits the best is s = h^T E^-1 conj(h) (peak squared over energy), with u ~ E^-1 conj(h). A peak a
//!   then costs a^2 / s, which bounds what it costs with limits.
//! - `program`, `barrier`, `optimum`: with limits a frequency leaves a convex problem, solved by an interior-point method
//!   whose dual value proves how far from the optimum it may be.
//! - `search`: frequencies are solved in the order of their bounds, until the next bound is no better than the best.
//! - `drives`: a plan from it.
//!
//! Two solutions stay, the closed one without limits and the interior-point method, because neither can do the other's part. On random
//! panels (2 to 4 actuators, 180 frequencies, optimised build) the closed form meets 84 to 97 % of wishes of a hundredth of the largest
//! peak; of wishes of 60 % of it only 2 to 7 %, and scaled down to the limits it reaches 10 to 21 % of that peak in the median. The
//! interior-point method alone finds the same energies to 1e-10, but takes 63 to 74 us in the median instead of 18 to 24 us for the small
//! wishes; for large ones the two take equally long. The closed form also gives the bounds by which `search` orders frequencies.

mod barrier;
pub(crate) mod drives;
mod optimum;
mod program;
#[cfg(test)]
mod scene_tests;
mod search;
mod small;
#[cfg(test)]
mod tests;
mod unlimited;

use crate::physics::{PerPair, Phasors};
use crate::scene::MAX_ACTUATORS;
use num_complex::Complex64;

const ZERO: Complex64 = Complex64::ZERO;

/// What the actuators do at every frequency of a grid, seen from one target. Entries of actuators beyond `actuators` are
/// of no account. All slices are as long as `frequencies_hz`.
#[derive(Clone, Copy, Debug)]
pub struct TargetField<'a> {
    /// Ascending, in Hz.
    pub frequencies_hz: &'a [f64],
    /// How many there are: 1 to [`MAX_ACTUATORS`].
    pub actuators: usize,
    /// Acceleration at the target per newton of each actuator, in m/s^2/N.
    pub gain: &'a [Phasors],
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

/// The best drives.
#[derive(Clone, Debug, PartialEq)]
pub struct BestPhasors {
    /// Index into the grid.
    pub frequency: usize,
    /// Phasors of the forces in N; in phase at the target, where their sum is real.
    pub forces_n: Phasors,
    /// Mean square elsewhere in (m/s^2)^2.
    pub energy: f64,
    /// Peak at the target in m/s^2: what is wanted, or the most that there is less a part of [`REACH_SLACK`].
    pub reached: f64,
    /// No frequency has an energy below `energy * (1 - proven_gap)` for the same peak, or, if the wish is not met, a peak
    /// above `reached / (1 - proven_gap)`. Rounding (1e-9 and below).
    pub proven_gap: f64,
    /// Convex problems solved on the way; 0 if no limit binds.
    pub solved: usize,
}

/// Where the wish cannot be met, part of the most there is that is given up, so that the least energy for it is a
/// well-posed problem. Not felt (1e-8 dB).
pub const REACH_SLACK: f64 = 1e-9;

/// The least energy elsewhere for a peak of `wanted_m_per_s2` m/s^2 at the target, over all frequencies of the grid; the most peak
/// there is if the wish is beyond reach. Without a positive wish the forces are zero.
///
/// `None` if there is no frequency at which anything can be driven, or if the field's slices differ in length.
#[must_use]
pub fn find_least_energy_or_largest_peak_phasors(field: &TargetField<'_>, wanted_m_per_s2: f64) -> Option<BestPhasors> {
    let count = field.frequencies_hz.len();
    let lengths = [field.gain.len(), field.energy.len(), field.max_force_n.len(), field.travel.len()];
    if !(1..=MAX_ACTUATORS).contains(&field.actuators) || lengths.iter().any(|length| *length != count) {
        return None;
    }
    search::find_least_energy_else_largest_peak(field, wanted_m_per_s2)
}

/// The actuators of a mask, ascending.
fn actuator_indices_in_mask(mask: u8) -> impl Iterator<Item = usize> {
    (0..MAX_ACTUATORS).filter(move |i| mask >> i & 1 == 1)
}
