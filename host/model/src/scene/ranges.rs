//! What numbers in a scene file may be where several parts of it share a range, and places on the surface.

use super::layout::SurfaceLayout;
use super::place::{check_and_snap_coordinate_along_side, metres_to_mm_rounded_to_9_decimals};
use super::read::{AllowedNumbers, TomlSection};
use super::{Side, SurfaceKind};

/// Largest thickness in mm; beyond it someone has mixed up units.
pub(super) const MAX_THICKNESS_MM: f64 = 100.0;
pub(super) const THICKNESS_MM: AllowedNumbers = AllowedNumbers::Within(1e-3, MAX_THICKNESS_MM);
/// Thermodynamics allows down to -1, incompressible materials have 0.5.
pub(super) const POISSON_RATIO: AllowedNumbers = AllowedNumbers::Between(-1.0, 0.5);
/// Foam is near 1e4 Pa and diamond at 1.2e12 Pa; the rest stands for "rigid".
pub(super) const YOUNGS_MODULUS_PA: AllowedNumbers = AllowedNumbers::Within(1.0, 1e18);
/// Aerogel is near 1 kg/m^3, osmium at 2.3e4 kg/m^3; some fold a panel's dead weight into its density.
pub(super) const DENSITY_KG_M3: AllowedNumbers = AllowedNumbers::Within(1e-3, 1e7);
/// All loss factors: the dampest rubbers have 1 to 2.
pub(super) const LOSS_FACTOR: AllowedNumbers = AllowedNumbers::Within(0.0, 2.0);

/// What positions are checked against; not a number where the size itself is wrong.
pub(super) struct SurfaceSize {
    pub kind: SurfaceKind,
    pub length_m: f64,
    pub width_m: f64,
    /// What cut-outs leave, if there are any.
    pub left: Option<SurfaceLayout>,
}

impl SurfaceSize {
    /// Where something is attached, in m: both coordinates, and not in a cut-out.
    pub fn read_position_m_and_report_if_in_cutout(&self, section: &TomlSection<'_, '_>) -> (f64, f64) {
        let (x_m, y_m) = (self.read_x_m(section), self.read_y_or_ignore_it_and_take_bar_axis_m(section));
        let is_nowhere = self.left.as_ref().is_some_and(|left| left.layer_at_unless_cut_out(x_m, y_m).is_none());
        if is_nowhere && x_m.is_finite() && y_m.is_finite() {
            let text = format!(
                "{} and y_mm: the point ({}, {}) lies in a [[cutout]], but must be on the surface",
                section.key_with_path("x_mm"),
                metres_to_mm_rounded_to_9_decimals(x_m),
                metres_to_mm_rounded_to_9_decimals(y_m)
            );
            section.mistake_report().add_mistake_at(&section.byte_range_of_value_or_section("x_mm"), text);
        }
        (x_m, y_m)
    }

    /// Whether cut-outs leave something of a side.
    pub fn do_cutouts_leave_part_of_side(&self, side: Side) -> bool {
        self.left.as_ref().is_none_or(|left| !left.remaining_stretches_of_side_m(side).is_empty())
    }

    /// Reads the x coordinate in m.
    pub fn read_x_m(&self, section: &TomlSection<'_, '_>) -> f64 {
        convert_mm_to_m_and_snap_to_ends_of_side(
            section.read_required_number_or_nan("x_mm", allowed_mm_along_side(self.length_m)),
            self.length_m,
        )
    }

    /// A bar's attachments lie on its axis, whatever y is given.
    pub fn read_y_or_ignore_it_and_take_bar_axis_m(&self, section: &TomlSection<'_, '_>) -> f64 {
        match self.kind {
            SurfaceKind::Plate => convert_mm_to_m_and_snap_to_ends_of_side(
                section.read_required_number_or_nan("y_mm", allowed_mm_along_side(self.width_m)),
                self.width_m,
            ),
            SurfaceKind::Bar => {
                section.read_optional_number_or_nan("y_mm", 0.0, allowed_mm_along_side(self.width_m));
                self.width_m / 2.0
            }
        }
    }
}

/// A position in mm that has been looked at, in m; on the edge if it is within rounding of it.
fn convert_mm_to_m_and_snap_to_ends_of_side(at_mm: f64, side_m: f64) -> f64 {
    check_and_snap_coordinate_along_side("", at_mm / 1e3, side_m).unwrap_or_else(|_| (at_mm / 1e3).min(side_m))
}

pub(super) fn allowed_mm_along_side(side_m: f64) -> AllowedNumbers {
    if side_m.is_nan() {
        AllowedNumbers::NotNegative
    } else {
        AllowedNumbers::Along(0.0, metres_to_mm_rounded_to_9_decimals(side_m))
    }
}
