//! A scene whose material or thickness is off, everywhere by the same part.

use super::Scene;

impl Scene {
    /// Young's moduli of surface and patches times a factor.
    pub fn scale_youngs_modulus(&mut self, factor: f64) {
        self.surface.material.youngs_modulus_pa *= factor;
        self.patches.iter_mut().for_each(|patch| patch.material.youngs_modulus_pa *= factor);
    }

    /// Thicknesses of surface and patches times a factor; their mass grows with it.
    pub fn scale_thickness(&mut self, factor: f64) {
        self.surface.thickness_m *= factor;
        self.patches.iter_mut().for_each(|patch| patch.thickness_m *= factor);
    }
}
