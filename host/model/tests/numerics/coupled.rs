//! Poles of plates whose dashpots couple their modes, against a Ritz model with Legendre polynomials: no mesh, no state matrix.
//!
//! With a dashpot c at each of some points, s is a pole where det(1 + s c G(s)) = 0, G the compliances between these points. Where all
//! poles swing on the way, each root is followed from its mode with the damping scaled up in small steps.

use era_model::model::{Accuracy, PanelMode, compute_modes_with_error_bounds};
use era_model::scene::Scene;
use nalgebra::{DMatrix, SymmetricEigen};
use num_complex::Complex64;
use std::f64::consts::TAU;

const MAX_HZ: f64 = 400.0;
const YOUNG_PA: f64 = 69e9;
const POISSON: f64 = 0.33;
const DENSITY_KG_M3: f64 = 2700.0;
const THICKNESS_M: f64 = 2e-3;
/// Polynomials along each side.
const DEGREES: u16 = 13;
/// Steps from a millionth of the damping to all of it.
const STEPS: i32 = 400;
/// What the Ritz model is off by at corner supports, relative to |s|.
const RITZ: f64 = 3e-6;

/// An aluminium plate on a spring of `stiffness` (N/m) and a dashpot (N s/m) at each corner.
struct Plate {
    sides_m: [f64; 2],
    sealed_depth_m: Option<f64>,
    stiffness: f64,
    dashpots: [f64; 4],
}

impl Plate {
    fn corner_places_m(&self) -> [[f64; 2]; 4] {
        let [a, b] = self.sides_m;
        [[0.0, 0.0], [a, 0.0], [0.0, b], [a, b]]
    }

    fn modes(&self) -> Vec<PanelMode> {
        let [a, b] = self.sides_m.map(|side| side * 1e3);
        let mut text = format!(
            "version = 1\nname = \"coupled\"\n[surface]\nkind = \"plate\"\nlength_mm = {a:?}\nwidth_mm = {b:?}\nthickness_mm = 2.0\n\
             [surface.material]\nyoungs_modulus_pa = {YOUNG_PA:e}\npoisson_ratio = {POISSON}\ndensity_kg_m3 = {DENSITY_KG_M3:?}\n"
        );
        if let Some(depth) = self.sealed_depth_m {
            text += &format!("[air]\nsealed_depth_mm = {:?}\n", depth * 1e3);
        }
        for ([x, y], dashpot) in self.corner_places_m().into_iter().zip(self.dashpots) {
            text += &format!(
                "[[support]]\nx_mm = {:?}\ny_mm = {:?}\nstiffness_n_per_m = {:?}\ndamping_n_s_per_m = {dashpot:?}\n",
                x * 1e3,
                y * 1e3,
                self.stiffness
            );
        }
        let scene = Scene::parse("coupled", &text).unwrap();
        compute_modes_with_error_bounds(&scene, Accuracy::BALANCED, MAX_HZ).unwrap().answer
    }

    fn ritz(&self) -> Ritz {
        let n = usize::from(DEGREES);
        let [along_x, along_y] = self.sides_m.map(slopes);
        let (bent_x, bent_y) = (&along_x * &along_x, &along_y * &along_y);
        let one = DMatrix::identity(n, n);
        let rigidity = YOUNG_PA * THICKNESS_M.powi(3) / (12.0 * (1.0 - POISSON * POISSON));
        let crossed = bent_x.kronecker(&bent_y.transpose());
        let twisted = (along_x.transpose() * &along_x).kronecker(&(along_y.transpose() * &along_y));
        let mut stiffness = rigidity
            * ((bent_x.transpose() * &bent_x).kronecker(&one)
                + one.kronecker(&(bent_y.transpose() * &bent_y))
                + POISSON * (&crossed + crossed.transpose())
                + 2.0 * (1.0 - POISSON) * twisted);
        let at_corners = DMatrix::from_columns(&self.corner_places_m().map(|[x, y]| {
            let values = |side, at| DMatrix::from_column_slice(n, 1, &polynomials(side, at));
            values(self.sides_m[0], x).kronecker(&values(self.sides_m[1], y)).column(0).into_owned()
        }));
        stiffness += self.stiffness * &at_corners * at_corners.transpose();
        if let Some(depth) = self.sealed_depth_m {
            // gamma p / volume times the square of the volume displaced: that of the constant function, sqrt(area).
            stiffness[(0, 0)] += 1.4 * 101_325.0 / depth;
        }
        let per_area = DENSITY_KG_M3 * THICKNESS_M;
        let solved = SymmetricEigen::new(stiffness / per_area);
        let mut order: Vec<usize> = (0..n * n).collect();
        order.sort_by(|a, b| solved.eigenvalues[*a].total_cmp(&solved.eigenvalues[*b]));
        let at_corners = solved.eigenvectors.transpose() * at_corners / per_area.sqrt();
        Ritz {
            lambda: order.iter().map(|i| solved.eigenvalues[*i]).collect(),
            at_corners: at_corners.select_rows(&order),
            dashpots: self.dashpots,
        }
    }
}

/// Legendre polynomials over 0 to `side`, of which the squares have the integral 1, at a place.
fn polynomials(side: f64, at: f64) -> Vec<f64> {
    let x = 2.0 * at / side - 1.0;
    let (mut before, mut now) = (0.0, 1.0);
    (0..DEGREES)
        .map(|k| {
            let k = f64::from(k);
            let value = now * ((2.0 * k + 1.0) / side).sqrt();
            (before, now) = (now, ((2.0 * k + 1.0) * x * now - k * before) / (k + 1.0));
            value
        })
        .collect()
}

/// Their slopes in terms of themselves, a column for each.
fn slopes(side: f64) -> DMatrix<f64> {
    let n = usize::from(DEGREES);
    let size = |k: usize| f64::from(u16::try_from(2 * k + 1).unwrap()).sqrt();
    DMatrix::from_fn(n, n, |k, m| if k < m && (m - k) % 2 == 1 { 2.0 / side * size(k) * size(m) } else { 0.0 })
}

struct Ritz {
    lambda: Vec<f64>,
    /// Mass-normalised shapes at the corners, a row for each mode.
    at_corners: DMatrix<f64>,
    dashpots: [f64; 4],
}

impl Ritz {
    /// The damping ratio that the mode would have if it did not couple with any other.
    fn uncoupled_damping_ratio(&self, mode: usize) -> f64 {
        let lost: f64 = self.dashpots.iter().enumerate().map(|(i, c)| c * self.at_corners[(mode, i)].powi(2)).sum();
        0.5 * lost / self.lambda[mode].sqrt()
    }

    /// Whether dashpots couple two modes: four equal ones those of one symmetry, which move the corners alike.
    fn are_coupled(&self, one: usize, other: usize) -> bool {
        let [one, other] = [one, other].map(|k| self.at_corners.row(k).normalize());
        self.dashpots.iter().any(|own| *own != self.dashpots[0]) || one.dot(&other).abs() > 0.5
    }

    /// det(1 + s t c G(s)) (s^2 + lambda) of one mode, in which that mode's own pole of G is no more.
    fn secular(&self, s: Complex64, part: f64, mode: usize) -> Complex64 {
        let others = self.lambda.iter().enumerate().filter(|(k, _)| *k != mode && self.are_coupled(mode, *k));
        let weights: Vec<(usize, Complex64)> = others.map(|(k, lambda)| (k, 1.0 / (s * s + lambda))).collect();
        let at = &self.at_corners;
        let scaled = |i: usize| part * self.dashpots[i] / (1.0 + part * self.dashpots[i]);
        let matrix = DMatrix::from_fn(4, 4, |i, j| {
            let compliance: Complex64 = weights.iter().map(|(k, own)| own * at[(*k, i)] * at[(*k, j)]).sum();
            let unit = if i == j { 1.0 / (1.0 + part * self.dashpots[i]) } else { 0.0 };
            unit + s * scaled(i) * compliance
        });
        let own = DMatrix::from_fn(4, 1, |i, _| s * scaled(i) * at[(mode, i)]);
        let determinant = matrix.determinant();
        let moved = matrix.lu().solve(&own).unwrap();
        let loss: Complex64 = (0..4).map(|i| moved[i] * at[(mode, i)]).sum();
        determinant * (s * s + self.lambda[mode] + loss)
    }

    /// The root next to `s`, by secants.
    fn root(&self, s: Complex64, part: f64, mode: usize) -> Complex64 {
        let (mut before, mut now) = (s * Complex64::new(1.0 + 1e-7, 1e-7), s);
        let (mut value_before, mut value) = (self.secular(before, part, mode), self.secular(now, part, mode));
        for _ in 0..12 {
            if value == value_before || (now - before).norm() < 1e-11 * now.norm() {
                break;
            }
            let next = now - value * (now - before) / (value - value_before);
            (before, value_before) = (now, value);
            (now, value) = (next, self.secular(next, part, mode));
        }
        now
    }

    /// What has become of a mode under all of the damping, as long as it swings.
    fn follow_mode(&self, mode: usize) -> Complex64 {
        let mut s = Complex64::new(0.0, self.lambda[mode].sqrt());
        for step in 0..=STEPS {
            let part = 10.0_f64.powf(6.0 * (f64::from(step) / f64::from(STEPS) - 1.0));
            s = self.root(s, part, mode);
        }
        s
    }
}

/// Compares all poles, which are told apart; by how many times the diagonal of the damping says more where that is a hundredth at least.
fn compare_poles_with_ritz(name: &str, plate: &Plate, expected: impl Fn(&Ritz, usize, &PanelMode) -> Complex64) -> f64 {
    let (modes, ritz) = (plate.modes(), plate.ritz());
    let (mut off, mut all) = (1.0_f64, Vec::<Complex64>::new());
    for (k, mode) in modes.iter().enumerate() {
        let frequency_hz = ritz.lambda[k].sqrt() / TAU;
        assert!((mode.frequency_hz / frequency_hz - 1.0).abs() < RITZ, "{name}: {mode:?} {frequency_hz}");
        let expected = expected(&ritz, k, mode);
        let said = || format!("{name}: mode {k}, {mode:?} {expected} {}", ritz.uncoupled_damping_ratio(k));
        assert!(mode.pole.slower.is_none(), "{}", said());
        let bound = mode.pole_bound.limit_if_known().unwrap_or_else(|| panic!("{}", said()));
        assert!(bound < 1e-3, "{}", said());
        assert!((mode.pole.s - expected).norm() < (bound + RITZ) * expected.norm(), "{}", said());
        let ratio = -expected.re / expected.norm();
        assert!((mode.damping_ratio - ratio).abs() < bound + RITZ, "{}", said());
        assert!(all.iter().all(|other| (other - expected).norm() > 1e-6 * expected.norm()), "{}", said());
        all.push(expected);
        if ritz.uncoupled_damping_ratio(k) > 0.01 {
            off = off.max(ritz.uncoupled_damping_ratio(k) / ratio);
        }
    }
    println!("{name}: {} modes, the diagonal says up to {off:.2} times as much", modes.len());
    off
}

/// 300 x 200 mm before sealed air: where the air makes two symmetric modes nearly one, the dashpots at the corners take one mixture of both and leave
/// the other one.
#[test]
fn before_sealed_air_dashpots_at_corners_leave_a_mode_alone() {
    let mut most = 0.0_f64;
    for (depth_mm, stiffness) in [(6.0, 2000.0), (8.5, 500.0), (9.0, 2000.0)] {
        let plate = Plate { sides_m: [0.3, 0.2], sealed_depth_m: Some(depth_mm * 1e-3), stiffness, dashpots: [4.0; 4] };
        most = most
            .max(compare_poles_with_ritz(&format!("{depth_mm} mm of air"), &plate, |ritz, k, _| ritz.follow_mode(k)));
    }
    assert!(most > 10.0, "{most}");
}

/// 300 x 299 mm: dashpots of 20 N s/m are more than its pairs of modes are apart by.
#[test]
fn on_a_nearly_square_plate_dashpots_mix_the_modes() {
    let mut most = 0.0_f64;
    for dashpots in [[20.0; 4], [20.0, 20.0, 20.0, 0.0], [20.0, 5.0, 8.0, 30.0], [0.0, 0.0, 0.0, 20.0]] {
        let plate = Plate { sides_m: [0.3, 0.299], sealed_depth_m: None, stiffness: 2000.0, dashpots };
        // Some meet on the real axis on their way and swing again: whichever mode has them, they are roots.
        let nearest = |ritz: &Ritz, k: usize, mode: &PanelMode| ritz.root(mode.pole.s, 1.0, k);
        most = most.max(compare_poles_with_ritz(&format!("{dashpots:?} N s/m"), &plate, nearest));
    }
    assert!(most > 2.5, "{most}");
}

/// Dashpots of 1e4 to 1e8 N s/m: what swings is what swings with the corners held, to 1 / c.
#[test]
fn heavy_dashpots_hold_their_points() {
    for dashpot in [1e4, 1e5, 1e6, 1e7, 1e8] {
        for sealed_depth_m in [None, Some(9e-3)] {
            let plate = Plate { sides_m: [0.3, 0.2], sealed_depth_m, stiffness: 2000.0, dashpots: [dashpot; 4] };
            // The dashpots in the way of rigid supports; 1e9 N/m are stiffer than the plate's corners by 1e4 and more.
            let held = Plate { stiffness: 1e9, dashpots: [0.0; 4], ..plate }.ritz();
            let (modes, ritz) = (plate.modes(), plate.ritz());
            let is_swinging = |mode: &PanelMode| mode.pole.slower.is_none() && mode.pole.s.im > 1.0;
            let swinging: Vec<(usize, &PanelMode)> =
                modes.iter().enumerate().filter(|(_, mode)| is_swinging(mode)).collect();
            assert!(swinging.len() >= 4, "{dashpot:e}: {modes:?}");
            for (k, mode) in &swinging {
                let said = || format!("{dashpot:e}, {sealed_depth_m:?}: {mode:?}");
                let hz = mode.pole.frequency_hz;
                let nearest = held
                    .lambda
                    .iter()
                    .map(|own| own.sqrt() / TAU)
                    .min_by(|a, b| (a - hz).abs().total_cmp(&(b - hz).abs()));
                let nearest = nearest.unwrap();
                assert!((nearest / hz - 1.0).abs() < 1e-3, "{}: {nearest}", said());
                assert!(mode.damping_ratio < 100.0 / dashpot, "{}", said());
                let Some(bound) = mode.pole_bound.limit_if_known() else { continue };
                let exact = ritz.root(mode.pole.s, 1.0, *k);
                assert!((mode.pole.s - exact).norm() < (bound + RITZ) * exact.norm(), "{}: {exact}", said());
            }
        }
    }
}
