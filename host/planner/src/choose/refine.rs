//! From the best combination on the grid to drives, with frequencies between the grid's where that is better.

use crate::MIN_SPACING_HZ;
use crate::choose::allocate::Allocation;
use crate::choose::candidates::Formulation;
use crate::choose::search::{BestCombination, CandidateSet};
use crate::chosen_drive::{ChosenDrive, is_one_near_3rd_5th_or_7th_harmonic_of_other};
use crate::scene::MAX_ACTUATORS;
use crate::table::{PlanTable, PulseOption};

/// Least relative gain that a frequency off the grid must bring.
const LEAST_GAIN: f64 = 1e-3;
/// Part of that which it must gain by the parabola to be looked at: a parabola through the flank of a resonance may be half off.
const LIKELY: f64 = 0.5;

/// The selected drives of all actuators.
#[derive(Clone, Debug)]
pub struct Selection {
    /// One per actuator.
    pub drives: Vec<ChosenDrive>,
    /// How their forces came about.
    pub allocation: Allocation,
    /// Shared limits that bind, by their numbers.
    pub active: Vec<usize>,
    /// By which part a better combination on the grid might exist; 0 where none does.
    pub gap: f64,
}

/// The drives of the combination `best` among `choices`, moved to frequencies between those of the grid if that is
/// better.
pub(crate) fn refine_frequencies_between_grid(
    table: &PlanTable,
    formulation: &Formulation<'_>,
    choices: &CandidateSet,
    best: &BestCombination,
) -> Selection {
    let p = choices.candidates.len();
    let mut drives: Vec<ChosenDrive> = (0..p)
        .map(|i| {
            let tag = choices.candidates[i][best.chosen[i]].tag;
            let (k, w) = (tag / 2, tag % 2);
            let row = table.entries_of_all_actuators_at_index(k);
            let width = row.get(i).map_or_else(PulseOption::default, |entry| entry.widths[w]);
            ChosenDrive {
                frequency_hz: table.frequencies_hz[k],
                on_grid: Some(k),
                row,
                width,
                force_n: 0.0,
                force_phase_rad: 0.0,
            }
        })
        .collect();
    let mut allocation = best.allocation.clone();
    let mut own = formulation.build_candidate_set_without_candidates(&choices.wanted);
    let hz: Vec<f64> = drives.iter().map(|drive| drive.frequency_hz).collect();
    // To first order the whole gains what its parts earn more at the dual variables that they have.
    let worth = LIKELY * LEAST_GAIN * if allocation.met >= 1.0 { allocation.cost } else { allocation.met };
    let better: Vec<_> = (0..p)
        .map(|i| find_better_frequency_hz_and_lagrangian_gain(table, formulation, choices, best, i, &hz))
        .collect();
    let mut moved = Vec::new();
    if better.iter().flatten().map(|(_, gain)| gain).sum::<f64>() >= worth {
        for (i, (hz, _)) in better.into_iter().enumerate().filter_map(|(i, better)| Some((i, better?))) {
            if let Ok(row) = table.compute_all_entries_at_hz_with_driven_limits_only(hz, i) {
                moved.push((i, hz, row));
            }
        }
    }
    if !moved.is_empty() {
        // All of them, and what they give together.
        let mut trial = drives.clone();
        for (i, hz, row) in moved {
            let w = choices.candidates[i][best.chosen[i]].tag % 2;
            let width = row.get(i).map_or_else(PulseOption::default, |entry| entry.widths[w]);
            trial[i] = ChosenDrive { frequency_hz: hz, on_grid: None, row, width, ..trial[i].clone() };
        }
        own.frequencies_hz = trial.iter().map(|drive| drive.frequency_hz).collect();
        let mut at = [0; MAX_ACTUATORS];
        for (i, drive) in trial.iter().enumerate() {
            if let Some(entry) = drive.row.get(i) {
                formulation.add_candidates_of_quiet_and_if_useful_widest_pulse(
                    &mut own,
                    i,
                    i,
                    0,
                    entry,
                    drive.frequency_hz,
                );
                let w = choices.candidates[i][best.chosen[i]].tag % 2;
                at[i] = own.candidates[i].iter().position(|c| c.tag % 2 == w).unwrap_or(0);
            }
        }
        let fits =
            |a: f64, b: f64| (a - b).abs() >= MIN_SPACING_HZ && !is_one_near_3rd_5th_or_7th_harmonic_of_other(a, b);
        let keeps = (0..p).all(|i| (0..i).all(|j| fits(own.frequencies_hz[i], own.frequencies_hz[j])));
        let refined = own.allocate_combination(&at);
        let is_better = refined.met > allocation.met * (1.0 + LEAST_GAIN)
            || refined.met >= allocation.met && refined.cost < allocation.cost * (1.0 - LEAST_GAIN);
        if keeps && is_better {
            drives = trial;
            allocation = refined;
        }
    }
    for (drive, force_n) in drives.iter_mut().zip(allocation.forces_n) {
        drive.force_n = force_n;
    }
    let active = allocation.duals.load.iter().enumerate().filter(|(_, dual)| **dual > 0.0).map(|(row, _)| row);
    Selection { active: active.collect(), drives, allocation, gap: best.gap }
}

/// The vertex in Hz of the parabola through an actuator's Lagrangian terms at its frequency and the two neighbours,
/// at the dual variables of the best combination, and the gain over the grid's frequency. `None` if the vertex is at
/// the grid's frequency, or closer than the spacing to another drive.
fn find_better_frequency_hz_and_lagrangian_gain(
    table: &PlanTable,
    formulation: &Formulation<'_>,
    choices: &CandidateSet,
    best: &BestCombination,
    actuator: usize,
    chosen_hz: &[f64],
) -> Option<(f64, f64)> {
    let tag = choices.candidates[actuator][best.chosen[actuator]].tag;
    let (k, w) = (tag / 2, tag % 2);
    let own = *table.frequencies_hz.get(k)?;
    let earned = |k: usize| -> Option<f64> {
        let mut one = formulation.build_candidate_set_without_candidates(&choices.wanted);
        one.frequencies_hz.push(own);
        formulation.add_candidates_of_quiet_and_if_useful_widest_pulse(
            &mut one,
            actuator,
            0,
            k,
            table.entry(actuator, k)?,
            *table.frequencies_hz.get(k)?,
        );
        let index = w.min(one.candidates[actuator].len() - 1);
        Some(one.lagrangian_term_at_duals_of(actuator, index, &best.allocation))
    };
    let (low, middle, high) = (earned(k.checked_sub(1)?)?, earned(k)?, earned(k + 1)?);
    let (below, above) = (own - table.frequencies_hz[k - 1], table.frequencies_hz[k + 1] - own);
    // Slopes towards the neighbours; the vertex lies where their mean line crosses zero.
    let (left, right) = ((middle - low) / below, (high - middle) / above);
    let curvature = 2.0 * (right - left) / (below + above);
    if curvature >= 0.0 || !curvature.is_finite() {
        return None;
    }
    let slope = (left * above + right * below) / (below + above);
    let step = (-slope / curvature).clamp(-below, above);
    let free =
        chosen_hz.iter().enumerate().all(|(j, other)| j == actuator || (own + step - other).abs() >= MIN_SPACING_HZ);
    let gain = (slope + 0.5 * curvature * step) * step;
    (free && step.abs() > 1e-3 * (below + above)).then_some((own + step, gain))
}
