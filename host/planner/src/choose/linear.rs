//! Small linear programmes: a dense simplex with two objectives, one before the other.
//!
//! Maximise c . x, and among the optima d . x, subject to A x <= b and x >= 0, with b >= 0, so that x = 0 is a feasible
//! start and no first phase is needed. Allocation has at most five variables and some hundred rows, a tableau of a few
//! kilobytes; mixtures of combinations have some fifty (`search/mixture.rs`), and as many rows as there are targets and limits.

/// Relative size below which a reduced cost or a pivot counts as zero. Rows and columns are scaled to the size of one by
/// whoever sets the programme up.
const ZERO: f64 = 1e-11;
/// Steps after which Bland's rule, which cannot cycle, takes over from the steepest column, and twice as many as there are
/// variables if that is more.
const BLAND_AFTER: usize = 60;
/// Steps after which the present vertex is taken, and as many times as many as variables: never reached by programmes of up to
/// five variables (the tests count at most 40).
const MOST_STEPS: (usize, usize) = (400, 50);

/// A programme: rows of coefficients and their bounds.
#[derive(Clone, Debug)]
pub struct Programme {
    columns: usize,
    /// Row by row: coefficients, then the bound.
    rows: Vec<f64>,
}

/// A vertex at which the first objective, and then the second, is greatest.
#[derive(Clone, Debug, PartialEq)]
pub struct Vertex {
    /// The variables.
    pub x: Vec<f64>,
    /// What one more unit of each row's bound would add to the first objective; 0 or more.
    pub first: Vec<f64>,
    /// The same of the second objective, the first kept at its greatest.
    pub second: Vec<f64>,
}

impl Programme {
    /// A programme of so many variables without rows.
    #[must_use]
    pub const fn new(columns: usize) -> Self {
        Self { columns, rows: Vec::new() }
    }

    /// Adds a row: `coefficients` . x <= `bound`, which is 0 or more.
    pub fn add_row(&mut self, coefficients: impl IntoIterator<Item = f64>, bound: f64) {
        let before = self.rows.len();
        self.rows.extend(coefficients);
        self.rows.resize(before + self.columns, 0.0);
        self.rows.push(bound.max(0.0));
    }

    /// The optimum; `None` if an objective has no bound.
    #[must_use]
    pub fn maximise_first_then_second_objective_if_bounded(
        &self,
        first_objective: &[f64],
        second_objective: &[f64],
    ) -> Option<Vertex> {
        let n = self.columns;
        let m = self.rows.len() / (n + 1);
        let width = n + 1;
        // Tableau in terms of the variables that are zero: each row's basic variable = bound - coefficients . zeros.
        let mut table = self.rows.clone();
        let objective =
            |of: &[f64]| -> Vec<f64> { (0..n).map(|j| of.get(j).copied().unwrap_or(0.0)).chain([0.0]).collect() };
        let (mut z1, mut z2) = (objective(first_objective), objective(second_objective));
        // Names: 0..n the variables, n.. the rows' slacks.
        let mut zeros: Vec<usize> = (0..n).collect();
        let mut basics: Vec<usize> = (n..n + m).collect();
        let scale1 = first_objective.iter().fold(0.0_f64, |most, c| most.max(c.abs())).max(f64::MIN_POSITIVE);
        let scale2 = second_objective.iter().fold(0.0_f64, |most, c| most.max(c.abs())).max(f64::MIN_POSITIVE);
        let bland_after = BLAND_AFTER.max(2 * n);
        for step in 0..MOST_STEPS.0.max(MOST_STEPS.1 * n) {
            let gains = |j: usize| z1[j] > ZERO * scale1 || z1[j] >= -ZERO * scale1 && z2[j] > ZERO * scale2;
            let key = |j: usize| (if z1[j] > ZERO * scale1 { z1[j] / scale1 } else { 0.0 }, z2[j] / scale2);
            let enters = if step < bland_after {
                (0..n).filter(|j| gains(*j)).max_by(|a, b| {
                    let (a, b) = (key(*a), key(*b));
                    a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
                })
            } else {
                (0..n).filter(|j| gains(*j)).min_by_key(|j| zeros[*j])
            };
            let Some(column) = enters else { break };
            let mut leaves: Option<(usize, f64)> = None;
            for row in 0..m {
                let pivot = table[row * width + column];
                if pivot > ZERO {
                    let ratio = table[row * width + n] / pivot;
                    let better = match leaves {
                        None => true,
                        Some((other, least)) => ratio < least || ratio == least && basics[row] < basics[other],
                    };
                    if better {
                        leaves = Some((row, ratio));
                    }
                }
            }
            let (row, _) = leaves?;
            pivot_tableau(&mut table, &mut z1, &mut z2, width, m, row, column);
            std::mem::swap(&mut zeros[column], &mut basics[row]);
        }
        let mut x = vec![0.0; n];
        for (row, name) in basics.iter().enumerate() {
            if let Some(x) = x.get_mut(*name) {
                *x = table[row * width + n].max(0.0);
            }
        }
        let duals = |z: &[f64]| {
            let mut out = vec![0.0; m];
            for (column, name) in zeros.iter().enumerate() {
                if *name >= n {
                    out[*name - n] = (-z[column]).max(0.0);
                }
            }
            out
        };
        Some(Vertex { x, first: duals(&z1), second: duals(&z2) })
    }
}

/// Exchanges a row's variable for a column's.
fn pivot_tableau(
    table: &mut [f64],
    first_objective: &mut [f64],
    second_objective: &mut [f64],
    width: usize,
    row_count: usize,
    row: usize,
    column: usize,
) {
    let inverse = 1.0 / table[row * width + column];
    for j in 0..width {
        let entry = &mut table[row * width + j];
        *entry = if j == column { inverse } else { *entry * inverse };
    }
    let pivot_row: Vec<f64> = table[row * width..(row + 1) * width].to_vec();
    let apply = |other: &mut [f64]| {
        let factor = other[column];
        if factor != 0.0 {
            for (j, (entry, pivot)) in other.iter_mut().zip(&pivot_row).enumerate() {
                *entry = if j == column { -factor * pivot } else { *entry - factor * pivot };
            }
        }
    };
    for other in 0..row_count {
        if other != row {
            let slice = &mut table[other * width..(other + 1) * width];
            apply(slice);
            // A bound that rounding made negative.
            slice[width - 1] = slice[width - 1].max(0.0);
        }
    }
    apply(first_objective);
    apply(second_objective);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_corner_is_found_with_its_duals() {
        let mut programme = Programme::new(2);
        programme.add_row([1.0, 1.0], 4.0);
        programme.add_row([1.0, 3.0], 6.0);
        let vertex = programme.maximise_first_then_second_objective_if_bounded(&[3.0, 5.0], &[]).unwrap();
        assert!((vertex.x[0] - 3.0).abs() < 1e-12 && (vertex.x[1] - 1.0).abs() < 1e-12);
        assert!((vertex.first[0] - 2.0).abs() < 1e-12 && (vertex.first[1] - 1.0).abs() < 1e-12);
        assert_eq!(
            programme.maximise_first_then_second_objective_if_bounded(&[-1.0, 0.0], &[0.0, -1.0]).unwrap().x,
            [0.0, 0.0]
        );
        assert!(Programme::new(1).maximise_first_then_second_objective_if_bounded(&[1.0], &[]).is_none());
    }

    /// Beale's example, on which the steepest column alone cycles.
    #[test]
    fn beales_example_ends() {
        let mut programme = Programme::new(4);
        programme.add_row([0.25, -60.0, -0.04, 9.0], 0.0);
        programme.add_row([0.5, -90.0, -0.02, 3.0], 0.0);
        programme.add_row([0.0, 0.0, 1.0, 0.0], 1.0);
        let vertex =
            programme.maximise_first_then_second_objective_if_bounded(&[0.75, -150.0, 0.02, -6.0], &[]).unwrap();
        let value = 0.75 * vertex.x[0] - 150.0 * vertex.x[1] + 0.02 * vertex.x[2] - 6.0 * vertex.x[3];
        assert!((value - 0.05).abs() < 1e-12, "{vertex:?}");
    }

    #[test]
    fn the_second_objective_decides_among_equals() {
        let mut programme = Programme::new(3);
        programme.add_row([1.0, 1.0], 2.0);
        programme.add_row([0.0, 0.0, 1.0], 1.0);
        let vertex =
            programme.maximise_first_then_second_objective_if_bounded(&[1.0, 1.0, 0.0], &[-1.0, -2.0, 0.5]).unwrap();
        assert_eq!(vertex.x, [2.0, 0.0, 1.0]);
    }

    proptest! {
        /// Strong duality, and no random feasible point is better.
        #[test]
        fn no_feasible_point_is_better(
            a in prop::collection::vec(prop::array::uniform4(0.0_f64..1.0), 1..20),
            b in prop::collection::vec(0.0_f64..1.0, 20),
            c in prop::array::uniform4(-1.0_f64..1.0),
            trials in prop::collection::vec(prop::array::uniform4(0.0_f64..1.0), 50),
        ) {
            let mut programme = Programme::new(4);
            for (a, b) in a.iter().zip(&b) { programme.add_row(*a, *b); }
            for i in 0..4 { programme.add_row((0..4).map(|j| f64::from(u8::from(i == j))), 1.0); }
            let vertex = programme.maximise_first_then_second_objective_if_bounded(&c, &[]).unwrap();
            let value = |x: &[f64]| x.iter().zip(&c).map(|(x, c)| x * c).sum::<f64>();
            let bounds: Vec<f64> = b.iter().take(a.len()).copied().chain([1.0; 4]).collect();
            let dual: f64 = vertex.first.iter().zip(&bounds).map(|(y, b)| y * b).sum();
            prop_assert!((value(&vertex.x) - dual).abs() < 1e-9);
            for trial in trials {
                // Shrunk until it is feasible.
                let worst = a.iter().zip(&b).map(|(a, b)| a.iter().zip(&trial).map(|(a, x)| a * x).sum::<f64>() / b.max(1e-300)).fold(1.0, f64::max);
                let feasible: Vec<f64> = trial.iter().map(|x| x / worst).collect();
                prop_assert!(value(&feasible) <= value(&vertex.x) + 1e-9);
            }
        }
    }
}
