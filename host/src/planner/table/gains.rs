//! Accelerations at a point at every frequency of the grid, for all actuators: the inner loop of every plan.

use super::Entry;
use nalgebra::DVector;

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
        pulp::Arch::new().dispatch(|| squares(self, &shape, &mut out));
        out
    }
}

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

#[allow(clippy::cast_possible_truncation, reason = "rounding is what is meant")]
fn single(value: f64) -> f32 {
    value as f32
}
