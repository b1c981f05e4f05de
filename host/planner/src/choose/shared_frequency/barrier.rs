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

use super::program::{Program, times};
use super::small::{MOST_UNKNOWNS, Matrix, Vector, add_outer, solve_positive};
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
/// `enough` says so of the two.
pub(super) fn solve(
    program: &Program,
    objective: Objective,
    start: &Phasors,
    tolerance: f64,
    enough: impl Fn(f64, f64) -> bool,
) -> Solution {
    let barrier = Barrier::new(program, objective);
    let mut point = barrier.to_eigenvectors(start);
    let first = barrier.limit_count() / barrier.span(&point).max(f64::MIN_POSITIVE);
    let mut weight = first;
    let mut best = barrier.certify(weight, &point, &[0.0; MOST_UNKNOWNS]);
    for _ in 0..CENTRINGS {
        let step = barrier.centre(weight, &mut point);
        let solution = barrier.certify(weight, &point, &step);
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
        if enough(best.value, best.bound) {
            break;
        }
        weight *= GROWTH;
    }
    best.x = barrier.to_phasors(&best.x);
    best
}

impl Barrier {
    fn new(program: &Program, objective: Objective) -> Self {
        let (mut place, mut unknowns) = ([0; MAX_ACTUATORS], 0);
        for i in program.actuators() {
            place[i] = unknowns;
            unknowns += 2;
        }
        // Before the turn: phasors are limited, their parts in eigenvectors are not.
        let binding = (0..MAX_ACTUATORS).filter(|row| program.may_travel_too_far(*row));
        let (turned, vectors) = program.in_eigenvectors();
        let travels = binding.map(|row| turned.travel[row]).collect();
        Self { program: turned, vectors, objective, travels, place, unknowns }
    }

    fn to_phasors(&self, v: &Phasors) -> Phasors {
        std::array::from_fn(|i| times(&self.vectors[i], v))
    }

    fn to_eigenvectors(&self, x: &Phasors) -> Phasors {
        std::array::from_fn(|n| (0..MAX_ACTUATORS).map(|i| self.vectors[i][n].conj() * x[i]).sum())
    }

    /// Rows r of the limits |r v| <= 1: phasors, then travels.
    fn limits(&self) -> impl Iterator<Item = &Phasors> {
        self.program.actuators().map(|i| &self.vectors[i]).chain(&self.travels)
    }

    /// nu.
    #[expect(clippy::cast_precision_loss, reason = "small counts")]
    fn limit_count(&self) -> f64 {
        (self.limits().count() + usize::from(self.objective == Objective::LeastEnergy)) as f64
    }

    /// How much the objective may change at all, roughly.
    fn span(&self, v: &Phasors) -> f64 {
        match self.objective {
            Objective::LeastEnergy => self.program.energy_of(v),
            Objective::MostPeak => self.program.most_peak(),
        }
    }

    fn value(&self, v: &Phasors) -> f64 {
        match self.objective {
            Objective::LeastEnergy => self.program.energy_of(v),
            Objective::MostPeak => -self.program.peak(v),
        }
    }

    /// Objective and barrier; infinite outside.
    fn merit(&self, weight: f64, v: &Phasors) -> f64 {
        let mut logs = 0.0;
        let mut inside = true;
        let mut add = |slack: f64| {
            inside &= slack > 0.0;
            logs += slack.ln();
        };
        for row in self.limits() {
            add(slack(times(row, v)));
        }
        if self.objective == Objective::LeastEnergy {
            add(self.program.peak(v) - 1.0);
        }
        if inside { weight * self.value(v) - logs } else { f64::INFINITY }
    }

    /// Newton's method on the barrier, up to the last step, which is returned.
    fn centre(&self, weight: f64, point: &mut Phasors) -> Vector {
        const NONE: Vector = [0.0; MOST_UNKNOWNS];
        let mut merit = self.merit(weight, point);
        for _ in 0..STEPS {
            let Some((step, decrement)) = self.newton(weight, point) else { return NONE };
            if decrement < CENTRED {
                return step;
            }
            let mut length = 1.0;
            loop {
                let trial = self.moved(point, &step, length);
                let there = self.merit(weight, &trial);
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

    fn moved(&self, point: &Phasors, step: &Vector, length: f64) -> Phasors {
        let mut moved = *point;
        for i in self.program.actuators() {
            moved[i] += Complex64::new(step[self.place[i]], step[self.place[i] + 1]) * length;
        }
        moved
    }

    /// The Newton step and the square of its decrement.
    fn newton(&self, weight: f64, point: &Phasors) -> Option<(Vector, f64)> {
        let program = &self.program;
        let (mut gradient, mut hessian) = ([0.0; MOST_UNKNOWNS], [[0.0; MOST_UNKNOWNS]; MOST_UNKNOWNS]);
        // Weight of the energy, pull towards the peak, and how the pull changes with it.
        let (energy_weight, pull, stiffness) = match self.objective {
            Objective::LeastEnergy => {
                let pull = (program.peak(point) - 1.0).recip();
                (weight, pull, pull * pull)
            }
            Objective::MostPeak => (0.0, weight, 0.0),
        };
        let mut towards_peak = [0.0; MOST_UNKNOWNS];
        for i in program.actuators() {
            let at = self.place[i];
            let energy = 2.0 * energy_weight * program.energy[i][i].re;
            let g = point[i] * energy - program.gain[i].conj() * pull;
            (gradient[at], gradient[at + 1]) = (g.re, g.im);
            (hessian[at][at], hessian[at + 1][at + 1]) = (energy, energy);
            (towards_peak[at], towards_peak[at + 1]) = (program.gain[i].re, -program.gain[i].im);
        }
        add_outer(&mut hessian, &towards_peak, stiffness, self.unknowns);
        for row in self.limits() {
            self.add_limit(row, times(row, point), &mut gradient, &mut hessian);
        }
        let mut step = gradient.map(|gradient| -gradient);
        solve_positive(self.unknowns, &mut hessian, &mut step)?;
        let decrement = -(0..self.unknowns).map(|i| step[i] * gradient[i]).sum::<f64>();
        Some((step, decrement))
    }

    /// Adds -log(1 - |z|^2) with z = row v.
    fn add_limit(&self, row: &Phasors, z: Complex64, gradient: &mut Vector, hessian: &mut Matrix) {
        let slack = slack(z);
        // Gradients of Re z, Im z and of the slack.
        let (mut re, mut im) = ([0.0; MOST_UNKNOWNS], [0.0; MOST_UNKNOWNS]);
        for j in self.program.actuators() {
            (re[self.place[j]], re[self.place[j] + 1]) = (row[j].re, -row[j].im);
            (im[self.place[j]], im[self.place[j] + 1]) = (row[j].im, row[j].re);
        }
        let mut normal = [0.0; MOST_UNKNOWNS];
        for i in 0..self.unknowns {
            normal[i] = -2.0 * (z.re * re[i] + z.im * im[i]);
            gradient[i] -= normal[i] / slack;
        }
        add_outer(hessian, &normal, 1.0 / (slack * slack), self.unknowns);
        add_outer(hessian, &re, 2.0 / slack, self.unknowns);
        add_outer(hessian, &im, 2.0 / slack, self.unknowns);
    }

    /// The certificate at a point, with the dual variables as they will be, to first order, after the Newton step: they solve
    /// the equations of the optimum in all phasors that no limit touches, where a slack's own rounding would not let them.
    /// The solution's point is the one after the step, if that is inside.
    fn certify(&self, weight: f64, point: &Phasors, step: &Vector) -> Solution {
        let program = &self.program;
        let after = self.moved(point, step, 1.0);
        // Changes come from the step itself: as differences they would be lost in rounding.
        let moved = self.moved(&[ZERO; MAX_ACTUATORS], step, 1.0);
        let (of_peak, demanded, energy_weight) = match self.objective {
            Objective::LeastEnergy => {
                let slack = program.peak(point) - 1.0;
                let of_peak = ((1.0 - program.peak(&moved) / slack) / (weight * slack)).max(0.0);
                (of_peak, of_peak, 1.0)
            }
            Objective::MostPeak => (1.0, 0.0, 0.0),
        };
        let energy = program.energy_times(&after);
        let mut w: Phasors =
            std::array::from_fn(|i| program.gain[i].conj() * of_peak - energy[i] * (2.0 * energy_weight));
        let mut of_travels = 0.0;
        for row in &self.travels {
            let (z, dz) = (times(row, point), times(row, &moved));
            let slack = slack(z);
            let change = -2.0 * (z.conj() * dz).re;
            let y = (z + dz - z * (change / slack)) * (2.0 / (weight * slack));
            of_travels += y.norm();
            for (w, entry) in w.iter_mut().zip(row) {
                *w -= entry.conj() * y;
            }
        }
        let of_phasors: f64 = self.to_phasors(&w).iter().map(|w| w.norm()).sum();
        let bound = demanded - of_phasors - of_travels - energy_weight * program.energy_of(&after);
        let x = if self.merit(weight, &after).is_finite() { after } else { *point };
        Solution { x, value: self.value(&x), bound }
    }
}

/// 1 - |z|^2, which keeps its digits near 1.
fn slack(z: Complex64) -> f64 {
    let size = z.norm();
    (1.0 - size) * (1.0 + size)
}
