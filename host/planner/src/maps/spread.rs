//! How values spread over a surface.

use crate::table::SurfaceGrid;
use serde::Serialize;

/// Least, most and quantiles by area of values on a grid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Least value.
    pub least: f64,
    /// Where, in mm.
    pub least_at_mm: [f64; 2],
    /// A tenth of the surface has less.
    pub tenth: f64,
    /// Half of it has less.
    pub median: f64,
    /// Largest value.
    pub most: f64,
    /// Where, in mm.
    pub most_at_mm: [f64; 2],
    /// Part of the surface with less than a tenth of the largest value.
    pub dead: f64,
}

/// Part of the largest value below which a place counts as dead: 20 dB less than the strongest.
const DEAD: f64 = 0.1;

impl Spread {
    /// Of values at the grid's points; `None` if there are none.
    #[must_use]
    pub fn compute(grid: &SurfaceGrid, values: &[Option<f64>]) -> Option<Self> {
        let mut sorted: Vec<(f64, usize)> =
            values.iter().enumerate().filter_map(|(point, value)| Some(((*value)?, point))).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (least, most) = (sorted.first()?, sorted.last()?);
        let weight = |point: usize| grid.weights.get(point).copied().unwrap_or(0.0);
        let whole: f64 = sorted.iter().map(|(_, point)| weight(*point)).sum();
        let quantile = |part: f64| {
            let mut sum = 0.0;
            let reached = sorted.iter().find(|(_, point)| {
                sum += weight(*point);
                sum >= part * whole
            });
            reached.unwrap_or(most).0
        };
        let columns = grid.x_m.len().max(1);
        let at_mm = |point: usize| [grid.x_m[point % columns] * 1e3, grid.y_m[point / columns] * 1e3];
        Some(Self {
            least: least.0,
            least_at_mm: at_mm(least.1),
            tenth: quantile(0.1),
            median: quantile(0.5),
            most: most.0,
            most_at_mm: at_mm(most.1),
            dead: area_fraction_below(grid, values, DEAD * most.0),
        })
    }
}

/// Part of the surface, of the points that have a value, with less than `level`.
#[must_use]
pub fn area_fraction_below(grid: &SurfaceGrid, values: &[Option<f64>], level: f64) -> f64 {
    let (mut whole, mut part) = (0.0, 0.0);
    for (value, weight) in values.iter().zip(&grid.weights).filter_map(|(value, weight)| Some(((*value)?, weight))) {
        whole += weight;
        part += if value < level { *weight } else { 0.0 };
    }
    if whole > 0.0 { part / whole } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_by_area() {
        let grid = SurfaceGrid {
            x_m: vec![0.0, 0.1, 0.2, 0.3],
            y_m: vec![0.0],
            shapes: nalgebra::DMatrix::zeros(4, 0),
            weights: vec![0.05, 0.15, 0.6, 0.2],
            there: vec![true; 4],
        };
        let spread = Spread::compute(&grid, &[Some(1.0), Some(2.0), Some(4.0), Some(3.0)]).unwrap();
        assert_eq!((spread.least, spread.tenth, spread.median, spread.most), (1.0, 2.0, 4.0, 4.0));
        assert_eq!((spread.least_at_mm, spread.most_at_mm), ([0.0, 0.0], [200.0, 0.0]));
        assert_eq!(spread.dead, 0.0);
        let dead = Spread::compute(&grid, &[Some(0.1), Some(0.5), Some(4.0), None]).unwrap().dead;
        assert!((dead - 0.05 / 0.8).abs() < 1e-12, "{dead}");
        assert!(Spread::compute(&grid, &[None; 4]).is_none());
    }
}
