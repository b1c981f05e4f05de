//! `era press`: what a finger's press does to the gaps of actuators.

use super::args::Press as Options;
use super::panel::{bound_text, plan_table};
use super::told::tell;
use super::{Outcome, print_json, print_text};
use crate::planner::PlanTable;
use crate::planner::press::{Pressed, Stop};
use std::fmt::Write;

pub fn run_press(options: &Options) -> Outcome {
    let mut scene = options.panel.load()?;
    if let Some(force_n) = options.force_n {
        scene.press_n = force_n;
    }
    let table = plan_table(&options.panel, options.keep, &scene)?;
    if options.json {
        describe_missing_bounds(&table).iter().for_each(|line| tell!("{line}"));
        return print_json(&crate::planner::press_report::report_press(&table));
    }
    print_text(&format_press(&table))
}

/// Why bounds are missing, and of whom.
fn describe_missing_bounds(table: &PlanTable) -> Vec<String> {
    let mut reasons: Vec<(&str, Vec<&str>)> = Vec::new();
    for (i, actuator) in table.scene.actuators.iter().enumerate() {
        let Some(reason) = crate::planner::press_bounds::bound_press_travel_error(table, i).reason_if_unknown() else {
            continue;
        };
        match reasons.iter_mut().find(|(known, _)| *known == reason) {
            Some((_, ids)) => ids.push(&actuator.id),
            None => reasons.push((reason, vec![&actuator.id])),
        }
    }
    let line = |(reason, ids): &(&str, Vec<&str>)| {
        format!("The error of how far the press alone moves {} is not known, because {reason}.", ids.join(" and "))
    };
    reasons.iter().map(line).collect()
}

fn format_press(table: &PlanTable) -> String {
    let mut text = format!(
        "{}: a press of {} N where it moves each mass furthest\n \
         actuator            at mm      alone   error at most      sag   error at most   held by            gap left   holds\n",
        table.scene.name, table.scene.press_n
    );
    for (i, (actuator, pressed)) in table.scene.actuators.iter().zip(&table.pressed).enumerate() {
        let Pressed { at_m, alone_m, sag_m, stop, stop_m, .. } = pressed;
        let held = match stop {
            Stop::None => "its springs".into(),
            Stop::Given => format!("stop, {:.0} um", stop_m * 1e6),
            Stop::Assumed => format!("no stop yet, {:.0} um", stop_m * 1e6),
        };
        let (bound, of_sag) = (
            bound_text(crate::planner::press_bounds::bound_press_travel_error(table, i)),
            bound_text(crate::planner::press_bounds::bound_sag_error(table, i)),
        );
        let electrodes = &table.electrodes[i];
        let at = format!("{:.1}, {:.1}", at_m.0 * 1e3, at_m.1 * 1e3);
        let _ = writeln!(
            text,
            " {:12} {at:>12} {:7.0} um {bound:>15} {:5.0} um {of_sag:>15}   {held:18} {:5.0} um {:5.0} V",
            actuator.id,
            alone_m * 1e6,
            sag_m * 1e6,
            electrodes.gap_left_m(0.0) * 1e6,
            electrodes.holds_v(0.0).min(electrodes.max_voltage_v),
        );
    }
    for line in describe_missing_bounds(table) {
        let _ = writeln!(text, "{line}");
    }
    text.push_str("Alone: without voltage and stop. Sag: with the electrodes' pull at the highest voltages. Holds: the voltage safe from breakdown there.");
    text
}
