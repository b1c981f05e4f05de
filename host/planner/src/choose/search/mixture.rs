//! The dual variables at which a part of all combinations has its least bound: those of the best mixture of combinations.
//!
//! If every actuator could share its time between frequencies, each at the force it likes, with what they do to targets and limits
//! added up by their shares, the best mixture would be exactly as good as the least bound (strong duality of the convex
//! hull; Geoffrion 1974). Over the columns met so far, a frequency and a force each, that is a small linear programme, whose
//! dual variables bring new columns (Dantzig and Wolfe 1960).

use super::{CandidateSet, SearchGoal};
use crate::choose::allocate::DualVariables;
use crate::choose::linear::Programme;

/// Shares below this are rounding.
const NO_SHARE: f64 = 1e-9;
/// Relative difference of forces that are the same column.
const SAME_FORCE: f64 = 1e-6;

/// An actuator at a frequency with a force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Column {
    pub actuator: usize,
    pub candidate: usize,
    pub force_n: f64,
    /// Its share in the last mixture.
    pub share: f64,
}

/// The best mixture.
#[derive(Clone, Debug)]
pub struct Mixture {
    /// What it is worth: what it reaches, or minus what it costs.
    pub worth: f64,
    /// Its dual variables.
    pub duals: DualVariables,
    /// Part of the wishes that it meets. Where that is less than all, the dual variables of a mixture for the least cost are those
    /// of its reach.
    pub met: f64,
}

/// Adds a column; returns whether it is new.
pub fn add_column_and_is_new(columns: &mut Vec<Column>, actuator: usize, candidate: usize, force_n: f64) -> bool {
    let is_known = |column: &Column| {
        column.actuator == actuator
            && column.candidate == candidate
            && (column.force_n - force_n).abs() <= SAME_FORCE * force_n.max(column.force_n)
    };
    if force_n <= 0.0 || columns.iter().any(is_known) {
        return false;
    }
    columns.push(Column { actuator, candidate, force_n, share: 0.0 });
    true
}

/// The best mixture of `columns`, whose shares it sets; `None` if nothing reaches any target.
pub fn set_best_mixture_shares_if_anything_reached(
    choices: &CandidateSet,
    columns: &mut [Column],
    goal: SearchGoal,
) -> Option<Mixture> {
    let (n, targets, limits) = (columns.len(), choices.wanted.len(), choices.allowed.len());
    let gain =
        |column: &Column, t: usize| choices.gains[column.actuator][column.candidate * targets + t] * column.force_n;
    let load =
        |column: &Column, c: usize| choices.loads[column.actuator][column.candidate * limits + c] * column.force_n;
    // Variables: the columns' shares, and s; rows of the size of one.
    let mut programme = Programme::new(n + 1);
    let mut scales: Vec<(usize, f64)> = Vec::new();
    for (c, allowed) in choices.allowed.iter().enumerate() {
        let entries = columns.iter().map(|column| load(column, c));
        let mut most = [0.0_f64; crate::scene::MAX_ACTUATORS];
        for (column, entry) in columns.iter().zip(entries.clone()) {
            most[column.actuator] = most[column.actuator].max(entry);
        }
        // What these columns cannot use up has dual variables of 0.
        if most.iter().sum::<f64>() > *allowed {
            let scale = most.iter().copied().fold(*allowed, f64::max);
            programme.add_row(entries.map(|entry| entry / scale), allowed / scale);
            scales.push((targets + c, scale));
        }
    }
    for (t, wanted) in choices.wanted.iter().enumerate() {
        let entries = columns.iter().map(|column| gain(column, t));
        let scale = entries.clone().fold(*wanted, f64::max).max(f64::MIN_POSITIVE);
        programme.add_row(entries.map(|entry| -entry / scale).chain([wanted / scale]), 0.0);
        scales.push((t, scale));
    }
    for actuator in 0..choices.candidates.len() {
        programme.add_row(columns.iter().map(|column| f64::from(u8::from(column.actuator == actuator))), 1.0);
    }
    if goal == SearchGoal::Cost {
        programme.add_row((0..=n).map(|j| f64::from(u8::from(j == n))), 1.0);
    }
    let first: Vec<f64> = (0..=n).map(|j| f64::from(u8::from(j == n))).collect();
    let costs = columns.iter().map(|column| {
        let candidate = &choices.candidates[column.actuator][column.candidate];
        (candidate.energy * column.force_n + candidate.power) * column.force_n
    });
    let costs: Vec<f64> = if goal == SearchGoal::Cost { costs.collect() } else { vec![0.0; n] };
    let unit = costs.iter().copied().fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let second: Vec<f64> = costs.iter().map(|cost| -cost / unit).collect();
    let vertex = programme.maximise_first_then_second_objective_if_bounded(&first, &second)?;
    for (column, share) in columns.iter_mut().zip(&vertex.x) {
        column.share = if *share > NO_SHARE { *share } else { 0.0 };
    }
    let met = vertex.x.last().copied().unwrap_or(0.0);
    let is_met = goal == SearchGoal::Cost && met >= 1.0 - NO_SHARE;
    let mut duals = DualVariables { gain: vec![0.0; targets], load: vec![0.0; limits] };
    let of = if is_met { &vertex.second } else { &vertex.first };
    for (dual, (row, scale)) in of.iter().zip(&scales) {
        let dual = if is_met { dual * unit / scale } else { dual / scale };
        match duals.gain.get_mut(*row) {
            Some(gain) => *gain = dual,
            None => duals.load[row - targets] = dual,
        }
    }
    if !is_met {
        // All that is asked for costs one.
        let sum: f64 = duals.gain.iter().zip(&choices.wanted).map(|(dual, wanted)| dual * wanted).sum();
        if sum <= 0.0 {
            return None;
        }
        duals.gain.iter_mut().chain(&mut duals.load).for_each(|dual| *dual /= sum);
    }
    let cost: f64 = columns.iter().zip(&costs).map(|(column, cost)| column.share * cost).sum();
    Some(Mixture { worth: if goal == SearchGoal::Cost { -cost } else { met }, duals, met })
}
