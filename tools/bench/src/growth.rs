//! (b): how time and memory grow.

use crate::case::{CaseOutcome, run_case_in_child_process};
use crate::clock::compute_median;
use crate::environment::Environment;
use crate::error::Error;
use crate::fit;
use crate::problem::{MAX_HZ, Problem, make_lightly_damped_plate_toml};
use crate::table::{Table, format_bytes, format_three_digits, format_time};
use std::fmt::Write;
use std::path::Path;

/// Part of the free memory that one case may be expected to take: other programs want some too.
const MOST_MEMORY: f64 = 0.5;
/// Numbers of unknowns, about.
const UNKNOWNS: [f64; 7] = [1e3, 3e3, 1e4, 3e4, 1e5, 3e5, 1e6];
/// Orders of elements: cubic ones, and those that tolerances of 1e-3 start with.
const ORDERS: [usize; 2] = [3, 7];
/// The mesh on which modes, actuators and frequencies are varied: right to 1e-3 up to 4 kHz.
const CELL_M: f64 = 0.05;

/// Measures the growth of time and memory with the number of unknowns, as long as a size is expected to take no more
/// than `longest_s`.
///
/// # Errors
/// Those of the cases, [`Error::File`].
pub fn build_table_of_growth_with_unknowns(
    environment: &Environment,
    problem: &Problem,
    longest_s: f64,
) -> Result<Table, Error> {
    let columns = ["order", "unknowns", "mesh and factors", "modes", "coordinates", "total", "peak memory"];
    let mut table = Table::new("(b) Growth: unknowns", &columns);
    table.above.push(String::from(
        "The scene is the starting plate with a loss factor of 0.005. The mesh has regular cells, and the modes and \
         residual shapes are for 50 to 1000 Hz. Each size runs in a process of its own. Below the table, the growth of \
         time and memory is given as a power of the number of unknowns. This power follows from the two largest sizes.",
    ));
    let scene = write_plate_scene_with_actuators(environment, 2)?;
    let surface = &problem.scene.surface;
    for order in ORDERS {
        let (mut times, mut peaks) = (Vec::new(), Vec::new());
        for wanted in UNKNOWNS {
            // Functions along a side: order - 1 for each cell.
            #[expect(clippy::cast_precision_loss, reason = "a dozen")]
            let cell_m = (order - 1) as f64 * (surface.length_m * surface.width_m / wanted).sqrt();
            if let (Some(time_s), Some(peak)) =
                (fit::evaluate_power_law(&times, wanted), fit::evaluate_power_law(&peaks, wanted))
            {
                let free = read_available_memory_bytes()?;
                if time_s > longest_s || peak > MOST_MEMORY * free {
                    table.below.push(format!(
                        "Order {order} ends here: {wanted:.0e} unknowns would take about {} and {} (limits of this \
                         measurement: {}, and half of the {} that are free).",
                        format_time(time_s),
                        format_bytes(peak),
                        format_time(longest_s),
                        format_bytes(free)
                    ));
                    break;
                }
            }
            let outcome = run_mesh_case_with_median_times(environment, &scene, order, cell_m, MAX_HZ, 2)?;
            #[expect(clippy::cast_precision_loss, reason = "a million at most")]
            let unknowns = outcome.unknowns as f64;
            times.push((unknowns, outcome.mesh_s + outcome.modes_s));
            peaks.push((unknowns, outcome.peak_bytes));
            table.add_row([
                order.to_string(),
                outcome.unknowns.to_string(),
                format_time(outcome.mesh_s),
                format_time(outcome.modes_s),
                outcome.coordinates.to_string(),
                format_time(outcome.mesh_s + outcome.modes_s),
                format_bytes(outcome.peak_bytes),
            ]);
        }
        if let (Some(time), Some(memory)) =
            (compute_power_law_exponent_of_last_two(&times), compute_power_law_exponent_of_last_two(&peaks))
        {
            table.below.push(format!(
                "For order {order}, the time grows with the power {} of the number of unknowns, and the memory with \
                 the power {}.",
                format_three_digits(time),
                format_three_digits(memory)
            ));
        }
    }
    Ok(table)
}

/// Measures the growth of time with modes, actuators and frequencies.
///
/// # Errors
/// Those of the cases, [`Error::File`].
pub fn build_table_of_growth_with_modes_actuators_and_frequencies(environment: &Environment) -> Result<Table, Error> {
    let columns = ["varied", "value", "unknowns", "coordinates", "mesh and factors", "modes", "sweep", "per frequency"];
    let mut table = Table::new("(b) Growth: modes, actuators, frequencies", &columns);
    table.above.push(format!(
        "The scene is the starting plate with a loss factor of 0.005, elements of order 7 and cells of {} mm. Each row \
         varies one property. \"Coordinates\" is the number of modes and residual shapes. \"Sweep\" is the time for \
         the coordinates of all actuators at all frequencies. Times are medians.",
        CELL_M * 1e3
    ));
    let two = write_plate_scene_with_actuators(environment, 2)?;
    let mut add_row = |varied: &str, value: String, outcome: &CaseOutcome, frequencies: usize| {
        #[expect(clippy::cast_precision_loss, reason = "ten thousand")]
        let each = outcome.sweep_s / frequencies as f64;
        table.add_row([
            String::from(varied),
            value,
            outcome.unknowns.to_string(),
            outcome.coordinates.to_string(),
            format_time(outcome.mesh_s),
            format_time(outcome.modes_s),
            format_time(outcome.sweep_s),
            format_time(each),
        ]);
    };
    for max_hz in [250.0, 500.0, 1000.0, 2000.0, 4000.0] {
        let outcome = run_mesh_case_with_median_times(environment, &two, 7, CELL_M, max_hz, 1000)?;
        add_row("band up to", format!("{max_hz} Hz"), &outcome, 1000);
    }
    for count in 1..=4 {
        let scene = write_plate_scene_with_actuators(environment, count)?;
        let outcome = run_mesh_case_with_median_times(environment, &scene, 7, CELL_M, MAX_HZ, 1000)?;
        add_row("actuators", count.to_string(), &outcome, 1000);
    }
    for frequencies in [100, 1000, 10_000] {
        let outcome = run_mesh_case_with_median_times(environment, &two, 7, CELL_M, MAX_HZ, frequencies)?;
        add_row("frequencies", frequencies.to_string(), &outcome, frequencies);
    }
    Ok(table)
}

fn compute_power_law_exponent_of_last_two(pairs: &[(f64, f64)]) -> Option<f64> {
    let [.., (x0, y0), (x1, y1)] = pairs else { return None };
    Some((y1 / y0).ln() / (x1 / x0).ln())
}

/// Runs one mesh, a small one several times, with the medians of its times.
fn run_mesh_case_with_median_times(
    environment: &Environment,
    scene: &Path,
    order: usize,
    cell_m: f64,
    max_hz: f64,
    frequencies: usize,
) -> Result<CaseOutcome, Error> {
    let options = [
        ("--cell-m", cell_m.to_string()),
        ("--order", order.to_string()),
        ("--max-hz", max_hz.to_string()),
        ("--frequencies", frequencies.to_string()),
    ];
    let first = run_case_in_child_process(environment, "mesh", scene, &options)?;
    // Above a second the noise is small against it.
    let more = if first.elapsed_s > 1.0 || environment.quick { 0 } else { 4 };
    let mut all = vec![first];
    for _ in 0..more {
        all.push(run_case_in_child_process(environment, "mesh", scene, &options)?);
    }
    let median_of = |what: fn(&CaseOutcome) -> f64| compute_median(all.iter().map(what).collect());
    let (mesh_s, modes_s, sweep_s) = (median_of(|o| o.mesh_s), median_of(|o| o.modes_s), median_of(|o| o.sweep_s));
    Ok(CaseOutcome { mesh_s, modes_s, sweep_s, ..all.swap_remove(0) })
}

/// Writes a scene file of the starting plate with 1 to 4 actuators: its own two, and two more placed off its centre
/// lines.
fn write_plate_scene_with_actuators(environment: &Environment, actuators: usize) -> Result<std::path::PathBuf, Error> {
    const BLOCK: &str = "[[actuator]]";
    let text = make_lightly_damped_plate_toml()?;
    let mut parts = text.split(BLOCK);
    let mut out = String::from(parts.next().ok_or(Error::Scene(BLOCK))?);
    let own: Vec<&str> = parts.collect();
    let pattern = own.first().ok_or(Error::Scene(BLOCK))?;
    let more = [("third", 120.0, 40.0), ("fourth", 190.0, 155.0)].map(|(id, x_mm, y_mm)| {
        let replace_value = |line: &str| match line.split('=').next().map(str::trim) {
            Some("id") => format!("id = \"{id}\""),
            Some("x_mm") => format!("x_mm = {x_mm:?}"),
            Some("y_mm") => format!("y_mm = {y_mm:?}"),
            _ => String::from(line),
        };
        pattern.lines().map(replace_value).collect::<Vec<_>>().join("\n")
    });
    for block in own.iter().copied().chain(more.iter().map(String::as_str)).take(actuators) {
        let _ = writeln!(out, "{BLOCK}{block}");
    }
    let path = environment.scratch.join(format!("plate-{actuators}.toml"));
    std::fs::write(&path, out).map_err(Error::file_error(&path))?;
    Ok(path)
}

/// Memory that programs may still take; infinite if the kernel does not say.
fn read_available_memory_bytes() -> Result<f64, Error> {
    let path = Path::new("/proc/meminfo");
    let text = std::fs::read_to_string(path).map_err(Error::file_error(path))?;
    let line = text.lines().find(|line| line.starts_with("MemAvailable:"));
    let kilobytes = line.and_then(|line| line.split_whitespace().nth(1)).and_then(|value| value.parse::<f64>().ok());
    Ok(kilobytes.map_or(f64::INFINITY, |kilobytes| kilobytes * 1024.0))
}
