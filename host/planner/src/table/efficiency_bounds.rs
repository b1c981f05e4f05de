//! Bounds on the efficiency of every actuator at every frequency, computed from few figures per entry, so that most
//! candidates can be excluded before their energies are computed.

use super::{Entry, SINGLE_PRECISION_ERROR};
use crate::TARGET_RADIUS_M;
use crate::scene::{Scene, SurfaceKind};
use era_model::kernel;
use pulp::Arch;

/// For every actuator at every frequency a lower bound on the mean square elsewhere, as a function of the magnitude h
/// at the target: base - slope h - square h^2, but at least `least`; in (m/s^2/N)^2.
#[derive(Clone, Debug, Default)]
pub struct EfficiencyBounds {
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

impl EfficiencyBounds {
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
        let part = (disc / scene.surface_area_less_cutouts_ignoring_bar_steps_m2()).min(0.9);
        let rest = 1.0 - part;
        let quiet = |entry: &Entry| {
            entry.widths[0].harmonics.min(entry.widest_pulse_if_noticeably_stronger_else_quiet().harmonics)
        };
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

    /// Upper bound on the efficiency of each candidate, h^2 over the bound on the energy; 0 without a response.
    #[must_use]
    pub fn bound_target_to_elsewhere_energy_ratio_of_each_candidate(&self, squared_accelerations: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; squared_accelerations.len()];
        Arch::new().dispatch(Efficiencies(self, squared_accelerations, &mut out));
        out
    }

    /// Tighter bounds where the mean squares `near_mean_squares` the target are known in single precision, over a zone that covers
    /// the fraction `zone_fraction` of the surface: for the candidates marked in `likely`; 0 for all others.
    #[must_use]
    pub fn sharper_target_to_elsewhere_ratio_bounds_of_likely_or_0(
        &self,
        squared_accelerations: &[f64],
        near_mean_squares: &[f64],
        zone_fraction: f64,
        likely: &[bool],
    ) -> Vec<f64> {
        let mut out = vec![0.0; squared_accelerations.len()];
        let known = squared_accelerations.iter().zip(near_mean_squares).zip(likely);
        let figures = self.whole.iter().zip(&self.harmonics).zip(&self.max_force_n);
        for ((out, ((square, near_mean_squares), likely)), ((whole, harmonics), force)) in
            out.iter_mut().zip(known).zip(figures)
        {
            if *likely && *force > 0.0 {
                let all = whole - harmonics;
                let rest =
                    (all - zone_fraction * near_mean_squares * (1.0 + SINGLE_PRECISION_ERROR)) / (1.0 - zone_fraction);
                *out = square / (rest.max(1e-9 * all) + harmonics).max(f64::MIN_POSITIVE);
            }
        }
        out
    }

    /// Upper bound in m/s^2 on the peak that all actuators together reach at the point with these squared gains, each
    /// at its best frequency.
    #[must_use]
    pub fn bound_summed_peak_at_best_frequencies_m_per_s2(
        &self,
        squared_accelerations: &[f64],
        actuator_count: usize,
        frequency_count: usize,
    ) -> f64 {
        let own = |actuator: usize| {
            let range = actuator * frequency_count..(actuator + 1) * frequency_count;
            let pairs = squared_accelerations[range.clone()].iter().zip(&self.max_force_n[range]);
            pairs.map(|(square, force)| square * force * force).fold(0.0, f64::max).sqrt()
        };
        (0..actuator_count).map(own).sum()
    }

    /// The peak in m/s^2 that each candidate reaches alone.
    #[must_use]
    pub fn max_peak_of_each_candidate_alone_m_per_s2(&self, squared_accelerations: &[f64]) -> Vec<f64> {
        squared_accelerations.iter().zip(&self.max_force_n).map(|(square, force)| square.sqrt() * force).collect()
    }

    /// Upper bound on the contribution of each candidate to the Lagrangian at the target's dual variable lambda, its
    /// `price_of_target_acceleration`: max over 0 <= u <= U of lambda h u - E u^2, with the lower bound on E that `efficiencies` follow from.
    #[must_use]
    pub fn bound_lagrangian_term_of_each_candidate(
        &self,
        squared_accelerations: &[f64],
        efficiencies: &[f64],
        price_of_target_acceleration: f64,
    ) -> Vec<f64> {
        let mut out = vec![0.0; squared_accelerations.len()];
        Arch::new().dispatch(LagrangianTerms(
            self,
            squared_accelerations,
            efficiencies,
            price_of_target_acceleration,
            &mut out,
        ));
        out
    }
}

kernel!(Efficiencies<'a>(rough: &'a EfficiencyBounds, squares: &'a [f64], out: &'a mut [f64]) -> () = fill_target_to_elsewhere_energy_ratio_bounds);

#[inline(always)]
fn fill_target_to_elsewhere_energy_ratio_bounds(
    rough: &EfficiencyBounds,
    squared_accelerations: &[f64],
    out: &mut [f64],
) {
    let ends = rough.least.iter().zip(&rough.whole);
    let bounds = rough.base.iter().zip(&rough.slope).zip(ends.zip(&rough.max_force_n));
    for ((out, square), ((base, slope), ((least, whole), force))) in
        out.iter_mut().zip(squared_accelerations).zip(bounds)
    {
        let energy = (base - slope * square.sqrt() - rough.square * square).max(*least).min(*whole);
        *out = if *force > 0.0 { square / energy } else { 0.0 };
    }
}

kernel!(LagrangianTerms<'a>(rough: &'a EfficiencyBounds, squares: &'a [f64], efficiencies: &'a [f64], price_of_target_acceleration: f64, out: &'a mut [f64]) -> () = fill_lagrangian_term_bounds);

#[inline(always)]
fn fill_lagrangian_term_bounds(
    rough: &EfficiencyBounds,
    squared_accelerations: &[f64],
    efficiencies: &[f64],
    price_of_target_acceleration: f64,
    out: &mut [f64],
) {
    let lambda = price_of_target_acceleration;
    let known = squared_accelerations.iter().zip(efficiencies).zip(&rough.max_force_n);
    for (out, ((square, efficiency), force)) in out.iter_mut().zip(known) {
        // With e = h^2 / E: free lambda^2 e / 4 at u = lambda e / 2h; at the limit lambda h U - h^2 U^2 / e.
        let reach = square.sqrt() * force;
        let is_limited = 0.5 * lambda * efficiency > reach;
        let limited = lambda * reach - reach * reach / efficiency;
        *out = if is_limited { limited } else { 0.25 * lambda * lambda * efficiency };
    }
}
