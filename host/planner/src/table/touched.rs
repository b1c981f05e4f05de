//! Tables of a panel with its scene's finger on one place after the other: what that place does while it is touched.
//!
//! A finger is a spring, a dashpot and a mass at its place, so that each place is a design of the bare panel ([`BarePanel`]): the place's shapes are in
//! that design's basis, and with them what a sum of modes misses where a force is, which is a part in a hundred of the receptance there.

use super::build::{self, Purpose};
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

/// A panel whose scene's finger is on one place at a time. What a press does to the gaps is as without it: a finger that is part of the panel does not
/// hold it against another one.
#[derive(Clone, Copy, Debug)]
pub struct Touched<'a> {
    panel: &'a BarePanel,
    scene: &'a Scene,
    untouched: &'a PlanTable,
}

impl<'a> Touched<'a> {
    /// The design `scene` of a panel, `untouched` its table without a finger.
    #[must_use]
    pub fn new(panel: &'a BarePanel, scene: &'a Scene, untouched: &'a PlanTable) -> Self {
        Self { panel, scene, untouched }
    }

    /// Asks at each place (m) a table of that place alone, with the finger on it: for the strongest drives at the frequencies that
    /// `frequencies_hz` takes for the model.
    ///
    /// # Errors
    /// [`TouchedError`] of the first place that has one.
    pub fn each<T: Send>(
        &self,
        places_m: &[(f64, f64)],
        frequencies_hz: impl Fn(&ReducedModel) -> Vec<f64> + Sync,
        ask: impl Fn(&PlanTable) -> T + Sync,
    ) -> Result<Vec<T>, TouchedError> {
        self.tables(places_m, Purpose::Strongest(Some(self.untouched)), frequencies_hz, ask)
    }

    /// The same roughly, and several times as fast: whatever its poles, a mass is taken to move, as it is switched on, by what a single pole's whole free motion adds.
    ///
    /// # Errors
    /// As [`Self::each`].
    pub fn each_roughly<T: Send>(
        &self,
        places_m: &[(f64, f64)],
        frequencies_hz: impl Fn(&ReducedModel) -> Vec<f64> + Sync,
        ask: impl Fn(&PlanTable) -> T + Sync,
    ) -> Result<Vec<T>, TouchedError> {
        self.tables(places_m, Purpose::Roughly(self.untouched), frequencies_hz, ask)
    }

    fn tables<T: Send>(
        &self,
        places_m: &[(f64, f64)],
        purpose: Purpose<'_>,
        frequencies_hz: impl Fn(&ReducedModel) -> Vec<f64> + Sync,
        ask: impl Fn(&PlanTable) -> T + Sync,
    ) -> Result<Vec<T>, TouchedError> {
        let stop = StopRequest::current_request_of_thread();
        let at = |place: &(f64, f64)| {
            if stop.is_stop_requested() {
                return Err(ModelError::Stopped.into());
            }
            let touched = self.scene.with_finger_at_places(&[*place]);
            let model = self.panel.couple_to_design(&touched)?;
            let (hz, grid) = (frequencies_hz(&model), SurfaceGrid::at(&model, *place));
            Ok(ask(&build::strongest(&touched, model, hz, grid, purpose)?))
        };
        places_m.par_iter().map(at).collect()
    }

    /// The table for plans of a place (m) with the finger on it. Without coarser models its plans have no error bound.
    ///
    /// # Errors
    /// [`TouchedError`].
    pub fn table(&self, place_m: (f64, f64), options: TableOptions) -> Result<PlanTable, TouchedError> {
        let touched = self.scene.with_finger_at_places(&[place_m]);
        Ok(build::table(&touched, self.panel.couple_to_design(&touched)?, options, Some(&self.untouched.pressed))?)
    }

    /// The same from the scene's own elements in three levels: its plans have an error bound.
    ///
    /// # Errors
    /// [`TouchedError`].
    pub fn bounded(
        &self,
        place_m: (f64, f64),
        accuracy: Accuracy,
        options: TableOptions,
    ) -> Result<PlanTable, TouchedError> {
        let touched = self.scene.with_finger_at_places(&[place_m]);
        let levels = ReducedLevels::build(&touched, accuracy, options.to_hz)?;
        Ok(PlanTable::of_levels(&touched, levels, options, Some(&self.untouched.pressed))?)
    }
}
