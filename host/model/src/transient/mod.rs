//! Motion in time: M q'' + C q' + K q = f(t) from any initial state, on a uniform grid of times.
//!
//! The thesis (equations 16 to 21) diagonalises the state matrix of 2n unknowns and inverts its matrix of eigenvectors,
//! which does not exist at critical damping. [`as_published`] does that, for comparison. [`Propagator`] does this:
//!
//! - C that commutes with K in mass coordinates (proportional damping, detected): n real modes, each with the 2 x 2
//!   propagator of a damped oscillator in a form that stays right through critical damping ([`oscillator`]).
//! - Any other C: the state (W q, q') with `W^T W` = K + sigma M, in which a dissipative system's propagator is a
//!   contraction, and the matrix exponential of one time step.
//!
//! Harmonic forces add a steady state, solved per frequency; an undamped resonance, which has none, is propagated with
//! the force's phasor as two more states. Times are reached in blocks: L output rows over one block, times the states at
//! the starts of all blocks, is one matrix product per output.

pub mod as_published;
mod blocks;
mod exponential;
mod modal;
pub mod oscillator;
pub mod panel;
mod propagator;
pub mod reduced;
mod sampled;
mod state;
mod steady;
mod system;

pub use propagator::Propagator;
pub use steady::solve_steady_state;

use nalgebra::{DMatrix, DVector};

/// M q'' + C q' + K q = f with n unknowns; all matrices n x n, in consistent units (kg, N s/m, N/m for translations).
#[derive(Clone, Debug, PartialEq)]
pub struct SecondOrderSystem {
    /// Mass: symmetric, positive definite.
    pub m: DMatrix<f64>,
    /// Viscous damping: any; symmetric unless there are gyroscopic forces.
    pub c: DMatrix<f64>,
    /// Stiffness: symmetric; may be singular (rigid motions) or indefinite (a softened spring).
    pub k: DMatrix<f64>,
}

/// A harmonic force, `force_n` cos(`omega_rad_s` t + `phase_rad`), switched on at t = 0.
#[derive(Clone, Debug, PartialEq)]
pub struct HarmonicForce {
    /// Angular frequency in rad/s, 0 and up.
    pub omega_rad_s: f64,
    /// Phase at t = 0 in rad; -pi/2 makes a sine.
    pub phase_rad: f64,
    /// Amplitude on each unknown, length n.
    pub force_n: DVector<f64>,
}

/// Displacement and velocity at t = 0, length n each.
#[derive(Clone, Debug, PartialEq)]
pub struct InitialState {
    /// q(0).
    pub displacement: DVector<f64>,
    /// q'(0).
    pub velocity: DVector<f64>,
}

impl InitialState {
    /// The state at rest.
    #[must_use]
    pub fn at_rest(unknowns: usize) -> Self {
        Self { displacement: DVector::zeros(unknowns), velocity: DVector::zeros(unknowns) }
    }
}

/// Times 0, `step_s`, ..., (`count` - 1) `step_s`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeGrid {
    /// Step in s, above 0.
    pub step_s: f64,
    /// Number of times, 1 to [`MOST_TIMES`].
    pub count: usize,
}

/// Most times of a grid.
pub const MOST_TIMES: usize = 10_000_000;

impl TimeGrid {
    /// The time of an index in s.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "at most MOST_TIMES")]
    pub fn time_at_index_s(&self, index: usize) -> f64 {
        index as f64 * self.step_s
    }
}

/// What to put out: rows times q, q' or q''.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionQuantity {
    /// q.
    Displacement,
    /// q'.
    Velocity,
    /// q''.
    Acceleration,
}

/// Of which unknowns.
#[derive(Clone, Copy, Debug)]
pub enum OutputRows<'a> {
    /// Every unknown.
    All,
    /// Combinations of them: r x n.
    Rows(&'a DMatrix<f64>),
}

/// Why there is no motion to show.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TransientError {
    /// A matrix or vector of the wrong size.
    #[error("{what} is {rows} x {columns}, but must be {expected_rows} x {expected_columns}")]
    Shape {
        /// Which one.
        what: &'static str,
        /// As given.
        rows: usize,
        /// As given.
        columns: usize,
        /// As it must be.
        expected_rows: usize,
        /// As it must be.
        expected_columns: usize,
    },
    /// An entry that is no number.
    #[error("{what} has an entry that is not finite")]
    NotFinite {
        /// Which one.
        what: &'static str,
    },
    /// A matrix that must equal its transpose and does not.
    #[error("{what} is not symmetric: entry ({row}, {column}) differs from its mirror image by {difference}")]
    NotSymmetric {
        /// Which one.
        what: &'static str,
        /// Row of the worst entry.
        row: usize,
        /// Its column.
        column: usize,
        /// By how much.
        difference: f64,
    },
    /// A mass matrix without mass in some direction.
    #[error("the mass matrix m is not positive definite: an unknown, or a combination of unknowns, has no mass")]
    NoMass,
    /// A number outside its range.
    #[error("{what} is {value}, but must be {min} to {max}")]
    Range {
        /// Which one.
        what: &'static str,
        /// As given.
        value: f64,
        /// Least allowed.
        min: f64,
        /// Most allowed.
        max: f64,
    },
    /// An undamped resonance: no steady state (thesis, after equation 15).
    #[error(
        "a force with the angular frequency {omega_rad_s} rad/s drives an undamped mode at its resonance frequency, \
         so there is no steady state"
    )]
    Unbounded {
        /// Angular frequency of the force.
        omega_rad_s: f64,
    },
    /// Eigenvectors that do not span the state space: the published equations have no solution.
    #[error("the matrix of eigenvectors is singular, so the solution by eigenvectors does not exist")]
    Defective,
}
