//! The choice of frequencies and forces with the largest minimum over points, proven: branch and cut.
//!
//! Chosen are a frequency f_i for every actuator (at least a spacing apart) and parts v_i of its full force, 0 to 1, for the
//! largest min over x of sum_i g_i(x, f_i) v_i, subject to sum_i c_i(f_i) v_i <= 1 for every shared limit.
//!
//! Bound: for weights lambda of points (adding up to 1) and prices mu of limits, no choice is better than
//! sum(mu) + sum_i max_f max(0, lambda . g_i(f) - mu . c_i(f)), which separates by actuator. The best weights and prices are
//! the multipliers of the linear program in which an actuator may divide itself between frequencies. A node of the search
//! is a list of frequencies for every actuator: it is dropped if its bound does not beat the best choice known, its
//! frequencies whose loss against the best one of the list is more than what the bound is ahead are dropped, and what is left is
//! split, or, if short, enumerated with the same bound. Points are few at first; where a choice looks better than the best
//! known, its worst point joins them (a cutting plane).

use super::space::Space;
use crate::choose::linear::Programme;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Relative difference of objective values that counts as none.
const EQUAL_VALUES: f64 = 1e-10;
/// Combinations that are looked at one by one.
const FEW: usize = 20_000;
/// Points to begin with.
const FIRST_POINTS: usize = 6;

/// How to search.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Least distance between frequencies of different actuators in Hz.
    pub spacing_hz: f64,
    /// Most nodes; where it ends the search, the result says what may be missing.
    pub nodes: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { spacing_hz: crate::MIN_SPACING_HZ, nodes: 200_000 }
    }
}

/// The best choice.
#[derive(Clone, Debug, PartialEq)]
pub struct Best {
    /// Frequency of each actuator, as an index.
    pub choice: Vec<usize>,
    /// Part of full force of each.
    pub parts: Vec<f64>,
    /// Least gain over the points.
    pub least: f64,
    /// No choice has more than this; `least` unless the node limit ended the search.
    pub upper: f64,
    /// Nodes it took.
    pub nodes: usize,
}

/// The choice with the largest least gain over `points`. `hint` is a good one, if known. `None` if no frequencies keep
/// their distance, or without points.
#[must_use]
pub fn best(space: &Space, points: &[usize], options: Options, hint: Option<&[usize]>) -> Option<Best> {
    if points.is_empty() || space.actuators() == 0 {
        return None;
    }
    let step = points.len().div_ceil(FIRST_POINTS);
    let mut search = ReachSearch {
        space,
        points,
        options,
        active: points.iter().copied().step_by(step).collect(),
        least: -1.0,
        found: None,
        unresolved: -1.0,
    };
    if let Some(hint) = hint.filter(|hint| search.is_spaced(hint)) {
        search.judge(hint);
    }
    let lists = (0..space.actuators()).map(|actuator| space.usable(actuator)).collect();
    let mut open = BinaryHeap::from([Node { bound: f64::INFINITY, lists }]);
    let mut nodes = 0;
    let mut upper = -1.0_f64;
    while let Some(node) = open.pop() {
        if !search.beats(node.bound) {
            break;
        }
        if nodes >= options.nodes {
            upper = node.bound;
            break;
        }
        nodes += 1;
        open.extend(search.visit(node.lists));
    }
    let (choice, parts) = search.found?;
    Some(Best { choice, parts, least: search.least, upper: search.least.max(upper).max(search.unresolved), nodes })
}

struct Node {
    bound: f64,
    lists: Vec<Vec<usize>>,
}

impl PartialEq for Node {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Node {}
impl PartialOrd for Node {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Node {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound.total_cmp(&other.bound)
    }
}

struct ReachSearch<'a> {
    space: &'a Space,
    points: &'a [usize],
    options: Options,
    active: Vec<usize>,
    least: f64,
    found: Option<(Vec<usize>, Vec<f64>)>,
    /// Largest value of a choice that rounding keeps from being settled.
    unresolved: f64,
}

/// Weights of the active points and prices of the limits.
struct Multipliers {
    weights: Vec<f64>,
    prices: Vec<f64>,
}

impl Multipliers {
    /// Any such make a bound; the duals of a program, in which gains are in units of `scale`, are cleaned of rounding.
    fn clean(dual: &[f64], points: usize, limits: usize, scale: f64) -> Self {
        let sum: f64 = dual.iter().take(points).sum();
        if sum > 0.0 {
            return Self {
                weights: dual.iter().take(points).map(|dual| dual / sum).collect(),
                prices: dual.iter().skip(points).take(limits).map(|dual| scale * dual / sum).collect(),
            };
        }
        #[expect(clippy::cast_precision_loss, reason = "a small count")]
        let even = 1.0 / points as f64;
        Self { weights: vec![even; points], prices: vec![0.0; limits] }
    }

    fn total(&self) -> f64 {
        self.prices.iter().sum()
    }
}

impl ReachSearch<'_> {
    /// Whether a value is more than the best known.
    fn beats(&self, value: f64) -> bool {
        value > self.least + EQUAL_VALUES * self.least.abs()
    }

    fn is_spaced(&self, choice: &[usize]) -> bool {
        choice.iter().enumerate().all(|(i, frequency)| self.fits(&choice[..i], *frequency))
    }

    fn fits(&self, chosen: &[usize], frequency: usize) -> bool {
        let hz = self.space.frequencies_hz[frequency];
        chosen.iter().all(|other| (self.space.frequencies_hz[*other] - hz).abs() >= self.options.spacing_hz - 1e-9)
    }

    fn worth(&self, multipliers: &Multipliers, actuator: usize, frequency: usize) -> f64 {
        let gains = self.space.gains(actuator, frequency);
        let gain: f64 = self.active.iter().zip(&multipliers.weights).map(|(x, w)| f64::from(gains[*x]) * w).sum();
        let usages = self.space.usages(actuator, frequency);
        let cost: f64 = usages.iter().zip(&multipliers.prices).map(|(usage, price)| usage * price).sum();
        (gain - cost).max(0.0)
    }

    /// Takes away frequencies that leave another actuator none; `false` if one is left without.
    fn propagate(&self, lists: &mut [Vec<usize>]) -> bool {
        loop {
            if lists.iter().any(Vec::is_empty) {
                return false;
            }
            let before: usize = lists.iter().map(Vec::len).sum();
            for other in 0..lists.len() {
                // All frequencies that are too near to both ends of a list are too near to all of it.
                let (Some(first), Some(last)) = (lists[other].first().copied(), lists[other].last().copied()) else {
                    return false;
                };
                for (actuator, list) in lists.iter_mut().enumerate() {
                    if actuator != other {
                        list.retain(|f| self.fits(&[first], *f) || self.fits(&[last], *f));
                    }
                }
            }
            if lists.iter().map(Vec::len).sum::<usize>() == before {
                return true;
            }
        }
    }

    /// What is left to be looked at of a node.
    fn visit(&mut self, mut lists: Vec<Vec<usize>>) -> Vec<Node> {
        if !self.propagate(&mut lists) {
            return Vec::new();
        }
        let (multipliers, shares) = self.relax(&lists);
        let worth: Vec<Vec<f64>> = lists
            .iter()
            .enumerate()
            .map(|(i, list)| list.iter().map(|f| self.worth(&multipliers, i, *f)).collect())
            .collect();
        let most: Vec<f64> = worth.iter().map(|list| list.iter().copied().fold(0.0, f64::max)).collect();
        let bound = multipliers.total() + most.iter().sum::<f64>();
        let mut kept: Vec<Vec<(f64, usize)>> = Vec::new();
        for ((list, worth), most) in lists.iter().zip(&worth).zip(&most) {
            let pairs = worth.iter().copied().zip(list.iter().copied());
            kept.push(pairs.filter(|(worth, _)| self.beats(bound - most + worth)).collect());
        }
        let combinations = kept.iter().fold(1_usize, |product, list| product.saturating_mul(list.len()));
        if combinations == 0 {
            return Vec::new();
        }
        if combinations <= FEW {
            self.enumerate(kept, multipliers.total());
            return Vec::new();
        }
        // Split the longest list where the relaxed actuator has half of its frequency on either side.
        let Some((longest, _)) = kept.iter().enumerate().max_by_key(|(_, list)| list.len()) else { return Vec::new() };
        let whole: Vec<Vec<usize>> = kept.into_iter().map(|list| list.into_iter().map(|(_, f)| f).collect()).collect();
        let list = &whole[longest];
        let at = split(list, &shares[longest]);
        let side = |part: &[usize]| {
            let mut lists = whole.clone();
            lists[longest] = part.to_vec();
            Node { bound, lists }
        };
        vec![side(&list[..at]), side(&list[at..])]
    }

    /// The relaxed program over the active points: its multipliers, and how each actuator divides itself.
    fn relax(&self, lists: &[Vec<usize>]) -> (Multipliers, Vec<Vec<(usize, f64)>>) {
        let columns: Vec<(usize, usize)> =
            lists.iter().enumerate().flat_map(|(i, list)| list.iter().map(move |f| (i, *f))).collect();
        let (points, limits) = (self.active.len(), self.space.limits);
        let gain = |(i, f): (usize, usize), x: usize| f64::from(self.space.gains(i, f)[x]);
        // Gains of the size of one, as usages are.
        let all = columns.iter().flat_map(|column| self.active.iter().map(move |x| gain(*column, *x)));
        let scale = Some(all.fold(0.0, f64::max)).filter(|most| *most > 0.0).unwrap_or(1.0);
        let mut programme = Programme::new(columns.len() + 1);
        for x in &self.active {
            programme.row(std::iter::once(1.0).chain(columns.iter().map(|column| -gain(*column, *x) / scale)), 0.0);
        }
        for limit in 0..limits {
            let usages = columns.iter().map(|(i, f)| self.space.usages(*i, *f)[limit]);
            programme.row(std::iter::once(0.0).chain(usages), 1.0);
        }
        for actuator in 0..lists.len() {
            let own = columns.iter().map(|(i, _)| f64::from(u8::from(*i == actuator)));
            programme.row(std::iter::once(0.0).chain(own), 1.0);
        }
        let optimum = programme.maximise(&[1.0], &[]);
        let dual = optimum.as_ref().map(|optimum| optimum.first.as_slice()).unwrap_or_default();
        let mut shares = vec![Vec::new(); lists.len()];
        if let Some(optimum) = &optimum {
            for ((i, f), share) in columns.iter().zip(optimum.x.iter().skip(1)).filter(|(_, share)| **share > 0.0) {
                shares[*i].push((*f, *share));
            }
        }
        (Multipliers::clean(dual, points, limits, scale), shares)
    }

    fn enumerate(&mut self, mut lists: Vec<Vec<(f64, usize)>>, priced: f64) {
        for list in &mut lists {
            list.sort_by(|a, b| b.0.total_cmp(&a.0));
        }
        // What the actuators from each on may add.
        let mut rest = vec![0.0; lists.len() + 1];
        for (i, list) in lists.iter().enumerate().rev() {
            rest[i] = rest[i + 1] + list.first().map_or(0.0, |best| best.0);
        }
        self.descend(&lists, &rest, priced, &mut Vec::with_capacity(lists.len()));
    }

    fn descend(&mut self, lists: &[Vec<(f64, usize)>], rest: &[f64], sum: f64, chosen: &mut Vec<usize>) {
        let depth = chosen.len();
        let Some(list) = lists.get(depth) else {
            let choice = chosen.clone();
            self.judge(&choice);
            return;
        };
        for (worth, frequency) in list {
            if !self.beats(sum + worth + rest[depth + 1]) {
                return;
            }
            if self.fits(chosen, *frequency) {
                chosen.push(*frequency);
                self.descend(lists, rest, sum + worth, chosen);
                chosen.pop();
            }
        }
    }

    /// Finds out whether frequencies are better than the best known.
    fn judge(&mut self, choice: &[usize]) {
        let full = vec![1.0; choice.len()];
        let fits = self.used(choice, &full) <= 1.0;
        loop {
            let at_full = self.active.iter().map(|x| self.space.peak(*x, choice, &full)).fold(f64::INFINITY, f64::min);
            if !self.beats(at_full) {
                return;
            }
            let (parts, upper) = if fits { (full.clone(), at_full) } else { self.strongest(choice) };
            if !self.beats(upper) {
                return;
            }
            let worst = self
                .points
                .iter()
                .map(|x| (self.space.peak(*x, choice, &parts), *x))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((least, at)) = worst else { return };
            if least > self.least || self.found.is_none() {
                self.least = least;
                self.found = Some((choice.to_vec(), parts));
            }
            if !self.beats(upper) {
                return;
            }
            if self.active.contains(&at) {
                self.unresolved = self.unresolved.max(upper);
                return;
            }
            self.active.push(at);
        }
    }

    /// Largest part of a shared limit that is used.
    fn used(&self, choice: &[usize], parts: &[f64]) -> f64 {
        (0..self.space.limits)
            .map(|limit| {
                let each = choice.iter().zip(parts).enumerate();
                each.map(|(i, (f, part))| self.space.usages(i, *f)[limit] * part).sum::<f64>()
            })
            .fold(0.0, f64::max)
    }

    /// The parts of full force with the largest least gain over the active points, and a bound on it.
    fn strongest(&self, choice: &[usize]) -> (Vec<f64>, f64) {
        let lists: Vec<Vec<usize>> = choice.iter().map(|f| vec![*f]).collect();
        let (multipliers, shares) = self.relax(&lists);
        let mut parts: Vec<f64> = shares.iter().map(|share| share.iter().map(|(_, part)| part).sum()).collect();
        parts.iter_mut().for_each(|part| *part = part.clamp(0.0, 1.0));
        let over = self.used(choice, &parts).max(1.0);
        parts.iter_mut().for_each(|part| *part /= over);
        let worth = choice.iter().enumerate().map(|(i, f)| self.worth(&multipliers, i, *f));
        (parts, multipliers.total() + worth.sum::<f64>())
    }
}

/// Where a list of at least two is divided: at the mean of `shares`, with something on both sides.
fn split(list: &[usize], shares: &[(usize, f64)]) -> usize {
    let weight: f64 = shares.iter().map(|(_, share)| share).sum();
    if weight <= 0.0 {
        return list.len() / 2;
    }
    #[expect(clippy::cast_precision_loss, reason = "a small index")]
    let mean = shares.iter().map(|(f, share)| *f as f64 * share).sum::<f64>() / weight;
    #[expect(clippy::cast_precision_loss, reason = "a small index")]
    let at = list.partition_point(|f| *f as f64 <= mean);
    at.clamp(1, list.len() - 1)
}
