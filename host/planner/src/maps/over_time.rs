//! Curves over time: the acceleration of places under an effect.

use super::axes::{self, Frame};
use super::text::{self, Anchor, TextDirection};
use super::{PictureError, TITLE, write_png_picture};
use plotters::prelude::*;
use std::path::Path;

/// Width and height of a plot in pixels.
const PLOT: (i32, i32) = (1200, 240);
/// Right of a plot, in pixels.
const RIGHT: i32 = 30;
/// Colour of the curves.
const COLOR: RGBColor = RGBColor(0, 90, 200);

/// Draws one plot per curve below each other, all with one scale: a name, and samples in g at `rate_hz`. The picture's size in pixels.
///
/// # Errors
/// [`PictureError`] if the file cannot be written.
#[expect(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "sample numbers"
)]
pub fn write_accelerations_png(
    path: &Path,
    title: &str,
    rate_hz: f64,
    curves: &[(String, &[f64])],
) -> Result<(u32, u32), PictureError> {
    let most = curves.iter().flat_map(|(_, samples)| *samples).fold(0.0_f64, |most, x| most.max(x.abs()));
    let most = if most > 0.0 { 1.05 * most } else { 1.0 };
    let count = curves.iter().map(|(_, samples)| samples.len()).max().unwrap_or(0).max(1);
    let height = 2 * TITLE + PLOT.1 + axes::BESIDE.1;
    let rows = i32::try_from(curves.len()).unwrap_or(i32::MAX / height);
    let size = ((axes::BESIDE.0 + PLOT.0 + RIGHT).max(text::text_width_px(title) + 20), TITLE + rows * height);
    write_png_picture(path, size, |area| {
        text::draw_text(area, (10, 10), title, (Anchor::Start, TextDirection::Along), BLACK)?;
        for (row, (name, samples)) in (0..).zip(curves) {
            let frame = Frame { left: axes::BESIDE.0, top: 2 * TITLE + row * height, w: PLOT.0, h: PLOT.1 };
            text::draw_text(area, (frame.left, frame.top - 22), name, (Anchor::Start, TextDirection::Along), BLACK)?;
            let y = |value: f64| frame.pixel_y_from_top((most - value) / (2.0 * most));
            for column in 0..frame.w {
                // From the least to the largest sample of the column, and the first of the next one.
                let sample = |column: i32| (f64::from(column) / f64::from(frame.w) * count as f64) as usize;
                let part = samples.get(sample(column)..(sample(column + 1) + 1).min(samples.len())).unwrap_or_default();
                let (low, high) =
                    part.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (x.min(low), x.max(high)));
                if low <= high {
                    let x = frame.left + column;
                    area.draw(&PathElement::new([(x, y(high)), (x, y(low))], COLOR))?;
                }
            }
            let duration_ms = 1e3 * count as f64 / rate_hz;
            axes::draw_axes(area, frame, (duration_ms, "time in ms"), (most, -most, "acceleration in g"))?;
        }
        Ok(())
    })
}
