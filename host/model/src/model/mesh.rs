//! Grid lines: where a bar's shape has joints, finer towards places where a plate's is singular, fine enough for the
//! shortest wave.

/// Lines nearer to each other than this part of the side are one line.
pub const MERGE: f64 = crate::scene::SAME_PLACE;
/// Cells shrink by this factor from one to the next towards where they must be small. Elements of high order converge
/// exponentially on meshes that shrink geometrically towards a singular point, best with factors of 4 to 7 (Szabo and
/// Babuska 1991, section 10.2).
const SHRINK: f64 = 4.0;
/// Most such cells on one side of a place.
const MOST_LAYERS: usize = 12;

/// One direction of the mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct GridLines {
    /// Ascending positions in m, the first 0 and the last the side's length.
    pub at: Vec<f64>,
    /// Length that the slope at each line is scaled with: the mean of the cells beside it.
    pub scale: Vec<f64>,
    /// One cell with free borders: its functions are written straight ([`super::shape`]).
    pub is_strip: bool,
}

/// A position that must have a line of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RequiredLine {
    /// In m.
    pub at: f64,
    /// Largest width of the cells beside it; infinite where regular cells will do.
    pub width: f64,
}

impl GridLines {
    /// Lines from 0 to `length` with cells of at most `cell`, one line at every forced position.
    #[must_use]
    pub fn new(length: f64, cell: f64, forced: &[RequiredLine]) -> Self {
        let mut stops: Vec<RequiredLine> =
            vec![RequiredLine { at: 0.0, width: f64::INFINITY }, RequiredLine { at: length, width: f64::INFINITY }];
        for stop in forced {
            match stops.iter_mut().find(|known| (known.at - stop.at).abs() <= MERGE * length) {
                Some(known) => known.width = known.width.min(stop.width),
                None => stops.push(*stop),
            }
        }
        stops.sort_by(|a, b| a.at.total_cmp(&b.at));
        let mut at = vec![0.0];
        for pair in stops.windows(2) {
            if let [from, to] = pair {
                add_graded_lines_between(&mut at, *from, *to, cell);
            }
        }
        let scale = (0..at.len())
            .map(|i| {
                let cells = at.get(i.saturating_sub(1)..(i + 2).min(at.len())).unwrap_or_default();
                match cells {
                    [left, _, right] => 0.5 * (right - left),
                    [left, right] => right - left,
                    _ => length,
                }
            })
            .collect();
        Self { at, scale, is_strip: false }
    }

    /// Number of cells.
    #[must_use]
    pub fn count_cells(&self) -> usize {
        self.at.len().saturating_sub(1)
    }

    /// Index of the line nearest to a position, which must be a required one (or within the merging distance of one).
    #[must_use]
    pub fn nearest_line_index(&self, position_m: f64) -> usize {
        let after = self.at.partition_point(|at| *at < position_m).min(self.at.len() - 1);
        let before = after.saturating_sub(1);
        if position_m - self.at[before] < self.at[after] - position_m { before } else { after }
    }

    /// The cell that contains a position, and where it is in the cell, 0 to 1.
    #[must_use]
    pub fn find_cell_index_and_fraction_within(&self, position_m: f64) -> (usize, f64) {
        let cell =
            self.at.partition_point(|at| *at <= position_m).saturating_sub(1).min(self.count_cells().saturating_sub(1));
        let (from, to) = (self.at[cell], self.at[cell + 1]);
        (cell, ((position_m - from) / (to - from)).clamp(0.0, 1.0))
    }
}

/// Adds the lines after `from` up to and including `to`: equal cells, of which the first and the last are cut towards the
/// ends that need small ones. Asking for smaller ones adds lines and moves none, so that spaces of functions are nested.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a positive count, bounded by the caller"
)]
fn add_graded_lines_between(positions_m: &mut Vec<f64>, from: RequiredLine, to: RequiredLine, largest_cell_m: f64) {
    let length = to.at - from.at;
    let mut cells = ((length / largest_cell_m - 1e-9).ceil() as usize).max(1);
    let both = from.width < length && to.width < length;
    if both {
        cells = cells.max(2);
    }
    let width = length / cells as f64;
    let layers = |wanted: f64| {
        let mut cuts = Vec::new();
        let mut here = width;
        while here > wanted * (1.0 + 1e-9) && cuts.len() < MOST_LAYERS {
            here /= SHRINK;
            cuts.push(here);
        }
        cuts
    };
    positions_m.extend(layers(from.width).into_iter().rev().map(|cut| from.at + cut));
    positions_m.extend((1..cells).map(|i| from.at + width * i as f64));
    positions_m.extend(layers(to.width).into_iter().map(|cut| to.at - cut));
    positions_m.push(to.at);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_forced_position_is_a_line_and_cells_are_small_enough() {
        let forced = [
            RequiredLine { at: 0.1, width: 0.005 },
            RequiredLine { at: 0.1001, width: f64::INFINITY },
            RequiredLine { at: 0.1 + 1e-9, width: f64::INFINITY },
            RequiredLine { at: 0.2, width: 1e-4 },
            RequiredLine { at: 0.3, width: 0.005 },
        ];
        let lines = GridLines::new(0.3, 0.02, &forced);
        assert!(lines.at.windows(2).all(|pair| pair[1] > pair[0] && pair[1] - pair[0] <= 0.02 * (1.0 + 1e-9)));
        for stop in forced {
            let line = lines.nearest_line_index(stop.at);
            assert!((lines.at[line] - stop.at).abs() < 1e-8);
            let beside = lines.at.windows(2).filter(|pair| pair.contains(&lines.at[line]));
            assert!(beside.map(|pair| pair[1] - pair[0]).all(|width| width <= stop.width * (1.0 + 1e-9)));
        }
        assert_eq!((lines.at[0], lines.at[lines.count_cells()]), (0.0, 0.3));
    }

    #[test]
    fn smaller_cells_add_lines_and_move_none() {
        let lines =
            |width| GridLines::new(1.0, 0.3, &[RequiredLine { at: 0.4, width }, RequiredLine { at: 1.0, width }]).at;
        for (coarse, fine) in [(f64::INFINITY, 0.1), (0.1, 0.03), (0.03, 1e-3)] {
            let (coarse, fine) = (lines(coarse), lines(fine));
            assert!(coarse.iter().all(|at| fine.contains(at)) && fine.len() > coarse.len());
        }
    }

    #[test]
    fn places_are_located() {
        let lines = GridLines::new(1.0, 0.25, &[]);
        assert_eq!(lines.find_cell_index_and_fraction_within(0.0), (0, 0.0));
        assert_eq!(lines.find_cell_index_and_fraction_within(1.0), (3, 1.0));
        assert_eq!(lines.find_cell_index_and_fraction_within(0.25), (1, 0.0));
        let (cell, place) = lines.find_cell_index_and_fraction_within(0.6);
        assert!(cell == 2 && (place - 0.4).abs() < 1e-12);
    }
}
