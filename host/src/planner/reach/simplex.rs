//! Small dense linear programs: maximise c . x subject to A x <= b and x >= 0, with b >= 0.
//!
//! Primal simplex on the condensed tableau (columns of non-basic variables only), from x = 0, which b >= 0 makes feasible.
//! Largest coefficient first; Bland's rule, which cannot cycle, as long as pivots do not improve anything. Callers get
//! the duals too and check values with them, so that rounding here can make a bound weak but not wrong.

/// Entries below this, relative to the largest entry of the program, count as zero.
const ZERO: f64 = 1e-12;
/// Most pivots per row and column; ends what rounding might keep going.
const PIVOTS: usize = 50;

/// An optimum.
#[derive(Clone, Debug, PartialEq)]
pub struct Optimum {
    /// The variables.
    pub x: Vec<f64>,
    /// One multiplier per row, at least 0.
    pub dual: Vec<f64>,
}

/// Solves the program with the rows `a` (each as long as `c`); `None` if it is unbounded.
#[must_use]
pub fn maximise(c: &[f64], a: &[Vec<f64>], b: &[f64]) -> Option<Optimum> {
    let (columns, rows) = (c.len(), a.len());
    let width = columns + 1;
    // Rows of the tableau: right-hand side last; the objective's row last of all.
    let mut tableau: Vec<f64> = Vec::with_capacity((rows + 1) * width);
    for (row, b) in a.iter().zip(b) {
        tableau.extend_from_slice(row);
        tableau.push(*b);
    }
    tableau.extend(c.iter().map(|c| -c));
    tableau.push(0.0);
    let largest = |of: &[f64]| of.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    let zero = ZERO * a.iter().map(|row| largest(row)).fold(0.0, f64::max);
    let zero_gain = ZERO * largest(c);
    // Variables 0..columns are x, the others the rows' slacks.
    let mut outside: Vec<usize> = (0..columns).collect();
    let mut inside: Vec<usize> = (columns..columns + rows).collect();
    let mut stalled = false;
    for _ in 0..PIVOTS * (rows + columns) {
        let gains = tableau.get(rows * width..rows * width + columns).unwrap_or_default();
        let improving = gains.iter().enumerate().filter(|(_, gain)| **gain < -zero_gain);
        let entering = if stalled {
            improving.min_by_key(|(j, _)| outside[*j])
        } else {
            improving.min_by(|a, b| a.1.total_cmp(b.1))
        };
        let Some((enter, _)) = entering else { break };
        let mut leaving: Option<(usize, f64)> = None;
        for i in 0..rows {
            let entry = tableau[i * width + enter];
            if entry <= zero {
                continue;
            }
            let ratio = tableau[i * width + columns].max(0.0) / entry;
            let better = leaving.is_none_or(|(row, least)| ratio < least || ratio <= least && inside[i] < inside[row]);
            if better {
                leaving = Some((i, ratio));
            }
        }
        let (leave, ratio) = leaving?;
        stalled = ratio <= 0.0;
        pivot(&mut tableau, width, leave, enter);
        std::mem::swap(&mut inside[leave], &mut outside[enter]);
    }
    let mut x = vec![0.0; columns];
    for (i, variable) in inside.iter().enumerate().filter(|(_, variable)| **variable < columns) {
        x[*variable] = tableau[i * width + columns].max(0.0);
    }
    let mut dual = vec![0.0; rows];
    for (j, variable) in outside.iter().enumerate().filter(|(_, variable)| **variable >= columns) {
        dual[*variable - columns] = tableau[rows * width + j].max(0.0);
    }
    Some(Optimum { x, dual })
}

/// Exchanges the basic variable of row `leave` with the non-basic one of column `enter`.
fn pivot(tableau: &mut [f64], width: usize, leave: usize, enter: usize) {
    let inverse = 1.0 / tableau[leave * width + enter];
    let mut pivot_row: Vec<f64> = tableau[leave * width..(leave + 1) * width].to_vec();
    pivot_row.iter_mut().for_each(|entry| *entry *= inverse);
    pivot_row[enter] = inverse;
    for (i, row) in tableau.chunks_exact_mut(width).enumerate() {
        if i == leave {
            row.copy_from_slice(&pivot_row);
            continue;
        }
        let factor = row[enter];
        if factor == 0.0 {
            continue;
        }
        row[enter] = 0.0;
        for (entry, pivot) in row.iter_mut().zip(&pivot_row) {
            *entry -= factor * pivot;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_textbook_program() {
        // 3 x + 5 y with x <= 4, 2 y <= 12, 3 x + 2 y <= 18: 36 at (2, 6); duals 0, 3/2, 1.
        let a = [vec![1.0, 0.0], vec![0.0, 2.0], vec![3.0, 2.0]];
        let found = maximise(&[3.0, 5.0], &a, &[4.0, 12.0, 18.0]).unwrap();
        assert!((found.x[0] - 2.0).abs() < 1e-12 && (found.x[1] - 6.0).abs() < 1e-12, "{found:?}");
        assert!(found.dual.iter().zip([0.0, 1.5, 1.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }

    #[test]
    fn without_limits_there_is_no_optimum() {
        assert_eq!(maximise(&[1.0, 1.0], &[vec![1.0, 0.0]], &[1.0]), None);
    }

    /// Beale's example, on which the largest-coefficient rule alone cycles.
    #[test]
    fn beales_example_ends() {
        let a = [vec![0.25, -60.0, -0.04, 9.0], vec![0.5, -90.0, -0.02, 3.0], vec![0.0, 0.0, 1.0, 0.0]];
        let found = maximise(&[0.75, -150.0, 0.02, -6.0], &a, &[0.0, 0.0, 1.0]).unwrap();
        let value = 0.75 * found.x[0] - 150.0 * found.x[1] + 0.02 * found.x[2] - 6.0 * found.x[3];
        assert!((value - 0.05).abs() < 1e-12, "{found:?}");
    }

    proptest! {
        /// Strong duality and feasibility of both sides prove an optimum.
        #[test]
        fn primal_and_dual_agree(
            a in prop::collection::vec(prop::collection::vec(0.0_f64..3.0, 5), 1..8),
            c in prop::collection::vec(-1.0_f64..3.0, 5),
            b in prop::collection::vec(0.0_f64..4.0, 8),
        ) {
            let mut a = a;
            let mut b = b[..a.len()].to_vec();
            // A bounded program.
            a.push(vec![1.0; 5]);
            b.push(10.0);
            let found = maximise(&c, &a, &b).unwrap();
            let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
            for (row, b) in a.iter().zip(&b) {
                prop_assert!(dot(row, &found.x) <= b + 1e-9);
            }
            for (j, c) in c.iter().enumerate() {
                let price: f64 = a.iter().zip(&found.dual).map(|(row, dual)| row[j] * dual).sum();
                prop_assert!(price >= c - 1e-9);
            }
            prop_assert!((dot(&c, &found.x) - dot(&b, &found.dual)).abs() < 1e-9);
        }
    }
}
