//! The finger that touches: what it is to the place under it.

use super::{Mass, Scene, Support};
use serde::Serialize;

/// A finger at rest on the surface, as what one feels of it there: a mass that moves with the place, a spring and a dashpot to the
/// ground.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Finger {
    /// In kg.
    pub mass_kg: f64,
    /// In N s/m.
    pub damping_n_s_per_m: f64,
    /// In N/m.
    pub stiffness_n_per_m: f64,
}

impl Scene {
    /// The panel with the scene's finger resting on each of these places (m); unchanged where the scene has no finger.
    #[must_use]
    pub fn replace_finger_by_masses_and_supports_at_places(&self, places: &[(f64, f64)]) -> Self {
        let mut touched = Self { finger: None, ..self.clone() };
        let Some(Finger { mass_kg, damping_n_s_per_m, stiffness_n_per_m }) = self.finger else { return touched };
        for (x_m, y_m) in places.iter().copied() {
            if mass_kg > 0.0 {
                touched.masses.push(Mass { x_m, y_m, mass_kg });
            }
            if damping_n_s_per_m > 0.0 || stiffness_n_per_m > 0.0 {
                touched.supports.push(Support {
                    x_m,
                    y_m,
                    stiffness_n_per_m,
                    damping_n_s_per_m,
                    rotational_stiffness_n_m_per_rad: 0.0,
                    loss_factor: 0.0,
                });
            }
        }
        touched
    }
}
