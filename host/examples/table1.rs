//! The thesis' Table 1, with matrices stated: time to solve a system of n unknowns at 5001 times (0 to 5 s, 1 ms).
//!
//! A chain between two walls: masses 1 to 2 kg, springs 500 to 1000 N/m, dashpots 1 to 5 N s/m, each 1, 500 or 1 plus 1,
//! 500 or 4 times the next number of the generator x -> 6364136223846793005 x + 1442695040888963407 mod 2^64 from x = n,
//! its upper 32 bits over 2^32 - 1: the n masses first, then spring and dashpot of each of the n + 1 links. "Proportional"
//! has C = 0.8 M + 0.001 K in place of the dashpots. Unit forces sin(60 t) on the first and last unknown, from rest.
//! Medians of wall time, decomposition included.

use era::transient::{
    Harmonic, Initial, Outputs, Propagator, Quantity, SecondOrder, TimeGrid, TransientError, as_published, steady_state,
};
use nalgebra::{DMatrix, DVector};
use std::hint::black_box;
use std::time::Instant;

const GRID: TimeGrid = TimeGrid { step_s: 1e-3, count: 5001 };

fn chain(n: usize) -> SecondOrder {
    let mut seed = n as u64;
    let mut next = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        #[allow(clippy::cast_precision_loss, reason = "32 bits")]
        let upper = (seed >> 32) as f64;
        upper / f64::from(u32::MAX)
    };
    let (mut c, mut k) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
    let m = DMatrix::from_diagonal(&DVector::from_fn(n, |_, _| 1.0 + next()));
    for link in 0..=n {
        let (spring, dashpot) = (500.0 + 500.0 * next(), 1.0 + 4.0 * next());
        for (matrix, value) in [(&mut k, spring), (&mut c, dashpot)] {
            if link > 0 {
                matrix[(link - 1, link - 1)] += value;
            }
            if link < n {
                matrix[(link, link)] += value;
            }
            if link > 0 && link < n {
                matrix[(link - 1, link)] -= value;
                matrix[(link, link - 1)] -= value;
            }
        }
    }
    SecondOrder { m, c, k }
}

/// Median time in ms of some runs.
fn median_ms(runs: usize, mut run: impl FnMut() -> Result<(), TransientError>) -> Result<f64, TransientError> {
    let mut times = Vec::with_capacity(runs);
    for _ in 0..runs {
        let started = Instant::now();
        run()?;
        times.push(started.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok(times[runs / 2])
}

fn main() -> Result<(), TransientError> {
    println!(
        "{:>12} {:>3} {:>12} {:>12} {:>12} {:>12} {:>14} {:>10}",
        "damping", "n", "two outputs", "all outputs", "steady", "steady again", "as published", "difference"
    );
    println!("{:>12} {:>3} {:>12} {:>12} {:>12} {:>12} {:>14}", "", "", "ms", "ms", "us", "us", "ms");
    for n in [4, 8, 16, 20, 40, 60] {
        for proportional in [true, false] {
            let mut system = chain(n);
            if proportional {
                system.c = &system.m * 0.8 + &system.k * 1e-3;
            }
            let mut force_n = DVector::zeros(n);
            (force_n[0], force_n[n - 1]) = (1.0, 1.0);
            let drives = [Harmonic { omega_rad_s: 60.0, phase_rad: -std::f64::consts::FRAC_PI_2, force_n }];
            let rest = Initial::rest(n);
            let mut two = DMatrix::zeros(2, n);
            (two[(0, 3)], two[(1, n.max(6) - 3)]) = (1.0, 1.0);
            let full = |outputs: Outputs<'_>| {
                Propagator::new(&system, GRID)?.harmonic(&rest, &drives, outputs, Quantity::Displacement)
            };
            let few_ms = median_ms(101, || full(Outputs::Rows(&two)).map(|out| drop(black_box(out))))?;
            let all_ms = median_ms(101, || full(Outputs::All).map(|out| drop(black_box(out))))?;
            let steady_ms = median_ms(1001, || steady_state(&system, &drives[0]).map(|u| drop(black_box(u))))?;
            let ready = Propagator::new(&system, GRID)?;
            let again_ms = median_ms(1001, || ready.steady(&drives[0]).map(|u| drop(black_box(u))))?;
            let published_ms = median_ms(5, || {
                as_published::displacements(&system, &rest, &drives, GRID).map(|out| drop(black_box(out)))
            })?;
            let published = as_published::displacements(&system, &rest, &drives, GRID)?;
            let difference = (full(Outputs::All)? - &published).amax() / published.amax();
            println!(
                "{:>12} {n:>3} {few_ms:>12.3} {all_ms:>12.3} {:>12.2} {:>12.2} {published_ms:>14.2} {difference:>10.1e}",
                if proportional { "proportional" } else { "dashpots" },
                steady_ms * 1e3,
                again_ms * 1e3
            );
        }
    }
    Ok(())
}
