//! How much each variable, and each pair of them, has to do with a figure: the analysis of variance of a factorial study, with
//! continuous variables cut into a few levels.

use crate::space::{CubeDimension, index_at_fraction};

/// Levels that a continuous variable, or one of many values, is cut into.
const LEVELS: usize = 5;
/// Values of a list, or counts, that have a level each.
const MOST_VALUES: usize = 24;
/// Coordinates of all designs together that have a level each, as a grid's.
const MOST_COORDINATES: usize = 9;

/// Effects on one figure.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectAnalysis {
    /// Designs that have the figure.
    pub count: usize,
    /// Its mean over them.
    pub mean: f64,
    /// Sum of the squared distances from that.
    pub squares: f64,
    /// Of each dimension.
    pub main: Vec<MainEffect>,
    /// Of each pair of dimensions, the first below the second.
    pub pairs: Vec<Interaction>,
}

/// What one dimension does.
#[derive(Clone, Debug, PartialEq)]
pub struct MainEffect {
    /// The dimension's number.
    pub dimension: usize,
    /// Its levels.
    pub cut: DimensionLevels,
    /// How many designs are in each level, and their mean.
    pub levels: Vec<(usize, Option<f64>)>,
    /// Part of the squares that lies between the levels.
    pub part: f64,
    /// Part that would by mere chance.
    pub by_chance: f64,
}

/// What two dimensions do together beyond what each does.
#[derive(Clone, Debug, PartialEq)]
pub struct Interaction {
    /// The dimensions' numbers.
    pub dimensions: [usize; 2],
    /// Mean in each pair of levels, levels of the first dimension after each other.
    pub means: Vec<Vec<Option<f64>>>,
    /// Part of the squares that lies between the pairs of levels, less that of either dimension.
    pub part: f64,
    /// Part that would by mere chance.
    pub by_chance: f64,
}

/// The levels of a dimension.
#[derive(Clone, Debug, PartialEq)]
pub struct DimensionLevels {
    /// A coordinate in each level, ascending: the one that all its designs have, or its middle.
    pub at: Vec<f64>,
    /// Whether the levels are those coordinates alone, and not equal parts of the range.
    is_exact: bool,
    /// Where what can be counted has more values than levels: how many.
    of: Option<usize>,
}

impl DimensionLevels {
    /// Few values have a level each: those of a list, or those that all designs together have. More are cut into equal parts.
    #[must_use]
    pub fn with_one_level_per_value_if_few_else_equal_parts(
        dimension: &CubeDimension,
        coordinates: impl Iterator<Item = f64>,
    ) -> Self {
        #[expect(clippy::cast_precision_loss, reason = "a few levels")]
        let middles = |count: usize| (0..count).map(|k| (k as f64 + 0.5) / count as f64).collect();
        if let Some(count) = dimension.count {
            let (levels, of) = if count <= MOST_VALUES { (count, None) } else { (LEVELS, Some(count)) };
            return Self { at: middles(levels), is_exact: false, of };
        }
        let mut known: Vec<f64> = Vec::new();
        for own in coordinates {
            if let Err(place) = known.binary_search_by(|other| other.total_cmp(&own)) {
                known.insert(place, own);
            }
            if known.len() > MOST_COORDINATES {
                return Self { at: middles(LEVELS), is_exact: false, of: None };
            }
        }
        Self { at: known, is_exact: true, of: None }
    }

    /// Number of levels.
    #[must_use]
    pub const fn count_levels(&self) -> usize {
        self.at.len()
    }

    /// The level that contains a coordinate.
    fn level_index_of_coordinate(&self, coordinate: f64) -> usize {
        match self.is_exact {
            true => {
                self.at.partition_point(|own| own.total_cmp(&coordinate).is_lt()).min(self.at.len().saturating_sub(1))
            }
            false => index_at_fraction(self.at.len(), coordinate),
        }
    }

    /// Coordinates of the first and the last value in a level, where it has several of what can be counted.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "a few levels")]
    pub fn first_and_last_unit_coordinate_in_level_if_values_are_grouped(&self, level: usize) -> Option<[f64; 2]> {
        let of = self.of?;
        let in_it = |k: &usize| self.level_index_of_coordinate((*k as f64 + 0.5) / of as f64) == level;
        let (first, last) = ((0..of).find(in_it)?, (0..of).rfind(in_it)?);
        Some([first, last].map(|k| (k as f64 + 0.5) / of as f64))
    }
}

/// Sums over the designs of a level, or of a pair.
#[derive(Clone, Copy, Debug, Default)]
struct LevelSum {
    count: usize,
    sum: f64,
}

impl LevelSum {
    /// Adds a design's figure.
    fn add_figure(&mut self, figure: f64) {
        self.count += 1;
        self.sum += figure;
    }

    /// The mean of the figures; `None` without any.
    #[expect(clippy::cast_precision_loss, reason = "counts of designs")]
    fn mean_of_figures_if_any(self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }

    /// The part of the squared deviations between cells that is this one's.
    #[expect(clippy::cast_precision_loss, reason = "counts of designs")]
    fn weighted_squared_deviation_from_mean(self, mean_of_all: f64) -> f64 {
        self.mean_of_figures_if_any().map_or(0.0, |own| self.count as f64 * (own - mean_of_all).powi(2))
    }
}

impl EffectAnalysis {
    /// The effects on the figures of some points of the unit cube; `None` where there are none, or all have the same figure.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "counts of designs")]
    pub fn analyse_variance_if_figures_differ(
        dimensions: &[CubeDimension],
        points_with_figures: &[(&[f64], f64)],
    ) -> Option<Self> {
        let count = points_with_figures.len();
        let mean = points_with_figures.iter().map(|(_, figure)| figure).sum::<f64>() / count as f64;
        let squares: f64 = points_with_figures.iter().map(|(_, figure)| (figure - mean).powi(2)).sum();
        // Not so for no points, whose mean is no number.
        if !(squares > 1e-20 * count as f64 * mean * mean && squares > 0.0) {
            return None;
        }
        let by_chance = |cells: usize| cells.saturating_sub(1) as f64 / (count as f64 - 1.0).max(1.0);
        let main: Vec<MainEffect> = dimensions
            .iter()
            .enumerate()
            .map(|(k, dimension)| {
                let cut = DimensionLevels::with_one_level_per_value_if_few_else_equal_parts(
                    dimension,
                    points_with_figures.iter().map(|(point, _)| point[k]),
                );
                let mut cells = vec![LevelSum::default(); cut.count_levels()];
                points_with_figures
                    .iter()
                    .for_each(|(point, figure)| cells[cut.level_index_of_coordinate(point[k])].add_figure(*figure));
                MainEffect {
                    dimension: k,
                    cut,
                    levels: cells.iter().map(|cell| (cell.count, cell.mean_of_figures_if_any())).collect(),
                    part: cells.iter().map(|cell| cell.weighted_squared_deviation_from_mean(mean)).sum::<f64>()
                        / squares,
                    by_chance: by_chance(cells.iter().filter(|cell| cell.count > 0).count()),
                }
            })
            .collect();
        let mut pairs = Vec::new();
        for (i, one) in main.iter().map(|own| &own.cut).enumerate() {
            for (j, other) in main.iter().map(|own| &own.cut).enumerate().skip(i + 1) {
                let mut cells = vec![vec![LevelSum::default(); other.count_levels()]; one.count_levels()];
                for (point, figure) in points_with_figures {
                    cells[one.level_index_of_coordinate(point[i])][other.level_index_of_coordinate(point[j])]
                        .add_figure(*figure);
                }
                let all = || cells.iter().flatten();
                let between = all().map(|cell| cell.weighted_squared_deviation_from_mean(mean)).sum::<f64>() / squares;
                let filled = all().filter(|cell| cell.count > 0).count();
                pairs.push(Interaction {
                    dimensions: [i, j],
                    means: cells
                        .iter()
                        .map(|row| row.iter().map(|cell| cell.mean_of_figures_if_any()).collect())
                        .collect(),
                    part: (between - main[i].part - main[j].part).max(0.0),
                    by_chance: (by_chance(filled) - main[i].by_chance - main[j].by_chance).max(0.0),
                });
            }
        }
        Some(Self { count, mean, squares, main, pairs })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dimensions(counts: &[Option<usize>]) -> Vec<CubeDimension> {
        let of =
            |count: &Option<usize>| CubeDimension { variable: 0, name: String::new(), count: *count, levels: None };
        counts.iter().map(of).collect()
    }

    /// All combinations of the middles of `n` parts.
    fn grid(n: [usize; 3]) -> Vec<Vec<f64>> {
        let middle = |k: usize, n: usize| (k as f64 + 0.5) / n as f64;
        let mut points = Vec::new();
        for i in 0..n[0] {
            for j in 0..n[1] {
                for k in 0..n[2] {
                    points.push(vec![middle(i, n[0]), middle(j, n[1]), middle(k, n[2])]);
                }
            }
        }
        points
    }

    fn effects(dimensions: &[CubeDimension], points: &[Vec<f64>], of: impl Fn(&[f64]) -> f64) -> EffectAnalysis {
        let told: Vec<(&[f64], f64)> = points.iter().map(|point| (point.as_slice(), of(point))).collect();
        EffectAnalysis::analyse_variance_if_figures_differ(dimensions, &told).unwrap()
    }

    /// Of a sum, every term has the part of the variance that is its own: 0, 1, .., 4 has the variance 2, times 9 18; of -5 and 5
    /// it is 25.
    #[test]
    fn a_sum_has_the_parts_of_its_terms_and_no_interactions() {
        let dimensions = dimensions(&[None, Some(2), Some(3)]);
        let found = effects(&dimensions, &grid([5, 2, 3]), |x| {
            let (first, second) = ((5.0 * x[0]).floor(), if x[1] < 0.5 { -5.0 } else { 5.0 });
            3.0 * first + second + 7.0
        });
        let wanted = [18.0 / 43.0, 25.0 / 43.0, 0.0];
        for (own, wanted) in found.main.iter().zip(wanted) {
            assert!((own.part - wanted).abs() < 1e-12, "{found:?}");
        }
        assert_eq!(found.main[1].levels, [(15, Some(3.0 * 2.0 - 5.0 + 7.0)), (15, Some(18.0))]);
        assert!(found.pairs.iter().all(|pair| pair.part < 1e-12), "{found:?}");
        assert!((found.mean - 13.0).abs() < 1e-12 && found.count == 30);
    }

    /// A product of signs is nothing but interaction.
    #[test]
    fn a_product_of_signs_is_an_interaction_of_two() {
        let dimensions = dimensions(&[Some(2), Some(2), Some(2)]);
        let sign = |part: f64| if part < 0.5 { -1.0 } else { 1.0 };
        let found = effects(&dimensions, &grid([2, 2, 2]), |x| 4.0 + sign(x[0]) * sign(x[2]));
        assert!(found.main.iter().all(|own| own.part < 1e-12), "{found:?}");
        let parts: Vec<f64> = found.pairs.iter().map(|pair| pair.part).collect();
        assert!(parts[0] < 1e-12 && (parts[1] - 1.0).abs() < 1e-12 && parts[2] < 1e-12, "{parts:?}");
        assert_eq!(found.pairs[1].dimensions, [0, 2]);
        assert_eq!(found.pairs[1].means, [[Some(5.0), Some(3.0)], [Some(3.0), Some(5.0)]]);
    }

    /// Six values of a list have six levels, of which each has its own mean; three values of a grid three, which are where the designs are.
    #[test]
    fn each_of_a_few_values_has_a_level_of_its_own() {
        let dimensions = dimensions(&[Some(6), None, Some(60)]);
        let points: Vec<Vec<f64>> =
            grid([6, 3, 60]).into_iter().map(|x| vec![x[0], (1.5 * x[1] - 0.25).clamp(0.0, 1.0), x[2]]).collect();
        let found = effects(&dimensions, &points, |x| (6.0 * x[0]).floor().powi(2) + x[1]);
        let means: Vec<f64> = found.main[0].levels.iter().map(|(_, mean)| mean.unwrap() - 0.5).collect();
        for (k, mean) in means.iter().enumerate() {
            assert!((mean - (k * k) as f64).abs() < 1e-9, "{means:?}");
        }
        assert_eq!((found.main[1].cut.at.as_slice(), found.main[1].levels.len()), ([0.0, 0.5, 1.0].as_slice(), 3));
        assert!((0..3).all(|level| {
            found.main[1].cut.first_and_last_unit_coordinate_in_level_if_values_are_grouped(level).is_none()
        }));
        // Of sixty values twelve are in each of five levels: the first to the twelfth, ...
        let ends = found.main[2]
            .cut
            .first_and_last_unit_coordinate_in_level_if_values_are_grouped(0)
            .unwrap()
            .map(|at| index_at_fraction(60, at));
        assert_eq!((found.main[2].cut.count_levels(), ends), (5, [0, 11]));
    }

    #[test]
    fn a_figure_that_is_always_the_same_has_no_effects() {
        let dimensions = dimensions(&[Some(2), Some(2), Some(2)]);
        let points = grid([2, 2, 2]);
        let told: Vec<(&[f64], f64)> = points.iter().map(|point| (point.as_slice(), 3.5)).collect();
        assert_eq!(EffectAnalysis::analyse_variance_if_figures_differ(&dimensions, &told), None);
        assert_eq!(EffectAnalysis::analyse_variance_if_figures_differ(&dimensions, &[]), None);
    }
}
