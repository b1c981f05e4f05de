//! One damped oscillator, q'' + c q' + lambda q = 0, propagated exactly.

/// The propagator over some time: (q, q') to (f q + g q', df q + dg q').
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OscillatorStep {
    /// Displacement from displacement.
    pub f: f64,
    /// Displacement from velocity, s.
    pub g: f64,
    /// Velocity from displacement, 1/s.
    pub df: f64,
    /// Velocity from velocity.
    pub dg: f64,
}

impl OscillatorStep {
    /// Over `time_s`, for squared angular frequency `lambda` (rad^2/s^2, any sign) and damping `damping` (1/s).
    ///
    /// With a = c/2 and s^2 = lambda - a^2: g = e^(-a t) sin(s t)/s, f = e^(-a t) cos(s t) + a g, f' = -lambda g,
    /// g' = e^(-a t) cos(s t) - a g. Both sides of critical damping have the limit g = t e^(-a t) at s = 0, and neither
    /// divides a difference of nearly equal numbers by s: sin(s t)/s below, (1 - e^(-2 s t)) / 2s (by `exp_m1`) above.
    #[must_use]
    pub fn from_time_and_mode(time_s: f64, lambda: f64, damping: f64) -> Self {
        let a = 0.5 * damping;
        // (w - a)(w + a) rather than w^2 - a^2, which loses half the digits near critical damping.
        let square = if lambda >= 0.0 {
            let omega = lambda.sqrt();
            (omega - a) * (omega + a)
        } else {
            lambda - a * a
        };
        let s = square.abs().sqrt();
        let (cosine, g) = if square >= 0.0 {
            let decay = (-a * time_s).exp();
            let (sin, cos) = (s * time_s).sin_cos();
            (decay * cos, decay * if s > 0.0 { sin / s } else { time_s })
        } else {
            // e^((s - a) t): s - a cancels under strong damping, where it is -lambda / (s + a).
            let slow = if a > 0.0 { -lambda / (s + a) } else { s - a };
            let decay = (slow * time_s).exp();
            let minus = (-2.0 * s * time_s).exp_m1();
            (0.5 * decay * (2.0 + minus), -0.5 * decay * minus / s)
        };
        Self { f: cosine + a * g, g, df: -lambda * g, dg: cosine - a * g }
    }

    /// Where (q, q') is after the step.
    #[must_use]
    pub fn advance_state(&self, (q, v): (f64, f64)) -> (f64, f64) {
        (self.f * q + self.g * v, self.df * q + self.dg * v)
    }
}

/// Rate in 1/s at which the slower part of the motion dies out; negative if it grows.
#[must_use]
pub fn slower_decay_rate_per_s(lambda: f64, damping: f64) -> f64 {
    let a = 0.5 * damping;
    let square = a * a - lambda;
    if square <= 0.0 {
        return a;
    }
    let s = square.sqrt();
    if a > 0.0 { lambda / (a + s) } else { a - s }
}
