//! `era field --reach` and `era field --schemes`: what a panel's actuators can do at all.

use super::args::Field;
use super::panel::{need_actuators, plan_table};
use super::progress::with_progress;
use super::{Failure, Outcome, print_json, print_text};
use crate::planner::reach::{Maps, SchemeReach, Spread, schemes};
use crate::planner::{MIN_SPACING_HZ, PlanTable};
use crate::study::reach as pictures;
use serde_json::json;
use std::fmt::Write;

/// Maps of the strongest and the most contrasted reachable at every point.
pub fn maps(options: &Field) -> Outcome {
    let scene = options.panel.load()?;
    need_actuators(&scene)?;
    let table = restricted(plan_table(&options.panel, options.keep, &scene)?, options)?;
    let maps = with_progress("computing what can be reached", || Maps::of(&table))?;
    if let Some(path) = &options.png {
        pictures::write_maps(path, &scene, &maps).map_err(Failure::failed)?;
    }
    if let Some(path) = &options.csv {
        if path.as_os_str() == "-" {
            return print_text(maps.csv().trim_end());
        }
        std::fs::write(path, maps.csv()).map_err(|error| Failure::failed(format!("{}: {error}", path.display())))?;
    }
    let spread = |values: &[Option<f64>]| {
        Spread::of(&table.grid, values).ok_or_else(|| Failure::failed("the grid has no point on the surface"))
    };
    let (strongest, contrast) = (spread(&maps.strongest_g)?, spread(&maps.contrast_db)?);
    if options.json {
        return print_json(&json!({"strongest_g": strongest, "contrast_db": contrast, "maps": maps}));
    }
    let line = |name: &str, unit: &str, spread: &Spread| {
        format!(
            "{name}: least {:.2} {unit} at {}, median {:.2} {unit}, most {:.2} {unit} at {}",
            spread.least,
            place(spread.least_at_mm),
            spread.median,
            spread.most,
            place(spread.most_at_mm)
        )
    };
    print_text(&format!(
        "{}, {}\n{}\n{}",
        scene.name,
        searched(&table),
        line("strongest peak", "g", &strongest),
        line("contrast of the quietest drive", "dB", &contrast)
    ))
}

/// The three ways to drive, side by side.
pub fn compare(options: &Field) -> Outcome {
    let scene = options.panel.load()?;
    need_actuators(&scene)?;
    let table = restricted(plan_table(&options.panel, options.keep, &scene)?, options)?;
    let schemes = with_progress("comparing the ways to drive", || schemes::compare(&table))?;
    if let Some(path) = &options.png {
        pictures::write_schemes(path, &scene, &table.grid, &schemes).map_err(Failure::failed)?;
    }
    if let Some(path) = &options.csv {
        let text = csv(&table, &schemes);
        if path.as_os_str() == "-" {
            return print_text(text.trim_end());
        }
        std::fs::write(path, text).map_err(|error| Failure::failed(format!("{}: {error}", path.display())))?;
    }
    let [ratios, phases] = schemes::tried(&table);
    if options.json {
        return print_json(&json!({
            "scene": scene.name, "frequencies_hz": table.frequencies_hz,
            "tried": {"in_phase": ratios, "phases": phases}, "schemes": schemes,
        }));
    }
    let mut text = format!(
        "{}, {}, full safe force, peaks in g\n\
         (one frequency: best found of {ratios} amplitude ratios in phase and {phases} with phases at each frequency, then \
         refined; distinct frequencies: proven optimum)\n",
        scene.name,
        searched(&table)
    );
    let first = schemes.first();
    text.push_str("\none setting for the whole surface\n\n");
    text.push_str("| scheme | least | at | 10 % below | median | most | least, times the first |\n");
    text.push_str("|---|---|---|---|---|---|---|\n");
    for scheme in &schemes {
        let ratio = first.map_or(1.0, |first| scheme.one_setting.least / first.one_setting.least);
        let _ = writeln!(text, "{}", row(scheme, &scheme.one_setting, ratio));
    }
    text.push_str("\na setting for every touch\n\n");
    text.push_str("| scheme | least | at | 10 % below | median | most | least, times the first |\n");
    text.push_str("|---|---|---|---|---|---|---|\n");
    for scheme in &schemes {
        let ratio = first.map_or(1.0, |first| scheme.per_touch.least / first.per_touch.least);
        let _ = writeln!(text, "{}", row(scheme, &scheme.per_touch, ratio));
    }
    text.push_str("\nthe one settings\n\n| scheme | actuator | frequency | force | voltage | phase |\n|---|---|---|---|---|---|\n");
    for scheme in &schemes {
        for part in &scheme.setting {
            let _ = writeln!(
                text,
                "| {} | {} | {} Hz | {:.4} N | {:.0} V | {:.0}\u{b0} |",
                scheme.scheme.name(),
                part.actuator,
                part.frequency_hz,
                part.force_n,
                part.voltage_v,
                part.phase_rad.to_degrees()
            );
        }
        if let Some(at_most) = scheme.one_setting_at_most.filter(|most| *most > scheme.one_setting.least * (1.0 + 1e-6))
        {
            let _ = writeln!(
                text,
                "(the search was cut short: up to {at_most:.4} g may be possible with {})",
                scheme.scheme.name()
            );
        }
    }
    print_text(text.trim_end())
}

fn row(scheme: &SchemeReach, spread: &Spread, ratio: f64) -> String {
    format!(
        "| {} | {:.3} | {} | {:.3} | {:.3} | {:.3} | {ratio:.2} |",
        scheme.scheme.name(),
        spread.least,
        place(spread.least_at_mm),
        spread.tenth,
        spread.median,
        spread.most
    )
}

fn place([x_mm, y_mm]: [f64; 2]) -> String {
    format!("{x_mm:.0} mm, {y_mm:.0} mm")
}

/// The table without the frequencies that `--from` and `--to` leave out.
fn restricted(table: PlanTable, options: &Field) -> Result<PlanTable, Failure> {
    let (from, to) = (options.from.unwrap_or(0.0), options.to.unwrap_or(f64::INFINITY));
    let known = table.frequencies_hz.first().copied().zip(table.frequencies_hz.last().copied());
    table.between(from, to).ok_or_else(|| {
        let (least, most) = known.unwrap_or_default();
        Failure::usage(format!(
            "--from {from} --to {to}: none of the planner's frequencies, {least} to {most} Hz, is between them"
        ))
    })
}

/// The grids that were searched.
fn searched(table: &PlanTable) -> String {
    let there = table.grid.there.iter().filter(|there| **there).count();
    match (table.frequencies_hz.first(), table.frequencies_hz.last()) {
        (Some(from), Some(to)) => format!(
            "{there} points, {} frequencies from {from} to {to} Hz, at least {MIN_SPACING_HZ} Hz apart",
            table.frequencies_hz.len()
        ),
        _ => format!("{there} points"),
    }
}

/// Lines of `x_mm,y_mm` and for each scheme the peak with one setting and with the best for the touch, in g.
fn csv(table: &PlanTable, schemes: &[SchemeReach]) -> String {
    let mut text = String::from("x_mm,y_mm");
    for number in 1..=schemes.len() {
        let _ = write!(text, ",one_setting_{number}_g,per_touch_{number}_g");
    }
    text.push('\n');
    let places = table.grid.y_m.iter().flat_map(|y| table.grid.x_m.iter().map(move |x| (x, y)));
    for (point, (x, y)) in places.enumerate() {
        let _ = write!(text, "{:.3},{:.3}", x * 1e3, y * 1e3);
        for scheme in schemes {
            for values in [&scheme.one_setting_g, &scheme.per_touch_g] {
                let cell = values.get(point).copied().flatten().map_or_else(String::new, |value| format!("{value:.4}"));
                let _ = write!(text, ",{cell}");
            }
        }
        text.push('\n');
    }
    text
}
