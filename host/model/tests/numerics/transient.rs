//! Motion in time against closed forms, a Runge-Kutta integration, the steady state, and the published equations.

use era_model::transient::{
    HarmonicForce, InitialState, MotionQuantity, OutputRows, Propagator, SecondOrderSystem, TimeGrid, TransientError,
    as_published, solve_steady_state,
};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::FRAC_PI_2;

fn vector(entries: &[f64]) -> DVector<f64> {
    DVector::from_column_slice(entries)
}

/// A square matrix by rows.
fn square(entries: &[f64]) -> DMatrix<f64> {
    let n = entries.len().isqrt();
    DMatrix::from_row_slice(n, n, entries)
}

fn grid(step_s: f64, count: usize) -> TimeGrid {
    TimeGrid { step_s, count }
}

fn single(damping: f64, stiffness: f64) -> SecondOrderSystem {
    SecondOrderSystem { m: square(&[1.0]), c: square(&[damping]), k: square(&[stiffness]) }
}

/// Numbers in [0, 1) of a multiplicative generator.
fn generator(mut seed: u64) -> impl FnMut() -> f64 {
    move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        f64::from(u32::try_from(seed >> 32).unwrap()) / f64::from(u32::MAX)
    }
}

/// Masses 1 to 2 kg in a chain between two walls, springs 500 to 1000 N/m, dashpots 1 to 5 N s/m.
fn make_mass_spring_chain(n: usize) -> SecondOrderSystem {
    let mut next = generator(n as u64);
    let (mut c, mut k) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
    let m = DMatrix::from_diagonal(&DVector::from_fn(n, |_, _| 1.0 + next()));
    for link in 0..=n {
        let (spring, dashpot) = (500.0 + 500.0 * next(), 1.0 + 4.0 * next());
        for (matrix, value) in [(&mut k, spring), (&mut c, dashpot)] {
            if link > 0 {
                matrix[(link - 1, link - 1)] += value;
            }
            if link < n {
                matrix[(link, link)] += value;
            }
            if link > 0 && link < n {
                matrix[(link - 1, link)] -= value;
                matrix[(link, link - 1)] -= value;
            }
        }
    }
    SecondOrderSystem { m, c, k }
}

fn proportional(mut system: SecondOrderSystem) -> SecondOrderSystem {
    system.c = &system.m * 0.8 + &system.k * 1e-3;
    system
}

/// Sines of 60 rad/s on the first and last unknown, and a cosine of 11 rad/s on the first.
fn drives(n: usize) -> Vec<HarmonicForce> {
    let mut ends = DVector::zeros(n);
    (ends[0], ends[n - 1]) = (1.0, 1.0);
    let mut first = DVector::zeros(n);
    first[0] = 0.7;
    vec![
        HarmonicForce { omega_rad_s: 60.0, phase_rad: -FRAC_PI_2, force_n: ends },
        HarmonicForce { omega_rad_s: 11.0, phase_rad: 0.4, force_n: first },
    ]
}

fn start(n: usize) -> InitialState {
    let mut next = generator(99);
    InitialState {
        displacement: DVector::from_fn(n, |_, _| 1e-2 * (next() - 0.5)),
        velocity: DVector::from_fn(n, |_, _| next() - 0.5),
    }
}

/// Displacements by the classical Runge-Kutta method with `fine` steps per step of the grid.
fn runge_kutta(
    system: &SecondOrderSystem,
    initial: &InitialState,
    force: &dyn Fn(f64) -> DVector<f64>,
    grid: TimeGrid,
    fine: u32,
) -> DMatrix<f64> {
    let inverse = system.m.clone().try_inverse().unwrap();
    let rate = |t: f64, q: &DVector<f64>, v: &DVector<f64>| &inverse * (force(t) - &system.c * v - &system.k * q);
    let (mut q, mut v) = (initial.displacement.clone(), initial.velocity.clone());
    let mut out = DMatrix::zeros(grid.count, system.count_unknowns());
    let h = grid.step_s / f64::from(fine);
    for k in 0..grid.count {
        out.set_row(k, &q.transpose());
        for i in 0..fine {
            let t = grid.time_at_index_s(k) + f64::from(i) * h;
            let a1 = rate(t, &q, &v);
            let (q2, v2) = (&q + &v * (h / 2.0), &v + &a1 * (h / 2.0));
            let a2 = rate(t + h / 2.0, &q2, &v2);
            let (q3, v3) = (&q + &v2 * (h / 2.0), &v + &a2 * (h / 2.0));
            let a3 = rate(t + h / 2.0, &q3, &v3);
            let (q4, v4) = (&q + &v3 * h, &v + &a3 * h);
            let a4 = rate(t + h, &q4, &v4);
            q += (&v + (&v2 + &v3) * 2.0 + &v4) * (h / 6.0);
            v += (&a1 + (&a2 + &a3) * 2.0 + &a4) * (h / 6.0);
        }
    }
    out
}

/// Largest difference over the largest entry of the second.
fn worst(found: &DMatrix<f64>, expected: &DMatrix<f64>) -> f64 {
    (found - expected).amax() / expected.amax()
}

fn at_time(drives: &[HarmonicForce], t: f64) -> DVector<f64> {
    let mut sum = drives[0].force_n.clone() * 0.0;
    for drive in drives {
        sum += &drive.force_n * (drive.omega_rad_s * t + drive.phase_rad).cos();
    }
    sum
}

#[test]
fn one_unknown_below_at_and_above_critical_damping() {
    let grid = grid(0.01, 400);
    let initial = InitialState { displacement: vector(&[1.0]), velocity: vector(&[-0.5]) };
    for damping in [0.0_f64, 0.3, 3.9, 4.0 - 1e-9, 4.0, 4.0 + 1e-9, 4.1, 40.0] {
        let a = damping / 2.0;
        let closed = DMatrix::from_fn(grid.count, 1, |k, _| {
            let t = grid.time_at_index_s(k);
            let rest = -0.5 + a;
            if (damping - 4.0).abs() < 1e-8 {
                return (-a * t).exp() * (1.0 + rest * t);
            }
            if damping < 4.0 {
                let s = (4.0 - a * a).sqrt();
                return (-a * t).exp() * ((s * t).cos() + rest * (s * t).sin() / s);
            }
            let s = (a * a - 4.0).sqrt();
            // Two real exponentials, from initial conditions.
            let (r1, r2) = (-4.0 / (a + s), -a - s);
            let first = (-0.5 - r2) / (r1 - r2);
            first * (r1 * t).exp() + (1.0 - first) * (r2 * t).exp()
        });
        let propagator = Propagator::new(&single(damping, 4.0), grid).unwrap();
        let found = propagator
            .compute_motion_under_harmonics_row_per_time(&initial, &[], OutputRows::All, MotionQuantity::Displacement)
            .unwrap();
        // 1e-9 off critical damping moves the answer by about as much.
        let limit = if (damping - 4.0).abs() < 1e-8 { 2e-9 } else { 2e-14 };
        assert!(worst(&found, &closed) < limit, "c = {damping}: {:e}", worst(&found, &closed));
        if damping == 4.0 {
            assert!(worst(&found, &closed) < 1e-14);
        }
    }
}

/// Three critically damped modes, coupled in the given unknowns, two of them equal.
fn make_critically_damped_system() -> SecondOrderSystem {
    let q = reflection();
    let omega = vector(&[2.0, 2.0, 5.0]);
    SecondOrderSystem {
        m: DMatrix::identity(3, 3),
        c: &q * DMatrix::from_diagonal(&(&omega * 2.0)) * q.transpose(),
        k: &q * DMatrix::from_diagonal(&omega.component_mul(&omega)) * q.transpose(),
    }
}

/// I - 2 u u^T for a unit vector u: orthogonal and symmetric.
fn reflection() -> DMatrix<f64> {
    let u = vector(&[1.0, 2.0, -0.5]).normalize();
    DMatrix::identity(3, 3) - &u * u.transpose() * 2.0
}

#[test]
fn critical_damping_and_equal_eigenvalues_where_the_published_form_fails() {
    let (system, grid, initial) = (make_critically_damped_system(), grid(0.01, 500), start(3));
    let q = reflection();
    let (p, v) = (q.transpose() * &initial.displacement, q.transpose() * &initial.velocity);
    let omega = [2.0, 2.0, 5.0];
    let closed = DMatrix::from_fn(grid.count, 3, |k, i| {
        let t = grid.time_at_index_s(k);
        (0..3).map(|j| q[(i, j)] * (-omega[j] * t).exp() * (p[j] + (v[j] + omega[j] * p[j]) * t)).sum()
    });
    let propagator = Propagator::new(&system, grid).unwrap();
    assert!(propagator.has_decoupled_modes());
    let found = propagator
        .compute_motion_under_harmonics_row_per_time(&initial, &[], OutputRows::All, MotionQuantity::Displacement)
        .unwrap();
    assert!(worst(&found, &closed) < 1e-13, "{:e}", worst(&found, &closed));
    match as_published::compute_displacements_by_thesis_eigenvectors_row_per_time(&system, &initial, &[], grid) {
        Err(error) => assert_eq!(error, TransientError::Defective),
        Ok(published) => assert!(worst(&published, &closed) > 1e-10, "{:e}", worst(&published, &closed)),
    }
}

#[test]
fn proportional_and_general_damping_against_runge_kutta() {
    let n = 7;
    let grid = grid(0.004, 301);
    for (system, decoupled) in [(proportional(make_mass_spring_chain(n)), true), (make_mass_spring_chain(n), false)] {
        let (initial, drives) = (start(n), drives(n));
        let propagator = Propagator::new(&system, grid).unwrap();
        assert_eq!(propagator.has_decoupled_modes(), decoupled);
        let expected = runge_kutta(&system, &initial, &|t| at_time(&drives, t), grid, 40);
        let all = propagator
            .compute_motion_under_harmonics_row_per_time(
                &initial,
                &drives,
                OutputRows::All,
                MotionQuantity::Displacement,
            )
            .unwrap();
        assert!(worst(&all, &expected) < 1e-10, "{:e}", worst(&all, &expected));
        let published =
            as_published::compute_displacements_by_thesis_eigenvectors_row_per_time(&system, &initial, &drives, grid)
                .unwrap();
        assert!(worst(&published, &all) < 1e-10);
        // Few outputs take another way; velocity and acceleration satisfy the equation of motion.
        let rows = DMatrix::identity(n, n);
        let get = |quantity| {
            propagator
                .compute_motion_under_harmonics_row_per_time(&initial, &drives, OutputRows::Rows(&rows), quantity)
                .unwrap()
        };
        let (q, v, a) =
            (get(MotionQuantity::Displacement), get(MotionQuantity::Velocity), get(MotionQuantity::Acceleration));
        assert!(worst(&q, &all) < 1e-12);
        for k in [0, 1, 137, 300] {
            let left =
                &system.m * a.row(k).transpose() + &system.c * v.row(k).transpose() + &system.k * q.row(k).transpose();
            assert!((left - at_time(&drives, grid.time_at_index_s(k))).amax() < 1e-9);
        }
        assert!((v.row(0).transpose() - &initial.velocity).amax() < 1e-12);
    }
}

#[test]
fn a_full_mass_matrix_and_many_outputs() {
    let n = 24;
    let mut system = make_mass_spring_chain(n);
    let mut next = generator(3);
    let mixing = DMatrix::from_fn(n, n, |i, j| f64::from(u8::from(i == j)) + 0.05 * (next() - 0.5));
    system.m = mixing.transpose() * &system.m * &mixing;
    system.m = 0.5 * (&system.m + system.m.transpose());
    for system in [proportional(system.clone()), system] {
        let grid = grid(1e-3, 1003);
        let propagator = Propagator::new(&system, grid).unwrap();
        let found = propagator
            .compute_motion_under_harmonics_row_per_time(
                &start(n),
                &drives(n),
                OutputRows::All,
                MotionQuantity::Displacement,
            )
            .unwrap();
        let published = as_published::compute_displacements_by_thesis_eigenvectors_row_per_time(
            &system,
            &start(n),
            &drives(n),
            grid,
        )
        .unwrap();
        assert!(worst(&found, &published) < 1e-10, "{:e}", worst(&found, &published));
    }
}

#[test]
fn what_is_left_in_the_end_is_the_steady_state() {
    for system in [proportional(make_mass_spring_chain(9)), make_mass_spring_chain(9)] {
        let grid = grid(0.02, 40_001);
        let drive = drives(9).remove(0);
        let propagator = Propagator::new(&system, grid).unwrap();
        let found = propagator
            .compute_motion_under_harmonics_row_per_time(
                &start(9),
                std::slice::from_ref(&drive),
                OutputRows::All,
                MotionQuantity::Displacement,
            )
            .unwrap();
        let amplitudes = propagator.solve_steady_amplitudes(&drive).unwrap();
        let direct = solve_steady_state(&system, &drive).unwrap();
        assert!((&amplitudes - &direct).map(|z| z.norm()).amax() < 1e-12 * direct.map(|z| z.norm()).amax());
        let (p, q) = as_published::solve_particular_cos_and_sin(&system, &drive).unwrap();
        let largest = p.amax().max(q.amax());
        for i in 0..9 {
            assert!((direct[i].re - p[i]).abs() + (direct[i].im + q[i]).abs() < 1e-12 * largest);
            let t = grid.time_at_index_s(grid.count - 1);
            let expected = (direct[i] * num_complex::Complex64::from_polar(1.0, drive.omega_rad_s * t)).re;
            assert!((found[(grid.count - 1, i)] - expected).abs() < 1e-11 * largest);
        }
    }
}

/// The thesis' example of two unknowns: eigenvalues 2 and 4, shapes (1, 3) and (1, -3) up to scale.
#[test]
fn the_thesis_two_unknowns() {
    let system = SecondOrderSystem {
        m: square(&[18.0, 0.0, 0.0, 2.0]),
        c: DMatrix::zeros(2, 2),
        k: square(&[54.0, -6.0, -6.0, 6.0]),
    };
    let grid = grid(0.05, 2000);
    let initial = InitialState { displacement: vector(&[2.0, 0.0]), velocity: vector(&[0.0, 0.0]) };
    let found = Propagator::new(&system, grid)
        .unwrap()
        .compute_motion_under_harmonics_row_per_time(&initial, &[], OutputRows::All, MotionQuantity::Displacement)
        .unwrap();
    let closed = DMatrix::from_fn(grid.count, 2, |k, i| {
        let (slow, fast) = ((2.0_f64.sqrt() * grid.time_at_index_s(k)).cos(), (2.0 * grid.time_at_index_s(k)).cos());
        if i == 0 { slow + fast } else { 3.0 * (slow - fast) }
    });
    assert!(worst(&found, &closed) < 1e-12, "{:e}", worst(&found, &closed));
}

/// q'' + 4 q = cos 2t from rest: q = t sin(2t) / 4, without a steady state.
#[test]
fn an_undamped_resonance_grows_with_time() {
    let grid = grid(0.01, 3001);
    let propagator = Propagator::new(&single(0.0, 4.0), grid).unwrap();
    let drive = HarmonicForce { omega_rad_s: 2.0, phase_rad: 0.0, force_n: vector(&[1.0]) };
    assert_eq!(propagator.solve_steady_amplitudes(&drive), Err(TransientError::Unbounded { omega_rad_s: 2.0 }));
    let found = propagator
        .compute_motion_under_harmonics_row_per_time(
            &InitialState::at_rest(1),
            &[drive],
            OutputRows::All,
            MotionQuantity::Displacement,
        )
        .unwrap();
    let closed =
        DMatrix::from_fn(grid.count, 1, |k, _| grid.time_at_index_s(k) * (2.0 * grid.time_at_index_s(k)).sin() / 4.0);
    assert!(worst(&found, &closed) < 1e-11, "{:e}", worst(&found, &closed));
}

#[test]
fn forces_by_samples() {
    let n = 7;
    for system in [proportional(make_mass_spring_chain(n)), make_mass_spring_chain(n)] {
        let mut last = f64::INFINITY;
        // A sampled harmonic force: the hold's error falls as the square of the step.
        for (step_s, count) in [(4e-3, 251), (1e-3, 1001)] {
            let grid = grid(step_s, count);
            let propagator = Propagator::new(&system, grid).unwrap();
            let exact = propagator
                .compute_motion_under_harmonics_row_per_time(
                    &start(n),
                    &drives(n),
                    OutputRows::All,
                    MotionQuantity::Displacement,
                )
                .unwrap();
            let mut samples = DMatrix::zeros(n, count);
            for k in 0..count {
                samples.set_column(k, &at_time(&drives(n), grid.time_at_index_s(k)));
            }
            let input = DMatrix::identity(n, n);
            let found = propagator
                .compute_motion_under_samples_row_per_time(
                    &start(n),
                    &input,
                    &samples,
                    OutputRows::All,
                    MotionQuantity::Displacement,
                )
                .unwrap();
            let error = worst(&found, &exact);
            assert!(error < last / 12.0, "{error:e} after {last:e}");
            last = error;
            let get = |quantity| {
                propagator
                    .compute_motion_under_samples_row_per_time(&start(n), &input, &samples, OutputRows::All, quantity)
                    .unwrap()
            };
            let (v, a) = (get(MotionQuantity::Velocity), get(MotionQuantity::Acceleration));
            let k = count / 3;
            let left = &system.m * a.row(k).transpose()
                + &system.c * v.row(k).transpose()
                + &system.k * found.row(k).transpose();
            assert!((left - samples.column(k)).amax() < 1e-9);
        }
        assert!(last < 1e-3);
    }
    // A ramp is straight: exact. q'' = t from rest, q = t^3/6.
    let grid = grid(0.1, 50);
    let samples = DMatrix::from_fn(1, 50, |_, k| grid.time_at_index_s(k));
    let free = Propagator::new(&single(0.0, 0.0), grid).unwrap();
    let found = free
        .compute_motion_under_samples_row_per_time(
            &InitialState::at_rest(1),
            &square(&[1.0]),
            &samples,
            OutputRows::All,
            MotionQuantity::Displacement,
        )
        .unwrap();
    let closed = DMatrix::from_fn(50, 1, |k, _| grid.time_at_index_s(k).powi(3) / 6.0);
    assert!(worst(&found, &closed) < 1e-13);
}

/// Free motion over 20001 steps against one long step each: the recurrence's round-off stays below its bound.
#[test]
fn round_off_stays_below_its_bound() {
    for system in [
        proportional(make_mass_spring_chain(20)),
        make_mass_spring_chain(20),
        SecondOrderSystem { c: DMatrix::zeros(20, 20), ..make_mass_spring_chain(20) },
    ] {
        let (fine, coarse) = (grid(1e-3, 20_001), grid(20.0, 2));
        let get = |grid| {
            let propagator = Propagator::new(&system, grid).unwrap();
            let out = propagator
                .compute_motion_under_harmonics_row_per_time(
                    &start(20),
                    &[],
                    OutputRows::All,
                    MotionQuantity::Displacement,
                )
                .unwrap();
            let bound = propagator.round_off_bound_relative_to_initial_motion_at_index(grid.count - 1);
            (out.row(grid.count - 1).transpose(), bound)
        };
        let ((found, bound), (direct, _)) = (get(fine), get(coarse));
        let energy = |q: &DVector<f64>, v: &DVector<f64>| (q.dot(&(&system.k * q)) + v.dot(&(&system.m * v))).sqrt();
        let difference = energy(&(found - direct), &DVector::zeros(20));
        let initial = energy(&start(20).displacement, &start(20).velocity);
        assert!(difference <= bound * initial, "{:e} above {bound:e}", difference / initial);
        assert!(bound < 1e-6);
    }
}

#[test]
fn bad_input_is_named() {
    let grid = grid(0.1, 10);
    let good = make_mass_spring_chain(3);
    let error = |system: &SecondOrderSystem| Propagator::new(system, grid).unwrap_err().to_string();
    let mut bad = good.clone();
    bad.k[(0, 1)] += 1.0;
    assert!(error(&bad).starts_with("k is not symmetric: entry (0, 1)"));
    bad = good.clone();
    bad.m[(1, 1)] = 0.0;
    assert!(error(&bad).starts_with("the mass matrix m is not positive definite"));
    bad = good.clone();
    bad.c[(1, 1)] = f64::NAN;
    assert!(error(&bad).starts_with("c has an entry"));
    bad.c = DMatrix::zeros(2, 3);
    assert_eq!(error(&bad), "c is 2 x 3, but must be 3 x 3");
    let step = TimeGrid { step_s: 0.0, count: 10 };
    assert!(Propagator::new(&good, step).unwrap_err().to_string().starts_with("time step in s is 0, but must be"));
    let propagator = Propagator::new(&good, grid).unwrap();
    let wrong = InitialState::at_rest(2);
    assert!(
        propagator
            .compute_motion_under_harmonics_row_per_time(&wrong, &[], OutputRows::All, MotionQuantity::Displacement)
            .is_err()
    );
}
