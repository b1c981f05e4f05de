//! The candidates of a touch: every actuator at every frequency that can be part of the best combination.

use crate::MIN_SPACING_HZ;
use crate::choose::allocate::Allocation;
use crate::choose::assignment::{Assignment, count_frequencies_below_each_with_spacing};
use crate::choose::search::{BestCombination, Candidate, CandidateSet, PairFilter, meets_more_or_as_much_at_less_cost};
use crate::perception;
use crate::request::quiet_zones::QuietZones;
use crate::request::target_zone::TargetZone;
use crate::request::{Objective, Request, SearchEffort, Weigh};
use crate::scene::MAX_ACTUATORS;
use crate::table::{Entry, PlanTable, PulseOption, SINGLE_PRECISION_ERROR, acceleration_at_point_from_coordinates};
use nalgebra::DVector;

/// Rounds in which a first combination is improved.
const FIRST_ROUNDS: usize = 4;
/// Frequencies that are taken together where bounds are first looked at.
const BAND_HZ: f64 = 5.0;
/// Such bands may hold two frequencies that keep their distance if they are that many apart: from the lower end of one to the
/// upper of the other are (3 + 1) 5 Hz, [`MIN_SPACING_HZ`].
const BANDS_APART: usize = 3;
/// Times what all actuators together can reach, at which a wish counts: what is beyond is as far beyond reach, and its
/// shares would be lost in rounding.
const BEYOND_REACH: f64 = 1e6;

/// A request as gains at its targets, loads on its limits and costs, for every candidate.
#[derive(Clone, Debug)]
pub struct Formulation<'a> {
    table: &'a PlanTable,
    /// The targets and what is around them.
    pub zone: TargetZone,
    /// The quiet zones.
    pub quiet: QuietZones,
    objective: Objective,
    weigh: Weigh,
    work: SearchEffort,
}

impl<'a> Formulation<'a> {
    /// For a request that has been checked.
    #[must_use]
    pub fn new(table: &'a PlanTable, request: &Request) -> Self {
        Self {
            table,
            zone: TargetZone::new(table, &request.targets),
            quiet: QuietZones::new(table, &request.quiet),
            objective: request.objective,
            weigh: request.weigh,
            work: request.work,
        }
    }

    /// Mean square elsewhere per N^2, harmonics included.
    #[must_use]
    pub fn mean_square_elsewhere_with_harmonics_per_n2(&self, entry: &Entry, pulse: &PulseOption) -> f64 {
        self.zone.mean_square_elsewhere(entry.mean_square, self.zone.mean_square_over_zone(&entry.acceleration))
            + pulse.harmonics
    }

    /// Electrical power in W per N of fundamental: both electrodes are charged from the rail once a period, 2 C V^2 f.
    #[must_use]
    pub fn electrical_power_w_per_n(&self, actuator: usize, frequency_hz: f64, pulse_width: f64) -> f64 {
        self.table.electrodes.get(actuator).map_or(0.0, |electrodes| {
            electrodes.mean_power_w(1.0, frequency_hz)
                / electrodes.harmonic_force_n_per_v2(1, frequency_hz, pulse_width)
        })
    }

    /// A candidate set with the rows of this request and without candidates.
    #[must_use]
    pub fn build_candidate_set_without_candidates(&self, wanted_m_per_s2: &[f64]) -> CandidateSet {
        let p = self.table.entries.len().min(MAX_ACTUATORS);
        CandidateSet {
            frequencies_hz: Vec::new(),
            candidates: vec![Vec::new(); p],
            gains: vec![Vec::new(); p],
            loads: vec![Vec::new(); p],
            wanted: wanted_m_per_s2.to_vec(),
            allowed: self
                .table
                .limits
                .allowed
                .iter()
                .copied()
                .chain(self.quiet.rows.iter().map(|(_, most)| *most))
                .collect(),
            spacing_hz: MIN_SPACING_HZ - 1e-9,
            work: self.work,
            is_estimated: false,
        }
    }

    /// Adds an actuator at a frequency with its pulse widths. `frequency_index` is the index of the frequency in the set, `caller_tag`
    /// the caller's own number.
    pub fn add_candidates_of_quiet_and_if_useful_widest_pulse(
        &self,
        choices: &mut CandidateSet,
        actuator: usize,
        frequency_index: usize,
        caller_tag: usize,
        entry: &Entry,
        frequency_hz: f64,
    ) {
        let near = self.zone.mean_square_over_zone(&entry.acceleration);
        self.add_candidates_of_pulses_with_given_mean_square_near_targets(
            choices,
            [actuator, frequency_index, caller_tag],
            entry,
            frequency_hz,
            near,
        );
    }

    /// Adds the same candidates with a known or assumed mean square near the targets. `[actuator, node, tag]` as
    /// above.
    fn add_candidates_of_pulses_with_given_mean_square_near_targets(
        &self,
        choices: &mut CandidateSet,
        [actuator, node, tag]: [usize; 3],
        entry: &Entry,
        frequency_hz: f64,
        near_mean_square: f64,
    ) {
        let [quiet, widest] = &entry.widths;
        let weight = if self.weigh == Weigh::Felt {
            perception::felt_weight_relative_to_reference_hz(frequency_hz)
        } else {
            1.0
        };
        let elsewhere = self.zone.mean_square_elsewhere(entry.mean_square, near_mean_square) * weight * weight;
        let at =
            |shape: &DVector<f64>| acceleration_at_point_from_coordinates(shape, &entry.acceleration).norm_sqr().sqrt();
        // A wider pulse makes more force of a voltage, which is what counts for power, even where another limit binds.
        let is_wanted = match self.objective {
            Objective::Power => true,
            Objective::Contrast | Objective::Reach => entry.widest_pulse_if_noticeably_stronger_else_quiet() == widest,
        };
        for (w, width) in [quiet, widest].into_iter().enumerate() {
            // The limits of quiet zones are about fundamentals: no drive buys strength with harmonics there.
            if w == 1 && (!is_wanted || width == quiet || !self.quiet.rows.is_empty()) {
                break;
            }
            let (energy, power) = match self.objective {
                Objective::Contrast | Objective::Reach => {
                    let is_felt = self.weigh == Weigh::Felt;
                    (elsewhere + if is_felt { width.felt_harmonics } else { width.harmonics }, 0.0)
                }
                Objective::Power => (0.0, self.electrical_power_w_per_n(actuator, frequency_hz, width.pulse_width)),
            };
            let candidate = Candidate { node, energy, power, max_force_n: width.max_force_n, tag: 2 * tag + w };
            choices.candidates[actuator].push(candidate);
            let gains = &mut choices.gains[actuator];
            if w == 0 {
                gains.extend(self.zone.targets.iter().map(|shape| weight * at(shape)));
            } else {
                // The same as with the other pulse.
                gains.extend_from_within(gains.len() - self.zone.targets.len()..);
            }
            choices.loads[actuator]
                .extend(self.table.limits.load_per_n_on_each_limit_in_unit_of_limit(actuator, width));
            choices.loads[actuator].extend(self.quiet.rows.iter().map(|(shape, _)| at(shape)));
        }
    }

    /// All actuators at all frequencies of the grid.
    #[must_use]
    pub fn list_candidates_at_all_table_frequencies(&self, wanted: &[f64]) -> CandidateSet {
        let mut choices = self.build_candidate_set_without_candidates(wanted);
        choices.frequencies_hz.clone_from(&self.table.frequencies_hz);
        for (actuator, list) in self.table.entries.iter().take(MAX_ACTUATORS).enumerate() {
            for (k, entry) in list.iter().enumerate() {
                if let Some(entry) = entry {
                    self.add_candidates_of_quiet_and_if_useful_widest_pulse(
                        &mut choices,
                        actuator,
                        k,
                        k,
                        entry,
                        self.table.frequencies_hz[k],
                    );
                }
            }
        }
        choices
    }

    /// The candidates that can be part of the best combination for one target and the objective contrast, by bounds
    /// that need one product per entry; all candidates if the bounds do not decide. If a first combination does not
    /// reach the wish, nearly all candidates can be part of a better one. Their energies, on which the reach does not
    /// depend, are then estimates that take the mean square near the target to be as large as at the target.
    #[must_use]
    pub fn shortlist_for_one_target_estimating_energies_if_wish_unmet(
        &self,
        wanted: f64,
        is_allowed_pair: &dyn Fn(f64, f64) -> bool,
    ) -> CandidateSet {
        let table = self.table;
        let (p, f) = (table.entries.len().min(MAX_ACTUATORS), table.frequencies_hz.len());
        let Some(shape) = self.zone.targets.first() else {
            return self.build_candidate_set_without_candidates(&[wanted]);
        };
        let squares = table.acceleration_coordinates().squared_accelerations_at_point_by_actuator_and_frequency(shape);
        let rough = &table.rough;
        let wanted = wanted.min(BEYOND_REACH * rough.bound_summed_peak_at_best_frequencies_m_per_s2(&squares, p, f));
        let efficiencies = rough.bound_target_to_elsewhere_energy_ratio_of_each_candidate(&squares);
        let Some(known) = self.allocate_heuristic_first_guess_if_spacing_can_be_kept(
            wanted,
            &squares,
            &efficiencies,
            is_allowed_pair,
        ) else {
            return self.list_candidates_at_all_table_frequencies(&[wanted]);
        };
        let lagrangian_terms = |known: &Allocation, efficiencies: &[f64]| {
            // No better one unless its sum of Lagrangian terms at this lambda is more than lambda a - cost.
            let lambda = known.duals.gain.first().copied().unwrap_or(0.0);
            (
                rough.bound_lagrangian_term_of_each_candidate(&squares, efficiencies, lambda),
                lambda * wanted - known.cost,
            )
        };
        let (known, earns, needed) = if known.met >= 1.0 {
            let (earns, needed) = lagrangian_terms(&known, &efficiencies);
            // Those that are left are worth the mean square near the target.
            let likely = mark_possible_candidates_by_band(
                &earns,
                p,
                &table.frequencies_hz,
                needed - SINGLE_PRECISION_ERROR * needed.abs(),
            );
            let near =
                table.acceleration_coordinates().mean_squared_accelerations_over_points_by_actuator_and_frequency(
                    &self.zone.quadrature_shapes_and_weights(),
                    &likely,
                );
            let efficiencies =
                rough.sharper_target_to_elsewhere_ratio_bounds_of_likely_or_0(&squares, &near, self.zone.part, &likely);
            let (earns, _) = lagrangian_terms(&known, &efficiencies);
            let trial =
                self.allocate_best_combination_among_band_peak_frequencies_if_allowed(&earns, wanted, is_allowed_pair);
            let known = trial.filter(|trial| meets_more_or_as_much_at_less_cost(trial, &known)).unwrap_or(known);
            let (mut earns, needed) = lagrangian_terms(&known, &efficiencies);
            earns
                .iter_mut()
                .zip(likely)
                .filter(|(_, likely)| !likely)
                .for_each(|(earns, _)| *earns = f64::NEG_INFINITY);
            (known, earns, needed)
        } else {
            // No better one unless it reaches more.
            let needed = known.met * wanted;
            (known, rough.max_peak_of_each_candidate_alone_m_per_s2(&squares), needed)
        };
        let mut choices = self.build_candidate_set_without_candidates(&[wanted]);
        // What a combination that is good by the bounds really is may show that more is needed.
        let improved = |picks: &[usize]| {
            let hz = |i: usize| table.frequencies_hz[picks[i]];
            let fit = (0..p).all(|i| (0..i).all(|j| is_allowed_pair(hz(i), hz(j))));
            let trial = self
                .allocate_quiet_else_strongest_pulses_if_frequencies_usable(picks, wanted)
                .filter(|trial| fit && meets_more_or_as_much_at_less_cost(trial, &known))?;
            let more = if known.met >= 1.0 { needed + known.cost - trial.cost } else { trial.met.min(1.0) * wanted };
            Some(more - SINGLE_PRECISION_ERROR * more.abs())
        };
        let kept = list_possible_frequency_actuator_pairs(
            &earns,
            p,
            &table.frequencies_hz,
            needed - SINGLE_PRECISION_ERROR * needed.abs(),
            improved,
        );
        let mut last = None;
        for (k, actuator) in kept {
            let Some(entry) = table.entry(actuator, k) else { continue };
            if last != Some(k) {
                choices.frequencies_hz.push(table.frequencies_hz[k]);
                last = Some(k);
            }
            let (node, frequency_hz) = (choices.frequencies_hz.len() - 1, table.frequencies_hz[k]);
            if known.met < 1.0 {
                choices.is_estimated = true;
                self.add_candidates_of_pulses_with_given_mean_square_near_targets(
                    &mut choices,
                    [actuator, node, k],
                    entry,
                    frequency_hz,
                    squares[actuator * f + k],
                );
            } else {
                self.add_candidates_of_quiet_and_if_useful_widest_pulse(
                    &mut choices,
                    actuator,
                    node,
                    k,
                    entry,
                    frequency_hz,
                );
            }
        }
        choices
    }

    /// The best combination of `choices`, which is a shortlist or the full set, together with the set.
    #[must_use]
    pub fn find_best_combination_replacing_estimated_energies_at_most_once(
        &self,
        mut choices: CandidateSet,
        is_allowed_pair: PairFilter<'_>,
    ) -> Option<(CandidateSet, BestCombination)> {
        let mut found = choices.find_best_combination_if_spacing_can_be_kept(is_allowed_pair)?;
        if choices.is_estimated {
            if found.allocation.met < 1.0 {
                self.replace_estimated_by_computed_energies(&mut choices, Some(&found.chosen));
                found.allocation = choices.allocate_combination(&found.chosen);
            } else {
                self.replace_estimated_by_computed_energies(&mut choices, None);
                choices.is_estimated = false;
                found = choices
                    .find_best_combination_from_guess_if_spacing_can_be_kept(is_allowed_pair, Some(found.chosen))?;
            }
        }
        Some((choices, found))
    }

    /// Replaces estimated energies of a shortlist by computed ones: those of one combination, or all.
    fn replace_estimated_by_computed_energies(&self, choices: &mut CandidateSet, combination: Option<&[usize]>) {
        for (i, (candidates, entries)) in choices.candidates.iter_mut().zip(&self.table.entries).enumerate() {
            let range = combination
                .and_then(|combination| combination.get(i))
                .map_or(0..candidates.len(), |index| *index..*index + 1);
            for candidate in &mut candidates[range] {
                if let Some(entry) = entries.get(candidate.tag / 2).and_then(Option::as_ref) {
                    candidate.energy =
                        self.mean_square_elsewhere_with_harmonics_per_n2(entry, &entry.widths[candidate.tag % 2]);
                }
            }
        }
    }

    /// The forces of a first combination that is good by the bounds: the most efficient frequency for one actuator
    /// after the other; if that does not reach the wish, the strongest ones, and from there the most efficient ones
    /// at the last dual variable. `None` if no combination fits.
    fn allocate_heuristic_first_guess_if_spacing_can_be_kept(
        &self,
        wanted: f64,
        squared_accelerations: &[f64],
        efficiencies: &[f64],
        is_allowed_pair: &dyn Fn(f64, f64) -> bool,
    ) -> Option<Allocation> {
        let table = self.table;
        let (p, f) = (table.entries.len().min(MAX_ACTUATORS), table.frequencies_hz.len());
        let hz = |k: usize| table.frequencies_hz[k];
        let mut picks: Vec<usize> = Vec::with_capacity(p);
        for actuator in 0..p {
            let range = actuator * f..(actuator + 1) * f;
            let mut best: Option<(usize, f64)> = None;
            for (k, score) in efficiencies[range].iter().copied().enumerate() {
                if score > best.map_or(0.0, |(_, best)| best) {
                    let keeps = |other: &usize| {
                        let other = hz(*other);
                        (hz(k) - other).abs() >= MIN_SPACING_HZ - 1e-9 && is_allowed_pair(hz(k), other)
                    };
                    if picks.iter().all(keeps) {
                        best = Some((k, score));
                    }
                }
            }
            picks.push(best?.0);
        }
        let mut known = self.allocate_quiet_else_strongest_pulses_if_frequencies_usable(&picks, wanted)?;
        if known.met >= 1.0 {
            return Some(known);
        }
        let lags = count_frequencies_below_each_with_spacing(&table.frequencies_hz, MIN_SPACING_HZ - 1e-9);
        let mut sums = Assignment::default();
        for _ in 0..FIRST_ROUNDS {
            let value = if known.met >= 1.0 {
                table.rough.bound_lagrangian_term_of_each_candidate(
                    squared_accelerations,
                    efficiencies,
                    known.duals.gain.first().copied()?,
                )
            } else {
                table.rough.max_peak_of_each_candidate_alone_m_per_s2(squared_accelerations)
            };
            sums.fill_best_sums_of_actuator_sets(p, value, &lags);
            let picks = sums.best_frequency_of_each_actuator_if_spacing_can_be_kept(&lags)?;
            let fit = (0..p).all(|i| (0..i).all(|j| is_allowed_pair(hz(picks[i]), hz(picks[j]))));
            let trial = self
                .allocate_quiet_else_strongest_pulses_if_frequencies_usable(&picks[..p], wanted)
                .filter(|trial| fit && meets_more_or_as_much_at_less_cost(trial, &known));
            let Some(trial) = trial else { break };
            known = trial;
            if known.met < 1.0 {
                break;
            }
        }
        Some(known)
    }

    /// The forces of the best combination of those frequencies at which an actuator has the largest Lagrangian term
    /// in its band.
    fn allocate_best_combination_among_band_peak_frequencies_if_allowed(
        &self,
        lagrangian_terms: &[f64],
        wanted: f64,
        is_allowed_pair: &dyn Fn(f64, f64) -> bool,
    ) -> Option<Allocation> {
        let hz = &self.table.frequencies_hz;
        let f = hz.len();
        let lowest_hz = hz.first().copied()?;
        let mut is_peak = vec![false; f];
        for own in lagrangian_terms.chunks(f.max(1)) {
            let (mut upto_hz, mut peak) = (lowest_hz + BAND_HZ, None);
            for (k, term) in own.iter().enumerate() {
                if hz[k] >= upto_hz {
                    peak.take().into_iter().for_each(|(k, _): (usize, f64)| is_peak[k] = true);
                    while hz[k] >= upto_hz {
                        upto_hz += BAND_HZ;
                    }
                }
                if *term > peak.map_or(0.0, |(_, most)| most) {
                    peak = Some((k, *term));
                }
            }
            peak.into_iter().for_each(|(k, _)| is_peak[k] = true);
        }
        let nodes: Vec<usize> = (0..f).filter(|k| is_peak[*k]).collect();
        let nodes_hz: Vec<f64> = nodes.iter().map(|k| hz[*k]).collect();
        let lags = count_frequencies_below_each_with_spacing(&nodes_hz, MIN_SPACING_HZ - 1e-9);
        let p = lagrangian_terms.len() / f.max(1);
        let value = (0..p).flat_map(|i| nodes.iter().map(move |k| lagrangian_terms[i * f + k])).collect();
        let mut sums = Assignment::default();
        sums.fill_best_sums_of_actuator_sets(p, value, &lags);
        let places = sums.best_frequency_of_each_actuator_if_spacing_can_be_kept(&lags)?;
        let picks: Vec<usize> = places[..p].iter().map(|place| nodes[*place]).collect();
        let fit = (0..p).all(|i| (0..i).all(|j| is_allowed_pair(hz[picks[i]], hz[picks[j]])));
        if fit { self.allocate_quiet_else_strongest_pulses_if_frequencies_usable(&picks, wanted) } else { None }
    }

    /// The forces of one combination: with the quiet pulses if they reach the wish, otherwise with the strong ones.
    fn allocate_quiet_else_strongest_pulses_if_frequencies_usable(
        &self,
        frequency_indices: &[usize],
        wanted: f64,
    ) -> Option<Allocation> {
        let mut choices = self.build_candidate_set_without_candidates(&[wanted]);
        for (actuator, k) in frequency_indices.iter().enumerate() {
            choices.frequencies_hz.push(self.table.frequencies_hz[*k]);
            self.add_candidates_of_quiet_and_if_useful_widest_pulse(
                &mut choices,
                actuator,
                actuator,
                *k,
                self.table.entry(actuator, *k)?,
                self.table.frequencies_hz[*k],
            );
        }
        let of = |strong: usize| {
            let at: Vec<usize> = choices.candidates.iter().map(|list| strong.min(list.len() - 1)).collect();
            choices.allocate_combination(&at)
        };
        let quiet = of(0);
        Some(if quiet.met >= 1.0 { quiet } else { of(1) })
    }

    /// A wanted acceleration in m/s^2, limited to a million times the sum of what the actuators reach at their best.
    #[must_use]
    pub fn limit_wanted_to_million_times_reach_m_per_s2(&self, wanted: f64, target: usize) -> f64 {
        let (p, f) = (self.table.entries.len().min(MAX_ACTUATORS), self.table.frequencies_hz.len());
        if wanted < 1e6 {
            return wanted;
        }
        let Some(shape) = self.zone.targets.get(target) else { return wanted };
        let most = self.table.rough.bound_summed_peak_at_best_frequencies_m_per_s2(
            &self.table.acceleration_coordinates().squared_accelerations_at_point_by_actuator_and_frequency(shape),
            p,
            f,
        );
        // Where nothing is reached the wish stands, so that it is not met.
        wanted.min(if most > 0.0 { BEYOND_REACH * most } else { f64::MAX })
    }
}

/// Marks the candidates whose Lagrangian term, together with the largest ones of the other actuators at a sufficient
/// distance, reaches `needed_sum`. Frequencies in the same band count as one, and bands count as far enough apart if
/// their ends are.
fn mark_possible_candidates_by_band(
    lagrangian_terms: &[f64],
    actuators: usize,
    frequencies_hz: &[f64],
    needed_sum: f64,
) -> Vec<bool> {
    let lowest_hz = frequencies_hz.first().copied().unwrap_or(0.0);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundred bands")]
    let band = |hz: &f64| ((hz - lowest_hz) / BAND_HZ) as usize;
    let bands: Vec<usize> = frequencies_hz.iter().map(band).collect();
    let count = bands.last().map_or(0, |last| last + 1);
    let mut value = vec![f64::NEG_INFINITY; actuators * count];
    let by_actuator = || lagrangian_terms.chunks(frequencies_hz.len().max(1)).take(actuators).enumerate();
    for (i, own) in by_actuator() {
        for (term, band) in own.iter().zip(&bands) {
            let value = &mut value[i * count + band];
            *value = value.max(*term);
        }
    }
    let turned = value.chunks(count.max(1)).flat_map(|own| own.iter().rev().copied()).collect();
    let lags: Vec<usize> = (0..count).map(|band| (band + 1).saturating_sub(BANDS_APART)).collect();
    let (mut up, mut down) = (Assignment::default(), Assignment::default());
    up.fill_best_sums_of_actuator_sets(actuators, value, &lags);
    down.fill_best_sums_of_actuator_sets(actuators, turned, &lags);
    let mut out = Vec::with_capacity(lagrangian_terms.len());
    for (i, own) in by_actuator() {
        let others = |band: usize| {
            up.best_spaced_sum_with_actuator_at_frequency(&down, i, band, lags[band], lags[count - 1 - band])
                - up.contribution_at(i, band)
        };
        let others: Vec<f64> = (0..count).map(others).collect();
        out.extend(own.iter().zip(&bands).map(|(term, band)| *term + others[*band] >= needed_sum));
    }
    out
}

/// The (frequency, actuator) pairs, in ascending order, that are part of a combination whose Lagrangian terms add up
/// to `needed_sum`. `raised_threshold` returns for a combination the higher threshold that follows once its forces are known.
fn list_possible_frequency_actuator_pairs(
    lagrangian_terms: &[f64],
    actuators: usize,
    frequencies_hz: &[f64],
    mut needed_sum: f64,
    raised_threshold: impl Fn(&[usize]) -> Option<f64>,
) -> Vec<(usize, usize)> {
    let f = frequencies_hz.len();
    let own = |i: usize| &lagrangian_terms[i * f..(i + 1) * f];
    // First by bands.
    let mut is_node = vec![false; f];
    for own in
        mark_possible_candidates_by_band(lagrangian_terms, actuators, frequencies_hz, needed_sum).chunks(f.max(1))
    {
        is_node.iter_mut().zip(own).for_each(|(is_node, likely)| *is_node |= likely);
    }
    let nodes: Vec<usize> = (0..f).filter(|k| is_node[*k]).collect();
    // Then by the best combinations through each place.
    let hz: Vec<f64> = nodes.iter().map(|k| frequencies_hz[*k]).collect();
    let turned: Vec<f64> = hz.iter().rev().map(|hz| -hz).collect();
    let spacing = MIN_SPACING_HZ - 1e-9;
    let (below, above) = (
        count_frequencies_below_each_with_spacing(&hz, spacing),
        count_frequencies_below_each_with_spacing(&turned, spacing),
    );
    let mut value = Vec::with_capacity(actuators * nodes.len());
    for i in 0..actuators {
        value.extend(nodes.iter().map(|k| own(i)[*k]));
    }
    let mut turned = Vec::with_capacity(value.len());
    for own in value.chunks(nodes.len().max(1)) {
        turned.extend(own.iter().rev());
    }
    let (mut up, mut down) = (Assignment::default(), Assignment::default());
    up.fill_best_sums_of_actuator_sets(actuators, value, &below);
    if let Some(places) = up.best_frequency_of_each_actuator_if_spacing_can_be_kept(&below) {
        let picks = places.map(|place| nodes.get(place).copied().unwrap_or(0));
        needed_sum = raised_threshold(&picks[..actuators]).unwrap_or(needed_sum).max(needed_sum);
    }
    down.fill_best_sums_of_actuator_sets(actuators, turned, &above);
    let mut kept = Vec::new();
    for (place, k) in nodes.iter().enumerate() {
        for i in 0..actuators {
            if up.best_spaced_sum_with_actuator_at_frequency(
                &down,
                i,
                place,
                below[place],
                above[nodes.len() - 1 - place],
            ) >= needed_sum
            {
                kept.push((*k, i));
            }
        }
    }
    kept
}
