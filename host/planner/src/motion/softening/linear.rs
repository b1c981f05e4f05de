//! A small real system of equations.

use crate::scene::MAX_ACTUATORS;

/// Real and imaginary part for each actuator.
pub const MOST: usize = 2 * MAX_ACTUATORS;

/// A x = b with up to [`MOST`] unknowns, b in the last column.
pub struct System {
    rows: [[f64; MOST + 1]; MOST],
    unknowns: usize,
}

impl System {
    pub const fn new(unknowns: usize) -> Self {
        Self { rows: [[0.0; MOST + 1]; MOST], unknowns }
    }

    /// Sets the two by two entries from (row, column) on, row by row.
    pub const fn set(&mut self, row: usize, column: usize, first: [f64; 2], second: [f64; 2]) {
        self.rows[row][column] = first[0];
        self.rows[row][column + 1] = first[1];
        self.rows[row + 1][column] = second[0];
        self.rows[row + 1][column + 1] = second[1];
    }

    /// Adds the identity to the two by two entries at `row` on the diagonal.
    pub const fn add_one(&mut self, row: usize) {
        self.rows[row][row] += 1.0;
        self.rows[row + 1][row + 1] += 1.0;
    }

    pub const fn set_right(&mut self, row: usize, first: f64, second: f64) {
        self.rows[row][MOST] = first;
        self.rows[row + 1][MOST] = second;
    }

    /// Gaussian elimination with row pivoting. `None` unless the determinant is positive.
    pub fn solve(mut self) -> Option<[f64; MOST]> {
        let n = self.unknowns;
        let mut positive = true;
        for column in 0..n {
            let size = |row: usize| self.rows[row][column].abs();
            let pivot = (column + 1..n).fold(column, |best, row| if size(row) > size(best) { row } else { best });
            if pivot != column {
                self.rows.swap(pivot, column);
                positive = !positive;
            }
            let above = self.rows[column];
            positive ^= above[column] < 0.0;
            if above[column] == 0.0 || above[column].is_nan() {
                return None;
            }
            let inverse = 1.0 / above[column];
            for row in &mut self.rows[column + 1..n] {
                let factor = row[column] * inverse;
                for (value, above) in row.iter_mut().zip(&above).skip(column + 1) {
                    *value -= factor * above;
                }
            }
        }
        if !positive {
            return None;
        }
        let mut solution = [0.0; MOST];
        for row in (0..n).rev() {
            let known: f64 = (row + 1..n).map(|k| self.rows[row][k] * solution[k]).sum();
            solution[row] = (self.rows[row][MOST] - known) / self.rows[row][row];
        }
        Some(solution)
    }
}
