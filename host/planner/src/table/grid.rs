//! Points over the surface, with the mode shapes there.

use crate::model::ReducedModel;
use crate::scene::{Scene, SurfaceKind, SurfaceLayer, SurfaceLayout, equidistant_numbers};
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

/// Least number of cells of the surface grid along the longer side, for a picture; the shorter one has as many as keep
/// the cells square.
const GRID_CELLS: f64 = 48.0;
/// Cells per bending wave at the highest frequency (0.22 m at 400 Hz on 2 mm of aluminium). A crest halfway between two
/// points is at most 1 - cos(pi/12) = 3.4 % higher than what they see.
const CELLS_PER_WAVE: f64 = 12.0;
/// Least number of cells along the shorter side.
const LEAST_CELLS: f64 = 4.0;
/// Most cells, for the memory that their mode shapes take; beyond it the cells grow, at 0.5 MB per mode.
const MOST_CELLS: f64 = 65_536.0;

/// A grid over the surface with the mode shapes at its points.
#[derive(Clone, Debug)]
pub struct SurfaceGrid {
    /// Columns, in m from the left edge.
    pub x_m: Vec<f64>,
    /// Rows, in m from the top edge; one row, the axis, for a bar.
    pub y_m: Vec<f64>,
    /// Mode shapes, one row per point, points row by row.
    pub shapes: DMatrix<f64>,
    /// Part of the surface that each point stands for; adds up to 1, and is 0 in a cut-out.
    pub weights: Vec<f64>,
    /// Whether there is surface at each point.
    pub there: Vec<bool>,
}

impl SurfaceGrid {
    pub(super) fn new(scene: &Scene, model: &ReducedModel, max_hz: f64) -> Self {
        let grid = Self::points_without_shapes(scene, max_hz);
        Self { shapes: model.shape_deflections_on_grid(&grid.x_m, &grid.y_m), ..grid }
    }

    /// The grid with every n-th of its lines (`n`) and the last one. All points have the same weight.
    #[expect(clippy::cast_precision_loss, reason = "a count of points")]
    pub(crate) fn with_every_nth_line(scene: &Scene, model: &ReducedModel, max_hz: f64, n: usize) -> Self {
        let whole = Self::points_without_shapes(scene, max_hz);
        let some = |lines: &[f64]| -> Vec<usize> {
            let last = lines.len().saturating_sub(1);
            (0..last).step_by(n.max(1)).chain([last]).collect()
        };
        let (columns, rows) = (some(&whole.x_m), some(&whole.y_m));
        let there: Vec<bool> = rows
            .iter()
            .flat_map(|row| {
                columns.iter().map(|column| whole.there[*row * whole.x_m.len() + *column]).collect::<Vec<_>>()
            })
            .collect();
        let each = 1.0 / there.iter().filter(|there| **there).count().max(1) as f64;
        let lines = |all: &[f64], some: &[usize]| some.iter().map(|line| all[*line]).collect::<Vec<_>>();
        let (x_m, y_m) = (lines(&whole.x_m, &columns), lines(&whole.y_m, &rows));
        let shapes = model.shape_deflections_on_grid(&x_m, &y_m);
        let weights = there.iter().map(|there| if *there { each } else { 0.0 }).collect();
        Self { x_m, y_m, shapes, weights, there }
    }

    /// A grid of one point, in m, with the whole weight.
    pub(super) fn at_single_point(model: &ReducedModel, (x_m, y_m): (f64, f64)) -> Self {
        let (x_m, y_m) = (vec![x_m], vec![y_m]);
        Self { shapes: model.shape_deflections_on_grid(&x_m, &y_m), x_m, y_m, weights: vec![1.0], there: vec![true] }
    }

    /// The points and weights of the grid, without mode shapes.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small counts")]
    pub(crate) fn points_without_shapes(scene: &Scene, max_hz: f64) -> Self {
        let (length, width) = (scene.surface.length_m, scene.surface.width_m);
        let cell = choose_surface_grid_cell_size_m(scene, max_hz);
        let count = |side: f64| (side / cell - 1e-9).ceil().max(LEAST_CELLS) as usize + 1;
        let x_m = equidistant_numbers(0.0, length, count(length));
        let y_m = match scene.surface.kind {
            SurfaceKind::Bar => vec![width / 2.0],
            SurfaceKind::Plate => equidistant_numbers(0.0, width, count(width)),
        };
        let (wx, wy) = (gregory_weights(x_m.len()), gregory_weights(y_m.len()));
        let layout = scene.layout();
        let points = y_m.iter().flat_map(|y| x_m.iter().map(move |x| (*x, *y)));
        let there: Vec<bool> = points.map(|(x, y)| layout.layer_at_unless_cut_out(x, y).is_some()).collect();
        let weights = if there.contains(&false) {
            grid_weights_around_cutouts(&layout, &x_m, &y_m, &there)
        } else {
            wy.iter().flat_map(|v| wx.iter().map(move |u| u * v)).collect()
        };
        Self { shapes: DMatrix::zeros(0, 0), x_m, y_m, weights, there }
    }

    /// Distance of neighbouring columns and of neighbouring rows in m; infinite if there is only one.
    pub(super) fn column_and_row_spacing_or_infinity_m(&self) -> (f64, f64) {
        let step = |line: &[f64]| line.get(1).zip(line.first()).map_or(f64::INFINITY, |(b, a)| b - a);
        (step(&self.x_m), step(&self.y_m))
    }

    /// Position (x, y) of a point in m.
    ///
    /// # Panics
    /// If there is no such point.
    #[must_use]
    pub fn point_position_m(&self, point: usize) -> (f64, f64) {
        let columns = self.x_m.len().max(1);
        (self.x_m[point % columns], self.y_m[point / columns])
    }

    /// Number of points of a scene's grid for frequencies up to `max_hz`.
    #[must_use]
    pub fn count_points(scene: &Scene, max_hz: f64) -> usize {
        let grid = Self::points_without_shapes(scene, max_hz);
        grid.x_m.len() * grid.y_m.len()
    }

    /// The motion with these coordinates at every point of the grid.
    #[must_use]
    pub fn evaluate_at_each_grid_point(&self, acceleration: &DVector<Complex64>) -> Vec<Complex64> {
        let re = &self.shapes * acceleration.map(|z| z.re);
        let im = &self.shapes * acceleration.map(|z| z.im);
        re.iter().zip(im.iter()).map(|(re, im)| Complex64::new(*re, *im)).collect()
    }

    /// Weighted mean over the surface of the magnitude of a motion with these coordinates.
    #[must_use]
    pub fn mean_magnitude_over_surface(&self, acceleration: &DVector<Complex64>) -> f64 {
        self.evaluate_at_each_grid_point(acceleration)
            .iter()
            .zip(&self.weights)
            .map(|(z, weight)| z.norm() * weight)
            .sum()
    }
}

/// Side of a cell of the surface grid in m.
fn choose_surface_grid_cell_size_m(scene: &Scene, max_hz: f64) -> f64 {
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let area = match scene.surface.kind {
        SurfaceKind::Plate => length * width,
        SurfaceKind::Bar => 0.0,
    };
    (length.max(width) / GRID_CELLS)
        .min(shortest_bending_wavelength_m(scene, max_hz) / CELLS_PER_WAVE)
        .max((area / MOST_CELLS).sqrt())
        .max(length / MOST_CELLS)
}

/// Length of the shortest bending wave in m: 2 pi (E h^2 / (12 rho w^2))^(1/4). A plate's is longer by (1 - nu^2)^(-1/4).
pub(super) fn shortest_bending_wavelength_m(scene: &Scene, frequency_hz: f64) -> f64 {
    let omega = std::f64::consts::TAU * frequency_hz;
    let ratio = |layer: &SurfaceLayer| {
        let material = &layer.material;
        let uniform = material.youngs_modulus_pa * layer.thickness_m.powi(2) / (12.0 * material.density_kg_m3);
        let weight = material.density_kg_m3 * layer.thickness_m;
        layer
            .orthotropic
            .map_or(uniform, |rigidities| rigidities.least_and_largest_rigidity_over_directions()[0] / weight)
    };
    let ratio =
        scene.layout().areas_or_bar_lengths_with_layers().map(|(_, layer)| ratio(&layer)).fold(f64::INFINITY, f64::min);
    std::f64::consts::TAU * (ratio / (omega * omega)).powf(0.25)
}

/// Weights on equidistant points, adding up to 1: the trapezoidal rule with Gregory's corrections at both ends up to second
/// differences (Hildebrand 1974, section 5.9). Without them a motion that ends with a slope, as at a free edge, has a mean that is off by
/// h^2 / 12 times that slope: 1 % with twelve points per wave.
#[expect(clippy::cast_precision_loss, reason = "small counts")]
fn gregory_weights(points: usize) -> Vec<f64> {
    const END: [f64; 3] = [3.0 / 8.0, 7.0 / 6.0, 23.0 / 24.0];
    if points < 2 {
        return vec![1.0; points];
    }
    let step = 1.0 / (points - 1) as f64;
    // On fewer points the two ends would meet.
    let ends: &[f64] = if points >= 2 * END.len() { &END } else { &[0.5] };
    (0..points).map(|i| step * ends.get(i.min(points - 1 - i)).copied().unwrap_or(1.0)).collect()
}

/// Weights for a surface with cut-outs, whose borders need not lie on lines of the grid: the trapezoidal rule over
/// each rectangle of the surface. The weight of a point inside a cut-out goes to its neighbours on the surface, so
/// that the mean has an error of the second order in the cell size.
fn grid_weights_around_cutouts(layout: &SurfaceLayout, x_m: &[f64], y_m: &[f64], has_surface: &[bool]) -> Vec<f64> {
    let columns = x_m.len();
    let mut weights = vec![0.0; has_surface.len()];
    for (bottom, top) in consecutive_pairs(layout.border_lines_and_outer_edges_y_m()) {
        let along_y = integrate_hat_functions(y_m, bottom, top);
        for (left, right) in consecutive_pairs(layout.border_lines_and_outer_edges_x_m()) {
            if layout.layer_at_unless_cut_out(0.5 * (left + right), 0.5 * (bottom + top)).is_some() {
                let along_x = integrate_hat_functions(x_m, left, right);
                let shares = along_y.iter().flat_map(|v| along_x.iter().map(move |u| u * v));
                weights.iter_mut().zip(shares).for_each(|(weight, share)| *weight += share);
            }
        }
    }
    for point in (0..has_surface.len()).filter(|point| !has_surface[*point]) {
        let share = std::mem::take(&mut weights[point]);
        let (column, row) = (point % columns, point / columns);
        let rows = row.saturating_sub(1)..=(row + 1).min(y_m.len() - 1);
        let beside = rows.flat_map(|row| {
            (column.saturating_sub(1)..=(column + 1).min(columns - 1)).map(move |column| row * columns + column)
        });
        let neighbours: Vec<usize> = beside.filter(|at| has_surface[*at]).collect();
        for at in &neighbours {
            weights[*at] += share / neighbours.len() as f64;
        }
    }
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= sum);
    weights
}

fn consecutive_pairs(lines: &[f64]) -> impl Iterator<Item = (f64, f64)> {
    lines.windows(2).map(|ends| (ends[0], ends[1]))
}

/// For each point the integral from one position to another of the function that is 1 at the point, 0 at its
/// neighbours and linear between them.
fn integrate_hat_functions(points: &[f64], from: f64, to: f64) -> Vec<f64> {
    let mut integrals = vec![0.0; points.len()];
    for (k, (left, right)) in consecutive_pairs(points).enumerate() {
        let (a, b) = (left.max(from), right.min(to));
        if a < b {
            let part = (0.5 * (a + b) - left) / (right - left);
            integrals[k] += (b - a) * (1.0 - part);
            integrals[k + 1] += (b - a) * part;
        }
    }
    integrals
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::STARTING_PLATE;

    /// Means of 1, x, x^2 and sin x along a line, which ends with a slope.
    #[test]
    fn weights_of_a_line_are_good_to_the_fourth_order() {
        for points in [5, 6, 7, 13, 49] {
            let weights = gregory_weights(points);
            let line = equidistant_numbers(0.0, 1.0, points);
            let mean = |of: &dyn Fn(f64) -> f64| -> f64 { line.iter().zip(&weights).map(|(x, w)| w * of(*x)).sum() };
            assert!((mean(&|_| 1.0) - 1.0).abs() < 1e-12 && (mean(&|x| x) - 0.5).abs() < 1e-12, "{points}");
            if points > 5 {
                assert!((mean(&|x| x * x) - 1.0 / 3.0).abs() < 1e-12, "{points}");
                let step = 1.0 / (points - 1) as f64;
                assert!((mean(&f64::sin) - (1.0 - 1.0_f64.cos())).abs() < 0.1 * step.powi(4), "{points}");
            }
        }
    }

    /// Every point of the grid of a panel of any whole millimetres is a place on it, and the outer ones are on its edges.
    #[test]
    fn grids_end_at_the_edges_of_any_panel() {
        let mut scene = Scene::parse("plate", STARTING_PLATE).unwrap();
        for side_mm in (20..=1500_u32).chain((1500..=10_000).step_by(37)) {
            let side = f64::from(side_mm) / 1e3;
            for (kind, length, width) in
                [(SurfaceKind::Plate, side, 0.05), (SurfaceKind::Plate, 0.05, side), (SurfaceKind::Bar, side, 0.02)]
            {
                (scene.surface.kind, scene.surface.length_m, scene.surface.width_m) = (kind, length, width);
                let grid = SurfaceGrid::points_without_shapes(&scene, 400.0);
                assert_eq!((grid.x_m[0], grid.x_m.last()), (0.0, Some(&length)));
                if kind == SurfaceKind::Plate {
                    assert_eq!((grid.y_m[0], grid.y_m.last()), (0.0, Some(&width)));
                }
                let exact = |x: f64, y: f64| {
                    scene.surface.surface_or_bar_axis_point_even_in_cutout(x, y).unwrap().coordinates_m() == (x, y)
                };
                assert!(grid.x_m.iter().all(|x| exact(*x, grid.y_m[0])), "{length} x {width}");
                assert!(grid.y_m.iter().all(|y| exact(0.0, *y)), "{length} x {width}");
            }
        }
    }

    /// Means of 1, x and x^2 over a plate with a cut-out at an edge and one in the middle, whose borders are no lines of the grid.
    #[test]
    fn weights_are_those_of_the_surface_around_cutouts() {
        let cutout =
            |x: f64, y: f64| format!("\n[[cutout]]\nx_mm = {x}\ny_mm = {y}\nlength_mm = 40.3\nwidth_mm = 33.3\n");
        let scene =
            Scene::parse("plate", &format!("{STARTING_PLATE}{}{}", cutout(31.7, 0.0), cutout(131.7, 71.3))).unwrap();
        let (length, width) = (scene.surface.length_m, scene.surface.width_m);
        let grid = SurfaceGrid::points_without_shapes(&scene, 400.0);
        let (hole, boxes) = ((40.3e-3, 33.3e-3), [31.7e-3, 131.7e-3]);
        let area = length * width - 2.0 * hole.0 * hole.1;
        for power in 0..3 {
            let moment = |from: f64, to: f64| (to.powi(power + 1) - from.powi(power + 1)) / f64::from(power + 1);
            let cut: f64 = boxes.iter().map(|left| moment(*left, left + hole.0) * hole.1).sum();
            let wanted = (moment(0.0, length) * width - cut) / area;
            let columns = grid.x_m.len();
            let found: f64 =
                grid.weights.iter().enumerate().map(|(k, weight)| weight * grid.x_m[k % columns].powi(power)).sum();
            assert!((found / wanted - 1.0).abs() < 1e-3, "x^{power}: {found} for {wanted}");
        }
    }
}
