//! What a panel does over its surface, as numbers and pictures: fields, reach maps ([`surface_maps`]), drive schemes side by side ([`schemes`]:
//! the thesis' removal of dead zones in numbers; `shared` is what one frequency for all actuators can do), how much of a motion leaves
//! the panel unbent ([`rigid`]), clicks at every place ([`clicks`]).

mod axes;
pub mod clicks;
mod map;
pub mod mode_sheet;
pub mod npy;
pub mod over_time;
pub mod reach;
pub mod rigid;
pub mod sag;
pub mod schemes;
pub mod shapes;
pub mod single_frequency;
pub mod spread;
pub mod strongest;
pub mod surface_maps;
mod text;
pub mod touched;
pub mod weakest;

use crate::scene::Scene;
use crate::{Plan, PlanTable, STANDARD_GRAVITY};
pub use clicks::ClickMap;
use era_files::{Readers, replace_file};
pub use schemes::{Scheme, SchemeReach};
pub use spread::Spread;
pub use surface_maps::ReachMaps;

use axes::Frame;
use image::ImageEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use plotters::coord::Shift;
use plotters::prelude::*;
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;
use text::{Anchor, Drawn, TextDirection};

/// Longer side of the map in pixels.
const PICTURE: f64 = 1000.0;
/// Least height of the map in pixels, for bars.
const LEAST_HEIGHT: f64 = 160.0;
/// Height of a title in pixels.
const TITLE: i32 = 34;

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {path}: {reason}")]
pub struct PictureError {
    path: String,
    reason: String,
}

/// Peak acceleration on a grid.
#[derive(Clone, Debug, Serialize)]
pub struct PeakField {
    /// Columns in mm.
    pub x_mm: Vec<f64>,
    /// Rows in mm.
    pub y_mm: Vec<f64>,
    /// Row by row, in g; `None` in cut-outs.
    pub peak_g: Vec<Option<f64>>,
}

impl PeakField {
    /// The field of `plan`.
    #[must_use]
    pub fn from_plan(table: &PlanTable, plan: &Plan) -> Self {
        Self {
            x_mm: table.grid.x_m.iter().map(|x| x * 1e3).collect(),
            y_mm: table.grid.y_m.iter().map(|y| y * 1e3).collect(),
            peak_g: table
                .compute_peak_at_each_grid_point_m_per_s2(plan)
                .into_iter()
                .map(|peak| Some(peak? / STANDARD_GRAVITY))
                .collect(),
        }
    }

    /// Lines of `x_mm,y_mm,peak_g`, the latter empty in cut-outs.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = String::from("x_mm,y_mm,peak_g\n");
        let points = self.y_mm.iter().flat_map(|y| self.x_mm.iter().map(move |x| (x, y)));
        for ((x, y), peak) in points.zip(&self.peak_g) {
            let peak = peak.map_or_else(String::new, |peak| format!("{peak:.6}"));
            let _ = writeln!(text, "{x:.3},{y:.3},{peak}");
        }
        text
    }

    /// Bilinear interpolation between the points around that have a value; `None` where none has.
    fn interpolate_between_known_neighbours_if_any(&self, x_mm: f64, y_mm: f64) -> Option<f64> {
        let (i, u) = find_cell_index_and_fraction(&self.x_mm, x_mm);
        let (j, v) = find_cell_index_and_fraction(&self.y_mm, y_mm);
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
        (weight > 0.0).then(|| sum / weight)
    }
}

fn find_cell_index_and_fraction(lines: &[f64], at: f64) -> (usize, f64) {
    let cell = lines.partition_point(|line| *line <= at).saturating_sub(1).min(lines.len().saturating_sub(2));
    match (lines.get(cell), lines.get(cell + 1)) {
        (Some(from), Some(to)) => (cell, ((at - from) / (to - from)).clamp(0.0, 1.0)),
        _ => (0, 0.0),
    }
}

/// Draws the field to scale, white in cut-outs, with actuators as circles, the target as a cross and a scale in g. The
/// picture's size in pixels.
///
/// # Errors
/// [`PictureError`] if the file cannot be written.
pub fn write_field_png(path: &Path, scene: &Scene, plan: &Plan, field: &PeakField) -> Result<(u32, u32), PictureError> {
    let places: Vec<String> =
        plan.targets.iter().map(|target| format!("{:.0}, {:.0} mm", target.x_m * 1e3, target.y_m * 1e3)).collect();
    let title = format!("{}: touch at {}", scene.name, places.join(" and "));
    let range = map::color_range_including_zero(field.peak_g.iter().flatten());
    let targets: Vec<(f64, f64)> = plan.targets.iter().map(|target| (target.x_m * 1e3, target.y_m * 1e3)).collect();
    write_map_png(path, scene, field, &title, (range, "peak in g"), &targets)
}

/// Draws one map to scale under its title, with a scale of this range and unit, and crosses at places in mm.
#[expect(clippy::cast_possible_truncation, reason = "pixel counts")]
fn write_map_png(
    path: &Path,
    scene: &Scene,
    field: &PeakField,
    title: &str,
    (range, unit): ((f64, f64), &str),
    crosses_mm: &[(f64, f64)],
) -> Result<(u32, u32), PictureError> {
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let scale = PICTURE / length.max(width);
    let frame = Frame {
        left: axes::BESIDE.0,
        top: TITLE,
        w: (length * scale).round().max(1.0) as i32,
        h: (width * scale).max(LEAST_HEIGHT).round() as i32,
    };
    let title_end = frame.left + text::text_width_px(title) + 10;
    let size = ((frame.right_px() + axes::SCALE).max(title_end), frame.bottom_px() + axes::BESIDE.1);
    write_png_picture(path, size, |area| {
        text::draw_text(area, (frame.left, 10), title, (Anchor::Start, TextDirection::Along), BLACK)?;
        let color = |value: f64| axes::viridis_color_at_fraction_of_scale((value - range.0) / (range.1 - range.0));
        map::draw_map(area, frame, scene, field, (range, unit), color)?;
        for (x_mm, y_mm) in crosses_mm {
            let at = map::pixel_of_place(frame, scene, *x_mm, *y_mm);
            area.draw(&Cross::new(at, 12, RED.stroke_width(3)))?;
        }
        Ok(())
    })
}

/// A white picture with what `draw` draws, as a file. Its size.
fn write_png_picture(
    path: &Path,
    (w, h): (i32, i32),
    draw: impl for<'a> Fn(&DrawingArea<BitMapBackend<'a>, Shift>) -> Drawn<BitMapBackend<'a>>,
) -> Result<(u32, u32), PictureError> {
    let failed = |reason: String| PictureError { path: path.display().to_string(), reason };
    let size = (w.unsigned_abs(), h.unsigned_abs());
    let mut pixels = vec![255_u8; size.0 as usize * size.1 as usize * 3];
    {
        let area = BitMapBackend::with_buffer(&mut pixels, size).into_drawing_area();
        draw(&area).and_then(|()| area.present()).map_err(|error| failed(error.to_string()))?;
    }
    let mut picture = Vec::new();
    // Large areas of one colour.
    let encoder = PngEncoder::new_with_quality(&mut picture, CompressionType::Best, FilterType::NoFilter);
    encoder.write_image(&pixels, size.0, size.1, image::ColorType::Rgb8).map_err(|error| failed(error.to_string()))?;
    replace_file(path, Readers::ByUmask, &picture).map_err(|error| failed(error.to_string()))?;
    Ok(size)
}
