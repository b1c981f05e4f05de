//! Fields over the surface, as numbers and pictures.

pub mod reach;

use crate::planner::{Plan, PlanTable, STANDARD_GRAVITY};
use crate::scene::Scene;
use plotters::prelude::*;
use plotters::style::colors::colormaps::ViridisRGB;
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;

/// Longer side of the picture in pixels.
const PICTURE: f64 = 1200.0;
/// Width of the legend in pixels.
const LEGEND: i32 = 90;
/// Least height of the map in pixels, for bars.
const LEAST_HEIGHT: f64 = 160.0;

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {path}: {reason}")]
pub struct PictureError {
    path: String,
    reason: String,
}

/// Peak acceleration on a grid.
#[derive(Clone, Debug, Serialize)]
pub struct Field {
    /// Columns in mm.
    pub x_mm: Vec<f64>,
    /// Rows in mm.
    pub y_mm: Vec<f64>,
    /// Row by row, in g; `None` in cut-outs.
    pub peak_g: Vec<Option<f64>>,
}

impl Field {
    /// The field of `plan`.
    #[must_use]
    pub fn of(table: &PlanTable, plan: &Plan) -> Self {
        Self {
            x_mm: table.grid.x_m.iter().map(|x| x * 1e3).collect(),
            y_mm: table.grid.y_m.iter().map(|y| y * 1e3).collect(),
            peak_g: table.field(plan).into_iter().map(|peak| Some(peak? / STANDARD_GRAVITY)).collect(),
        }
    }

    /// Lines of `x_mm,y_mm,peak_g`, the latter empty in cut-outs.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut text = String::from("x_mm,y_mm,peak_g\n");
        let points = self.y_mm.iter().flat_map(|y| self.x_mm.iter().map(move |x| (x, y)));
        for ((x, y), peak) in points.zip(&self.peak_g) {
            let peak = peak.map_or_else(String::new, |peak| format!("{peak:.6}"));
            let _ = writeln!(text, "{x:.3},{y:.3},{peak}");
        }
        text
    }

    /// Bilinear interpolation between the points around that have a value.
    fn at(&self, x_mm: f64, y_mm: f64) -> f64 {
        let (i, u) = place(&self.x_mm, x_mm);
        let (j, v) = place(&self.y_mm, y_mm);
        let nx = self.x_mm.len();
        let (mut sum, mut weight) = (0.0, 0.0);
        for (i, u) in [(i, 1.0 - u), (i + 1, u)] {
            for (j, v) in [(j, 1.0 - v), (j + 1, v)] {
                let (i, j) = (i.min(nx - 1), j.min(self.y_mm.len() - 1));
                if let Some(peak) = self.peak_g.get(j * nx + i).copied().flatten() {
                    sum += u * v * peak;
                    weight += u * v;
                }
            }
        }
        if weight > 0.0 { sum / weight } else { 0.0 }
    }
}

fn place(lines: &[f64], at: f64) -> (usize, f64) {
    let cell = lines.partition_point(|line| *line <= at).saturating_sub(1).min(lines.len().saturating_sub(2));
    match (lines.get(cell), lines.get(cell + 1)) {
        (Some(from), Some(to)) => (cell, ((at - from) / (to - from)).clamp(0.0, 1.0)),
        _ => (0, 0.0),
    }
}

/// Draws the field to scale, white in cut-outs, with actuators as circles, the target as a cross and a legend in g.
///
/// # Errors
/// [`PictureError`] if the file cannot be written.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss, reason = "pixel counts")]
pub fn write_png(path: &Path, scene: &Scene, plan: &Plan, field: &Field) -> Result<(), PictureError> {
    let failed = |reason: String| PictureError { path: path.display().to_string(), reason };
    let (length, width) = (scene.surface.length_m * 1e3, scene.surface.width_m * 1e3);
    let scale = PICTURE / length.max(width);
    let (w, h) = ((length * scale).round(), (width * scale).max(LEAST_HEIGHT).round());
    let to_px = |x_mm: f64, y_mm: f64| ((x_mm / length * w) as i32, (y_mm / width * h) as i32);
    let most = field.peak_g.iter().flatten().copied().fold(0.0, f64::max);
    let layout = scene.layout();
    let full = if most > 0.0 { most } else { 1.0 };

    let size = (w as u32 + LEGEND as u32, h as u32);
    let mut pixels = vec![255_u8; (size.0 * size.1 * 3) as usize];
    {
        let area = BitMapBackend::with_buffer(&mut pixels, size).into_drawing_area();
        let draw = || -> Result<(), Box<dyn std::error::Error + '_>> {
            area.fill(&WHITE)?;
            for py in 0..h as i32 {
                for px in 0..w as i32 {
                    let (x_mm, y_mm) = ((f64::from(px) + 0.5) / w * length, (f64::from(py) + 0.5) / h * width);
                    if layout.at(x_mm / 1e3, y_mm / 1e3).is_none() {
                        continue;
                    }
                    let value = field.at(x_mm, y_mm);
                    area.draw_pixel((px, py), &ViridisRGB.get_color((value / full) as f32))?;
                }
            }
            for actuator in &scene.actuators {
                let radius = (actuator.electrode_area_m2 / std::f64::consts::PI).sqrt() * 1e3 * scale;
                let at = to_px(actuator.x_m * 1e3, actuator.y_m * 1e3);
                area.draw(&Circle::new(at, radius as i32, WHITE.stroke_width(2)))?;
            }
            for target in &plan.targets {
                area.draw(&Cross::new(to_px(target.x_mm, target.y_mm), 12, RED.stroke_width(3)))?;
            }
            for py in 0..h as i32 {
                let color = ViridisRGB.get_color((1.0 - f64::from(py) / h) as f32);
                for px in 10..30 {
                    area.draw_pixel((w as i32 + px, py), &color)?;
                }
            }
            for part in 0..=4 {
                let value = most * (1.0 - f64::from(part) / 4.0);
                let y = ((h - 14.0) * f64::from(part) / 4.0) as i32;
                draw_number(&area, w as i32 + 36, y, value)?;
            }
            area.present()?;
            Ok(())
        };
        draw().map_err(|error| failed(error.to_string()))?;
    }
    write_pixels(path, size, pixels).map_err(failed)
}

fn write_pixels(path: &Path, size: (u32, u32), pixels: Vec<u8>) -> Result<(), String> {
    let picture = image::RgbImage::from_raw(size.0, size.1, pixels).ok_or("the picture has no pixels")?;
    picture.save_with_format(path, image::ImageFormat::Png).map_err(|error| error.to_string())
}

/// Seven-segment digits: a legend needs twelve characters and no font.
fn draw_number<DB: DrawingBackend>(
    area: &DrawingArea<DB, plotters::coord::Shift>,
    x: i32,
    y: i32,
    value: f64,
) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
    const SEGMENTS: [u8; 10] = [0x77, 0x24, 0x5D, 0x6D, 0x2E, 0x6B, 0x7B, 0x25, 0x7F, 0x6F];
    let text = if value >= 10.0 { format!("{value:.1}") } else { format!("{value:.3}") };
    let mut left = x;
    for character in text.chars() {
        if character == '-' {
            area.draw(&PathElement::new([(left, y + 6), (left + 5, y + 6)], BLACK))?;
            left += 8;
            continue;
        }
        let Some(digit) = character.to_digit(10) else {
            area.draw(&Rectangle::new([(left, y + 11), (left + 1, y + 12)], BLACK.filled()))?;
            left += 4;
            continue;
        };
        let lines = [
            ((0, 0), (6, 0)),
            ((0, 0), (0, 6)),
            ((6, 0), (6, 6)),
            ((0, 6), (6, 6)),
            ((0, 6), (0, 12)),
            ((6, 6), (6, 12)),
            ((0, 12), (6, 12)),
        ];
        for (bit, (from, to)) in lines.iter().enumerate() {
            if SEGMENTS[digit as usize] >> bit & 1 == 1 {
                let points = vec![(left + from.0, y + from.1), (left + to.0, y + to.1)];
                area.draw(&PathElement::new(points, BLACK))?;
            }
        }
        left += 10;
    }
    Ok(())
}
