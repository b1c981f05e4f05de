//! What a touch has to choose from: every actuator at every frequency that can be part of the best combination.

use crate::choose::allocate::Allocation;
use crate::choose::assignment::{Assignment, lags};
use crate::choose::search::{BestCombination, Candidate, Choices, Fits, is_better};
use crate::perception;
use crate::request::quiet_zones::QuietZones;
use crate::request::target_zone::Zone;
use crate::request::{Objective, Request, Weigh, Work};
use crate::scene::{EPS0, MAX_ACTUATORS};
use crate::table::{Entry, PlanTable, SINGLE, Width, at_point};
use crate::{ELECTRODE_CABLE_F, MIN_SPACING_HZ};
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

/// A request's targets, and what a candidate does to them.
#[derive(Clone, Debug)]
pub struct Formulation<'a> {
    table: &'a PlanTable,
    /// The targets and what is around them.
    pub zone: Zone,
    /// The quiet zones.
    pub quiet: QuietZones,
    objective: Objective,
    weigh: Weigh,
    work: Work,
}

impl<'a> Formulation<'a> {
    /// For a request that has been checked.
    #[must_use]
    pub fn new(table: &'a PlanTable, request: &Request) -> Self {
        Self {
            table,
            zone: Zone::new(table, &request.targets),
            quiet: QuietZones::new(table, &request.quiet),
            objective: request.objective,
            weigh: request.weigh,
            work: request.work,
        }
    }

    /// Mean square elsewhere per N^2, harmonics included.
    #[must_use]
    pub fn energy(&self, entry: &Entry, width: &Width) -> f64 {
        self.zone.elsewhere(entry.mean_square, self.zone.mean_square(&entry.acceleration)) + width.harmonics
    }

    /// Electrical power in W per N of fundamental: both electrodes are charged from the rail once a period, 2 C V^2 f.
    #[must_use]
    pub fn power_w_per_n(&self, actuator: usize, frequency_hz: f64, pulse_width: f64) -> f64 {
        self.table.electrodes.get(actuator).map_or(0.0, |electrodes| {
            let capacitance = EPS0 * electrodes.area_m2 / electrodes.gap_m + ELECTRODE_CABLE_F;
            2.0 * capacitance * frequency_hz / electrodes.harmonic_per_volt_squared(1, pulse_width)
        })
    }

    /// An empty list of choices with this request's rows. `wanted` in m/s^2.
    #[must_use]
    pub fn empty(&self, wanted: &[f64]) -> Choices {
        let p = self.table.entries.len().min(MAX_ACTUATORS);
        Choices {
            frequencies_hz: Vec::new(),
            candidates: vec![Vec::new(); p],
            gains: vec![Vec::new(); p],
            loads: vec![Vec::new(); p],
            wanted: wanted.to_vec(),
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

    /// Adds an actuator at a frequency, which has the number `node` in the list and `tag` for the caller, with its pulse
    /// widths.
    pub fn add(
        &self,
        choices: &mut Choices,
        actuator: usize,
        node: usize,
        tag: usize,
        entry: &Entry,
        frequency_hz: f64,
    ) {
        let near = self.zone.mean_square(&entry.acceleration);
        self.add_with(choices, [actuator, node, tag], entry, frequency_hz, near);
    }

    /// The same with what is known, or taken, for the mean square near the targets. `[actuator, node, tag]` as above.
    fn add_with(
        &self,
        choices: &mut Choices,
        [actuator, node, tag]: [usize; 3],
        entry: &Entry,
        frequency_hz: f64,
        near: f64,
    ) {
        let [quiet, widest] = &entry.widths;
        let weight = if self.weigh == Weigh::Felt { perception::weight(frequency_hz) } else { 1.0 };
        let elsewhere = self.zone.elsewhere(entry.mean_square, near) * weight * weight;
        let at = |shape: &DVector<f64>| at_point(shape, &entry.acceleration).norm_sqr().sqrt();
        // A wider pulse makes more force of a voltage, which is what counts for power, even where another limit binds.
        let is_wanted = match self.objective {
            Objective::Power => true,
            Objective::Contrast | Objective::Reach => entry.strong() == widest,
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
                Objective::Power => (0.0, self.power_w_per_n(actuator, frequency_hz, width.pulse_width)),
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
            choices.loads[actuator].extend(self.table.limits.loads(actuator, width));
            choices.loads[actuator].extend(self.quiet.rows.iter().map(|(shape, _)| at(shape)));
        }
    }

    /// Everything: all actuators at all frequencies of the grid.
    #[must_use]
    pub fn all(&self, wanted: &[f64]) -> Choices {
        let mut choices = self.empty(wanted);
        choices.frequencies_hz.clone_from(&self.table.frequencies_hz);
        for (actuator, list) in self.table.entries.iter().take(MAX_ACTUATORS).enumerate() {
            for (k, entry) in list.iter().enumerate() {
                if let Some(entry) = entry {
                    self.add(&mut choices, actuator, k, k, entry, self.table.frequencies_hz[k]);
                }
            }
        }
        choices
    }

    /// What cannot be missing from the best combination for one target and the objective contrast, from bounds that take one
    /// product per entry; all where the bounds do not decide. Where a first combination does not reach what is wanted, nearly
    /// all can be part of one that reaches more, and their energies, on which that does not depend, are estimates: with the mean
    /// square near the target as large as at it.
    #[must_use]
    pub fn shortlist(&self, wanted: f64, fits: &dyn Fn(f64, f64) -> bool) -> Choices {
        let table = self.table;
        let (p, f) = (table.entries.len().min(MAX_ACTUATORS), table.frequencies_hz.len());
        let Some(shape) = self.zone.targets.first() else { return self.empty(&[wanted]) };
        let squares = table.gains().squares(shape);
        let rough = &table.rough;
        let wanted = wanted.min(BEYOND_REACH * rough.most_reach(&squares, p, f));
        let efficiencies = rough.efficiencies(&squares);
        let Some(known) = self.first(wanted, &squares, &efficiencies, fits) else { return self.all(&[wanted]) };
        let earnings = |known: &Allocation, efficiencies: &[f64]| {
            // No better one unless its sum of earnings at this lambda is more than lambda a - cost.
            let lambda = known.duals.gain.first().copied().unwrap_or(0.0);
            (rough.earnings(&squares, efficiencies, lambda), lambda * wanted - known.cost)
        };
        let (known, earns, needed) = if known.met >= 1.0 {
            let (earns, needed) = earnings(&known, &efficiencies);
            // Those that are left are worth the mean square near the target.
            let likely = likely(&earns, p, &table.frequencies_hz, needed - SINGLE * needed.abs());
            let near = table.gains().mean_squares(&self.zone.points(), &likely);
            let efficiencies = rough.sharper(&squares, &near, self.zone.part, &likely);
            let (earns, _) = earnings(&known, &efficiencies);
            let trial = self.of_peaks(&earns, wanted, fits);
            let known = trial.filter(|trial| is_better(trial, &known)).unwrap_or(known);
            let (mut earns, needed) = earnings(&known, &efficiencies);
            earns
                .iter_mut()
                .zip(likely)
                .filter(|(_, likely)| !likely)
                .for_each(|(earns, _)| *earns = f64::NEG_INFINITY);
            (known, earns, needed)
        } else {
            // No better one unless it reaches more.
            let needed = known.met * wanted;
            (known, rough.reaches(&squares), needed)
        };
        let mut choices = self.empty(&[wanted]);
        // What a combination that is good by the bounds really is may show that more is needed.
        let improved = |picks: &[usize]| {
            let hz = |i: usize| table.frequencies_hz[picks[i]];
            let fit = (0..p).all(|i| (0..i).all(|j| fits(hz(i), hz(j))));
            let trial = self.known(picks, wanted).filter(|trial| fit && is_better(trial, &known))?;
            let more = if known.met >= 1.0 { needed + known.cost - trial.cost } else { trial.met.min(1.0) * wanted };
            Some(more - SINGLE * more.abs())
        };
        let kept = kept(&earns, p, &table.frequencies_hz, needed - SINGLE * needed.abs(), improved);
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
                self.add_with(&mut choices, [actuator, node, k], entry, frequency_hz, squares[actuator * f + k]);
            } else {
                self.add(&mut choices, actuator, node, k, entry, frequency_hz);
            }
        }
        choices
    }

    /// The best of `choices`, a shortlist or all, with them.
    #[must_use]
    pub fn best_of(&self, mut choices: Choices, fits: Fits<'_>) -> Option<(Choices, BestCombination)> {
        let mut found = choices.best(fits)?;
        if choices.is_estimated {
            if found.allocation.met < 1.0 {
                self.work_out(&mut choices, Some(&found.chosen));
                found.allocation = choices.allocation(&found.chosen);
            } else {
                self.work_out(&mut choices, None);
                choices.is_estimated = false;
                found = choices.best_from(fits, Some(found.chosen))?;
            }
        }
        Some((choices, found))
    }

    /// Works out energies of a shortlist that are estimates: those of one combination, or all.
    fn work_out(&self, choices: &mut Choices, only: Option<&[usize]>) {
        for (i, (candidates, entries)) in choices.candidates.iter_mut().zip(&self.table.entries).enumerate() {
            let range = only.and_then(|only| only.get(i)).map_or(0..candidates.len(), |index| *index..*index + 1);
            for candidate in &mut candidates[range] {
                if let Some(entry) = entries.get(candidate.tag / 2).and_then(Option::as_ref) {
                    candidate.energy = self.energy(entry, &entry.widths[candidate.tag % 2]);
                }
            }
        }
    }

    /// A combination that is good by the bounds: the most efficient, one actuator after the other; if that does not reach,
    /// the strongest, and from there what is most efficient at the lambda of the last one. `None` without any that fits.
    fn first(
        &self,
        wanted: f64,
        squares: &[f64],
        efficiencies: &[f64],
        fits: &dyn Fn(f64, f64) -> bool,
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
                        (hz(k) - other).abs() >= MIN_SPACING_HZ - 1e-9 && fits(hz(k), other)
                    };
                    if picks.iter().all(keeps) {
                        best = Some((k, score));
                    }
                }
            }
            picks.push(best?.0);
        }
        let mut known = self.known(&picks, wanted)?;
        if known.met >= 1.0 {
            return Some(known);
        }
        let lags = lags(&table.frequencies_hz, MIN_SPACING_HZ - 1e-9);
        let mut sums = Assignment::default();
        for _ in 0..FIRST_ROUNDS {
            let value = if known.met >= 1.0 {
                table.rough.earnings(squares, efficiencies, known.duals.gain.first().copied()?)
            } else {
                table.rough.reaches(squares)
            };
            sums.fill(p, value, &lags);
            let picks = sums.choice(&lags)?;
            let fit = (0..p).all(|i| (0..i).all(|j| fits(hz(picks[i]), hz(picks[j]))));
            let trial = self.known(&picks[..p], wanted).filter(|trial| fit && is_better(trial, &known));
            let Some(trial) = trial else { break };
            known = trial;
            if known.met < 1.0 {
                break;
            }
        }
        Some(known)
    }

    /// The best combination of the frequencies at which an actuator earns most of its band.
    fn of_peaks(&self, earns: &[f64], wanted: f64, fits: &dyn Fn(f64, f64) -> bool) -> Option<Allocation> {
        let hz = &self.table.frequencies_hz;
        let f = hz.len();
        let lowest_hz = hz.first().copied()?;
        let mut is_peak = vec![false; f];
        for own in earns.chunks(f.max(1)) {
            let (mut upto_hz, mut peak) = (lowest_hz + BAND_HZ, None);
            for (k, earns) in own.iter().enumerate() {
                if hz[k] >= upto_hz {
                    peak.take().into_iter().for_each(|(k, _): (usize, f64)| is_peak[k] = true);
                    while hz[k] >= upto_hz {
                        upto_hz += BAND_HZ;
                    }
                }
                if *earns > peak.map_or(0.0, |(_, most)| most) {
                    peak = Some((k, *earns));
                }
            }
            peak.into_iter().for_each(|(k, _)| is_peak[k] = true);
        }
        let nodes: Vec<usize> = (0..f).filter(|k| is_peak[*k]).collect();
        let nodes_hz: Vec<f64> = nodes.iter().map(|k| hz[*k]).collect();
        let lags = lags(&nodes_hz, MIN_SPACING_HZ - 1e-9);
        let p = earns.len() / f.max(1);
        let value = (0..p).flat_map(|i| nodes.iter().map(move |k| earns[i * f + k])).collect();
        let mut sums = Assignment::default();
        sums.fill(p, value, &lags);
        let places = sums.choice(&lags)?;
        let picks: Vec<usize> = places[..p].iter().map(|place| nodes[*place]).collect();
        let fit = (0..p).all(|i| (0..i).all(|j| fits(hz[picks[i]], hz[picks[j]])));
        if fit { self.known(&picks, wanted) } else { None }
    }

    /// The forces of one combination: with the quieter pulses where they reach, with the stronger ones otherwise.
    fn known(&self, picks: &[usize], wanted: f64) -> Option<Allocation> {
        let mut choices = self.empty(&[wanted]);
        for (actuator, k) in picks.iter().enumerate() {
            choices.frequencies_hz.push(self.table.frequencies_hz[*k]);
            self.add(
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
            choices.allocation(&at)
        };
        let quiet = of(0);
        Some(if quiet.met >= 1.0 { quiet } else { of(1) })
    }

    /// A wanted acceleration in m/s^2, at most a million times the sum of what the actuators reach at their best.
    #[must_use]
    pub fn countable(&self, wanted: f64, target: usize) -> f64 {
        let (p, f) = (self.table.entries.len().min(MAX_ACTUATORS), self.table.frequencies_hz.len());
        if wanted < 1e6 {
            return wanted;
        }
        let Some(shape) = self.zone.targets.get(target) else { return wanted };
        let most = self.table.rough.most_reach(&self.table.gains().squares(shape), p, f);
        // Where nothing is reached the wish stands, so that it is not met.
        wanted.min(if most > 0.0 { BEYOND_REACH * most } else { f64::MAX })
    }
}

/// Which actuators at which frequencies earn what is needed together with the most that the others earn far enough from there:
/// frequencies of a band count as one, and bands whose ends are the spacing apart as far enough.
fn likely(earns: &[f64], p: usize, frequencies_hz: &[f64], needed: f64) -> Vec<bool> {
    let lowest_hz = frequencies_hz.first().copied().unwrap_or(0.0);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundred bands")]
    let band = |hz: &f64| ((hz - lowest_hz) / BAND_HZ) as usize;
    let bands: Vec<usize> = frequencies_hz.iter().map(band).collect();
    let count = bands.last().map_or(0, |last| last + 1);
    let mut value = vec![f64::NEG_INFINITY; p * count];
    let by_actuator = || earns.chunks(frequencies_hz.len().max(1)).take(p).enumerate();
    for (i, own) in by_actuator() {
        for (earns, band) in own.iter().zip(&bands) {
            let value = &mut value[i * count + band];
            *value = value.max(*earns);
        }
    }
    let turned = value.chunks(count.max(1)).flat_map(|own| own.iter().rev().copied()).collect();
    let lags: Vec<usize> = (0..count).map(|band| (band + 1).saturating_sub(BANDS_APART)).collect();
    let (mut up, mut down) = (Assignment::default(), Assignment::default());
    up.fill(p, value, &lags);
    down.fill(p, turned, &lags);
    let mut out = Vec::with_capacity(earns.len());
    for (i, own) in by_actuator() {
        let others = |band: usize| up.through(&down, i, band, lags[band], lags[count - 1 - band]) - up.value(i, band);
        let others: Vec<f64> = (0..count).map(others).collect();
        out.extend(own.iter().zip(&bands).map(|(earns, band)| *earns + others[*band] >= needed));
    }
    out
}

/// Frequencies and actuators, in ascending order, that are part of a combination whose earnings add up to what is needed.
/// `improved` says of a combination, a frequency per actuator, by how much more is needed once it is known.
fn kept(
    earns: &[f64],
    p: usize,
    frequencies_hz: &[f64],
    mut needed: f64,
    improved: impl Fn(&[usize]) -> Option<f64>,
) -> Vec<(usize, usize)> {
    let f = frequencies_hz.len();
    let own = |i: usize| &earns[i * f..(i + 1) * f];
    // First by bands.
    let mut is_node = vec![false; f];
    for own in likely(earns, p, frequencies_hz, needed).chunks(f.max(1)) {
        is_node.iter_mut().zip(own).for_each(|(is_node, likely)| *is_node |= likely);
    }
    let nodes: Vec<usize> = (0..f).filter(|k| is_node[*k]).collect();
    // Then by the best combinations through each place.
    let hz: Vec<f64> = nodes.iter().map(|k| frequencies_hz[*k]).collect();
    let turned: Vec<f64> = hz.iter().rev().map(|hz| -hz).collect();
    let spacing = MIN_SPACING_HZ - 1e-9;
    let (below, above) = (lags(&hz, spacing), lags(&turned, spacing));
    let mut value = Vec::with_capacity(p * nodes.len());
    for i in 0..p {
        value.extend(nodes.iter().map(|k| own(i)[*k]));
    }
    let mut turned = Vec::with_capacity(value.len());
    for own in value.chunks(nodes.len().max(1)) {
        turned.extend(own.iter().rev());
    }
    let (mut up, mut down) = (Assignment::default(), Assignment::default());
    up.fill(p, value, &below);
    if let Some(places) = up.choice(&below) {
        let picks = places.map(|place| nodes.get(place).copied().unwrap_or(0));
        needed = improved(&picks[..p]).unwrap_or(needed).max(needed);
    }
    down.fill(p, turned, &above);
    let mut kept = Vec::new();
    for (place, k) in nodes.iter().enumerate() {
        for i in 0..p {
            if up.through(&down, i, place, below[place], above[nodes.len() - 1 - place]) >= needed {
                kept.push((*k, i));
            }
        }
    }
    kept
}
