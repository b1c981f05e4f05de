//! An interior-point method for [`Program`]: logarithmic barrier, Newton steps, and a dual value as certificate.
//!
//! Minimises x^H E x subject to Re(h x) >= 1, or -Re(h x), where |x_i| <= 1 and |z_i| <= 1 with the travels z = G x. The
//! barrier is -log of 1 - |x_i|^2, 1 - |z_i|^2, Re(h x) - 1 (Boyd and Vandenberghe, Convex Optimization, section 11.3); its
//! minimum at weight t (1 over the barrier parameter) is within nu / t of the optimum, nu the number of limits.
//!
//! The certificate does not rely on that: for any dual variables l of the peak, y_i of the travels and
//! w = l conj(h) - 2 E x - sum conj(G_i) y_i, the Lagrangian's minimum over all phasors is
//! D = l - sum |w_i| - sum |y_i| - x^H E x, which no feasible point undercuts. For the most peak E is left out, and l is 1 and
//! not counted in D.
//!
//! Unknowns are v with x = Q v and E = Q diag Q^H: where actuators act alike, E is nearly singular, and what the barrier
//! says about the directions without energy would be lost beside the others if they were not apart.

use super::program::{Program, multiply_row_by_phasors};
use super::small::{
    MOST_UNKNOWNS, Matrix, Vector, add_lower_triangle_of_outer_product, solve_in_place_if_positive_definite,
};
use super::{PerPair, Phasors, ZERO};
use crate::scene::MAX_ACTUATORS;
use num_complex::Complex64;

/// Growth of the barrier's weight from one centring to the next.
const GROWTH: f64 = 12.0;
/// Centrings: 12^24 = 8e25, beyond what a double resolves.
const CENTRINGS: usize = 24;
/// Part of the gap that a centring has to take away, and growth of the weight from which on it counts: then rounding has
/// the word.
const STUCK: f64 = 0.9;
const WELL_UNDER_WAY: f64 = 1e6;
/// Newton steps per centring; a dozen are usual at most.
const STEPS: usize = 60;
/// Square of the Newton decrement at which a point counts as centred; the certificate is valid at any.
const CENTRED: f64 = 1e-2;
/// Below this square of the decrement full steps are safe (self-concordance: decrement < 1/4), and rounding of the
/// barrier's value, which grows with the weight, would only mislead.
const FULL_STEPS: f64 = 0.06;

/// What is minimised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Objective {
    /// The energy of a peak of 1 or more.
    LeastEnergy,
    /// Minus the peak.
    MostPeak,
}

/// What came out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solution {
    /// Phasors in parts of their limits; within this module in eigenvectors of the energy.
    pub(super) x: Phasors,
    /// The objective there.
    value: f64,
    /// No feasible point has less.
    pub(super) bound: f64,
}

struct Barrier {
    /// In eigenvectors of the energy.
    program: Program,
    /// The eigenvectors, as columns.
    vectors: PerPair,
    objective: Objective,
    /// Rows of the travels that may be too far.
    travels: Vec<Phasors>,
    /// Where each phasor's two unknowns are.
    place: [usize; MAX_ACTUATORS],
    unknowns: usize,
}

/// Solves from `start`, strictly within the limits, until value and bound differ by at most `tolerance` times the larger, or
/// `is_close_enough` says so of the two.
pub(super) fn solve_by_barrier(
    program: &Program,
    objective: Objective,
    start: &Phasors,
    tolerance: f64,
    is_close_enough: impl Fn(f64, f64) -> bool,
) -> Solution {
    let barrier = Barrier::new(program, objective);
    let mut point = barrier.eigenvector_coordinates_of_phasors(start);
    let first = barrier.count_barrier_terms() / barrier.estimate_objective_range(&point).max(f64::MIN_POSITIVE);
    let mut weight = first;
    let mut best = barrier.build_certified_solution_after_step(weight, &point, &[0.0; MOST_UNKNOWNS]);
    for _ in 0..CENTRINGS {
        let step = barrier.centre_point_and_return_unapplied_newton_step(weight, &mut point);
        let solution = barrier.build_certified_solution_after_step(weight, &point, &step);
        point = solution.x;
        // Values fall and bounds rise, until rounding ends it.
        let bound = best.bound.max(solution.bound);
        let stuck = solution.value - bound >= STUCK * (best.value - best.bound);
        if solution.value <= best.value {
            (best.x, best.value) = (solution.x, solution.value);
        }
        best.bound = bound;
        let gap = best.value - best.bound;
        if gap <= tolerance * best.value.abs().max(best.bound.abs()) || stuck && weight > WELL_UNDER_WAY * first {
            break;
        }
        if is_close_enough(best.value, best.bound) {
            break;
        }
        weight *= GROWTH;
    }
    best.x = barrier.phasors_from_eigenvector_coordinates(&best.x);
    best
}

impl Barrier {
    fn new(program: &Program, objective: Objective) -> Self {
        let (mut place, mut unknowns) = ([0; MAX_ACTUATORS], 0);
        for i in program.drivable_actuators() {
            place[i] = unknowns;
            unknowns += 2;
        }
        // Before the turn: phasors are limited, their parts in eigenvectors are not.
        let binding = (0..MAX_ACTUATORS).filter(|row| program.can_reach_travel_limit(*row));
        let (turned, vectors) = program.diagonalize_energy_and_get_eigenvectors();
        let travels = binding.map(|row| turned.travel[row]).collect();
        Self { program: turned, vectors, objective, travels, place, unknowns }
    }

    fn phasors_from_eigenvector_coordinates(&self, v: &Phasors) -> Phasors {
        std::array::from_fn(|i| multiply_row_by_phasors(&self.vectors[i], v))
    }

    fn eigenvector_coordinates_of_phasors(&self, x: &Phasors) -> Phasors {
        std::array::from_fn(|n| (0..MAX_ACTUATORS).map(|i| self.vectors[i][n].conj() * x[i]).sum())
    }

    /// Rows r of the limits |r v| <= 1: phasors, then travels.
    fn limit_rows(&self) -> impl Iterator<Item = &Phasors> {
        self.program.drivable_actuators().map(|i| &self.vectors[i]).chain(&self.travels)
    }

    /// nu.
    #[expect(clippy::cast_precision_loss, reason = "small counts")]
    fn count_barrier_terms(&self) -> f64 {
        (self.limit_rows().count() + usize::from(self.objective == Objective::LeastEnergy)) as f64
    }

    /// How much the objective may change at all, roughly.
    fn estimate_objective_range(&self, v: &Phasors) -> f64 {
        match self.objective {
            Objective::LeastEnergy => self.program.energy_of_phasors(v),
            Objective::MostPeak => self.program.max_peak_without_travel_limits(),
        }
    }

    fn objective_without_barrier(&self, v: &Phasors) -> f64 {
        match self.objective {
            Objective::LeastEnergy => self.program.energy_of_phasors(v),
            Objective::MostPeak => -self.program.real_part_of_peak_at_target(v),
        }
    }

    /// Objective and barrier; infinite outside.
    fn weighted_objective_plus_barrier_or_infinity(&self, weight: f64, v: &Phasors) -> f64 {
        let mut logs = 0.0;
        let mut inside = true;
        let mut add = |slack: f64| {
            inside &= slack > 0.0;
            logs += slack.ln();
        };
        for row in self.limit_rows() {
            add(one_minus_squared_magnitude(multiply_row_by_phasors(row, v)));
        }
        if self.objective == Objective::LeastEnergy {
            add(self.program.real_part_of_peak_at_target(v) - 1.0);
        }
        if inside { weight * self.objective_without_barrier(v) - logs } else { f64::INFINITY }
    }

    /// Newton's method on the barrier, up to the last step, which is returned.
    fn centre_point_and_return_unapplied_newton_step(&self, weight: f64, point: &mut Phasors) -> Vector {
        const NONE: Vector = [0.0; MOST_UNKNOWNS];
        let mut merit = self.weighted_objective_plus_barrier_or_infinity(weight, point);
        for _ in 0..STEPS {
            let Some((step, decrement)) = self.newton_step_and_squared_decrement_if_positive_definite(weight, point)
            else {
                return NONE;
            };
            if decrement < CENTRED {
                return step;
            }
            let mut length = 1.0;
            loop {
                let trial = self.point_after_step(point, &step, length);
                let there = self.weighted_objective_plus_barrier_or_infinity(weight, &trial);
                if there < merit - 1e-4 * length * decrement || decrement < FULL_STEPS && there.is_finite() {
                    (*point, merit) = (trial, there);
                    break;
                }
                length *= 0.5;
                if length < 1e-12 {
                    return NONE;
                }
            }
        }
        NONE
    }

    fn point_after_step(&self, point: &Phasors, step: &Vector, length: f64) -> Phasors {
        let mut moved = *point;
        for i in self.program.drivable_actuators() {
            moved[i] += Complex64::new(step[self.place[i]], step[self.place[i] + 1]) * length;
        }
        moved
    }

    /// The Newton step and the square of its decrement.
    fn newton_step_and_squared_decrement_if_positive_definite(
        &self,
        weight: f64,
        point: &Phasors,
    ) -> Option<(Vector, f64)> {
        let program = &self.program;
        let (mut gradient, mut hessian) = ([0.0; MOST_UNKNOWNS], [[0.0; MOST_UNKNOWNS]; MOST_UNKNOWNS]);
        // Weight of the energy, pull towards the peak, and how the pull changes with it.
        let (energy_weight, pull, stiffness) = match self.objective {
            Objective::LeastEnergy => {
                let pull = (program.real_part_of_peak_at_target(point) - 1.0).recip();
                (weight, pull, pull * pull)
            }
            Objective::MostPeak => (0.0, weight, 0.0),
        };
        let mut towards_peak = [0.0; MOST_UNKNOWNS];
        for i in program.drivable_actuators() {
            let at = self.place[i];
            let energy = 2.0 * energy_weight * program.energy[i][i].re;
            let g = point[i] * energy - program.gain[i].conj() * pull;
            (gradient[at], gradient[at + 1]) = (g.re, g.im);
            (hessian[at][at], hessian[at + 1][at + 1]) = (energy, energy);
            (towards_peak[at], towards_peak[at + 1]) = (program.gain[i].re, -program.gain[i].im);
        }
        add_lower_triangle_of_outer_product(&mut hessian, &towards_peak, stiffness, self.unknowns);
        for row in self.limit_rows() {
            self.add_barrier_derivatives_of_limit(
                row,
                multiply_row_by_phasors(row, point),
                &mut gradient,
                &mut hessian,
            );
        }
        let mut step = gradient.map(|gradient| -gradient);
        solve_in_place_if_positive_definite(self.unknowns, &mut hessian, &mut step)?;
        let decrement = -(0..self.unknowns).map(|i| step[i] * gradient[i]).sum::<f64>();
        Some((step, decrement))
    }

    /// Adds -log(1 - |z|^2) with z = row v.
    fn add_barrier_derivatives_of_limit(
        &self,
        row: &Phasors,
        row_value: Complex64,
        gradient: &mut Vector,
        hessian: &mut Matrix,
    ) {
        let slack = one_minus_squared_magnitude(row_value);
        // Gradients of Re z, Im z and of the slack.
        let (mut re, mut im) = ([0.0; MOST_UNKNOWNS], [0.0; MOST_UNKNOWNS]);
        for j in self.program.drivable_actuators() {
            (re[self.place[j]], re[self.place[j] + 1]) = (row[j].re, -row[j].im);
            (im[self.place[j]], im[self.place[j] + 1]) = (row[j].im, row[j].re);
        }
        let mut normal = [0.0; MOST_UNKNOWNS];
        for i in 0..self.unknowns {
            normal[i] = -2.0 * (row_value.re * re[i] + row_value.im * im[i]);
            gradient[i] -= normal[i] / slack;
        }
        add_lower_triangle_of_outer_product(hessian, &normal, 1.0 / (slack * slack), self.unknowns);
        add_lower_triangle_of_outer_product(hessian, &re, 2.0 / slack, self.unknowns);
        add_lower_triangle_of_outer_product(hessian, &im, 2.0 / slack, self.unknowns);
    }

    /// The certificate at a point, with the dual variables as they will be, to first order, after the Newton step: they solve
    /// the equations of the optimum in all phasors that no limit touches, where a slack's own rounding would not let them.
    /// The solution's point is the one after the step, if that is inside.
    fn build_certified_solution_after_step(&self, weight: f64, point: &Phasors, unapplied_step: &Vector) -> Solution {
        let program = &self.program;
        let after = self.point_after_step(point, unapplied_step, 1.0);
        // Changes come from the step itself: as differences they would be lost in rounding.
        let moved = self.point_after_step(&[ZERO; MAX_ACTUATORS], unapplied_step, 1.0);
        let (of_peak, demanded, energy_weight) = match self.objective {
            Objective::LeastEnergy => {
                let slack = program.real_part_of_peak_at_target(point) - 1.0;
                let of_peak = ((1.0 - program.real_part_of_peak_at_target(&moved) / slack) / (weight * slack)).max(0.0);
                (of_peak, of_peak, 1.0)
            }
            Objective::MostPeak => (1.0, 0.0, 0.0),
        };
        let energy = program.multiply_by_energy_matrix(&after);
        let mut w: Phasors =
            std::array::from_fn(|i| program.gain[i].conj() * of_peak - energy[i] * (2.0 * energy_weight));
        let mut of_travels = 0.0;
        for row in &self.travels {
            let (z, dz) = (multiply_row_by_phasors(row, point), multiply_row_by_phasors(row, &moved));
            let slack = one_minus_squared_magnitude(z);
            let change = -2.0 * (z.conj() * dz).re;
            let y = (z + dz - z * (change / slack)) * (2.0 / (weight * slack));
            of_travels += y.norm();
            for (w, entry) in w.iter_mut().zip(row) {
                *w -= entry.conj() * y;
            }
        }
        let of_phasors: f64 = self.phasors_from_eigenvector_coordinates(&w).iter().map(|w| w.norm()).sum();
        let bound = demanded - of_phasors - of_travels - energy_weight * program.energy_of_phasors(&after);
        let x =
            if self.weighted_objective_plus_barrier_or_infinity(weight, &after).is_finite() { after } else { *point };
        Solution { x, value: self.objective_without_barrier(&x), bound }
    }
}

/// 1 - |z|^2, which keeps its digits near 1.
fn one_minus_squared_magnitude(z: Complex64) -> f64 {
    let size = z.norm();
    (1.0 - size) * (1.0 + size)
}
