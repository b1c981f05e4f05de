//! Places on the surface, and lines over it from edge to edge.
//!
//! Arithmetic takes a coordinate beyond an edge by a rounding: 0.36 * 48 / 48 is 0.36000000000000004. So every place that
//! comes from outside or is computed passes [`Scene::surface_or_bar_axis_point_outside_cutouts`], and every grid is made by [`equidistant_numbers`].

use super::{Scene, Surface, SurfaceKind};

/// How near to an edge a coordinate is on it, relative to the side: what a dozen operations and nine printed digits leave,
/// and a nanometre on a panel of 1 m.
pub const ROUNDING: f64 = 1e-9;

/// A place on the surface's rectangle in m, edges included: made by [`Surface::surface_or_bar_axis_point_even_in_cutout`] and [`Scene::surface_or_bar_axis_point_outside_cutouts`] alone. On a bar it
/// is on the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    x_m: f64,
    y_m: f64,
}

impl SurfacePoint {
    /// In m from the left edge, 0 to the length.
    #[must_use]
    pub const fn x_m(self) -> f64 {
        self.x_m
    }

    /// In m from the top edge, 0 to the width.
    #[must_use]
    pub const fn y_m(self) -> f64 {
        self.y_m
    }

    /// Both coordinates in m.
    #[must_use]
    pub const fn coordinates_m(self) -> (f64, f64) {
        (self.x_m, self.y_m)
    }
}

/// Why a place is none of the surface.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PlaceError {
    /// Beyond an edge.
    #[error("{field} is {value}, but must be 0 to {max}")]
    Outside {
        /// `x_mm` or `y_mm`.
        field: &'static str,
        /// In mm.
        value: f64,
        /// The side in mm.
        max: f64,
    },
    /// In a cut-out.
    #[error(
        "the point with x_mm = {x_mm} and y_mm = {y_mm} lies in cutout[{cutout}] of the scene, where there is no surface"
    )]
    Cutout {
        /// In mm.
        x_mm: f64,
        /// In mm.
        y_mm: f64,
        /// Which, counted from 1.
        cutout: usize,
    },
}

/// A length in mm, without the rounding of the conversion to metres and back.
pub(super) fn metres_to_mm_rounded_to_9_decimals(length_m: f64) -> f64 {
    // Beyond a kilometre the digits do not matter, and the product may overflow.
    if length_m.abs() < 1e3 { (length_m * 1e12).round() / 1e9 } else { length_m * 1e3 }
}

/// A coordinate along a side, both in m: on the edge if it is within [`ROUNDING`] of it. `field` is what messages call it.
///
/// # Errors
/// [`PlaceError::Outside`] beyond an edge, and for what is not a number.
pub fn check_and_snap_coordinate_along_side(field: &'static str, at_m: f64, side_m: f64) -> Result<f64, PlaceError> {
    let near = |edge_m: f64| (at_m - edge_m).abs() <= ROUNDING * side_m;
    if near(side_m) {
        Ok(side_m)
    } else if near(0.0) {
        Ok(0.0)
    } else if (0.0..=side_m).contains(&at_m) {
        Ok(at_m)
    } else {
        Err(PlaceError::Outside {
            field,
            value: metres_to_mm_rounded_to_9_decimals(at_m),
            max: metres_to_mm_rounded_to_9_decimals(side_m),
        })
    }
}

/// `count` equidistant numbers from one to another, both exactly among them and none beyond; the middle if it is one.
#[expect(clippy::cast_precision_loss, reason = "counts of points")]
#[must_use]
pub fn equidistant_numbers(from: f64, to: f64, count: usize) -> Vec<f64> {
    if count == 1 {
        return vec![0.5 * (from + to)];
    }
    let last = count.saturating_sub(1);
    let number = |i: usize| match i {
        0 => from,
        _ if i == last => to,
        // The product first: where both are whole numbers of a unit, so are the lines between.
        _ => (from + (to - from) * i as f64 / last as f64).clamp(from.min(to), from.max(to)),
    };
    (0..count).map(number).collect()
}

impl Surface {
    /// A point on the surface's rectangle, cut-outs or not; on a bar it is moved onto the axis.
    ///
    /// # Errors
    /// [`PlaceError::Outside`].
    pub fn surface_or_bar_axis_point_even_in_cutout(&self, x_m: f64, y_m: f64) -> Result<SurfacePoint, PlaceError> {
        let x_m = check_and_snap_coordinate_along_side("x_mm", x_m, self.length_m)?;
        let y_m = check_and_snap_coordinate_along_side("y_mm", y_m, self.width_m)?;
        Ok(match self.kind {
            SurfaceKind::Plate => SurfacePoint { x_m, y_m },
            SurfaceKind::Bar => SurfacePoint { x_m, y_m: self.width_m / 2.0 },
        })
    }
}

impl Scene {
    /// Columns and rows of a grid in m, border to border; a bar has one row, its axis.
    #[must_use]
    pub fn surface_grid_lines_or_bar_axis_line_m(&self, (columns, rows): (usize, usize)) -> (Vec<f64>, Vec<f64>) {
        let rows = if self.surface.kind == SurfaceKind::Bar { 1 } else { rows };
        (equidistant_numbers(0.0, self.surface.length_m, columns), equidistant_numbers(0.0, self.surface.width_m, rows))
    }

    /// A place where there is surface.
    ///
    /// # Errors
    /// [`PlaceError`] beyond an edge and inside of a cut-out.
    pub fn surface_or_bar_axis_point_outside_cutouts(&self, x_m: f64, y_m: f64) -> Result<SurfacePoint, PlaceError> {
        let place = self.surface.surface_or_bar_axis_point_even_in_cutout(x_m, y_m)?;
        match self.cutout_number_counted_from_1_at(place.x_m, place.y_m) {
            None => Ok(place),
            Some(cutout) => Err(PlaceError::Cutout {
                x_mm: metres_to_mm_rounded_to_9_decimals(place.x_m),
                y_mm: metres_to_mm_rounded_to_9_decimals(place.y_m),
                cutout,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::STARTING_PLATE;

    /// Sides of every whole millimetre, as a scene file has them.
    fn sides() -> impl Iterator<Item = f64> {
        (1..=10_000_u32).map(|side_mm| f64::from(side_mm) / 1e3)
    }

    #[test]
    fn lines_end_exactly_at_the_edges() {
        for side in sides() {
            for count in [2, 3, 5, 7, 13, 33, 49, 50, 97, 101] {
                let lines = equidistant_numbers(0.0, side, count);
                assert!(lines.len() == count && lines[0] == 0.0 && lines[count - 1] == side, "{side} {count}");
                assert!(lines.windows(2).all(|pair| pair[0] < pair[1]), "{side} {count}");
            }
        }
        assert_eq!((equidistant_numbers(0.0, 0.3, 1), equidistant_numbers(1.0, 2.0, 0)), (vec![0.15], vec![]));
        assert_eq!(equidistant_numbers(0.0, 1.0, 5), [0.0, 0.25, 0.5, 0.75, 1.0]);
    }

    #[test]
    fn places_within_rounding_of_an_edge_are_on_it_and_others_stay() {
        let mut surface = Scene::parse("plate", STARTING_PLATE).unwrap().surface;
        for side in sides() {
            (surface.length_m, surface.width_m) = (side, side / 3.0);
            let width = surface.width_m;
            for (x, y) in [(side.next_up(), -1e-17), (side * 48.0 / 48.0, 0.0), (side * 1e3 / 1e3, -0.0)] {
                assert_eq!(
                    surface.surface_or_bar_axis_point_even_in_cutout(x, y).unwrap().coordinates_m(),
                    (side, 0.0)
                );
            }
            assert_eq!(
                surface
                    .surface_or_bar_axis_point_even_in_cutout(-1e-10 * side, width.next_down())
                    .unwrap()
                    .coordinates_m(),
                (0.0, width)
            );
            assert_eq!(
                surface.surface_or_bar_axis_point_even_in_cutout(0.3 * side, 0.7 * width).unwrap().coordinates_m(),
                (0.3 * side, 0.7 * width)
            );
            assert!(
                surface.surface_or_bar_axis_point_even_in_cutout(side * (1.0 + 1e-8), 0.0).is_err()
                    && surface.surface_or_bar_axis_point_even_in_cutout(0.0, -1e-8 * side).is_err()
            );
        }
        assert!(
            surface.surface_or_bar_axis_point_even_in_cutout(f64::NAN, 0.0).is_err()
                && surface.surface_or_bar_axis_point_even_in_cutout(0.0, f64::INFINITY).is_err()
        );
        surface.length_m = 0.36;
        let error = surface.surface_or_bar_axis_point_even_in_cutout(0.3601, 0.0).unwrap_err();
        assert_eq!(error.to_string(), "x_mm is 360.1, but must be 0 to 360");
    }

    #[test]
    fn a_bars_places_are_on_its_axis() {
        let mut surface = Scene::parse("plate", STARTING_PLATE).unwrap().surface;
        surface.kind = SurfaceKind::Bar;
        assert_eq!(
            surface.surface_or_bar_axis_point_even_in_cutout(0.1, 0.0).unwrap().coordinates_m(),
            (0.1, surface.width_m / 2.0)
        );
        assert!(surface.surface_or_bar_axis_point_even_in_cutout(0.1, 2.0 * surface.width_m).is_err());
    }

    #[test]
    fn pixels_at_the_end_of_the_screen_are_on_the_edge() {
        for side_mm in (40..=1000).step_by(7) {
            let text = STARTING_PLATE.replace("length_mm = 300.0", &format!("length_mm = {side_mm}"));
            assert!(text.contains(&format!("length_mm = {side_mm}\n")), "{text}");
            let mut scene = Scene::parse("plate", text.split("[[").next().unwrap()).unwrap();
            for x_mm in [1.0, 7.7, 19.3, 33.3] {
                let (start, width) = (x_mm / 1e3, (f64::from(side_mm) - x_mm) / 1e3);
                (scene.screen.x_m, scene.screen.width_m) = (start, width);
                let right = scene.surface_point_at_px(f64::from(scene.screen.width_px), 0.0).unwrap();
                assert_eq!(right.x_m(), scene.surface.length_m, "{side_mm} {x_mm}");
            }
        }
    }
}
