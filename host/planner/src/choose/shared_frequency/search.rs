//! The best frequency, proven.

use super::optimum::{
    Optimum, find_least_energy_for_unit_peak_if_no_limit_binds, maximise_peak_until_proven_no_better_than_known,
    minimise_energy_for_unit_peak_if_reachable_below_cost_limit,
};
use super::program::{Program, ROUNDING, Units};
use super::unlimited::UnlimitedEfficiency;
use super::{BestPhasors, REACH_SLACK, TargetField, ZERO, actuator_indices_in_mask};
use crate::scene::MAX_ACTUATORS;

/// Relative improvement below which a frequency counts as no better.
const NO_BETTER: f64 = 1e-10;

pub(super) fn find_least_energy_else_largest_peak(
    field: &TargetField<'_>,
    wanted_m_per_s2: f64,
) -> Option<BestPhasors> {
    let unlimited: Vec<UnlimitedEfficiency> = (0..field.frequencies_hz.len())
        .map(|k| UnlimitedEfficiency::compute_efficiency_of_all_drivable_actuators(field, k))
        .collect();
    let most_peaks =
        (0..unlimited.len()).map(|k| max_peak_without_travel_limits_m_per_s2(field, &unlimited[k], k)).collect();
    let search = PhasorSearch { field, unlimited, most_peaks };
    // The first of equals.
    let usable = (0..search.unlimited.len()).filter(|k| search.unlimited[*k].usable != 0).rev();
    let frequency =
        usable.max_by(|a, b| search.unlimited[*a].efficiency.total_cmp(&search.unlimited[*b].efficiency))?;
    let efficiency = search.unlimited[frequency].efficiency;
    if wanted_m_per_s2.is_nan() || wanted_m_per_s2 <= 0.0 || efficiency <= 0.0 {
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
    let wanted_m_per_s2 = wanted_m_per_s2.min(2.0 * search.most_peaks.iter().fold(0.0, |a, b| b.max(a)));
    let units = |peak: f64| Units { peak, energy: peak * peak / efficiency };
    search
        .find_least_energy_over_frequencies_if_peak_reachable(units(wanted_m_per_s2))
        .or_else(|| search.find_frequency_of_largest_peak_then_least_energy_there(wanted_m_per_s2, units))
}

/// Most peak of a frequency in m/s^2 if only forces are limited.
fn max_peak_without_travel_limits_m_per_s2(
    field: &TargetField<'_>,
    unlimited: &UnlimitedEfficiency,
    frequency: usize,
) -> f64 {
    actuator_indices_in_mask(unlimited.usable)
        .map(|i| field.gain[frequency][i].norm() * field.max_force_n[frequency][i])
        .sum()
}

struct PhasorSearch<'a> {
    field: &'a TargetField<'a>,
    unlimited: Vec<UnlimitedEfficiency>,
    /// [`max_peak_without_travel_limits_m_per_s2`] every frequency.
    most_peaks: Vec<f64>,
}

impl PhasorSearch<'_> {
    /// Least energy for the peak that is the unit; `None` if no frequency has it.
    fn find_least_energy_over_frequencies_if_peak_reachable(&self, units: Units) -> Option<BestPhasors> {
        let reaches = |k: &usize| self.most_peaks[*k] >= units.peak * (1.0 - ROUNDING);
        // Without limits a peak a costs a^2 / s.
        let bound = |k: usize| units.peak * units.peak / (self.unlimited[k].efficiency * units.energy);
        let bounds = (0..self.unlimited.len()).filter(reaches).map(|k| (bound(k), k)).collect();
        let best = find_cheapest_frequency_in_order_of_bounds(bounds, |k, limit, solved| {
            let program = self.build_program_at_frequency(k, units);
            find_least_energy_for_unit_peak_if_no_limit_binds(&program).or_else(|| {
                *solved += 1;
                minimise_energy_for_unit_peak_if_reachable_below_cost_limit(&program, limit)
            })
        })?;
        Some(self.to_best_phasors(units, &best))
    }

    /// Where `wanted_m_per_s2` is beyond reach: the most peak, with the least energy that its frequency has for it.
    fn find_frequency_of_largest_peak_then_least_energy_there(
        &self,
        wanted_m_per_s2: f64,
        units: impl Fn(f64) -> Units,
    ) -> Option<BestPhasors> {
        let at = units(wanted_m_per_s2);
        let usable = (0..self.unlimited.len()).filter(|k| self.unlimited[*k].usable != 0);
        let bounds = usable.map(|k| (-self.most_peaks[k] / at.peak, k)).collect();
        let strongest = find_cheapest_frequency_in_order_of_bounds(bounds, |k, limit, solved| {
            *solved += 1;
            Some(maximise_peak_until_proven_no_better_than_known(&self.build_program_at_frequency(k, at), limit))
        })?;
        let reached = -wanted_m_per_s2 * strongest.optimum.cost * (1.0 - REACH_SLACK);
        let goal = units(reached.min(wanted_m_per_s2));
        let optimum = minimise_energy_for_unit_peak_if_reachable_below_cost_limit(
            &self.build_program_at_frequency(strongest.frequency, goal),
            f64::INFINITY,
        );
        // Rounding may hide the slack: then the strongest itself.
        let (units, optimum) = optimum.map_or((at, strongest.optimum), |optimum| (goal, optimum));
        Some(self.to_best_phasors(units, &BestFrequency { optimum, solved: strongest.solved + 1, ..strongest }))
    }

    fn build_program_at_frequency(&self, frequency: usize, units: Units) -> Program {
        Program::new(self.field, &self.unlimited[frequency], frequency, units)
    }

    fn to_best_phasors(&self, units: Units, best: &BestFrequency) -> BestPhasors {
        let (k, x) = (best.frequency, &best.optimum.x);
        let (program, unlimited) = (self.build_program_at_frequency(k, units), &self.unlimited[k]);
        let mut forces_n = [ZERO; MAX_ACTUATORS];
        for i in program.drivable_actuators() {
            forces_n[i] = x[i] * self.field.max_force_n[k][i];
        }
        let diagonal = program.drivable_actuators().map(|i| self.field.energy[k][i][i].re * forces_n[i].norm_sqr());
        let ridge = unlimited.ridge * diagonal.sum::<f64>();
        BestPhasors {
            frequency: k,
            forces_n,
            energy: (program.energy_of_phasors(x) * units.energy - ridge).max(0.0),
            reached: program.real_part_of_peak_at_target(x) * units.peak,
            proven_gap: best.gap,
            solved: best.solved,
        }
    }
}

/// The best of all frequencies.
struct BestFrequency {
    frequency: usize,
    optimum: Optimum,
    /// By which part another might be better.
    gap: f64,
    /// Convex problems solved.
    solved: usize,
}

/// Solves frequencies in the order of what they cost at least (`(bound, frequency)`), until the next bound is no better than
/// the best cost. `solve` is told a cost from which on a frequency is no better, and counts the convex problems.
fn find_cheapest_frequency_in_order_of_bounds(
    mut bounds: Vec<(f64, usize)>,
    mut solve: impl FnMut(usize, f64, &mut usize) -> Option<Optimum>,
) -> Option<BestFrequency> {
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
    Some(BestFrequency { frequency, optimum, gap, solved })
}
