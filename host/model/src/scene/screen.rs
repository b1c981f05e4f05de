//! Between pixels of the screen and the surface.

use super::{PlaceError, ROUNDING, Scene, SurfacePoint};
use serde::Serialize;

/// Where the screen's pixels lie on the surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Screen {
    /// Pixels along x.
    pub width_px: u32,
    /// Pixels along y.
    pub height_px: u32,
    /// Left edge of the active area in m.
    pub x_m: f64,
    /// Its top edge.
    pub y_m: f64,
    /// Its width.
    pub width_m: f64,
    /// Its height.
    pub height_m: f64,
}

/// A point that is not on the screen.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{field} is {value}, but must be {min} to {max}, the range of the screen")]
pub struct ScreenError {
    /// `x_px` or `y_px`, `x_mm` or `y_mm`.
    pub field: &'static str,
    /// As given.
    pub value: f64,
    /// Least allowed.
    pub min: f64,
    /// Most allowed.
    pub max: f64,
}

/// Why there is no place under a pixel position.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PixelError {
    /// It is not on the screen.
    #[error(transparent)]
    Screen(#[from] ScreenError),
    /// The screen has no surface there.
    #[error(transparent)]
    Place(#[from] PlaceError),
}

impl Screen {
    /// The point of the surface in m under a pixel position, 0..=width_px and 0..=height_px, as arithmetic has it:
    /// [`Scene::surface_point_at_px`] makes a place of it.
    ///
    /// # Errors
    /// [`ScreenError`] outside the screen.
    pub fn convert_px_to_surface_m(&self, x_px: f64, y_px: f64) -> Result<(f64, f64), ScreenError> {
        let part = |field, value: f64, pixels: u32| {
            let max = f64::from(pixels);
            if (0.0..=max).contains(&value) {
                Ok(value / max)
            } else {
                Err(ScreenError { field, value, min: 0.0, max })
            }
        };
        let (u, v) = (part("x_px", x_px, self.width_px)?, part("y_px", y_px, self.height_px)?);
        Ok((self.x_m + u * self.width_m, self.y_m + v * self.height_m))
    }

    /// The pixel position over a point of the surface in m.
    ///
    /// # Errors
    /// [`ScreenError`] (in mm) where the surface has no screen.
    pub fn convert_surface_m_to_px(&self, x_m: f64, y_m: f64) -> Result<(f64, f64), ScreenError> {
        let part = |field, value: f64, start: f64, length: f64, pixels: u32| {
            let part = (value - start) / length;
            // A point on the border may have been rounded beyond it on its way here.
            if (-ROUNDING..=1.0 + ROUNDING).contains(&part) {
                return Ok(part.clamp(0.0, 1.0) * f64::from(pixels));
            }
            Err(ScreenError { field, value: value * 1e3, min: start * 1e3, max: (start + length) * 1e3 })
        };
        Ok((
            part("x_mm", x_m, self.x_m, self.width_m, self.width_px)?,
            part("y_mm", y_m, self.y_m, self.height_m, self.height_px)?,
        ))
    }
}

impl Scene {
    /// The place under a pixel position.
    ///
    /// # Errors
    /// [`PixelError`] where there is no screen, or no surface.
    pub fn surface_point_at_px(&self, x_px: f64, y_px: f64) -> Result<SurfacePoint, PixelError> {
        let (x_m, y_m) = self.screen.convert_px_to_surface_m(x_px, y_px)?;
        Ok(self.surface_or_bar_axis_point_outside_cutouts(x_m, y_m)?)
    }
}
