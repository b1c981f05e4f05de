//! Medians of times.

use std::time::Instant;

/// The middle one of some numbers, the upper of two; NaN of none.
#[must_use]
pub fn compute_median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Runs `work` once: what it gives, and how long it took in s.
///
/// # Errors
/// Those of `work`.
pub fn run_and_time_s<T, E>(work: impl FnOnce() -> Result<T, E>) -> Result<(T, f64), E> {
    let started = Instant::now();
    let out = work()?;
    Ok((out, started.elapsed().as_secs_f64()))
}

/// Median time of `runs` runs of `work` in s.
///
/// # Errors
/// Those of `work`.
pub fn measure_median_time_s<T, E>(runs: usize, mut work: impl FnMut() -> Result<T, E>) -> Result<f64, E> {
    let times = (0..runs)
        .map(|_| run_and_time_s(|| work().map(std::hint::black_box)).map(|(_, s)| s))
        .collect::<Result<_, _>>()?;
    Ok(compute_median(times))
}

#[cfg(test)]
mod tests {
    use super::compute_median;

    #[test]
    fn median_is_the_middle() {
        assert_eq!(compute_median(vec![3.0, 1.0, 2.0]), 2.0);
        assert!(compute_median(Vec::new()).is_nan());
    }
}
