//! Medians of times.

use std::time::Instant;

/// The middle of some numbers; NaN of none.
#[must_use]
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// What `work` gives, and how long it took in s.
///
/// # Errors
/// Those of `work`.
pub fn timed<T, E>(work: impl FnOnce() -> Result<T, E>) -> Result<(T, f64), E> {
    let started = Instant::now();
    let out = work()?;
    Ok((out, started.elapsed().as_secs_f64()))
}

/// Median time of some runs in s.
///
/// # Errors
/// Those of `work`.
pub fn median_s<T, E>(runs: usize, mut work: impl FnMut() -> Result<T, E>) -> Result<f64, E> {
    let times =
        (0..runs).map(|_| timed(|| work().map(std::hint::black_box)).map(|(_, s)| s)).collect::<Result<_, _>>()?;
    Ok(median(times))
}

#[cfg(test)]
mod tests {
    use super::median;

    #[test]
    fn median_is_the_middle() {
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
        assert!(median(Vec::new()).is_nan());
    }
}
