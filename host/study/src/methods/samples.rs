//! Points that are known beforehand: grids, Latin hypercubes, Sobol's sequence.

use crate::space::{CubeDimension, draw_latin_hypercube};
use crate::spec::{PointMethod, StudyMethod};
use era_model::scene::random::RandomSequence;
use sobol::params::JoeKuoD6;
use sobol::{Sobol, SobolType};
use std::ops::Range;

/// A stream of random numbers of its own.
const STREAM: u64 = 0x5a3;

/// Dimensions that Sobol's sequence is known for.
pub const MOST_SOBOL: usize = 1000;
/// Bits of its coordinates.
const BITS: usize = <f64 as SobolType>::MAX_RESOLUTION;

/// All points of a study.
#[derive(Clone, Debug)]
pub enum KnownPoints {
    /// All combinations; the last dimension goes fastest.
    Grid {
        /// The values of each dimension.
        levels: Vec<Vec<f64>>,
    },
    /// Every point, as they depend on each other.
    Listed(Vec<Vec<f64>>),
    /// Sobol's sequence, shifted.
    Sobol {
        /// How many.
        count: usize,
        /// Of each dimension the direction numbers, by bit.
        directions: Vec<Vec<u64>>,
        /// What is added to each coordinate, modulo 1 (Cranley and Patterson 1976); zeros for the sequence itself.
        shift: Vec<f64>,
    },
}

impl KnownPoints {
    /// The points of a method; `None` for one whose points depend on results.
    #[must_use]
    pub fn new(method: &StudyMethod, dimensions: &[CubeDimension]) -> Option<Self> {
        let mut random = RandomSequence::new(method.seed, STREAM);
        match method.way {
            PointMethod::Grid => {
                let of = |dimension: &CubeDimension| coordinates_of_grid_levels(dimension, method.levels);
                Some(Self::Grid { levels: dimensions.iter().map(of).collect() })
            }
            PointMethod::LatinHypercube => {
                Some(Self::Listed(draw_latin_hypercube(dimensions.len(), method.designs, &mut random)))
            }
            PointMethod::Sobol => {
                let shift = |_| if method.seed == 0 { 0.0 } else { random.next_unit_number() };
                let shift: Vec<f64> = (0..dimensions.len()).map(shift).collect();
                Some(Self::from_shifted_sobol_sequence(method.designs, shift))
            }
            PointMethod::Evolution => None,
        }
    }

    /// Sobol's sequence with what is added to each coordinate; beyond [`MOST_SOBOL`] dimensions there is none.
    fn from_shifted_sobol_sequence(count: usize, shift: Vec<f64>) -> Self {
        let directions = Sobol::<f64>::init_direction_vals(shift.len(), BITS, &JoeKuoD6::standard());
        Self::Sobol { count, directions, shift }
    }

    /// How many there are; more than can be counted is the largest number.
    #[must_use]
    pub fn count_all_points_of_study(&self) -> usize {
        match self {
            Self::Grid { levels } => levels.iter().fold(1_usize, |count, own| count.saturating_mul(own.len())),
            Self::Listed(points) => points.len(),
            Self::Sobol { count, .. } => *count,
        }
    }

    /// Some of them.
    #[must_use]
    pub fn points_in_range(&self, range: Range<usize>) -> Vec<Vec<f64>> {
        match self {
            Self::Grid { levels } => range.map(|index| grid_point_at_index(levels, index)).collect(),
            Self::Listed(points) => points.get(range).map(<[_]>::to_vec).unwrap_or_default(),
            Self::Sobol { directions, shift, .. } => {
                let coordinate = |index: usize, (own, shift): (&Vec<u64>, &f64)| {
                    (<f64 as SobolType>::render(sobol_coordinate_bits(own, index)) + shift).fract()
                };
                range.map(|index| directions.iter().zip(shift).map(|both| coordinate(index, both)).collect()).collect()
            }
        }
    }
}

/// How many designs a method looks at, before any is listed; more than can be counted is the largest number.
#[must_use]
pub fn count_designs_of_method(method: &StudyMethod, dimensions: &[CubeDimension]) -> usize {
    match method.way {
        PointMethod::Grid => dimensions.iter().fold(1_usize, |count, own| {
            count.saturating_mul(count_grid_levels_own_or_all_values_or_default(own, method.levels))
        }),
        PointMethod::LatinHypercube | PointMethod::Sobol | PointMethod::Evolution => method.designs,
    }
}

/// How many values of a dimension are on a grid.
fn count_grid_levels_own_or_all_values_or_default(dimension: &CubeDimension, default_level_count: usize) -> usize {
    match dimension.count {
        Some(count) => dimension.levels.unwrap_or(count).min(count),
        None => dimension.levels.unwrap_or(default_level_count),
    }
}

/// The values of a dimension on a grid: both ends, and evenly between them; of what can be counted all, or as many as asked for.
#[expect(clippy::cast_precision_loss, reason = "small counts")]
fn coordinates_of_grid_levels(dimension: &CubeDimension, default_level_count: usize) -> Vec<f64> {
    match dimension.count {
        // The middle of what stands for each.
        Some(count) => {
            let chosen = count_grid_levels_own_or_all_values_or_default(dimension, default_level_count);
            let last = chosen.saturating_sub(1).max(1);
            (0..chosen).map(|k| (((k * (count - 1)) as f64 / last as f64).round() + 0.5) / count as f64).collect()
        }
        None => era_model::scene::equidistant_numbers(
            0.0,
            1.0,
            count_grid_levels_own_or_all_values_or_default(dimension, default_level_count),
        ),
    }
}

/// A point's coordinate by the bits of its index's Gray code (Antonov and Saleev 1979): any point, without those before it.
fn sobol_coordinate_bits(directions: &[u64], index: usize) -> u64 {
    let code = index ^ (index >> 1);
    directions.iter().enumerate().filter(|(bit, _)| code >> bit & 1 == 1).fold(0, |sum, (_, direction)| sum ^ direction)
}

fn grid_point_at_index(levels: &[Vec<f64>], index: usize) -> Vec<f64> {
    let mut rest = index;
    let mut point = vec![0.0; levels.len()];
    for (value, own) in point.iter_mut().zip(levels).rev() {
        *value = own[rest % own.len()];
        rest /= own.len();
    }
    point
}

#[cfg(test)]
mod tests {
    use super::*;

    fn make_cube_dimension(count: Option<usize>, levels: Option<usize>) -> CubeDimension {
        CubeDimension { variable: 0, name: String::new(), count, levels }
    }

    /// The strata are counted.
    #[test]
    fn a_latin_hypercube_has_a_point_in_every_part_of_every_dimension() {
        for count in [1, 2, 7, 64] {
            let points = draw_latin_hypercube(3, count, &mut RandomSequence::new(5, 1));
            for d in 0..3 {
                let mut hits = vec![0; count];
                points.iter().for_each(|point| hits[(point[d] * count as f64).floor() as usize] += 1);
                assert!(hits.iter().all(|hits| *hits == 1), "{count} {d}: {hits:?}");
            }
        }
        let orders: Vec<Vec<usize>> = (0..2)
            .map(|d| {
                let points = draw_latin_hypercube(2, 50, &mut RandomSequence::new(5, 1));
                let mut order: Vec<usize> = (0..50).collect();
                order.sort_by(|a, b| points[*a][d].total_cmp(&points[*b][d]));
                order
            })
            .collect();
        assert_ne!(orders[0], orders[1]);
    }

    /// The first points as Joe and Kuo's own program (new-joe-kuo-6.21201) prints them, its origin included.
    #[test]
    fn sobols_sequence_begins_as_published() {
        let samples = KnownPoints::from_shifted_sobol_sequence(10, vec![0.0; 3]);
        let published = [
            [0.0, 0.0, 0.0],
            [0.5, 0.5, 0.5],
            [0.75, 0.25, 0.25],
            [0.25, 0.75, 0.75],
            [0.375, 0.375, 0.625],
            [0.875, 0.875, 0.125],
            [0.625, 0.125, 0.875],
            [0.125, 0.625, 0.375],
            [0.1875, 0.3125, 0.9375],
            [0.6875, 0.8125, 0.4375],
        ];
        assert_eq!(samples.points_in_range(0..10), published);
        assert_eq!(samples.points_in_range(7..9), published[7..9]);
        // The library's own sequence, one point after the other.
        let ones: Vec<Vec<f64>> = Sobol::<f64>::new(7, &JoeKuoD6::standard()).take(5000).collect();
        assert_eq!(KnownPoints::from_shifted_sobol_sequence(5000, vec![0.0; 7]).points_in_range(0..5000), ones);
    }

    #[test]
    fn a_shift_moves_all_points_around_the_cube() {
        let samples = KnownPoints::from_shifted_sobol_sequence(4, vec![0.3, 0.0]);
        let firsts: Vec<f64> = samples.points_in_range(0..4).into_iter().map(|point| point[0]).collect();
        for (found, wanted) in firsts.iter().zip([0.3, 0.8, 0.05, 0.55]) {
            assert!((found - wanted).abs() < 1e-12, "{firsts:?}");
        }
    }

    #[test]
    fn a_grid_has_all_combinations() {
        let dimensions = [make_cube_dimension(None, Some(3)), make_cube_dimension(Some(2), None)];
        let of = |dimension: &CubeDimension| coordinates_of_grid_levels(dimension, 5);
        let samples = KnownPoints::Grid { levels: dimensions.iter().map(of).collect() };
        assert_eq!(samples.count_all_points_of_study(), 6);
        let wanted = [[0.0, 0.25], [0.0, 0.75], [0.5, 0.25], [0.5, 0.75], [1.0, 0.25], [1.0, 0.75]];
        assert_eq!(samples.points_in_range(0..6), wanted);
        assert_eq!(coordinates_of_grid_levels(&make_cube_dimension(None, None), 5).len(), 5);
        assert_eq!(coordinates_of_grid_levels(&make_cube_dimension(Some(5), Some(3)), 5), [0.1, 0.5, 0.9]);
    }
}
