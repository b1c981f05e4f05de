//! What can be had at places that a finger is on, one after the other.

use super::strongest::{StrongestDrive, strongest_drive_at_each_point_unless_stopped};
use crate::PlanTable;
use crate::reach::{Measure, ReachSpace};
use crate::table::touched::{TouchedError, TouchedPanel};
use crate::table::{PointView, Region};

/// The strongest drive at each of some points with the scene's finger on it. It takes a table for every point: whoever wants several figures
/// of it makes it once.
#[derive(Clone, Debug)]
pub struct TouchedReach {
    pub(super) view: PointView,
    pub(super) touches: Vec<StrongestDrive>,
}

impl TouchedReach {
    /// At the points of the grid of `table`, or those in a region. `table` is that of the panel that nothing touches: the frequencies to choose from and
    /// the pulse widths are its own. `None` where a point has no usable frequencies, and where there is none.
    ///
    /// # Errors
    /// [`TouchedError`].
    pub fn compute_at_each_point_if_frequencies_usable(
        table: &PlanTable,
        touched: TouchedPanel<'_>,
        region: Option<Region>,
        measure: Measure,
    ) -> Result<Option<Self>, TouchedError> {
        let Some(view) = PointView::new(table, region) else { return Ok(None) };
        let ask = |own: &PlanTable| {
            let space = ReachSpace::from_table(own, &own.grid.shapes, |hz| measure.weight_per_m_per_s2(hz));
            strongest_drive_at_each_point_unless_stopped(own, &space).into_iter().next().flatten()
        };
        let each = touched.evaluate_with_finger_on_each_place(
            &view.place_of_each_point_m(table),
            |_| table.frequencies_hz.clone(),
            ask,
        )?;
        Ok(each.into_iter().collect::<Option<_>>().map(|touches| Self { view, touches }))
    }
}
