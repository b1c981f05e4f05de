//! Grid lines: through every attachment, finer around driven points and between close ones, fine enough for the shortest
//! wave.

/// Lines nearer to each other than this part of the side are one line.
pub const MERGE: f64 = 1e-6;
/// Cells grow by this factor from one to the next, away from where they must be small.
const GROWTH: f64 = 2.0;

/// One direction of the mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Lines {
    /// Ascending positions in m, the first 0 and the last the side's length.
    pub at: Vec<f64>,
    /// Length that the slope at each line is scaled with: the mean of the cells beside it.
    pub scale: Vec<f64>,
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
        Self { at, scale }
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

/// Adds the lines after `from` up to and including `to`: small cells at the ends that need them, growing until they are
/// regular or meet, and equal ones in between.
fn fill(at: &mut Vec<f64>, from: Forced, to: Forced, cell: f64) {
    let (mut left, mut right) = (from.at, to.at);
    let (mut left_width, mut right_width) = (from.width.min(cell), to.width.min(cell));
    let mut behind = vec![to.at];
    while left_width.min(right_width) < cell && right - left > left_width + right_width {
        if left_width <= right_width {
            left += left_width;
            at.push(left);
            left_width = (GROWTH * left_width).min(cell);
        } else {
            right -= right_width;
            behind.push(right);
            right_width = (GROWTH * right_width).min(cell);
        }
    }
    let widest = left_width.max(right_width);
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a positive count, bounded by the caller"
    )]
    let cells = (((right - left) / widest - 1e-9).ceil() as usize).max(1);
    #[allow(clippy::cast_precision_loss, reason = "small counts")]
    at.extend((1..cells).map(|i| left + (right - left) * i as f64 / cells as f64));
    at.extend(behind.into_iter().rev());
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
            assert!((lines.at[lines.nearest(stop.at)] - stop.at).abs() < 1e-8);
        }
        assert_eq!((lines.at[0], lines.at[lines.cells()]), (0.0, 0.3));
        assert!((lines.at[lines.cells()] - lines.at[lines.cells() - 1] - 0.005).abs() < 1e-12, "graded at the end");
        let fine = lines.nearest(0.2);
        assert!((lines.at[fine + 1] - lines.at[fine] - 1e-4).abs() < 1e-12);
        let widths: Vec<f64> = lines.at.windows(2).map(|pair| pair[1] - pair[0]).skip(fine).collect();
        assert!(widths.windows(2).all(|pair| pair[1] <= pair[0] * 2.0 * (1.0 + 1e-9)), "grows gently: {widths:?}");
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
