//! The zone that counts as "at the target": the surface within 10 mm of it.

use super::disc_quadrature::quadrature_points_around_each_target;
use crate::physics::PerPair;
use crate::request::Target;
use crate::request::y_or_bar_axis_y_m;
use crate::scene::MAX_ACTUATORS;
use crate::table::{PlanTable, acceleration_at_point_from_coordinates};
use era_model::kernel;
use nalgebra::DVector;
use num_complex::Complex64;
use pulp::Arch;

/// Largest part of the surface that targets take: discs may cover a small surface whole; some of it is always "elsewhere".
const MAX_FRACTION: f64 = 0.9;

/// The targets and the surface around them.
#[derive(Clone, Debug)]
pub struct TargetZone {
    /// Mode shapes at the targets.
    pub targets: Vec<DVector<f64>>,
    /// Mode shapes at the points of a quadrature over the targets' discs, with weights that add up to 1.
    points: Vec<(DVector<f64>, f64)>,
    /// Part of the surface that the discs cover.
    pub part: f64,
}

impl TargetZone {
    /// The zone of `targets`, which lie on the surface.
    #[must_use]
    pub fn new(table: &PlanTable, targets: &[Target]) -> Self {
        let shapes: Vec<DVector<f64>> = targets
            .iter()
            .map(|target| table.model.shape_deflections_at(target.x_m, y_or_bar_axis_y_m(table, target.y_m)))
            .collect();
        let places: Vec<(f64, f64)> =
            targets.iter().map(|target| (target.x_m, y_or_bar_axis_y_m(table, target.y_m))).collect();
        let mut points = Vec::with_capacity(7 * targets.len());
        let mut area = 0.0;
        for ((own, place), shape) in quadrature_points_around_each_target(&table.scene, &places, table.wave_m)
            .into_iter()
            .zip(&places)
            .zip(&shapes)
        {
            for (x, y, weight) in own {
                area += weight;
                let shape = if (x, y) == *place { shape.clone() } else { table.model.shape_deflections_at(x, y) };
                points.push((shape, weight));
            }
        }
        let sum: f64 = points.iter().map(|(_, weight)| weight).sum();
        for (_, weight) in &mut points {
            *weight /= sum;
        }
        Self {
            targets: shapes,
            points,
            part: (area / table.scene.surface_area_less_cutouts_ignoring_bar_steps_m2()).min(MAX_FRACTION),
        }
    }

    /// Mode shapes at the points of the quadrature, and their weights.
    pub fn quadrature_shapes_and_weights(&self) -> Vec<(&DVector<f64>, f64)> {
        self.points.iter().map(|(shape, weight)| (shape, *weight)).collect()
    }

    /// Mean square over the zone of an acceleration with these coordinates.
    #[must_use]
    pub fn mean_square_over_zone(&self, acceleration: &DVector<Complex64>) -> f64 {
        Arch::new().dispatch(MeanSquare(&self.points, acceleration))
    }

    /// Means over the zone of conj(a_i) a_j for several motions.
    #[must_use]
    pub fn mean_products_over_zone(&self, accelerations: &[&DVector<Complex64>]) -> PerPair {
        let mut sums = [[Complex64::ZERO; MAX_ACTUATORS]; MAX_ACTUATORS];
        for (shape, weight) in &self.points {
            let mut at = [Complex64::ZERO; MAX_ACTUATORS];
            at.iter_mut()
                .zip(accelerations)
                .for_each(|(at, acceleration)| *at = acceleration_at_point_from_coordinates(shape, acceleration));
            for (row, a) in sums.iter_mut().zip(&at) {
                for (sum, b) in row.iter_mut().zip(&at) {
                    *sum += a.conj() * b * *weight;
                }
            }
        }
        sums
    }

    /// Mean over the zone of the magnitude of an acceleration with these coordinates.
    #[must_use]
    pub fn mean_magnitude_over_zone(&self, acceleration: &DVector<Complex64>) -> f64 {
        self.points
            .iter()
            .map(|(shape, weight)| acceleration_at_point_from_coordinates(shape, acceleration).norm() * weight)
            .sum()
    }

    /// Mean square over the rest of the surface of a motion whose mean square is `zone` in the zone and `whole_surface` over
    /// the whole surface.
    #[must_use]
    pub fn mean_square_elsewhere(&self, whole_surface: f64, zone: f64) -> f64 {
        // The difference may round to nothing on a surface that is all target; it stays positive.
        ((whole_surface - self.part * zone) / (1.0 - self.part)).max(1e-9 * whole_surface).max(f64::MIN_POSITIVE)
    }
}

kernel!(MeanSquare<'a>(points: &'a [(DVector<f64>, f64)], acceleration: &'a DVector<Complex64>) -> f64 = mean_squared_acceleration_over_points);

#[inline(always)]
fn mean_squared_acceleration_over_points(
    shapes_and_weights: &[(DVector<f64>, f64)],
    acceleration: &DVector<Complex64>,
) -> f64 {
    let mut sum = 0.0;
    for (shape, weight) in shapes_and_weights {
        sum += acceleration_at_point_from_coordinates(shape, acceleration).norm_sqr() * weight;
    }
    sum
}
