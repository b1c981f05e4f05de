//! Accelerations at a point at every frequency of the grid, for all actuators: the inner loop of every plan.

use super::Entry;
use era_model::kernel;
use nalgebra::DVector;
use pulp::Arch;

/// Frequencies of a block: its sums, 4 kB, stay in the first-level cache while all coordinates are added.
const BLOCK: usize = 512;
/// Relative error of [`Gains::squares`] against the entries' own: rounding to single precision, of terms that partly cancel.
/// What is left out on account of it is looked at again in double precision.
pub const SINGLE: f64 = 1e-4;

/// Acceleration coordinates of all actuators, coordinate by coordinate with the frequencies of one in a row, so that the
/// sums over coordinates run over many frequencies at once. In single precision: half as many bytes, which the
/// second-level cache holds.
#[derive(Clone, Debug, Default)]
pub struct Gains {
    actuators: usize,
    frequencies: usize,
    coordinates: usize,
    /// `[actuator][block][coordinate][re, im][frequency of the block]`; zero where there is no response.
    data: Vec<f32>,
}

impl Gains {
    pub(super) fn new(entries: &[Vec<Option<Entry>>], coordinates: usize) -> Self {
        let frequencies = entries.first().map_or(0, Vec::len);
        let mut data = Vec::with_capacity(2 * coordinates * frequencies * entries.len());
        for list in entries {
            for block in list.chunks(BLOCK) {
                for i in 0..coordinates {
                    data.extend(block.iter().map(|entry| entry.as_ref().map_or(0.0, |e| single(e.acceleration[i].re))));
                    data.extend(block.iter().map(|entry| entry.as_ref().map_or(0.0, |e| single(e.acceleration[i].im))));
                }
            }
        }
        Self { actuators: entries.len(), frequencies, coordinates, data }
    }

    /// Bytes that it takes.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        self.data.len() * size_of::<f32>()
    }

    /// |acceleration|^2 in (m/s^2/N)^2 at the point whose mode shapes are `shape`, actuator by actuator over all frequencies.
    #[must_use]
    pub fn squares(&self, shape: &DVector<f64>) -> Vec<f64> {
        let shape: Vec<f32> = shape.iter().map(|value| single(*value)).collect();
        let mut out = vec![0.0; self.actuators * self.frequencies];
        // With the vector instructions that the machine has.
        Arch::new().dispatch(Squares(self, &shape, &mut out));
        out
    }
}

/// Frequencies that are taken together: with four points their sums are in the processor's registers.
const LANES: usize = 8;
/// Points that are taken together.
const POINTS: usize = 4;

/// Mode shapes of four points, coordinate by coordinate, and the points' weights.
struct Four {
    shapes: Vec<[f32; POINTS]>,
    weights: [f32; POINTS],
}

impl Four {
    fn of(points: &[(&DVector<f64>, f64)]) -> Self {
        let n = points.first().map_or(0, |(shape, _)| shape.len());
        let mut four = Self { shapes: vec![[0.0; POINTS]; n], weights: [0.0; POINTS] };
        for (q, (shape, weight)) in points.iter().enumerate().take(POINTS) {
            four.weights[q] = single(*weight);
            four.shapes.iter_mut().zip(shape.iter()).for_each(|(shapes, value)| shapes[q] = single(*value));
        }
        four
    }
}

impl Gains {
    /// The mean of |acceleration|^2 in (m/s^2/N)^2 over points with these mode shapes and weights, actuator by actuator over all
    /// frequencies, where it is `needed` (it may be told elsewhere as well; 0 where it is not).
    #[must_use]
    pub fn mean_squares(&self, points: &[(&DVector<f64>, f64)], needed: &[bool]) -> Vec<f64> {
        let groups: Vec<Four> = points.chunks(POINTS).map(Four::of).collect();
        let mut out = vec![0.0; self.actuators * self.frequencies];
        Arch::new().dispatch(MeanSquares(self, &groups, needed, &mut out));
        out
    }
}

kernel!(MeanSquares<'a>(gains: &'a Gains, groups: &'a [Four], needed: &'a [bool], out: &'a mut [f64]) -> () = mean_squares);

#[inline(always)]
fn mean_squares(gains: &Gains, groups: &[Four], needed: &[bool], out: &mut [f64]) {
    let mut data = gains.data.as_slice();
    let frequencies = gains.frequencies.max(1);
    for (own, needed) in out.chunks_mut(frequencies).zip(needed.chunks(frequencies)) {
        for (block, needed) in own.chunks_mut(BLOCK).zip(needed.chunks(BLOCK)) {
            let width = block.len();
            let (values, rest) = data.split_at(2 * gains.coordinates * width);
            data = rest;
            for from in (0..width).step_by(LANES) {
                // The last ones of a block overlap those before, unless there are none.
                let from = from.min(width.saturating_sub(LANES));
                let upto = (from + LANES).min(width);
                if !needed[from..upto].contains(&true) {
                    continue;
                }
                let mut sum = [0.0_f32; LANES];
                for four in groups {
                    add_four(&mut sum, four, values, width, from);
                }
                for (out, sum) in block[from..upto].iter_mut().zip(sum) {
                    *out = f64::from(sum);
                }
            }
        }
    }
}

#[inline(always)]
fn add_four(sum: &mut [f32; LANES], four: &Four, values: &[f32], width: usize, from: usize) {
    let (mut re, mut im) = ([[0.0_f32; LANES]; POINTS], [[0.0_f32; LANES]; POINTS]);
    for (shapes, pair) in four.shapes.iter().zip(values.chunks_exact(2 * width)) {
        let (values_re, values_im) = pair.split_at(width);
        let (values_re, values_im) = (lanes(&values_re[from..]), lanes(&values_im[from..]));
        for ((re, im), shape) in re.iter_mut().zip(&mut im).zip(shapes) {
            for l in 0..LANES {
                re[l] += values_re[l] * shape;
                im[l] += values_im[l] * shape;
            }
        }
    }
    for ((re, im), weight) in re.iter().zip(&im).zip(four.weights) {
        for l in 0..LANES {
            sum[l] += weight * (re[l] * re[l] + im[l] * im[l]);
        }
    }
}

#[inline(always)]
fn lanes(values: &[f32]) -> [f32; LANES] {
    match values.first_chunk() {
        Some(all) => *all,
        None => {
            let mut padded = [0.0; LANES];
            padded.iter_mut().zip(values).for_each(|(padded, value)| *padded = *value);
            padded
        }
    }
}

kernel!(Squares<'a>(gains: &'a Gains, shape: &'a [f32], out: &'a mut [f64]) -> () = squares);

#[inline(always)]
fn squares(gains: &Gains, shape: &[f32], out: &mut [f64]) {
    let mut data = gains.data.as_slice();
    for own in out.chunks_mut(gains.frequencies.max(1)) {
        for block in own.chunks_mut(BLOCK) {
            let width = block.len();
            let (values, rest) = data.split_at(2 * gains.coordinates * width);
            data = rest;
            let (mut re, mut im) = ([0.0_f32; BLOCK], [0.0_f32; BLOCK]);
            let (re, im) = (&mut re[..width], &mut im[..width]);
            for (shape, pair) in shape.iter().zip(values.chunks_exact(2 * width)) {
                let (values_re, values_im) = pair.split_at(width);
                add(re, values_re, *shape);
                add(im, values_im, *shape);
            }
            for ((out, re), im) in block.iter_mut().zip(re.iter()).zip(im.iter()) {
                *out = f64::from(*re).powi(2) + f64::from(*im).powi(2);
            }
        }
    }
}

#[inline(always)]
fn add(sum: &mut [f32], values: &[f32], factor: f32) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum += value * factor;
    }
}

#[expect(clippy::cast_possible_truncation, reason = "rounding is what is meant")]
fn single(value: f64) -> f32 {
    value as f32
}
