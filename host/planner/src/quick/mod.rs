//! The weakest place of many designs of one panel, each in some milliseconds: for studies, whose few best designs are looked at
//! thoroughly afterwards.
//!
//! What a thorough look at a design ([`crate::maps::ReachMaps`]) spends its time on is left out where the weakest place does not depend on it:
//!
//! - The panel is solved once; supports, masses and ERAs are coupled to it ([`BarePanel`]).
//! - Frequencies lie close together only where a resonance is (`frequencies`).
//! - Points are on every second of the grid's lines, and on all of them around the weakest (`points`).
//! - With a finger each point is a panel of its own, with the finger on it; all are looked at roughly, and those that may be the weakest thoroughly.
//! - At a point the best frequencies without the limits that actuators share are found first. Where these limits leave them alone, that is the
//!   optimum; elsewhere it is a bound from above, and the same drives within the limits are one from below. The exact search looks at those
//!   points alone whose lower bound leaves them in question (`weakest`).
//!
//! Fewer points make what is told larger than what a thorough look finds, fewer frequencies mostly smaller: where masses move far, what is found with
//! others may be left less of. By how much is measured by `cargo xtask bench study`.

mod frequencies;
mod points;
#[cfg(test)]
mod tests;
mod weakest;

pub use weakest::WeakestPlace;

use crate::reach::Measure;
use crate::table::PlanTable;
use crate::table::touched::{TouchedError, TouchedPanel};
use crate::{PlanError, TableOptions};
use era_model::model::{Accuracy, BarePanel, ModelError};
use era_model::response::ResponseError;
use era_model::scene::{MAX_ACTUATORS, Scene};
use points::build_coarse_grid_for_first_search;

/// Why a design has no weakest place.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum QuickError {
    /// The design is not one of this panel, or cannot be computed with.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// It has no response.
    #[error(transparent)]
    Response(#[from] ResponseError),
    /// It cannot be driven.
    #[error(transparent)]
    Plan(#[from] PlanError),
}

impl From<TouchedError> for QuickError {
    fn from(error: TouchedError) -> Self {
        match error {
            TouchedError::Model(error) => error.into(),
            TouchedError::Response(error) => error.into(),
        }
    }
}

/// A panel of which many designs are looked at: all that share its surface, patches, cut-outs and edges.
#[derive(Debug)]
pub struct QuickPanel {
    panel: BarePanel,
    options: TableOptions,
}

impl QuickPanel {
    /// The panel of a scene, whatever is attached to it, driven at frequencies of the grid `options`.
    ///
    /// # Errors
    /// As [`BarePanel::build`].
    pub fn new(scene: &Scene, options: TableOptions) -> Result<Self, ModelError> {
        Ok(Self { panel: BarePanel::build(scene, Accuracy::FAST, options.to_hz)?, options })
    }

    /// The panel itself, for whoever wants more of a design than its weakest place.
    #[must_use]
    pub const fn bare_panel(&self) -> &BarePanel {
        &self.panel
    }

    /// Unknowns of the panel's mesh.
    #[must_use]
    pub fn count_unknowns(&self) -> usize {
        self.panel.count_unknowns()
    }

    /// The weakest place of a design of this panel: where the strongest drive, chosen for that place, is the weakest. With a finger in the scene
    /// it is on the place that is looked at, each time.
    ///
    /// # Errors
    /// [`QuickError`], also where the design is one of another panel.
    pub fn find_place_of_least_achievable_peak(
        &self,
        scene: &Scene,
        measure: Measure,
    ) -> Result<WeakestPlace, QuickError> {
        match scene.actuators.len() {
            0 => return Err(PlanError::NoActuators.into()),
            count if count > MAX_ACTUATORS => return Err(PlanError::Actuators { count }.into()),
            _ => {}
        }
        let table = self.build_strongest_drive_table_on_coarse_grid(scene)?;
        match scene.finger {
            None => weakest::find_place_of_least_achievable_peak_of_table(&table, measure, self.options.to_hz),
            Some(_) => self.find_place_of_least_achievable_peak_under_finger(scene, &table, measure, weakest::ROUGHLY),
        }
    }

    fn build_strongest_drive_table_on_coarse_grid(&self, scene: &Scene) -> Result<PlanTable, QuickError> {
        let model = self.panel.couple_to_design(scene)?;
        let hz = frequencies::choose_frequencies_denser_near_modes_hz(&model, self.options);
        let grid = build_coarse_grid_for_first_search(scene, &model, self.options.to_hz);
        Ok(PlanTable::build_for_strongest_drives_only(scene, model, hz, grid)?)
    }

    fn find_place_of_least_achievable_peak_under_finger(
        &self,
        scene: &Scene,
        table: &PlanTable,
        measure: Measure,
        slack: f64,
    ) -> Result<WeakestPlace, QuickError> {
        weakest::find_place_of_least_achievable_peak_under_finger(
            TouchedPanel::new(&self.panel, scene, table),
            table,
            measure,
            self.options,
            slack,
        )
    }
}
