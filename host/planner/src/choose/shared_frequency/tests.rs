//! Against exhaustive search, brute force over phasors and closed forms.

use super::optimum::{
    find_least_energy_for_unit_peak_if_no_limit_binds, maximise_peak_until_proven_no_better_than_known,
    minimise_energy_for_unit_peak_if_reachable_below_cost_limit,
};
use super::program::{Program, Units};
use super::unlimited::UnlimitedEfficiency;
use super::*;
use proptest::prelude::*;
use std::f64::consts::PI;

/// Numbers that look random: splitmix64.
pub(super) struct Random(pub(super) u64);

impl Random {
    #[expect(clippy::cast_precision_loss, reason = "53 bits fit")]
    pub(super) fn draw_fraction(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(super) fn draw_between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.draw_fraction()
    }
}

/// A [`TargetField`] with its numbers.
pub(super) struct Owned {
    pub(super) frequencies_hz: Vec<f64>,
    pub(super) actuators: usize,
    pub(super) gain: Vec<Phasors>,
    pub(super) energy: Vec<PerPair>,
    pub(super) max_force_n: Vec<[f64; 4]>,
    pub(super) travel: Vec<PerPair>,
    pub(super) max_travel_m: [f64; 4],
}

impl Owned {
    /// Zero everywhere, and no frequencies yet.
    pub(super) fn new(actuators: usize, count: usize, travel_m: f64) -> Self {
        Self {
            frequencies_hz: Vec::with_capacity(count),
            actuators,
            gain: vec![[ZERO; 4]; count],
            energy: vec![[[ZERO; 4]; 4]; count],
            max_force_n: vec![[0.0; 4]; count],
            travel: vec![[[ZERO; 4]; 4]; count],
            max_travel_m: [travel_m; 4],
        }
    }

    pub(super) fn borrow_target_field(&self) -> TargetField<'_> {
        TargetField {
            frequencies_hz: &self.frequencies_hz,
            actuators: self.actuators,
            gain: &self.gain,
            energy: &self.energy,
            max_force_n: &self.max_force_n,
            travel: &self.travel,
            max_travel_m: self.max_travel_m,
        }
    }
}

/// A panel of a few random modes with random actuators on it: gains, energies and travels hang together as they do on a
/// panel. `travel_m` sets how soon travel binds.
#[expect(clippy::cast_precision_loss, reason = "small counts")]
pub(super) fn make_random_panel_field(seed: u64, actuators: usize, count: usize, travel_m: f64) -> Owned {
    const POINTS: usize = 14;
    let random = &mut Random(seed);
    let modes = 3 + (random.draw_fraction() * 5.0) as usize;
    let own_hz: Vec<f64> = (0..modes).map(|_| random.draw_between(40.0, 500.0)).collect();
    let shape = |random: &mut Random| -> Vec<f64> { (0..modes).map(|_| random.draw_between(-2.0, 2.0)).collect() };
    let mounts: Vec<Vec<f64>> = (0..actuators).map(|_| shape(random)).collect();
    let points: Vec<Vec<f64>> = (0..=POINTS).map(|_| shape(random)).collect();
    let loss = random.draw_between(0.01, 0.1);
    let eras: Vec<(f64, f64)> =
        (0..actuators).map(|_| (random.draw_between(60.0, 250.0), random.draw_between(0.05, 0.2))).collect();
    let mut owned = Owned::new(actuators, count, travel_m);
    owned.frequencies_hz.extend((0..count).map(|k| 40.0 + 360.0 * k as f64 / count as f64));
    for k in 0..count {
        let f = owned.frequencies_hz[k];
        let omega = std::f64::consts::TAU * f;
        let era = |i: usize| {
            let ratio = f / eras[i].0;
            Complex64::new(1.0 - ratio * ratio, eras[i].1 * ratio).inv()
        };
        // Displacement per newton on a panel of 1 kg, the ERA passing on its spring's force.
        let moves = |from: usize, to: &[f64]| -> Complex64 {
            let mode = |r: usize| {
                let own = std::f64::consts::TAU * own_hz[r];
                Complex64::new(mounts[from][r] * to[r], 0.0)
                    / Complex64::new(own * own - omega * omega, loss * own * own)
            };
            (0..modes).map(mode).sum::<Complex64>() * era(from)
        };
        let all: Vec<Vec<Complex64>> =
            (0..actuators).map(|i| points.iter().map(|point| moves(i, point) * (-omega * omega)).collect()).collect();
        for i in 0..actuators {
            owned.gain[k][i] = all[i][POINTS];
            let own = era(i) / 5000.0;
            for j in 0..actuators {
                owned.energy[k][i][j] =
                    (0..POINTS).map(|p| all[i][p].conj() * all[j][p]).sum::<Complex64>() / POINTS as f64;
                owned.travel[k][i][j] = if i == j { own } else { moves(j, &mounts[i]) * era(i) * 0.2 };
            }
            owned.max_force_n[k][i] = (travel_m / own.norm()).min(0.3);
        }
    }
    owned
}

/// (energy, peak) of the best of all frequencies, each solved on its own.
pub(super) fn find_least_energy_and_peak_exhaustively(field: &TargetField<'_>, wanted: f64) -> (f64, f64) {
    let all: Vec<UnlimitedEfficiency> = (0..field.frequencies_hz.len())
        .map(|k| UnlimitedEfficiency::compute_efficiency_of_all_drivable_actuators(field, k))
        .collect();
    let efficiency = all.iter().map(|unlimited| unlimited.efficiency).fold(0.0, f64::max);
    let units = |peak: f64| Units { peak, energy: peak * peak / efficiency };
    let programs = |peak: f64| all.iter().enumerate().map(move |(k, own)| Program::new(field, own, k, units(peak)));
    let least = |peak: f64| {
        let optima = programs(peak).filter_map(|p| {
            find_least_energy_for_unit_peak_if_no_limit_binds(&p)
                .or_else(|| minimise_energy_for_unit_peak_if_reachable_below_cost_limit(&p, f64::INFINITY))
        });
        optima.map(|optimum| optimum.cost).reduce(f64::min).map(|cost| (cost * units(peak).energy, peak))
    };
    least(wanted).unwrap_or_else(|| {
        let most = programs(wanted).map(|p| -maximise_peak_until_proven_no_better_than_known(&p, f64::INFINITY).cost);
        least(wanted * most.fold(0.0, f64::max) * (1.0 - REACH_SLACK)).unwrap()
    })
}

/// What phasors do, from the field itself.
struct Figures {
    peak: f64,
    energy: f64,
    /// Part of its limit that the force has which is nearest to it, and the same of the travels.
    force: f64,
    travel: f64,
}

impl Figures {
    fn compute_from_phasors(field: &TargetField<'_>, k: usize, u: &Phasors) -> Self {
        let sum = |row: &Phasors| row.iter().zip(u).map(|(entry, u)| entry * u).sum::<Complex64>();
        let forces =
            (0..field.actuators).map(|i| if u[i] == ZERO { 0.0 } else { u[i].norm() / field.max_force_n[k][i] });
        let travels = (0..field.actuators).map(|i| sum(&field.travel[k][i]).norm() / field.max_travel_m[i]);
        Self {
            peak: sum(&field.gain[k]).norm(),
            energy: field.energy[k].iter().zip(u).map(|(row, u)| (u.conj() * sum(row)).re).sum(),
            force: forces.fold(0.0, f64::max),
            travel: travels.fold(0.0, f64::max),
        }
    }
}

/// Checks limits, energy and peak of a result; returns what the energy's rounding is relative to: the energy that the same
/// forces would have one by one, over that which they have together.
pub(super) fn check_phasors_and_get_cancellation_ratio(field: &TargetField<'_>, found: &BestPhasors) -> f64 {
    let (k, u) = (found.frequency, &found.forces_n);
    let Figures { peak, energy, force, travel } = Figures::compute_from_phasors(field, k, u);
    let apart: f64 = (0..4).map(|i| field.energy[k][i][i].re * u[i].norm_sqr()).sum();
    assert!(force.max(travel) <= 1.0 + 1e-11, "{force} {travel} {found:?}");
    assert!((energy / found.energy - 1.0).abs() < 1e-12 + 1e-14 * apart / energy, "{energy} {found:?}");
    assert!((peak / found.reached - 1.0).abs() < 1e-11, "{peak} {found:?}");
    apart / energy
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    /// From "no limit binds" to "beyond reach".
    #[test]
    fn equals_exhaustive_search(
        seed in any::<u64>(),
        size in prop::sample::select(vec![(1_usize, 12_usize), (2, 30), (3, 40), (4, 40)]),
        part in prop::sample::select(vec![0.01, 0.3, 0.6, 0.8, 0.95, 0.999, 1.0, 2.0]),
        travel_m in prop::sample::select(vec![1e-3, 1e-4, 3e-5]),
    ) {
        let (actuators, count) = size;
        let owned = make_random_panel_field(seed, actuators, count, travel_m);
        let field = owned.borrow_target_field();
        let most = find_least_energy_or_largest_peak_phasors(&field, f64::INFINITY).unwrap().reached;
        let found = find_least_energy_or_largest_peak_phasors(&field, part * most).unwrap();
        let cancelled = check_phasors_and_get_cancellation_ratio(&field, &found);
        let (energy, peak) = find_least_energy_and_peak_exhaustively(&field, part * most);
        let tolerance = if part < 1.0 { 1e-9 + 1e-13 * cancelled } else { 1e-5 };
        prop_assert!((found.reached / peak - 1.0).abs() < 1e-9, "peak {} of {peak}", found.reached);
        prop_assert!((found.energy / energy - 1.0).abs() < tolerance, "energy {} of {energy}", found.energy);
        prop_assert!(found.proven_gap < if part < 1.0 { 1e-9 } else { 1e-6 }, "{found:?}");
    }
}

/// Two actuators at one frequency: no ratio of forces and no phase between them is better, on grids that close in on the
/// best, without the dual variables that the search relies on.
#[test]
fn no_phasors_are_better() {
    const STEPS: i32 = 20;
    let (mut by_force, mut by_travel) = (0, 0);
    for seed in 0..20 {
        let owned = make_random_panel_field(seed, 2, 1, 3e-5);
        let field = owned.borrow_target_field();
        let most = find_least_energy_or_largest_peak_phasors(&field, f64::INFINITY).unwrap().reached;
        for part in [0.5, 0.9, 2.0] {
            let wanted = part * most;
            let cost = |ratio: f64, phase: f64| {
                let [first, second, ..] = field.max_force_n[0];
                let u = [(first * ratio.cos()).into(), Complex64::from_polar(second * ratio.sin(), phase), ZERO, ZERO];
                let Figures { peak, energy, force, travel } = Figures::compute_from_phasors(&field, 0, &u);
                match wanted / peak {
                    _ if part > 1.0 => -peak / force.max(travel),
                    scale if scale * force.max(travel) <= 1.0 => energy * scale * scale,
                    _ => f64::INFINITY,
                }
            };
            let ((mut ratio, mut phase), mut span, mut least) = ((0.25, 1.0), 1.0, f64::INFINITY);
            for _ in 0..8 {
                let grid = (-STEPS..=STEPS).flat_map(|i| (-STEPS..=STEPS).map(move |j| (i, j)));
                let at = |(i, j): (i32, i32)| {
                    let along = |steps: i32| span * f64::from(steps) / f64::from(STEPS);
                    (ratio + 0.25 * along(i), phase + along(j))
                };
                let all = grid.map(at).map(|(ratio, phase)| (cost(ratio * PI, phase * PI), (ratio, phase)));
                (least, (ratio, phase)) = all.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
                span *= 0.3;
            }
            let found = find_least_energy_or_largest_peak_phasors(&field, wanted).unwrap();
            let own = if part > 1.0 { -found.reached } else { found.energy };
            assert!(own <= least + 1e-8 * own.abs(), "{least} {found:?}");
            assert!(least <= own + 0.01 * own.abs(), "grids too coarse: {least} {found:?}");
            let Figures { force, travel, .. } = Figures::compute_from_phasors(&field, 0, &found.forces_n);
            by_force += u32::from(force > 1.0 - 1e-6);
            by_travel += u32::from(travel > 1.0 - 1e-6);
        }
    }
    assert!(by_force > 5 && by_travel > 5, "{by_force} {by_travel}");
}

/// Two actuators at one frequency, with E inverted by hand.
#[test]
fn without_limits_the_closed_form() {
    let mut owned = make_random_panel_field(3, 2, 1, 1e-4);
    owned.max_force_n[0] = [1e6; 4];
    owned.max_travel_m = [f64::INFINITY; 4];
    let found = find_least_energy_or_largest_peak_phasors(&owned.borrow_target_field(), 2.0).unwrap();
    let (e, h) = (&owned.energy[0], &owned.gain[0]);
    let determinant = e[0][0].re * e[1][1].re - e[0][1].norm_sqr();
    let score = (h[0].norm_sqr() * e[1][1].re + h[1].norm_sqr() * e[0][0].re - 2.0 * (h[0] * e[0][1] * h[1].conj()).re)
        / determinant;
    assert!((found.energy * score / 4.0 - 1.0).abs() < 1e-9, "{} {score}", found.energy);
    assert!((found.reached - 2.0).abs() < 1e-12 && found.solved == 0);
}

#[test]
fn what_cannot_be_driven_stays_at_rest() {
    let mut owned = make_random_panel_field(4, 2, 6, 1e-4);
    for force in &mut owned.max_force_n {
        force[1] = 0.0;
    }
    let found = find_least_energy_or_largest_peak_phasors(&owned.borrow_target_field(), 0.1).unwrap();
    check_phasors_and_get_cancellation_ratio(&owned.borrow_target_field(), &found);
    assert_eq!(found.forces_n[1], ZERO);
    let nothing = find_least_energy_or_largest_peak_phasors(&owned.borrow_target_field(), 0.0).unwrap();
    assert_eq!((nothing.energy, nothing.reached), (0.0, 0.0));
    owned.max_force_n.fill([0.0; 4]);
    assert_eq!(find_least_energy_or_largest_peak_phasors(&owned.borrow_target_field(), 1.0), None);
    owned.travel.pop();
    assert_eq!(find_least_energy_or_largest_peak_phasors(&owned.borrow_target_field(), 1.0), None);
}
