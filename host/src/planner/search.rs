//! The choice of frequencies.

use super::MIN_SPACING_HZ;
use super::allocate::{Choice, allocate};
use super::limits::Limit;

/// Candidates kept per actuator where all combinations would be too many (three and more actuators, or several
/// targets). Taken half by energy elsewhere and half by reach, so that neither is lost.
const SHORTLIST: usize = 28;

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
/// Exhaustive over the grid for one and two actuators and one target, over a shortlist otherwise.
#[must_use]
pub fn search(candidates: &[Vec<Candidate>], wanted: &[f64]) -> Option<Selection> {
    let exhaustive = candidates.len() <= 2 && wanted.len() == 1;
    let lists: Vec<Vec<&Candidate>> = candidates
        .iter()
        .map(|list| if exhaustive { list.iter().collect() } else { shortlist(list, wanted) })
        .collect();
    let mut best: Option<Best<'_>> = None;
    let mut chosen = Vec::with_capacity(lists.len());
    descend(&lists, wanted, &mut chosen, &mut best);
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
        const SAME: f64 = 1e-9;
        met > self.met + SAME || met > self.met - SAME && energy < self.energy
    }
}

fn descend<'a>(
    lists: &[Vec<&'a Candidate>],
    wanted: &[f64],
    chosen: &mut Vec<&'a Candidate>,
    best: &mut Option<Best<'a>>,
) {
    let Some(list) = lists.get(chosen.len()) else {
        judge(chosen, wanted, best);
        return;
    };
    for candidate in list {
        let spaced = |other: &&Candidate| (other.frequency_hz - candidate.frequency_hz).abs() >= MIN_SPACING_HZ - 1e-9;
        if chosen.iter().all(spaced) {
            chosen.push(candidate);
            descend(lists, wanted, chosen, best);
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

/// The most promising candidates by efficiency (gain^2 over energy) and by reach (gain times most force).
fn shortlist<'a>(list: &'a [Candidate], wanted: &[f64]) -> Vec<&'a Candidate> {
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
    let mut kept: Vec<&Candidate> = Vec::new();
    let halves: [(Score<'_>, usize); 2] = [(&efficiency, SHORTLIST / 2), (&reach, SHORTLIST)];
    for (by, until) in halves {
        let mut sorted: Vec<&Candidate> = list.iter().collect();
        sorted.sort_by(|a, b| score(by, b).total_cmp(&score(by, a)));
        for candidate in sorted {
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
    fn no_combination_is_none() {
        assert!(search(&[vec![candidate(100, 1.0, 1.0, 1.0)], vec![candidate(110, 1.0, 1.0, 1.0)]], &[1.0]).is_none());
    }
}
