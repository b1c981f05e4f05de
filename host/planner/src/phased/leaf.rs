//! One choice of groups and frequencies, solved: least energy for a peak of 1, most peak, or the most that one group adds
//! at given prices.

use super::barrier::{Objective, solve};
use super::program::{Program, list};
use super::{PerActuator, ZERO};
use num_complex::Complex64;

/// Relative gap between value and bound at which a choice counts as solved.
const LEAF_TOLERANCE: f64 = 1e-11;
/// The same for the most peak, of which a part of 1e-9 is given up (`REACH_SLACK`).
const PEAK_TOLERANCE: f64 = 1e-13;
/// The same for a group at prices, which only has to tell choices apart.
const GROUP_TOLERANCE: f64 = 1e-8;
/// Part of the way from the demanded peak to the most peak that is far enough inside to start from.
const INSIDE: f64 = 0.2;

/// Rounds over the forces for a quick bound, and change of a force, in parts of its limit, at which there are enough.
const SWEEPS: usize = 16;
const SETTLED: f64 = 1e-10;

/// What peak, energy and travel are worth: multipliers of the convex problem, in its units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Prices {
    pub(super) peak: f64,
    pub(super) travel: [f64; 4],
    /// 1, or 0 where only the peak counts.
    pub(super) energy: f64,
}

impl Prices {
    pub(super) fn times(&self, factor: f64) -> Self {
        Self { peak: self.peak * factor, travel: self.travel.map(|price| price * factor), ..*self }
    }

    pub(super) fn mean(&self, other: &Self) -> Self {
        let mean = |row: usize| 0.5 * (self.travel[row] + other.travel[row]);
        Self { peak: 0.5 * (self.peak + other.peak), travel: std::array::from_fn(mean), ..*self }
    }

    /// The least that any choice costs that is worth so much.
    pub(super) fn cost(&self, worth: f64) -> f64 {
        let demanded = if self.energy > 0.0 { self.peak } else { 0.0 };
        demanded - self.travel.iter().sum::<f64>() - worth
    }

    /// The same for the best multiple r of the prices, and r.
    pub(super) fn best_multiple(&self, worth: &Worth) -> (f64, f64) {
        let rest = self.cost(worth.limits);
        // The maximum over r of r rest - r^2 energy.
        if self.energy > 0.0 && rest > 0.0 && worth.energy > 0.0 {
            (rest * rest / (4.0 * worth.energy), rest / (2.0 * worth.energy))
        } else {
            (rest - worth.energy, 1.0)
        }
    }
}

/// A solved choice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leaf {
    pub(super) x: PerActuator,
    /// What is minimised: the energy, or minus the peak.
    pub(super) cost: f64,
    /// No forces cost less.
    pub(super) bound: f64,
    pub(super) prices: Prices,
}

/// Least energy for a peak of 1; `None` if there is no such peak, or proof that it takes `limit` or more.
pub(super) fn least_energy(program: &Program, limit: f64) -> Option<Leaf> {
    if let Some(leaf) = within_limits(program) {
        return Some(leaf);
    }
    if program.most_peak() <= 1.0 {
        return None;
    }
    // Inside, or a proof that there is no inside.
    let inside = solve(program, peak_only(), None, PEAK_TOLERANCE, |peak, _, bound| {
        -bound <= 1.0 || peak - 1.0 > INSIDE * (-bound - 1.0)
    });
    if program.peak(&inside.point.x) <= 1.0 {
        return None;
    }
    let objective = Objective { energy_weight: 1.0, peak_price: 0.0, travel_price: [0.0; 4], demanded: true };
    let solution = solve(program, objective, Some(&inside.point), LEAF_TOLERANCE, |_, _, bound| bound >= limit);
    if solution.bound >= limit {
        return None;
    }
    // The point is inside: a peak above 1 is brought back to it.
    let scale = program.peak(&solution.point.x).recip();
    let x = solution.point.x.map(|x| x * scale);
    let prices = Prices { peak: solution.peak_price, travel: solution.travel_price, energy: 1.0 };
    Some(Leaf { x, cost: program.energy_of(&x), bound: solution.bound, prices })
}

/// Least energy for a peak of 1 if no limit binds.
pub(super) fn within_limits(program: &Program) -> Option<Leaf> {
    let direction = program.unlimited();
    let scale = program.peak(&direction).recip();
    let x = direction.map(|x| x * scale);
    let prices = Prices { peak: 2.0 * scale, travel: [0.0; 4], energy: 1.0 };
    (scale.is_finite() && program.allows(&x)).then_some(Leaf { x, cost: scale, bound: scale, prices })
}

/// Most peak within the limits.
pub(super) fn most_peak(program: &Program) -> Leaf {
    let prices = |travel| Prices { peak: 1.0, travel, energy: 0.0 };
    // Every actuator at its limit, all in phase at the target.
    let x: PerActuator = std::array::from_fn(|i| {
        let norm = program.gain[i].norm();
        if norm > 0.0 { program.gain[i].conj() / norm } else { ZERO }
    });
    let most = program.most_peak();
    if (0..4).all(|row| !program.may_travel_too_far(row)) {
        return Leaf { x, cost: -most, bound: -most, prices: prices([0.0; 4]) };
    }
    let solution = solve(program, peak_only(), None, PEAK_TOLERANCE, |_, _, _| false);
    Leaf {
        x: solution.point.x,
        cost: -program.peak(&solution.point.x),
        bound: solution.bound,
        prices: prices(solution.travel_price),
    }
}

/// Upper bound on what forces are worth at given prices: the peak's price times their peak, less their energy and the price
/// of their travel. At r times the prices it is r `limits` + r^2 `energy`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Worth {
    pub(super) limits: f64,
    pub(super) energy: f64,
    /// Whether it is as good as it gets, to [`GROUP_TOLERANCE`].
    pub(super) tight: bool,
}

impl Worth {
    pub(super) fn sum(&self) -> f64 {
        self.limits + self.energy
    }
}

/// The bound by the interior-point method, as good as it gets unless it is `hopeless` or less before.
pub(super) fn worth(program: &Program, prices: &Prices, hopeless: f64) -> Worth {
    let objective = Objective {
        energy_weight: prices.energy,
        peak_price: prices.peak,
        travel_price: prices.travel,
        demanded: false,
    };
    let solution = solve(program, objective, None, GROUP_TOLERANCE, |_, _, bound| -bound <= hopeless);
    Worth { limits: solution.limits_part, energy: -solution.bound - solution.limits_part, tight: true }
}

/// The bound in a tenth of the time: forces at their best given the others, one after the other and then those within
/// their limits together; comes near where little travel is priced. The certificate is that of [`super::barrier`], with multipliers of
/// travel that have the phase of the travel and its price. Ends early at `hopeless` or less.
pub(super) fn quick_worth(program: &Program, prices: &Prices, hopeless: f64) -> Worth {
    let mut x = [ZERO; 4];
    let mut pull = program.gain.map(|gain| gain.conj() * prices.peak);
    let mut look_at = 1;
    for sweep in 1..=SWEEPS {
        let before = x;
        for i in program.actuators() {
            let others: Complex64 = program.actuators().filter(|j| *j != i).map(|j| program.energy[i][j] * x[j]).sum();
            let wish = pull[i] * 0.5 - others * prices.energy;
            let own = program.energy[i][i].re * prices.energy;
            // At most 1, in the direction of the wish.
            let size = wish.norm();
            x[i] = if size > own { wish / size } else { wish / own.max(f64::MIN_POSITIVE) };
        }
        if prices.energy > 0.0 {
            free_together(program, &pull, &mut x);
        }
        let changed = x.iter().zip(&before).map(|(x, before)| (x - before).norm()).fold(0.0, f64::max);
        let settled = changed < SETTLED;
        if !settled {
            pull = pull_after_travel(program, prices, &x);
        }
        if sweep == look_at || sweep == SWEEPS || settled {
            let worth = certified(program, prices, &x, &pull);
            if worth.tight || worth.sum() <= hopeless || sweep == SWEEPS || settled {
                return worth;
            }
            look_at *= 2;
        }
    }
    certified(program, prices, &x, &pull)
}

/// Moves the forces that are within their limits to their best given the others, all at once: one by one they would creep
/// where actuators act alike. As far as the limits go.
fn free_together(program: &Program, pull: &PerActuator, x: &mut PerActuator) {
    let free = program.actuators().filter(|i| x[*i].norm() < 1.0 - SETTLED).fold(0_u8, |mask, i| mask | 1 << i);
    if free.count_ones() < 2 {
        return;
    }
    let mut right = *pull;
    for i in list(free) {
        right[i] = pull[i] * 0.5;
        for j in list(program.used & !free) {
            right[i] -= program.energy[i][j] * x[j];
        }
    }
    let best = program.solve(free, right);
    // |x + part d| = 1 has one positive solution, as |x| < 1.
    let part = list(free).fold(1.0_f64, |part, i| {
        let d = best[i] - x[i];
        let (square, cross, room) = (d.norm_sqr(), (x[i].conj() * d).re, 1.0 - x[i].norm_sqr());
        if best[i].norm() <= 1.0 { part } else { part.min(room / (cross + (cross * cross + square * room).sqrt())) }
    });
    for i in list(free) {
        x[i] += (best[i] - x[i]) * part;
    }
}

/// What pulls at each force: the peak's price less that of the travel it makes.
fn pull_after_travel(program: &Program, prices: &Prices, x: &PerActuator) -> PerActuator {
    let mut pull = program.gain.map(|gain| gain.conj() * prices.peak);
    for row in (0..4).filter(|row| prices.travel[*row] > 0.0) {
        for group in 0..program.groups {
            let z = program.travel_of(row, group, x);
            if z == ZERO {
                continue;
            }
            let y = z * (prices.travel[row] / z.norm());
            for j in program.actuators().filter(|j| program.group[*j] == group) {
                pull[j] -= program.travel[row][j].conj() * y;
            }
        }
    }
    pull
}

/// The bound that forces and a pull prove.
fn certified(program: &Program, prices: &Prices, x: &PerActuator, pull: &PerActuator) -> Worth {
    let marginal = program.energy_times(x);
    let limits = program.actuators().map(|i| (pull[i] - marginal[i] * (2.0 * prices.energy)).norm()).sum();
    let energy = prices.energy * program.energy_of(x);
    let travel = |row: usize| (0..program.groups).map(|group| program.travel_of(row, group, x).norm()).sum::<f64>();
    let priced: f64 = (0..4).filter(|row| prices.travel[*row] > 0.0).map(|row| prices.travel[row] * travel(row)).sum();
    let had = prices.peak * program.peak(x) - energy - priced;
    let bound: f64 = limits + energy;
    Worth { limits, energy, tight: bound - had <= GROUP_TOLERANCE * bound && program.allows(x) }
}

const fn peak_only() -> Objective {
    Objective { energy_weight: 0.0, peak_price: 1.0, travel_price: [0.0; 4], demanded: false }
}
