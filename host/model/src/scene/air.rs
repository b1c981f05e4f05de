//! Air that is shut in behind the panel.

use super::Scene;

/// Bulk modulus of air in Pa for changes too fast for heat to flow, gamma p = rho c^2: 1.4 times 1013.25 hPa, whatever its temperature.
pub const BULK_MODULUS_PA: f64 = 1.4 * 101_325.0;

impl Scene {
    /// What sealed air resists the panel's mean deflection with, in N/m: rho c^2 A^2 / V = rho c^2 A / depth. `None` without such air.
    #[must_use]
    pub fn sealed_air_stiffness_if_any_n_per_m(&self) -> Option<f64> {
        self.sealed_depth_m
            .map(|depth_m| BULK_MODULUS_PA * self.surface_area_less_cutouts_ignoring_bar_steps_m2() / depth_m)
    }
}
