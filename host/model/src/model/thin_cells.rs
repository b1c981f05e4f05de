//! Cells of a bar that are much thinner than the others: between attachments that are near to each other, or to an end.
//!
//! In a cell of length d the stiffness of values and slopes goes with EI / d^3, and rounding of that is more than what bends the
//! bar: at a ten-thousandth of the other cells' length l a part of 1e-4. A rigid motion of the cell bends nothing, but its entries cancel
//! only where they are exact. So the unknowns of one end are relative to the rigid motion of the other one,
//!
//! w_b = w_a + d w_a' + (d / l)^2 u, w_b' = w_a' + d / l^2 v,
//!
//! and the cell's stiffness acts on u and v alone: nothing has to cancel.

use super::points::StiffPointUnknowns;
use super::sections::CellSection;
use super::shape::CellMatrices;
use super::sparse::{MatrixEntries, SparseVector};
use std::collections::BTreeMap;

/// A cell is thin if it is shorter than this part of the mesh's cells: its rounding would be 1e-16 times the cube of 64, or 3e-11.
const THIN: f64 = 1.0 / 64.0;

/// A thin cell.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ThinCell {
    cell: usize,
    /// Whether its right end is the one that the left end is relative to.
    from_right: bool,
    /// What u is multiplied with for the deflection, and v for the scaled slope.
    factors: [f64; 2],
}

/// All thin cells of a bar, with the relative unknowns that take the place of one end's.
#[derive(Clone, Debug, Default)]
pub struct ThinCells {
    cells: Vec<ThinCell>,
    relative: Vec<usize>,
}

/// Numbers of the deflection and the scaled slope at a line.
type LineUnknowns = [Option<usize>; 2];

impl ThinCells {
    /// The thin cells between lines `at`, whose slopes are stored times `scale`, on a mesh with cells of `cell_m`; with the change of
    /// unknowns that they need. `numbers` are the unknowns at each line.
    pub(super) fn find_cells_much_shorter_than_mesh_and_change_of_unknowns(
        at: &[f64],
        scale: &[f64],
        cell_m: f64,
        numbers: &[LineUnknowns],
    ) -> (Self, StiffPointUnknowns) {
        let lengths: Vec<f64> = at.windows(2).map(|ends| ends[1] - ends[0]).collect();
        let is_thin = |cell: usize| lengths.get(cell).is_some_and(|length| *length < THIN * cell_m);
        let mut thin = Self::default();
        let mut replaced: BTreeMap<usize, SparseVector> = BTreeMap::new();
        // Those that reach the right end hang on it, as it may be held; all others on their left end.
        let last = lengths.iter().rposition(|length| *length >= THIN * cell_m).map_or(0, |regular| regular + 1);
        let rightwards = (0..last).filter(|cell| is_thin(*cell)).map(|cell| (cell, false));
        let leftwards = (last..lengths.len()).rev().map(|cell| (cell, true));
        for (cell, from_right) in rightwards.chain(leftwards) {
            let (from, to) = if from_right { (cell + 1, cell) } else { (cell, cell + 1) };
            let (d, factors) =
                (at[to] - at[from], [(lengths[cell] / cell_m).powi(2), lengths[cell] / cell_m.powi(2) * scale[to]]);
            // Over the unknowns of the end that it hangs on, which may be relative themselves; what is held there moves nothing.
            let over = |parts: [f64; 2], own: (usize, f64), replaced: &BTreeMap<usize, SparseVector>| -> SparseVector {
                let mut row: BTreeMap<usize, f64> = BTreeMap::from([own]);
                for (number, part) in
                    numbers[from].iter().zip(parts).filter_map(|(number, part)| Some(((*number)?, part)))
                {
                    let alone = vec![(number, 1.0)];
                    for (unknown, value) in replaced.get(&number).unwrap_or(&alone) {
                        *row.entry(*unknown).or_insert(0.0) += part * value;
                    }
                }
                row.into_iter().filter(|(_, value)| *value != 0.0).collect()
            };
            let [Some(value), Some(slope)] = numbers[to] else { continue };
            let of_value = over([1.0, d / scale[from]], (value, factors[0]), &replaced);
            let of_slope = over([0.0, scale[to] / scale[from]], (slope, factors[1]), &replaced);
            replaced.insert(value, of_value);
            replaced.insert(slope, of_slope);
            thin.cells.push(ThinCell { cell, from_right, factors });
            thin.relative.extend([value, slope]);
        }
        (thin, StiffPointUnknowns::from_replacements_without_held_points(replaced))
    }

    /// Whether a cell is thin.
    pub(super) fn is_thin_cell(&self, cell: usize) -> bool {
        self.cells.iter().any(|thin| thin.cell == cell)
    }

    /// The relative unknowns, which are 0 where the bar moves without bending.
    pub(super) fn unknowns_relative_to_other_end(&self) -> impl Iterator<Item = usize> {
        self.relative.iter().copied()
    }

    /// Adds the cells' bending, over the new unknowns. `unknown_indices_of_cell` are those of a cell's functions.
    pub(super) fn add_bending_stiffness_of_thin_cells(
        &self,
        stiffness: &mut MatrixEntries,
        matrices: &[CellMatrices],
        section: impl Fn(usize) -> Option<CellSection>,
        unknown_indices_of_cell: impl Fn(usize) -> Vec<Option<usize>>,
    ) {
        for ThinCell { cell, from_right, factors } in &self.cells {
            let (Some(CellSection { rigidity, .. }), own) = (section(*cell), unknown_indices_of_cell(*cell)) else {
                continue;
            };
            let first = if *from_right { 0 } else { 2 };
            let factor = |a: usize| match a.checked_sub(first) {
                Some(k @ 0..=1) => factors[k],
                _ if a < 4 => 0.0,
                _ => 1.0,
            };
            let bend = &matrices[*cell].bend;
            for (a, row) in own.iter().enumerate().filter(|(a, _)| factor(*a) != 0.0) {
                for (b, column) in own.iter().enumerate().filter(|(b, _)| factor(*b) != 0.0) {
                    if let (Some(row), Some(column)) = (row, column) {
                        stiffness.add_entry_without_its_transpose(
                            *row,
                            *column,
                            rigidity * factor(a) * factor(b) * bend[(a, b)],
                        );
                    }
                }
            }
        }
    }
}
