//! The enumeration of all choices whose bounds are below the best cost.

use super::bounds::{Bounds, Prefix};
use super::leaf::quick_worth;
use super::program::Choice;
use super::search::{MOST_VIEWS, Search, State};
use std::ops::ControlFlow;

/// Tries to prove a choice useless at prices of its own.
const QUICK_TRIES: usize = 4;
/// Steps that judging a choice counts for.
const JUDGING: usize = 500;

/// Bounds at some prices.
pub(super) struct View {
    pub(super) bounds: Bounds,
    pub(super) prefix: Prefix,
}

/// A part of a choice: what it is worth at most in each view, and its peak.
#[derive(Clone, Copy, Default)]
pub(super) struct Partial {
    worth: [f64; MOST_VIEWS],
    peak: f64,
}

impl Search<'_> {
    /// Looks at every choice whose bound is below the best cost: adds groups for `mask` at the first `until` frequencies,
    /// the highest frequency first. Breaks off at the limit of work, or if a cost is good enough.
    pub(super) fn descend(
        &self,
        state: &mut State,
        views: &[View],
        until: usize,
        mask: usize,
        so_far: Partial,
        chosen: &mut Vec<Choice>,
    ) -> ControlFlow<()> {
        for k in (0..until).rev() {
            state.steps += 1;
            if self.no_better(state, views, &so_far, k + 1, mask) {
                break;
            }
            for (rest, group) in self.layout.groups(mask) {
                let lag = self.layout.lag[k];
                let mut with = so_far;
                for (sum, view) in with.worth.iter_mut().zip(views) {
                    *sum += view.bounds.worth[k][group];
                }
                with.peak += self.most_peaks[k][group];
                if self.no_better(state, views, &with, lag, rest) {
                    continue;
                }
                #[expect(clippy::cast_possible_truncation, reason = "at most 15")]
                chosen.push((group as u8, k));
                let flow = if rest == 0 {
                    self.judge(state, views, chosen)
                } else {
                    self.descend(state, views, lag, rest, with, chosen)
                };
                chosen.pop();
                flow?;
            }
        }
        ControlFlow::Continue(())
    }

    /// Whether nothing that continues a part of a choice at the first `until` frequencies is better than the best.
    fn no_better(&self, state: &State, views: &[View], so_far: &Partial, until: usize, mask: usize) -> bool {
        let too_weak = state.for_energy && so_far.peak + self.strongest[until][mask] < state.units.peak;
        let mut sums = so_far.worth.iter().zip(views);
        too_weak || sums.any(|(sum, view)| view.bounds.cost(sum + view.prefix[until][mask]) >= state.limit())
    }

    fn judge(&self, state: &mut State, views: &[View], chosen: &[Choice]) -> ControlFlow<()> {
        let own = |view: &View| view.bounds.prices.best_multiple(&view.bounds.parts_of(chosen));
        let best = views.iter().map(|view| (own(view), view)).max_by(|a, b| a.0.0.total_cmp(&b.0.0));
        if let Some(((cost, mut multiple), view)) = best
            && cost < state.limit()
        {
            // Once more, all groups together at the prices that suit them.
            let program = self.program(chosen, state.units);
            let mut prices = view.bounds.prices;
            let mut better = true;
            for _ in 0..QUICK_TRIES {
                prices = prices.times(multiple);
                let cost;
                (cost, multiple) = prices.best_multiple(&quick_worth(&program, &prices, f64::NEG_INFINITY));
                better = cost < state.limit();
                if !better || (multiple - 1.0).abs() < 1e-3 {
                    break;
                }
            }
            if better {
                let _ = self.visit(state, chosen, state.limit());
            }
            state.steps += JUDGING;
        }
        if state.spent() || state.leaf.cost <= state.enough {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }
}
