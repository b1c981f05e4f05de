//! A field over a surface in colours, with axes, actuators and a scale.

use super::PeakField;
use super::axes::{self, Frame};
use super::text::Drawn;
use crate::scene::Scene;
use plotters::coord::Shift;
use plotters::prelude::*;
use std::f64::consts::PI;

/// Least radius of an actuator's circle in pixels.
const LEAST_RADIUS: i32 = 3;

/// Draws `field` into `frame`, `color` its values, `range` the ends of the scale and `unit` its title.
pub(super) fn draw_map<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    frame: Frame,
    scene: &Scene,
    field: &PeakField,
    (range, unit): ((f64, f64), &str),
    color: impl Fn(f64) -> RGBColor,
) -> Drawn<DB> {
    let (length_mm, width_mm) = (scene.surface.length_m * 1e3, scene.surface.width_m * 1e3);
    paint_field(area, frame, scene, field, &color)?;
    draw_actuators(area, frame, scene, WHITE)?;
    axes::draw_axes(area, frame, (length_mm, "x in mm"), (0.0, width_mm, "y in mm"))?;
    axes::draw_color_scale_right_of_frame(area, frame, range, unit, color)
}

/// Fills `frame` with the colours of a field; cut-outs are left as they are.
pub(super) fn paint_field<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    frame: Frame,
    scene: &Scene,
    field: &PeakField,
    color: impl Fn(f64) -> RGBColor,
) -> Drawn<DB> {
    let (length_mm, width_mm) = (scene.surface.length_m * 1e3, scene.surface.width_m * 1e3);
    let layout = scene.layout();
    for (py, px) in (0..frame.h).flat_map(|py| (0..frame.w).map(move |px| (py, px))) {
        let part = |pixel: i32, all: i32| (f64::from(pixel) + 0.5) / f64::from(all);
        let (x_mm, y_mm) = (part(px, frame.w) * length_mm, part(py, frame.h) * width_mm);
        if layout.layer_at_unless_cut_out(x_mm / 1e3, y_mm / 1e3).is_some()
            && let Some(value) = field.interpolate_between_known_neighbours_if_any(x_mm, y_mm)
        {
            area.draw_pixel((frame.left + px, frame.top + py), &color(value))?;
        }
    }
    Ok(())
}

/// Circles of the actuators' electrodes, to scale but never too small to be seen.
pub(super) fn draw_actuators<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    frame: Frame,
    scene: &Scene,
    color: RGBColor,
) -> Drawn<DB> {
    for actuator in &scene.actuators {
        let radius_m = (actuator.electrode_area_m2 / PI).sqrt();
        let at = pixel_of_place(frame, scene, actuator.x_m * 1e3, actuator.y_m * 1e3);
        let radius = frame.pixel_x(radius_m / scene.surface.length_m) - frame.left;
        area.draw(&Circle::new(at, radius.max(LEAST_RADIUS), color.stroke_width(2)))?;
    }
    Ok(())
}

/// Pixel of a place on the surface.
pub(super) fn pixel_of_place(frame: Frame, scene: &Scene, x_mm: f64, y_mm: f64) -> (i32, i32) {
    (frame.pixel_x(x_mm / (scene.surface.length_m * 1e3)), frame.pixel_y_from_top(y_mm / (scene.surface.width_m * 1e3)))
}

/// Values that scales can have as their ends: as they are, or from zero on where they are not negative.
pub(super) fn color_range_including_zero<'a>(values: impl Iterator<Item = &'a f64>) -> (f64, f64) {
    let (least, most) = values.fold((0.0_f64, 0.0_f64), |(least, most), value| (least.min(*value), most.max(*value)));
    if most > least { (least, most) } else { (0.0, 1.0) }
}
