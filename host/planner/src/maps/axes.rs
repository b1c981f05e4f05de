//! What makes a picture readable: ticks, axes in mm, colour scales with units.

use super::text::{self, Anchor, Drawn, HEIGHT, TextDirection};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::colors::colormaps::ViridisRGB;

/// Steps of a colour scale: two percent each is finer than the eye tells, and areas of one colour compress well.
const BANDS: f64 = 50.0;
/// Room that [`draw_axes`] takes left of and below a map, in pixels.
pub(super) const BESIDE: (i32, i32) = (70, 52);
/// Room that [`draw_color_scale_right_of_frame`] takes right of a map, in pixels.
pub(super) const SCALE: i32 = 128;
/// Length of a tick in pixels.
const TICK: i32 = 5;

/// A rectangle of pixels: left, top, width, height.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub left: i32,
    pub top: i32,
    pub w: i32,
    pub h: i32,
}

impl Frame {
    pub(super) fn bottom_px(&self) -> i32 {
        self.top + self.h
    }

    pub(super) fn right_px(&self) -> i32 {
        self.left + self.w
    }

    /// Pixel of a part, 0 to 1, of the width.
    #[expect(clippy::cast_possible_truncation, reason = "pixel counts")]
    pub(super) fn pixel_x(&self, fraction: f64) -> i32 {
        self.left + (fraction * f64::from(self.w)).round() as i32
    }

    /// Pixel of a part, 0 to 1, of the height, from the top.
    #[expect(clippy::cast_possible_truncation, reason = "pixel counts")]
    pub(super) fn pixel_y_from_top(&self, fraction: f64) -> i32 {
        self.top + (fraction * f64::from(self.h)).round() as i32
    }
}

/// Round values between two, at most about `max_count`, and how many digits after the point they have.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small numbers")]
pub(super) fn choose_round_ticks_and_decimals(from: f64, to: f64, max_count: u32) -> (Vec<f64>, usize) {
    let least = (to - from) / f64::from(max_count.max(1));
    if !(least > 0.0 && least.is_finite()) {
        return (vec![from], 3);
    }
    let power = least.log10().floor();
    let step = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * 10.0_f64.powf(power));
    let step = step.into_iter().find(|step| *step >= least * (1.0 - 1e-9)).unwrap_or(least);
    let digits = (-(step * (1.0 + 1e-9)).log10().floor()).max(0.0) as usize;
    let (first, last) = ((from / step - 1e-6).ceil() as i64, (to / step + 1e-6).floor() as i64);
    #[expect(clippy::cast_precision_loss, reason = "small numbers")]
    ((first..=last).map(|k| k as f64 * step).collect(), digits)
}

/// The axes of a map or plot: from 0 to `length` below, which is in what `below` names, and at the left what `side` names.
pub(super) fn draw_axes<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    frame: Frame,
    (length, below): (f64, &str),
    (from, to, side): (f64, f64, &str),
) -> Drawn<DB> {
    let (left, top, right, bottom) = (frame.left - 1, frame.top - 1, frame.right_px(), frame.bottom_px());
    area.draw(&Rectangle::new([(left, top), (right, bottom)], BLACK))?;
    let spread = (Anchor::Middle, TextDirection::Along);
    let (values, digits) = choose_round_ticks_and_decimals(0.0, length, 6);
    for value in values {
        let x = frame.pixel_x(value / length);
        area.draw(&PathElement::new([(x, bottom), (x, bottom + TICK)], BLACK))?;
        text::draw_text(area, (x, bottom + TICK + 3), &format!("{value:.digits$}"), spread, BLACK)?;
    }
    text::draw_text(area, (frame.pixel_x(0.5), bottom + TICK + HEIGHT + 9), below, spread, BLACK)?;
    let (values, digits) =
        choose_round_ticks_and_decimals(from.min(to), from.max(to), if frame.h < 100 { 2 } else { 5 });
    for value in values {
        let y = frame.pixel_y_from_top((value - from) / (to - from));
        area.draw(&PathElement::new([(left - TICK, y), (left, y)], BLACK))?;
        let at = (left - TICK - 3, y - HEIGHT / 2);
        text::draw_text(area, at, &format!("{value:.digits$}"), (Anchor::End, TextDirection::Along), BLACK)?;
    }
    text::draw_text(
        area,
        (frame.left - BESIDE.0 + 2, frame.pixel_y_from_top(0.5)),
        side,
        (Anchor::Middle, TextDirection::Up),
        BLACK,
    )
}

/// A colour scale right of a map, its unit above the numbers' column.
pub(super) fn draw_color_scale_right_of_frame<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    map_frame: Frame,
    (from, to): (f64, f64),
    unit: &str,
    color: impl Fn(f64) -> RGBColor,
) -> Drawn<DB> {
    let left = map_frame.right_px() + 12;
    for py in 0..map_frame.h {
        let value = to + (from - to) * (f64::from(py) + 0.5) / f64::from(map_frame.h);
        let row = map_frame.top + py;
        area.draw(&Rectangle::new([(left, row), (left + 16, row + 1)], color(value).filled()))?;
    }
    area.draw(&Rectangle::new([(left - 1, map_frame.top - 1), (left + 16, map_frame.bottom_px())], BLACK))?;
    let (values, digits) = choose_round_ticks_and_decimals(from, to, 6);
    for value in values {
        let y = map_frame.pixel_y_from_top((to - value) / (to - from));
        area.draw(&PathElement::new([(left + 16, y), (left + 20, y)], BLACK))?;
        let at = (left + 24, y - HEIGHT / 2);
        text::draw_text(area, at, &format!("{value:.digits$}"), (Anchor::Start, TextDirection::Along), BLACK)?;
    }
    text::draw_text(
        area,
        (map_frame.right_px() + SCALE - HEIGHT - 18, map_frame.pixel_y_from_top(0.5)),
        unit,
        (Anchor::Middle, TextDirection::Up),
        BLACK,
    )
}

/// Colour of a part, 0 to 1, of a scale.
#[expect(clippy::cast_possible_truncation, reason = "a colour")]
pub(super) fn viridis_color_at_fraction_of_scale(fraction: f64) -> RGBColor {
    ViridisRGB.get_color((((fraction.clamp(0.0, 1.0) * BANDS).floor() + 0.5) / (BANDS + 1.0)) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        assert_eq!(
            choose_round_ticks_and_decimals(0.0, 300.0, 6),
            (vec![0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0], 0)
        );
        let (values, digits) = choose_round_ticks_and_decimals(-0.03, 0.315, 6);
        assert_eq!(digits, 1);
        assert!(values.len() == 4 && values.iter().zip([0.0, 0.1, 0.2, 0.3]).all(|(a, b)| (a - b).abs() < 1e-12));
        assert_eq!(choose_round_ticks_and_decimals(2.0, 2.0, 6).0, [2.0]);
        assert_eq!(choose_round_ticks_and_decimals(0.0, 20.0, 2), (vec![0.0, 10.0, 20.0], 0));
        assert_eq!(choose_round_ticks_and_decimals(0.0, 0.05, 5).1, 2);
    }
}
