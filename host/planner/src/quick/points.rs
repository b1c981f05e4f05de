//! Points: some of the table's grid, and all of them around the weakest.

use crate::model::ReducedModel;
use crate::scene::Scene;
use crate::table::{PlanTable, SurfaceGrid};

/// One of so many of the grid's lines is looked at: six points in a bending wave at the highest frequency. Where node lines of two modes cross,
/// places are weak within a tenth of a wave only: with every third line one of 24 designs of the example plate had its weakest place between them, and
/// was taken for 1.5 times as strong.
const TIMES: usize = 2;

/// The points that are looked at first.
pub(super) fn build_coarse_grid_for_first_search(scene: &Scene, model: &ReducedModel, max_hz: f64) -> SurfaceGrid {
    SurfaceGrid::with_every_nth_line(scene, model, max_hz, TIMES)
}

/// The points of the whole grid that are nearer to one of `places` than the next coarse line, other than the coarse ones, in m.
pub(super) fn list_finer_points_around_places_m(
    table: &PlanTable,
    max_hz: f64,
    places_m: &[(f64, f64)],
) -> Vec<(f64, f64)> {
    let whole = SurfaceGrid::points_without_shapes(&table.scene, max_hz);
    let step = |lines: &[f64]| lines.get(1).zip(lines.first()).map_or(f64::INFINITY, |(b, a)| b - a);
    #[expect(clippy::cast_precision_loss, reason = "a small number")]
    let reach = [&whole.x_m, &whole.y_m].map(|lines| (TIMES as f64 - 0.5) * step(lines));
    let coarse = &table.grid;
    let is_coarse = |x: f64, y: f64| coarse.x_m.contains(&x) && coarse.y_m.contains(&y);
    let all = whole.y_m.iter().flat_map(|y| whole.x_m.iter().map(move |x| (*x, *y))).zip(&whole.there);
    let is_near = |x: f64, y: f64| places_m.iter().any(|(a, b)| (x - a).abs() < reach[0] && (y - b).abs() < reach[1]);
    all.filter(|((x, y), there)| **there && is_near(*x, *y) && !is_coarse(*x, *y)).map(|(place, _)| place).collect()
}
