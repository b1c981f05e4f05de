//! Deflections of stiffly held points as unknowns of their own.
//!
//! A spring of 1e18 N/m at a point inside a cell adds k N_a N_b to a hundred entries, whose rounding alone (1e-16 k) is
//! stiffer than the panel. So the deflection v = R u of each such point takes the place of one unknown u_P that has part
//! in it: u_P = R_P^-1 (v - R_F u_F), and the spring is a single number on the diagonal.

use super::sparse::{MatrixEntries, SparseVector};
use nalgebra::DMatrix;
use std::collections::BTreeMap;

/// Least value of a function at the point, over the largest, for it to be preferred because it lives in one cell alone.
const PREFERRED: f64 = 0.1;

/// A stiffly held point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StiffPoint {
    /// In m.
    pub at: (f64, f64),
    /// Which of the points before it is its neighbour, and their distance over the mesh's length (`neighbours`): its row is then
    /// the difference of their deflections over that.
    pub beside: Option<(usize, f64)>,
}

/// The change of unknowns; the identity where nothing is stiff.
#[derive(Clone, Debug, Default)]
pub struct StiffPointUnknowns {
    /// The points that have unknowns.
    held: Vec<StiffPoint>,
    /// The unknown that each has become.
    unknowns: Vec<usize>,
    /// What a replaced unknown is in the new ones.
    replaced: BTreeMap<usize, SparseVector>,
}

impl StiffPointUnknowns {
    /// The change for deflections (or differences of them) `rows` of `points`; `inner` tells functions that live in one cell.
    /// Points that depend on others stay as they are, and so do their neighbours.
    pub(super) fn new(points: &[StiffPoint], rows: &[SparseVector], inner: impl Fn(usize) -> bool) -> Self {
        let mut pivots: Vec<usize> = Vec::new();
        let mut kept: Vec<usize> = Vec::new();
        // Elimination row by row; each is cleared of the pivots before it.
        let mut cleared: Vec<BTreeMap<usize, f64>> = Vec::new();
        for (m, row) in rows.iter().enumerate() {
            if points[m].beside.is_some_and(|(other, _)| !kept.contains(&other)) {
                continue;
            }
            let mut rest: BTreeMap<usize, f64> = row.iter().copied().collect();
            let size = rest.values().fold(0.0, |most: f64, value| most.max(value.abs()));
            for (pivot, other) in pivots.iter().zip(&cleared) {
                let factor = rest.get(pivot).copied().unwrap_or(0.0) / other[pivot];
                if factor != 0.0 {
                    for (index, value) in other {
                        *rest.entry(*index).or_insert(0.0) -= factor * value;
                    }
                    rest.insert(*pivot, 0.0);
                }
            }
            let largest = |only_inner: bool| {
                let candidates = rest.iter().filter(|(index, _)| !only_inner || inner(**index));
                candidates
                    .map(|(index, value)| (*index, value.abs()))
                    .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
            };
            let Some(any) = largest(false).filter(|any| any.1 > f64::EPSILON.sqrt() * size) else { continue };
            let pivot = largest(true).filter(|inner| inner.1 >= PREFERRED * any.1).unwrap_or(any).0;
            pivots.push(pivot);
            cleared.push(rest);
            kept.push(m);
        }
        let n = pivots.len();
        let value = |m: usize, index: usize| rows[m].iter().filter(|(j, _)| *j == index).map(|(_, v)| v).sum::<f64>();
        let square = DMatrix::from_fn(n, n, |i, j| value(kept[i], pivots[j]));
        let Some(inverse) = square.try_inverse() else { return Self::default() };
        let replaced = pivots.iter().enumerate().map(|(i, pivot)| {
            let mut in_new: BTreeMap<usize, f64> = BTreeMap::new();
            for (j, m) in kept.iter().enumerate() {
                *in_new.entry(pivots[j]).or_insert(0.0) += inverse[(i, j)];
                for (index, value) in rows[*m].iter().filter(|(index, _)| !pivots.contains(index)) {
                    *in_new.entry(*index).or_insert(0.0) -= inverse[(i, j)] * value;
                }
            }
            let mut row: SparseVector = in_new.into_iter().collect();
            row.sort_by_key(|(index, _)| *index);
            (*pivot, row)
        });
        let replaced = replaced.collect();
        let held = kept.iter().map(|m| {
            let beside = points[*m].beside;
            // Where the neighbour is among those kept.
            let beside = beside.and_then(|(other, ratio)| Some((kept.iter().position(|k| *k == other)?, ratio)));
            StiffPoint { beside, ..points[*m] }
        });
        Self { held: held.collect(), unknowns: pivots, replaced }
    }

    /// A change of unknowns that replaces some without holding any point.
    pub(super) const fn from_replacements_without_held_points(replaced: BTreeMap<usize, SparseVector>) -> Self {
        Self { held: Vec::new(), unknowns: Vec::new(), replaced }
    }

    /// The deflection at a place over the unknowns, if it is one of these: its own, or its neighbours' and the differences.
    pub(super) fn deflection_row_if_stiff_point_at(&self, x_m: f64, y_m: f64) -> Option<SparseVector> {
        let mut point = self.held.iter().position(|held| held.at == (x_m, y_m))?;
        let mut out = Vec::new();
        while let Some((other, ratio)) = self.held[point].beside {
            out.push((self.unknowns[point], ratio));
            point = other;
        }
        out.push((self.unknowns[point], 1.0));
        Some(out)
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.held.len()
    }

    /// Each one's unknown with the value that it has where the deflection is linear: c at (0, 0), and slopes cx and cy.
    pub(super) fn unknowns_and_values_for_linear_deflection(
        &self,
        c: f64,
        slope_x: f64,
        slope_y: f64,
    ) -> impl Iterator<Item = (usize, f64)> {
        self.held.iter().zip(&self.unknowns).map(move |(held, unknown)| {
            let (x, y) = held.at;
            let value = match held.beside {
                None => c + slope_x * x + slope_y * y,
                Some((other, ratio)) => {
                    let from = self.held[other].at;
                    (slope_x * (x - from.0) + slope_y * (y - from.1)) / ratio
                }
            };
            (*unknown, value)
        })
    }

    /// Transforms a row over the old unknowns to one over the new ones.
    pub(super) fn transform_row_to_new_unknowns(&self, row: SparseVector) -> SparseVector {
        if row.iter().all(|(index, _)| !self.replaced.contains_key(index)) {
            return row;
        }
        let mut out: BTreeMap<usize, f64> = BTreeMap::new();
        for (index, value) in row {
            match self.replaced.get(&index) {
                None => *out.entry(index).or_insert(0.0) += value,
                Some(terms) => terms.iter().for_each(|(j, part)| *out.entry(*j).or_insert(0.0) += value * part),
            }
        }
        let mut row: SparseVector = out.into_iter().collect();
        row.sort_by_key(|(index, _)| *index);
        row
    }

    /// Transforms a matrix over the old unknowns to one over the new ones.
    pub(super) fn transform_matrix_to_new_unknowns(&self, entries: MatrixEntries) -> MatrixEntries {
        if self.replaced.is_empty() {
            return entries;
        }
        let order = entries.iter().map(|(row, column, _)| row.max(column) + 1).max().unwrap_or(0);
        let order = self.replaced.values().flatten().map(|(index, _)| index + 1).fold(order, usize::max);
        let mut out = MatrixEntries::default();
        // First the columns, then the rows; what either touches is summed up in full rows, as replaced unknowns become sums of
        // hundreds, and their products with each other would be tens of thousands for every entry.
        let mut rows: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        for (row, column, value) in entries.iter() {
            let columns = self.replaced.get(&column);
            if columns.is_none() && !self.replaced.contains_key(&row) {
                out.add_entry_without_its_transpose(row, column, value);
                continue;
            }
            let sums = rows.entry(row).or_insert_with(|| vec![0.0; order]);
            match columns {
                None => sums[column] += value,
                Some(terms) => terms.iter().for_each(|(j, part)| sums[*j] += part * value),
            }
        }
        // All of them out before any comes in: a replaced unknown's new meaning has its old number.
        let replaced: Vec<_> =
            self.replaced.iter().filter_map(|(row, terms)| Some((terms, rows.remove(row)?))).collect();
        for (terms, values) in replaced {
            for (row, part) in terms {
                let sums = rows.entry(*row).or_insert_with(|| vec![0.0; order]);
                sums.iter_mut().zip(&values).for_each(|(sum, value)| *sum += part * value);
            }
        }
        for (row, sums) in rows {
            sums.iter()
                .enumerate()
                .for_each(|(column, value)| out.add_entry_without_its_transpose(row, column, *value));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deflections_become_unknowns() {
        let rows = vec![vec![(0, 0.5), (1, 1.0), (2, 0.2)], vec![(1, 0.9), (2, 0.4), (3, -0.3)]];
        let places = [(0.1, 0.2), (0.3, 0.4)].map(make_stiff_point_without_neighbour);
        let points = StiffPointUnknowns::new(&places, &rows, |index| index == 2);
        for (row, held) in rows.iter().zip(places) {
            let [(unknown, 1.0)] = points.deflection_row_if_stiff_point_at(held.at.0, held.at.1).unwrap()[..] else {
                panic!("alone")
            };
            let new = points.transform_row_to_new_unknowns(row.clone());
            for (index, value) in new {
                assert!((value - if index == unknown { 1.0 } else { 0.0 }).abs() < 1e-15, "{index} {value}");
            }
        }
        // The same numbers in old and new unknowns: u' A u.
        let mut matrix = MatrixEntries::default();
        for i in 0..4 {
            for j in 0..4 {
                matrix.add_entry_without_its_transpose(i, j, 1.0 / (1.0 + i as f64 + j as f64));
            }
        }
        let new = [0.3, -0.7, 0.2, 1.1];
        let old: Vec<f64> = (0..4)
            .map(|i| {
                points.transform_row_to_new_unknowns(vec![(i, 1.0)]).iter().map(|(j, value)| value * new[*j]).sum()
            })
            .collect();
        let form = |entries: &MatrixEntries, u: &[f64]| entries.iter().map(|(i, j, a)| u[i] * a * u[j]).sum::<f64>();
        let transformed = points.transform_matrix_to_new_unknowns(matrix.clone());
        assert!((form(&matrix, &old) - form(&transformed, &new)).abs() < 1e-12);
    }

    #[test]
    fn dependent_points_are_left_alone() {
        let rows = vec![vec![(0, 0.5), (1, 1.0)], vec![(0, 1.0), (1, 2.0)], vec![]];
        let points = StiffPointUnknowns::new(
            &[(0.1, 0.0), (0.2, 0.0), (0.3, 0.0)].map(make_stiff_point_without_neighbour),
            &rows,
            |_| true,
        );
        assert!(
            points.deflection_row_if_stiff_point_at(0.1, 0.0).is_some()
                && points.deflection_row_if_stiff_point_at(0.2, 0.0).is_none()
        );
        assert!(points.deflection_row_if_stiff_point_at(0.3, 0.0).is_none());
    }

    /// A neighbour's deflection is that of the first and a part of the difference.
    #[test]
    fn differences_of_neighbours_become_unknowns() {
        let (first, second) = (vec![(0, 0.5), (1, 1.0), (2, 0.2)], vec![(0, 0.5), (1, 1.001), (2, 0.2005)]);
        let rows = vec![first.clone(), vec![(1, 1.0), (2, 0.5)]];
        let places =
            [make_stiff_point_without_neighbour((0.1, 0.0)), StiffPoint { at: (0.101, 0.0), beside: Some((0, 1e-3)) }];
        let points = StiffPointUnknowns::new(&places, &rows, |_| true);
        for (row, held) in [first, second].into_iter().zip(places) {
            let mut expected = points.deflection_row_if_stiff_point_at(held.at.0, held.at.1).unwrap();
            expected.sort_by_key(|(index, _)| *index);
            let found = points
                .transform_row_to_new_unknowns(row)
                .into_iter()
                .filter(|(_, value)| value.abs() > 1e-12)
                .collect::<Vec<_>>();
            assert_eq!(found.len(), expected.len(), "{found:?} {expected:?}");
            for ((i, found), (j, expected)) in found.into_iter().zip(expected) {
                assert!(i == j && (found - expected).abs() < 1e-12);
            }
        }
        // A slope of 2 along x.
        let slopes: Vec<f64> =
            points.unknowns_and_values_for_linear_deflection(0.0, 2.0, 0.0).map(|(_, value)| value).collect();
        assert!((slopes[0] - 0.2).abs() < 1e-15 && (slopes[1] - 2.0).abs() < 1e-10, "{slopes:?}");
    }

    fn make_stiff_point_without_neighbour(at: (f64, f64)) -> StiffPoint {
        StiffPoint { at, beside: None }
    }
}
