//! How much of a motion is that of a rigid body: such a motion of a held panel has few nodes, or none.

use crate::reach::setting::sum_acceleration_coordinates_at_frequency_if_first_used_by;
use crate::table::ActuatorSetting;
use crate::table::{PlanTable, SurfaceGrid};
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Fraction of a mode's mean square below which it counts as bending.
const MOSTLY: f64 = 0.5;

/// Translation and the two rotations over a grid, made orthonormal by Gram and Schmidt's method under the grid's weights. A
/// bar, a line of points, has one rotation.
struct RigidMotions<'a> {
    grid: &'a SurfaceGrid,
    motions: Vec<Vec<f64>>,
}

impl<'a> RigidMotions<'a> {
    fn new(grid: &'a SurfaceGrid) -> Self {
        let columns = grid.x_m.len().max(1);
        let at = |of: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
            (0..grid.weights.len()).map(|point| of(grid.x_m[point % columns], grid.y_m[point / columns])).collect()
        };
        let mut rigid = Self { grid, motions: Vec::new() };
        for mut motion in [at(&|_, _| 1.0), at(&|x, _| x), at(&|_, y| y)] {
            let whole = rigid.area_weighted_mean_product_of_grid_values(&motion, &motion);
            for before in &rigid.motions {
                let part = rigid.area_weighted_mean_product_of_grid_values(&motion, before);
                motion.iter_mut().zip(before).for_each(|(value, before)| *value -= part * before);
            }
            let rest = rigid.area_weighted_mean_product_of_grid_values(&motion, &motion);
            if rest > 1e-9 * whole {
                let scale = 1.0 / rest.sqrt();
                motion.iter_mut().for_each(|value| *value *= scale);
                rigid.motions.push(motion);
            }
        }
        rigid
    }

    fn area_weighted_mean_product_of_grid_values(&self, values_a: &[f64], values_b: &[f64]) -> f64 {
        values_a.iter().zip(values_b).zip(&self.grid.weights).map(|((a, b), weight)| a * b * weight).sum()
    }

    /// Mean squares over the surface of a field's rigid part and of all of it.
    fn rigid_and_total_mean_squares(&self, field: &[Complex64]) -> [f64; 2] {
        let part = |motion: &Vec<f64>| {
            let terms = field.iter().zip(motion).zip(&self.grid.weights);
            terms.map(|((z, motion), weight)| z * *motion * *weight).sum::<Complex64>().norm_sqr()
        };
        let all = field.iter().zip(&self.grid.weights).map(|(z, weight)| z.norm_sqr() * weight).sum();
        [self.motions.iter().map(part).sum(), all]
    }
}

/// Part of a setting's mean square acceleration, its frequencies added up, that is motion as a rigid body; `None` where
/// nothing moves.
#[must_use]
pub fn rigid_fraction_of_mean_square_unless_at_rest(table: &PlanTable, setting: &[ActuatorSetting]) -> Option<f64> {
    let rigid = RigidMotions::new(&table.grid);
    let mut sums = [0.0; 2];
    for number in 0..setting.len() {
        if let Some(coordinates) = sum_acceleration_coordinates_at_frequency_if_first_used_by(table, setting, number) {
            let squares = rigid.rigid_and_total_mean_squares(&table.grid.evaluate_at_each_grid_point(&coordinates));
            sums.iter_mut().zip(squares).for_each(|(sum, square)| *sum += square);
        }
    }
    (sums[1] > 0.0).then(|| (sums[0] / sums[1]).min(1.0))
}

/// Frequency in Hz of the first mode, of those that the actuators move, whose motion is mostly bending.
#[must_use]
pub fn first_bending_mode_moving_surface_if_any_hz(table: &PlanTable) -> Option<f64> {
    list_modes_moving_surface_as_rigid_or_bending(table).into_iter().find(|mode| mode.bends).map(|mode| mode.hz)
}

/// Frequency in Hz of the last mode, of those that the actuators move, whose motion is mostly that of a rigid body; `None` where
/// there is none.
#[must_use]
pub fn last_rigid_mode_moving_surface_if_any_hz(table: &PlanTable) -> Option<f64> {
    list_modes_moving_surface_as_rigid_or_bending(table)
        .into_iter()
        .filter(|mode| !mode.bends)
        .map(|mode| mode.hz)
        .next_back()
}

/// A mode of which something is seen on the surface.
struct RigidOrBendingMode {
    hz: f64,
    /// Whether it is mostly bending.
    bends: bool,
}

fn list_modes_moving_surface_as_rigid_or_bending(table: &PlanTable) -> Vec<RigidOrBendingMode> {
    let rigid = RigidMotions::new(&table.grid);
    let shapes = table.grid.shapes.column_iter();
    let bends = |shape: &[f64]| {
        let [part, all] =
            rigid.rigid_and_total_mean_squares(&shape.iter().map(|value| Complex64::from(*value)).collect::<Vec<_>>());
        (all > 0.0).then_some(part < MOSTLY * all)
    };
    let modes = table.model.lambda.iter().zip(shapes);
    modes
        .filter_map(|(lambda, shape)| {
            Some(RigidOrBendingMode { hz: lambda.sqrt() / TAU, bends: bends(shape.as_slice())? })
        })
        .collect()
}
