//! Layers that make a surface: what a stack of plies resists bending with, by classical laminate theory.
//!
//! A bonded stack deforms as one: its strains are e0 + z k, k the curvatures of its bending and e0 such that nothing pulls in the
//! plane, e0 = -A^-1 B k with A and B the integrals of Q and z Q over the thickness, Q the plane stress stiffness of what is at z
//! (Jones, Mechanics of Composite Materials, chapter 4). So each ply adds the integral of (z + T)' Q (z + T), T = -A^-1 B, and all of them add
//! up to D - B A^-1 B: no term is a small difference of large ones. Where a layer slips on the one below nothing is handed on, and the
//! stacks on either side bend each about a neutral plane of its own.

use super::{Material, Surface, SurfaceKind};
use nalgebra::Matrix2;
use serde::Serialize;

/// Part by which rigidities may differ from those of an isotropic plate and be taken for them: what rounding makes of layers that are
/// each isotropic.
const ROUNDING: f64 = 1e-12;

/// A layer of the surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ply {
    /// In m.
    pub thickness_m: f64,
    /// How it resists strain.
    pub elastic: PlyElasticity,
    /// In kg/m^3.
    pub density_kg_m3: f64,
    /// Hysteretic: its stiffness times 1 + j eta.
    pub loss_factor: f64,
    /// Whether it slips on the layer below.
    pub slips: bool,
}

/// An elastic material whose axes are those of the surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlyElasticity {
    /// Young's modulus along x in Pa.
    pub ex_pa: f64,
    /// Along y.
    pub ey_pa: f64,
    /// Shear modulus in the plane.
    pub g_pa: f64,
    /// What it narrows by along y over what it is stretched by along x.
    pub poisson_xy: f64,
}

impl PlyElasticity {
    /// An elastic material that is the same along all axes.
    #[must_use]
    pub fn from_isotropic_moduli(youngs_modulus_pa: f64, poisson: f64) -> Self {
        let g_pa = youngs_modulus_pa / (2.0 * (1.0 + poisson));
        Self { ex_pa: youngs_modulus_pa, ey_pa: youngs_modulus_pa, g_pa, poisson_xy: poisson }
    }

    /// The material turned by 90 degrees.
    #[must_use]
    pub fn turn_by_90_degrees(self) -> Self {
        let Self { ex_pa, ey_pa, g_pa, poisson_xy } = self;
        Self { ex_pa: ey_pa, ey_pa: ex_pa, g_pa, poisson_xy: poisson_xy * ey_pa / ex_pa }
    }

    /// Stress over strain along x and y in Pa: plane stress in a plate; in a bar, whose sides are free, each direction by itself.
    fn plane_stiffness_pa(self, kind: SurfaceKind) -> Matrix2<f64> {
        let Self { ex_pa, ey_pa, poisson_xy, .. } = self;
        match kind {
            SurfaceKind::Plate => {
                let between = poisson_xy * ey_pa;
                Matrix2::new(ex_pa, between, between, ey_pa) / (1.0 - poisson_xy * poisson_xy * ey_pa / ex_pa)
            }
            SurfaceKind::Bar => Matrix2::new(ex_pa, 0.0, 0.0, ey_pa),
        }
    }
}

/// What a plate resists bending with, in N m: D11 w_xx^2 + 2 D12 w_xx w_yy + D22 w_yy^2 + 4 D66 w_xy^2 is twice its energy per area.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PlateRigidities {
    /// Against bending along x.
    pub d11: f64,
    /// Between both.
    pub d12: f64,
    /// Against bending along y.
    pub d22: f64,
    /// Against twist.
    pub d66: f64,
}

impl PlateRigidities {
    /// Adds a ply's stiffness against bending and against twist, times a factor.
    fn add_weighted_stiffness(&mut self, stiffness_along_axes: &Matrix2<f64>, twist: f64, factor: f64) {
        self.d11 += factor * stiffness_along_axes[(0, 0)];
        self.d12 += factor * 0.5 * (stiffness_along_axes[(0, 1)] + stiffness_along_axes[(1, 0)]);
        self.d22 += factor * stiffness_along_axes[(1, 1)];
        self.d66 += factor * twist;
    }

    /// That of waves along (cos, sin) of an angle whose squared cosine is given: D11 c^4 + 2 (D12 + 2 D66) c^2 s^2 + D22 s^4.
    #[must_use]
    pub fn rigidity_in_direction(&self, squared_cosine: f64) -> f64 {
        let (c, s) = (squared_cosine, 1.0 - squared_cosine);
        self.d11 * c * c + 2.0 * (self.d12 + 2.0 * self.d66) * c * s + self.d22 * s * s
    }

    /// The least and the largest [`PlateRigidities::rigidity_in_direction`] of all directions.
    #[must_use]
    pub fn least_and_largest_rigidity_over_directions(&self) -> [f64; 2] {
        let (x, y, both) = (self.d11, self.d22, self.d12 + 2.0 * self.d66);
        let (low, high, turn) = (x.min(y), x.max(y), x + y - 2.0 * both);
        // The parabola turns between the axes where it rises, or falls, from both of them.
        if (both - x) * (both - y) > 0.0 && turn != 0.0 {
            let between = self.rigidity_in_direction((y - both) / turn);
            return [low.min(between), high.max(between)];
        }
        [low, high]
    }

    /// The mean of [`PlateRigidities::rigidity_in_direction`] over all directions: cos^4 has the mean 3/8, cos^2 sin^2 1/8.
    #[must_use]
    pub fn mean_rigidity_over_directions(&self) -> f64 {
        0.375 * (self.d11 + self.d22) + 0.25 * (self.d12 + 2.0 * self.d66)
    }

    /// Whether they are an isotropic plate's, but for rounding.
    #[must_use]
    pub fn is_isotropic(&self) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= ROUNDING * self.d11;
        near(self.d11, self.d22) && near(self.d11, self.d12 + 2.0 * self.d66)
    }
}

/// What all layers of a surface are together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Laminate {
    /// In m.
    pub thickness_m: f64,
    /// In kg/m^2.
    pub per_area_kg_m2: f64,
    /// Against bending; of a bar D11 is E I over its width, and the others are of no account.
    pub rigidities: PlateRigidities,
    /// Of all layers, each weighted with its part of the strain energy: of a bar that bends, of plane waves in a plate, over all directions alike.
    pub loss_factor: f64,
    /// Bending over shear stiffness in m^2, of the direction in which that is more: shear takes this times k^2 from the stiffness of waves
    /// of the wavenumber k.
    pub shear_m2: f64,
    /// Moment of inertia over mass, in m^2.
    pub turning_m2: f64,
}

impl Laminate {
    /// The bending stiffnesses with their names: of a plate those of classical laminate theory in N m, of a bar `width_m` wide E I in N m^2.
    #[must_use]
    pub fn named_bending_stiffnesses(&self, kind: SurfaceKind, width_m: f64) -> Vec<(&'static str, f64)> {
        let PlateRigidities { d11, d12, d22, d66 } = self.rigidities;
        match kind {
            SurfaceKind::Plate => vec![("d11_n_m", d11), ("d12_n_m", d12), ("d22_n_m", d22), ("d66_n_m", d66)],
            SurfaceKind::Bar => vec![("bending_stiffness_n_m2", d11 * width_m)],
        }
    }

    /// The laminate of layers from the bottom to the top, of which there is at least one.
    #[must_use]
    pub fn from_plies(kind: SurfaceKind, plies: &[Ply]) -> Self {
        let thickness_m: f64 = plies.iter().map(|ply| ply.thickness_m).sum();
        let per_area_kg_m2 = plies.iter().map(|ply| ply.density_kg_m3 * ply.thickness_m).sum();
        let (mut rigidities, mut lost) = (PlateRigidities::default(), PlateRigidities::default());
        let (mut shear, mut turning) = ([0.0; 2], 0.0);
        for stack in plies.chunk_by(|_, above| !above.slips) {
            let stack = BondedStack::new(kind, stack);
            stack.add_bending_rigidities_and_loss_weighted_rigidities(&mut rigidities, &mut lost);
            turning += stack.rotary_inertia_per_area_kg();
            for (axis, sum) in shear.iter_mut().enumerate() {
                *sum += stack.integrate_squared_shear_flow_over_modulus(axis);
            }
        }
        let along = [rigidities.d11, rigidities.d22];
        let (loss_factor, shear_m2) = match kind {
            SurfaceKind::Plate => (
                lost.mean_rigidity_over_directions() / rigidities.mean_rigidity_over_directions(),
                (shear[0] / along[0]).max(shear[1] / along[1]),
            ),
            SurfaceKind::Bar => (lost.d11 / rigidities.d11, shear[0] / along[0]),
        };
        Self { thickness_m, per_area_kg_m2, rigidities, loss_factor, shear_m2, turning_m2: turning / per_area_kg_m2 }
    }

    /// The uniform material of the same thickness, weight and stiffness; of rigidities that no such material has their geometric mean.
    #[must_use]
    pub fn to_uniform_material(&self, kind: SurfaceKind) -> Material {
        let PlateRigidities { d11, d12, d22, .. } = self.rigidities;
        let (rigidity, poisson_ratio) = match kind {
            SurfaceKind::Plate if self.rigidities.is_isotropic() => (d11, d12 / d11),
            SurfaceKind::Plate => ((d11 * d22).sqrt(), d12 / (d11 * d22).sqrt()),
            SurfaceKind::Bar => (d11, 0.0),
        };
        Material {
            youngs_modulus_pa: 12.0 * rigidity * (1.0 - poisson_ratio * poisson_ratio) / self.thickness_m.powi(3),
            poisson_ratio,
            density_kg_m3: self.per_area_kg_m2 / self.thickness_m,
        }
    }
}

/// Layers that are bonded to each other.
struct BondedStack<'a> {
    /// Each with the height of its middle over the stack's.
    plies: Vec<(f64, &'a Ply)>,
    kind: SurfaceKind,
}

impl<'a> BondedStack<'a> {
    fn new(kind: SurfaceKind, plies: &'a [Ply]) -> Self {
        let mut top = -0.5 * plies.iter().map(|ply| ply.thickness_m).sum::<f64>();
        let place = |ply: &'a Ply| {
            top += ply.thickness_m;
            (top - 0.5 * ply.thickness_m, ply)
        };
        Self { plies: plies.iter().map(place).collect(), kind }
    }

    /// Adds what bends it, and of each layer that times its loss factor.
    fn add_bending_rigidities_and_loss_weighted_rigidities(
        &self,
        rigidities: &mut PlateRigidities,
        loss_weighted_rigidities: &mut PlateRigidities,
    ) {
        let (mut a, mut b) = (Matrix2::zeros(), Matrix2::zeros());
        let (mut a_twist, mut b_twist) = (0.0, 0.0);
        for (z, ply) in &self.plies {
            let (q, t) = (ply.elastic.plane_stiffness_pa(self.kind), ply.thickness_m);
            a += q * t;
            b += q * (t * z);
            a_twist += ply.elastic.g_pa * t;
            b_twist += ply.elastic.g_pa * t * z;
        }
        // A is a sum of positive definite matrices; only overflow leaves it without an inverse, and what follows is refused as that.
        let shift = -(a.try_inverse().unwrap_or_else(Matrix2::zeros) * b);
        let twist = -b_twist / a_twist;
        for (z, ply) in &self.plies {
            let (q, t) = (ply.elastic.plane_stiffness_pa(self.kind), ply.thickness_m);
            let (about, turned) = (Matrix2::identity() * *z + shift, t.powi(3) / 12.0);
            let both = about.transpose() * q * about * t + q * turned;
            let own = ply.elastic.g_pa * (t * (z + twist).powi(2) + turned);
            rigidities.add_weighted_stiffness(&both, own, 1.0);
            loss_weighted_rigidities.add_weighted_stiffness(&both, own, ply.loss_factor);
        }
    }

    /// Moment of inertia per area about the stack's neutral plane, about: its centre of mass.
    fn rotary_inertia_per_area_kg(&self) -> f64 {
        let mass = |ply: &Ply| ply.density_kg_m3 * ply.thickness_m;
        let total: f64 = self.plies.iter().map(|(_, ply)| mass(ply)).sum();
        let centre = self.plies.iter().map(|(z, ply)| mass(ply) * z).sum::<f64>() / total;
        let own = |(z, ply): &(f64, &Ply)| mass(ply) * ((z - centre).powi(2) + ply.thickness_m.powi(2) / 12.0);
        self.plies.iter().map(own).sum()
    }

    /// The integral of g^2 / G over the thickness, where a bending moment that changes along `axis` shears with g: the integral of E (z - z0) from
    /// below, E the stiffness along the axis and z0 its neutral plane. Over the squared rigidity it is what shear gives way: 6/5 over G h of one layer.
    fn integrate_squared_shear_flow_over_modulus(&self, axis: usize) -> f64 {
        let along = |ply: &Ply| ply.elastic.plane_stiffness_pa(self.kind)[(axis, axis)];
        let sum = |power: i32| -> f64 {
            self.plies.iter().map(|(z, ply)| along(ply) * ply.thickness_m * z.powi(power)).sum()
        };
        let neutral = sum(1) / sum(0);
        let (mut below, mut total) = (0.0, 0.0);
        for (z, ply) in &self.plies {
            let (t, from) = (ply.thickness_m, z - 0.5 * ply.thickness_m - neutral);
            let at = |part: f64| below + along(ply) * part * t * (from + 0.5 * part * t);
            // Gauss' three points: the square of a parabola exactly.
            let apart = 0.5 * 0.6_f64.sqrt();
            let points = [(0.5 - apart, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.5 + apart, 5.0 / 18.0)];
            total += points.iter().map(|(part, weight)| weight * t * at(*part).powi(2) / ply.elastic.g_pa).sum::<f64>();
            below = at(1.0);
        }
        total
    }
}

impl Surface {
    /// What the surface's layers are together; `None` where it has none.
    #[must_use]
    pub fn laminate_if_layered(&self) -> Option<Laminate> {
        (!self.layers.is_empty()).then(|| Laminate::from_plies(self.kind, &self.layers))
    }

    /// The rigidities that no [`Material`] has: of layers that are stiffer along one axis than along the other.
    #[must_use]
    pub(super) fn rigidities_if_layered_plate_is_anisotropic(&self) -> Option<PlateRigidities> {
        let rigidities = self.laminate_if_layered().filter(|_| self.kind == SurfaceKind::Plate)?.rigidities;
        (!rigidities.is_isotropic()).then_some(rigidities)
    }
}

#[cfg(test)]
mod tests;
