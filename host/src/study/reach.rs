//! Pictures of reach: maps of plates side by side, curves over bars.

use super::{Field, PictureError, draw_number, write_pixels};
use crate::planner::reach::{Maps, Scheme, SchemeReach};
use crate::planner::table::SurfaceGrid;
use crate::scene::{Scene, SurfaceKind};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::colors::colormaps::ViridisRGB;
use std::path::Path;

/// Longer side of a map, and width of the plot of a bar, in pixels.
const SIDE: f64 = 420.0;
/// Height of the plot of a bar in pixels.
const PLOT_HEIGHT: i32 = 260;
/// Room beside and below each sheet for its numbers, in pixels.
const MARGIN: (i32, i32) = (84, 26);
/// Of the curves over a bar, in turn.
const COLORS: [RGBColor; 3] = [RGBColor(120, 120, 120), RGBColor(230, 130, 0), RGBColor(0, 90, 200)];

/// A field of a scheme, and its least value.
type Shown<'a> = &'a dyn Fn(&SchemeReach) -> (&[Option<f64>], f64);

/// One map, or curves over one axis.
struct Sheet {
    fields: Vec<Field>,
    /// The scale's ends.
    range: (f64, f64),
    /// What is less is drawn in red: a dead zone.
    weak_below: Option<f64>,
}

/// Draws the strongest (in g) and the most contrasted (in dB) reachable.
///
/// # Errors
/// [`PictureError`] if the file cannot be written.
pub fn write_maps(path: &Path, scene: &Scene, maps: &Maps) -> Result<(), PictureError> {
    let sheet = |values: &[Option<f64>]| {
        let (least, most) = ends(values.iter().flatten());
        Sheet {
            fields: vec![Field { x_mm: maps.x_mm.clone(), y_mm: maps.y_mm.clone(), peak_g: values.to_vec() }],
            range: (least.min(0.0), most),
            weak_below: None,
        }
    };
    write_sheets(path, scene, &[vec![sheet(&maps.strongest_g), sheet(&maps.contrast_db)]])
}

/// Draws the schemes' fields: above with one setting for the whole surface, below with the best for every touch. On a
/// plate one map each, red where there is less than distinct frequencies give at their weakest place; on a bar curves, grey,
/// orange and blue.
///
/// # Errors
/// [`PictureError`] if the file cannot be written.
pub fn write_schemes(
    path: &Path,
    scene: &Scene,
    grid: &SurfaceGrid,
    schemes: &[SchemeReach],
) -> Result<(), PictureError> {
    let mm = |lines: &[f64]| lines.iter().map(|line| line * 1e3).collect::<Vec<_>>();
    let field = |values: &[Option<f64>]| Field { x_mm: mm(&grid.x_m), y_mm: mm(&grid.y_m), peak_g: values.to_vec() };
    let distinct = schemes.iter().find(|scheme| scheme.scheme == Scheme::DistinctFrequencies);
    let row = |of: Shown<'_>| -> Vec<Sheet> {
        let (_, most) = ends(schemes.iter().flat_map(|scheme| of(scheme).0.iter().flatten()));
        let weak_below = distinct.map(|scheme| of(scheme).1);
        let fields = schemes.iter().map(|scheme| field(of(scheme).0));
        match scene.surface.kind {
            SurfaceKind::Bar => vec![Sheet { fields: fields.collect(), range: (0.0, most), weak_below }],
            SurfaceKind::Plate => {
                fields.map(|field| Sheet { fields: vec![field], range: (0.0, most), weak_below }).collect()
            }
        }
    };
    let rows = [
        row(&|scheme| (&scheme.one_setting_g, scheme.one_setting.least)),
        row(&|scheme| (&scheme.per_touch_g, scheme.per_touch.least)),
    ];
    write_sheets(path, scene, &rows)
}

fn ends<'a>(values: impl Iterator<Item = &'a f64>) -> (f64, f64) {
    let (least, most) =
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), value| (least.min(*value), most.max(*value)));
    if most > least { (least, most) } else { (0.0, 1.0) }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_possible_wrap, reason = "pixel counts")]
fn write_sheets(path: &Path, scene: &Scene, rows: &[Vec<Sheet>]) -> Result<(), PictureError> {
    let failed = |reason: String| PictureError { path: path.display().to_string(), reason };
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let (w, h) = match scene.surface.kind {
        SurfaceKind::Bar => (SIDE as i32, PLOT_HEIGHT),
        SurfaceKind::Plate => {
            let scale = SIDE / length.max(width);
            ((length * scale).round().max(1.0) as i32, (width * scale).round().max(1.0) as i32)
        }
    };
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0) as i32;
    let (step_x, step_y) = (w + MARGIN.0, h + MARGIN.1);
    let size = ((columns * step_x) as u32, (rows.len() as i32 * step_y) as u32);
    let mut pixels = vec![255_u8; (size.0 * size.1 * 3) as usize];
    {
        let area = BitMapBackend::with_buffer(&mut pixels, size).into_drawing_area();
        let draw = || -> Result<(), Box<dyn std::error::Error + '_>> {
            area.fill(&WHITE)?;
            for (j, row) in (0..).zip(rows) {
                for (i, sheet) in (0..).zip(row) {
                    let origin = (i * step_x, j * step_y);
                    match scene.surface.kind {
                        SurfaceKind::Bar => draw_curves(&area, origin, (w, h), length * 1e3, sheet)?,
                        SurfaceKind::Plate => draw_map(&area, origin, (w, h), scene, sheet)?,
                    }
                }
            }
            area.present()?;
            Ok(())
        };
        draw().map_err(|error| failed(error.to_string()))?;
    }
    write_pixels(path, size, pixels).map_err(failed)
}

type Drawn<DB> = Result<(), DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>>;

/// Colour of a value: red below what counts as weak, the darker the weaker.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "parts of 255")]
fn color(sheet: &Sheet, value: f64) -> RGBColor {
    match sheet.weak_below {
        Some(level) if value < level * (1.0 - 1e-9) => {
            let part = (value / level).clamp(0.0, 1.0);
            RGBColor((90.0 + 165.0 * part) as u8, (150.0 * part) as u8, (130.0 * part) as u8)
        }
        _ => ViridisRGB.get_color(((value - sheet.range.0) / (sheet.range.1 - sheet.range.0)) as f32),
    }
}

#[allow(clippy::cast_possible_truncation, reason = "pixel counts")]
fn draw_map<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    (left, top): (i32, i32),
    (w, h): (i32, i32),
    scene: &Scene,
    sheet: &Sheet,
) -> Drawn<DB> {
    let Some(field) = sheet.fields.first() else { return Ok(()) };
    let (length, width) = (scene.surface.length_m * 1e3, scene.surface.width_m * 1e3);
    let layout = scene.layout();
    for (py, px) in (0..h).flat_map(|py| (0..w).map(move |px| (py, px))) {
        let (x, y) = ((f64::from(px) + 0.5) / f64::from(w) * length, (f64::from(py) + 0.5) / f64::from(h) * width);
        if layout.at(x / 1e3, y / 1e3).is_some() {
            area.draw_pixel((left + px, top + py), &color(sheet, field.at(x, y)))?;
        }
    }
    for actuator in &scene.actuators {
        let to_px = |metres: f64, side_mm: f64, pixels: i32| (metres * 1e3 / side_mm * f64::from(pixels)) as i32;
        let radius = (actuator.electrode_area_m2 / std::f64::consts::PI).sqrt();
        let at = (left + to_px(actuator.x_m, length, w), top + to_px(actuator.y_m, width, h));
        area.draw(&Circle::new(at, to_px(radius, length, w), WHITE.stroke_width(2)))?;
    }
    let (from, to) = sheet.range;
    for py in 0..h {
        let value = to + (from - to) * f64::from(py) / f64::from(h);
        for px in 6..20 {
            area.draw_pixel((left + w + px, top + py), &color(sheet, value))?;
        }
    }
    for part in 0..=4 {
        let y = top + (h - 14) * part / 4;
        draw_number(area, left + w + 26, y, to + (from - to) * f64::from(part) / 4.0)?;
    }
    Ok(())
}

/// Curves over a bar's length, with the scale at the right and the place in mm below.
#[allow(clippy::cast_possible_truncation, reason = "pixel counts")]
fn draw_curves<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    (left, top): (i32, i32),
    (w, h): (i32, i32),
    length_mm: f64,
    sheet: &Sheet,
) -> Drawn<DB> {
    let (from, to) = sheet.range;
    let top = top + 8;
    let h = h - 8;
    let y_px = |value: f64| top + (f64::from(h) * (to - value) / (to - from)) as i32;
    let x_px = |x_mm: f64| left + (f64::from(w) * x_mm / length_mm) as i32;
    for part in 0..=4 {
        let value = from + (to - from) * f64::from(part) / 4.0;
        let y = y_px(value);
        area.draw(&PathElement::new([(left, y), (left + w, y)], RGBColor(215, 215, 215)))?;
        draw_number(area, left + w + 6, y - 6, value)?;
        let x_mm = length_mm * f64::from(part) / 4.0;
        let x = x_px(x_mm);
        area.draw(&PathElement::new([(x, top), (x, top + h)], RGBColor(235, 235, 235)))?;
        draw_number(area, (x - 18).max(left), top + h + 8, x_mm)?;
    }
    for (field, color) in sheet.fields.iter().zip(COLORS.iter().cycle()) {
        let points = field.x_mm.iter().zip(&field.peak_g).filter_map(|(x, value)| Some((x_px(*x), y_px((*value)?))));
        area.draw(&PathElement::new(points.collect::<Vec<_>>(), color.stroke_width(3)))?;
    }
    Ok(())
}
