//! What was modelled, what was left out, and what each step cost and bought: `--explain`.

use crate::model::Accuracy;
use crate::model::bounded::RefinementLevel;
use crate::scene::{EdgeKind, Mount, Scene, SurfaceDamping, SurfaceKind};
use std::fmt::Write;

/// The scene's part of it.
fn describe_modelled_scene(scene: &Scene) -> String {
    let surface = &scene.surface;
    let mm = |m: f64| m * 1e3;
    let mut text = match surface.kind {
        SurfaceKind::Bar => {
            format!(
                "modelled: a beam (Euler-Bernoulli), {} x {} x {} mm; the deflection depends on x only",
                mm(surface.length_m),
                mm(surface.width_m),
                mm(surface.thickness_m)
            )
        }
        SurfaceKind::Plate => {
            format!(
                "modelled: a thin plate (Kirchhoff), {} x {} x {} mm",
                mm(surface.length_m),
                mm(surface.width_m),
                mm(surface.thickness_m)
            )
        }
    };
    let held = scene.edges.iter().filter(|edge| !matches!(edge.kind, EdgeKind::Elastic { .. })).count();
    let inertial = scene.actuators.iter().filter(|actuator| actuator.mount == Mount::Inertial).count();
    let lossy = scene.supports.iter().map(|support| support.loss_factor);
    let lossy =
        lossy.chain(scene.edges.iter().map(|edge| edge.kind.spring_loss_factor())).filter(|loss| *loss > 0.0).count();
    let biased = scene.actuators.iter().filter(|actuator| actuator.bias_voltage_v > 0.0).count();
    let charging = scene.actuators.iter().filter(|actuator| !actuator.charging.is_instant()).count();
    let parts = [
        (surface.layers.len(), "layers (classical laminate theory)"),
        (scene.patches.len(), "patches of other thickness or material"),
        (scene.cutouts.len(), "cut-outs"),
        (scene.supports.len(), "point supports"),
        (held, "pinned or clamped edges"),
        (scene.edges.len() - held, "elastic edges"),
        (lossy, "supports and edges with a loss factor"),
        (scene.masses.len(), "attached masses"),
        (inertial, "inertial actuators, each with one unknown for the motion of its mass"),
        (scene.actuators.len() - inertial, "grounded actuators"),
        (biased, "actuators softened by a bias voltage"),
        (charging, "actuators whose electrodes charge through resistors"),
    ];
    for (count, what) in parts.into_iter().filter(|(count, _)| *count > 0) {
        let _ = write!(text, ", {count} {what}");
    }
    if let Some(stiffness) = scene.sealed_air_stiffness_if_any_n_per_m() {
        let _ = write!(text, ", sealed air with a stiffness of {stiffness:.3e} N/m against the mean deflection");
    }
    if surface.added_mass_kg_per_m2 > 0.0 {
        let _ = write!(text, ", {} kg/m^2 of air that moves with the surface", surface.added_mass_kg_per_m2);
    }
    text.push_str(match surface.damping {
        SurfaceDamping::None => ", no damping of the surface",
        SurfaceDamping::LossFactor(_) => ", hysteretic damping of the surface",
        SurfaceDamping::ModalRatio(ratio) if ratio.is_same_for_all_modes() => {
            ", the same damping ratio on every mode of the surface"
        }
        SurfaceDamping::ModalRatio(_) => {
            ", on every mode of the surface a damping ratio that depends on the frequency of the mode"
        }
        SurfaceDamping::Rayleigh { .. } => ", Rayleigh damping of the surface",
    });
    text
}

/// The whole text.
#[must_use]
pub fn explain_model_scope_and_mesh_accuracy(scene: &Scene, accuracy: Accuracy, steps: &[RefinementLevel]) -> String {
    let mut text = describe_modelled_scene(scene);
    text.push_str(
        "\nnot modelled: shear and rotary inertia, stretching in the plane, the air except where it is listed above, \
         the finger except at a touched place, the effect of the voltage of an actuator on its stiffness except the effect of \
         bias_voltage_v; residual shapes of the actuators, the dampers and the requested point replace the modes \
         above the computed modes",
    );
    let _ = write!(
        text,
        "\nmeshes (order: order of the elements; cells: along x and y; point forces: functions for point forces; stiff \
         points: points whose deflection is an unknown; known modes: rigid and slow modes known before the iteration)\n \
         order  cells    unknowns  point forces  stiff points  known modes      time   error at most"
    );
    for step in steps {
        let bound = if step.bound.is_finite() { format!("{:.0e}", step.bound) } else { String::from("not known") };
        let cells = format!("{}x{}", step.parts.cells[0], step.parts.cells[1]);
        let _ = write!(
            text,
            "\n{:6}  {cells:8} {:8}  {:12}  {:12}  {:11}  {:6.1} ms   {bound}",
            step.fineness.order,
            step.dofs,
            step.parts.point_functions,
            step.parts.stiff_points,
            step.parts.known_modes,
            step.elapsed_ms,
        );
    }
    let total: f64 = steps.iter().map(|step| step.elapsed_ms).sum();
    let tolerance = accuracy.relative_tolerance_or_tightest();
    let best = steps.iter().map(|step| step.bound).reduce(f64::min);
    let _ = match best {
        Some(bound) if accuracy.time_limit().is_some() && bound.is_finite() => {
            write!(text, "\nerror bound {bound:.0e} reached within the allowed time, total time {total:.1} ms")
        }
        Some(bound) if bound <= tolerance => write!(text, "\ntolerance {tolerance:.0e} met, total time {total:.1} ms"),
        // A table of plans: each plan has its own.
        Some(f64::INFINITY) => write!(text, "\ntotal time {total:.1} ms; each answer has its own error bound"),
        _ => write!(text, "\ntolerance {tolerance:.0e} not met by the finest mesh, total time {total:.1} ms"),
    };
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::compute_modes_with_error_bounds;

    #[test]
    fn every_step_and_every_part_is_reported() {
        let scene = Scene::parse("bar", crate::scene::EXAMPLE_BAR).unwrap();
        let found = compute_modes_with_error_bounds(&scene, Accuracy::BALANCED, 300.0).unwrap();
        let text = explain_model_scope_and_mesh_accuracy(&scene, Accuracy::BALANCED, &found.steps);
        for piece in ["a beam", "2 grounded actuators", "hysteretic", "not modelled: shear", "tolerance 1e-3 met"] {
            assert!(text.contains(piece), "{piece:?} is not in {text}");
        }
        assert_eq!(text.lines().count(), 2 + 2 + found.steps.len() + 1, "{text}");
        let mut lossy = scene.clone();
        lossy.supports.extend(Scene::parse("plate", crate::scene::STARTING_PLATE).unwrap().supports);
        lossy.supports[1].loss_factor = 0.3;
        let text_of_lossy = explain_model_scope_and_mesh_accuracy(&lossy, Accuracy::BALANCED, &found.steps);
        assert!(text_of_lossy.contains(", 1 supports and edges with a loss factor"), "{text_of_lossy}");
        assert!(!text.contains("loss factor"), "{text}");
        let last = found.steps.last().unwrap();
        assert!(text.contains(&format!("{:6}  ", last.fineness.order)) && text.contains(&last.dofs.to_string()));
    }
}
