//! Grid lines: through every attachment, finer around driven points, fine enough for the shortest wave.

/// Lines nearer to each other than this part of the side are one line.
const MERGE: f64 = 1e-6;
/// Widths of the two cells next to a driven point, in regular cells: a point force bends a plate as r^2 log r, which
/// regular cells resolve only to second order.
const GRADED: [f64; 2] = [0.25, 0.5];

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
    /// Whether the cells beside it are refined.
    pub graded: bool,
}

impl Lines {
    /// Lines from 0 to `length` with cells of at most `cell`, one line at every forced position.
    #[must_use]
    pub fn new(length: f64, cell: f64, forced: &[Forced]) -> Self {
        let mut stops: Vec<Forced> = vec![Forced { at: 0.0, graded: false }, Forced { at: length, graded: false }];
        for stop in forced {
            match stops.iter_mut().find(|known| (known.at - stop.at).abs() <= MERGE * length) {
                Some(known) => known.graded |= stop.graded,
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

/// Adds the lines after `from` up to and including `to`.
fn fill(at: &mut Vec<f64>, from: Forced, to: Forced, cell: f64) {
    let graded_width: f64 = GRADED.iter().sum::<f64>() * cell;
    let room = to.at - from.at;
    let ends = f64::from(u8::from(from.graded)) + f64::from(u8::from(to.graded));
    // Where two attachments are near each other their lines refine the mesh by themselves.
    let grade = room > ends * graded_width + cell;
    let mut start = from.at;
    if grade && from.graded {
        for part in GRADED {
            start += part * cell;
            at.push(start);
        }
    }
    let end = if grade && to.graded { to.at - graded_width } else { to.at };
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a positive count, bounded by the caller"
    )]
    let cells = (((end - start) / cell - 1e-9).ceil() as usize).max(1);
    for i in 1..=cells {
        #[allow(clippy::cast_precision_loss, reason = "small counts")]
        at.push(if i == cells { end } else { start + (end - start) * i as f64 / cells as f64 });
    }
    if grade && to.graded {
        at.push(to.at - GRADED[0] * cell);
        at.push(to.at);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_forced_position_is_a_line_and_cells_are_small_enough() {
        let forced = [
            Forced { at: 0.1, graded: true },
            Forced { at: 0.1001, graded: false },
            Forced { at: 0.1 + 1e-9, graded: false },
            Forced { at: 0.3, graded: true },
        ];
        let lines = Lines::new(0.3, 0.02, &forced);
        assert!(lines.at.windows(2).all(|pair| pair[1] > pair[0] && pair[1] - pair[0] <= 0.02 * (1.0 + 1e-9)));
        for stop in forced {
            assert!((lines.at[lines.nearest(stop.at)] - stop.at).abs() < 1e-8);
        }
        assert_eq!((lines.at[0], lines.at[lines.cells()]), (0.0, 0.3));
        assert!((lines.at[lines.cells()] - lines.at[lines.cells() - 1] - 0.005).abs() < 1e-12, "graded at the end");
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
