//! `era transient`: a point's motion after drives are switched on.

use super::args::{DriveText, Transient};
use super::panel::{surface_point, warn_if_thick};
use super::progress::with_progress;
use super::told::tell;
use super::{Failure, Outcome, print_json, print_text};
use crate::model::PanelModel;
use crate::scene::Scene;
use crate::transient::TimeGrid;
use crate::transient::panel::{Drive, Motion, motion_at};
use serde_json::json;
use std::fmt::Write;
use std::time::Instant;

/// Part of the steady peak within which a motion counts as settled.
const SETTLED: f64 = 0.1;
/// Frequencies up to this multiple of the drives' are modelled: switching on excites modes above the drive in proportion to
/// drive over mode frequency.
const SWITCHED_ON: f64 = 10.0;
/// Why a motion has no bound: with the mesh, acceleration after switching on does not settle but gains ever higher modes.
const NO_BOUND: &str = "switching on excites modes of any frequency, and how those above the band ring on is not in the model; \
    the steady state is bounded by `era response`";
/// Most times of a series.
const MOST_TIMES: f64 = 1e6;

pub fn run(options: &Transient) -> Outcome {
    let started = Instant::now();
    let scene = options.panel.load()?;
    let accuracy = options.panel.accuracy()?;
    let at = surface_point(&scene, options.at.x, options.at.y, options.unit)?;
    let drives = options.drive.iter().map(|text| drive(&scene, text)).collect::<Result<Vec<_>, _>>()?;
    let grid = grid(options)?;
    let highest = drives.iter().map(|drive| drive.frequency_hz).fold(1.0, f64::max);
    warn_if_thick(&scene, highest);
    let motion = with_progress("computing the motion", || -> Result<_, Failure> {
        let model = PanelModel::build(&scene, accuracy, SWITCHED_ON * highest)?.reduce(SWITCHED_ON * highest, &[at])?;
        motion_at(&model, &model.shape_at(at.0, at.1), &drives, grid).map_err(Failure::failed)
    })?;
    let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
    tell!("error_bound is null: {NO_BOUND}");
    // Several drives beat, and a beat's peaks say nothing about settling.
    let settled_s = match drives.as_slice() {
        [drive] => motion.settles_s(drive.frequency_hz, SETTLED),
        _ => None,
    };
    if let Some(path) = &options.csv {
        let text = csv(&motion);
        if path.as_os_str() == "-" {
            return print_text(text.trim_end());
        }
        std::fs::write(path, text).map_err(|error| Failure::failed(format!("{}: {error}", path.display())))?;
    }
    if options.json {
        return print_json(&json!({
            "elapsed_ms": elapsed_ms, "peak_m_per_s2": motion.peak_m_per_s2(),
            "steady_peak_m_per_s2": motion.steady_peak_m_per_s2, "settled_s": settled_s, "error_bound": null,
            "time_s": motion.time_s,
            "displacement_m": motion.displacement_m, "acceleration_m_per_s2": motion.acceleration_m_per_s2,
        }));
    }
    let settled = match (settled_s, drives.len()) {
        (Some(settled), _) => format!("\nwithin 10 % of the steady state from {:.1} ms on", settled * 1e3),
        (None, 1) => "\nnot settled within this time, or too few steps in a period to tell".into(),
        (None, _) => String::new(),
    };
    print_text(&format!(
        "{} times, {elapsed_ms:.0} ms\nlargest acceleration {:.4} m/s^2, in the steady state {:.4} m/s^2{settled}",
        motion.time_s.len(),
        motion.peak_m_per_s2(),
        motion.steady_peak_m_per_s2,
    ))
}

fn drive(scene: &Scene, text: &DriveText) -> Result<Drive, Failure> {
    let known = || scene.actuators.iter().map(|actuator| actuator.id.as_str()).collect::<Vec<_>>().join(", ");
    let actuator = scene.actuators.iter().position(|actuator| actuator.id == text.actuator).ok_or_else(|| {
        Failure::usage(format!("--drive: {:?} is not an actuator of the scene ({})", text.actuator, known()))
    })?;
    let within = |what: &str, value: f64, min: f64, max: f64| {
        if (min..=max).contains(&value) {
            return Ok(value);
        }
        Err(Failure::usage(format!("--drive: {what} {value} is not in the allowed range {min} to {max}")))
    };
    Ok(Drive {
        actuator,
        frequency_hz: within("frequency in Hz", text.frequency_hz, 1e-3, 20_000.0)?,
        force_n: within("force in N", text.force_n, 0.0, 1e6)?,
        phase_rad: text.phase_deg.to_radians(),
    })
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked before")]
fn grid(options: &Transient) -> Result<TimeGrid, Failure> {
    let (duration, step) = (options.duration, options.step);
    if !(step > 0.0 && step.is_finite()) {
        return Err(Failure::usage(format!("--step {step} is not in the allowed range above 0 s")));
    }
    let count = (duration / step + 1e-9).floor() + 1.0;
    if !(duration > 0.0 && count <= MOST_TIMES) {
        let most = MOST_TIMES * step;
        return Err(Failure::usage(format!(
            "--duration {duration} is not in the allowed range above 0 to {most} s ({MOST_TIMES} steps)"
        )));
    }
    Ok(TimeGrid { step_s: step, count: count as usize })
}

fn csv(motion: &Motion) -> String {
    let mut text = String::from("time_s,displacement_m,acceleration_m_per_s2\n");
    for ((time, displacement), acceleration) in
        motion.time_s.iter().zip(&motion.displacement_m).zip(&motion.acceleration_m_per_s2)
    {
        let _ = writeln!(text, "{time},{displacement:e},{acceleration:e}");
    }
    text
}
