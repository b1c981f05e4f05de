//! The simulated accelerometer: a band-limited sensor fixed to the surface.

use num_complex::Complex64;
use std::collections::VecDeque;

/// Corner of the sensor's low-pass in Hz, as of common MEMS parts; the skin feels nothing above it either. Without a band
/// limit the peak under square-edged forces would mean nothing: a plate's acceleration under a step of force is an
/// impulse.
pub const BANDWIDTH_HZ: f64 = 1000.0;
/// Time over which the peak is held at least, however often it is read: longer than a period at 20 Hz, shorter than a person notices.
const HOLD_S: f64 = 0.05;

/// One second-order section of a Butterworth low-pass (bilinear transform, direct form 2 transposed).
#[derive(Clone, Copy, Debug)]
struct FilterSection {
    b: [f64; 3],
    a: [f64; 2],
    state: [f64; 2],
}

impl FilterSection {
    /// `quality_factor` is 1/(2 cos theta) of the pole pair.
    fn new_low_pass(corner_hz: f64, quality_factor: f64, step_s: f64) -> Self {
        let w = (std::f64::consts::PI * corner_hz * step_s).tan();
        let norm = 1.0 / (1.0 + w / quality_factor + w * w);
        let b0 = w * w * norm;
        Self {
            b: [b0, 2.0 * b0, b0],
            a: [2.0 * (w * w - 1.0) * norm, (1.0 - w / quality_factor + w * w) * norm],
            state: [0.0; 2],
        }
    }

    fn filter_sample(&mut self, input: f64) -> f64 {
        let y = self.b[0] * input + self.state[0];
        self.state[0] = self.b[1] * input - self.a[0] * y + self.state[1];
        self.state[1] = self.b[2] * input - self.a[1] * y;
        y
    }
}

/// Fourth-order Butterworth low-pass at [`BANDWIDTH_HZ`], a peak hold and, if wanted, a record.
#[derive(Clone, Debug)]
pub struct Accelerometer {
    sections: [FilterSection; 2],
    held: VecDeque<f64>,
    hold_length: usize,
    /// Largest magnitude since the peak was last taken.
    unread: f64,
    /// Largest magnitude since the sensor was put where it is.
    here: f64,
    record: Option<Vec<f64>>,
}

impl Accelerometer {
    /// A sensor that is sampled every `step_s`.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small positive count")]
    pub fn new(step_s: f64) -> Self {
        // Pole pairs of a fourth-order Butterworth at 22.5 and 67.5 degrees.
        let q = |degrees: f64| 0.5 / degrees.to_radians().cos();
        Self {
            sections: [
                FilterSection::new_low_pass(BANDWIDTH_HZ, q(22.5), step_s),
                FilterSection::new_low_pass(BANDWIDTH_HZ, q(67.5), step_s),
            ],
            held: VecDeque::new(),
            hold_length: ((HOLD_S / step_s) as usize).max(1),
            unread: 0.0,
            here: 0.0,
            record: None,
        }
    }

    /// Forgets what was measured, because the sensor has been moved. A record goes on.
    pub fn forget_all_but_record(&mut self) {
        self.sections.iter_mut().for_each(|section| section.state = [0.0; 2]);
        self.held.clear();
        (self.unread, self.here) = (0.0, 0.0);
    }

    /// Keeps every sample from now on.
    pub fn start_record(&mut self) {
        self.record = Some(Vec::new());
    }

    /// The samples kept, in m/s^2.
    pub fn stop_and_take_record(&mut self) -> Vec<f64> {
        self.record.take().unwrap_or_default()
    }

    /// Takes the next sample of the surface's acceleration in m/s^2.
    pub fn add_sample(&mut self, acceleration_m_per_s2: f64) {
        let [first, second] = &mut self.sections;
        let filtered = second.filter_sample(first.filter_sample(acceleration_m_per_s2));
        if self.held.len() == self.hold_length {
            self.held.pop_front();
        }
        self.held.push_back(filtered.abs());
        self.unread = self.unread.max(filtered.abs());
        self.here = self.here.max(filtered.abs());
        if let Some(record) = &mut self.record {
            record.push(filtered);
        }
    }

    /// Largest magnitude in the last 50 ms, in m/s^2.
    #[must_use]
    pub fn peak_of_last_50_ms_m_per_s2(&self) -> f64 {
        self.held.iter().copied().fold(0.0, f64::max)
    }
}

impl Accelerometer {
    /// Largest magnitude in m/s^2 since the last call, or of the last 50 ms if that is longer: repeated calls miss no peak, and an answer that is lost
    /// does not lose a recent one.
    pub fn take_peak_since_last_call_and_at_least_50_ms_m_per_s2(&mut self) -> f64 {
        std::mem::take(&mut self.unread).max(self.peak_of_last_50_ms_m_per_s2())
    }

    /// Largest magnitude in m/s^2 since the sensor was put where it is; reading it changes nothing.
    #[must_use]
    pub const fn peak_since_placed_m_per_s2(&self) -> f64 {
        self.here
    }
}

/// Complex response of the sensor's low-pass at `frequency_hz`: an analogue fourth-order Butterworth.
#[must_use]
pub fn low_pass_response(frequency_hz: f64) -> Complex64 {
    let s = Complex64::new(0.0, frequency_hz / BANDWIDTH_HZ);
    [22.5_f64, 67.5].iter().map(|degrees| 1.0 / (s * s + s * 2.0 * degrees.to_radians().cos() + 1.0)).product()
}

/// The magnitude of [`low_pass_response`].
#[must_use]
pub fn low_pass_gain(frequency_hz: f64) -> f64 {
    low_pass_response(frequency_hz).norm()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whoever reads it a second later has the peak of 2 ms, once; elsewhere it has not been.
    #[test]
    fn a_short_peak_is_held_until_it_is_read() {
        let mut sensor = Accelerometer::new(1e-4);
        let rest = |sensor: &mut Accelerometer, steps: u32| (0..steps).for_each(|_| sensor.add_sample(0.0));
        (0..20).for_each(|_| sensor.add_sample(3.0));
        rest(&mut sensor, 10_000);
        // What is left of the filter's motion may be the least number that there is.
        assert!(sensor.peak_of_last_50_ms_m_per_s2() < f64::MIN_POSITIVE);
        let peak = sensor.take_peak_since_last_call_and_at_least_50_ms_m_per_s2();
        assert!((3.0..3.5).contains(&peak), "{peak}");
        assert!(
            sensor.take_peak_since_last_call_and_at_least_50_ms_m_per_s2() < f64::MIN_POSITIVE
                && sensor.peak_since_placed_m_per_s2() == peak
        );
        // An answer that is lost at once is given again.
        (0..20).for_each(|_| sensor.add_sample(3.0));
        assert_eq!(
            [
                sensor.take_peak_since_last_call_and_at_least_50_ms_m_per_s2(),
                sensor.take_peak_since_last_call_and_at_least_50_ms_m_per_s2()
            ],
            [peak; 2]
        );
        sensor.forget_all_but_record();
        rest(&mut sensor, 1);
        assert_eq!(
            (sensor.take_peak_since_last_call_and_at_least_50_ms_m_per_s2(), sensor.peak_since_placed_m_per_s2()),
            (0.0, 0.0)
        );
    }

    #[test]
    fn digital_and_analogue_low_pass_agree() {
        let step_s = 25e-6;
        for frequency_hz in [50.0, 400.0, 1000.0, 1500.0] {
            let mut sensor = Accelerometer::new(step_s);
            for i in 0..20_000 {
                sensor.add_sample((std::f64::consts::TAU * frequency_hz * f64::from(i) * step_s).sin());
            }
            let (found, expected) = (sensor.peak_of_last_50_ms_m_per_s2(), low_pass_gain(frequency_hz));
            assert!((found - expected).abs() < 0.02 * expected, "{frequency_hz}: {found} {expected}");
        }
    }
}
