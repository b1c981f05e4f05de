//! Against exhaustive search, random feasible points and closed forms.

use super::leaf::{least_energy, most_peak};
use super::program::{Choice, Program, Units};
use super::scores::Scores;
use super::*;
use proptest::prelude::*;

/// Numbers that look random: splitmix64.
pub(super) struct Random(pub(super) u64);

impl Random {
    #[expect(clippy::cast_precision_loss, reason = "53 bits fit")]
    pub(super) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// A [`Field`] with its numbers.
pub(super) struct Owned {
    pub(super) frequencies_hz: Vec<f64>,
    pub(super) actuators: usize,
    pub(super) gain: Vec<PerActuator>,
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

    pub(super) fn field(&self) -> Field<'_> {
        Field {
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
pub(super) fn panel(seed: u64, actuators: usize, count: usize, travel_m: f64) -> Owned {
    const POINTS: usize = 14;
    let random = &mut Random(seed);
    let modes = 3 + (random.unit() * 5.0) as usize;
    let own_hz: Vec<f64> = (0..modes).map(|_| random.between(40.0, 500.0)).collect();
    let shape = |random: &mut Random| -> Vec<f64> { (0..modes).map(|_| random.between(-2.0, 2.0)).collect() };
    let mounts: Vec<Vec<f64>> = (0..actuators).map(|_| shape(random)).collect();
    let points: Vec<Vec<f64>> = (0..=POINTS).map(|_| shape(random)).collect();
    let loss = random.between(0.01, 0.1);
    let eras: Vec<(f64, f64)> =
        (0..actuators).map(|_| (random.between(60.0, 250.0), random.between(0.05, 0.2))).collect();
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

/// All spaced choices of groups, all groupings (or the whole set only).
fn all_choices(field: &Field<'_>, grouping: Grouping, spacing_hz: f64) -> Vec<Vec<Choice>> {
    fn extend(
        field: &Field<'_>,
        left: u8,
        spacing_hz: f64,
        whole: bool,
        so_far: &mut Vec<Choice>,
        all: &mut Vec<Vec<Choice>>,
    ) {
        if left == 0 {
            all.push(so_far.clone());
            return;
        }
        let lowest = left & left.wrapping_neg();
        let groups = (1..=left).filter(|group| group & left == *group && group & lowest != 0);
        for group in groups.filter(|group| !whole || *group == left) {
            for k in 0..field.frequencies_hz.len() {
                let apart = |other: &Choice| {
                    (field.frequencies_hz[other.1] - field.frequencies_hz[k]).abs() >= spacing_hz - 1e-9
                };
                if so_far.iter().all(apart) {
                    so_far.push((group, k));
                    extend(field, left & !group, spacing_hz, whole, so_far, all);
                    so_far.pop();
                }
            }
        }
    }
    let mut all = Vec::new();
    let everyone = (1_u8 << field.actuators) - 1;
    extend(field, everyone, spacing_hz, grouping == Grouping::Shared, &mut Vec::new(), &mut all);
    all
}

/// (energy, peak) of the best of all choices, each solved on its own.
pub(super) fn exhaustive(field: &Field<'_>, grouping: Grouping, wanted: f64, spacing_hz: f64) -> (f64, f64) {
    let scores = Scores::new(field, true);
    let all = all_choices(field, grouping, spacing_hz);
    let units = |peak: f64| Units { peak, energy: peak * peak / scores.of.iter().flatten().fold(0.0, |a, b| b.max(a)) };
    let least = |peak: f64| {
        let costs = all
            .iter()
            .filter_map(|choices| least_energy(&Program::new(field, &scores, choices, units(peak)), f64::INFINITY));
        costs.map(|leaf| leaf.cost).reduce(f64::min).map(|cost| (cost * units(peak).energy, peak))
    };
    least(wanted).unwrap_or_else(|| {
        let most = all.iter().map(|choices| -most_peak(&Program::new(field, &scores, choices, units(wanted))).cost);
        least(wanted * most.fold(0.0, f64::max) * (1.0 - REACH_SLACK)).unwrap()
    })
}

/// Checks limits, energy and peak of a result from the field itself; returns what the energy's rounding is relative to: the
/// energy that the same forces would have one by one, over that which they have together.
pub(super) fn check(field: &Field<'_>, found: &Found, spacing_hz: f64) -> f64 {
    let (mut energy, mut peak, mut seen, mut apart) = (0.0, 0.0, 0, 0.0);
    let mut travel = [0.0; 4];
    for group in &found.groups {
        assert_eq!(seen & group.members, 0);
        seen |= group.members;
        let (u, k) = (&group.forces_n, group.frequency);
        for i in 0..4 {
            assert!(group.members >> i & 1 == 1 || u[i] == ZERO);
            assert!(u[i].norm() <= field.max_force_n[k][i] * (1.0 + 1e-11));
            let moved = (0..4).map(|j| field.travel[k][i][j] * u[j]).sum::<Complex64>();
            travel[i] += moved.norm();
            apart += field.energy[k][i][i].re * u[i].norm_sqr();
            for j in 0..4 {
                energy += (u[i].conj() * field.energy[k][i][j] * u[j]).re;
            }
        }
        peak += (0..4).map(|i| field.gain[k][i] * u[i]).sum::<Complex64>().norm();
        for other in &found.groups {
            let distance = (field.frequencies_hz[k] - field.frequencies_hz[other.frequency]).abs();
            assert!(other.members == group.members || distance >= spacing_hz - 1e-9);
        }
    }
    assert_eq!(seen, (1 << field.actuators) - 1);
    assert!((0..field.actuators).all(|i| travel[i] <= field.max_travel_m[i] * (1.0 + 1e-11)), "{travel:?}");
    assert!((energy / found.energy - 1.0).abs() < 1e-12 + 1e-14 * apart / energy, "{energy} {found:?}");
    assert!((peak / found.reached - 1.0).abs() < 1e-11, "{peak} {found:?}");
    apart / energy
}

/// Most peak of all choices, and least energy per peak squared.
fn scale(field: &Field<'_>, grouping: Grouping, spacing_hz: f64) -> (f64, f64) {
    let most = best(field, grouping, f64::INFINITY, spacing_hz).unwrap().reached;
    (most, best(field, grouping, 1e-9 * most, spacing_hz).unwrap().energy / (1e-9 * most).powi(2))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// From "no limit binds" to "beyond reach", both groupings.
    #[test]
    fn equals_exhaustive_search(
        seed in any::<u64>(),
        size in prop::sample::select(vec![(1_usize, 12_usize), (2, 30), (3, 8), (4, 5)]),
        part in prop::sample::select(vec![0.01, 0.3, 0.6, 0.8, 0.95, 0.999, 1.0, 2.0]),
        travel_m in prop::sample::select(vec![1e-3, 1e-4, 3e-5]),
        shared in any::<bool>(),
    ) {
        let (actuators, count) = size;
        let owned = panel(seed, actuators, count, travel_m);
        let (field, spacing_hz) = (owned.field(), 70.0);
        let grouping = if shared { Grouping::Shared } else { Grouping::Mixed };
        let (most, _) = scale(&field, grouping, spacing_hz);
        let found = best(&field, grouping, part * most, spacing_hz).unwrap();
        let cancelled = check(&field, &found, spacing_hz);
        let (energy, peak) = exhaustive(&field, grouping, part * most, spacing_hz);
        let tolerance = if part < 1.0 { 1e-9 + 1e-13 * cancelled } else { 1e-5 };
        prop_assert!((found.reached / peak - 1.0).abs() < 1e-9, "peak {} of {peak}", found.reached);
        prop_assert!((found.energy / energy - 1.0).abs() < tolerance, "energy {} of {energy}", found.energy);
        prop_assert!(found.proven_gap < if part < 1.0 { 1e-9 } else { 1e-6 }, "{found:?}");
    }
}

/// Two actuators at one frequency, with E inverted by hand.
#[test]
fn without_limits_the_closed_form() {
    let mut owned = panel(3, 2, 1, 1e-4);
    owned.max_force_n[0] = [1e6; 4];
    owned.max_travel_m = [f64::INFINITY; 4];
    let found = best(&owned.field(), Grouping::Shared, 2.0, 20.0).unwrap();
    let (e, h) = (&owned.energy[0], &owned.gain[0]);
    let determinant = e[0][0].re * e[1][1].re - e[0][1].norm_sqr();
    let score = (h[0].norm_sqr() * e[1][1].re + h[1].norm_sqr() * e[0][0].re - 2.0 * (h[0] * e[0][1] * h[1].conj()).re)
        / determinant;
    assert!((found.energy * score / 4.0 - 1.0).abs() < 1e-9, "{} {score}", found.energy);
    assert!((found.reached - 2.0).abs() < 1e-12 && found.solved == 0);
}

#[test]
fn what_cannot_be_driven_stays_at_rest() {
    let mut owned = panel(4, 2, 6, 1e-4);
    for force in &mut owned.max_force_n {
        force[1] = 0.0;
    }
    for grouping in [Grouping::Shared, Grouping::Mixed] {
        let found = best(&owned.field(), grouping, 0.1, 20.0).unwrap();
        check(&owned.field(), &found, 20.0);
        assert!(found.groups.iter().all(|group| group.forces_n[1] == ZERO));
    }
    let nothing = best(&owned.field(), Grouping::Mixed, 0.0, 20.0).unwrap();
    assert_eq!((nothing.energy, nothing.reached), (0.0, 0.0));
    owned.max_force_n.fill([0.0; 4]);
    assert_eq!(best(&owned.field(), Grouping::Mixed, 1.0, 20.0), None);
    owned.travel.pop();
    assert_eq!(best(&owned.field(), Grouping::Mixed, 1.0, 20.0), None);
}
