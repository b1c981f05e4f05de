//! The felt band, and motions as samples of it.
//!
//! The skin's sensitivity falls above 300 Hz: a frequency counts in full up to 300 Hz and not at all from 500 Hz on, with half a period of a
//! raised cosine in between. A record is 1 s long, so that its lines are 1 Hz apart, and begins again at its end: what comes
//! before its beginning, as the band has no phase, is at its end.

use num_complex::Complex64;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use std::f64::consts::{FRAC_PI_2, PI};
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
/// Steps of the integration in 1 s.
pub const STEPS: usize = 10 * RECORD;
/// Steps from which one sample of a force is taken.
const STEPS_OF_FORCE_SAMPLE: usize = 5;
/// Time between two samples in s.
pub const SAMPLE_S: f64 = 1.0 / RECORD as f64;
/// Means of a motion in 1 s: one for every two steps. Of means over [`SAMPLE_S`], what lies near 4 kHz would be folded into what is felt: up to 7 %
/// of a click of a stiff bar, which follows the edges of its windows.
pub const MEANS: usize = STEPS / 2;
/// Time in s over which a mean is taken.
pub const MEAN_S: f64 = 1.0 / MEANS as f64;
/// Samples of a record of which figures are read: of a motion at 300 Hz the crest is missed by (pi 300 / 16000)^2 / 2 = 0.2 %.
pub const FINE_RECORD: usize = 16_000;

/// The transforms between a record and its lines.
struct Transforms {
    means_to_lines: Arc<dyn RealToComplex<f64>>,
    force_samples_to_lines: Arc<dyn RealToComplex<f64>>,
    to_record: Arc<dyn ComplexToReal<f64>>,
    to_fine_record: Arc<dyn ComplexToReal<f64>>,
}

static TRANSFORMS: LazyLock<Transforms> = LazyLock::new(|| {
    let mut planner = RealFftPlanner::new();
    Transforms {
        means_to_lines: planner.plan_fft_forward(MEANS),
        force_samples_to_lines: planner.plan_fft_forward(STEPS / STEPS_OF_FORCE_SAMPLE),
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
pub fn weigh_spectrum_and_transform_to_felt_record(spectrum: impl Iterator<Item = Complex64>) -> Vec<f64> {
    let mut lines = vec![Complex64::ZERO; RECORD / 2 + 1];
    for ((place, value), hz) in lines.iter_mut().skip(1).zip(spectrum).zip(1_u32..) {
        *place = value * weigh_frequency(f64::from(hz));
    }
    inverse_fft_unscaled_or_zeros_on_error(&*TRANSFORMS.to_record, &mut lines, RECORD)
}

/// The felt part of a motion whose mean over each [`MEAN_S`] is given, as [`FINE_RECORD`] samples at the times 0, 1/16 ms, ...; the mean over
/// the whole record is left out.
#[must_use]
pub fn filter_50_us_means_to_felt_motion_at_16_khz(means: &[f64]) -> Vec<f64> {
    filter_50_us_means_and_resample_to_16_khz(means, LAST_LINE, weigh_frequency)
}

/// The same of all that is below 1 kHz, as an accelerometer shows it.
#[must_use]
pub fn filter_50_us_means_to_motion_below_1_khz_at_16_khz(means: &[f64]) -> Vec<f64> {
    filter_50_us_means_and_resample_to_16_khz(means, LAST_SHOWN_LINE, |_| 1.0)
}

fn filter_50_us_means_and_resample_to_16_khz(means: &[f64], last_line: usize, weigh: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut fine = vec![Complex64::ZERO; FINE_RECORD / 2 + 1];
    let lines = spectral_lines_from_50_us_means(means, last_line);
    for ((place, line), hz) in fine.iter_mut().skip(1).zip(lines).zip(1_u32..) {
        *place = line * weigh(f64::from(hz));
    }
    inverse_fft_unscaled_or_zeros_on_error(&*TRANSFORMS.to_fine_record, &mut fine, FINE_RECORD)
}

/// The lines of a motion whose mean over each [`MEAN_S`] is given, at 1, 2, ... Hz up to `last_line`: half the amplitude of each frequency.
#[must_use]
pub fn spectral_lines_from_50_us_means(means: &[f64], last_line: usize) -> Vec<Complex64> {
    list_spectral_lines(means, &*TRANSFORMS.means_to_lines, last_line)
}

/// The same of what is given as its mean over each of [`STEPS`] steps of 1 s: forces of windows, whose lines above 2 kHz would be folded into those
/// that count if they were given as means over [`SAMPLE_S`]. Three moving means over five steps come before every fifth is taken (a cascaded
/// integrator-comb decimator): what is folded onto a line of up to 1 kHz lies at 7 kHz or above, of which (sin(7 pi / 8) / (7 pi / 8))^3 =
/// 0.3 % or less is left.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "five steps")]
pub fn spectral_lines_from_25_us_step_means(steps: &[f64], last_line: usize) -> Vec<Complex64> {
    const WIDTH: usize = STEPS_OF_FORCE_SAMPLE;
    let mut smooth = steps.to_vec();
    for _ in 0..3 {
        let mean_up_to = |last: usize| {
            let those = (last + 1).saturating_sub(WIDTH)..(last + 1).min(smooth.len());
            smooth.get(those).map_or(0.0, |those| those.iter().sum::<f64>() / WIDTH as f64)
        };
        smooth = (0..smooth.len() + WIDTH - 1).map(mean_up_to).collect();
    }
    let samples: Vec<f64> = smooth.into_iter().step_by(WIDTH).collect();
    let lines = list_spectral_lines(&samples, &*TRANSFORMS.force_samples_to_lines, last_line);
    let undo_smoothing = |(line, hz): (Complex64, u32)| {
        let half_step = PI * f64::from(hz) / STEPS as f64;
        let left = (WIDTH as f64 * half_step).sin() / (WIDTH as f64 * half_step.sin());
        // One of the three is the mean that a sample is taken for, and ends with the sample's first step in place of its last one, 4 steps later. The
        // two others add 2 steps each.
        line * Complex64::cis(16.0 * half_step) / (left * left)
    };
    lines.into_iter().zip(1_u32..).map(undo_smoothing).collect()
}

fn list_spectral_lines(means: &[f64], to_lines: &dyn RealToComplex<f64>, last_line: usize) -> Vec<Complex64> {
    let mut record = to_lines.make_input_vec();
    record.iter_mut().zip(means).for_each(|(place, mean)| *place = *mean);
    #[expect(clippy::cast_precision_loss, reason = "some thousand samples")]
    let sample_s = 1.0 / record.len() as f64;
    let mut lines = to_lines.make_output_vec();
    if to_lines.process(&mut record, &mut lines).is_err() {
        // Lengths are those of the plan.
        return Vec::new();
    }
    let correct = |(line, hz): (Complex64, u32)| {
        // A mean belongs to the middle of its time, and takes sin(x) / x off.
        let x = PI * f64::from(hz) * sample_s;
        line * Complex64::cis(-x) * (sample_s * x / x.sin())
    };
    lines.into_iter().zip(0_u32..).take(last_line + 1).skip(1).map(correct).collect()
}

fn inverse_fft_unscaled_or_zeros_on_error(
    transform: &dyn ComplexToReal<f64>,
    lines: &mut [Complex64],
    samples: usize,
) -> Vec<f64> {
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

    /// Means of sines over 50 us come back as the sines, the felt part of them.
    #[test]
    fn means_become_what_is_felt() {
        for (hz, felt) in [(7.0, 1.0), (250.0, 1.0), (400.0, 0.5), (700.0, 0.0)] {
            let integral = |t: f64| -(TAU * hz * t).cos() / (TAU * hz);
            let means: Vec<f64> = (0..20_000)
                .map(|k| f64::from(k) * MEAN_S)
                .map(|t| (integral(t + MEAN_S) - integral(t)) / MEAN_S)
                .collect();
            let found = filter_50_us_means_to_felt_motion_at_16_khz(&means);
            for (k, found) in (0..16_000).zip(found) {
                let expected = felt * (TAU * hz * f64::from(k) / 16e3).sin();
                assert!((found - expected).abs() < 1e-9, "{hz} Hz, sample {k}: {found} {expected}");
            }
        }
    }

    /// The lines of short windows of force, whose edges lie anywhere, against their integral: (e^(-i w a) - e^(-i w b)) / (i w). At 1 kHz, what is folded
    /// from 7 and from 9 kHz is 0.4 % together.
    #[test]
    fn steps_of_force_become_their_lines() {
        for (from_s, to_s) in [(0.0_f64, 0.3e-3_f64), (1.013e-3, 1.061e-3), (0.02037, 0.02119)] {
            let step_s = 1.0 / STEPS as f64;
            let mean = |k: u32| {
                let begin_s = f64::from(k) * step_s;
                (to_s.min(begin_s + step_s) - from_s.max(begin_s)).max(0.0) / step_s
            };
            let steps: Vec<f64> = (0..900).map(mean).collect();
            let lines = spectral_lines_from_25_us_step_means(&steps, 1000);
            for (line, hz) in lines.iter().zip(1_u32..) {
                let turn = TAU * f64::from(hz);
                let expected =
                    (Complex64::cis(-turn * from_s) - Complex64::cis(-turn * to_s)) / Complex64::new(0.0, turn);
                assert!((line - expected).norm() < 5e-3 * (to_s - from_s), "{from_s}, {hz} Hz: {line} {expected}");
            }
            assert_eq!(lines.len(), 1000);
        }
    }

    #[test]
    fn a_spectrum_becomes_its_record() {
        // cos(2 pi 50 t) has half an amplitude at each of 50 and -50 Hz.
        let found = weigh_spectrum_and_transform_to_felt_record(
            (1..=499).map(|hz| if hz == 50 { Complex64::from(0.5) } else { Complex64::ZERO }),
        );
        for (k, found) in (0..4000).zip(found) {
            assert!((found - (TAU * 50.0 * f64::from(k) / 4e3).cos()).abs() < 1e-12, "sample {k}");
        }
    }
}
