//! Figures of the entries in the order in which a touch asks for them, for bounds.

use super::{Entry, SINGLE};
use crate::TARGET_RADIUS_M;
use crate::scene::{Scene, SurfaceKind};
use era_model::kernel;
use pulp::Arch;

/// Of every actuator at every frequency, actuator by actuator: a lower bound of the mean square elsewhere, in terms of the
/// magnitude h at the target, base - slope h - square h^2, but `least` in any case; in (m/s^2/N)^2.
#[derive(Clone, Debug, Default)]
pub struct Rough {
    base: Vec<f64>,
    slope: Vec<f64>,
    square: f64,
    least: Vec<f64>,
    /// What it is where the zone takes nothing: no bound is above it.
    whole: Vec<f64>,
    /// Harmonics' part of it, of the quieter pulse width.
    harmonics: Vec<f64>,
    /// Most force in N, of any pulse width; 0 where there is no response.
    max_force_n: Vec<f64>,
}

impl Rough {
    /// At a distance r from the target the magnitude is at most h + g r, g the steepest slope on the surface, so that its
    /// mean square within R is at most h^2 + 4/3 h g R + g^2 R^2 / 2 on a plate, and on a bar h^2 + h g R + g^2 R^2 / 3,
    /// which is less. Nor is it more than the largest on the surface. With the part of the surface that a whole disc takes; for
    /// one that an edge cuts, which takes any part from nothing to that, the least is at one end or the other.
    #[must_use]
    pub fn new(scene: &Scene, entries: &[Vec<Option<Entry>>]) -> Self {
        let surface = &scene.surface;
        let disc = match surface.kind {
            SurfaceKind::Plate => std::f64::consts::PI * TARGET_RADIUS_M * TARGET_RADIUS_M,
            SurfaceKind::Bar => 2.0 * TARGET_RADIUS_M * surface.width_m,
        };
        let part = (disc / scene.surface_area_m2()).min(0.9);
        let rest = 1.0 - part;
        let quiet = |entry: &Entry| entry.widths[0].harmonics.min(entry.strong().harmonics);
        let all = |of: &dyn Fn(&Entry) -> f64| -> Vec<f64> {
            entries.iter().flatten().map(|entry| entry.as_ref().map_or(0.0, of)).collect()
        };
        let run = |entry: &Entry| entry.steepest * TARGET_RADIUS_M;
        // Across a cut-out the magnitude may jump, which no slope tells.
        let known = if scene.cutouts.is_empty() { 0.0 } else { f64::NEG_INFINITY };
        Self {
            base: all(&|entry| known + (entry.mean_square - part * 0.5 * run(entry).powi(2)) / rest + quiet(entry)),
            slope: all(&|entry| part / rest * 4.0 / 3.0 * run(entry)),
            square: part / rest,
            least: all(&|entry| {
                let least = (entry.mean_square - part * entry.most_square) / rest;
                (least.max(1e-9 * entry.mean_square) + quiet(entry)).max(f64::MIN_POSITIVE)
            }),
            whole: all(&|entry| entry.mean_square + quiet(entry)),
            harmonics: all(&quiet),
            max_force_n: all(&|entry| entry.max_force_n),
        }
    }

    /// How efficient each is at most: h^2 over the bound; 0 without a response.
    #[must_use]
    pub fn efficiencies(&self, squares: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; squares.len()];
        Arch::new().dispatch(Efficiencies(self, squares, &mut out));
        out
    }

    /// The same where the mean squares `near` the target are known to single precision, over a zone that takes `part` of the
    /// surface: for the few that are `likely`, 0 for all others.
    #[must_use]
    pub fn sharper(&self, squares: &[f64], near: &[f64], part: f64, likely: &[bool]) -> Vec<f64> {
        let mut out = vec![0.0; squares.len()];
        let known = squares.iter().zip(near).zip(likely);
        let figures = self.whole.iter().zip(&self.harmonics).zip(&self.max_force_n);
        for ((out, ((square, near), likely)), ((whole, harmonics), force)) in out.iter_mut().zip(known).zip(figures) {
            if *likely && *force > 0.0 {
                let all = whole - harmonics;
                let rest = (all - part * near * (1.0 + SINGLE)) / (1.0 - part);
                *out = square / (rest.max(1e-9 * all) + harmonics).max(f64::MIN_POSITIVE);
            }
        }
        out
    }

    /// Most that all actuators together reach at the point with these squared gains, each at its best frequency, in m/s^2.
    #[must_use]
    pub fn most_reach(&self, squares: &[f64], actuators: usize, frequencies: usize) -> f64 {
        let own = |actuator: usize| {
            let range = actuator * frequencies..(actuator + 1) * frequencies;
            let pairs = squares[range.clone()].iter().zip(&self.max_force_n[range]);
            pairs.map(|(square, force)| square * force * force).fold(0.0, f64::max).sqrt()
        };
        (0..actuators).map(own).sum()
    }

    /// What each reaches, in m/s^2.
    #[must_use]
    pub fn reaches(&self, squares: &[f64]) -> Vec<f64> {
        squares.iter().zip(&self.max_force_n).map(|(square, force)| square.sqrt() * force).collect()
    }

    /// The most that each can earn at the dual variable `lambda` of the target: max over 0 <= u <= U of lambda h u - E u^2, with
    /// the lower bound for E, of which `efficiencies` are made.
    #[must_use]
    pub fn earnings(&self, squares: &[f64], efficiencies: &[f64], lambda: f64) -> Vec<f64> {
        let mut out = vec![0.0; squares.len()];
        Arch::new().dispatch(Earnings(self, squares, efficiencies, lambda, &mut out));
        out
    }
}

kernel!(Efficiencies<'a>(rough: &'a Rough, squares: &'a [f64], out: &'a mut [f64]) -> () = efficiencies);

#[inline(always)]
fn efficiencies(rough: &Rough, squares: &[f64], out: &mut [f64]) {
    let ends = rough.least.iter().zip(&rough.whole);
    let bounds = rough.base.iter().zip(&rough.slope).zip(ends.zip(&rough.max_force_n));
    for ((out, square), ((base, slope), ((least, whole), force))) in out.iter_mut().zip(squares).zip(bounds) {
        let energy = (base - slope * square.sqrt() - rough.square * square).max(*least).min(*whole);
        *out = if *force > 0.0 { square / energy } else { 0.0 };
    }
}

kernel!(Earnings<'a>(rough: &'a Rough, squares: &'a [f64], efficiencies: &'a [f64], lambda: f64, out: &'a mut [f64]) -> () = earnings);

#[inline(always)]
fn earnings(rough: &Rough, squares: &[f64], efficiencies: &[f64], lambda: f64, out: &mut [f64]) {
    let known = squares.iter().zip(efficiencies).zip(&rough.max_force_n);
    for (out, ((square, efficiency), force)) in out.iter_mut().zip(known) {
        // With e = h^2 / E: free lambda^2 e / 4 at u = lambda e / 2h; at the limit lambda h U - h^2 U^2 / e.
        let reach = square.sqrt() * force;
        let is_limited = 0.5 * lambda * efficiency > reach;
        let limited = lambda * reach - reach * reach / efficiency;
        *out = if is_limited { limited } else { 0.25 * lambda * lambda * efficiency };
    }
}
