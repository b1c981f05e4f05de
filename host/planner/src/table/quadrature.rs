//! Mean squares over the surface, by Gauss' rule on its own rectangles.
//!
//! A motion is smooth within each rectangle of the surface's layout and ends at its borders with any slope. On points that
//! are evenly apart (the grid of pictures) the trapezoidal rule is off there by h^2, 0.5 % with twelve points per wave, and by
//! h where a cut-out's border is not a line of the grid.

use super::grid::shortest_bending_wavelength_m;
use crate::HIGHEST_FELT_HZ;
use crate::model::ReducedModel;
use crate::model::shape::gauss_legendre_rule_on_unit_interval;
use crate::scene::{Scene, SurfaceKind};
use nalgebra::DMatrix;
use std::f64::consts::TAU;

/// Points beyond those that the shortest wave needs: for what decays away from borders and points that are held, and for panels that
/// hardly move but around the force (118 x 35 mm held on three sides, far below its first mode: 4 points more are wrong by 9e-3, 16 by 1e-3).
const MORE_POINTS: f64 = 16.0;
/// Most points in a rectangle along either axis, as many as the grid of pictures has at most.
const MOST_GAUSS_POINTS: f64 = 256.0;

/// Products of the shapes with each other, as means over the surface, n x n: the mean square of a motion with coordinates q
/// is q* M q, up to 1 kHz to four digits, three where little but the surroundings of a force moves: there a motion goes as
/// r^2 log r. A bar's means are over its length.
pub(super) fn compute_mean_shape_products_over_surface(scene: &Scene, model: &ReducedModel) -> DMatrix<f64> {
    let layout = scene.layout();
    let wave_m = shortest_bending_wavelength_m(scene, HIGHEST_FELT_HZ);
    let x = gauss_points_and_weights(layout.border_lines_and_outer_edges_x_m(), wave_m);
    let y = match scene.surface.kind {
        SurfaceKind::Bar => vec![(scene.surface.width_m / 2.0, 1.0)],
        SurfaceKind::Plate => gauss_points_and_weights(layout.border_lines_and_outer_edges_y_m(), wave_m),
    };
    let x_m: Vec<f64> = x.iter().map(|(at, _)| *at).collect();
    let mut products = DMatrix::zeros(model.count_coordinates(), model.count_coordinates());
    let mut area = 0.0;
    for (y_m, height) in &y {
        let shapes = model.shape_deflections_on_grid(&x_m, &[*y_m]);
        let mut weighted = shapes.clone();
        for (mut row, (x_m, length)) in weighted.row_iter_mut().zip(&x) {
            let weight = if layout.layer_at_unless_cut_out(*x_m, *y_m).is_some() { length * height } else { 0.0 };
            row *= weight;
            area += weight;
        }
        products += shapes.tr_mul(&weighted);
    }
    products / area
}

/// Places and weights of Gauss' rule between each two lines. A square of a motion has waves of half the length; the rule
/// takes pi points for each of them.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most MOST_GAUSS_POINTS")]
fn gauss_points_and_weights(lines_m: &[f64], wave_m: f64) -> Vec<(f64, f64)> {
    let between = lines_m.windows(2).flat_map(|ends| {
        let (from, side) = (ends[0], ends[1] - ends[0]);
        let count = (TAU * side / wave_m + MORE_POINTS).ceil().min(MOST_GAUSS_POINTS) as usize;
        gauss_legendre_rule_on_unit_interval(count)
            .into_iter()
            .map(move |(at, weight)| (from + side * at, side * weight))
    });
    between.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Accuracy, PanelModel};
    use crate::response::CoordinateSolver;
    use crate::scene::STARTING_PLATE;
    use crate::table::build::mean_square_over_surface;
    use nalgebra::DVector;
    use num_complex::Complex64;

    /// Mean square of a motion by the midpoint rule with `count` x `count` points in each rectangle.
    fn by_midpoints(scene: &Scene, model: &ReducedModel, motion: &DVector<Complex64>, count: usize) -> f64 {
        let layout = scene.layout();
        let middles = |lines: &[f64]| -> Vec<(f64, f64)> {
            let cells = lines.windows(2).flat_map(|ends| {
                let step = (ends[1] - ends[0]) / count as f64;
                (0..count).map(move |k| (ends[0] + step * (k as f64 + 0.5), step))
            });
            cells.collect()
        };
        let (x, y) =
            (middles(layout.border_lines_and_outer_edges_x_m()), middles(layout.border_lines_and_outer_edges_y_m()));
        let x_m: Vec<f64> = x.iter().map(|(at, _)| *at).collect();
        let (mut sum, mut area) = (0.0, 0.0);
        for (y_m, height) in &y {
            let shapes = model.shape_deflections_on_grid(&x_m, &[*y_m]);
            let (re, im) = (&shapes * motion.map(|z| z.re), &shapes * motion.map(|z| z.im));
            for (k, (x_m, length)) in x.iter().enumerate() {
                if layout.layer_at_unless_cut_out(*x_m, *y_m).is_some() {
                    sum += (re[k] * re[k] + im[k] * im[k]) * length * height;
                    area += length * height;
                }
            }
        }
        sum / area
    }

    /// Many midpoints, what is left of their error taken away (Richardson): what Gauss' rule has to agree with.
    #[test]
    fn mean_squares_are_those_of_many_points() {
        let cut = format!("{STARTING_PLATE}\n[[cutout]]\nx_mm = 31.7\ny_mm = 0.0\nlength_mm = 40.3\nwidth_mm = 33.3\n");
        for text in [STARTING_PLATE, &cut] {
            let scene = Scene::parse("plate", text).unwrap();
            let model = PanelModel::build(&scene, Accuracy::FAST, 400.0)
                .unwrap()
                .reduce_with_residual_shapes_of_actuators_damping_and_points(400.0, &[])
                .unwrap();
            let products = compute_mean_shape_products_over_surface(&scene, &model);
            for frequency_hz in [60.0, 287.0, 400.0] {
                let motions = CoordinateSolver::new(&model).solve_coordinates_per_newton_at(frequency_hz).unwrap();
                let [few, many] = [100, 200].map(|count| by_midpoints(&scene, &model, &motions[0], count));
                let wanted = (4.0 * many - few) / 3.0;
                let found = mean_square_over_surface(&products, &motions[0]);
                assert!((found / wanted - 1.0).abs() < 2e-4, "{frequency_hz} Hz: {found} for {wanted}");
            }
        }
    }
}
