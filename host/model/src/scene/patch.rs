//! Rectangles that differ from the rest of the surface.

use super::Material;
use serde::Serialize;

/// A rectangle of another thickness or material, or a step of a bar.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Patch {
    /// Its left end in m.
    pub x_m: f64,
    /// Its top end in m; on a bar, which it is centred on, negative where it is wider than the bar.
    pub y_m: f64,
    /// Along x in m.
    pub length_m: f64,
    /// Along y in m; on a bar the bar's width within the step.
    pub width_m: f64,
    /// In m.
    pub thickness_m: f64,
    /// What it is made of.
    pub material: Material,
}

/// A rectangle without surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cutout {
    /// Its left end in m.
    pub x_m: f64,
    /// Its top end in m.
    pub y_m: f64,
    /// Along x in m.
    pub length_m: f64,
    /// Along y in m.
    pub width_m: f64,
}

impl Patch {
    pub(super) fn range_in_x_m(&self) -> [f64; 2] {
        [self.x_m, self.x_m + self.length_m]
    }

    pub(super) fn range_in_y_m(&self) -> [f64; 2] {
        [self.y_m, self.y_m + self.width_m]
    }
}

impl Cutout {
    pub(super) fn range_in_x_m(&self) -> [f64; 2] {
        [self.x_m, self.x_m + self.length_m]
    }

    pub(super) fn range_in_y_m(&self) -> [f64; 2] {
        [self.y_m, self.y_m + self.width_m]
    }
}
