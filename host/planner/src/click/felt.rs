//! The felt band, and motions as samples of it.
//!
//! The skin's sensitivity falls above 300 Hz: a frequency counts in full up to 300 Hz and not at all from 500 Hz on, with half a period of a
//! raised cosine in between. A record is 1 s long, so that its lines are 1 Hz apart, and begins again at its end: what comes
//! before its beginning, as the band has no phase, is at its end.

use num_complex::Complex64;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use std::f64::consts::FRAC_PI_2;
use std::sync::{Arc, LazyLock};

/// Frequency in Hz up to which motion counts in full.
const FULL_TO_HZ: f64 = 300.0;
/// Frequency in Hz from which on it does not count.
const NOTHING_FROM_HZ: f64 = 500.0;
/// Highest line that counts.
pub const LAST_LINE: usize = 499;
/// Highest line that an accelerometer of 1 kHz shows.
pub const LAST_SHOWN_LINE: usize = 1000;
/// Samples of a record of 1 s.
pub const RECORD: usize = 4000;
/// Time between two samples in s.
pub const SAMPLE_S: f64 = 1.0 / RECORD as f64;
/// Samples of a record of which figures are read: of a motion at 300 Hz the crest is missed by (pi 300 / 16000)^2 / 2 = 0.2 %.
pub const FINE_RECORD: usize = 16_000;

/// The transforms between a record and its lines.
struct Transforms {
    to_lines: Arc<dyn RealToComplex<f64>>,
    to_record: Arc<dyn ComplexToReal<f64>>,
    to_fine_record: Arc<dyn ComplexToReal<f64>>,
}

static TRANSFORMS: LazyLock<Transforms> = LazyLock::new(|| {
    let mut planner = RealFftPlanner::new();
    Transforms {
        to_lines: planner.plan_fft_forward(RECORD),
        to_record: planner.plan_fft_inverse(RECORD),
        to_fine_record: planner.plan_fft_inverse(FINE_RECORD),
    }
});

/// What a frequency in Hz counts, 0 to 1.
#[must_use]
pub fn weigh_frequency(frequency_hz: f64) -> f64 {
    let beyond = (frequency_hz - FULL_TO_HZ) / (NOTHING_FROM_HZ - FULL_TO_HZ);
    (FRAC_PI_2 * beyond.clamp(0.0, 1.0)).cos().powi(2)
}

/// A record of [`RECORD`] samples from its spectrum per Hz at 1, 2, ... Hz, which is weighed.
#[must_use]
pub fn record_from_spectrum(spectrum: impl Iterator<Item = Complex64>) -> Vec<f64> {
    let mut lines = vec![Complex64::ZERO; RECORD / 2 + 1];
    for ((place, value), hz) in lines.iter_mut().skip(1).zip(spectrum).zip(1_u32..) {
        *place = value * weigh_frequency(f64::from(hz));
    }
    run_inverse(&*TRANSFORMS.to_record, &mut lines, RECORD)
}

/// The felt part of a motion whose mean over each [`SAMPLE_S`] is given, as [`FINE_RECORD`] samples at the times 0, 1/16 ms, ...; the mean over
/// the whole record is left out.
#[must_use]
pub fn felt_motion_from_means(means: &[f64]) -> Vec<f64> {
    motion_from_means(means, LAST_LINE, weigh_frequency)
}

/// The same of all that is below 1 kHz, as an accelerometer shows it.
#[must_use]
pub fn shown_motion_from_means(means: &[f64]) -> Vec<f64> {
    motion_from_means(means, LAST_SHOWN_LINE, |_| 1.0)
}

fn motion_from_means(means: &[f64], last_line: usize, weigh: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut fine = vec![Complex64::ZERO; FINE_RECORD / 2 + 1];
    let lines = list_lines_from_means(means, last_line);
    for ((place, line), hz) in fine.iter_mut().skip(1).zip(lines).zip(1_u32..) {
        *place = line * weigh(f64::from(hz));
    }
    run_inverse(&*TRANSFORMS.to_fine_record, &mut fine, FINE_RECORD)
}

/// The lines of a motion whose mean over each [`SAMPLE_S`] is given, at 1, 2, ... Hz up to `last_line`: half the amplitude of each frequency.
#[must_use]
pub fn list_lines_from_means(means: &[f64], last_line: usize) -> Vec<Complex64> {
    let mut record = vec![0.0; RECORD];
    record.iter_mut().zip(means).for_each(|(place, mean)| *place = *mean);
    let mut lines = TRANSFORMS.to_lines.make_output_vec();
    if TRANSFORMS.to_lines.process(&mut record, &mut lines).is_err() {
        // Lengths are those of the plan.
        return Vec::new();
    }
    let correct = |(line, hz): (Complex64, u32)| {
        // A mean belongs to the middle of its time, and takes sin(x) / x off.
        let x = std::f64::consts::PI * f64::from(hz) * SAMPLE_S;
        line * Complex64::cis(-x) * (SAMPLE_S * x / x.sin())
    };
    lines.into_iter().zip(0_u32..).take(last_line + 1).skip(1).map(correct).collect()
}

fn run_inverse(transform: &dyn ComplexToReal<f64>, lines: &mut [Complex64], samples: usize) -> Vec<f64> {
    let mut record = vec![0.0; samples];
    // It fails only if the first or last line is not real, and they are 0.
    if transform.process(lines, &mut record).is_err() {
        record.fill(0.0);
    }
    record
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn the_band_is_full_to_300_hz_and_ends_at_500() {
        let weights = [0.0, 299.0, 300.0, 400.0, 500.0, 900.0].map(weigh_frequency);
        let expected = [1.0, 1.0, 1.0, 0.5, 0.0, 0.0];
        assert!(weights.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-12), "{weights:?}");
    }

    /// Means of sines over a quarter of a ms come back as the sines, the felt part of them.
    #[test]
    fn means_become_what_is_felt() {
        for (hz, felt) in [(7.0, 1.0), (250.0, 1.0), (400.0, 0.5), (700.0, 0.0)] {
            let integral = |t: f64| -(TAU * hz * t).cos() / (TAU * hz);
            let means: Vec<f64> = (0..4000)
                .map(|k| f64::from(k) * SAMPLE_S)
                .map(|t| (integral(t + SAMPLE_S) - integral(t)) / SAMPLE_S)
                .collect();
            let found = felt_motion_from_means(&means);
            for (k, found) in (0..16_000).zip(found) {
                let expected = felt * (TAU * hz * f64::from(k) / 16e3).sin();
                assert!((found - expected).abs() < 1e-9, "{hz} Hz, sample {k}: {found} {expected}");
            }
        }
    }

    #[test]
    fn a_spectrum_becomes_its_record() {
        // cos(2 pi 50 t) has half an amplitude at each of 50 and -50 Hz.
        let found =
            record_from_spectrum((1..=499).map(|hz| if hz == 50 { Complex64::from(0.5) } else { Complex64::ZERO }));
        for (k, found) in (0..4000).zip(found) {
            assert!((found - (TAU * 50.0 * f64::from(k) / 4e3).cos()).abs() < 1e-12, "sample {k}");
        }
    }
}
