//! Pictures of mode shapes: one sheet with a map of every mode, or a curve on a bar, with what is attached to the panel.

use super::axes::{self, Frame};
use super::shapes::ModeShapes;
use super::text::{self, Anchor, Drawn, TextDirection};
use super::{PeakField, PictureError, TITLE, map, write_png_picture};
use crate::scene::{EdgeKind, Scene, Side, SurfaceKind};
use plotters::coord::Shift;
use plotters::prelude::*;
use std::path::Path;

/// Longer side of a map in pixels.
const SIDE: f64 = 280.0;
/// Least side of a map in pixels, for strips.
const LEAST_SIDE: f64 = 40.0;
/// Width and height of a bar's plot in pixels.
const PLOT: (i32, i32) = (280, 110);
/// Maps beside each other.
const COLUMNS: usize = 4;
/// Most modes on a sheet.
pub const MOST_MODES: usize = 48;
/// Half the side of a mark in pixels.
const MARK: i32 = 5;
/// Steps of the colour scale on either side of zero.
const BANDS: f64 = 12.0;
/// Elastic edges, and what stands for them in the legend.
const ELASTIC: RGBColor = RGBColor(230, 130, 0);
const PINNED: RGBColor = RGBColor(120, 120, 120);

/// Draws the first [`MOST_MODES`] modes: blue where the surface is below, red where it is above, white on nodal lines, each
/// relative to its own largest value; supports as triangles, masses as squares, actuators as circles, held edges as thick
/// lines. The picture's size in pixels.
///
/// # Errors
/// [`PictureError`] if the file cannot be written.
pub fn write_sheet_of_first_modes_png(
    path: &Path,
    scene: &Scene,
    modes: &ModeShapes,
) -> Result<(u32, u32), PictureError> {
    let is_bar = scene.surface.kind == SurfaceKind::Bar;
    let (w, h) = if is_bar { PLOT } else { map_size_px(scene) };
    let count = modes.frequencies_hz.len().min(MOST_MODES);
    let (columns, rows) = (count.clamp(1, COLUMNS), count.div_ceil(COLUMNS).max(1));
    let pixels = |number: usize| i32::try_from(number).unwrap_or(i32::MAX);
    let cell = (axes::BESIDE.0 + w + 20, TITLE + h + axes::BESIDE.1);
    let title = format!("{}: {}", scene.name, describe_shown_and_total_mode_count(modes, count));
    let legend = list_legend_entries(scene);
    let legend_width = legend.iter().map(|(_, words)| text::text_width_px(words) + 50).sum::<i32>() + 20;
    let beside = if is_bar { 0 } else { axes::SCALE };
    let width = (pixels(columns) * cell.0 + beside).max(text::text_width_px(&title) + 20).max(legend_width);
    let size = (width, 2 * TITLE + pixels(rows) * cell.1);
    write_png_picture(path, size, |area| {
        text::draw_text(area, (10, 10), &title, (Anchor::Start, TextDirection::Along), BLACK)?;
        let mut left = 20;
        for (mark, words) in &legend {
            draw_mark(area, *mark, (left, TITLE + 10))?;
            text::draw_text(area, (left + 18, TITLE + 4), words, (Anchor::Start, TextDirection::Along), BLACK)?;
            left += text::text_width_px(words) + 50;
        }
        for mode in 0..count {
            let (row, column) = (pixels(mode / COLUMNS), pixels(mode % COLUMNS));
            let frame =
                Frame { left: column * cell.0 + axes::BESIDE.0, top: 2 * TITLE + row * cell.1 + TITLE - 10, w, h };
            let name = format!("mode {}: {} Hz", mode + 1, format_frequency_without_unit(modes.frequencies_hz[mode]));
            text::draw_text(area, (frame.left, frame.top - 20), &name, (Anchor::Start, TextDirection::Along), BLACK)?;
            let field = normalise_mode_to_its_largest_value(modes, mode);
            if is_bar {
                draw_mode_curve(area, frame, scene, &field)?;
            } else {
                map::paint_field(area, frame, scene, &field, blue_white_red_color)?;
                axes::draw_axes(
                    area,
                    frame,
                    (scene.surface.length_m * 1e3, "x in mm"),
                    (0.0, scene.surface.width_m * 1e3, "y in mm"),
                )?;
                if mode + 1 == columns {
                    axes::draw_color_scale_right_of_frame(
                        area,
                        frame,
                        (-1.0, 1.0),
                        "relative value",
                        blue_white_red_color,
                    )?;
                }
            }
            draw_attachments(area, frame, scene)?;
        }
        Ok(())
    })
}

fn describe_shown_and_total_mode_count(modes: &ModeShapes, count: usize) -> String {
    match modes.frequencies_hz.len() {
        0 => "no modes".into(),
        all if all > count => format!("the first {count} of {all} modes"),
        1 => "1 mode".into(),
        all => format!("{all} modes"),
    }
}

#[expect(clippy::cast_possible_truncation, reason = "pixel counts")]
fn map_size_px(scene: &Scene) -> (i32, i32) {
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let scale = SIDE / length.max(width);
    let pixels = |side: f64| (side * scale).max(LEAST_SIDE).round() as i32;
    (pixels(length), pixels(width))
}

/// Four digits that mean something.
fn format_frequency_without_unit(hz: f64) -> String {
    let digits = if hz >= 1000.0 {
        0
    } else if hz >= 100.0 {
        1
    } else {
        2
    };
    format!("{hz:.digits$}")
}

/// A mode over its largest value.
fn normalise_mode_to_its_largest_value(modes: &ModeShapes, mode: usize) -> PeakField {
    let column = modes.shapes.column(mode);
    let largest = column.iter().filter(|value| !value.is_nan()).fold(0.0_f64, |most, value| most.max(value.abs()));
    let scale = if largest > 0.0 { 1.0 / largest } else { 0.0 };
    let mm = |lines: &[f64]| lines.iter().map(|line| line * 1e3).collect();
    let values = column.iter().map(|value| (!value.is_nan()).then_some(value * scale));
    PeakField { x_mm: mm(&modes.x_m), y_mm: mm(&modes.y_m), peak_g: values.collect() }
}

/// Colour of a value from -1 to 1: blue, white, red, which those who do not see red and green tell apart.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "parts of 255")]
fn blue_white_red_color(value: f64) -> RGBColor {
    let part = (value.abs().min(1.0) * BANDS).round() / BANDS;
    let towards = |end: f64| (255.0 + part * (end - 255.0)).round() as u8;
    let (r, g, b) = if value < 0.0 { (33.0, 102.0, 172.0) } else { (178.0, 24.0, 43.0) };
    RGBColor(towards(r), towards(g), towards(b))
}

fn draw_mode_curve<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    frame: Frame,
    scene: &Scene,
    field: &PeakField,
) -> Drawn<DB> {
    let length_mm = scene.surface.length_m * 1e3;
    // A little room above and below.
    let at = |x_mm: f64, value: f64| (frame.pixel_x(x_mm / length_mm), frame.pixel_y_from_top(0.5 - value / 2.2));
    area.draw(&PathElement::new([at(0.0, 0.0), at(length_mm, 0.0)], PINNED))?;
    let points = field.x_mm.iter().zip(&field.peak_g).filter_map(|(x, value)| Some(at(*x, (*value)?)));
    area.draw(&PathElement::new(points.collect::<Vec<_>>(), RGBColor(0, 90, 200).stroke_width(3)))?;
    axes::draw_axes(area, frame, (length_mm, "x in mm"), (1.1, -1.1, "relative"))
}

/// What is drawn of something attached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mark {
    Support,
    Mass,
    Actuator,
    Edge(RGBColor),
}

fn draw_mark<DB: DrawingBackend>(area: &DrawingArea<DB, Shift>, mark: Mark, (x, y): (i32, i32)) -> Drawn<DB> {
    match mark {
        Mark::Support => {
            let corners = vec![(x, y - MARK), (x + MARK, y + MARK), (x - MARK, y + MARK)];
            area.draw(&Polygon::new(corners, BLACK.filled()))
        }
        Mark::Mass => {
            let half = MARK - 1;
            area.draw(&Rectangle::new([(x - half, y - half), (x + half, y + half)], BLACK.filled()))
        }
        Mark::Actuator => area.draw(&Circle::new((x, y), MARK, BLACK.stroke_width(2))),
        Mark::Edge(color) => area.draw(&Rectangle::new([(x - MARK, y - 2), (x + MARK, y + 3)], color.filled())),
    }
}

const fn edge_color(kind: EdgeKind) -> RGBColor {
    match kind {
        EdgeKind::Clamped => BLACK,
        EdgeKind::Pinned => PINNED,
        EdgeKind::Elastic { .. } => ELASTIC,
    }
}

/// The marks that the scene has, and what they are.
fn list_legend_entries(scene: &Scene) -> Vec<(Mark, String)> {
    let mut all = vec![
        (!scene.supports.is_empty(), Mark::Support, "support"),
        (!scene.masses.is_empty(), Mark::Mass, "mass"),
        (!scene.actuators.is_empty(), Mark::Actuator, "actuator"),
    ];
    let mut named: Vec<&str> = Vec::new();
    for edge in &scene.edges {
        if !named.contains(&edge.kind.name()) {
            named.push(edge.kind.name());
            all.push((true, Mark::Edge(edge_color(edge.kind)), edge.kind.name()));
        }
    }
    let words =
        |mark: Mark, name: &str| if matches!(mark, Mark::Edge(_)) { format!("{name} edge") } else { name.into() };
    all.into_iter().filter(|(here, ..)| *here).map(|(_, mark, name)| (mark, words(mark, name))).collect()
}

/// Marks of all that is attached, edges first.
fn draw_attachments<DB: DrawingBackend>(area: &DrawingArea<DB, Shift>, frame: Frame, scene: &Scene) -> Drawn<DB> {
    let is_bar = scene.surface.kind == SurfaceKind::Bar;
    let (left, top, right, bottom) = (frame.left, frame.top, frame.right_px(), frame.bottom_px());
    for edge in &scene.edges {
        let corners = match edge.side {
            Side::Left => [(left - 5, top), (left, bottom)],
            Side::Right => [(right, top), (right + 5, bottom)],
            Side::Top => [(left, top - 5), (right, top)],
            Side::Bottom => [(left, bottom), (right, bottom + 5)],
        };
        area.draw(&Rectangle::new(corners, edge_color(edge.kind).filled()))?;
    }
    // A bar's attachments are on its axis, the line of no motion.
    let at = |x_m: f64, y_m: f64| {
        if is_bar {
            (frame.pixel_x(x_m / scene.surface.length_m), frame.pixel_y_from_top(0.5))
        } else {
            map::pixel_of_place(frame, scene, x_m * 1e3, y_m * 1e3)
        }
    };
    if is_bar {
        for actuator in &scene.actuators {
            draw_mark(area, Mark::Actuator, at(actuator.x_m, actuator.y_m))?;
        }
    } else {
        map::draw_actuators(area, frame, scene, BLACK)?;
    }
    for support in &scene.supports {
        draw_mark(area, Mark::Support, at(support.x_m, support.y_m))?;
    }
    for mass in &scene.masses {
        draw_mark(area, Mark::Mass, at(mass.x_m, mass.y_m))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_is_white_and_the_ends_differ() {
        assert_eq!(blue_white_red_color(0.0), WHITE);
        assert_eq!(blue_white_red_color(0.04), blue_white_red_color(-0.04));
        let (below, above) = (blue_white_red_color(-1.0), blue_white_red_color(1.0));
        assert!(below.2 > below.0 && above.0 > above.2);
    }

    #[test]
    fn the_legend_names_what_is_there_once() {
        let scene = Scene::parse("plate", crate::scene::STARTING_PLATE).unwrap();
        let names: Vec<String> = list_legend_entries(&scene).into_iter().map(|(_, words)| words).collect();
        assert!(names.contains(&"support".into()) && names.contains(&"actuator".into()), "{names:?}");
        assert_eq!(names.len(), names.iter().collect::<std::collections::BTreeSet<_>>().len());
    }
}
