//! What a point force does to a plate that is stiffer along one axis than along the other, as sums of Z^2 log Z.
//!
//! With n across an edge and t along it, D_n w_nnnn + 2 H w_nntt + D_t w_tttt = force has, in the Fourier transform along t, solutions
//! e^(-l k n) with D_n l^4 - 2 H l^2 + D_t = 0: two roots l with positive real parts, real or conjugate to each other. A force of
//! one, continuous in w, w_n and w_nn, is the sum of a_j e^(-l_j k |n|) / k^3 with a_1 l_1 = -a_2 l_2 = -1 / (2 D_n (l_1^2 - l_2^2)), and
//! e^(-k s) / k^3 transformed back is s^2 log s, up to polynomials: Lekhnitskii's complex potentials (Anisotropic Plates, 1968). An edge at n = 0
//! reflects sums of e^(-l_m k n), whose amplitudes follow from what the edge demands; each is singular at an image of its own behind the edge.
//! With equal roots all of it is [`super::singular`].

use super::sections::RelativeBending;
use super::singular::{SingularSource, SingularTerms, image_source_of_clamped_edge, image_source_of_free_edge};
use super::wave::LogWave;
use crate::scene::Side;
use num_complex::Complex64;

/// H over sqrt(D_n D_t) is taken for 1 more or less this, where it is nearer to 1: there the roots meet, and the functions are small differences of
/// large ones. What is then left to the elements is as small a part of the singularity.
const APART: f64 = 0.02;

/// What the plate around a point force is.
#[derive(Clone, Copy, Debug)]
pub enum PlateMedium {
    /// With Poisson's ratio.
    Isotropic(f64),
    /// With rigidities of its own along x and y.
    Orthotropic(RelativeBending),
}

impl PlateMedium {
    /// The medium that a plate of these rigidities is.
    pub fn isotropic_or_orthotropic_from_bending(bending: RelativeBending) -> Self {
        if bending.is_isotropic() { Self::Isotropic(bending.poisson) } else { Self::Orthotropic(bending) }
    }

    /// What a force inside the plate does, 8 pi sqrt(D_11 D_22) times: r^2 log r where it is isotropic.
    /// Written by the waves across `side_that_waves_run_across`, as a clamped edge there needs it: those of another differ by polynomials, with which it would move.
    pub fn sources_of_inner_point_force(self, at: (f64, f64), side_that_waves_run_across: Side) -> Vec<SingularSource> {
        match self {
            Self::Isotropic(_) => vec![SingularSource::from_inner_point_force(at)],
            Self::Orthotropic(bending) => {
                let across = EdgeWaves::new(bending, side_that_waves_run_across);
                let wave =
                    |j: usize| LogWave { factor: across.amplitude_of_wave_from_point_force(j), root: across.roots[j] };
                [0, 1]
                    .map(|j| SingularSource {
                        centre: at,
                        side: side_that_waves_run_across,
                        terms: SingularTerms::Wave(wave(j)),
                    })
                    .to_vec()
            }
        }
    }

    /// What a free edge adds; the force is `distance_over_scale` from it, in units of `scale` (m), and its mirror image at `image`.
    pub fn image_sources_of_free_edge(
        self,
        side: Side,
        image: (f64, f64),
        distance_over_scale: f64,
        scale: f64,
    ) -> Vec<SingularSource> {
        match self {
            Self::Isotropic(poisson) => vec![image_source_of_free_edge(side, image, distance_over_scale, poisson)],
            Self::Orthotropic(bending) => {
                let across = EdgeWaves::new(bending, side);
                across.reflected_wave_sources(
                    across.free_edge_reflection_amplitudes_by_reflected_and_incident_wave(),
                    image,
                    distance_over_scale,
                    scale,
                )
            }
        }
    }

    /// Sources that make a clamped edge neither move nor turn.
    pub fn image_sources_of_clamped_edge(
        self,
        side: Side,
        image: (f64, f64),
        distance_over_scale: f64,
        scale: f64,
    ) -> Vec<SingularSource> {
        match self {
            Self::Isotropic(_) => vec![image_source_of_clamped_edge(side, image, distance_over_scale)],
            Self::Orthotropic(bending) => {
                let across = EdgeWaves::new(bending, side);
                across.reflected_wave_sources(
                    across.clamped_edge_reflection_amplitudes_by_reflected_and_incident_wave(),
                    image,
                    distance_over_scale,
                    scale,
                )
            }
        }
    }
}

/// A plate as an edge sees it.
struct EdgeWaves {
    side: Side,
    roots: [Complex64; 2],
    /// D_12 over D_n.
    poisson: f64,
}

impl EdgeWaves {
    fn new(bending: RelativeBending, side: Side) -> Self {
        let (normal, along) =
            if matches!(side, Side::Left | Side::Right) { (bending.x, bending.y) } else { (bending.y, bending.x) };
        let mixed = (bending.poisson + 0.5 * bending.twist) / (normal * along).sqrt();
        let mixed = if (mixed - 1.0).abs() < APART { 1.0 + APART.copysign(mixed - 1.0) } else { mixed };
        let half = Complex64::from(mixed * mixed - 1.0).sqrt();
        let ratio = (along / normal).sqrt();
        Self {
            side,
            roots: [mixed + half, mixed - half].map(|square| (square * ratio).sqrt()),
            poisson: bending.poisson / normal,
        }
    }

    /// The amplitude of a force's wave, with signs as of s^2 log s: 2 l_2 / (l_1^2 - l_2^2), and with 1 and 2 exchanged.
    fn amplitude_of_wave_from_point_force(&self, wave_index: usize) -> Complex64 {
        let (own, other) = (self.roots[wave_index], self.roots[1 - wave_index]);
        2.0 * other / (own * own - other * other)
    }

    /// Amplitudes that a free edge reflects, `[of the wave][for the wave that comes]`: neither moment, D_n w_nn - D_12 k^2 w, nor shear,
    /// D_n w_nnn - (D_12 + 4 D_66) k^2 w_n, whose coefficient of a wave is l_1 times the other's of the moment.
    fn free_edge_reflection_amplitudes_by_reflected_and_incident_wave(&self) -> [[Complex64; 2]; 2] {
        let [l1, l2] = self.roots;
        let [p1, p2] = [l1 * l1 - self.poisson, l2 * l2 - self.poisson];
        let (direct, whole) = (l2 * p1 * p1 + l1 * p2 * p2, l2 * p1 * p1 - l1 * p2 * p2);
        [[-direct / whole, -2.0 * l2 * p1 * p2 / whole], [2.0 * l1 * p1 * p2 / whole, direct / whole]]
    }

    /// Amplitudes that a clamped edge reflects: neither w nor w_n.
    fn clamped_edge_reflection_amplitudes_by_reflected_and_incident_wave(&self) -> [[Complex64; 2]; 2] {
        let [l1, l2] = self.roots;
        let (sum, whole) = (l1 + l2, l2 - l1);
        [[-sum / whole, -2.0 * l2 / whole], [2.0 * l1 / whole, sum / whole]]
    }

    /// What the edge reflects: a wave that came with l_j over the distance d and goes with l_m is singular where
    /// l_m n + l_j d + j t = 0, behind the edge.
    fn reflected_wave_sources(
        &self,
        reflected: [[Complex64; 2]; 2],
        image: (f64, f64),
        distance_over_scale: f64,
        scale: f64,
    ) -> Vec<SingularSource> {
        let mut out = Vec::new();
        for (m, row) in reflected.iter().enumerate() {
            for (j, amplitude) in row.iter().enumerate() {
                let (goes, came) = (self.roots[m], self.roots[j]);
                let n = -distance_over_scale * came.re / goes.re;
                let t = -(came.im * distance_over_scale + goes.im * n);
                // From the mirror image, which is at -d.
                let (deeper, aside) = ((n + distance_over_scale) * scale, t * scale);
                let (x, y) = image;
                let centre = match self.side {
                    Side::Left => (x + deeper, y + aside),
                    Side::Right => (x - deeper, y + aside),
                    Side::Top => (x + aside, y + deeper),
                    Side::Bottom => (x + aside, y - deeper),
                };
                let wave = LogWave { factor: amplitude * self.amplitude_of_wave_from_point_force(j), root: goes };
                out.push(SingularSource { centre, side: self.side, terms: SingularTerms::Wave(wave) });
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::super::singular::{FunctionEnd, FunctionReach, SingularFunction};
    use super::*;

    /// Conjugate roots, real ones, and nearly equal ones.
    const PLATES: [RelativeBending; 3] = [
        RelativeBending { x: 1.4, y: 0.7, poisson: 0.2, twist: 0.5 },
        RelativeBending { x: 0.5, y: 2.0, poisson: 0.3, twist: 3.9 },
        RelativeBending { x: 1.1, y: 0.9, poisson: 0.25, twist: 1.5 },
    ];

    fn function(sources: Vec<SingularSource>) -> SingularFunction {
        let open =
            FunctionReach { centre: 0.0, from: -10.0, to: 10.0, at_from: FunctionEnd::Open, at_to: FunctionEnd::Open };
        SingularFunction { x: open, y: open, sources, scale: 0.7, finest: f64::INFINITY }
    }

    /// Second derivatives along a line across the force are continuous, and smooth away from it.
    #[test]
    fn forces_are_smooth_beside_their_point() {
        for bending in PLATES {
            let f = function(
                PlateMedium::isotropic_or_orthotropic_from_bending(bending)
                    .sources_of_inner_point_force((0.1, 0.2), Side::Left),
            );
            let h = 1e-5;
            for (x, y) in [(0.1, 0.6), (0.1, -0.3), (0.4, 0.2), (-0.2, 0.5)] {
                let (before, after, here) =
                    (f.evaluate_jet_at(x - h, y), f.evaluate_jet_at(x + h, y), f.evaluate_jet_at(x, y));
                for (a, b, c) in
                    [(before.xx, after.xx, here.xx), (before.xy, after.xy, here.xy), (before.yy, after.yy, here.yy)]
                {
                    assert!((a - b).abs() < 1e-3 && (0.5 * (a + b) - c).abs() < 1e-7, "{a} {b} {c}");
                }
                assert!((here.x - (after.value - before.value) / (2.0 * h)).abs() < 1e-7);
                assert!((here.xx - (after.x - before.x) / (2.0 * h)).abs() < 1e-6);
                assert!((here.xy - (after.y - before.y) / (2.0 * h)).abs() < 1e-6);
            }
        }
    }

    /// D_11 w_xxxx + 2 H w_xxyy + D_22 w_yyyy = 0 but at the force, where its integral is 8 pi sqrt(D_11 D_22): the shear through a circle.
    #[test]
    fn forces_are_of_one() {
        for bending in &PLATES[..2] {
            let f = function(
                PlateMedium::isotropic_or_orthotropic_from_bending(*bending)
                    .sources_of_inner_point_force((0.0, 0.0), Side::Left),
            );
            let both = bending.poisson + 0.5 * bending.twist;
            let h = 1e-4;
            let shear = |x: f64, y: f64| {
                let (e, w, s, n) = (
                    f.evaluate_jet_at(x + h, y),
                    f.evaluate_jet_at(x - h, y),
                    f.evaluate_jet_at(x, y + h),
                    f.evaluate_jet_at(x, y - h),
                );
                let along_x = bending.x * (e.xx - w.xx) + both * (e.yy - w.yy);
                let along_y = bending.y * (s.yy - n.yy) + both * (s.xx - n.xx);
                [along_x / (2.0 * h), along_y / (2.0 * h)]
            };
            let through = |radius: f64| {
                let count = 720;
                let part = |k: i32| {
                    let angle = std::f64::consts::TAU * f64::from(k) / f64::from(count);
                    let [x, y] = shear(radius * angle.cos(), radius * angle.sin());
                    (x * angle.cos() + y * angle.sin()) * radius * std::f64::consts::TAU / f64::from(count)
                };
                (0..count).map(part).sum::<f64>()
            };
            // Distances are over the scale.
            let expected = 8.0 * std::f64::consts::PI * (bending.x * bending.y).sqrt() / f.scale.powi(2);
            for radius in [0.1, 0.5] {
                assert!((through(radius) / expected - 1.0).abs() < 1e-5, "{} {expected}", through(radius));
            }
        }
    }

    /// Neither moment nor shear on a free edge, neither motion nor slope on a clamped one, wherever the force is.
    #[test]
    fn half_planes_have_their_edges() {
        for bending in &PLATES[..2] {
            let medium = PlateMedium::isotropic_or_orthotropic_from_bending(*bending);
            for (side, flip) in [(Side::Left, 1.0), (Side::Right, -1.0), (Side::Top, 1.0), (Side::Bottom, -1.0)] {
                let across_x = matches!(side, Side::Left | Side::Right);
                let place = |n: f64, t: f64| if across_x { (flip * n, t) } else { (t, flip * n) };
                let (d, scale) = (0.21, 0.7);
                let edge = |images: Vec<SingularSource>| {
                    function([medium.sources_of_inner_point_force(place(d, 0.0), side), images].concat())
                };
                let free = edge(medium.image_sources_of_free_edge(side, place(-d, 0.0), d / scale, scale));
                let clamped = edge(medium.image_sources_of_clamped_edge(side, place(-d, 0.0), d / scale, scale));
                let normal = if across_x { bending.x } else { bending.y };
                let curvatures = |n: f64, t: f64| {
                    let (x, y) = place(n, t);
                    let jet = free.evaluate_jet_at(x, y);
                    if across_x { [jet.xx, jet.yy] } else { [jet.yy, jet.xx] }
                };
                // Up to polynomials: a constant moment, and no shear.
                let moment = |t: f64| {
                    let [nn, tt] = curvatures(0.0, t);
                    normal * nn + bending.poisson * tt
                };
                let shear = |t: f64| {
                    let sum = |n: f64| {
                        let [nn, tt] = curvatures(n, t);
                        normal * nn + (bending.poisson + bending.twist) * tt
                    };
                    let h = 1e-4;
                    (4.0 * sum(h) - sum(2.0 * h) - 3.0 * sum(0.0)) / (2.0 * h)
                };
                for t in [-0.5, -0.1, 0.05, 0.3, 0.9] {
                    assert!((moment(t) - moment(0.02)).abs() < 1e-10, "{side:?} {t}: {} {}", moment(t), moment(0.02));
                    assert!(shear(t).abs() < 1e-4, "{side:?} {t}: {}", shear(t));
                    let (x, y) = place(0.0, t);
                    let jet = clamped.evaluate_jet_at(x, y);
                    let slope = if across_x { jet.x } else { jet.y };
                    assert!(jet.value.abs() < 1e-12 && slope.abs() < 1e-12, "{side:?} {t}: {jet:?}");
                }
            }
        }
    }
}
