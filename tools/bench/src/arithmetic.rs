//! (e): f32 against f64 in the response evaluation, and how near the machine's limit it is.

use crate::clock::{compute_median, measure_median_time_s};
use crate::error::Error;
use crate::own::{EraMeasurement, get_acceleration_per_newton_of_curve, measure_solution_on_one_mesh};
use crate::problem::{AccelerationCurves, Problem};
use crate::table::{Table, format_bytes, format_relative_error, format_three_digits, format_time};
use era_model::model::Accuracy;
use era_model::response::sweep::Arithmetic;
use faer::linalg::matmul::matmul;
use faer::traits::ComplexField;
use faer::{Accum, Mat, Par};
use std::convert::Infallible;

/// Order of the square matrices whose product shows the peak: 4.7 MB each in f64, blocked by the kernel.
const ORDER: usize = 768;

/// What the machine can do, on one thread.
#[derive(Clone, Copy, Debug)]
struct MachineRates {
    /// Additions and multiplications per s in a large matrix product.
    operations_per_s: f64,
    /// Bytes per s into memory as the allocator gives it.
    new_memory_bytes_per_s: f64,
    /// The same into memory that was written before.
    used_memory_bytes_per_s: f64,
}

/// Measures the sweep in f64 and in f32 beside the limits of the machine.
///
/// # Errors
/// [`Error::Model`], [`Error::Response`].
pub fn build_table_of_arithmetics(
    problem: &Problem,
    accuracy: Accuracy,
    reference: &AccelerationCurves,
    runs: usize,
) -> Result<Table, Error> {
    let columns = [
        "arithmetic",
        "sweep",
        "error",
        "from f64",
        "operations",
        "rate",
        "of peak",
        "result",
        "limit by operations",
        "limit by bytes",
        "limit / time",
    ];
    let mut table = Table::new("(e) Arithmetic of the response evaluation, and the machine's limit", &columns);
    let (double, fine) = measure_solution_on_one_mesh::<f64>(problem, accuracy, reference, runs)?;
    let (single, coarse) = measure_solution_on_one_mesh::<f32>(problem, accuracy, reference, runs)?;
    let own = AccelerationCurves::from_fn(fine.points * fine.actuators, problem.frequencies_hz.len(), |curve, f| {
        get_acceleration_per_newton_of_curve(&fine, curve, f)
    });
    let apart = own.compute_largest_relative_error(|curve, f| get_acceleration_per_newton_of_curve(&coarse, curve, f));
    let mut remarks = Vec::new();
    let mut add_row = |name: &str, own: &EraMeasurement, apart: f64, width: f64, rates: MachineRates| {
        #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
        let result = 2.0 * width * (fine.points * fine.actuators * problem.frequencies_hz.len()) as f64;
        let sweep_s = own.sweep_s.unwrap_or(f64::NAN);
        let (by_operations, by_bytes) =
            (own.operations / rates.operations_per_s, result / rates.new_memory_bytes_per_s);
        table.add_row([
            String::from(name),
            format_time(sweep_s),
            format_relative_error(own.error),
            if apart.is_nan() { String::new() } else { format_relative_error(apart) },
            format!("{} M", format_three_digits(own.operations / 1e6)),
            format!("{} GFLOP/s", format_three_digits(own.operations / sweep_s / 1e9)),
            format!("{} %", format_three_digits(100.0 * own.operations / sweep_s / rates.operations_per_s)),
            format_bytes(result),
            format_time(by_operations),
            format_time(by_bytes),
            format!("{} %", format_three_digits(100.0 * (by_operations + by_bytes) / sweep_s)),
        ]);
        remarks.push(format!(
            "{name}: a product of two matrices of order {ORDER} runs at {} GFLOP/s. Writing runs at {}/s into new \
             memory (the allocator takes pieces above 32 MB directly from the operating system), and at {}/s into \
             memory that was written before.",
            format_three_digits(rates.operations_per_s / 1e9),
            format_bytes(rates.new_memory_bytes_per_s),
            format_bytes(rates.used_memory_bytes_per_s)
        ));
    };
    add_row("f64", &double, f64::NAN, 8.0, measure_machine_rates::<f64>(runs));
    add_row("f32", &single, apart, 4.0, measure_machine_rates::<f32>(runs));
    table.below = remarks;
    table.above.push(format!(
        "The problem is that of (c), with {} unknowns and {} coordinates. The sweep computes the shapes at the points \
         and all responses, with one thread. \"From f64\" is the largest difference from double precision, relative to \
         the peak of a curve. \"Operations\" is the number of operations in the matrix products that remain after \
         symmetry is used. \"Rate\" is this number divided by the time of the sweep. \"Of peak\" is the rate relative \
         to the rate of a product of two large matrices. \"Limit by operations\" is the time of the operations at the \
         rate of this large product. \"Limit by bytes\" is the time for writing the result into new memory. \
         \"Limit / time\" is the sum of both limits relative to the time of the sweep.",
        double.unknowns, double.coordinates
    ));
    Ok(table)
}

fn measure_machine_rates<T: Arithmetic + ComplexField>(runs: usize) -> MachineRates {
    #[expect(clippy::cast_precision_loss, reason = "small")]
    let entry = |i: usize, j: usize| T::rounded_from_f64(((i * 31 + j * 17) % 101) as f64 / 101.0);
    let (a, b) = (Mat::from_fn(ORDER, ORDER, entry), Mat::from_fn(ORDER, ORDER, entry));
    let mut c = Mat::from_fn(ORDER, ORDER, |_, _| T::rounded_from_f64(0.0));
    let product_s = unwrap_infallible(measure_median_time_s(runs, || {
        matmul(c.as_mut(), Accum::Replace, a.as_ref(), b.as_ref(), T::rounded_from_f64(1.0), Par::Seq);
        Ok(c[(0, 0)])
    }));
    #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
    let operations_per_s = 2.0 * (ORDER as f64).powi(3) / product_s;
    // As large as the problem's result in this arithmetic: 6.5 million numbers.
    let count = 6_500_000;
    #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
    let size = (count * size_of::<T>()) as f64;
    let fresh_s = unwrap_infallible(measure_median_time_s(runs, || Ok(vec![T::rounded_from_f64(1.0); count])));
    let mut buffer = vec![T::rounded_from_f64(0.0); count];
    let mut again_s = Vec::new();
    for k in 0..runs {
        #[expect(clippy::cast_precision_loss, reason = "small")]
        let value = T::rounded_from_f64(k as f64);
        again_s.push(unwrap_infallible(measure_median_time_s(1, || {
            buffer.fill(value);
            Ok(buffer.last().copied())
        })));
    }
    MachineRates {
        operations_per_s,
        new_memory_bytes_per_s: size / fresh_s,
        used_memory_bytes_per_s: size / compute_median(again_s),
    }
}

fn unwrap_infallible(result: Result<f64, Infallible>) -> f64 {
    match result {
        Ok(value) => value,
        Err(never) => match never {},
    }
}
