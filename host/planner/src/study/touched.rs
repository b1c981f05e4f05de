//! What can be had at places that a finger is on, one after the other.

use super::strongest::{Strongest, strongest};
use crate::PlanTable;
use crate::reach::{Measure, Space};
use crate::table::touched::{Touched, TouchedError};
use crate::table::{Region, View};

/// The strongest drive at each of some points with the scene's finger on it. It takes a table for every point: whoever wants several figures
/// of it makes it once.
#[derive(Clone, Debug)]
pub struct TouchedReach {
    pub(super) view: View,
    pub(super) touches: Vec<Strongest>,
}

impl TouchedReach {
    /// At the points of the grid of `table`, or those in a region. `table` is that of the panel that nothing touches: the frequencies to choose from and
    /// the pulse widths are its own. `None` where a point has no usable frequencies, and where there is none.
    ///
    /// # Errors
    /// [`TouchedError`].
    pub fn of(
        table: &PlanTable,
        touched: Touched<'_>,
        region: Option<Region>,
        measure: Measure,
    ) -> Result<Option<Self>, TouchedError> {
        let Some(view) = View::new(table, region) else { return Ok(None) };
        let ask = |own: &PlanTable| {
            let space = Space::of(own, &own.grid.shapes, |hz| measure.weight(hz));
            strongest(own, &space).into_iter().next().flatten()
        };
        let each = touched.each(&view.grid_places_m(table), |_| table.frequencies_hz.clone(), ask)?;
        Ok(each.into_iter().collect::<Option<_>>().map(|touches| Self { view, touches }))
    }
}
