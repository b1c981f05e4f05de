//! Frequencies that are close together only where responses change.

use crate::TableOptions;
use crate::model::ReducedModel;
use std::f64::consts::TAU;

/// Steps from a resonance to where its response has fallen to half its power, along the curve. Of a crest that lies between two
/// frequencies 1 - (1 + (1/8)^2)^(-1/2) = 0.8 % are missed.
const STEPS: f64 = 4.0;
/// Widest step in Hz: where two drives want the same resonance, one of them goes 20 Hz beside it, or as little further as frequencies allow.
const WIDEST_HZ: f64 = 3.0;

/// Some of the frequencies of the grid `options`, ascending, the lowest and the highest among them. A mode at f1 with half a width b at half its power changes at f within
/// sqrt((f - f1)^2 + b^2), its distance from the pole.
#[must_use]
pub(super) fn choose_frequencies_denser_near_modes_hz(model: &ReducedModel, options: TableOptions) -> Vec<f64> {
    let poles: Vec<(f64, f64)> = (0..model.count_coordinates())
        .filter(|k| model.lambda[*k] > 0.0)
        .map(|k| {
            let omega = model.lambda[k].sqrt();
            let loss = model.structural[(k, k)] / omega + model.viscous[(k, k)];
            (omega / TAU, 0.5 * loss / TAU)
        })
        .collect();
    let step_hz = options.step_hz;
    let mut next_hz = f64::NEG_INFINITY;
    let all = options.frequencies_hz();
    let last_hz = all.last().copied().unwrap_or_default();
    let is_wanted = |hz: &f64| {
        // A grid's frequency, to rounding.
        if *hz < next_hz - 1e-6 * step_hz && *hz < last_hz {
            return false;
        }
        let distances = poles.iter().map(|(pole_hz, half_hz)| (hz - pole_hz).hypot(*half_hz));
        let nearest_hz = distances.fold(f64::INFINITY, f64::min);
        next_hz = hz + (nearest_hz / STEPS).clamp(step_hz, WIDEST_HZ.max(step_hz));
        true
    };
    all.into_iter().filter(is_wanted).collect()
}
