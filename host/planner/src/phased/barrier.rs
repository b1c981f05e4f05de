//! An interior-point method for [`Program`]: logarithmic barrier, Newton steps, and a dual value as certificate.
//!
//! Minimises energy_weight x^H E x - peak_price Re(h x) + sum_i travel_price_i sum_g tau_ig subject to |x_i| <= 1,
//! |z_ig| <= tau_ig with z_ig the travel of i at the frequency of group g, sum_g tau_ig <= 1, and, if asked for,
//! Re(h x) >= 1. The barrier is -log of 1 - |x_i|^2, tau^2 - |z|^2, 1 - sum tau, Re(h x) - 1 (Boyd and Vandenberghe,
//! Convex Optimization, section 11.6); its minimum at weight t is within nu / t of the optimum.
//!
//! The certificate does not rely on that: for any multipliers l of the peak, y_ig of the travel and
//! w = l conj(h) - 2 energy_weight E x - sum conj(G) y, the Lagrangian's minimum over all forces is
//! D = l - sum |w_i| - sum_i max_g(|y_ig| - travel_price_i)+ - energy_weight x^H E x (the first l only with the constraint
//! on the peak, where l is its multiplier and not the price), which no feasible point undercuts.
//!
//! Unknowns are y with x = Q y and E = Q diag Q^H: where actuators act alike, E is nearly singular, and what the barrier
//! says about the directions without energy would be lost beside the others if they were not apart.

use super::program::{MOST_GROUPED, Program};
use super::small::{MOST_UNKNOWNS, Matrix, Vector, add_outer, solve_positive};
use super::{PerActuator, PerPair, ZERO};
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
const NEAR: f64 = 0.06;

/// What is minimised.
#[derive(Clone, Copy, Debug)]
pub(super) struct Objective {
    pub(super) energy_weight: f64,
    pub(super) peak_price: f64,
    pub(super) travel_price: [f64; 4],
    /// Whether the peak has to be at least 1.
    pub(super) demanded: bool,
}

/// Where to start: strictly feasible.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    /// Forces; within this module in eigenvectors of the energy.
    pub(super) x: PerActuator,
    tau: [f64; MOST_GROUPED],
}

/// What came out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solution {
    pub(super) point: Point,
    /// The objective there.
    pub(super) value: f64,
    /// No feasible point has less.
    pub(super) bound: f64,
    /// Multiplier of the demanded peak.
    pub(super) peak_price: f64,
    /// Multipliers of the travel limits.
    pub(super) travel_price: [f64; 4],
    /// The part of `-bound` that comes from limits; the rest is the energy.
    pub(super) limits_part: f64,
}

struct Barrier {
    /// In eigenvectors of the energy.
    program: Program,
    /// The eigenvectors, as columns.
    turn: PerPair,
    objective: Objective,
    /// (row, group) of each cone.
    cones: [(usize, usize); MOST_GROUPED],
    cone_count: usize,
    /// Where each force's two unknowns are.
    place: [usize; 4],
    force_unknowns: usize,
}

/// Solves from `start`, or from rest (no force, feasible if no peak is demanded), until value and bound differ by at most
/// `tolerance` times the larger, or `enough` says so of the point's peak, the value and the bound.
pub(super) fn solve(
    program: &Program,
    objective: Objective,
    start: Option<&Point>,
    tolerance: f64,
    enough: impl Fn(f64, f64, f64) -> bool,
) -> Solution {
    let barrier = Barrier::new(program, objective);
    let mut point = match start {
        Some(start) => Point { x: barrier.to_eigenvectors(&start.x), ..*start },
        None => Point { x: [ZERO; 4], tau: barrier.tau_at_rest() },
    };
    let first = barrier.parameter() / barrier.span(&point).max(f64::MIN_POSITIVE);
    let mut weight = first;
    let mut best = barrier.certify(weight, &point, &[0.0; MOST_UNKNOWNS]);
    for _ in 0..CENTRINGS {
        let step = barrier.centre(weight, &mut point);
        let solution = barrier.certify(weight, &point, &step);
        point = solution.point;
        // Values fall and bounds rise, until rounding ends it.
        let bound = best.bound.max(solution.bound);
        let stuck = solution.value - bound >= STUCK * (best.value - best.bound);
        if solution.bound >= best.bound {
            best = Solution { value: best.value, point: best.point, ..solution };
        }
        if solution.value <= best.value {
            (best.value, best.point) = (solution.value, solution.point);
        }
        let gap = best.value - best.bound;
        if gap <= tolerance * best.value.abs().max(best.bound.abs()) || stuck && weight > WELL_UNDER_WAY * first {
            break;
        }
        if enough(barrier.program.peak(&point.x), best.value, best.bound) {
            break;
        }
        weight *= GROWTH;
    }
    best.point.x = barrier.to_forces(&best.point.x);
    best
}

impl Barrier {
    fn new(program: &Program, objective: Objective) -> Self {
        let mut cones = [(0, 0); MOST_GROUPED];
        let mut cone_count = 0;
        for row in (0..4).filter(|row| objective.travel_price[*row] > 0.0 || program.may_travel_too_far(*row)) {
            for group in 0..program.groups {
                let moves = |j: usize| program.group[j] == group && program.travel[row][j] != ZERO;
                if program.actuators().any(moves) {
                    cones[cone_count] = (row, group);
                    cone_count += 1;
                }
            }
        }
        let (mut place, mut force_unknowns) = ([0; 4], 0);
        for i in program.actuators() {
            place[i] = force_unknowns;
            force_unknowns += 2;
        }
        let (program, turn) = program.in_eigenvectors();
        Self { program, turn, objective, cones, cone_count, place, force_unknowns }
    }

    fn to_forces(&self, y: &PerActuator) -> PerActuator {
        std::array::from_fn(|i| self.force(i, y))
    }

    fn to_eigenvectors(&self, x: &PerActuator) -> PerActuator {
        std::array::from_fn(|n| (0..4).map(|i| self.turn[i][n].conj() * x[i]).sum())
    }

    /// Force of actuator `i` in parts of its limit.
    fn force(&self, i: usize, y: &PerActuator) -> Complex64 {
        (0..4).map(|n| self.turn[i][n] * y[n]).sum()
    }

    fn cones(&self) -> impl Iterator<Item = (usize, (usize, usize))> + '_ {
        self.cones[..self.cone_count].iter().copied().enumerate()
    }

    fn rows(&self) -> impl Iterator<Item = usize> + '_ {
        (0..4).filter(|row| self.cones().any(|(_, cone)| cone.0 == *row))
    }

    fn unknowns(&self) -> usize {
        self.force_unknowns + self.cone_count
    }

    /// The travel limits' parts that no force uses: equal parts, and one left over.
    fn tau_at_rest(&self) -> [f64; MOST_GROUPED] {
        let mut tau = [0.0; MOST_GROUPED];
        for (c, (row, _)) in self.cones() {
            let parts = 1 + self.cones().filter(|(_, other)| other.0 == row).count();
            tau[c] = 1.0 / f64::from(u32::try_from(parts).unwrap_or(u32::MAX));
        }
        tau
    }

    /// nu, the barrier's parameter: 1 for each scalar limit, 2 for each cone.
    #[expect(clippy::cast_precision_loss, reason = "small counts")]
    fn parameter(&self) -> f64 {
        let scalars = self.force_unknowns / 2 + self.rows().count() + usize::from(self.objective.demanded);
        (scalars + 2 * self.cone_count) as f64
    }

    /// How much the objective may change at all, roughly.
    fn span(&self, point: &Point) -> f64 {
        let prices: f64 = self.rows().map(|row| self.objective.travel_price[row]).sum();
        self.objective.peak_price * self.program.most_peak()
            + self.objective.energy_weight * self.program.energy_of(&point.x)
            + prices
    }

    fn value(&self, point: &Point) -> f64 {
        let objective = &self.objective;
        objective.energy_weight * self.program.energy_of(&point.x) - objective.peak_price * self.program.peak(&point.x)
            + self.cones().map(|(c, (row, _))| objective.travel_price[row] * point.tau[c]).sum::<f64>()
    }

    fn travel(&self, point: &Point, (row, group): (usize, usize)) -> Complex64 {
        self.program.travel_of(row, group, &point.x)
    }

    fn row_left(&self, point: &Point, row: usize) -> f64 {
        1.0 - self.cones().filter(|(_, cone)| cone.0 == row).map(|(c, _)| point.tau[c]).sum::<f64>()
    }

    /// Objective and barrier; infinite outside.
    fn merit(&self, weight: f64, point: &Point) -> f64 {
        let mut logs = 0.0;
        let mut inside = true;
        let mut add = |slack: f64| {
            inside &= slack > 0.0;
            logs += slack.ln();
        };
        for i in self.program.actuators() {
            let force = self.force(i, &point.x).norm();
            add((1.0 - force) * (1.0 + force));
        }
        for (c, cone) in self.cones() {
            add(point.tau[c]);
            let z = self.travel(point, cone).norm();
            add((point.tau[c] - z) * (point.tau[c] + z) / point.tau[c]);
        }
        for row in self.rows() {
            add(self.row_left(point, row));
        }
        if self.objective.demanded {
            add(self.program.peak(&point.x) - 1.0);
        }
        if inside { weight * self.value(point) - logs } else { f64::INFINITY }
    }

    /// Newton's method on the barrier, up to the last step, which is returned.
    fn centre(&self, weight: f64, point: &mut Point) -> Vector {
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
                if there < merit - 1e-4 * length * decrement || decrement < NEAR && there.is_finite() {
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

    fn moved(&self, point: &Point, step: &Vector, length: f64) -> Point {
        let mut moved = *point;
        for i in self.program.actuators() {
            moved.x[i] += Complex64::new(step[self.place[i]], step[self.place[i] + 1]) * length;
        }
        for c in 0..self.cone_count {
            moved.tau[c] += step[self.force_unknowns + c] * length;
        }
        moved
    }

    /// The Newton step and the square of its decrement.
    fn newton(&self, weight: f64, point: &Point) -> Option<(Vector, f64)> {
        let (program, objective) = (&self.program, &self.objective);
        let n = self.unknowns();
        let (mut slope, mut bend) = ([0.0; MOST_UNKNOWNS], [[0.0; MOST_UNKNOWNS]; MOST_UNKNOWNS]);
        let demand = objective.demanded.then(|| program.peak(&point.x) - 1.0);
        let peak_pull = weight * objective.peak_price + demand.map_or(0.0, f64::recip);
        let mut towards_peak = [0.0; MOST_UNKNOWNS];
        for i in program.actuators() {
            let at = self.place[i];
            let energy = 2.0 * weight * objective.energy_weight * program.energy[i][i].re;
            let g = point.x[i] * energy - program.gain[i].conj() * peak_pull;
            (slope[at], slope[at + 1]) = (g.re, g.im);
            (bend[at][at], bend[at + 1][at + 1]) = (energy, energy);
            (towards_peak[at], towards_peak[at + 1]) = (program.gain[i].re, -program.gain[i].im);
        }
        if let Some(slack) = demand {
            add_outer(&mut bend, &towards_peak, 1.0 / (slack * slack), self.force_unknowns);
        }
        for i in program.actuators() {
            self.add_modulus(&self.turn[i], self.force(i, &point.x), 1.0, None, &mut slope, &mut bend);
        }
        for (c, (row, group)) in self.cones() {
            let at = self.force_unknowns + c;
            let of_group = |j: usize| program.group[j] == group;
            let travel = std::array::from_fn(|j| if of_group(j) { program.travel[row][j] } else { ZERO });
            let z = self.travel(point, (row, group));
            self.add_modulus(&travel, z, point.tau[c], Some(at), &mut slope, &mut bend);
            slope[at] += weight * objective.travel_price[row];
        }
        for row in self.rows() {
            let left = self.row_left(point, row);
            for (c, _) in self.cones().filter(|(_, cone)| cone.0 == row) {
                slope[self.force_unknowns + c] += 1.0 / left;
                for (d, _) in self.cones().filter(|(_, cone)| cone.0 == row) {
                    bend[self.force_unknowns + c][self.force_unknowns + d] += 1.0 / (left * left);
                }
            }
        }
        let mut step = slope.map(|slope| -slope);
        solve_positive(n, &mut bend, &mut step)?;
        let decrement = -(0..n).map(|i| step[i] * slope[i]).sum::<f64>();
        Some((step, decrement))
    }

    /// Adds -log(radius^2 - |z|^2) with z = row y; the radius may be the unknown at `radius_at`.
    fn add_modulus(
        &self,
        row: &PerActuator,
        z: Complex64,
        radius: f64,
        radius_at: Option<usize>,
        slope: &mut Vector,
        bend: &mut Matrix,
    ) {
        let slack = (radius - z.norm()) * (radius + z.norm());
        // Gradients of Re z, Im z and of the slack.
        let (mut re, mut im) = ([0.0; MOST_UNKNOWNS], [0.0; MOST_UNKNOWNS]);
        for j in self.program.actuators() {
            (re[self.place[j]], re[self.place[j] + 1]) = (row[j].re, -row[j].im);
            (im[self.place[j]], im[self.place[j] + 1]) = (row[j].im, row[j].re);
        }
        let mut normal = [0.0; MOST_UNKNOWNS];
        for i in 0..self.force_unknowns {
            normal[i] = -2.0 * (z.re * re[i] + z.im * im[i]);
        }
        let mut until = self.force_unknowns;
        if let Some(at) = radius_at {
            normal[at] = 2.0 * radius;
            bend[at][at] -= 2.0 / slack;
            until = at + 1;
        }
        for (slope, normal) in slope.iter_mut().zip(&normal) {
            *slope -= normal / slack;
        }
        add_outer(bend, &normal, 1.0 / (slack * slack), until);
        add_outer(bend, &re, 2.0 / slack, self.force_unknowns);
        add_outer(bend, &im, 2.0 / slack, self.force_unknowns);
    }

    /// The certificate at a point, with the multipliers as they will be, to first order, after the Newton step: they solve
    /// the equations of the optimum in all forces that no limit touches, where a slack's own rounding would not let them.
    /// The solution's point is the one after the step, if that is inside.
    fn certify(&self, weight: f64, point: &Point, step: &Vector) -> Solution {
        let (program, objective) = (&self.program, &self.objective);
        let after = self.moved(point, step, 1.0);
        // Changes come from the step itself: as differences they would be lost in rounding.
        let still = Point { x: [ZERO; 4], tau: [0.0; MOST_GROUPED] };
        let moved = self.moved(&still, step, 1.0);
        let demanded = if objective.demanded {
            let slack = program.peak(&point.x) - 1.0;
            ((1.0 - program.peak(&moved.x) / slack) / (weight * slack)).max(0.0)
        } else {
            0.0
        };
        let peak_price = objective.peak_price + demanded;
        let energy = program.energy_times(&after.x);
        let mut w: PerActuator =
            std::array::from_fn(|i| program.gain[i].conj() * peak_price - energy[i] * (2.0 * objective.energy_weight));
        let mut excess = [0.0_f64; 4];
        for (c, (row, group)) in self.cones() {
            let (z, tau) = (self.travel(point, (row, group)), point.tau[c]);
            let (dz, dtau) = (self.travel(&moved, (row, group)), moved.tau[c]);
            let slack = (tau - z.norm()) * (tau + z.norm());
            let change = 2.0 * (tau * dtau - (z.conj() * dz).re);
            let y = (z + dz - z * (change / slack)) * (2.0 / (weight * slack));
            excess[row] = excess[row].max(y.norm() - objective.travel_price[row]);
            for j in program.actuators().filter(|j| program.group[*j] == group) {
                w[j] -= program.travel[row][j].conj() * y;
            }
        }
        let limits_part =
            program.actuators().map(|i| self.force(i, &w).norm()).sum::<f64>() + excess.iter().sum::<f64>();
        let energy = objective.energy_weight * program.energy_of(&after.x);
        let point = if self.merit(weight, &after).is_finite() { after } else { *point };
        Solution {
            point,
            value: self.value(&point),
            bound: demanded - limits_part - energy,
            peak_price,
            travel_price: std::array::from_fn(|row| objective.travel_price[row] + excess[row]),
            limits_part,
        }
    }
}
