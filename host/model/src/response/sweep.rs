//! Responses at every point of a grid, at many frequencies, for every actuator: one blocked product of real matrices.
//!
//! The coordinates of a block of frequencies, real and imaginary parts side by side, are the columns of one matrix; the
//! shapes at the grid's points are another. On a panel with mirror symmetry the shapes are even or odd about its centre
//! lines, and the product is made for a quarter of the points: the rest are sums and differences.
//!
//! The product is nalgebra's (the matrixmultiply crate's, with whichever of SSE2, AVX and FMA the machine has). faer 0.24's
//! is faster by AVX-512, but leaves the upper halves of the vector registers in use: all that the thread computes
//! with SSE afterwards was seen to take five times as long.

use super::mirror::{MirrorSymmetry, find_mirror_symmetries};
use super::{CoordinateSolver, ResponseError};
use crate::model::ReducedModel;
use crate::scene::Scene;
use nalgebra::{DMatrix, RealField};
use num_complex::{Complex, Complex64};
use std::ops::Range;

/// Columns of a block: with 425 points and four parities in f64 that is 0.9 MB, which a second-level cache holds.
const BLOCK: usize = 64;

/// The numbers that the product is made in.
pub trait Arithmetic: RealField + Copy {
    /// The nearest one.
    fn rounded_from_f64(value: f64) -> Self;
    /// Their relative rounding.
    const ROUNDING: f64;
    /// How far a shape may be from even or odd, relative to its largest value, to be taken as that. Modes converge to a
    /// residual of 1e-9, which mixes neighbours a thousandth apart by 1e-6 or so; the exact ones are not mixed at all.
    const MIXED: f64;
}

impl Arithmetic for f64 {
    fn rounded_from_f64(value: f64) -> Self {
        value
    }
    const ROUNDING: f64 = f64::EPSILON;
    const MIXED: f64 = 1e-10;
}

impl Arithmetic for f32 {
    #[expect(clippy::cast_possible_truncation, reason = "rounding is what is meant")]
    fn rounded_from_f64(value: f64) -> Self {
        value as f32
    }
    const ROUNDING: f64 = f32::EPSILON as f64;
    const MIXED: f64 = 1e-6;
}

/// Accelerations in m/s^2 for 1 N at each actuator alone.
#[derive(Clone, Debug, PartialEq)]
pub struct AccelerationSweep<T> {
    /// Points: row by row, x first.
    pub points: usize,
    /// Actuators.
    pub actuators: usize,
    /// Real parts, `[frequency][actuator][point]`.
    pub re: Vec<T>,
    /// Imaginary parts.
    pub im: Vec<T>,
}

impl<T: Copy> AccelerationSweep<T> {
    /// Acceleration for a frequency, an actuator and a point.
    ///
    /// # Panics
    /// If an index is out of range.
    #[must_use]
    pub fn acceleration_per_newton_at_indices(&self, frequency: usize, actuator: usize, point: usize) -> Complex<T> {
        let place = (frequency * self.actuators + actuator) * self.points + point;
        Complex::new(self.re[place], self.im[place])
    }
}

impl<T: Arithmetic + Into<f64>> AccelerationSweep<T> {
    /// Acceleration for a frequency, an actuator and a point, in double precision.
    pub(super) fn acceleration_per_newton_as_f64(&self, frequency: usize, actuator: usize, point: usize) -> Complex64 {
        let z = self.acceleration_per_newton_at_indices(frequency, actuator, point);
        Complex64::new(z.re.into(), z.im.into())
    }

    /// Accelerations of all points for a frequency and an actuator.
    pub fn accelerations_per_newton_of_all_points(
        &self,
        frequency: usize,
        actuator: usize,
    ) -> impl Iterator<Item = Complex64> {
        let from = (frequency * self.actuators + actuator) * self.points;
        let range = from..from + self.points;
        self.re[range.clone()].iter().zip(&self.im[range]).map(|(re, im)| Complex64::new((*re).into(), (*im).into()))
    }
}

/// A panel's responses on a grid, ready for sweeps.
#[derive(Clone, Debug)]
pub struct SurfaceShapes<T> {
    /// Columns and rows of the whole grid.
    size: [usize; 2],
    /// Columns and rows of the part that is computed.
    part: [usize; 2],
    folds: [MirrorSymmetry; 2],
    /// Over the coordinates that any actuator excites, sorted by parity.
    model: ReducedModel,
    parities: Vec<ParityShapes<T>>,
}

/// Coordinates whose shapes have the same parity about both centre lines.
#[derive(Clone, Debug)]
struct ParityShapes<T> {
    /// Odd about the centre in x, in y.
    odd: [bool; 2],
    coordinates: Range<usize>,
    /// Points of the part x coordinates.
    shapes: DMatrix<T>,
}

impl<T: Arithmetic> SurfaceShapes<T> {
    /// Shapes of `model` at the points of the grid of columns `x_m` and rows `y_m`.
    #[must_use]
    pub fn new(scene: &Scene, model: &ReducedModel, x_m: &[f64], y_m: &[f64]) -> Self {
        let folds = find_mirror_symmetries(scene, model, x_m, y_m, T::MIXED);
        let part = [folds[0].count_lines_to_compute(x_m.len()), folds[1].count_lines_to_compute(y_m.len())];
        let mut excited: Vec<usize> = Vec::new();
        let mut parities: Vec<([bool; 2], Range<usize>)> = Vec::new();
        for odd in [[false, false], [false, true], [true, false], [true, true]] {
            let is_of = |i: &usize| [folds[0].is_coordinate_odd(*i), folds[1].is_coordinate_odd(*i)] == odd;
            // What no actuator moves stays at rest.
            if !(0..2).any(|axis| {
                odd[axis]
                    && (folds[axis].is_symmetric_with_only_even_shapes_driven()
                        || !folds[axis].are_scene_grid_and_shapes_symmetric_about_this_line())
            }) {
                let from = excited.len();
                excited.extend((0..model.count_coordinates()).filter(is_of));
                parities.push((odd, from..excited.len()));
            }
        }
        let model = model.restrict_to_coordinates(&excited);
        let shapes = model.shape_deflections_on_grid(&x_m[..part[0]], &y_m[..part[1]]);
        let parities = parities
            .into_iter()
            .map(|(odd, coordinates)| {
                let shapes = shapes.columns_range(coordinates.clone()).map(T::rounded_from_f64);
                ParityShapes { odd, coordinates, shapes }
            })
            .collect();
        Self { size: [x_m.len(), y_m.len()], part, folds, model, parities }
    }

    /// Number of points of the grid.
    #[must_use]
    pub fn count_points(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Multiplications and additions of the products for one frequency and actuator.
    #[must_use]
    pub fn count_multiplications_and_additions_per_frequency_and_actuator(&self) -> usize {
        4 * self.part[0] * self.part[1] * self.model.count_coordinates()
    }

    /// Accelerations of all points for all frequencies and actuators.
    ///
    /// # Errors
    /// [`ResponseError::Unbounded`] at the first frequency that has no answer.
    pub fn compute_accelerations_per_newton_at_all_points(
        &self,
        frequencies_hz: &[f64],
    ) -> Result<AccelerationSweep<T>, ResponseError> {
        let (n, p, points) = (self.model.count_coordinates(), self.model.count_actuators(), self.count_points());
        let total = frequencies_hz.len() * p * points;
        let mut out =
            AccelerationSweep { points, actuators: p, re: vec![T::zero(); total], im: vec![T::zero(); total] };
        if p == 0 || points == 0 {
            return Ok(out);
        }
        let solver = CoordinateSolver::new(&self.model);
        let per_block = (BLOCK / (2 * p)).max(1);
        let mut work = SweepBuffers::new(self, 2 * p * per_block);
        let mut coordinates = (vec![0.0; n * p], vec![0.0; n * p]);
        let (blocks, length) = (frequencies_hz.chunks(per_block), per_block * p * points);
        for ((block, re), im) in blocks.zip(out.re.chunks_mut(length)).zip(out.im.chunks_mut(length)) {
            for (k, frequency_hz) in block.iter().enumerate() {
                solver.solve_coordinates_per_newton_into(*frequency_hz, &mut coordinates.0, &mut coordinates.1)?;
                let scale = -(std::f64::consts::TAU * frequency_hz).powi(2);
                work.put_scaled_vectors_into_columns(self, 2 * p * k, &coordinates.0, n, scale);
                work.put_scaled_vectors_into_columns(self, 2 * p * k + p, &coordinates.1, n, scale);
            }
            let columns = 2 * p * block.len();
            work.multiply_shapes_with_coordinates(self, columns);
            for column in 0..columns {
                // Of every frequency first all real parts, then all imaginary ones.
                let (frequency, kind, actuator) = (column / (2 * p), column % (2 * p) / p, column % p);
                let plane = if kind == 0 { &mut *re } else { &mut *im };
                let from = (frequency * p + actuator) * points;
                work.unfold_column_to_grid(self, column, &mut plane[from..from + points]);
            }
        }
        Ok(out)
    }
}

/// What a block is computed in.
struct SweepBuffers<T> {
    /// For each parity its coordinates x columns.
    coordinates: Vec<DMatrix<T>>,
    /// For each parity points of the part x columns.
    products: Vec<DMatrix<T>>,
    /// What a parity that nothing excites contributes.
    nothing: Vec<T>,
}

impl<T: Arithmetic> SweepBuffers<T> {
    fn new(shapes: &SurfaceShapes<T>, columns: usize) -> Self {
        let part = shapes.part[0] * shapes.part[1];
        let of = |rows: usize| DMatrix::zeros(rows, columns);
        Self {
            coordinates: shapes.parities.iter().map(|parity| of(parity.coordinates.len())).collect(),
            products: shapes.parities.iter().map(|_| of(part)).collect(),
            nothing: vec![T::zero(); part],
        }
    }

    /// Puts `vectors`, which follow each other and have `vector_length` coordinates each, times `scale` into the columns from `first_column` on.
    fn put_scaled_vectors_into_columns(
        &mut self,
        shapes: &SurfaceShapes<T>,
        first_column: usize,
        vectors: &[f64],
        vector_length: usize,
        scale: f64,
    ) {
        for (parity, own) in shapes.parities.iter().zip(&mut self.coordinates) {
            for (j, vector) in vectors.chunks_exact(vector_length).enumerate() {
                for (out, value) in own.column_mut(first_column + j).iter_mut().zip(&vector[parity.coordinates.clone()])
                {
                    *out = T::rounded_from_f64(value * scale);
                }
            }
        }
    }

    /// Multiplies the shapes of each parity with its coordinates.
    fn multiply_shapes_with_coordinates(&mut self, shapes: &SurfaceShapes<T>, columns: usize) {
        for ((parity, coordinates), products) in shapes.parities.iter().zip(&self.coordinates).zip(&mut self.products) {
            let mut products = products.columns_mut(0, columns);
            products.gemm(T::one(), &parity.shapes, &coordinates.columns(0, columns), T::zero());
        }
    }

    /// Writes one column's values at all points of the grid.
    fn unfold_column_to_grid<'a>(&'a self, shapes: &SurfaceShapes<T>, column: usize, out: &mut [T]) {
        let ([nx, ny], [px, py]) = (shapes.size, shapes.part);
        let part = px * py;
        let of = |odd: [bool; 2]| {
            let at = shapes.parities.iter().position(|parity| parity.odd == odd);
            at.map_or(&self.nothing[..], |at| &self.products[at].as_slice()[column * part..(column + 1) * part])
        };
        let (even, odd_x) = (of([false, false]), of([true, false]));
        let (odd_y, odd_both) = (of([false, true]), of([true, true]));
        for j in 0..py {
            let row = |values: &'a [T]| &values[j * px..(j + 1) * px];
            let rows = [row(even), row(odd_y), row(odd_x), row(odd_both)];
            unfold_row_from_parities(rows, |a, b| a + b, &mut out[j * nx..(j + 1) * nx]);
            let mirrored = ny - 1 - j;
            if shapes.folds[1].are_scene_grid_and_shapes_symmetric_about_this_line() && mirrored != j {
                unfold_row_from_parities(rows, |a, b| a - b, &mut out[mirrored * nx..(mirrored + 1) * nx]);
            }
        }
    }
}

/// One row of the grid from those of the four parities: even in both, odd in y, odd in x, odd in both; `sum` adds what is
/// odd in y, or takes it away in the mirrored half.
fn unfold_row_from_parities<T: Arithmetic>(
    [even, odd_y, odd_x, odd_both]: [&[T]; 4],
    add_or_subtract_odd_in_y: impl Fn(T, T) -> T,
    out: &mut [T],
) {
    // All of the row, or its left part.
    let (left, right) = out.split_at_mut(even.len());
    let pairs = even.iter().zip(odd_y).zip(odd_x.iter().zip(odd_both));
    for (out, ((even, odd_y), (odd_x, odd_both))) in left.iter_mut().zip(pairs.clone()) {
        *out = add_or_subtract_odd_in_y(*even, *odd_y) + add_or_subtract_odd_in_y(*odd_x, *odd_both);
    }
    // The centre column of an odd number is its own mirror image.
    for (out, ((even, odd_y), (odd_x, odd_both))) in right.iter_mut().rev().zip(pairs) {
        *out = add_or_subtract_odd_in_y(*even, *odd_y) - add_or_subtract_odd_in_y(*odd_x, *odd_both);
    }
}
