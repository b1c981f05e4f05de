//! The best frequency, proven.

use super::optimum::{Optimum, least_energy, most_peak, within_limits};
use super::program::{Program, ROUNDING, Units};
use super::unlimited::Unlimited;
use super::{BestPhasors, Field, REACH_SLACK, ZERO, list};
use crate::scene::MAX_ACTUATORS;

/// Relative improvement below which a frequency counts as no better.
const NO_BETTER: f64 = 1e-10;

pub(super) fn best(field: &Field<'_>, wanted: f64) -> Option<BestPhasors> {
    let unlimited: Vec<Unlimited> = (0..field.frequencies_hz.len()).map(|k| Unlimited::at(field, k)).collect();
    let most_peaks = (0..unlimited.len()).map(|k| most_peak_at(field, &unlimited[k], k)).collect();
    let search = PhasorSearch { field, unlimited, most_peaks };
    // The first of equals.
    let usable = (0..search.unlimited.len()).filter(|k| search.unlimited[*k].usable != 0).rev();
    let frequency =
        usable.max_by(|a, b| search.unlimited[*a].efficiency.total_cmp(&search.unlimited[*b].efficiency))?;
    let efficiency = search.unlimited[frequency].efficiency;
    if wanted.is_nan() || wanted <= 0.0 || efficiency <= 0.0 {
        return Some(BestPhasors {
            frequency,
            forces_n: [ZERO; MAX_ACTUATORS],
            energy: 0.0,
            reached: 0.0,
            proven_gap: 0.0,
            solved: 0,
        });
    }
    // More than there is, whatever the wish: keeps it a number.
    let wanted = wanted.min(2.0 * search.most_peaks.iter().fold(0.0, |a, b| b.max(a)));
    let units = |peak: f64| Units { peak, energy: peak * peak / efficiency };
    search.least_energy(units(wanted)).or_else(|| search.most_peak(wanted, units))
}

/// Most peak of a frequency in m/s^2 if only forces are limited.
fn most_peak_at(field: &Field<'_>, unlimited: &Unlimited, k: usize) -> f64 {
    list(unlimited.usable).map(|i| field.gain[k][i].norm() * field.max_force_n[k][i]).sum()
}

struct PhasorSearch<'a> {
    field: &'a Field<'a>,
    unlimited: Vec<Unlimited>,
    /// [`most_peak_at`] every frequency.
    most_peaks: Vec<f64>,
}

impl PhasorSearch<'_> {
    /// Least energy for the peak that is the unit; `None` if no frequency has it.
    fn least_energy(&self, units: Units) -> Option<BestPhasors> {
        let reaches = |k: &usize| self.most_peaks[*k] >= units.peak * (1.0 - ROUNDING);
        // Without limits a peak a costs a^2 / s.
        let bound = |k: usize| units.peak * units.peak / (self.unlimited[k].efficiency * units.energy);
        let bounds = (0..self.unlimited.len()).filter(reaches).map(|k| (bound(k), k)).collect();
        let best = in_order_of_bounds(bounds, |k, limit, solved| {
            let program = self.program(k, units);
            within_limits(&program).or_else(|| {
                *solved += 1;
                least_energy(&program, limit)
            })
        })?;
        Some(self.found(units, &best))
    }

    /// Where `wanted` is beyond reach: the most peak, with the least energy that its frequency has for it.
    fn most_peak(&self, wanted: f64, units: impl Fn(f64) -> Units) -> Option<BestPhasors> {
        let at = units(wanted);
        let usable = (0..self.unlimited.len()).filter(|k| self.unlimited[*k].usable != 0);
        let bounds = usable.map(|k| (-self.most_peaks[k] / at.peak, k)).collect();
        let strongest = in_order_of_bounds(bounds, |k, limit, solved| {
            *solved += 1;
            Some(most_peak(&self.program(k, at), limit))
        })?;
        let reached = -wanted * strongest.optimum.cost * (1.0 - REACH_SLACK);
        let goal = units(reached.min(wanted));
        let optimum = least_energy(&self.program(strongest.frequency, goal), f64::INFINITY);
        // Rounding may hide the slack: then the strongest itself.
        let (units, optimum) = optimum.map_or((at, strongest.optimum), |optimum| (goal, optimum));
        Some(self.found(units, &Best { optimum, solved: strongest.solved + 1, ..strongest }))
    }

    fn program(&self, k: usize, units: Units) -> Program {
        Program::new(self.field, &self.unlimited[k], k, units)
    }

    fn found(&self, units: Units, best: &Best) -> BestPhasors {
        let (k, x) = (best.frequency, &best.optimum.x);
        let (program, unlimited) = (self.program(k, units), &self.unlimited[k]);
        let mut forces_n = [ZERO; MAX_ACTUATORS];
        for i in program.actuators() {
            forces_n[i] = x[i] * self.field.max_force_n[k][i];
        }
        let diagonal = program.actuators().map(|i| self.field.energy[k][i][i].re * forces_n[i].norm_sqr());
        let ridge = unlimited.ridge * diagonal.sum::<f64>();
        BestPhasors {
            frequency: k,
            forces_n,
            energy: (program.energy_of(x) * units.energy - ridge).max(0.0),
            reached: program.peak(x) * units.peak,
            proven_gap: best.gap,
            solved: best.solved,
        }
    }
}

/// The best of all frequencies.
struct Best {
    frequency: usize,
    optimum: Optimum,
    /// By which part another might be better.
    gap: f64,
    /// Convex problems solved.
    solved: usize,
}

/// Solves frequencies in the order of what they cost at least (`(bound, frequency)`), until the next bound is no better than
/// the best cost. `solve` is told a cost from which on a frequency is no better, and counts the convex problems.
fn in_order_of_bounds(
    mut bounds: Vec<(f64, usize)>,
    mut solve: impl FnMut(usize, f64, &mut usize) -> Option<Optimum>,
) -> Option<Best> {
    bounds.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut best, mut limit, mut proven, mut solved) = (None, f64::INFINITY, f64::INFINITY, 0);
    for (bound, k) in bounds {
        if bound >= limit {
            break;
        }
        // What has no optimum cannot have the peak, or is proven to cost the limit or more.
        let Some(optimum) = solve(k, limit, &mut solved) else { continue };
        proven = proven.min(optimum.bound);
        if optimum.cost < limit {
            limit = optimum.cost - NO_BETTER * optimum.cost.abs();
            best = Some((k, optimum));
        }
    }
    let (frequency, optimum) = best?;
    let (cost, bound) = (optimum.cost, proven.min(limit));
    // Of minus a peak: the most peak there may be counts as the whole.
    let gap = ((cost - bound) / cost.abs().max(bound.abs())).max(0.0);
    Some(Best { frequency, optimum, gap, solved })
}
