//! `era field --reach` and `era field --schemes`: what a panel's actuators can do at all.

use super::args_field::{Corners, Field};
use super::output::write_text_file_atomically;
use super::panel::{check_has_actuators, load_or_compute_plan_table};
use super::progress::run_with_progress;
use super::terminal_messages::tell;
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::maps::reach as pictures;
use crate::model::BarePanel;
use crate::planner::maps::{ReachMaps, Scheme, SchemeReach, Spread, rigid, schemes};
use crate::planner::perception::threshold_multiple_to_db_unless_at_rest;
use crate::planner::reach::Measure;
use crate::planner::table::touched::TouchedPanel;
use crate::planner::table::{PointView, Region};
use crate::planner::{MIN_SPACING_HZ, PlanTable, TableOptions};
use crate::scene::Scene;
use serde_json::json;
use std::fmt::Write;
use std::path::Path;

/// Part of a setting's motion from which on it counts as that of a rigid body.
const RIGID: f64 = 0.5;

/// How a scheme does in one of the ways to choose settings: its peaks, and the part of the surface that is weaker than with
/// distinct frequencies.
type FigureOfScheme = fn(&SchemeReach) -> (&Spread, f64);

/// Maps of the strongest and the most contrasted reachable at every point.
pub fn compute_and_write_reach_maps(options: &Field) -> CommandResult {
    let (scene, table, region) = prepare_scene_table_and_region(options)?;
    let maps = match scene.finger {
        None => run_with_progress("computing the largest peaks and contrasts", || ReachMaps::compute(&table, region))?,
        Some(_) => compute_reach_maps_with_finger_on_each_point(options, &scene, &table, region)?,
    };
    if let Some(path) = &options.png {
        tell_picture_written(
            path,
            pictures::write_reach_maps_png(path, &scene, &maps).map_err(Failure::runtime_error)?,
        );
    }
    if write_csv_if_asked_true_if_to_stdout(options, &maps.to_csv())? {
        return Ok(());
    }
    let spread = |values: &[Option<f64>]| {
        Spread::compute(&table.grid, values).ok_or_else(|| {
            Failure::runtime_error(
                "the map has no value at any point of the surface, so it has no weakest or strongest place",
            )
        })
    };
    let strongest = spread(&maps.strongest_g)?;
    // With a finger there is none.
    let contrast = scene.finger.is_none().then(|| spread(&maps.contrast_db)).transpose()?;
    if options.json {
        return print_json(&json!({"strongest_g": strongest, "contrast_db": contrast, "maps": maps}));
    }
    let line = |name: &str, unit: &str, spread: &Spread, hz: &[Option<Vec<f64>>], [least, most]: [&str; 2]| {
        let end = |value: f64, at_mm: [f64; 2], which: &str| {
            let place = format_place(at_mm);
            let at = describe_frequencies_if_exactly_on_grid_point(&table, hz, at_mm)
                .map_or_else(|| place.clone(), |frequencies| format!("{place}; {frequencies}"));
            format!("{value:.2} {unit} at the {which} place ({at})")
        };
        format!(
            "{name}: {}, median {:.2} {unit}, {}",
            end(spread.least, spread.least_at_mm, least),
            spread.median,
            end(spread.most, spread.most_at_mm, most)
        )
    };
    let mut text = format!("{}, {}\n", scene.name, describe_searched_zone_and_frequencies(&table, options));
    text.push_str(&line("reach", "g", &strongest, &maps.strongest_hz, ["weakest", "strongest"]));
    if let Some(bound) = maps.error_bound.iter().flatten().next().filter(|_| scene.finger.is_some()) {
        let _ = write!(
            text,
            " (relative error of the peak at the weakest place at most {bound:.1e}; the bound is computed for this place \
             only)"
        );
    }
    if let Some(contrast) = contrast {
        let name = "highest contrast of a weak touch";
        let _ = write!(text, "\n{}", line(name, "dB", &contrast, &maps.contrast_hz, ["worst", "best"]));
    }
    print_text_after_queued_log(&text)
}

/// The maps with the scene's finger on each point while it is looked at.
fn compute_reach_maps_with_finger_on_each_point(
    options: &Field,
    scene: &Scene,
    table: &PlanTable,
    region: Option<Region>,
) -> Result<ReachMaps, Failure> {
    tell!(
        "the scene has a [finger], so each examined point is computed with the finger on this point; contrasts are not \
         computed, because each point would need its own plan, for the panel with the finger on this point"
    );
    let (accuracy, grid) = (options.panel.accuracy()?, TableOptions::default());
    run_with_progress("computing the largest peaks with a finger on each point", || -> Result<ReachMaps, Failure> {
        let panel = BarePanel::build(scene, accuracy, grid.to_hz)?;
        Ok(ReachMaps::compute_with_finger_and_error_bound_of_weakest_point(
            table,
            region,
            TouchedPanel::new(&panel, scene, table),
            accuracy,
            grid,
        )?)
    })
}

/// The three ways to drive, side by side.
pub fn compare_drive_schemes_and_write_result(options: &Field) -> CommandResult {
    let (scene, table, region) = prepare_scene_table_and_region(options)?;
    if scene.finger.is_some() {
        tell!("the scene's [finger] is not used: drive schemes are compared on the panel without a finger");
    }
    let measure = if options.felt { Measure::Thresholds } else { Measure::G };
    let schemes = run_with_progress("comparing drive schemes", || schemes::compare_schemes(&table, region, measure))?;
    if let Some(path) = &options.png {
        let written = pictures::write_schemes_png(path, &scene, &table.grid, measure, &schemes);
        tell_picture_written(path, written.map_err(Failure::runtime_error)?);
    }
    if write_csv_if_asked_true_if_to_stdout(options, &format_schemes_csv(&table, measure, &schemes))? {
        return Ok(());
    }
    let [ratios, phases] = schemes::count_trial_force_ratios_in_phase_and_with_phases(&table);
    let first_bending_hz = rigid::first_bending_mode_moving_surface_if_any_hz(&table);
    if options.json {
        return print_json(&json!({
            "scene": scene.name, "measure": measure, "frequencies_hz": table.frequencies_hz,
            "first_bending_hz": first_bending_hz, "tried": {"in_phase": ratios, "phases": phases}, "schemes": schemes,
        }));
    }
    let unit = if options.felt { "dB above the threshold of feeling" } else { "g" };
    let mut text = format!(
        "{}, {}. All schemes use the largest safe forces. Peaks are in {unit}.\n\
         (For the scheme \"one frequency, in phase\", the program tries {ratios} amplitude ratios at each frequency; \
         for the scheme \"one frequency, phases chosen\", {phases} combinations of amplitudes and phases at each \
         frequency. Then the program searches near the best of them. For the scheme \"distinct frequencies\", the \
         setting is the best possible one if the air gaps stay as wide as at rest. If the program \
         cannot prove that the setting is the best possible one, a line below says so.)\n",
        scene.name,
        describe_searched_zone_and_frequencies(&table, options)
    );
    let spreads: [(&str, FigureOfScheme); 2] = [
        ("one setting for the whole surface", |scheme| (&scheme.one_setting, scheme.one_setting_weaker)),
        ("a setting for every touch", |scheme| (&scheme.per_touch, scheme.per_touch_weaker)),
    ];
    for (title, of) in spreads {
        let _ = write!(
            text,
            "\n{title}\n\n| scheme | lowest | at | 10th percentile | median | highest | dead | weaker | \
             lowest, relative to the first scheme |\n\
             |---|---|---|---|---|---|---|---|---|\n"
        );
        for scheme in &schemes {
            let (spread, weaker) = of(scheme);
            let first = schemes.first().map_or(spread.least, |first| of(first).0.least);
            let _ = writeln!(text, "{}", format_scheme_row(scheme.scheme, measure, spread, weaker, first));
        }
    }
    text.push_str(
        "\n(10th percentile: 10 % of the surface has a lower peak; dead: percentage of the surface with a peak below a \
         tenth of the largest peak; weaker: percentage of the surface with a peak below the lowest peak \
         of the scheme with distinct frequencies)\n",
    );
    text.push_str(&format_scheme_settings(&schemes, measure));
    text.push_str(&describe_first_bending_mode_and_why_one_frequency_wins_if_so(&schemes, first_bending_hz));
    print_text_after_queued_log(text.trim_end())
}

/// What is commanded for the whole surface.
fn format_scheme_settings(schemes: &[SchemeReach], measure: Measure) -> String {
    let mut text = String::from(
        "\nthe settings for the whole surface\n\n| scheme | actuator | frequency | force | voltage | pulse width | phase | rigid motion |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for scheme in schemes {
        let rigid = scheme.rigid.map_or_else(String::new, format_fraction_as_percent);
        for part in &scheme.setting {
            let _ = writeln!(
                text,
                "| {} | {} | {} Hz | {:.4} N | {:.0} V | {:.3} | {:.0}\u{b0} | {rigid} |",
                scheme.scheme.name(),
                part.drive.actuator,
                part.drive.frequency_hz,
                part.drive.force_n,
                part.drive.voltage_v,
                part.drive.pulse_width,
                part.drive.phase_rad.to_degrees()
            );
        }
    }
    for scheme in schemes {
        if scheme.scale < 1.0 {
            let left = format_fraction_as_percent(scheme.scale);
            let _ = writeln!(
                text,
                "({}: all forces are reduced to {left} of the values computed at the rest gaps; the moving masses \
                 narrow the gaps, and larger forces would exceed a limit)",
                scheme.scheme.name()
            );
        }
        let at_most = scheme.one_setting_at_most.filter(|most| *most > scheme.one_setting.least * (1.0 + 1e-6));
        if let Some(at_most) = at_most {
            let at_most = format_peak_without_unit_in_g_or_db(measure, at_most);
            let unit = if measure == Measure::G { "g" } else { "dB" };
            let _ = writeln!(
                text,
                "({}: a lowest peak of up to {at_most} {unit} may be possible, but this is not proven)",
                scheme.scheme.name()
            );
        }
    }
    text
}

/// Why the weakest place is as strong as it is.
fn describe_first_bending_mode_and_why_one_frequency_wins_if_so(
    schemes: &[SchemeReach],
    first_bending_hz: Option<f64>,
) -> String {
    let mut text = String::new();
    if let Some(hz) = first_bending_hz {
        let _ = write!(text, "\nFirst mode that bends the panel: {hz:.1} Hz.");
    }
    let distinct = schemes.iter().find(|scheme| scheme.scheme == Scheme::DistinctFrequencies);
    let better = |scheme: &&SchemeReach| {
        distinct.is_some_and(|distinct| scheme.one_setting.least > distinct.one_setting.least)
            && scheme.rigid.is_some_and(|rigid| rigid > RIGID)
    };
    if let Some(scheme) = schemes.iter().find(better) {
        let hz = scheme.setting.first().map_or(0.0, |part| part.drive.frequency_hz);
        let _ = write!(
            text,
            "\nFor this scene, one frequency gives a higher lowest peak than distinct frequencies: at {hz} Hz, {} \
             of the motion (mean square) is the motion of a rigid body, which has no nodes. At this frequency, the motions \
             of all actuators add in phase; of distinct frequencies, at least {MIN_SPACING_HZ} Hz apart, only one can be \
             near this frequency. `--from {:.0}` excludes the rigid motion.",
            format_fraction_as_percent(scheme.rigid.unwrap_or_default()),
            first_bending_hz.unwrap_or(hz).ceil()
        );
    }
    text
}

fn format_fraction_as_percent(fraction: f64) -> String {
    format!("{:.1} %", 100.0 * fraction)
}

/// A peak as it is printed: in g, or in dB above the threshold.
fn format_peak_without_unit_in_g_or_db(measure: Measure, peak: f64) -> String {
    match measure {
        Measure::G => format!("{peak:.3}"),
        Measure::Thresholds => threshold_multiple_to_db_unless_at_rest(peak)
            .map_or_else(|| String::from("no motion"), |db| format!("{db:.1}")),
    }
}

fn format_scheme_row(
    scheme: Scheme,
    measure: Measure,
    spread: &Spread,
    weaker_fraction: f64,
    first_least: f64,
) -> String {
    let ratio = spread.least / first_least;
    format!(
        "| {} | {} | {} | {} | {} | {} | {} | {} | {} |",
        scheme.name(),
        format_peak_without_unit_in_g_or_db(measure, spread.least),
        format_place(spread.least_at_mm),
        format_peak_without_unit_in_g_or_db(measure, spread.tenth),
        format_peak_without_unit_in_g_or_db(measure, spread.median),
        format_peak_without_unit_in_g_or_db(measure, spread.most),
        format_fraction_as_percent(spread.dead),
        format_fraction_as_percent(weaker_fraction),
        match measure {
            Measure::G => format!("{ratio:.2}"),
            Measure::Thresholds => format!("{:+.1} dB", 20.0 * ratio.log10()),
        }
    )
}

pub(super) fn format_place([x_mm, y_mm]: [f64; 2]) -> String {
    format!("{x_mm:.0} mm, {y_mm:.0} mm")
}

/// The frequencies at a point of the grid, in words.
fn describe_frequencies_if_exactly_on_grid_point(
    table: &PlanTable,
    hz: &[Option<Vec<f64>>],
    [x_mm, y_mm]: [f64; 2],
) -> Option<String> {
    let line = |lines: &[f64], at_mm: f64| lines.iter().position(|line| (line * 1e3 - at_mm).abs() < 1e-6);
    let point = line(&table.grid.y_m, y_mm)? * table.grid.x_m.len() + line(&table.grid.x_m, x_mm)?;
    let frequencies = hz.get(point)?.as_ref()?;
    Some(frequencies.iter().map(|hz| format!("{hz:.0}")).collect::<Vec<_>>().join(", ") + " Hz")
}

/// The scene, its table in the band that is asked for, and the region.
fn prepare_scene_table_and_region(options: &Field) -> Result<(Scene, PlanTable, Option<Region>), Failure> {
    let scene = options.panel.load_scene()?;
    check_has_actuators(&scene)?;
    let region = convert_zone_to_region(&scene, options.zone)?;
    let table = restrict_table_to_band(load_or_compute_plan_table(&options.panel, options.keep, &scene)?, options)?;
    PointView::try_new(&table, region).map_err(|error| Failure::usage_error(format!("--zone: {error}")))?;
    Ok((scene, table, region))
}

/// Converts the corners of `--zone` to a region of the surface of this scene.
pub(super) fn convert_zone_to_region(scene: &Scene, zone: Option<Corners>) -> Result<Option<Region>, Failure> {
    let Some(zone) = zone else { return Ok(None) };
    let metres = |[from, to]: [f64; 2]| [from / 1e3, to / 1e3];
    let region = Region::on_surface(scene, metres(zone.x), metres(zone.y));
    region.map(Some).map_err(|error| Failure::usage_error(format!("--zone: {error}")))
}

/// The table without the frequencies that `--from` and `--to` leave out.
fn restrict_table_to_band(table: PlanTable, options: &Field) -> Result<PlanTable, Failure> {
    table
        .restrict_to_band(options.from, options.to)
        .map_err(|error| Failure::usage_error(format!("--from {} --to {}: {error}", error.from_hz, error.to_hz)))
}

/// The grids that were searched.
fn describe_searched_zone_and_frequencies(table: &PlanTable, options: &Field) -> String {
    let within = options.zone.map_or_else(String::new, |zone| {
        format!("{} to {} mm by {} to {} mm, ", zone.x[0], zone.x[1], zone.y[0], zone.y[1])
    });
    match (table.frequencies_hz.first(), table.frequencies_hz.last()) {
        (Some(from), Some(to)) => format!(
            "{within}{} frequencies searched from {from} to {to} Hz; the frequencies of two actuators, if distinct, \
            differ by at least {MIN_SPACING_HZ} Hz",
            table.frequencies_hz.len()
        ),
        _ => within,
    }
}

/// Writes the text to the file of `--csv`, if there is one; returns whether the text went to standard output.
pub(super) fn write_csv_if_asked_true_if_to_stdout(options: &Field, text: &str) -> Result<bool, Failure> {
    let Some(path) = &options.csv else { return Ok(false) };
    if path.as_os_str() == "-" {
        return print_text_after_queued_log(text.trim_end()).map(|()| true);
    }
    write_text_file_atomically(path, text)?;
    tell!("wrote {}", path.display());
    Ok(false)
}

/// Says what picture was written.
pub fn tell_picture_written(path: &Path, (width, height): (u32, u32)) {
    tell!("wrote {}, {width} x {height} pixels", path.display());
}

/// Lines of `x_mm,y_mm` and for each scheme the peak with one setting and with the best for the touch, in g or dB above the
/// threshold (empty where nothing moves).
fn format_schemes_csv(table: &PlanTable, measure: Measure, schemes: &[SchemeReach]) -> String {
    let unit = match measure {
        Measure::G => "g",
        Measure::Thresholds => "db",
    };
    let mut text = String::from("x_mm,y_mm");
    for number in 1..=schemes.len() {
        let _ = write!(text, ",one_setting_{number}_{unit},per_touch_{number}_{unit}");
    }
    text.push('\n');
    let places = table.grid.y_m.iter().flat_map(|y| table.grid.x_m.iter().map(move |x| (x, y)));
    for (point, (x, y)) in places.enumerate() {
        let _ = write!(text, "{:.3},{:.3}", x * 1e3, y * 1e3);
        for scheme in schemes {
            for values in [&scheme.one_setting_field, &scheme.per_touch_field] {
                let cell = values.get(point).copied().flatten().and_then(|peak| match measure {
                    Measure::G => Some(format!("{peak:.4}")),
                    Measure::Thresholds => threshold_multiple_to_db_unless_at_rest(peak).map(|db| format!("{db:.2}")),
                });
                let _ = write!(text, ",{}", cell.unwrap_or_default());
            }
        }
        text.push('\n');
    }
    text
}
