//! The best choice of groups and frequencies, proven.

use super::bounds::{Bounds, Layout, Prefix, most_peaks};
use super::enumerate::{Partial, View};
use super::leaf::{Leaf, Prices, least_energy, most_peak, within_limits};
use super::program::{Choice, Program, Units, list};
use super::scores::Scores;
use super::{Field, Found, Group, Grouping, REACH_SLACK, SUBSETS, ZERO};
use std::collections::HashMap;

/// Relative improvement below which a choice counts as no better.
const SAME: f64 = 1e-10;
/// Most convex problems solved per search; each takes up to 0.2 ms.
const MOST_SOLVED: usize = 10_000;
/// Most steps of an enumeration; each takes some nanoseconds.
const MOST_STEPS: usize = 20_000_000;
/// Most prices at which bounds are looked at, how many in a row may bring the bound nearer to the best by less than a part
/// of the gap, and that part.
pub(super) const MOST_VIEWS: usize = 8;
const VIEWS_IN_VAIN: usize = 2;
const WORTH_ANOTHER: f64 = 0.1;
/// Relative gap that the enumeration settles sooner than further prices.
const CLOSE: f64 = 1e-5;
/// Factor on the prices if what looks best at them is too weak.
const DEARER: f64 = 1.5;
/// Guesses at a better choice, and relative difference of bounds and of prices that is good enough for that.
const GUESSES: usize = 6;
const GUESSED: f64 = 0.02;
/// Bounds tightened before the dynamic programming is done again with them; it takes about as long as ten of them.
const BATCH: usize = 32;
/// The same for quick bounds.
const QUICK_BATCH: usize = 256;

pub(super) fn best(field: &Field<'_>, grouping: Grouping, wanted: f64, spacing_hz: f64) -> Option<Found> {
    let scores = Scores::new(field, grouping == Grouping::Mixed);
    if scores.usable.iter().all(|usable| *usable == 0) {
        return None;
    }
    let layout = Layout::new(field, grouping, spacing_hz);
    let prefix = layout.prefix(&scores.of);
    let (choices, score) = (layout.choice(&prefix, &scores.of), layout.most(&prefix));
    if wanted.is_nan() || wanted <= 0.0 || score <= 0.0 {
        let groups = choices.iter().map(|(members, k)| Group { members: *members, frequency: *k, forces_n: [ZERO; 4] });
        return Some(Found { groups: groups.collect(), energy: 0.0, reached: 0.0, proven_gap: 0.0, solved: 0 });
    }
    let units = |peak: f64| Units { peak, energy: peak * peak / score };
    if wanted.is_finite() {
        let units = units(wanted);
        if let Some(leaf) = within_limits(&Program::new(field, &scores, &choices, units)) {
            return Some(found(field, &scores, units, &choices, &leaf, 0.0, 0));
        }
    }
    let most_peaks = most_peaks(field, &scores);
    let strongest = layout.prefix(&most_peaks);
    let search = Search { field, scores: &scores, layout: &layout, most_peaks: &most_peaks, strongest: &strongest };
    Some(search.within_limits(wanted, units, choices))
}

pub(super) struct Search<'a> {
    field: &'a Field<'a>,
    scores: &'a Scores,
    pub(super) layout: &'a Layout,
    pub(super) most_peaks: &'a [[f64; SUBSETS]],
    /// Most peak at the first frequencies, by mask.
    pub(super) strongest: &'a Prefix,
}

/// The best so far, and what is being looked for.
pub(super) struct State {
    pub(super) units: Units,
    /// What is minimised: energy, or minus the peak.
    pub(super) for_energy: bool,
    /// A cost that is good enough.
    pub(super) enough: f64,
    choices: Vec<Choice>,
    pub(super) leaf: Leaf,
    /// Choices that were solved, and their prices.
    visited: HashMap<[Choice; 4], Option<Prices>>,
    solved: usize,
    /// Steps of the enumeration.
    pub(super) steps: usize,
}

impl Search<'_> {
    fn within_limits(&self, wanted: f64, units: impl Fn(f64) -> Units, unlimited: Vec<Choice>) -> Found {
        let most = self.layout.most(self.strongest);
        let strongest = self.layout.choice(self.strongest, self.most_peaks);
        // More than there is, whatever the wish: keeps it a number.
        let wanted = wanted.min(2.0 * most);
        let at = units(wanted);
        let energy_of = |choices: Vec<Choice>, units: Units| {
            least_energy(&self.program(&choices, units), f64::INFINITY)
                .map(|leaf| State::new(units, true, choices, leaf))
        };
        let start = if wanted < most {
            [unlimited, strongest.clone()]
                .into_iter()
                .filter_map(|choices| energy_of(choices, at))
                .min_by(|a, b| a.leaf.cost.total_cmp(&b.leaf.cost))
        } else {
            None
        };
        let (mut state, peak_gap, before) = if let Some(start) = start {
            (start, 0.0, 0)
        } else {
            let leaf = most_peak(&self.program(&strongest, at));
            let mut state = State::new(at, false, strongest, leaf);
            state.enough = -1.0 - SAME;
            let gap = self.improve(&mut state);
            let reached = -state.leaf.cost;
            let met = reached >= 1.0 + SAME;
            let goal = if met { at } else { units(wanted * reached * (1.0 - REACH_SLACK)) };
            let gap = if met { 0.0 } else { gap };
            match energy_of(state.choices.clone(), goal) {
                Some(start) => (start, gap, state.solved),
                // Only if rounding hides the slack: the strongest itself.
                None => return found(self.field, self.scores, at, &state.choices, &state.leaf, gap, state.solved),
            }
        };
        let gap = self.improve(&mut state).max(peak_gap);
        found(self.field, self.scores, state.units, &state.choices, &state.leaf, gap, before + state.solved)
    }

    pub(super) fn program(&self, choices: &[Choice], units: Units) -> Program {
        Program::new(self.field, self.scores, choices, units)
    }

    /// Lowers the cost to the least there is, and returns the gap that is left.
    fn improve(&self, state: &mut State) -> f64 {
        loop {
            let mut views = Vec::with_capacity(MOST_VIEWS);
            match self.look(state, &mut views) {
                Look::Improved => {}
                Look::Done(bound) => return state.gap(bound),
                Look::Open(bound) => {
                    let (all, until) = (usize::from(self.layout.all), self.most_peaks.len());
                    let flow = self.descend(state, &views, until, all, Partial::default(), &mut Vec::new());
                    return state.gap(if flow.is_continue() { state.limit() } else { bound });
                }
            }
        }
    }

    /// Bounds the cost of all choices by the dynamic programming at several prices, and solves the choices that look best
    /// at them.
    fn look(&self, state: &mut State, views: &mut Vec<View>) -> Look {
        // At the prices of the best so far its own bound is its cost: what is worth more there may cost less.
        let mut prices = state.leaf.prices;
        let mut first = self.bounds(state, prices);
        if self.guess(state, &mut first) {
            return if state.leaf.cost <= state.enough { Look::Done(f64::NEG_INFINITY) } else { Look::Improved };
        }
        let (mut first, mut bound, mut in_vain) = (Some(first), f64::NEG_INFINITY, 0);
        while views.len() < MOST_VIEWS && in_vain < VIEWS_IN_VAIN {
            let mut bounds = first.take().unwrap_or_else(|| self.bounds(state, prices));
            let prefix = self.sharpen(state, &mut bounds);
            let here = bounds.cost(self.layout.most(&prefix));
            let helps = here - bound > WORTH_ANOTHER * (state.limit() - bound);
            in_vain = if helps || views.is_empty() { 0 } else { in_vain + 1 };
            bound = bound.max(here);
            if bound >= state.limit() || state.spent() {
                return Look::Done(bound);
            }
            let choices = self.layout.choice(&prefix, &bounds.worth);
            views.push(View { bounds, prefix });
            if state.limit() - bound < CLOSE * state.limit().abs() {
                break;
            }
            let rival = match self.visit(state, &choices, f64::INFINITY) {
                Visit::Better if state.leaf.cost <= state.enough => return Look::Done(bound),
                Visit::Better => return Look::Improved,
                Visit::NoBetter(rival) => rival,
            };
            // At its own prices the bound of what looks best here is its cost; between the two the least bound is highest.
            prices = rival.map_or_else(|| prices.times(DEARER), |rival| prices.mean(&rival));
        }
        Look::Open(bound)
    }

    /// Tries the choices that look best by quick bounds; `true` if one is better than the best so far. Each is followed to
    /// the multiple of the prices at which it has the peak that is wanted.
    fn guess(&self, state: &mut State, first: &mut Bounds) -> bool {
        let mut prices = first.prices;
        let mut later;
        let mut bounds = first;
        for _ in 0..GUESSES {
            let choices = self.best_by_quick_bounds(state, bounds);
            if matches!(self.visit(state, &choices, state.limit()), Visit::Better) {
                return true;
            }
            let multiple = prices.best_multiple(&bounds.parts_of(&choices)).1.clamp(0.25, 4.0);
            if !state.for_energy || (multiple - 1.0).abs() < GUESSED {
                return false;
            }
            prices = prices.times(multiple);
            later = self.bounds(state, prices);
            bounds = &mut later;
        }
        false
    }

    fn bounds(&self, state: &State, prices: Prices) -> Bounds {
        Bounds::new(prices, state.units, self.scores, self.most_peaks)
    }

    /// What a group may be worth, at most, that is in no choice better than the best so far, whatever the distances between
    /// frequencies, if `rest` is what it leaves of the actuators.
    fn hopeless(state: &State, bounds: &Bounds, prefix: &Prefix, rest: usize) -> f64 {
        bounds.cost(0.0) - state.limit() - prefix[prefix.len() - 1][rest]
    }

    fn best_by_quick_bounds(&self, state: &State, bounds: &mut Bounds) -> Vec<Choice> {
        let all = usize::from(self.layout.all);
        loop {
            let prefix = self.layout.prefix(&bounds.worth);
            let choices = self.layout.choice(&prefix, &bounds.worth);
            for (group, k) in &choices {
                bounds.quicken(self.field, self.scores, usize::from(*group), *k, f64::NEG_INFINITY);
            }
            let now: f64 = choices.iter().map(|(group, k)| bounds.worth[*k][usize::from(*group)]).sum();
            // Bounds only fall, and each group's only once: it ends.
            if now >= (1.0 - GUESSED) * self.layout.most(&prefix) {
                return choices;
            }
            // With them the others that look good, as the next choice is one of those.
            let mut next: Vec<(f64, usize, usize, f64)> = Vec::new();
            for (rest, group) in self.layout.groups(all) {
                let hopeless = Self::hopeless(state, bounds, &prefix, rest);
                let with = prefix[prefix.len() - 1][rest];
                let loose = (0..bounds.worth.len()).filter(|k| !bounds.is_quick(group, *k));
                next.extend(
                    loose.map(|k| (bounds.worth[k][group] + with, group, k, hopeless)).filter(|next| next.0 > now),
                );
            }
            if next.len() > QUICK_BATCH {
                next.select_nth_unstable_by(QUICK_BATCH, |a, b| b.0.total_cmp(&a.0));
            }
            for (_, group, k, hopeless) in next.into_iter().take(QUICK_BATCH) {
                bounds.quicken(self.field, self.scores, group, k, hopeless);
            }
        }
    }

    /// Makes bounds as good as they get wherever they could be part of a choice that is better than the best so far.
    fn sharpen(&self, state: &mut State, bounds: &mut Bounds) -> Prefix {
        let all = usize::from(self.layout.all);
        let mut prefix = self.layout.prefix(&bounds.worth);
        for (rest, group) in self.layout.groups(all) {
            let hopeless = Self::hopeless(state, bounds, &prefix, rest);
            for k in 0..bounds.worth.len() {
                if bounds.worth[k][group] > hopeless {
                    bounds.quicken(self.field, self.scores, group, k, hopeless);
                }
            }
        }
        loop {
            prefix = self.layout.prefix(&bounds.worth);
            let mut loose: Vec<(f64, usize, usize, f64)> = Vec::new();
            for (rest, group) in self.layout.groups(all) {
                let hopeless = Self::hopeless(state, bounds, &prefix, rest);
                for k in 0..bounds.worth.len() {
                    let over = bounds.worth[k][group] - hopeless;
                    if over > 0.0 && !bounds.is_tight(group, k) {
                        loose.push((over, group, k, hopeless));
                    }
                }
            }
            if loose.is_empty() || state.spent() {
                return prefix;
            }
            loose.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
            for (_, group, k, hopeless) in loose.into_iter().take(BATCH) {
                bounds.tighten(self.field, self.scores, group, k, hopeless);
                state.solved += 1;
            }
        }
    }

    /// Solves a choice unless that was done before, as far as it may cost less than `limit`.
    pub(super) fn visit(&self, state: &mut State, choices: &[Choice], limit: f64) -> Visit {
        let key = key(choices);
        if let Some(prices) = state.visited.get(&key) {
            return Visit::NoBetter(*prices);
        }
        let program = self.program(choices, state.units);
        let leaf = if state.for_energy && program.most_peak() < 1.0 {
            None
        } else {
            state.solved += 1;
            if state.for_energy { least_energy(&program, limit) } else { Some(most_peak(&program)) }
        };
        state.visited.insert(key, leaf.map(|leaf| leaf.prices));
        match leaf {
            Some(leaf) if leaf.cost < state.limit() => {
                (state.leaf, state.choices) = (leaf, choices.to_vec());
                Visit::Better
            }
            _ => Visit::NoBetter(leaf.map(|leaf| leaf.prices)),
        }
    }
}

/// What looking at bounds brought.
enum Look {
    /// A better choice.
    Improved,
    /// Nothing costs less than the bound, and that settles it; or the limit of work.
    Done(f64),
    /// Nothing costs less than the bound, but that is below the best.
    Open(f64),
}

/// What solving a choice brought.
pub(super) enum Visit {
    /// It is the best so far.
    Better,
    /// It is not; its prices, if it was solved.
    NoBetter(Option<Prices>),
}

impl State {
    fn new(units: Units, for_energy: bool, choices: Vec<Choice>, leaf: Leaf) -> Self {
        let visited = HashMap::from([(key(&choices), Some(leaf.prices))]);
        Self { units, for_energy, enough: f64::NEG_INFINITY, choices, leaf, visited, solved: 1, steps: 0 }
    }

    /// A cost from which on a choice is no better.
    pub(super) fn limit(&self) -> f64 {
        self.leaf.cost - SAME * self.leaf.cost.abs()
    }

    pub(super) fn spent(&self) -> bool {
        self.solved >= MOST_SOLVED || self.steps >= MOST_STEPS
    }

    /// Relative difference to a bound on all others, and the best's own.
    fn gap(&self, others: f64) -> f64 {
        let (cost, bound) = (self.leaf.cost, self.leaf.bound.min(others));
        // Of minus a peak: the most peak there may be counts as the whole.
        ((cost - bound) / cost.abs().max(bound.abs())).max(0.0)
    }
}

/// Names a choice.
fn key(choices: &[Choice]) -> [Choice; 4] {
    let mut key = [(0, 0); 4];
    key[..choices.len()].copy_from_slice(choices);
    key.sort_unstable();
    key
}

fn found(
    field: &Field<'_>,
    scores: &Scores,
    units: Units,
    choices: &[Choice],
    leaf: &Leaf,
    proven_gap: f64,
    solved: usize,
) -> Found {
    let groups = choices.iter().map(|(members, k)| {
        let mut forces_n = [ZERO; 4];
        for i in list(members & scores.usable[*k]) {
            forces_n[i] = leaf.x[i] * field.max_force_n[*k][i];
        }
        Group { members: *members, frequency: *k, forces_n }
    });
    let groups: Vec<Group> = groups.collect();
    let program = Program::new(field, scores, choices, units);
    let ridge = |group: &Group| {
        let (u, k) = (&group.forces_n, group.frequency);
        scores.ridge[k] * list(group.members).map(|i| field.energy[k][i][i].re * u[i].norm_sqr()).sum::<f64>()
    };
    let ridge: f64 = groups.iter().map(ridge).sum();
    Found {
        groups,
        energy: (program.energy_of(&leaf.x) * units.energy - ridge).max(0.0),
        reached: program.peak(&leaf.x) * units.peak,
        proven_gap,
        solved,
    }
}
