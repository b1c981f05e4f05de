//! A sound as intensity over time: its loudness is the intensity, and its frequency the sharpness.

use super::error::ReadError;
use super::events::{EnvelopePoint, EventList, HapticEvent, MAX_DURATION_S, sharpness_from_hz};
use super::format::FileFormat;
use hound::{SampleFormat, WavReader};

/// Time over which the largest sample counts, in s: half a period of 50 Hz.
const WINDOW_S: f64 = 0.01;
/// Rates in Hz that are read.
const RATES_HZ: (u32, u32) = (1000, 192_000);
/// Level below which nothing is felt.
const SILENT: f64 = 0.01;

/// Reads a sound of any number of channels, the mean of which counts.
///
/// # Errors
/// [`ReadError`] for what is no WAV, or of another rate.
pub fn read_wav_bytes(bytes: &[u8]) -> Result<EventList, ReadError> {
    let broken = |error: hound::Error| {
        let detail = match error {
            hound::Error::IoError(_) => "the file ends too early".to_owned(),
            other => other.to_string(),
        };
        ReadError::Syntax { format: FileFormat::Wav, detail }
    };
    let mut reader = WavReader::new(bytes).map_err(broken)?;
    let spec = reader.spec();
    if !(RATES_HZ.0..=RATES_HZ.1).contains(&spec.sample_rate) {
        let allowed = format!("{} to {}", RATES_HZ.0, RATES_HZ.1);
        return Err(ReadError::new_field_error("sample rate in Hz", spec.sample_rate, allowed));
    }
    let mut list = EventList::new(FileFormat::Wav, None);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most some million samples")]
    let most = (MAX_DURATION_S * f64::from(spec.sample_rate)) as usize * usize::from(spec.channels);
    let samples: Vec<f64> = match spec.sample_format {
        SampleFormat::Float => {
            reader.samples::<f32>().take(most).map(|x| x.map(f64::from)).collect::<Result<_, _>>().map_err(broken)?
        }
        SampleFormat::Int => {
            let full = (2.0_f64).powi(i32::from(spec.bits_per_sample) - 1);
            let part = |x: Result<i32, hound::Error>| x.map(|x| f64::from(x) / full);
            reader.samples::<i32>().take(most).map(part).collect::<Result<_, _>>().map_err(broken)?
        }
    };
    let channels = usize::from(spec.channels.max(1));
    let mono: Vec<f64> =
        samples.chunks(channels).map(|frame| frame.iter().sum::<f64>() / f64::from(spec.channels)).collect();
    if usize::try_from(reader.duration()).is_ok_and(|frames| frames > mono.len()) {
        list.warn(format!("the part of the sound after the first {MAX_DURATION_S} s is left out"));
    }
    if channels > 1 {
        list.warn(format!("the sound has {channels} channels: their mean is used"));
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundred samples")]
    let window = (WINDOW_S * f64::from(spec.sample_rate)).round() as usize;
    let peaks: Vec<f64> =
        mono.chunks(window).map(|part| part.iter().fold(0.0_f64, |most, x| most.max(x.abs())).min(1.0)).collect();
    if mono.iter().any(|x| !x.is_finite()) {
        return Err(ReadError::Syntax { format: FileFormat::Wav, detail: "a sample is not a finite number".into() });
    }
    if peaks.iter().all(|peak| *peak < SILENT) {
        list.warn("the sound is silent");
        return list.finish();
    }
    let rises = mono.windows(2).filter(|pair| pair[0] <= 0.0 && pair[1] > 0.0).count();
    #[expect(clippy::cast_precision_loss, reason = "at most some million samples")]
    let (mean_hz, duration_s) = {
        let duration_s = mono.len() as f64 / f64::from(spec.sample_rate);
        (rises as f64 / duration_s, duration_s)
    };
    list.warn(format!(
        "the loudness of the sound over time is used as the intensity, and the mean frequency of the sound \
         ({mean_hz:.0} Hz) as the sharpness"
    ));
    let mut time_s = -0.5 * WINDOW_S;
    let envelope = peaks.iter().map(|level| {
        time_s += WINDOW_S;
        EnvelopePoint { time_s, level: *level }
    });
    let event = HapticEvent::new_continuous((0.0, duration_s), 1.0, sharpness_from_hz(mean_hz), envelope.collect());
    list.add_event_within_limits("the sound", event);
    list.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect_files::events::{EventKind, envelope_level_at};
    use hound::{WavSpec, WavWriter};
    use std::io::Cursor;

    fn sound(spec: WavSpec, samples: impl Iterator<Item = f64>) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        let mut writer = WavWriter::new(&mut bytes, spec).unwrap();
        for x in samples {
            match spec.sample_format {
                SampleFormat::Float => writer.write_sample(x as f32).unwrap(),
                SampleFormat::Int => writer.write_sample((x * 32767.0) as i16).unwrap(),
            }
        }
        writer.finalize().unwrap();
        bytes.into_inner()
    }

    #[test]
    fn a_sine_that_grows_becomes_a_ramp() {
        let spec = WavSpec { channels: 1, sample_rate: 8000, bits_per_sample: 16, sample_format: SampleFormat::Int };
        let sine = (0..8000).map(|k| f64::from(k) / 8e3).map(|t| t * (std::f64::consts::TAU * 150.0 * t).sin());
        let list = read_wav_bytes(&sound(spec, sine)).unwrap();
        let EventKind::Continuous { duration_s, envelope } = &list.events[0].kind else { panic!("a vibration") };
        assert!((*duration_s - 1.0).abs() < 1e-9 && (list.events[0].sharpness - 85.0 / 235.0).abs() < 0.01);
        for time_s in [0.2, 0.5, 0.9] {
            assert!((envelope_level_at(envelope, time_s) - time_s).abs() < 0.02, "{time_s}");
        }
    }

    #[test]
    fn long_silent_and_broken_sounds_are_reported() {
        let float = WavSpec { channels: 2, sample_rate: 1000, bits_per_sample: 32, sample_format: SampleFormat::Float };
        let list = read_wav_bytes(&sound(float, (0..80_000).map(|k| f64::from(k % 4 / 2)))).unwrap();
        let said = list.warnings.join("\n");
        assert!(said.contains("after the first 30 s") && said.contains("2 channels"), "{said}");
        let silent = read_wav_bytes(&sound(float, (0..2000).map(|_| 0.0))).unwrap_err().to_string();
        assert!(silent.contains("the sound is silent"), "{silent}");
        assert!(read_wav_bytes(b"RIFFxxxxWAVE").is_err());
        let slow = WavSpec { sample_rate: 100, ..float };
        let error = read_wav_bytes(&sound(slow, (0..200).map(|_| 0.5))).unwrap_err().to_string();
        assert_eq!(error, "sample rate in Hz is 100, but must be 1000 to 192000");
    }
}
