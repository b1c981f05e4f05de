//! Pictures of reach: maps of plates side by side, curves over bars.

use super::axes::{self, Frame};
use super::text::{self, Anchor, Drawn, TextDirection};
use super::{PeakField, PictureError, TITLE, map, write_png_picture};
use super::{ReachMaps, Scheme, SchemeReach};
use crate::reach::Measure;
use crate::scene::{Scene, SurfaceKind};
use crate::table::SurfaceGrid;
use plotters::coord::Shift;
use plotters::prelude::*;
use std::path::Path;

/// Longer side of a map in pixels.
const SIDE: f64 = 400.0;
/// Width and height of the plot of a bar in pixels.
const PLOT: (i32, i32) = (800, 260);
/// Of the curves over a bar, in turn: told apart by those who do not see red and green, too.
const COLORS: [RGBColor; 3] = [RGBColor(120, 120, 120), RGBColor(230, 130, 0), RGBColor(0, 90, 200)];
/// Decibels below the strongest peak at which scales end.
const LEAST_DB: f64 = 60.0;

/// A field of a scheme, and its least value.
type SheetValues<'a> = &'a dyn Fn(&SchemeReach) -> (&[Option<f64>], f64);

/// One map, or curves over one axis.
struct Sheet {
    title: String,
    fields: Vec<(&'static str, PeakField)>,
    /// The scale's ends.
    range: (f64, f64),
    /// What the scale shows.
    unit: &'static str,
    /// What is less is drawn in red: a dead zone.
    weak_below: Option<f64>,
}

/// Draws the strongest (in g) and the most contrasted (in dB) reachable. The picture's size in pixels.
///
/// # Errors
/// [`PictureError`] if the file cannot be written.
pub fn write_reach_maps_png(path: &Path, scene: &Scene, maps: &ReachMaps) -> Result<(u32, u32), PictureError> {
    let sheet = |title: &str, unit: &'static str, values: &[Option<f64>]| Sheet {
        title: title.into(),
        fields: vec![("", PeakField { x_mm: maps.x_mm.clone(), y_mm: maps.y_mm.clone(), peak_g: values.to_vec() })],
        range: map::color_range_including_zero(values.iter().flatten()),
        unit,
        weak_below: None,
    };
    let strongest = sheet("strongest peak", "peak in g", &maps.strongest_g);
    // With a finger there are no contrasts.
    let contrast = maps.contrast_db.iter().any(Option::is_some);
    let contrast = contrast.then(|| sheet("highest contrast of a weak touch", "contrast in dB", &maps.contrast_db));
    let sheets = [strongest].into_iter().chain(contrast);
    let rows: Vec<Vec<Sheet>> = match scene.surface.kind {
        SurfaceKind::Bar => sheets.map(|sheet| vec![sheet]).collect(),
        SurfaceKind::Plate => vec![sheets.collect()],
    };
    write_sheets_png(path, scene, &format!("{}: largest possible values at every point", scene.name), &rows)
}

/// Draws the schemes' fields: above with one setting for the whole surface, below with the best for every touch. On a
/// plate one map each, red where there is less than distinct frequencies give at their weakest place; on a bar curves. The
/// picture's size in pixels.
///
/// # Errors
/// [`PictureError`] if the file cannot be written.
pub fn write_schemes_png(
    path: &Path,
    scene: &Scene,
    grid: &SurfaceGrid,
    measure: Measure,
    schemes: &[SchemeReach],
) -> Result<(u32, u32), PictureError> {
    let mm = |lines: &[f64]| lines.iter().map(|line| line * 1e3).collect::<Vec<_>>();
    let (counted, unit): (fn(f64) -> f64, _) = match measure {
        Measure::G => (|value| value, "peak in g"),
        Measure::Thresholds => (|value| 20.0 * value.max(f64::MIN_POSITIVE).log10(), "dB above threshold"),
    };
    let field = |values: &[Option<f64>]| PeakField {
        x_mm: mm(&grid.x_m),
        y_mm: mm(&grid.y_m),
        peak_g: values.iter().map(|value| value.map(counted)).collect(),
    };
    let distinct = schemes.iter().find(|scheme| scheme.scheme == Scheme::DistinctFrequencies);
    let row = |title: &str, of: SheetValues<'_>| -> Vec<Sheet> {
        let fields: Vec<(&'static str, PeakField)> =
            schemes.iter().map(|scheme| (scheme.scheme.name(), field(of(scheme).0))).collect();
        let (_, most) =
            map::color_range_including_zero(fields.iter().flat_map(|(_, field)| field.peak_g.iter().flatten()));
        let least = fields.iter().flat_map(|(_, field)| field.peak_g.iter().flatten()).copied();
        let least = least.fold(0.0, f64::min).max(most - LEAST_DB);
        let range = (if measure == Measure::G { 0.0 } else { least.min(0.0) }, most);
        let weak_below = distinct.map(|scheme| counted(of(scheme).1));
        match scene.surface.kind {
            SurfaceKind::Bar => vec![Sheet { title: title.into(), fields, range, unit, weak_below }],
            SurfaceKind::Plate => {
                let sheet = |(name, field): (&'static str, PeakField)| Sheet {
                    title: name.into(),
                    fields: vec![("", field)],
                    range,
                    unit,
                    weak_below,
                };
                fields.into_iter().map(sheet).collect()
            }
        }
    };
    let (one, each) = ("one setting for the whole surface", "a setting for every touch");
    let rows = [
        row(one, &|scheme| (&scheme.one_setting_field, scheme.one_setting.least)),
        row(each, &|scheme| (&scheme.per_touch_field, scheme.per_touch.least)),
    ];
    let title = match scene.surface.kind {
        SurfaceKind::Bar => {
            format!(
                "{}: three drive schemes; the red line is the peak at the weakest place for the scheme with distinct \
                 frequencies",
                scene.name
            )
        }
        SurfaceKind::Plate => format!(
            "{} (upper row: {one}; lower row: {each}; red: places where the peak is lower than the peak at the weakest place with \
             distinct frequencies)",
            scene.name
        ),
    };
    write_sheets_png(path, scene, &title, &rows)
}

#[expect(clippy::cast_possible_truncation, reason = "pixel counts")]
fn write_sheets_png(path: &Path, scene: &Scene, title: &str, rows: &[Vec<Sheet>]) -> Result<(u32, u32), PictureError> {
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let (w, h) = match scene.surface.kind {
        SurfaceKind::Bar => PLOT,
        SurfaceKind::Plate => {
            let scale = SIDE / length.max(width);
            ((length * scale).round().max(1.0) as i32, (width * scale).round().max(1.0) as i32)
        }
    };
    // A line for the sheet's title, and one for what its curves are.
    let lines = if rows.iter().flatten().any(|sheet| sheet.fields.len() > 1) { 2 } else { 1 };
    let cell = (axes::BESIDE.0 + w + axes::SCALE, lines * TITLE + h + axes::BESIDE.1);
    let count = |number: usize| i32::try_from(number).unwrap_or(i32::MAX);
    let columns = count(rows.iter().map(Vec::len).max().unwrap_or(0));
    let size = ((columns * cell.0).max(text::text_width_px(title) + 20), TITLE + count(rows.len()) * cell.1);
    write_png_picture(path, size, |area| {
        text::draw_text(area, (10, 10), title, (Anchor::Start, TextDirection::Along), BLACK)?;
        for (row, sheets) in (0..).zip(rows) {
            for (column, sheet) in (0..).zip(sheets) {
                let (left, top) = (column * cell.0 + axes::BESIDE.0, TITLE + row * cell.1);
                let frame = Frame { left, top: top + lines * TITLE, w, h };
                text::draw_text(area, (left, top + 12), &sheet.title, (Anchor::Start, TextDirection::Along), BLACK)?;
                match scene.surface.kind {
                    SurfaceKind::Bar => draw_curves(area, frame, length * 1e3, sheet)?,
                    SurfaceKind::Plate => {
                        if let Some((_, field)) = sheet.fields.first() {
                            let color = |value: f64| sheet_color_red_if_below_weak_level(sheet, value);
                            map::draw_map(area, frame, scene, field, (sheet.range, sheet.unit), color)?;
                        }
                    }
                }
            }
        }
        Ok(())
    })
}

/// Colour of a value: red below what counts as weak, the darker the weaker.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "parts of 255")]
fn sheet_color_red_if_below_weak_level(sheet: &Sheet, value: f64) -> RGBColor {
    let (from, to) = sheet.range;
    match sheet.weak_below {
        Some(level) if value < level * (1.0 - 1e-9) && level > from => {
            let part = ((value - from) / (level - from)).clamp(0.0, 1.0);
            let part = (10.0 * part).floor() / 10.0;
            RGBColor((90.0 + 165.0 * part) as u8, (150.0 * part) as u8, (130.0 * part) as u8)
        }
        _ => axes::viridis_color_at_fraction_of_scale((value - from) / (to - from)),
    }
}

/// Curves over a bar's length, their names above, and a red line at what counts as weak.
fn draw_curves<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    frame: Frame,
    length_mm: f64,
    sheet: &Sheet,
) -> Drawn<DB> {
    let (from, to) = sheet.range;
    let at = |x_mm: f64, value: f64| {
        let part = ((to - value) / (to - from)).clamp(0.0, 1.0);
        (frame.pixel_x(x_mm / length_mm), frame.pixel_y_from_top(part))
    };
    let grey = RGBColor(225, 225, 225);
    for value in axes::choose_round_ticks_and_decimals(from, to, 5).0 {
        area.draw(&PathElement::new([at(0.0, value), at(length_mm, value)], grey))?;
    }
    if let Some(level) = sheet.weak_below {
        area.draw(&PathElement::new([at(0.0, level), at(length_mm, level)], RED))?;
    }
    let mut left = frame.left;
    for ((name, field), color) in sheet.fields.iter().zip(COLORS.into_iter().cycle()) {
        let points = field.x_mm.iter().zip(&field.peak_g).filter_map(|(x, value)| Some(at(*x, (*value)?)));
        area.draw(&PathElement::new(points.collect::<Vec<_>>(), color.stroke_width(3)))?;
        text::draw_text(area, (left, frame.top - 22), name, (Anchor::Start, TextDirection::Along), color)?;
        left += text::text_width_px(name) + 30;
    }
    axes::draw_axes(area, frame, (length_mm, "x in mm"), (to, from, sheet.unit))
}
