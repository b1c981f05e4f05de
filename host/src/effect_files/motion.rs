//! The acceleration of an effect's places over time, and files of it.

use super::panel::PanelEffect;
use crate::effects::intensity::mode_shape_values_at_point_or_on_bar_axis;
use crate::effects::sample_acceleration_of_design_unless_undamped_m_per_s2;
use crate::planner::rise::PanelPoles;
use crate::planner::{PlanTable, STANDARD_GRAVITY};
use hound::{SampleFormat, WavSpec, WavWriter};
use std::fmt::Write;
use std::io::Cursor;

/// Samples per s: eight in a period of 1 kHz, the highest frequency that is computed.
pub const RATE_HZ: u32 = 8000;

/// Acceleration at every place of an effect in g, [`RATE_HZ`] samples per s from the effect's begin on. Parts are added: what an earlier one
/// leaves goes on under the next. `None` at an undamped resonance.
#[must_use]
pub fn sample_acceleration_g(table: &PlanTable, poles: &PanelPoles, effect: &PanelEffect) -> Option<Vec<Vec<f64>>> {
    let step_s = 1.0 / f64::from(RATE_HZ);
    let one_place = |place: &super::panel::PanelPlace| {
        let shape = mode_shape_values_at_point_or_on_bar_axis(table, place.x_m, place.y_m);
        let mut sum: Vec<f64> = Vec::new();
        for part in &effect.parts {
            let alone =
                sample_acceleration_of_design_unless_undamped_m_per_s2(table, poles, &part.design, &shape, step_s)?;
            let begin = part.begin_ms * RATE_HZ as usize / 1000;
            sum.resize(sum.len().max(begin + alone.len()), 0.0);
            sum.iter_mut().skip(begin).zip(alone).for_each(|(sum, x)| *sum += x / STANDARD_GRAVITY);
        }
        Some(sum)
    };
    let mut all = effect.places.iter().map(one_place).collect::<Option<Vec<Vec<f64>>>>()?;
    let longest = all.iter().map(Vec::len).max().unwrap_or(0);
    all.iter_mut().for_each(|samples| samples.resize(longest, 0.0));
    Some(all)
}

/// A table of all samples, one column per place.
#[must_use]
pub fn format_csv(places_mm: &[(f64, f64)], samples_g: &[Vec<f64>]) -> String {
    let mut text = String::from("time_s");
    for (x_mm, y_mm) in places_mm {
        let _ = write!(text, ",acceleration_g at {x_mm:.1} mm {y_mm:.1} mm");
    }
    text.push('\n');
    for (i, time) in (0..samples_g.first().map_or(0, Vec::len)).zip(0_u32..) {
        let _ = write!(text, "{:.6}", f64::from(time) / f64::from(RATE_HZ));
        for samples in samples_g {
            let _ = write!(text, ",{:.6}", samples.get(i).copied().unwrap_or(0.0));
        }
        text.push('\n');
    }
    text
}

/// A sound with one channel per place: samples are the acceleration in g, as numbers of 32 bits with a point.
///
/// # Errors
/// What the library for WAV says.
pub fn format_wav(samples_g: &[Vec<f64>]) -> Result<Vec<u8>, hound::Error> {
    let channels = u16::try_from(samples_g.len()).unwrap_or(u16::MAX);
    let spec = WavSpec { channels, sample_rate: RATE_HZ, bits_per_sample: 32, sample_format: SampleFormat::Float };
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = WavWriter::new(&mut bytes, spec)?;
    for i in 0..samples_g.first().map_or(0, Vec::len) {
        for samples in samples_g {
            #[expect(clippy::cast_possible_truncation, reason = "seven digits are enough for an acceleration")]
            writer.write_sample(samples.get(i).copied().unwrap_or(0.0) as f32)?;
        }
    }
    writer.finalize()?;
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_every_sample_of_every_place() {
        let samples = [vec![0.0, 0.25, -0.5], vec![1.0, 2.0, 3.0]];
        let csv = format_csv(&[(1.0, 2.0), (3.0, 4.0)], &samples);
        let expected = "time_s,acceleration_g at 1.0 mm 2.0 mm,acceleration_g at 3.0 mm 4.0 mm\n\
            0.000000,0.000000,1.000000\n0.000125,0.250000,2.000000\n0.000250,-0.500000,3.000000\n";
        assert_eq!(csv, expected);
        let wav = format_wav(&samples).unwrap();
        let mut read = hound::WavReader::new(&wav[..]).unwrap();
        assert_eq!((read.spec().channels, read.spec().sample_rate), (2, RATE_HZ));
        let found: Vec<f32> = read.samples().collect::<Result<_, _>>().unwrap();
        assert_eq!(found, [0.0, 1.0, 0.25, 2.0, -0.5, 3.0]);
    }
}
