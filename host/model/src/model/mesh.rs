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
pub struct Lines {
    /// Ascending positions in m, the first 0 and the last the side's length.
    pub at: Vec<f64>,
    /// Length that the slope at each line is scaled with: the mean of the cells beside it.
    pub scale: Vec<f64>,
    /// One cell with free borders: its functions are written straight ([`super::shape`]).
    pub is_strip: bool,
}

/// A position that must have a line of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forced {
    /// In m.
    pub at: f64,
    /// Largest width of the cells beside it; infinite where regular cells will do.
    pub width: f64,
}

impl Lines {
    /// Lines from 0 to `length` with cells of at most `cell`, one line at every forced position.
    #[must_use]
    pub fn new(length: f64, cell: f64, forced: &[Forced]) -> Self {
        let mut stops: Vec<Forced> =
            vec![Forced { at: 0.0, width: f64::INFINITY }, Forced { at: length, width: f64::INFINITY }];
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
                fill(&mut at, *from, *to, cell);
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
    pub fn cells(&self) -> usize {
        self.at.len().saturating_sub(1)
    }

    /// Index of the line at `x`, which must be a forced position (or within the merging distance of one).
    #[must_use]
    pub fn nearest(&self, x: f64) -> usize {
        let after = self.at.partition_point(|at| *at < x).min(self.at.len() - 1);
        let before = after.saturating_sub(1);
        if x - self.at[before] < self.at[after] - x { before } else { after }
    }

    /// The cell that holds `x`, and the place in it from 0 to 1.
    #[must_use]
    pub fn locate(&self, x: f64) -> (usize, f64) {
        let cell = self.at.partition_point(|at| *at <= x).saturating_sub(1).min(self.cells().saturating_sub(1));
        let (from, to) = (self.at[cell], self.at[cell + 1]);
        (cell, ((x - from) / (to - from)).clamp(0.0, 1.0))
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
fn fill(at: &mut Vec<f64>, from: Forced, to: Forced, cell: f64) {
    let length = to.at - from.at;
    let mut cells = ((length / cell - 1e-9).ceil() as usize).max(1);
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
    at.extend(layers(from.width).into_iter().rev().map(|cut| from.at + cut));
    at.extend((1..cells).map(|i| from.at + width * i as f64));
    at.extend(layers(to.width).into_iter().map(|cut| to.at - cut));
    at.push(to.at);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_forced_position_is_a_line_and_cells_are_small_enough() {
        let forced = [
            Forced { at: 0.1, width: 0.005 },
            Forced { at: 0.1001, width: f64::INFINITY },
            Forced { at: 0.1 + 1e-9, width: f64::INFINITY },
            Forced { at: 0.2, width: 1e-4 },
            Forced { at: 0.3, width: 0.005 },
        ];
        let lines = Lines::new(0.3, 0.02, &forced);
        assert!(lines.at.windows(2).all(|pair| pair[1] > pair[0] && pair[1] - pair[0] <= 0.02 * (1.0 + 1e-9)));
        for stop in forced {
            let line = lines.nearest(stop.at);
            assert!((lines.at[line] - stop.at).abs() < 1e-8);
            let beside = lines.at.windows(2).filter(|pair| pair.contains(&lines.at[line]));
            assert!(beside.map(|pair| pair[1] - pair[0]).all(|width| width <= stop.width * (1.0 + 1e-9)));
        }
        assert_eq!((lines.at[0], lines.at[lines.cells()]), (0.0, 0.3));
    }

    #[test]
    fn smaller_cells_add_lines_and_move_none() {
        let lines = |width| Lines::new(1.0, 0.3, &[Forced { at: 0.4, width }, Forced { at: 1.0, width }]).at;
        for (coarse, fine) in [(f64::INFINITY, 0.1), (0.1, 0.03), (0.03, 1e-3)] {
            let (coarse, fine) = (lines(coarse), lines(fine));
            assert!(coarse.iter().all(|at| fine.contains(at)) && fine.len() > coarse.len());
        }
    }

    #[test]
    fn places_are_located() {
        let lines = Lines::new(1.0, 0.25, &[]);
        assert_eq!(lines.locate(0.0), (0, 0.0));
        assert_eq!(lines.locate(1.0), (3, 1.0));
        assert_eq!(lines.locate(0.25), (1, 0.0));
        let (cell, place) = lines.locate(0.6);
        assert!(cell == 2 && (place - 0.4).abs() < 1e-12);
    }
}
