//! What harmonics do at a place, and how wrong that may be.
//!
//! The mesh was chosen for the drives' band, and harmonics lie above it: their resonances are off by more than the plan's own bound says.
//! They have a bound of their own, from the same drives on the coarser levels, and where that is not enough levels of their own.

use super::harmonics::compute_harmonics_on_model;
use crate::chosen_drive::ChosenDrive;
use crate::model::estimator::ErrorEstimator;
use crate::model::levels::ReducedLevels;
use crate::model::{Accuracy, Bound, ReducedModel};
use crate::motion::driven_panel::SettledMotion;
use crate::motion::harmonics::compute_drive_harmonics_on_finest_model;
use crate::perception::felt_threshold_m_per_s2;
use crate::table::{NO_LEVELS, PlanTable, UNBOUNDED};
use num_complex::Complex64;

/// Why nothing is known of what is not there.
const UNMOVED: &str = "no harmonic moves this point";
/// A bound with which the table's own levels do: harmonics are told in whole per cent.
const ENOUGH: f64 = 2e-2;
/// Harmonics of a smaller part of the fundamentals' peak are what rounding leaves of those that the windows drop.
const NOTHING: f64 = 1e-9;
/// Of levels for the harmonics, until one meets that.
const OWN: [Accuracy; 2] = [Accuracy::FAST, Accuracy::BALANCED];

/// Harmonics at a place, with bounds on their relative errors.
#[derive(Clone, Copy, Debug)]
pub struct HarmonicsAt {
    /// Sum of the peaks in m/s^2, drive by drive.
    pub sum_m_per_s2: f64,
    /// Of that.
    pub sum_bound: Bound,
    /// Largest of the peaks over the threshold of feeling, drives at one frequency together.
    pub strongest: f64,
    /// Of that.
    pub strongest_bound: Bound,
}

impl HarmonicsAt {
    /// The worse of the two; infinite where there is none.
    fn largest_error_bound_or_infinity(&self) -> f64 {
        let value = |bound: Bound| bound.limit_if_known().unwrap_or(f64::INFINITY);
        value(self.sum_bound).max(value(self.strongest_bound))
    }
}

/// What the harmonics of drives that have been made safe do at a place in m, where the fundamentals' peak is
/// `fundamental_peak_for_negligibility_m_per_s2`.
pub(crate) fn compute_harmonics_at_place_refining_model_until_accurate(
    table: &PlanTable,
    drives: &[ChosenDrive],
    settled: &SettledMotion,
    place_m: (f64, f64),
    fundamental_peak_for_negligibility_m_per_s2: f64,
) -> HarmonicsAt {
    let coarser = table.coarser.as_ref().map(|(models, estimator)| (models, estimator));
    let mut best =
        compute_harmonic_sum_and_most_felt_one_with_bounds_at_place(&table.model, coarser, drives, settled, place_m);
    if coarser.is_none() {
        return best;
    }
    if best.sum_m_per_s2 <= NOTHING * fundamental_peak_for_negligibility_m_per_s2 {
        (best.sum_bound, best.strongest_bound) = (Bound::Unknown(UNMOVED), Bound::Unknown(UNMOVED));
        return best;
    }
    let highest_hz = compute_drive_harmonics_on_finest_model(table, drives, settled).highest_harmonic_or_0_hz();
    // A reduced model for them has more modes; there is none where the panel is too large for that.
    for accuracy in OWN {
        if best.largest_error_bound_or_infinity() <= ENOUGH {
            break;
        }
        let Ok(own) = ReducedLevels::build(&table.scene, accuracy, highest_hz) else { break };
        let found = compute_harmonic_sum_and_most_felt_one_with_bounds_at_place(
            &own.fine,
            Some((&own.coarser, &own.estimator)),
            drives,
            settled,
            place_m,
        );
        if found.largest_error_bound_or_infinity() < best.largest_error_bound_or_infinity() {
            best = found;
        }
    }
    best
}

fn compute_harmonic_sum_and_most_felt_one_with_bounds_at_place(
    fine: &ReducedModel,
    coarser: Option<(&[ReducedModel; 2], &ErrorEstimator)>,
    drives: &[ChosenDrive],
    settled: &SettledMotion,
    (x_m, y_m): (f64, f64),
) -> HarmonicsAt {
    // For each drive's harmonic, and for each frequency.
    let of = |model: &ReducedModel| {
        let (own, shape) = (compute_harmonics_on_model(model, drives, settled), model.shape_deflections_at(x_m, y_m));
        (own.harmonic_hz_and_phasors_at_point(&shape), own.hz_and_phasors_summed_by_frequency_at_point(&shape))
    };
    let (each, together) = of(fine);
    let felt = |(hz, phasor): (f64, Complex64)| phasor.norm() / felt_threshold_m_per_s2(hz);
    let sum_m_per_s2: f64 = each.iter().map(|(_, phasor)| phasor.norm()).sum();
    let strongest = together.iter().map(|line| felt(*line)).fold(0.0, f64::max);
    let answer = |sum_bound, strongest_bound| HarmonicsAt { sum_m_per_s2, sum_bound, strongest, strongest_bound };
    let unknown = |reason| answer(Bound::Unknown(reason), Bound::Unknown(reason));
    let Some((coarser, estimator)) = coarser else { return unknown(NO_LEVELS) };
    if sum_m_per_s2 <= 0.0 || strongest <= 0.0 {
        return unknown(UNMOVED);
    }
    let [middle, coarse] = coarser.each_ref().map(of);
    // One that meets an undamped resonance on one model alone is left out there.
    if [&middle, &coarse].iter().any(|(other, _)| other.len() != each.len()) {
        return unknown(UNBOUNDED);
    }
    let apart = |a: &[(f64, Complex64)], b: &[(f64, Complex64)]| {
        a.iter().zip(b).map(|((_, a), (_, b))| (a - b).norm()).sum::<f64>() / sum_m_per_s2
    };
    let lines_apart = |a: &[(f64, Complex64)], b: &[(f64, Complex64)]| {
        a.iter().zip(b).map(|((hz, a), (_, b))| felt((*hz, a - b))).fold(0.0, f64::max) / strongest
    };
    answer(
        estimator.response_error_bound_from_relative_differences(apart(&coarse.0, &middle.0), apart(&middle.0, &each)),
        estimator.response_error_bound_from_relative_differences(
            lines_apart(&coarse.1, &middle.1),
            lines_apart(&middle.1, &together),
        ),
    )
}
