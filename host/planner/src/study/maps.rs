//! Reach maps: what can be had at every point of the surface.

use crate::model::{Accuracy, Bound};
use crate::quick::QuickError;
use crate::reach::Measure;
use crate::reach::Space;
use crate::reach::search;
use crate::reach::setting::command;
use crate::stop::Stop;
use crate::table::Part;
use crate::table::PlanTable;
use crate::table::touched::{Touched, TouchedError};
use crate::table::{Region, View};
use crate::wish::request::Work;
use crate::{PlanError, TableOptions, Target};
use rayon::prelude::*;
use serde::Serialize;
use std::fmt::Write;

/// Part of the strongest peak at which the most contrasted is asked for: so little that no limit changes it. At a hundredth one does
/// where an ERA beside a clamped edge shakes the rest of the panel so little that all of its force would go first.
const LITTLE: f64 = 1e-6;
/// Neighbouring points that are searched in turn, each with the one before as a hint.
const RUN: usize = 16;

/// What can be had at every point of the table's grid; `None` in cut-outs, and outside the region that was asked for.
#[derive(Clone, Debug, Serialize)]
pub struct Maps {
    /// Columns in mm.
    pub x_mm: Vec<f64>,
    /// Rows in mm.
    pub y_mm: Vec<f64>,
    /// The actuators' ids, in the order of the frequencies below.
    pub actuators: Vec<String>,
    /// Row by row: the strongest peak in g, of drives at distinct frequencies within all limits.
    pub strongest_g: Vec<Option<f64>>,
    /// Row by row: the frequency of each actuator in Hz for that.
    pub strongest_hz: Vec<Option<Vec<f64>>>,
    /// Row by row: upper bound on the relative error of the strongest peak, its forces as they are; `None` where there is none.
    pub error_bound: Vec<Option<f64>>,
    /// Row by row: contrast in dB of the drives that shake the rest least for a weak peak at the point; `None` with a finger.
    pub contrast_db: Vec<Option<f64>>,
    /// Row by row: the frequency of each actuator in Hz for that.
    pub contrast_hz: Vec<Option<Vec<f64>>>,
}

/// The strongest drive at a point.
#[derive(Clone, Debug)]
pub struct Strongest {
    /// As it is commanded.
    pub setting: Vec<Part>,
    /// Its peak there, in the space's unit.
    pub peak: f64,
}

/// The strongest drive at each point of a space, each with frequencies and forces of its own; none from when nobody waits on ([`Stop`]).
#[must_use]
pub fn strongest(table: &PlanTable, space: &Space) -> Vec<Option<Strongest>> {
    let stop = Stop::current();
    let points: Vec<usize> = (0..space.points).collect();
    let runs: Vec<Vec<Option<Strongest>>> = points
        .par_chunks(RUN)
        .map(|run| {
            let mut hint: Option<Vec<usize>> = None;
            let each = run.iter().map(|point| {
                if stop.is_asked() {
                    return None;
                }
                let best = search::best(space, &[*point], Work::Study, hint.as_deref())?;
                let mut setting = best.setting(table, space);
                let peak = best.least * command(table, &mut setting)?;
                hint = Some(best.choice);
                Some(Strongest { setting, peak })
            });
            each.collect()
        })
        .collect();
    runs.into_iter().flatten().collect()
}

/// The strongest drive at each of a view's points with the scene's finger on it, chosen among the frequencies of `table`, that of the panel
/// that nothing touches, and among its pulse widths. `None` where one has no usable frequencies.
///
/// # Errors
/// [`TouchedError`].
pub fn strongest_touched(
    table: &PlanTable,
    touched: Touched<'_>,
    view: &View,
    measure: Measure,
) -> Result<Option<Vec<Strongest>>, TouchedError> {
    let ask = |own: &PlanTable| {
        let space = Space::of(own, &own.grid.shapes, |hz| measure.weight(hz));
        strongest(own, &space).into_iter().next().flatten()
    };
    let each = touched.each(&view.grid_places_m(table), |_| table.frequencies_hz.clone(), ask)?;
    Ok(each.into_iter().collect())
}

impl Maps {
    /// The maps of a table, over all of the surface or a region of it.
    ///
    /// # Errors
    /// As a plan for a point has; [`PlanError::NoFrequencies`] also where the region has no point of the table's grid.
    pub fn of(table: &PlanTable, region: Option<Region>) -> Result<Self, PlanError> {
        let grid = &table.grid;
        let view = View::new(table, region).ok_or(PlanError::NoFrequencies)?;
        let space = Space::of(table, &view.shapes, |hz| Measure::G.weight(hz));
        let stop = Stop::current();
        let found = strongest(table, &space);
        if stop.is_asked() {
            return Err(PlanError::Stopped);
        }
        let found: Vec<Strongest> = found.into_iter().collect::<Option<_>>().ok_or(PlanError::NoFrequencies)?;
        let contrasts: Vec<(f64, Vec<f64>)> = view
            .points
            .par_iter()
            .zip(&found)
            .map(|(point, strongest)| {
                if stop.is_asked() {
                    return Err(PlanError::Stopped);
                }
                let (x_m, y_m) = grid.place_m(*point);
                let weak = Target { x_m, y_m, intensity_g: Some(LITTLE * strongest.peak) };
                let plan = table.plan(&[weak])?;
                Ok((plan.predicted.contrast_db, plan.drives.iter().map(|drive| drive.frequency_hz).collect()))
            })
            .collect::<Result<_, PlanError>>()?;
        let settings = view.points.iter().zip(&found).map(|(point, strongest)| (*point, strongest.setting.as_slice()));
        let bounds = view.on_grid(table, table.setting_bounds(settings).into_iter().map(Bound::value));
        Ok(Self {
            error_bound: bounds.into_iter().map(Option::flatten).collect(),
            contrast_db: view.on_grid(table, contrasts.iter().map(|(contrast_db, _)| *contrast_db)),
            contrast_hz: view.on_grid(table, contrasts.into_iter().map(|(_, hz)| hz)),
            ..Self::without_contrasts(table, &view, &found)
        })
    }

    /// The same with the scene's finger on each point while it is looked at; `table` is that of the panel that nothing touches. There are no
    /// contrasts: each is a plan for a panel of its own. The weakest point is computed from the scene's own elements for `accuracy` and has an error
    /// bound, as have those that were taken for it first; others have none.
    ///
    /// # Errors
    /// As [`Self::of`], and as [`Touched::each`].
    pub fn touched(
        table: &PlanTable,
        region: Option<Region>,
        touched: Touched<'_>,
        accuracy: Accuracy,
        options: TableOptions,
    ) -> Result<Self, QuickError> {
        let view = View::new(table, region).ok_or(PlanError::NoFrequencies)?;
        let mut found = strongest_touched(table, touched, &view, Measure::G)?.ok_or(PlanError::NoFrequencies)?;
        let (from_hz, to_hz) =
            table.frequencies_hz.first().zip(table.frequencies_hz.last()).ok_or(PlanError::NoFrequencies)?;
        let mut bounds: Vec<Option<Bound>> = vec![None; found.len()];
        // What is the weakest may change as it is computed anew: to one that nearly was.
        loop {
            let each = found.iter().enumerate().min_by(|a, b| a.1.peak.total_cmp(&b.1.peak));
            let Some((weakest, _)) = each.filter(|(weakest, _)| bounds[*weakest].is_none()) else { break };
            let point = view.points[weakest];
            let bounded = touched.bounded(table.grid.place_m(point), accuracy, options)?.between(*from_hz, *to_hz);
            let bounded = bounded.ok_or(PlanError::NoFrequencies)?;
            let space = Space::of(&bounded, &bounded.grid.shapes.select_rows(&[point]), |hz| Measure::G.weight(hz));
            let own = strongest(&bounded, &space).into_iter().next().flatten().ok_or(PlanError::NoFrequencies)?;
            bounds[weakest] = bounded.setting_bounds(std::iter::once((point, own.setting.as_slice()))).pop();
            found[weakest] = own;
        }
        let bounds = view.on_grid(table, bounds);
        Ok(Self {
            error_bound: bounds.into_iter().map(|bound| bound.flatten().and_then(Bound::value)).collect(),
            ..Self::without_contrasts(table, &view, &found)
        })
    }

    fn without_contrasts(table: &PlanTable, view: &View, found: &[Strongest]) -> Self {
        let grid = &table.grid;
        let mm = |lines: &[f64]| lines.iter().map(|line| line * 1e3).collect();
        let hz = |strongest: &Strongest| strongest.setting.iter().map(|part| part.drive.frequency_hz).collect();
        Self {
            x_mm: mm(&grid.x_m),
            y_mm: mm(&grid.y_m),
            actuators: table.scene.actuators.iter().map(|actuator| actuator.id.clone()).collect(),
            strongest_g: view.on_grid(table, found.iter().map(|strongest| strongest.peak)),
            strongest_hz: view.on_grid(table, found.iter().map(hz)),
            error_bound: vec![None; grid.there.len()],
            contrast_db: vec![None; grid.there.len()],
            contrast_hz: vec![None; grid.there.len()],
        }
    }

    /// Lines of `x_mm,y_mm,strongest_g,contrast_db` and the frequency of each actuator for either; all but the place are empty
    /// where nothing is known.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut text = String::from("x_mm,y_mm,strongest_g,contrast_db");
        for name in ["strongest", "contrast"] {
            self.actuators.iter().for_each(|id| text.push_str(&format!(",{name}_{id}_hz")));
        }
        text.push('\n');
        let places = self.y_mm.iter().flat_map(|y| self.x_mm.iter().map(move |x| (x, y)));
        let cell = |value: Option<f64>, digits: usize| {
            value.map_or_else(|| String::from(","), |value| format!(",{value:.digits$}"))
        };
        for (point, (x, y)) in places.enumerate() {
            let at = |values: &[Option<f64>]| cell(values.get(point).copied().flatten(), 4);
            let _ = write!(text, "{x:.3},{y:.3}{}{}", at(&self.strongest_g), at(&self.contrast_db));
            for frequencies in [&self.strongest_hz, &self.contrast_hz] {
                let hz = frequencies.get(point).and_then(Option::as_ref);
                for actuator in 0..self.actuators.len() {
                    text.push_str(&cell(hz.and_then(|hz| hz.get(actuator)).copied(), 2));
                }
            }
            text.push('\n');
        }
        text
    }
}
