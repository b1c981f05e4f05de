//! Accelerations at a point at every frequency of the grid, for all actuators: the inner loop of every plan.

use super::Entry;
use era_model::kernel;
use nalgebra::DVector;
use pulp::Arch;

/// Frequencies of a block: its sums, 4 kB, stay in the first-level cache while all coordinates are added.
const BLOCK: usize = 512;
/// Relative error of [`AccelerationCoordinates::squared_accelerations_at_point_by_actuator_and_frequency`] against the entries' own: rounding to single precision, of terms that partly cancel.
/// What is left out on account of it is looked at again in double precision.
pub const SINGLE_PRECISION_ERROR: f64 = 1e-4;

/// Acceleration coordinates of all actuators in the order in which a touch needs them: coordinate by coordinate, with
/// all frequencies of a coordinate in a row, so that sums over coordinates run over many frequencies at once. Single
/// precision halves the bytes, so that they fit the second-level cache.
#[derive(Clone, Debug, Default)]
pub struct AccelerationCoordinates {
    actuators: usize,
    frequencies: usize,
    coordinates: usize,
    /// `[actuator][block][coordinate][re, im][frequency of the block]`; zero where there is no response.
    data: Vec<f32>,
}

impl AccelerationCoordinates {
    pub(super) fn new(entries: &[Vec<Option<Entry>>], coordinates: usize) -> Self {
        let frequencies = entries.first().map_or(0, Vec::len);
        let mut data = Vec::with_capacity(2 * coordinates * frequencies * entries.len());
        for list in entries {
            for block in list.chunks(BLOCK) {
                for i in 0..coordinates {
                    data.extend(
                        block
                            .iter()
                            .map(|entry| entry.as_ref().map_or(0.0, |e| to_single_precision(e.acceleration[i].re))),
                    );
                    data.extend(
                        block
                            .iter()
                            .map(|entry| entry.as_ref().map_or(0.0, |e| to_single_precision(e.acceleration[i].im))),
                    );
                }
            }
        }
        Self { actuators: entries.len(), frequencies, coordinates, data }
    }

    /// Bytes that it takes.
    #[must_use]
    pub const fn memory_bytes(&self) -> usize {
        self.data.len() * size_of::<f32>()
    }

    /// |acceleration|^2 in (m/s^2/N)^2 at the point whose mode shapes are `mode_shapes`, actuator by actuator over all frequencies.
    #[must_use]
    pub fn squared_accelerations_at_point_by_actuator_and_frequency(&self, mode_shapes: &DVector<f64>) -> Vec<f64> {
        let mode_shapes: Vec<f32> = mode_shapes.iter().map(|value| to_single_precision(*value)).collect();
        let mut out = vec![0.0; self.actuators * self.frequencies];
        // With the vector instructions that the machine has.
        Arch::new().dispatch(Squares(self, &mode_shapes, &mut out));
        out
    }
}

/// Frequencies that are taken together: with four points their sums are in the processor's registers.
const LANES: usize = 8;
/// Points that are taken together.
const POINTS: usize = 4;

/// Mode shapes of four points, coordinate by coordinate, and the weights of the points.
struct PointGroup {
    shapes: Vec<[f32; POINTS]>,
    weights: [f32; POINTS],
}

impl PointGroup {
    fn pack_up_to_four_points(points: &[(&DVector<f64>, f64)]) -> Self {
        let n = points.first().map_or(0, |(shape, _)| shape.len());
        let mut four = Self { shapes: vec![[0.0; POINTS]; n], weights: [0.0; POINTS] };
        for (q, (shape, weight)) in points.iter().enumerate().take(POINTS) {
            four.weights[q] = to_single_precision(*weight);
            four.shapes
                .iter_mut()
                .zip(shape.iter())
                .for_each(|(shapes, value)| shapes[q] = to_single_precision(*value));
        }
        four
    }
}

impl AccelerationCoordinates {
    /// The mean of |acceleration|^2 in (m/s^2/N)^2 over points with these mode shapes and weights, actuator by actuator over all
    /// frequencies, where it is `needed` (it may be told elsewhere as well; 0 where it is not).
    #[must_use]
    pub fn mean_squared_accelerations_over_points_by_actuator_and_frequency(
        &self,
        shapes_and_weights: &[(&DVector<f64>, f64)],
        needed: &[bool],
    ) -> Vec<f64> {
        let groups: Vec<PointGroup> =
            shapes_and_weights.chunks(POINTS).map(PointGroup::pack_up_to_four_points).collect();
        let mut out = vec![0.0; self.actuators * self.frequencies];
        Arch::new().dispatch(MeanSquares(self, &groups, needed, &mut out));
        out
    }
}

kernel!(MeanSquares<'a>(gains: &'a AccelerationCoordinates, groups: &'a [PointGroup], needed: &'a [bool], out: &'a mut [f64]) -> () = fill_mean_squared_accelerations);

#[inline(always)]
fn fill_mean_squared_accelerations(
    coordinates: &AccelerationCoordinates,
    groups: &[PointGroup],
    needed: &[bool],
    out: &mut [f64],
) {
    let mut data = coordinates.data.as_slice();
    let frequencies = coordinates.frequencies.max(1);
    for (own, needed) in out.chunks_mut(frequencies).zip(needed.chunks(frequencies)) {
        for (block, needed) in own.chunks_mut(BLOCK).zip(needed.chunks(BLOCK)) {
            let width = block.len();
            let (values, rest) = data.split_at(2 * coordinates.coordinates * width);
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
                    add_weighted_squares_of_four_points(&mut sum, four, values, width, from);
                }
                for (out, sum) in block[from..upto].iter_mut().zip(sum) {
                    *out = f64::from(sum);
                }
            }
        }
    }
}

#[inline(always)]
fn add_weighted_squares_of_four_points(
    sum: &mut [f32; LANES],
    four: &PointGroup,
    values: &[f32],
    width: usize,
    from: usize,
) {
    let (mut re, mut im) = ([[0.0_f32; LANES]; POINTS], [[0.0_f32; LANES]; POINTS]);
    for (shapes, pair) in four.shapes.iter().zip(values.chunks_exact(2 * width)) {
        let (values_re, values_im) = pair.split_at(width);
        let (values_re, values_im) =
            (load_lanes_padded_with_zeros(&values_re[from..]), load_lanes_padded_with_zeros(&values_im[from..]));
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
fn load_lanes_padded_with_zeros(values: &[f32]) -> [f32; LANES] {
    match values.first_chunk() {
        Some(all) => *all,
        None => {
            let mut padded = [0.0; LANES];
            padded.iter_mut().zip(values).for_each(|(padded, value)| *padded = *value);
            padded
        }
    }
}

kernel!(Squares<'a>(gains: &'a AccelerationCoordinates, shape: &'a [f32], out: &'a mut [f64]) -> () = fill_squared_accelerations_at_point_per_actuator_and_frequency);

#[inline(always)]
fn fill_squared_accelerations_at_point_per_actuator_and_frequency(
    coordinates: &AccelerationCoordinates,
    shape: &[f32],
    out: &mut [f64],
) {
    let mut data = coordinates.data.as_slice();
    for own in out.chunks_mut(coordinates.frequencies.max(1)) {
        for block in own.chunks_mut(BLOCK) {
            let width = block.len();
            let (values, rest) = data.split_at(2 * coordinates.coordinates * width);
            data = rest;
            let (mut re, mut im) = ([0.0_f32; BLOCK], [0.0_f32; BLOCK]);
            let (re, im) = (&mut re[..width], &mut im[..width]);
            for (shape, pair) in shape.iter().zip(values.chunks_exact(2 * width)) {
                let (values_re, values_im) = pair.split_at(width);
                add_scaled(re, values_re, *shape);
                add_scaled(im, values_im, *shape);
            }
            for ((out, re), im) in block.iter_mut().zip(re.iter()).zip(im.iter()) {
                *out = f64::from(*re).powi(2) + f64::from(*im).powi(2);
            }
        }
    }
}

#[inline(always)]
fn add_scaled(sum: &mut [f32], values: &[f32], factor: f32) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum += value * factor;
    }
}

#[expect(clippy::cast_possible_truncation, reason = "rounding is what is meant")]
fn to_single_precision(value: f64) -> f32 {
    value as f32
}
