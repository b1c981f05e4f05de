//! `era transient`: a point's motion after drives are switched on.

use super::args_panel::{DriveText, Transient};
use super::output::write_text_file_atomically;
use super::panel::{convert_at_option_to_m, warn_if_too_thick_for_thin_plate_theory};
use super::progress::run_with_progress;
use super::terminal_messages::tell;
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::scene::Scene;
use crate::transient::panel::{
    MotionError, NO_BOUND, PointMotion, SwitchedForce, choose_time_grid, compute_motion_after_switch_on,
    highest_drive_frequency_but_at_least_1_hz,
};
use serde_json::json;
use std::fmt::Write;
use std::time::Instant;

pub fn run_transient(options: &Transient) -> CommandResult {
    let started = Instant::now();
    let scene = options.panel.load_scene()?;
    let accuracy = options.panel.accuracy()?;
    let at = convert_at_option_to_m(&scene, options.at.x, options.at.y, options.unit)?;
    let drives = options.drive.iter().map(|text| make_switched_force(&scene, text)).collect::<Result<Vec<_>, _>>()?;
    let grid =
        choose_time_grid(options.duration, options.step).map_err(|error| Failure::usage_error(format!("--{error}")))?;
    warn_if_too_thick_for_thin_plate_theory(&scene, highest_drive_frequency_but_at_least_1_hz(&drives));
    let motion = run_with_progress("computing the motion", || {
        compute_motion_after_switch_on(&scene, accuracy, at, &drives, grid)
    })?;
    let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
    tell!("no bound of the model error is known (error_bound is null), because {NO_BOUND}");
    let settled_s = motion.settling_time_if_single_drive_settles_s(&drives);
    if let Some(path) = &options.csv {
        let text = format_motion_csv(&motion);
        if path.as_os_str() == "-" {
            return print_text_after_queued_log(text.trim_end());
        }
        write_text_file_atomically(path, &text)?;
    }
    if options.json {
        return print_json(&json!({
            "elapsed_ms": elapsed_ms, "peak_m_per_s2": motion.largest_acceleration_over_time_m_per_s2(),
            "steady_peak_m_per_s2": motion.steady_peak_m_per_s2, "settled_s": settled_s, "error_bound": null,
            "time_s": motion.time_s,
            "displacement_m": motion.displacement_m, "acceleration_m_per_s2": motion.acceleration_m_per_s2,
        }));
    }
    let settled = match (settled_s, drives.len()) {
        (Some(settled), _) => {
            format!("\nthe motion stays within 10 % of the steady state from {:.1} ms on", settled * 1e3)
        }
        (None, 1) => {
            "\nthe motion did not settle within this time, or the time steps are too long to show whether it settled: \
             use a longer --duration or a shorter --step"
                .into()
        }
        (None, _) => String::new(),
    };
    print_text_after_queued_log(&format!(
        "{} points in time, computed in {elapsed_ms:.0} ms\nlargest acceleration {:.4} m/s^2, in the steady state {:.4} m/s^2{settled}",
        motion.time_s.len(),
        motion.largest_acceleration_over_time_m_per_s2(),
        motion.steady_peak_m_per_s2,
    ))
}

impl From<MotionError> for Failure {
    fn from(error: MotionError) -> Self {
        match error {
            MotionError::Model(error) => error.into(),
            MotionError::Transient(error) => Failure::runtime_error(error),
        }
    }
}

fn make_switched_force(scene: &Scene, text: &DriveText) -> Result<SwitchedForce, Failure> {
    let known = || scene.actuators.iter().map(|actuator| actuator.id.as_str()).collect::<Vec<_>>().join(", ");
    let actuator = scene.actuators.iter().position(|actuator| actuator.id == text.actuator).ok_or_else(|| {
        Failure::usage_error(format!(
            "--drive: the scene has no actuator {:?} (its actuators: {})",
            text.actuator,
            known()
        ))
    })?;
    let phase_rad = text.phase_deg.to_radians();
    let drive = SwitchedForce { actuator, frequency_hz: text.frequency_hz, force_n: text.force_n, phase_rad };
    drive.check_frequency_and_force().map_err(|error| Failure::usage_error(format!("--drive: {error}")))?;
    Ok(drive)
}

fn format_motion_csv(motion: &PointMotion) -> String {
    let mut text = String::from("time_s,displacement_m,acceleration_m_per_s2\n");
    for ((time, displacement), acceleration) in
        motion.time_s.iter().zip(&motion.displacement_m).zip(&motion.acceleration_m_per_s2)
    {
        let _ = writeln!(text, "{time},{displacement:e},{acceleration:e}");
    }
    text
}
