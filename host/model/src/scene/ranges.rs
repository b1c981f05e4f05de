//! What numbers in a scene file may be where several parts of it share a range, and places on the surface.

use super::layout::Layout;
use super::place::{along_side, mm};
use super::read::{Allowed, Section};
use super::{Side, SurfaceKind};

/// Largest thickness in mm; beyond it someone has mixed up units.
pub(super) const MAX_THICKNESS_MM: f64 = 100.0;
pub(super) const THICKNESS_MM: Allowed = Allowed::Within(1e-3, MAX_THICKNESS_MM);
/// Thermodynamics allows down to -1, incompressible materials have 0.5.
pub(super) const POISSON_RATIO: Allowed = Allowed::Between(-1.0, 0.5);
/// Foam is near 1e4 Pa and diamond at 1.2e12 Pa; the rest stands for "rigid".
pub(super) const YOUNGS_MODULUS_PA: Allowed = Allowed::Within(1.0, 1e18);
/// Aerogel is near 1 kg/m^3, osmium at 2.3e4 kg/m^3; some fold a panel's dead weight into its density.
pub(super) const DENSITY_KG_M3: Allowed = Allowed::Within(1e-3, 1e7);
/// All loss factors: the dampest rubbers have 1 to 2.
pub(super) const LOSS_FACTOR: Allowed = Allowed::Within(0.0, 2.0);

/// What positions are checked against; not a number where the size itself is wrong.
pub(super) struct Size {
    pub kind: SurfaceKind,
    pub length_m: f64,
    pub width_m: f64,
    /// What cut-outs leave, if there are any.
    pub left: Option<Layout>,
}

impl Size {
    /// Where something is attached, in m: both coordinates, and not in a cut-out.
    pub fn place_m(&self, section: &Section<'_, '_>) -> (f64, f64) {
        let (x_m, y_m) = (self.x_m(section), self.y_m(section));
        let is_nowhere = self.left.as_ref().is_some_and(|left| left.at(x_m, y_m).is_none());
        if is_nowhere && x_m.is_finite() && y_m.is_finite() {
            let text = format!(
                "{} and y_mm: ({}, {}) lies in a [[cutout]], but must be on the surface",
                section.key("x_mm"),
                mm(x_m),
                mm(y_m)
            );
            section.report().add(&section.place("x_mm"), text);
        }
        (x_m, y_m)
    }

    /// Whether something of a side is left.
    pub fn has_side(&self, side: Side) -> bool {
        self.left.as_ref().is_none_or(|left| !left.side(side).is_empty())
    }

    pub fn x_m(&self, section: &Section<'_, '_>) -> f64 {
        snapped(section.number("x_mm", side_range(self.length_m)), self.length_m)
    }

    /// A bar's attachments lie on its axis, whatever y is given.
    pub fn y_m(&self, section: &Section<'_, '_>) -> f64 {
        match self.kind {
            SurfaceKind::Plate => snapped(section.number("y_mm", side_range(self.width_m)), self.width_m),
            SurfaceKind::Bar => {
                section.number_or("y_mm", 0.0, side_range(self.width_m));
                self.width_m / 2.0
            }
        }
    }
}

/// A position in mm that has been looked at, in m; on the edge if it is within rounding of it.
fn snapped(at_mm: f64, side_m: f64) -> f64 {
    along_side("", at_mm / 1e3, side_m).unwrap_or_else(|_| (at_mm / 1e3).min(side_m))
}

pub(super) fn side_range(side_m: f64) -> Allowed {
    if side_m.is_nan() { Allowed::NotNegative } else { Allowed::Along(0.0, mm(side_m)) }
}
