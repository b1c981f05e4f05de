//! Closed equations, solved here by bisection.

use std::f64::consts::{PI, TAU};

/// A sign change of `f` in an interval.
pub fn root(f: impl Fn(f64) -> f64, mut from: f64, mut to: f64) -> f64 {
    let sign = f(from) > 0.0;
    assert_ne!(sign, f(to) > 0.0, "no sign change from {from} to {to}");
    for _ in 0..200 {
        let middle = 0.5 * (from + to);
        if (f(middle) > 0.0) == sign { from = middle } else { to = middle }
    }
    0.5 * (from + to)
}

/// The first `count` sign changes of `f`, which has no poles, on a fine grid from `from` to a hundred times that.
pub fn roots(f: impl Fn(f64) -> f64, from: f64, step: f64, count: usize) -> Vec<f64> {
    let mut found = Vec::new();
    let mut x = from;
    while found.len() < count {
        assert!(x < 100.0 * from, "only {found:?}");
        if (f(x) > 0.0) != (f(x + step) > 0.0) {
            found.push(root(&f, x, x + step));
        }
        x += step;
    }
    found
}

/// SDLL04's problem: a beam on two supports with a sprung mass of `ratio` times its own at a quarter of its length, tuned to the
/// beam's first frequency. Frequencies in Hz for E I / (rho A) = 1e4 m^4/s^2 and 10 m.
///
/// The beam's receptance at that place is H = (sin(ra) sin(rb) / sin(rL) - sinh(ra) sinh(rb) / sinh(rL)) / (2 E I r^3), w = 100 r^2 (its
/// static limit is a^2 b^2 / (3 E I L)); the sprung mass pulls with m w^2 / (1 - w^2 / wc^2) per deflection, so that
/// H m w^2 = 1 - w^2 / wc^2, and m w^2 = ratio L E I r^4.
pub fn tuned_mass(ratio: f64, count: usize) -> Vec<f64> {
    let length = 10.0;
    let (a, b) = (0.25 * length, 0.75 * length);
    let own = PI * PI;
    let equation = |hz: f64| {
        let w = TAU * hz;
        let r = (w / 100.0).sqrt();
        // Times sin(rL), which takes the poles away.
        let pole = (r * length).sin();
        let beam = (r * a).sin() * (r * b).sin() - pole * (r * a).sinh() * (r * b).sinh() / (r * length).sinh();
        ratio * r * length * beam - 2.0 * (1.0 - (w / own).powi(2)) * pole
    };
    roots(equation, 0.1, 1e-3, count)
}

/// Mindlin's plate, pinned all round, a square of side `a`: the slower of the two frequencies in Hz for `m`, `n` half waves, with the
/// shear factor 5/6 (Reismann and Lee; w = sin sin meets all conditions).
pub fn mindlin(young: f64, poisson: f64, density: f64, a: f64, h: f64, [m, n]: [f64; 2]) -> f64 {
    let rigidity = young * h.powi(3) / (12.0 * (1.0 - poisson * poisson));
    let shear = 5.0 / 6.0 * young / (2.0 * (1.0 + poisson));
    let wave = (PI / a).powi(2) * (m * m + n * n);
    // (-k^2 + rho w^2 / shear) (-D k^2 + rho h^3 w^2 / 12) = rho h w^2
    let (quadratic, constant) = (density / shear * density * h.powi(3) / 12.0, rigidity * wave * wave);
    let linear = -(wave * density * h.powi(3) / 12.0 + rigidity * wave * density / shear + density * h);
    let square = 2.0 * constant / (-linear + (linear * linear - 4.0 * quadratic * constant).sqrt());
    square.sqrt() / TAU
}

/// lambda = pi^2 (m^2 + n^2), the square plate pinned all round, ascending.
pub fn navier(count: usize) -> Vec<f64> {
    let mut all: Vec<f64> = (1..9).flat_map(|m: i32| (1..9).map(move |n| PI * PI * f64::from(m * m + n * n))).collect();
    all.sort_by(f64::total_cmp);
    all.truncate(count);
    all
}

/// sqrt(D11 / D22 m^4 + 2 (D12 + 2 D66) / D22 m^2 n^2 + n^4), a square orthotropic plate pinned all round, ascending.
pub fn orthotropic(along: f64, twist: f64, count: usize) -> Vec<f64> {
    let own = |m: f64, n: f64| (along * m.powi(4) + 2.0 * twist * m * m * n * n + n.powi(4)).sqrt();
    let mut all: Vec<f64> = (1..9).flat_map(|m| (1..9).map(move |n| own(f64::from(m), f64::from(n)))).collect();
    all.sort_by(f64::total_cmp);
    all.truncate(count);
    all
}

/// (k L) of a cantilever: cos cosh = -1.
pub fn cantilever(count: usize) -> Vec<f64> {
    roots(|x| x.cos() + 1.0 / x.cosh(), 1.0, 0.1, count)
}

/// (k L) of a free beam: cos cosh = 1.
pub fn free_beam(count: usize) -> Vec<f64> {
    roots(|x| x.cos() - 1.0 / x.cosh(), 4.0, 0.1, count)
}

/// (k L) of a beam clamped at one end and pinned at the other: tan = tanh.
pub fn propped(count: usize) -> Vec<f64> {
    roots(|x| x.sin() - x.cos() * x.tanh(), 3.0, 0.1, count)
}
