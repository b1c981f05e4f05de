use super::*;
use crate::model::{Accuracy, PanelModel};
use crate::scene::{EXAMPLE_BAR, STARTING_PLATE, Scene};
use crate::transient::TimeGrid;
use crate::transient::panel::compute_point_motion;
use std::f64::consts::FRAC_PI_2;

fn model(text: &str) -> ReducedModel {
    let scene = Scene::parse("scene", text).unwrap();
    PanelModel::build(&scene, Accuracy::FAST, 300.0)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(300.0, &[])
        .unwrap()
}

fn sine(actuator: usize, frequency_hz: f64, force_n: f64) -> SwitchedForce {
    SwitchedForce { actuator, frequency_hz, force_n, phase_rad: -FRAC_PI_2 }
}

/// The examples, and the bar with other springs and losses.
fn bars() -> Vec<String> {
    let mut out = vec![EXAMPLE_BAR.to_owned(), STARTING_PLATE.to_owned()];
    for (damping, stiffness, loss) in [("0.2", "3000.0", "0.03"), ("8.0", "9000.0", "0.0"), ("40.0", "20000.0", "0.1")]
    {
        out.push(
            EXAMPLE_BAR
                .replace("damping_n_s_per_m = 1.1", &format!("damping_n_s_per_m = {damping}"))
                .replace("stiffness_n_per_m = 5000.0", &format!("stiffness_n_per_m = {stiffness}"))
                .replace("loss_factor = 0.01", &format!("loss_factor = {loss}")),
        );
    }
    out
}

/// The propagator steps the same equations in another way; what is left out here vibrates above 2 kHz.
#[test]
fn motion_is_that_of_the_propagator() {
    for (i, text) in bars().iter().enumerate() {
        let model = model(text);
        let shape = model.shape_deflections_at(0.06, 0.01);
        let rise = PanelPoles::find_poles_if_converged(&model).unwrap();
        let drives = [sine(0, 83.0, 0.1), sine(1, 171.0, 0.04)];
        let grid = TimeGrid { step_s: 2e-4, count: 1000 };
        let motion = compute_point_motion(&model, &shape, &drives, grid).unwrap();
        let ringings = rise.transient_response_per_n_of_each_drive_if_finite(&shape, &drives).unwrap();
        let peak = motion.steady_peak_m_per_s2;
        let steady: f64 = ringings.iter().zip(&drives).map(|(r, d)| r.steady.norm() * d.force_n).sum();
        assert!((steady / peak - 1.0).abs() < 1e-4, "{i}: {steady} {peak}");
        for (k, expected) in motion.acceleration_m_per_s2.iter().enumerate() {
            let t = grid.time_at_index_s(k);
            let found: f64 = ringings.iter().zip(&drives).map(|(r, d)| r.value_at(t) * d.force_n).sum();
            // A sine has a kink at its start, which excites poles up there by a few per cent.
            assert!((found - expected).abs() < 0.04 * peak, "{i} at {t}: {found} {expected}, peak {peak}");
            let found: f64 = ringings
                .iter()
                .zip(&drives)
                .map(|(r, d)| r.clone().acceleration_to_displacement().value_at(t) * d.force_n)
                .sum();
            let expected = motion.displacement_m[k];
            assert!(
                (found - expected).abs() < 1e-3 * motion.displacement_m.iter().fold(0.0, |m: f64, x| m.max(x.abs()))
            );
        }
    }
}

/// Running amplitude by definition, densely sampled, from the propagator's motion with the drive in and out of phase.
#[test]
fn times_are_those_of_the_running_amplitude() {
    for (i, text) in bars().iter().enumerate() {
        let model = model(text);
        let rise = PanelPoles::find_poles_if_converged(&model).unwrap();
        for (x, hz) in [(0.03, 64.0), (0.11, 131.0), (0.2, 250.0)] {
            let shape = model.shape_deflections_at(x, 0.01);
            let drives = [sine(0, hz, 0.1), sine(1, hz + 37.0, 0.05)];
            let timing = rise.find_rise_and_decay_times(&shape, &drives);
            let grid = TimeGrid { step_s: 1e-4, count: 8001 };
            let ringings = rise.transient_response_per_n_of_each_drive_if_finite(&shape, &drives).unwrap();
            let envelope = |t: f64, part: f64| -> f64 {
                let amplitude = |(r, d): (&TransientResponse, &SwitchedForce)| {
                    let carrier = Complex64::new(0.0, -r.omega_rad_s * t).exp();
                    let one = |(s, c): &(Complex64, Complex64)| {
                        let motion = c * (s * t).exp();
                        carrier * if s.im > -s.re { motion } else { Complex64::from(motion.re) }
                    };
                    let free: Complex64 = r.free.iter().map(one).sum();
                    (r.steady * part + free).norm() * d.force_n
                };
                ringings.iter().zip(&drives).map(amplitude).sum()
            };
            let peak = compute_point_motion(&model, &shape, &drives, TimeGrid { step_s: 1e-4, count: 2 }).unwrap();
            let peak = peak.steady_peak_m_per_s2;
            let last = |fails: &dyn Fn(f64) -> bool| {
                (0..grid.count)
                    .rev()
                    .find(|k| fails(grid.time_at_index_s(*k)))
                    .map_or(0.0, |k| grid.time_at_index_s(k + 1))
            };
            let reaches = last(&|t| envelope(t, 1.0) < 0.9 * peak);
            let decays = last(&|t| envelope(t, 0.0) > 0.1 * peak);
            let (found, expected) = (timing.reaches_90_s.unwrap(), reaches);
            assert!((found - expected).abs() < 4e-3 * (1.0 + expected), "{i} {hz}: {found} {expected}");
            let (found, expected) = (timing.decays_to_10_s.unwrap(), decays);
            assert!((found - expected).abs() < 4e-3 * (1.0 + expected), "{i} {hz}: {found} {expected}");
        }
    }
}

#[test]
fn without_damping_there_is_no_end() {
    let text = EXAMPLE_BAR
        .replace("damping_n_s_per_m = 1.1", "damping_n_s_per_m = 0.0")
        .replace("loss_factor = 0.01", "loss_factor = 0.0");
    let model = model(&text);
    let shape = model.shape_deflections_at(0.06, 0.01);
    let timing =
        PanelPoles::find_poles_if_converged(&model).unwrap().find_rise_and_decay_times(&shape, &[sine(0, 100.0, 0.1)]);
    assert_eq!(timing, Timing { reaches_90_s: None, decays_to_10_s: None });
}

/// One mode, damped around and at the critical value: settles as the closed form does.
#[test]
fn critical_damping() {
    for ratio in [0.999_999, 1.0, 1.000_001, 3.0] {
        let text = r#"
            version = 1
            name = "stiff plate on a soft spring"
            [surface]
            kind = "bar"
            length_mm = 20.0
            width_mm = 20.0
            thickness_mm = 20.0
            [surface.material]
            youngs_modulus_pa = 70e9
            poisson_ratio = 0.33
            density_kg_m3 = 12500.0
            [screen]
            width_px = 100
            height_px = 100
            [[actuator]]
            id = "a"
            x_mm = 10.0
            mount = "grounded"
            moving_mass_g = 0.001
            stiffness_n_per_m = 10000.0
            damping_n_s_per_m = DAMPING
            electrode_area_mm2 = 1963.5
            air_gap_um = 500.0
            max_voltage_v = 2000.0
        "#;
        // 0.1 kg on 1e4 N/m: w = 316 rad/s, critical damping 2 sqrt(k m) = 63.2 N s/m.
        let (mass, stiffness) = (0.100_001_f64, 1e4_f64);
        let damping = ratio * 2.0 * (stiffness * mass).sqrt();
        let model = model(&text.replace("DAMPING", &format!("{damping:.12}")));
        let rise = PanelPoles::find_poles_if_converged(&model).unwrap();
        let timing = rise.find_rise_and_decay_times(&model.shape_deflections_at(0.01, 0.01), &[sine(0, 150.0, 1.0)]);
        let decay = |t: f64| {
            // Of (x, v) at the end of a steady sine, by the oscillator's own propagator.
            let omega = TAU * 150.0;
            let u = Complex64::new(0.0, -1.0) / Complex64::new(stiffness - mass * omega * omega, damping * omega);
            let free = (u.re, (u * Complex64::new(0.0, omega)).re);
            let (x, v) =
                crate::transient::oscillator::OscillatorStep::from_time_and_mode(t, stiffness / mass, damping / mass)
                    .advance_state(free);
            ((stiffness * x + damping * v) / mass).abs() / (u.norm() * omega * omega)
        };
        let expected = (0..40_000).rev().map(|k| f64::from(k) * 1e-5).find(|t| decay(*t) > 0.1).unwrap_or(0.0);
        let found = timing.decays_to_10_s.unwrap();
        assert!((found - expected).abs() < 1e-3, "{ratio}: {found} {expected}");
        assert!(timing.reaches_90_s.is_some());
    }
}

/// Stepped under a sine, displacements are those of the closed form: a test of turn, input, output and what is at once.
#[test]
fn the_stepper_follows_the_closed_form() {
    let model = model(EXAMPLE_BAR);
    let rise = PanelPoles::find_poles_if_converged(&model).unwrap();
    let rows = [model.shape_deflections_at(0.06, 0.01), model.shape_deflections_at(0.2, 0.01)];
    let (step_s, hz) = (2e-5, 110.0);
    let mut stepper = rise.build_stepper(&rows, step_s);
    let drive = sine(1, hz, 1.0);
    let expected: Vec<TransientResponse> = rows
        .iter()
        .map(|row| {
            rise.transient_response_per_n_of_each_drive_if_finite(row, &[drive])
                .unwrap()
                .remove(0)
                .acceleration_to_displacement()
        })
        .collect();
    let mut out = [0.0; 2];
    let size = expected.iter().map(|r| r.steady.norm()).fold(0.0, f64::max);
    for k in 0..4000 {
        // The middle of a step stands for it.
        let t = f64::from(k) * step_s;
        stepper.advance_one_step(&[0.0, (TAU * hz * (t + 0.5 * step_s)).sin()], &mut out);
        for (found, ringing) in out.iter().zip(&expected) {
            let wanted = ringing.value_at(t + step_s);
            assert!((found - wanted).abs() < 0.02 * size, "{found} {wanted} at {t}, {size}");
        }
    }
}

/// Travel stepped while a drive's force grows with the square of the time, against the steady one and what is told to come on
/// top. At 223 Hz a mode of the random panel takes the ERA's motion away, and takes its time over it.
#[test]
fn switching_on_goes_as_far_as_is_reported() {
    let absorbed = crate::scene::random::random_scene_text(1, 130);
    let (mut beyond, mut largest) = (0, 0.0_f64);
    for (text, frequencies_hz) in [
        (EXAMPLE_BAR, [60.0, 97.0, 143.0, 260.0]),
        (STARTING_PLATE, [45.0, 90.0, 131.0, 222.0]),
        (&absorbed, [60.0, 190.0, 223.0, 260.0]),
    ] {
        let model = model(text);
        let rise = PanelPoles::find_poles_if_converged(&model).unwrap();
        let onset = rise.build_switch_on_model(&model);
        let rows: Vec<DVector<f64>> =
            (0..model.count_actuators()).map(|actuator| model.actuator_mass_travel_row(actuator)).collect();
        let at_rest = rise.build_stepper(&rows, 5e-5);
        for (driven, hz) in (0..model.count_actuators()).flat_map(|driven| frequencies_hz.map(|hz| (driven, hz))) {
            let mut steady = [Complex64::ZERO; crate::scene::MAX_ACTUATORS];
            for (steady, row) in steady.iter_mut().zip(&rows) {
                let ringing = rise
                    .transient_response_per_n_of_each_drive_if_finite(row, &[sine(driven, hz, 1.0)])
                    .unwrap()
                    .remove(0)
                    .acceleration_to_displacement();
                *steady = ringing.steady * Complex64::from_polar(1.0, FRAC_PI_2);
            }
            for rise_s in [0.02, 0.06] {
                let told = onset.bound_overshoot_of_each_mass_m_per_n(driven, hz, rise_s, &steady);
                let (mut stepper, mut out, mut most) =
                    (at_rest.clone(), vec![0.0; rows.len()], vec![0.0_f64; rows.len()]);
                for k in 0..12_000 {
                    let t = (f64::from(k) + 0.5) * 5e-5;
                    let mut forces = vec![0.0; rows.len()];
                    forces[driven] = (t / rise_s).min(1.0).powi(2) * (TAU * hz * t).sin();
                    stepper.advance_one_step(&forces, &mut out);
                    most.iter_mut().zip(&out).for_each(|(most, out)| *most = most.max(out.abs()));
                }
                for (i, most) in most.iter().enumerate() {
                    let most_told = steady[i].norm() + told[i];
                    // A crest between samples is missed by 3.4 %.
                    assert!(*most <= 1.04 * most_told, "{driven} {i} at {hz} Hz: {most} {most_told}");
                    // Near what the driven mass does it is no mere bound.
                    if i == driven && told[i] > 0.1 * steady[i].norm() {
                        beyond += 1;
                        largest = largest.max(told[i] / steady[i].norm());
                        assert!(most_told <= 1.35 * most, "{driven} {i} at {hz} Hz: {most} {most_told}");
                    }
                }
            }
        }
    }
    assert!(beyond >= 8 && largest > 3.0, "{beyond} {largest}");
}
