//! (e): f32 against f64 in the response evaluation, and how near the machine's limit it is.

use crate::clock::{median, median_s};
use crate::error::Error;
use crate::own::{Own, solve, value};
use crate::problem::{Curves, Problem};
use crate::table::{Table, bytes, relative, seconds, three};
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
struct Machine {
    /// Additions and multiplications per s in a large matrix product.
    flops: f64,
    /// Bytes per s into memory as the allocator gives it.
    fresh: f64,
    /// The same into memory that was written before.
    again: f64,
}

/// Sweeps in both arithmetics.
///
/// # Errors
/// [`Error::Model`], [`Error::Response`].
pub fn table(problem: &Problem, accuracy: Accuracy, reference: &Curves, runs: usize) -> Result<Table, Error> {
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
    let (double, fine) = solve::<f64>(problem, accuracy, reference, runs)?;
    let (single, coarse) = solve::<f32>(problem, accuracy, reference, runs)?;
    let own =
        Curves::new(fine.points * fine.actuators, problem.frequencies_hz.len(), |curve, f| value(&fine, curve, f));
    let apart = own.error_of(|curve, f| value(&coarse, curve, f));
    let mut remarks = Vec::new();
    let mut row = |name: &str, own: &Own, apart: f64, width: f64, machine: Machine| {
        #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
        let result = 2.0 * width * (fine.points * fine.actuators * problem.frequencies_hz.len()) as f64;
        let sweep_s = own.sweep_s.unwrap_or(f64::NAN);
        let (by_operations, by_bytes) = (own.operations / machine.flops, result / machine.fresh);
        table.row([
            String::from(name),
            seconds(sweep_s),
            relative(own.error),
            if apart.is_nan() { String::new() } else { relative(apart) },
            format!("{} M", three(own.operations / 1e6)),
            format!("{} GFLOP/s", three(own.operations / sweep_s / 1e9)),
            format!("{} %", three(100.0 * own.operations / sweep_s / machine.flops)),
            bytes(result),
            seconds(by_operations),
            seconds(by_bytes),
            format!("{} %", three(100.0 * (by_operations + by_bytes) / sweep_s)),
        ]);
        remarks.push(format!(
            "{name}: a product of two matrices of order {ORDER} runs at {} GFLOP/s. Writing runs at {}/s into new \
             memory (the allocator takes pieces above 32 MB directly from the operating system), and at {}/s into \
             memory that was written before.",
            three(machine.flops / 1e9),
            bytes(machine.fresh),
            bytes(machine.again)
        ));
    };
    row("f64", &double, f64::NAN, 8.0, machine::<f64>(runs));
    row("f32", &single, apart, 4.0, machine::<f32>(runs));
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

fn machine<T: Arithmetic + ComplexField>(runs: usize) -> Machine {
    #[expect(clippy::cast_precision_loss, reason = "small")]
    let entry = |i: usize, j: usize| T::rounded_from_f64(((i * 31 + j * 17) % 101) as f64 / 101.0);
    let (a, b) = (Mat::from_fn(ORDER, ORDER, entry), Mat::from_fn(ORDER, ORDER, entry));
    let mut c = Mat::from_fn(ORDER, ORDER, |_, _| T::rounded_from_f64(0.0));
    let product_s = infallible(median_s(runs, || {
        matmul(c.as_mut(), Accum::Replace, a.as_ref(), b.as_ref(), T::rounded_from_f64(1.0), Par::Seq);
        Ok(c[(0, 0)])
    }));
    #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
    let flops = 2.0 * (ORDER as f64).powi(3) / product_s;
    // As large as the problem's result in this arithmetic: 6.5 million numbers.
    let count = 6_500_000;
    #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
    let size = (count * size_of::<T>()) as f64;
    let fresh_s = infallible(median_s(runs, || Ok(vec![T::rounded_from_f64(1.0); count])));
    let mut buffer = vec![T::rounded_from_f64(0.0); count];
    let mut again = Vec::new();
    for k in 0..runs {
        #[expect(clippy::cast_precision_loss, reason = "small")]
        let value = T::rounded_from_f64(k as f64);
        again.push(infallible(median_s(1, || {
            buffer.fill(value);
            Ok(buffer.last().copied())
        })));
    }
    Machine { flops, fresh: size / fresh_s, again: size / median(again) }
}

fn infallible(result: Result<f64, Infallible>) -> f64 {
    match result {
        Ok(value) => value,
        Err(never) => match never {},
    }
}
