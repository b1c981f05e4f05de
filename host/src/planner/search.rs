//! The choice of frequencies.

use super::MIN_SPACING_HZ;
use super::allocate::{Choice, allocate};
use super::limits::Limit;

/// Candidates kept per actuator where all combinations would be too many (three and more actuators, or several
/// targets). Taken half by energy elsewhere and half by reach, so that neither is lost.
const SHORTLIST: usize = 28;
/// Odd harmonics of a drive that its electrode windows leave and that another's frequency may meet within the grid: at a
/// pulse width of 2/3 there is no third and no ninth. The fifth has a fifth of the fundamental's force.
const HARMONICS: [f64; 2] = [5.0, 7.0];

/// One actuator at one frequency, seen from the targets.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Index into the frequency grid.
    pub frequency: usize,
    /// In Hz.
    pub frequency_hz: f64,
    /// Acceleration per newton at each target, in m/s^2/N.
    pub gain: Vec<f64>,
    /// Mean square elsewhere, per N^2.
    pub energy: f64,
    /// Most force in N.
    pub max_force_n: f64,
    /// What sets it.
    pub limit: Limit,
}

/// The best combination.
#[derive(Clone, Debug, PartialEq)]
pub struct Selection {
    /// One candidate per actuator, and its force in N.
    pub drives: Vec<(Candidate, f64)>,
    /// Least part of what was wanted that a target gets; 1 if all is met.
    pub met: f64,
}

/// Looks at every combination of candidates, one per actuator, whose frequencies keep their distance, and returns the one
/// that meets the targets with the least energy elsewhere; if none meets them, the one that comes nearest.
///
/// No drive's fifth or seventh harmonic falls on another's frequency if there is a choice: it would change, by an amount
/// that no one asked for, what is felt there. Exhaustive over the grid for one and two actuators and one target, over a
/// shortlist otherwise.
#[must_use]
pub fn search(candidates: &[Vec<Candidate>], wanted: &[f64]) -> Option<Selection> {
    let exhaustive = candidates.len() <= 2 && wanted.len() == 1;
    let lists: Vec<Vec<&Candidate>> = candidates
        .iter()
        .map(|list| if exhaustive { list.iter().collect() } else { shortlist(list, wanted, candidates.len()) })
        .collect();
    let best_under = |fits: Fits<'_>| {
        let mut best: Option<Best<'_>> = None;
        descend(&lists, wanted, fits, &mut Vec::with_capacity(lists.len()), &mut best);
        best
    };
    let best = best_under(&|a, b| spaced(a, b) && !harmonic(a, b)).or_else(|| best_under(&spaced));
    best.map(|best| Selection { drives: best.chosen.into_iter().cloned().zip(best.forces).collect(), met: best.met })
}

struct Best<'a> {
    met: f64,
    energy: f64,
    chosen: Vec<&'a Candidate>,
    forces: Vec<f64>,
}

impl Best<'_> {
    /// More is met, or as much with less energy elsewhere.
    fn is_beaten_by(&self, met: f64, energy: f64) -> bool {
        // Relative: what is far beyond reach is met in a small part by all.
        const SAME: f64 = 1e-9;
        met > self.met * (1.0 + SAME) || met > self.met * (1.0 - SAME) && energy < self.energy
    }
}

/// Whether two drives may have these frequencies, in Hz.
type Fits<'a> = &'a dyn Fn(f64, f64) -> bool;

fn spaced(a_hz: f64, b_hz: f64) -> bool {
    (a_hz - b_hz).abs() >= MIN_SPACING_HZ - 1e-9
}

/// Whether one is a harmonic of the other.
fn harmonic(a_hz: f64, b_hz: f64) -> bool {
    let (low, high) = (a_hz.min(b_hz), a_hz.max(b_hz));
    HARMONICS.iter().any(|n| (n * low - high).abs() <= 1e-6 * high)
}

fn descend<'a>(
    lists: &[Vec<&'a Candidate>],
    wanted: &[f64],
    fits: Fits<'_>,
    chosen: &mut Vec<&'a Candidate>,
    best: &mut Option<Best<'a>>,
) {
    let Some(list) = lists.get(chosen.len()) else {
        judge(chosen, wanted, best);
        return;
    };
    for candidate in list {
        if chosen.iter().all(|other| fits(other.frequency_hz, candidate.frequency_hz)) {
            chosen.push(candidate);
            descend(lists, wanted, fits, chosen, best);
            chosen.pop();
        }
    }
}

fn judge<'a>(chosen: &[&'a Candidate], wanted: &[f64], best: &mut Option<Best<'a>>) {
    let choices: Vec<Choice<'_>> = chosen
        .iter()
        .map(|candidate| Choice { gain: &candidate.gain, energy: candidate.energy, max_force_n: candidate.max_force_n })
        .collect();
    let forces = allocate(&choices, wanted);
    let energy = choices.iter().zip(&forces).map(|(choice, force)| choice.energy * force * force).sum();
    let met = wanted
        .iter()
        .enumerate()
        .map(|(target, wanted)| {
            let reached: f64 = choices
                .iter()
                .zip(&forces)
                .map(|(choice, force)| choice.gain.get(target).unwrap_or(&0.0) * force)
                .sum();
            if *wanted > 0.0 { (reached / wanted).min(1.0) } else { 1.0 }
        })
        .fold(1.0, f64::min);
    if best.as_ref().is_none_or(|best| best.is_beaten_by(met, energy)) {
        *best = Some(Best { met, energy, chosen: chosen.to_vec(), forces });
    }
}

/// How good a candidate is, given its gain over what is wanted.
type Score<'a> = &'a dyn Fn(&Candidate, f64) -> f64;

/// The most promising candidates by efficiency (gain^2 over energy) and by reach (gain times most force), and before them
/// enough that keep their distance from each other: a frequency chosen for another actuator is too near to at most two of
/// those, so 2 (p - 1) + 1 leave one for every one of p actuators, also where all are best at the same resonance.
fn shortlist<'a>(list: &'a [Candidate], wanted: &[f64], actuators: usize) -> Vec<&'a Candidate> {
    let score = |by: Score<'_>, candidate: &Candidate| -> f64 {
        candidate
            .gain
            .iter()
            .zip(wanted)
            .map(|(gain, wanted)| by(candidate, gain / wanted.max(f64::MIN_POSITIVE)))
            .sum()
    };
    let efficiency = |candidate: &Candidate, gain: f64| gain * gain / candidate.energy;
    let reach = |candidate: &Candidate, gain: f64| gain * candidate.max_force_n;
    let sorted = |by: Score<'_>| {
        let mut sorted: Vec<(f64, &Candidate)> =
            list.iter().map(|candidate| (score(by, candidate), candidate)).collect();
        sorted.sort_by(|a, b| b.0.total_cmp(&a.0));
        sorted.into_iter().map(|(_, candidate)| candidate).collect::<Vec<_>>()
    };
    let (by_efficiency, by_reach) = (sorted(&efficiency), sorted(&reach));
    let mut kept: Vec<&Candidate> = Vec::new();
    for candidate in &by_efficiency {
        if kept.len() < 2 * actuators - 1 && kept.iter().all(|other| spaced(other.frequency_hz, candidate.frequency_hz))
        {
            kept.push(candidate);
        }
    }
    for (ranked, until) in [(by_efficiency, kept.len().midpoint(SHORTLIST)), (by_reach, SHORTLIST)] {
        for candidate in ranked {
            if kept.len() >= until {
                break;
            }
            if !kept.iter().any(|other| other.frequency == candidate.frequency) {
                kept.push(candidate);
            }
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(frequency: u32, gain: f64, energy: f64, max_force_n: f64) -> Candidate {
        Candidate {
            frequency: frequency as usize,
            frequency_hz: f64::from(frequency),
            gain: vec![gain],
            energy,
            max_force_n,
            limit: Limit::Voltage,
        }
    }

    #[test]
    fn the_most_efficient_spaced_pair_wins() {
        let left = vec![candidate(100, 2.0, 1.0, 10.0), candidate(150, 1.9, 1.0, 10.0)];
        let right = vec![candidate(110, 3.0, 1.0, 10.0), candidate(200, 0.1, 1.0, 10.0)];
        let selection = search(&[left, right], &[1.0]).unwrap();
        let frequencies: Vec<f64> = selection.drives.iter().map(|(candidate, _)| candidate.frequency_hz).collect();
        assert_eq!(frequencies, [150.0, 110.0], "100 and 110 Hz are too near each other");
        assert_eq!(selection.met, 1.0);
        assert!(selection.drives.iter().all(|(_, force)| *force > 0.0));
    }

    #[test]
    fn out_of_reach_takes_the_strongest() {
        let only = vec![candidate(100, 10.0, 0.1, 0.01), candidate(150, 1.0, 10.0, 1.0)];
        let selection = search(&[only], &[5.0]).unwrap();
        assert_eq!(selection.drives[0].0.frequency, 150);
        assert!((selection.met - 0.2).abs() < 1e-12);
    }

    #[test]
    fn actuators_that_share_their_best_resonance_all_get_a_frequency() {
        // A broad resonance at 120 Hz: the best candidates by far are the same narrow band for all four.
        let list: Vec<Candidate> = (20..=200)
            .map(|half| {
                let gain = 1.0 / (1.0 + ((f64::from(2 * half) - 120.0) / 20.0).powi(2));
                candidate(2 * half, gain, 1.0, 10.0)
            })
            .collect();
        let selection = search(&vec![list; 4], &[1.0]).unwrap();
        assert_eq!(selection.drives.len(), 4);
        assert_eq!(selection.met, 1.0);
    }

    #[test]
    fn a_frequency_on_anothers_fifth_harmonic_is_left_out() {
        let left = vec![candidate(60, 2.0, 1.0, 10.0)];
        let right = vec![candidate(300, 2.0, 1.0, 10.0), candidate(302, 1.9, 1.0, 10.0)];
        let frequency = |selection: &Selection| selection.drives[1].0.frequency;
        assert_eq!(frequency(&search(&[left.clone(), right.clone()], &[1.0]).unwrap()), 302);
        assert_eq!(frequency(&search(&[left, right[..1].to_vec()], &[1.0]).unwrap()), 300, "without a choice");
    }

    #[test]
    fn far_beyond_reach_still_takes_the_strongest() {
        let only = vec![candidate(100, 10.0, 0.1, 0.01), candidate(150, 1.0, 10.0, 1.0)];
        assert_eq!(search(&[only], &[1e12]).unwrap().drives[0].0.frequency, 150);
    }

    #[test]
    fn no_combination_is_none() {
        assert!(search(&[vec![candidate(100, 1.0, 1.0, 1.0)], vec![candidate(110, 1.0, 1.0, 1.0)]], &[1.0]).is_none());
    }
}
