//! What counts as "at the target": the surface within 10 mm of it.

use super::TARGET_RADIUS_M;
use super::phased::PerPair;
use super::request::Target;
use super::table::{PlanTable, at_point};
use crate::scene::MAX_ACTUATORS;
use crate::scene::SurfaceKind;
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::PI;

/// Gauss-Legendre points and weights on -1 to 1, five of them: exact for polynomials of degree 9.
const GAUSS_5: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189),
    (-0.538_469_310_105_683, 0.478_628_670_499_366),
    (0.0, 0.568_888_888_888_889),
    (0.538_469_310_105_683, 0.478_628_670_499_366),
    (0.906_179_845_938_664, 0.236_926_885_056_189),
];
/// Four of them: degree 7.
const GAUSS_4: [(f64, f64); 4] = [
    (-0.861_136_311_594_053, 0.347_854_845_137_454),
    (-0.339_981_043_584_856, 0.652_145_154_862_546),
    (0.339_981_043_584_856, 0.652_145_154_862_546),
    (0.861_136_311_594_053, 0.347_854_845_137_454),
];
/// Three of them: degree 5, as much as the rule of whole discs.
const GAUSS_3: [(f64, f64); 3] = [
    (-0.774_596_669_241_483, 0.555_555_555_555_556),
    (0.0, 0.888_888_888_888_889),
    (0.774_596_669_241_483, 0.555_555_555_555_556),
];
/// Largest part of the surface that targets take: discs may overlap or cover a small surface whole; some of it is always
/// "elsewhere".
const MOST_PART: f64 = 0.9;

/// The targets and the points around them.
#[derive(Clone, Debug)]
pub struct Zone {
    /// Mode shapes at the targets.
    pub targets: Vec<DVector<f64>>,
    /// Mode shapes at the points of a quadrature over the targets' discs, with weights that add up to 1.
    points: Vec<(DVector<f64>, f64)>,
    /// Part of the surface that the discs cover.
    pub part: f64,
}

impl Zone {
    /// The zone of `targets`, which lie on the surface.
    #[must_use]
    pub fn new(table: &PlanTable, targets: &[Target]) -> Self {
        let shapes: Vec<DVector<f64>> =
            targets.iter().map(|target| table.model.shape_at(target.x_m, table.y_m(target.y_m))).collect();
        let mut points = Vec::with_capacity(7 * targets.len());
        let mut area = 0.0;
        for (target, shape) in targets.iter().zip(&shapes) {
            let (x, y) = (target.x_m, table.y_m(target.y_m));
            let own = match table.scene.surface.kind {
                SurfaceKind::Plate => disc(table, x, y),
                SurfaceKind::Bar => segment(table, x, y),
            };
            // On a surface smaller than the rule's least distance only the target itself is left.
            if own.is_empty() {
                points.push((shape.clone(), f64::MIN_POSITIVE));
            }
            for (dx, dy, weight) in own {
                area += weight;
                let at_target = dx == 0.0 && dy == 0.0;
                let shape = if at_target { shape.clone() } else { table.model.shape_at(x + dx, y + dy) };
                points.push((shape, weight));
            }
        }
        let sum: f64 = points.iter().map(|(_, weight)| weight).sum();
        for (_, weight) in &mut points {
            *weight /= sum;
        }
        Self { targets: shapes, points, part: (area / table.scene.area_m2()).min(MOST_PART) }
    }

    /// Mode shapes at the points of the quadrature, and their weights.
    pub fn points(&self) -> Vec<(&DVector<f64>, f64)> {
        self.points.iter().map(|(shape, weight)| (shape, *weight)).collect()
    }

    /// Mean over the zone of |acceleration|^2.
    #[must_use]
    pub fn mean_square(&self, acceleration: &DVector<Complex64>) -> f64 {
        self.points.iter().map(|(shape, weight)| at_point(shape, acceleration).norm_sqr() * weight).sum()
    }

    /// Means over the zone of conj(a_i) a_j, for several motions.
    #[must_use]
    pub fn products(&self, accelerations: &[&DVector<Complex64>]) -> PerPair {
        let mut sums = [[Complex64::ZERO; MAX_ACTUATORS]; MAX_ACTUATORS];
        for (shape, weight) in &self.points {
            let mut at = [Complex64::ZERO; MAX_ACTUATORS];
            at.iter_mut().zip(accelerations).for_each(|(at, acceleration)| *at = at_point(shape, acceleration));
            for (row, a) in sums.iter_mut().zip(&at) {
                for (sum, b) in row.iter_mut().zip(&at) {
                    *sum += a.conj() * b * *weight;
                }
            }
        }
        sums
    }

    /// Mean over the zone of |acceleration|.
    #[must_use]
    pub fn mean(&self, acceleration: &DVector<Complex64>) -> f64 {
        self.points.iter().map(|(shape, weight)| at_point(shape, acceleration).norm() * weight).sum()
    }

    /// Mean square over the rest of the surface, of what has a mean square of `near` here and one of `all` over the whole.
    #[must_use]
    pub fn elsewhere(&self, all: f64, near: f64) -> f64 {
        // The difference may round to nothing on a surface that is all target; it stays positive.
        ((all - self.part * near) / (1.0 - self.part)).max(1e-9 * all).max(f64::MIN_POSITIVE)
    }
}

/// Distances from the centre and areas. Whole discs: seven points, exact for polynomials of degree 5 (Abramowitz and
/// Stegun 25.4.61), which is degree 2 of the motion's; ones that an edge cuts, or a cut-out: Gauss' rule in each rectangle of the
/// surface, in strips between the places where the circle crosses its top and bottom, along each one more point as the
/// chords' lengths vary, and across.
fn disc(table: &PlanTable, x: f64, y: f64) -> Vec<(f64, f64, f64)> {
    let r = TARGET_RADIUS_M;
    let (length, width) = (table.scene.surface.length_m, table.scene.surface.width_m);
    let is_whole = x >= r && y >= r && x + r <= length && y + r <= width && table.scene.cutouts.is_empty();
    if is_whole {
        let area = PI * r * r;
        let ring = (0..6).map(|k| {
            let (sin, cos) = (PI / 3.0 * f64::from(k)).sin_cos();
            let radius = r * (2.0_f64 / 3.0).sqrt();
            (radius * cos, radius * sin, area / 8.0)
        });
        return std::iter::once((0.0, 0.0, area / 4.0)).chain(ring).collect();
    }
    let mut points = Vec::with_capacity(3 * GAUSS_4.len() * GAUSS_3.len());
    if table.scene.cutouts.is_empty() {
        in_rectangle(&mut points, (-x, length - x), (-y, width - y));
        return points;
    }
    let layout = table.scene.layout();
    for rows in layout.y_m().windows(2) {
        for columns in layout.x_m().windows(2) {
            if layout.at(0.5 * (columns[0] + columns[1]), 0.5 * (rows[0] + rows[1])).is_some() {
                in_rectangle(&mut points, (columns[0] - x, columns[1] - x), (rows[0] - y, rows[1] - y));
            }
        }
    }
    points
}

/// Adds those in a rectangle, whose sides are relative to the disc's centre.
fn in_rectangle(points: &mut Vec<(f64, f64, f64)>, (left, right): (f64, f64), (bottom, top): (f64, f64)) {
    let r = TARGET_RADIUS_M;
    let (left, right) = (left.max(-r), right.min(r));
    let crossings = [bottom, top].into_iter().filter(|edge| edge.abs() < r).flat_map(|edge| {
        let along = (r * r - edge * edge).sqrt();
        [-along, along]
    });
    let mut cuts: Vec<f64> = crossings.filter(|along| left < *along && *along < right).chain([left, right]).collect();
    cuts.sort_by(f64::total_cmp);
    for ends in cuts.windows(2) {
        // x = r sin(angle): the chords' ends are smooth in the angle.
        let (from, to) = ((ends[0] / r).clamp(-1.0, 1.0).asin(), (ends[1] / r).clamp(-1.0, 1.0).asin());
        for (u, u_weight) in GAUSS_4 {
            let angle = 0.5 * (from + to) + 0.5 * (to - from) * u;
            let (dx, half) = (r * angle.sin(), r * angle.cos());
            let (low, high) = ((-half).max(bottom), half.min(top));
            for (v, v_weight) in GAUSS_3 {
                let dy = 0.5 * (low + high) + 0.5 * (high - low) * v;
                let weight = 0.25 * u_weight * v_weight * (to - from) * (high - low) * half;
                if to > from && high > low {
                    points.push((dx, dy, weight));
                }
            }
        }
    }
}

/// The same along a bar, across which nothing changes.
fn segment(table: &PlanTable, x: f64, y: f64) -> Vec<(f64, f64, f64)> {
    let (length, width) = (table.scene.surface.length_m, table.scene.surface.width_m);
    let layout = table.scene.layout();
    let (from, to) = ((-TARGET_RADIUS_M).max(-x), TARGET_RADIUS_M.min(length - x));
    GAUSS_5
        .into_iter()
        .map(|(u, weight)| (0.5 * (from + to) + 0.5 * (to - from) * u, 0.0, 0.5 * weight * (to - from) * width))
        .filter(|(dx, _, weight)| *weight > 0.0 && layout.at(x + dx, y).is_some())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Area and second moments of a disc that a corner cuts, against many midpoints: what a rule over chords that are cut has
    /// to be in strips for.
    #[test]
    fn a_disc_that_edges_cut_is_integrated() {
        let r = TARGET_RADIUS_M;
        for (x, y) in [(0.0, 0.0), (0.3 * r, 0.7 * r), (0.9 * r, 2.0 * r), (2.0 * r, 0.02 * r)] {
            let (width, height) = (1.5 * r, 3.0 * r);
            let mut points = Vec::new();
            in_rectangle(&mut points, (-x, width - x), (-y, height - y));
            let of = |points: &[(f64, f64, f64)], moment: &dyn Fn(f64, f64) -> f64| -> f64 {
                points.iter().map(|(dx, dy, weight)| weight * moment(*dx, *dy)).sum()
            };
            let steps = 1000;
            let step = 2.0 * r / f64::from(steps);
            let middle = |k: i32| -r + (f64::from(k) + 0.5) * step;
            let many: Vec<(f64, f64, f64)> = (0..steps)
                .flat_map(|i| (0..steps).map(move |j| (middle(i), middle(j), step * step)))
                .filter(|(dx, dy, _)| dx * dx + dy * dy < r * r)
                .filter(|(dx, dy, _)| (-x..width - x).contains(dx) && (-y..height - y).contains(dy))
                .collect();
            let moments: [&dyn Fn(f64, f64) -> f64; 3] =
                [&|_, _| 1.0, &|dx, dy| (dx / r + 1.0) * (dy / r + 1.0), &|dx, dy| (dx * dx + dy * dy) / (r * r)];
            for (k, moment) in moments.into_iter().enumerate() {
                let (found, wanted) = (of(&points, moment), of(&many, moment));
                assert!((found - wanted).abs() < 2e-3 * wanted.abs(), "{k} at {x}, {y}: {found} for {wanted}");
            }
        }
    }
}
