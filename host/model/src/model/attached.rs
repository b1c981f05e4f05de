//! What is attached to a panel at points, from a scene: the one list of it. Matrices, meshes, rigid motions and bounds follow from it.

use crate::scene::{Mount, Scene};

/// Something attached at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct PointAttachment {
    /// Where, in m.
    pub at: (f64, f64),
    /// Spring to the ground in N/m.
    pub stiffness_n_per_m: f64,
    /// Dashpot to the ground in N s/m.
    pub damping_n_s_per_m: f64,
    /// Rotational spring to the ground, against slopes in both directions, in N m/rad.
    pub turning_n_m_per_rad: f64,
    /// Loss factor of both springs to the ground.
    pub loss_factor: f64,
    /// Mass that moves with the point, in kg.
    pub mass_kg: f64,
    /// What hangs on it.
    pub carried: Option<SuspendedMass>,
}

/// A mass on a spring of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SuspendedMass {
    /// Between the point and the mass, in N/m.
    pub stiffness_n_per_m: f64,
    /// Between the point and the mass, in N s/m.
    pub damping_n_s_per_m: f64,
    /// In kg.
    pub mass_kg: f64,
}

impl PointAttachment {
    /// What resists a motion of the point in K + shift M, in N/m.
    pub fn stiffness_plus_shift_times_mass_n_per_m(&self, shift_per_s2: f64) -> f64 {
        self.stiffness_n_per_m
            + self.carried.map_or(0.0, |carried| carried.stiffness_n_per_m)
            + shift_per_s2 * self.mass_kg
    }
}

/// Everything attached at points except the ERAs: supports, then point masses.
pub(super) fn supports_and_masses(scene: &Scene) -> impl Iterator<Item = PointAttachment> {
    let supports = scene.supports.iter().map(|support| PointAttachment {
        at: (support.x_m, support.y_m),
        stiffness_n_per_m: support.stiffness_n_per_m,
        damping_n_s_per_m: support.damping_n_s_per_m,
        turning_n_m_per_rad: support.rotational_stiffness_n_m_per_rad,
        loss_factor: support.loss_factor,
        ..PointAttachment::default()
    });
    let masses = scene.masses.iter().map(|mass| PointAttachment {
        at: (mass.x_m, mass.y_m),
        mass_kg: mass.mass_kg,
        ..PointAttachment::default()
    });
    supports.chain(masses)
}

/// The ERAs, in the scene's order.
pub(super) fn actuator_attachments(scene: &Scene) -> impl Iterator<Item = PointAttachment> {
    scene.actuators.iter().map(|actuator| {
        let at = (actuator.x_m, actuator.y_m);
        let (stiffness_n_per_m, damping_n_s_per_m) =
            (actuator.effective_stiffness_n_per_m(), actuator.damping_n_s_per_m);
        let (housing_kg, moving_kg) = (actuator.housing_mass_kg, actuator.moving_mass_kg);
        match actuator.mount {
            Mount::Grounded => PointAttachment {
                at,
                stiffness_n_per_m,
                damping_n_s_per_m,
                mass_kg: housing_kg + moving_kg,
                ..PointAttachment::default()
            },
            Mount::Inertial => PointAttachment {
                at,
                mass_kg: housing_kg,
                carried: Some(SuspendedMass { stiffness_n_per_m, damping_n_s_per_m, mass_kg: moving_kg }),
                ..PointAttachment::default()
            },
        }
    })
}

/// Everything attached at points: supports, point masses, ERAs.
pub(super) fn all_point_attachments(scene: &Scene) -> impl Iterator<Item = PointAttachment> {
    supports_and_masses(scene).chain(actuator_attachments(scene))
}
