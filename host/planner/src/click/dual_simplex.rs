//! Linear programmes with few bounded variables and dense rows that are added while they are solved: the dual simplex method.
//!
//! Every variable starts at that bound at which its cost is least, so that the start is optimal but for the rows, and each added row is one more
//! that is broken. The tableau holds the rows that were added, in the variables that stand at a bound; one exchange costs rows times
//! variables. Bounds are passed where the programme still gains beyond them (R. Fourer, "Notes on the dual simplex method", 1994).

/// Part by which a value may be beyond its bound, or a limit exceeded.
const BROKEN: f64 = 1e-7;
/// Part of what a row misses that is rounding.
const ROUNDING: f64 = 1e-9;
/// Least coefficient that a variable is exchanged by, as a part of the largest of its row.
const LEAST_PIVOT: f64 = 1e-7;
/// Most exchanges between two added rows.
const MOST_EXCHANGES: usize = 5000;

/// A variable: its bounds, of which the one at which it is cheaper is finite, and its cost.
#[derive(Clone, Copy, Debug)]
pub struct BoundedVariable {
    /// Least value.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
    /// Cost per value.
    pub cost: f64,
}

/// A programme with the rows added so far.
#[derive(Clone, Debug)]
pub struct DualSimplex {
    /// Those of the programme, then the slack of every row.
    variables: Vec<BoundedVariable>,
    /// How many are not slacks.
    chosen: usize,
    /// Value of each variable that stands at a bound, and of each in a row.
    values: Vec<f64>,
    /// The variable of each column, which stands at a bound.
    columns: Vec<usize>,
    /// What each of them costs.
    reduced_costs: Vec<f64>,
    /// The variable of each row, which lies between its bounds once the programme is solved.
    rows: Vec<usize>,
    /// Rows x columns: the variable of a row and the sum of coefficient times variable over the columns are constant.
    tableau: Vec<f64>,
}

impl DualSimplex {
    /// A programme without rows.
    #[must_use]
    pub fn new(variables: Vec<BoundedVariable>) -> Self {
        let start = |own: &BoundedVariable| if own.cost < 0.0 { own.upper } else { own.lower };
        Self {
            chosen: variables.len(),
            values: variables.iter().map(start).collect(),
            columns: (0..variables.len()).collect(),
            reduced_costs: variables.iter().map(|own| own.cost).collect(),
            rows: Vec::new(),
            tableau: Vec::new(),
            variables,
        }
    }

    /// The values of the programme's variables.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        self.values.get(..self.chosen).unwrap_or(&[])
    }

    /// Whether a row, from 0 in the order in which they were added, holds with equality.
    #[must_use]
    pub fn is_row_tight(&self, row: usize) -> bool {
        self.columns.contains(&(self.chosen + row))
    }

    /// Adds the row: the sum of `coefficients` times variables is at most `limit`, or, with `is_equal`, the limit.
    pub fn add_row(&mut self, coefficients: &[f64], limit: f64, is_equal: bool) {
        let width = self.columns.len();
        let mut row: Vec<f64> =
            self.columns.iter().map(|variable| coefficients.get(*variable).copied().unwrap_or(0.0)).collect();
        for (variable, other) in self.rows.iter().zip(self.tableau.chunks_exact(width.max(1))) {
            let Some(factor) = coefficients.get(*variable).filter(|factor| **factor != 0.0) else { continue };
            row.iter_mut().zip(other).for_each(|(own, other)| *own -= factor * other);
        }
        let used: f64 = coefficients.iter().zip(&self.values).map(|(factor, value)| factor * value).sum();
        self.rows.push(self.variables.len());
        let upper = if is_equal { 0.0 } else { f64::INFINITY };
        self.variables.push(BoundedVariable { lower: 0.0, upper, cost: 0.0 });
        self.values.push(limit - used);
        self.tableau.extend(row);
    }

    /// Exchanges variables until all rows hold at the least cost; whether there is such a solution, and it was found.
    pub fn minimise(&mut self) -> bool {
        for _ in 0..MOST_EXCHANGES {
            let Some((row, target)) = self.find_most_broken_row_and_its_violated_bound() else { return true };
            let Some(column) = self.choose_entering_column_flipping_passed_bounds_if_feasible(row, target) else {
                return false;
            };
            self.exchange_variables_of_row_and_column(row, column, target);
        }
        false
    }

    /// The row whose variable is furthest beyond a bound, measured in its columns' variables, and that bound.
    fn find_most_broken_row_and_its_violated_bound(&self) -> Option<(usize, f64)> {
        let mut most = (0.0, None);
        for (row, (variable, coefficients)) in
            self.rows.iter().zip(self.tableau.chunks_exact(self.columns.len().max(1))).enumerate()
        {
            let (own, value) = (self.variables[*variable], self.values[*variable]);
            let bound = value.clamp(own.lower, own.upper);
            let beyond = (value - bound).abs();
            if beyond > BROKEN {
                let square: f64 = 1.0 + coefficients.iter().map(|factor| factor * factor).sum::<f64>();
                let measure = beyond * beyond / square;
                if measure > most.0 {
                    most = (measure, Some((row, bound)));
                }
            }
        }
        most.1
    }

    /// The column whose variable takes the row's place when that goes to `target`; those whose other bound is passed on the way go there.
    fn choose_entering_column_flipping_passed_bounds_if_feasible(&mut self, row: usize, target: f64) -> Option<usize> {
        let width = self.columns.len();
        let variable = self.rows[row];
        let own = &self.tableau[row * width..(row + 1) * width];
        // Above 0: the row's variable has to grow.
        let missing = target - self.values[variable];
        let least = LEAST_PIVOT * own.iter().fold(0.0_f64, |most, factor| most.max(factor.abs()));
        let mut candidates: Vec<(f64, usize)> = Vec::with_capacity(width);
        for (column, factor) in own.iter().enumerate() {
            let bounds = self.variables[self.columns[column]];
            let value = self.values[self.columns[column]];
            if bounds.upper <= bounds.lower || factor.abs() <= least {
                continue;
            }
            // A variable at its lower bound can only grow, one at its upper bound only shrink.
            let is_low = value <= bounds.lower;
            let helps = if is_low { -factor * missing > 0.0 } else { factor * missing > 0.0 };
            if helps {
                candidates.push((self.reduced_costs[column].abs() / factor.abs(), column));
            }
        }
        candidates.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut left = missing.abs();
        let mut passed: Vec<usize> = Vec::new();
        let mut chosen = None;
        for (_, column) in candidates {
            let bounds = self.variables[self.columns[column]];
            let gained = own[column].abs() * (bounds.upper - bounds.lower);
            // What is reached but for rounding is reached.
            if gained < left - ROUNDING * missing.abs() {
                left -= gained;
                passed.push(column);
            } else {
                chosen = Some(column);
                break;
            }
        }
        // All of them together do not reach it: there is no solution.
        let chosen = chosen?;
        for column in passed {
            let variable = self.columns[column];
            let bounds = self.variables[variable];
            let value = self.values[variable];
            let other = if value <= bounds.lower { bounds.upper } else { bounds.lower };
            self.set_value_of_column_variable_and_update_rows(column, other);
        }
        Some(chosen)
    }

    /// Gives the variable of a column another value; those of the rows follow.
    fn set_value_of_column_variable_and_update_rows(&mut self, column: usize, value: f64) {
        let variable = self.columns[column];
        let moved = value - self.values[variable];
        self.values[variable] = value;
        let width = self.columns.len();
        for (own, coefficients) in self.rows.iter().zip(self.tableau.chunks_exact(width)) {
            self.values[*own] -= coefficients[column] * moved;
        }
    }

    /// Exchanges the variables of a row and a column; that of the row goes to `target`.
    fn exchange_variables_of_row_and_column(&mut self, row: usize, column: usize, target: f64) {
        let width = self.columns.len();
        let (leaving, entering) = (self.rows[row], self.columns[column]);
        let pivot = self.tableau[row * width + column];
        let moved = (self.values[leaving] - target) / pivot;
        let entered = self.values[entering] + moved;
        self.set_value_of_column_variable_and_update_rows(column, entered);
        self.values[leaving] = target;
        let mut pivot_row: Vec<f64> =
            self.tableau[row * width..(row + 1) * width].iter().map(|own| own / pivot).collect();
        pivot_row[column] = 1.0 / pivot;
        for (other, coefficients) in self.tableau.chunks_exact_mut(width).enumerate() {
            if other == row {
                continue;
            }
            let factor = coefficients[column];
            if factor != 0.0 {
                coefficients[column] = 0.0;
                coefficients.iter_mut().zip(&pivot_row).for_each(|(own, pivot)| *own -= factor * pivot);
            }
        }
        let cost = self.reduced_costs[column];
        self.reduced_costs[column] = 0.0;
        self.reduced_costs.iter_mut().zip(&pivot_row).for_each(|(own, pivot)| *own -= cost * pivot);
        self.tableau[row * width..(row + 1) * width].copy_from_slice(&pivot_row);
        self.rows[row] = entering;
        self.columns[column] = leaving;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    const VARIABLES: usize = 3;

    /// Rows that every solution keeps: those of the programme, both sides of an equality, and the bounds.
    fn list_all_rows(variables: &[BoundedVariable], rows: &[(Vec<f64>, f64, bool)]) -> Vec<(Vec<f64>, f64)> {
        let unit =
            |place: usize, sign: f64| (0..VARIABLES).map(|k| if k == place { sign } else { 0.0 }).collect::<Vec<f64>>();
        let bounds = variables.iter().enumerate();
        let bounds = bounds.flat_map(|(k, own)| [(unit(k, 1.0), own.upper), (unit(k, -1.0), -own.lower)]);
        let negated = |row: &Vec<f64>| row.iter().map(|factor| -factor).collect::<Vec<f64>>();
        let both = rows.iter().flat_map(|(row, limit, is_equal)| {
            let below = is_equal.then(|| (negated(row), -limit));
            [(row.clone(), *limit)].into_iter().chain(below)
        });
        bounds.chain(both).collect()
    }

    /// The least cost over all corners, each the solution of as many rows as there are variables.
    fn find_least_cost_over_corners(variables: &[BoundedVariable], rows: &[(Vec<f64>, f64, bool)]) -> Option<f64> {
        let all = list_all_rows(variables, rows);
        let mut least: Option<f64> = None;
        for i in 0..all.len() {
            for j in i + 1..all.len() {
                for k in j + 1..all.len() {
                    let own = [&all[i], &all[j], &all[k]];
                    let matrix = DMatrix::from_fn(VARIABLES, VARIABLES, |r, c| own[r].0[c]);
                    let right = DVector::from_fn(VARIABLES, |r, _| own[r].1);
                    let Some(corner) = matrix.lu().solve(&right) else { continue };
                    let used = |row: &[f64]| row.iter().zip(corner.iter()).map(|(a, x)| a * x).sum::<f64>();
                    if all.iter().all(|(row, limit)| used(row) <= limit + 1e-7) {
                        let cost: f64 = variables.iter().zip(corner.iter()).map(|(own, x)| own.cost * x).sum();
                        least = Some(least.map_or(cost, |least| least.min(cost)));
                    }
                }
            }
        }
        least
    }

    fn make_row() -> impl Strategy<Value = (Vec<f64>, f64, bool)> {
        let factors = prop::collection::vec((-4i32..=4).prop_map(f64::from), VARIABLES);
        (factors, (-6i32..=6).prop_map(f64::from), prop::bool::weighted(0.2))
    }

    fn make_variable() -> impl Strategy<Value = BoundedVariable> {
        ((-3i32..=1).prop_map(f64::from), (0i32..=4).prop_map(f64::from), (-3i32..=3).prop_map(f64::from))
            .prop_map(|(lower, range, cost)| BoundedVariable { lower, upper: lower + range, cost })
    }

    /// Its rows leave one solution.
    #[test]
    fn a_single_feasible_point_is_found() {
        let make = |upper: f64, cost: f64| BoundedVariable { lower: 0.0, upper, cost };
        let mut simplex = DualSimplex::new(vec![make(2.0, 0.0), make(0.0, 0.0), make(2.0, -1.0)]);
        for (row, limit) in [([-3.0, 0.0, 1.0], -3.0), ([4.0, 0.0, 0.0], 4.0)] {
            simplex.add_row(&row, limit, false);
            assert!(simplex.minimise());
        }
        let expected = [1.0, 0.0, 0.0];
        assert!(simplex.values().iter().zip(expected).all(|(x, y)| (x - y).abs() < 1e-6), "{:?}", simplex.values());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3000))]

        /// Rows are added one after the other, each after the programme has been solved with those before it.
        #[test]
        fn the_least_cost_is_that_of_a_corner(
            variables in prop::collection::vec(make_variable(), VARIABLES),
            rows in prop::collection::vec(make_row(), 1..5),
        ) {
            let mut simplex = DualSimplex::new(variables.clone());
            let mut is_solved = true;
            for (row, limit, is_equal) in &rows {
                simplex.add_row(row, *limit, *is_equal);
                is_solved &= simplex.minimise();
                if !is_solved {
                    break;
                }
            }
            let expected = find_least_cost_over_corners(&variables, &rows);
            prop_assert_eq!(is_solved, expected.is_some(), "{:?}", expected);
            if let Some(expected) = expected {
                let found: f64 = variables.iter().zip(simplex.values()).map(|(own, x)| own.cost * x).sum();
                prop_assert!((found - expected).abs() < 1e-6, "{} {}", found, expected);
                for (row, limit) in list_all_rows(&variables, &rows) {
                    let used: f64 = row.iter().zip(simplex.values()).map(|(a, x)| a * x).sum();
                    prop_assert!(used <= limit + 1e-6, "{} {}", used, limit);
                }
            }
        }
    }
}
