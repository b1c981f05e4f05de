//! The points of a surface, or of a region of it, over which a minimum is taken.

use super::PlanTable;
use crate::scene::{PlaceError, Scene, check_and_snap_coordinate_along_side, equidistant_numbers};
use nalgebra::DMatrix;

/// Lines from one of the table's grid to the next on the finer grid, as a minimum may hide between the points.
const FINER: usize = 4;
/// Most points of the finer grid; with more, fewer lines are added.
const MOST_POINTS: usize = 65_536;

/// A rectangle of the surface in m from its top left corner; on a bar only x counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Least and most x.
    pub x_m: [f64; 2],
    /// Least and most y.
    pub y_m: [f64; 2],
}

impl Region {
    /// The region between two corners on the surface of a scene, in m.
    ///
    /// # Errors
    /// [`PlaceError::Outside`] that names `x_mm` or `y_mm`.
    pub fn on_surface(scene: &Scene, x_m: [f64; 2], y_m: [f64; 2]) -> Result<Self, PlaceError> {
        let along = |field, [from, to]: [f64; 2], side_m| -> Result<[f64; 2], PlaceError> {
            Ok([
                check_and_snap_coordinate_along_side(field, from, side_m)?,
                check_and_snap_coordinate_along_side(field, to, side_m)?,
            ])
        };
        Ok(Self { x_m: along("x_mm", x_m, scene.surface.length_m)?, y_m: along("y_mm", y_m, scene.surface.width_m)? })
    }

    /// Whether a point lies in the region; up to a nanometre outside counts as inside.
    fn contains_point(&self, x_m: f64, y_m: f64, ignores_y: bool) -> bool {
        let within = |value: f64, [from, to]: [f64; 2]| value >= from - 1e-9 && value <= to + 1e-9;
        within(x_m, self.x_m) && (ignores_y || within(y_m, self.y_m))
    }
}

/// The error for a region without a point of the grid.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("the zone contains no point of the surface's grid; the points of this grid are {apart_mm:.1} mm apart")]
pub struct EmptyRegionError {
    /// How far they are from each other, in mm.
    pub apart_mm: f64,
}

/// The points of a surface, or of a region of it, over which a minimum is taken.
#[derive(Clone, Debug)]
pub struct PointView {
    /// Points of the table's grid, by their numbers.
    pub points: Vec<usize>,
    /// Mode shapes at these, points x n.
    pub shapes: DMatrix<f64>,
    /// Points of a grid up to four times as fine, in m.
    pub places_m: Vec<(f64, f64)>,
    /// Mode shapes at those.
    pub finer: DMatrix<f64>,
}

impl PointView {
    /// The view of the whole surface or of a region of it; `None` if the table's grid has no point there.
    #[must_use]
    pub fn new(table: &PlanTable, region: Option<Region>) -> Option<Self> {
        let grid = &table.grid;
        let layout = table.scene.layout();
        let ignores_y = grid.y_m.len() < 2;
        let is_seen = |x: f64, y: f64| region.is_none_or(|region| region.contains_point(x, y, ignores_y));
        let columns = grid.x_m.len().max(1);
        let points: Vec<usize> = (0..grid.there.len())
            .filter(|point| grid.there[*point] && is_seen(grid.x_m[point % columns], grid.y_m[point / columns]))
            .collect();
        if points.is_empty() {
            return None;
        }
        let times = (1..=FINER).rev().find(|k| k * k * grid.there.len() <= MOST_POINTS).unwrap_or(1);
        let (x, y) = (subdivide_between_lines(&grid.x_m, times), subdivide_between_lines(&grid.y_m, times));
        let places = y.iter().flat_map(|y| x.iter().map(move |x| (*x, *y)));
        let (there, places_m): (Vec<usize>, Vec<(f64, f64)>) = places
            .enumerate()
            .filter(|(_, (x, y))| is_seen(*x, *y) && layout.layer_at_unless_cut_out(*x, *y).is_some())
            .unzip();
        let shapes = grid.shapes.select_rows(&points);
        Some(Self {
            points,
            shapes,
            places_m,
            finer: table.model.shape_deflections_on_grid(&x, &y).select_rows(&there),
        })
    }

    /// The view of the whole surface or of a region of it.
    ///
    /// # Errors
    /// [`EmptyRegionError`] where the table's grid has no point.
    pub fn try_new(table: &PlanTable, region: Option<Region>) -> Result<Self, EmptyRegionError> {
        Self::new(table, region).ok_or_else(|| {
            let step = |lines: &[f64]| lines.windows(2).map(|pair| (pair[1] - pair[0]) * 1e3).fold(0.0, f64::max);
            EmptyRegionError { apart_mm: step(&table.grid.x_m).max(step(&table.grid.y_m)) }
        })
    }

    /// Positions of [`PointView::points`] in m.
    #[must_use]
    pub fn place_of_each_point_m(&self, table: &PlanTable) -> Vec<(f64, f64)> {
        self.points.iter().map(|point| table.grid.point_position_m(*point)).collect()
    }

    /// Places values at [`PointView::points`] into a list over all points of the grid; `None` elsewhere.
    #[must_use]
    pub fn spread_view_values_over_table_grid<T: Clone>(
        &self,
        table: &PlanTable,
        values: impl IntoIterator<Item = T>,
    ) -> Vec<Option<T>> {
        let mut all = vec![None; table.grid.there.len()];
        for (point, value) in self.points.iter().zip(values) {
            all[*point] = Some(value);
        }
        all
    }
}

/// The lines, with `times` - 1 more between every two.
fn subdivide_between_lines(lines: &[f64], times: usize) -> Vec<f64> {
    let parts = |pair: &[f64]| equidistant_numbers(pair[0], pair[1], times + 1).into_iter().take(times);
    lines.windows(2).flat_map(parts).chain(lines.last().copied()).collect()
}
