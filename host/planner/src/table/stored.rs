//! What of a table is kept on disk, as plain numbers, and the table again.
//!
//! Whoever can write to the file can write anything into it, with a right hash. So nothing is kept that a drive's limits follow from, nor what a drive does: the
//! panel's model and every actuator's motion, force, voltage and travel at every frequency are computed from the scene at every start. Kept are the coarser models and their responses,
//! which tell how wrong a plan may be, and the figures that take a look at every point of the surface: they say which frequencies the planner
//! looks at, and how large errors may be, and take most of the time. Beyond sizes and finite numbers, samples of every part are computed again and compared.

use super::build::{
    acceleration_coordinates_per_newton_of_each_actuator_by_frequency,
    compute_table_without_surface_mean_max_and_slope, mean_magnitude_and_bounds_of_square_and_slope,
};
use super::{Entry, PlanTable, TableOptions};
use crate::model::bounded::RefinementLevel;
use crate::model::levels::ReducedLevels;
use crate::model::stored::{
    ImplausibleStore, StoredLevels, check_stored_size, complex_to_pairs, restore_complex_vector,
};
use crate::model::{Accuracy, ReducedModel};
use crate::scene::Scene;
use nalgebra::DVector;
use num_complex::Complex64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Relative difference of a number that is computed again from the one kept. They are the same on the same machine; another's vector
/// instructions round differently, and near resonance a response has a hundred times what its parts have.
const SAME_NUMBER: f64 = 1e-9;
/// The same of figures over the surface, which are summed in single precision.
const SAME_IN_SINGLE: f64 = 1e-4;
/// What the mean (trapezoidal rule on the grid of pictures) or the largest value (at its points) may be off by against the mean
/// square, which is by Gauss' rule: a border of a cut-out may be half a cell, a twenty-fourth of a wave, from the grid's lines.
const OTHER_POINTS: f64 = 1.1;
/// Parts of the list of frequencies at which samples are taken.
const SAMPLES: [f64; 3] = [0.15, 0.5, 0.85];

/// Accelerations of all actuators at a frequency, as pairs; `None` where they are unbounded.
type StoredRow = Option<Vec<Vec<[f64; 2]>>>;

/// Of an entry, `mean`, `most_square` and `steepest`.
type StoredFigures = [f64; 3];

/// Gives an entry the figures that were kept; `rounding_level` is the acceleration in (m/s^2)/N up to which they are rounding.
fn restore_surface_mean_max_and_slope_of_entry(
    entry: &mut Entry,
    kept: StoredFigures,
    rounding_level: f64,
) -> Result<(), ImplausibleStore> {
    if !kept.iter().all(|figure| figure.is_finite() && *figure >= 0.0) {
        return Err(ImplausibleStore::NotFinite("the values over the surface"));
    }
    [entry.mean, entry.most_square, entry.steepest] = kept;
    // No mean is above the root of the mean square, and no mean square above the largest: but for the points that they are taken at.
    let is_above = |low: f64, high: f64| low > OTHER_POINTS * high;
    let is_motion = entry.most_square.sqrt() > rounding_level;
    if is_motion && (is_above(entry.mean.powi(2), entry.mean_square) || is_above(entry.mean_square, entry.most_square))
    {
        return Err(ImplausibleStore::Differs("the values over the surface"));
    }
    Ok(())
}

/// What is kept of a [`PlanTable`] made by [`PlanTable::from_levels`], and the steps of its levels.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StoredTable {
    levels: StoredLevels,
    figures: Vec<Vec<Option<StoredFigures>>>,
    coarser_rows: [Vec<StoredRow>; 2],
}

impl StoredTable {
    /// Of a table with coarser levels, whose steps are given; `None` of one without.
    #[must_use]
    pub fn new(table: &PlanTable, steps: &[RefinementLevel]) -> Option<Self> {
        let (coarser, _) = table.coarser.as_ref()?;
        let figures = |entry: &Option<Entry>| entry.as_ref().map(|own| [own.mean, own.most_square, own.steepest]);
        let row =
            |row: &Option<Vec<DVector<Complex64>>>| row.as_ref().map(|row| row.iter().map(complex_to_pairs).collect());
        Some(Self {
            levels: StoredLevels::new(coarser, steps),
            figures: table.entries.iter().map(|list| list.iter().map(figures).collect()).collect(),
            coarser_rows: table.coarser_rows.each_ref().map(|rows| rows.iter().map(row).collect()),
        })
    }

    /// The table again, and the steps.
    ///
    /// # Errors
    /// [`ImplausibleStore`], if it cannot be that of this scene with these options.
    pub fn recompute_table_and_fill_in_stored_parts_if_plausible(
        self,
        scene: &Scene,
        accuracy: Accuracy,
        options: TableOptions,
    ) -> Result<(PlanTable, Vec<RefinementLevel>), ImplausibleStore> {
        let ReducedLevels { fine, coarser, estimator, steps } =
            self.levels.restore_coarser_and_build_finest_levels(scene, accuracy, options.to_hz)?;
        let mut computed = compute_table_without_surface_mean_max_and_slope(scene, fine, options, None)
            .map_err(|_| ImplausibleStore::Differs("model"))?;
        check_stored_size("actuators", self.figures.len(), computed.entries.len())?;
        let nothing = HARDLY_MOVING / scene.surface_mass_with_air_kg();
        for (list, kept) in computed.entries.iter_mut().zip(self.figures) {
            check_stored_size("frequencies", kept.len(), list.len())?;
            for (entry, kept) in list.iter_mut().zip(kept) {
                match (entry, kept) {
                    (Some(entry), Some(kept)) => restore_surface_mean_max_and_slope_of_entry(entry, kept, nothing)?,
                    (None, None) => {}
                    _ => return Err(ImplausibleStore::Differs("the frequencies without a response")),
                }
            }
        }
        let mut table = PlanTable::from_computed(scene, computed);
        let [middle, coarse] = self.coarser_rows;
        table.coarser_rows = [
            restore_coarser_level_accelerations_none_where_unbounded(middle, &coarser[0], table.frequencies_hz.len())?,
            restore_coarser_level_accelerations_none_where_unbounded(coarse, &coarser[1], table.frequencies_hz.len())?,
        ];
        table.coarser = Some((coarser, estimator));
        recompute_and_compare_samples(&table)?;
        Ok((table, steps))
    }
}

fn restore_coarser_level_accelerations_none_where_unbounded(
    stored: Vec<StoredRow>,
    model: &ReducedModel,
    frequencies: usize,
) -> Result<Vec<Option<Vec<DVector<Complex64>>>>, ImplausibleStore> {
    const WHAT: &str = "the responses of a coarser model";
    check_stored_size(WHAT, stored.len(), frequencies)?;
    let row = |row: Vec<Vec<[f64; 2]>>| {
        check_stored_size(WHAT, row.len(), model.count_actuators())?;
        row.iter().map(|values| restore_complex_vector(WHAT, values, model.count_coordinates())).collect()
    };
    stored.into_par_iter().map(|stored| stored.map(row).transpose()).collect()
}

/// Acceleration, relative to that of the surface under the same force, which is as good as none.
const HARDLY_MOVING: f64 = 1e-6;

/// Whether the stored figures of an entry agree with figures that are computed again from its acceleration.
fn are_surface_mean_max_and_slope_as_recomputed(table: &PlanTable, kept: &Entry) -> bool {
    let recomputed = mean_magnitude_and_bounds_of_square_and_slope(
        table.grid.evaluate_at_each_grid_point(&kept.acceleration).into_iter(),
        &table.grid,
    );
    // The steepest slope is a difference of neighbours in single precision: of what rounding makes of the largest value.
    let [mean, most_square, steepest] = recomputed;
    let (dx, dy) = table.grid.column_and_row_spacing_or_infinity_m();
    // Of a force on an edge that does not move there is only rounding, whose figures are not the same twice.
    let nothing = HARDLY_MOVING / table.scene.surface_mass_with_air_kg();
    if most_square.max(kept.most_square).sqrt() <= nothing {
        return true;
    }
    let slope = most_square.sqrt() / dx.min(dy);
    is_nearly_equal(mean, kept.mean, SAME_IN_SINGLE)
        && is_nearly_equal(most_square, kept.most_square, SAME_IN_SINGLE)
        && (steepest - kept.steepest).abs() <= SAME_IN_SINGLE * slope
}

/// Computes samples again and compares them: figures over the surface, and responses of the coarser levels.
fn recompute_and_compare_samples(table: &PlanTable) -> Result<(), ImplausibleStore> {
    for k in indices_of_few_spread_samples(table.frequencies_hz.len()) {
        if !table
            .entries
            .iter()
            .filter_map(|list| list[k].as_ref())
            .all(|kept| are_surface_mean_max_and_slope_as_recomputed(table, kept))
        {
            return Err(ImplausibleStore::Differs("the values over the surface"));
        }
        let hz = table.frequencies_hz[k];
        for (model, kept) in table.coarser.iter().flat_map(|(models, _)| models).zip(&table.coarser_rows) {
            let is_same = match (
                acceleration_coordinates_per_newton_of_each_actuator_by_frequency(model, &[hz]).pop().flatten(),
                &kept[k],
            ) {
                (Some(recomputed), Some(kept)) => {
                    recomputed.iter().zip(kept).all(|(recomputed, kept)| is_nearly_equal_row(recomputed, kept))
                }
                (recomputed, kept) => recomputed.is_none() && kept.is_none(),
            };
            if !is_same {
                return Err(ImplausibleStore::Differs("the responses of a coarser model"));
            }
        }
    }
    Ok(())
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "parts of a length"
)]
fn indices_of_few_spread_samples(length: usize) -> impl Iterator<Item = usize> {
    SAMPLES.into_iter().map(move |part| (part * length as f64) as usize).filter(move |at| *at < length)
}

fn is_nearly_equal(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * a.abs().max(b.abs())
}

fn is_nearly_equal_row(a: &DVector<Complex64>, b: &DVector<Complex64>) -> bool {
    a.len() == b.len() && (a - b).norm() <= SAME_NUMBER * a.norm()
}
