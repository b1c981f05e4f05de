//! What is attached to a panel, from a scene: the one list of it. What acts where (assembly), where meshes are finer (placement, neighbours), what
//! holds the panel (rigid motions) and where no bound exists (estimator) all follow from it.

use crate::scene::{Mount, Scene, Support};

/// Something attached at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Attached {
    /// Where, in m.
    pub at: (f64, f64),
    /// Spring to the ground in N/m.
    pub grounded_n_per_m: f64,
    /// Spring to a mass of its own in N/m.
    pub carried_n_per_m: f64,
    /// Rotational spring to the ground, against slopes in both directions, in N m/rad.
    pub turning_n_m_per_rad: f64,
    /// Mass that moves with the point, in kg.
    pub mass_kg: f64,
}

impl Attached {
    fn support(support: &Support) -> Self {
        Self {
            at: (support.x_m, support.y_m),
            grounded_n_per_m: support.stiffness_n_per_m,
            turning_n_m_per_rad: support.rotational_stiffness_n_m_per_rad,
            ..Self::default()
        }
    }

    /// What resists a motion of the point in K + shift M, in N/m.
    pub fn held(&self, shift: f64) -> f64 {
        self.grounded_n_per_m + self.carried_n_per_m + shift * self.mass_kg
    }
}

/// All of a scene: supports, point masses, ERAs.
pub(super) fn attached(scene: &Scene) -> impl Iterator<Item = Attached> {
    let masses = scene.masses.iter().map(|mass| Attached {
        at: (mass.x_m, mass.y_m),
        mass_kg: mass.mass_kg,
        ..Attached::default()
    });
    let actuators = scene.actuators.iter().map(|actuator| {
        let (at, spring) = ((actuator.x_m, actuator.y_m), actuator.effective_stiffness_n_per_m());
        let housing_kg = actuator.housing_mass_kg;
        match actuator.mount {
            Mount::Grounded => Attached {
                at,
                grounded_n_per_m: spring,
                mass_kg: housing_kg + actuator.moving_mass_kg,
                ..Attached::default()
            },
            Mount::Inertial => Attached { at, carried_n_per_m: spring, mass_kg: housing_kg, ..Attached::default() },
        }
    });
    scene.supports.iter().map(Attached::support).chain(masses).chain(actuators)
}
