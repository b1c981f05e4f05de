//! A scene whose material or thickness is off, everywhere by the same part.

use super::Scene;

impl Scene {
    /// Moduli of surface, layers and patches times a factor.
    pub fn scale_all_elastic_moduli(&mut self, factor: f64) {
        for layer in &mut self.surface.layers {
            let elastic = &mut layer.elastic;
            [&mut elastic.ex_pa, &mut elastic.ey_pa, &mut elastic.g_pa]
                .into_iter()
                .for_each(|modulus| *modulus *= factor);
        }
        self.surface.material.youngs_modulus_pa *= factor;
        self.patches.iter_mut().for_each(|patch| patch.material.youngs_modulus_pa *= factor);
    }

    /// Thicknesses of surface, layers and patches times a factor; their mass grows with it.
    pub fn scale_all_thicknesses(&mut self, factor: f64) {
        self.surface.layers.iter_mut().for_each(|layer| layer.thickness_m *= factor);
        self.surface.thickness_m *= factor;
        self.patches.iter_mut().for_each(|patch| patch.thickness_m *= factor);
    }
}
