//! Reach maps: what can be had at every point of the surface.

use super::search::{self, Best, Options};
use super::space::Space;
use crate::planner::table::PlanTable;
use crate::planner::{PlanError, STANDARD_GRAVITY, Target};
use rayon::prelude::*;
use serde::Serialize;

/// Part of the strongest peak at which the most contrasted is asked for: so little that no limit changes it.
const LITTLE: f64 = 0.01;
/// Neighbouring points that are searched in turn, each with the one before as a hint.
const RUN: usize = 16;

/// What can be had at every point of the table's grid; `None` in cut-outs.
#[derive(Clone, Debug, Serialize)]
pub struct Maps {
    /// Columns in mm.
    pub x_mm: Vec<f64>,
    /// Rows in mm.
    pub y_mm: Vec<f64>,
    /// Row by row: the strongest peak in g, of drives at distinct frequencies within all limits.
    pub strongest_g: Vec<Option<f64>>,
    /// Row by row: contrast in dB of the drives that shake the rest least for a weak peak at the point.
    pub contrast_db: Vec<Option<f64>>,
}

/// The strongest drive at each of `points`, each with frequencies and forces of its own.
#[must_use]
pub fn strongest(space: &Space, points: &[usize], options: Options) -> Vec<Option<Best>> {
    let runs: Vec<Vec<Option<Best>>> = points
        .par_chunks(RUN)
        .map(|run| {
            let mut hint: Option<Vec<usize>> = None;
            let each = run.iter().map(|point| {
                let best = search::best(space, &[*point], options, hint.as_deref());
                hint = best.as_ref().map(|best| best.choice.clone()).or_else(|| hint.take());
                best
            });
            each.collect()
        })
        .collect();
    runs.into_iter().flatten().collect()
}

impl Maps {
    /// The maps of a table.
    ///
    /// # Errors
    /// As a plan for a point has.
    pub fn of(table: &PlanTable) -> Result<Self, PlanError> {
        let grid = &table.grid;
        let points: Vec<usize> = (0..grid.there.len()).filter(|point| grid.there[*point]).collect();
        let space = Space::of(table, &grid.shapes, |_| 1.0);
        let found = strongest(&space, &points, Options::default());
        let mut strongest_g = vec![None; grid.there.len()];
        for (point, best) in points.iter().zip(&found) {
            let best = best.as_ref().ok_or(PlanError::NoFrequencies)?;
            strongest_g[*point] = Some(best.least / STANDARD_GRAVITY);
        }
        let columns = grid.x_m.len().max(1);
        let contrast_db = strongest_g
            .par_iter()
            .enumerate()
            .map(|(point, strongest_g)| {
                let Some(strongest_g) = strongest_g else { return Ok(None) };
                let (x_m, y_m) = (grid.x_m[point % columns], grid.y_m[point / columns]);
                let weak = Target { x_m, y_m, intensity_g: Some(LITTLE * strongest_g) };
                Ok(Some(table.plan(&[weak])?.predicted.contrast_db))
            })
            .collect::<Result<_, PlanError>>()?;
        let mm = |lines: &[f64]| lines.iter().map(|line| line * 1e3).collect();
        Ok(Self { x_mm: mm(&grid.x_m), y_mm: mm(&grid.y_m), strongest_g, contrast_db })
    }

    /// Lines of `x_mm,y_mm,strongest_g,contrast_db`, the latter two empty in cut-outs.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut text = String::from("x_mm,y_mm,strongest_g,contrast_db\n");
        let places = self.y_mm.iter().flat_map(|y| self.x_mm.iter().map(move |x| (x, y)));
        let cell = |value: &Option<f64>| value.map_or_else(String::new, |value| format!("{value:.4}"));
        for (((x, y), strongest), contrast) in places.zip(&self.strongest_g).zip(&self.contrast_db) {
            text.push_str(&format!("{x:.3},{y:.3},{},{}\n", cell(strongest), cell(contrast)));
        }
        text
    }
}
