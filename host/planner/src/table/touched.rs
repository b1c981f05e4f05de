//! Tables of a panel with its scene's finger on one place after the other: what that place does while it is touched.
//!
//! A finger is a spring, a dashpot and a mass at its place, so that each place is a design of the bare panel ([`BarePanel`]): the place's shapes are in
//! that design's basis, and with them what a sum of modes misses where a force is, which is a part in a hundred of the receptance there.

use super::build::{self, TablePurpose};
use super::{PlanTable, SurfaceGrid, TableOptions};
use crate::model::levels::ReducedLevels;
use crate::model::{Accuracy, ReducedModel};
use crate::response::ResponseError;
use crate::stop::StopRequest;
use era_model::model::{BarePanel, ModelError};
use era_model::scene::Scene;
use rayon::prelude::*;

/// Why there is no table of a place that is touched.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum TouchedError {
    /// The scene is not a design of the panel, or cannot be computed with.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// There is no response.
    #[error(transparent)]
    Response(#[from] ResponseError),
}

/// A panel with the scene's finger at one place at a time. The press effects are those without the finger, because a
/// finger that is part of the panel does not hold it against another press.
#[derive(Clone, Copy, Debug)]
pub struct TouchedPanel<'a> {
    panel: &'a BarePanel,
    scene: &'a Scene,
    untouched: &'a PlanTable,
}

impl<'a> TouchedPanel<'a> {
    /// The design `scene` of a panel, `untouched` its table without a finger.
    #[must_use]
    pub fn new(panel: &'a BarePanel, scene: &'a Scene, untouched: &'a PlanTable) -> Self {
        Self { panel, scene, untouched }
    }

    /// Builds for each place (in m) a table of that place alone, with the finger on it, for the strongest drives at
    /// the frequencies that `frequencies_hz` chooses for the model, and returns what `ask` finds in each table.
    ///
    /// # Errors
    /// [`TouchedError`] of the first place that has one.
    pub fn evaluate_with_finger_on_each_place<T: Send>(
        &self,
        places_m: &[(f64, f64)],
        frequencies_hz: impl Fn(&ReducedModel) -> Vec<f64> + Sync,
        ask: impl Fn(&PlanTable) -> T + Sync,
    ) -> Result<Vec<T>, TouchedError> {
        self.build_table_and_ask_with_finger_on_each_place(
            places_m,
            TablePurpose::Strongest(Some(self.untouched)),
            frequencies_hz,
            ask,
        )
    }

    /// A faster estimate of the same: the overshoot of every mass when a drive is switched on is that of a single
    /// pole.
    ///
    /// # Errors
    /// As [`Self::evaluate_with_finger_on_each_place`].
    pub fn estimate_with_single_pole_overshoot_and_finger_on_each_place<T: Send>(
        &self,
        places_m: &[(f64, f64)],
        frequencies_hz: impl Fn(&ReducedModel) -> Vec<f64> + Sync,
        ask: impl Fn(&PlanTable) -> T + Sync,
    ) -> Result<Vec<T>, TouchedError> {
        self.build_table_and_ask_with_finger_on_each_place(
            places_m,
            TablePurpose::Roughly(self.untouched),
            frequencies_hz,
            ask,
        )
    }

    fn build_table_and_ask_with_finger_on_each_place<T: Send>(
        &self,
        places_m: &[(f64, f64)],
        purpose: TablePurpose<'_>,
        frequencies_hz: impl Fn(&ReducedModel) -> Vec<f64> + Sync,
        ask: impl Fn(&PlanTable) -> T + Sync,
    ) -> Result<Vec<T>, TouchedError> {
        let stop = StopRequest::current_request_of_thread();
        let at = |place: &(f64, f64)| {
            if stop.is_stop_requested_or_deadline_over() {
                return Err(ModelError::Stopped.into());
            }
            stop.run_with_self_as_current_stop_request_of_thread(|| {
                let touched = self.scene.replace_finger_by_masses_and_supports_at_places(&[*place]);
                let model = self.panel.couple_to_design(&touched)?;
                let (hz, grid) = (frequencies_hz(&model), SurfaceGrid::at_single_point(&model, *place));
                Ok(ask(&build::build_table_for_strongest_drives_only(&touched, model, hz, grid, purpose)?))
            })
        };
        places_m.par_iter().map(at).collect()
    }

    /// Builds the table for plans at a place (in m) with the finger on it. It has no coarser models, so its plans
    /// have no error bound.
    ///
    /// # Errors
    /// [`TouchedError`].
    pub fn build_plan_table_at_touched_place(
        &self,
        place_m: (f64, f64),
        options: TableOptions,
    ) -> Result<PlanTable, TouchedError> {
        let touched = self.scene.replace_finger_by_masses_and_supports_at_places(&[place_m]);
        Ok(build::build_table(
            &touched,
            self.panel.couple_to_design(&touched)?,
            options,
            Some(&self.untouched.pressed),
        )?)
    }

    /// Builds that table from the scene's own elements in three levels, so that its plans have an error bound.
    ///
    /// # Errors
    /// [`TouchedError`].
    pub fn build_plan_table_with_error_bounds_at_touched_place(
        &self,
        place_m: (f64, f64),
        accuracy: Accuracy,
        options: TableOptions,
    ) -> Result<PlanTable, TouchedError> {
        let touched = self.scene.replace_finger_by_masses_and_supports_at_places(&[place_m]);
        let levels = ReducedLevels::build(&touched, accuracy, options.to_hz)?;
        Ok(PlanTable::build_from_levels(&touched, levels, options, Some(&self.untouched.pressed))?)
    }
}
