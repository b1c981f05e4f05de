//! Mode shapes on a grid, as numbers.
//!
//! Shapes are mass-normalised: phi' M phi = 1 over all that moves, masses and ERAs included, so that their unit is kg^-1/2 and
//! a force of 1 N at a point a with loss factor eta moves the point b of a mode alone by phi_a phi_b / (eta omega^2) at its
//! resonance. That leaves the sign open, and of modes at one frequency any rotation among them. Here the shape's largest value on
//! the grid is positive (of equally large ones that of the first point, row by row). Of modes at one frequency the first is
//! the one that is as large as any of them can be anywhere; the others vanish there, and are chosen among themselves in the same way.

use crate::model::bounded::BoundedAnswer;
use crate::model::{Bound, ModelError, PanelMode};
use crate::scene::Scene;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;
use std::fmt::Write;

/// Relative distance of frequencies that count as one: within what the iteration leaves shapes are mixed at will.
const ONE_FREQUENCY: f64 = 1e-6;
/// Relative difference of a frequency that is computed twice, beyond which it is another mode's.
const ANOTHER: f64 = 1e-4;
/// Part by which a value must be larger to count as larger: places that symmetry makes equal differ by rounding.
const LARGER: f64 = 1e-6;

/// Shapes of modes at the points of a grid.
#[derive(Clone, Debug)]
pub struct ModeShapes {
    /// Columns in m.
    pub x_m: Vec<f64>,
    /// Rows in m.
    pub y_m: Vec<f64>,
    /// Frequency of each mode in Hz.
    pub frequencies_hz: Vec<f64>,
    /// Bound on each frequency's relative error.
    pub bounds: Vec<Bound>,
    /// In kg^-1/2, points (row by row, x first) x modes; NaN in cut-outs.
    pub shapes: DMatrix<f64>,
}

impl ModeShapes {
    /// The shapes of the modes that were found up to `max_hz`, on the grid of columns `x_m` and rows `y_m`.
    ///
    /// # Errors
    /// [`ModelError`]: the finest level's modes cannot be computed again.
    pub fn compute(
        scene: &Scene,
        found: &BoundedAnswer<Vec<PanelMode>>,
        max_hz: f64,
        (x_m, y_m): (Vec<f64>, Vec<f64>),
    ) -> Result<Self, ModelError> {
        let frequencies_hz: Vec<f64> = found.answer.iter().map(|mode| mode.frequency_hz).collect();
        // Its coordinates are the modes, ascending, and then shapes of higher frequencies.
        let reduced = found.model.reduce_with_residual_shapes_of_actuators_damping_and_points(max_hz, &[])?;
        let again = reduced.lambda.iter().map(|lambda| lambda.sqrt() / TAU).zip(&frequencies_hz);
        if again.filter(|(again, hz)| (again - *hz).abs() <= ANOTHER * *hz).count() != frequencies_hz.len() {
            return Err(ModelError::NotConverged { max_hz, vectors: reduced.count_coordinates() });
        }
        let mut shapes = reduced.shape_deflections_on_grid(&x_m, &y_m).columns(0, frequencies_hz.len()).into_owned();
        let layout = scene.layout();
        let points = y_m.iter().flat_map(|y| x_m.iter().map(move |x| (*x, *y)));
        for (mut row, (x, y)) in shapes.row_iter_mut().zip(points) {
            if layout.layer_at_unless_cut_out(x, y).is_none() {
                row.fill(f64::NAN);
            }
        }
        let mut first = 0;
        for hz in frequencies_hz.chunk_by(|a, b| b - a <= ONE_FREQUENCY * b) {
            normalise_signs_and_rotations_of_equal_modes(&mut shapes, first, hz.len());
            first += hz.len();
        }
        Ok(Self { x_m, y_m, frequencies_hz, bounds: found.bounds.clone(), shapes })
    }

    /// All values, `[mode][row][column]`.
    pub fn iter_values_of_all_modes(&self) -> impl Iterator<Item = f64> {
        self.shapes.iter().copied()
    }

    /// Lines of `mode,frequency_hz,error_bound,x_mm,y_mm,shape_per_sqrt_kg`, one for each mode and point, the last one empty in cut-outs.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = String::from("mode,frequency_hz,error_bound,x_mm,y_mm,shape_per_sqrt_kg\n");
        for (mode, (hz, bound)) in self.frequencies_hz.iter().zip(&self.bounds).enumerate() {
            let bound = bound.limit_if_known().map_or_else(String::new, |bound| format!("{bound:.2e}"));
            let points = self.y_m.iter().flat_map(|y| self.x_m.iter().map(move |x| (x * 1e3, y * 1e3)));
            for ((x, y), value) in points.zip(self.shapes.column(mode).iter()) {
                let value = if value.is_nan() { String::new() } else { format!("{value:.6e}") };
                let _ = writeln!(text, "{},{hz:.6},{bound},{x:.6},{y:.6},{value}", mode + 1);
            }
        }
        text
    }
}

/// Signs and rotations of `count` columns from `first` on, which are modes of one frequency.
fn normalise_signs_and_rotations_of_equal_modes(shapes: &mut DMatrix<f64>, first: usize, count: usize) {
    for from in first..first + count {
        let mut left = shapes.columns_mut(from, first + count - from);
        // Where the modes that are left can be largest, and how: a unit vector over them.
        let mut largest: Option<(f64, DVector<f64>)> = None;
        for row in left.row_iter() {
            let size = row.norm();
            if size > largest.as_ref().map_or(0.0, |(most, _)| most * (1.0 + LARGER)) {
                largest = Some((size, row.transpose() / size));
            }
        }
        let Some((_, direction)) = largest else { return };
        // The reflection that takes the direction to the first axis, and the first axis to it.
        let mut normal = -direction;
        normal[0] += 1.0;
        let square = normal.norm_squared();
        if square > 0.0 {
            let along: DVector<f64> = &left * &normal;
            for (i, mut column) in left.column_iter_mut().enumerate() {
                column.axpy(-2.0 * normal[i] / square, &along, 1.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A single mode: its sign alone, by the first of equally large values; holes do not count.
    #[test]
    fn the_largest_value_is_positive() {
        let mut shapes = DMatrix::from_column_slice(4, 1, &[f64::NAN, -2.0, 0.5, 2.0 + 1e-9]);
        normalise_signs_and_rotations_of_equal_modes(&mut shapes, 0, 1);
        assert!(shapes[0].is_nan() && (shapes[1] - 2.0).abs() < 1e-12 && (shapes[3] + 2.0).abs() < 1e-8, "{shapes}");
    }

    /// Whatever rotation of a pair comes in, the same goes out, and the mode before and after stay as they are.
    #[test]
    fn pairs_are_turned_to_the_same_place() {
        let exact = [[1.0, 0.2, -0.4, 0.1], [0.0, 0.7, 0.9, -0.3]];
        let turned = |angle: f64, mirrored: f64| {
            let (sin, cos) = angle.sin_cos();
            let one: Vec<f64> = (0..4).map(|i| cos * exact[0][i] - sin * exact[1][i]).collect();
            let two: Vec<f64> = (0..4).map(|i| mirrored * (sin * exact[0][i] + cos * exact[1][i])).collect();
            let mut shapes = DMatrix::from_column_slice(4, 4, &[&[-1.0; 4], &one[..], &two[..], &[-1.0; 4]].concat());
            normalise_signs_and_rotations_of_equal_modes(&mut shapes, 1, 2);
            shapes
        };
        let first = turned(0.0, 1.0);
        for (angle, mirrored) in [(0.3, 1.0), (2.9, -1.0), (-1.2, -1.0), (1.6, 1.0)] {
            let other = turned(angle, mirrored);
            assert!((&other - &first).amax() < 1e-12, "{angle}: {other} {first}");
        }
        // Largest together at the first point: 1.0 against 0.98 at the third.
        assert!((first[(0, 1)] - 1.0).abs() < 1e-12 && first[(0, 2)].abs() < 1e-12, "{first}");
        assert!(first.column(2).amax() == first.column(2).max() && first[(0, 0)] == -1.0, "{first}");
    }
}
