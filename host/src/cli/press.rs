//! `era press`: what a finger's press does to the gaps of actuators.

use super::args_panel::Press as Options;
use super::panel::{format_bound_or_not_known, load_full_plan_table_or_compute_band_ends_only};
use super::terminal_messages::tell;
use super::{CommandResult, print_json, print_text_after_queued_log};
use crate::planner::PlanTable;
use crate::planner::press::{PressEffect, Stop};
use std::fmt::Write;

pub fn compute_and_print_actuator_gaps_under_finger_press(options: &Options) -> CommandResult {
    let mut scene = options.panel.load_scene()?;
    if let Some(force_n) = options.force_n {
        scene.press_n = force_n;
    }
    let table = load_full_plan_table_or_compute_band_ends_only(&options.panel, options.keep, &scene)?;
    if options.json {
        describe_missing_press_error_bounds_by_reason(&table).iter().for_each(|line| tell!("{line}"));
        return print_json(&crate::planner::press_report::build_press_report(&table));
    }
    print_text_after_queued_log(&format_press_travel_per_actuator(&table))
}

/// Why bounds are missing, and of whom.
fn describe_missing_press_error_bounds_by_reason(table: &PlanTable) -> Vec<String> {
    let mut reasons: Vec<(&str, Vec<&str>)> = Vec::new();
    for (i, actuator) in table.scene.actuators.iter().enumerate() {
        let Some(reason) = crate::planner::press_bounds::bound_relative_mesh_error_of_travel_by_press_alone(table, i)
            .reason_if_unknown()
        else {
            continue;
        };
        match reasons.iter_mut().find(|(known, _)| *known == reason) {
            Some((_, ids)) => ids.push(&actuator.id),
            None => reasons.push((reason, vec![&actuator.id])),
        }
    }
    let line = |(reason, ids): &(&str, Vec<&str>)| {
        let quoted: Vec<String> = ids.iter().map(|id| format!("{id:?}")).collect();
        let of = if quoted.len() == 1 { "actuator" } else { "actuators" };
        format!(
            "For the {of} {}, the error bound of the travel with no voltage and no stop is not known, because {reason}.",
            quoted.join(" and ")
        )
    };
    reasons.iter().map(line).collect()
}

fn format_press_travel_per_actuator(table: &PlanTable) -> String {
    let mut text = format!(
        "{}: for each actuator, the effect of a press of {} N at the point where the press moves the mass of this \
         actuator furthest\n\
         \x20actuator       x, y in mm      alone   error at most      sag   error at most  stop            \
         remaining gap safe up to\n",
        table.scene.name, table.scene.press_n
    );
    for (i, (actuator, pressed)) in table.scene.actuators.iter().zip(&table.pressed).enumerate() {
        let PressEffect { at_m, alone_m, sag_m, stop, stop_m, .. } = pressed;
        let held = match stop {
            Stop::None => "none needed".into(),
            Stop::Given => format!("at {:.0} um", stop_m * 1e6),
            Stop::Assumed => format!("assumed, {:.0} um", stop_m * 1e6),
        };
        let (bound, of_sag) = (
            format_bound_or_not_known(
                crate::planner::press_bounds::bound_relative_mesh_error_of_travel_by_press_alone(table, i),
            ),
            format_bound_or_not_known(
                crate::planner::press_bounds::bound_relative_mesh_error_of_sag_under_press_and_electrode_pull(table, i),
            ),
        );
        let electrodes = &table.electrodes[i];
        let at = format!("{:.1}, {:.1}", at_m.0 * 1e3, at_m.1 * 1e3);
        let _ = writeln!(
            text,
            " {:12} {at:>12} {:7.0} um {bound:>15} {:5.0} um {of_sag:>15}  {held:15} {:10.0} um {:8.0} V",
            actuator.id,
            alone_m * 1e6,
            sag_m * 1e6,
            electrodes.remaining_gap_under_press_m(0.0) * 1e6,
            electrodes.breakdown_voltage_of_remaining_gap_with_margin_v(0.0).min(electrodes.max_voltage_v),
        );
    }
    for line in describe_missing_press_error_bounds_by_reason(table) {
        let _ = writeln!(text, "{line}");
    }
    text.push_str(
        "Alone: travel of the mass with no voltage and no stop. Sag: travel with the stop and with the pull \
         of the electrodes at the highest voltages. Assumed: the scene has no stop for this mass, and plans assume \
         one. Safe up to: highest voltage, within the voltage limits of the scene, at which the air in the remaining \
         gap does not break down.",
    );
    text
}
