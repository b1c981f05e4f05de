//! Designs of one panel: how many a second the quick look of studies does, how far it is from a thorough one, and how both grow.

use crate::clock::{compute_median, run_and_time_s};
use crate::environment::Environment;
use crate::error::Error;
use crate::peers::PeerReport;
use crate::problem::Problem;
use crate::process::run_and_parse_json;
use crate::table::{Table, format_factor, format_relative_error, format_time};
use era_model::model::{Accuracy, PanelModel};
use era_model::scene::{STARTING_PLATE, Scene, equidistant_numbers};
use era_planner::maps::weakest;
use era_planner::quick::{QuickPanel, WeakestPlace};
use era_planner::reach::Measure;
use era_planner::{PlanError, PlanTable, TableOptions};
use rayon::prelude::*;

/// Designs of the first table; of those the thorough look and the peer take the first few.
const DESIGNS: u32 = 200;
const THOROUGH: usize = 24;
const PEER: usize = 3;
/// Designs of each row of what a design costs as it grows.
const GROWN: u32 = 40;
/// The peer's mesh: cubic elements, with which its responses are off by some 1e-3.
const MESH: &str = "24x16";
/// Cells of the grid that fields are told on, as the planner's.
const CELLS: (usize, usize) = (48, 32);

/// Size of a panel, number of its actuators, and the frequencies that its designs are evaluated at.
#[derive(Clone, Copy)]
struct PanelCase {
    length_m: f64,
    width_m: f64,
    actuators: usize,
    options: TableOptions,
}

const EXAMPLE: PanelCase = PanelCase {
    length_m: 0.3,
    width_m: 0.2,
    actuators: 2,
    options: TableOptions { from_hz: 40.0, to_hz: 400.0, step_hz: 1.0 },
};

/// The starting plate, of the case's size, with ERAs anywhere on it, a tenth of its sides from the edges, by a low-discrepancy sequence.
fn make_design_scenes(case: PanelCase, count: u32) -> Result<Vec<Scene>, Error> {
    let plate = Scene::parse("examples/scenes/plate.toml", STARTING_PLATE)?;
    let make_design = |number: u32| {
        let mut scene = plate.clone();
        for support in &mut scene.supports {
            support.x_m *= case.length_m / plate.surface.length_m;
            support.y_m *= case.width_m / plate.surface.width_m;
        }
        (scene.surface.length_m, scene.surface.width_m) = (case.length_m, case.width_m);
        scene.actuators = (0..case.actuators)
            .zip(0_u32..)
            .map(|(k, step)| {
                let mut actuator = plate.actuators[k % plate.actuators.len()].clone();
                let fraction_of_side =
                    |step: f64, turn: f64| 0.1 + 0.8 * (0.5 + turn + step * f64::from(number + 1)).fract();
                actuator.id = format!("era{k}");
                let turn = f64::from(step) * 0.38;
                (actuator.x_m, actuator.y_m) = (
                    case.length_m * fraction_of_side(0.754_877_666, turn),
                    case.width_m * fraction_of_side(0.569_840_291, 0.7 * turn),
                );
                actuator
            })
            .collect();
        scene
    };
    Ok((0..count).map(make_design).collect())
}

/// The quick look at all designs, in s for each, on the threads of the pool that this runs in.
fn find_weakest_places_and_time_per_design_s(
    panel: &QuickPanel,
    scenes: &[Scene],
) -> Result<(Vec<WeakestPlace>, f64), Error> {
    let all = || {
        scenes
            .par_iter()
            .map(|scene| panel.find_place_of_least_achievable_peak(scene, Measure::G))
            .collect::<Result<Vec<_>, _>>()
    };
    let (found, all_s) = run_and_time_s(all)?;
    Ok((found, all_s / scenes.len() as f64))
}

/// A design by itself: its own elements, every frequency, every point, each searched exactly. Its weakest place in g.
fn find_weakest_peak_thoroughly_g(scene: &Scene, options: TableOptions) -> Result<f64, Error> {
    let model = PanelModel::build(scene, Accuracy::BALANCED, options.to_hz)?
        .reduce_with_residual_shapes_of_actuators_damping_and_points(options.to_hz, &[])?;
    let table = PlanTable::build(scene, model, options)?;
    Ok(weakest::weakest_place_with_setting_per_place_if_frequencies_usable(&table, Measure::G)
        .ok_or(PlanError::NoFrequencies)?
        .peak)
}

fn build_thread_pool(threads: usize) -> Result<rayon::ThreadPool, Error> {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| Error::Threads(error.to_string()))
}

/// SciPy's modes and responses of a design, of two loads at all points of the planner's grid and at its frequencies, without any search: in s.
fn measure_scipy_time_s(environment: &Environment, scene: &Scene, options: TableOptions) -> Result<f64, Error> {
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let problem = Problem {
        scene: scene.clone(),
        frequencies_hz: options.frequencies_hz(),
        x_m: equidistant_numbers(0.0, length, CELLS.0 + 1),
        y_m: equidistant_numbers(0.0, width, CELLS.1 + 1),
    };
    let reference = problem.compute_reference_curves(crate::own::NEXT)?;
    let path = problem.write_files_and_return_problem_path(&environment.scratch, &reference)?;
    let mut command = environment.make_script_command("peers.py");
    command.arg(path).args(["--meshes", MESH, "--direct-most", "0", "--real-most", "0", "--solves", "1"]);
    let report: PeerReport = run_and_parse_json(&mut command)?;
    let own = report.results.iter().find(|solved| solved.method == "modal+2");
    Ok(own.map_or(f64::NAN, |solved| solved.set_up_s + solved.sweep_s))
}

/// Measures studies: the table of three ways to look at a design, and that of how the time of a design grows.
///
/// # Errors
/// [`Error`] of a design that has no answer, or of the peer.
pub fn build_study_tables(environment: &Environment) -> Result<Vec<Table>, Error> {
    Ok(vec![build_table_of_quick_thorough_and_scipy(environment)?, build_table_of_time_per_design()?])
}

fn build_table_of_quick_thorough_and_scipy(environment: &Environment) -> Result<Table, Error> {
    let scenes = make_design_scenes(EXAMPLE, DESIGNS)?;
    let (panel, first_s) = run_and_time_s(|| QuickPanel::new(&scenes[0], EXAMPLE.options))?;
    let (found, quick_s) =
        build_thread_pool(1)?.install(|| find_weakest_places_and_time_per_design_s(&panel, &scenes))?;
    let (_, both_s) = build_thread_pool(2)?.install(|| find_weakest_places_and_time_per_design_s(&panel, &scenes))?;
    let mut off = Vec::new();
    let mut thorough_s = Vec::new();
    for (scene, found) in scenes.iter().zip(&found).take(THOROUGH) {
        let (least, s) = build_thread_pool(1)?
            .install(|| run_and_time_s(|| find_weakest_peak_thoroughly_g(scene, EXAMPLE.options)))?;
        off.push((found.peak / least - 1.0).abs());
        thorough_s.push(s);
    }
    let thorough_s = compute_median(thorough_s);
    let peer = scenes.iter().take(PEER).map(|scene| measure_scipy_time_s(environment, scene, EXAMPLE.options));
    let peer_s = compute_median(peer.collect::<Result<_, _>>()?);
    off.sort_by(f64::total_cmp);
    let columns = ["way", "designs", "each", "designs a second", "times the thorough look"];
    let mut table = Table::new("Designs of the starting plate: its weakest place", &columns);
    let mut add_row = |name: &str, designs: usize, s: f64| {
        let speed = format!("{:.1}", 1.0 / s);
        table.add_row([name.to_owned(), designs.to_string(), format_time(s), speed, format_factor(thorough_s / s)]);
    };
    add_row("quick, one thread", scenes.len(), quick_s);
    add_row("quick, two threads", scenes.len(), both_s);
    add_row("thorough, one thread", THOROUGH, thorough_s);
    add_row("SciPy, responses alone, one thread", PEER, peer_s);
    table.below.push(format!(
        "The two ERAs anywhere. Solving the bare panel first took {}. Quick beside thorough over {THOROUGH} designs: \
         {} off in the median, {} at most. SciPy: {MESH} cubic elements, 60 modes, two residual terms, responses at the planner's points and \
         frequencies, no search.",
        format_time(first_s),
        format_relative_error(off[off.len() / 2]),
        format_relative_error(off[off.len() - 1])
    ));
    Ok(table)
}

fn build_table_of_time_per_design() -> Result<Table, Error> {
    let columns = ["case", "unknowns", "frequencies", "points", "each"];
    let mut table = Table::new("What a design costs, one thread", &columns);
    let example_up_to_hz = |to_hz: f64| PanelCase { options: TableOptions { to_hz, ..EXAMPLE.options }, ..EXAMPLE };
    let cases = [
        ("the example", EXAMPLE),
        ("one ERA", PanelCase { actuators: 1, ..EXAMPLE }),
        ("three ERAs", PanelCase { actuators: 3, ..EXAMPLE }),
        ("four ERAs", PanelCase { actuators: 4, ..EXAMPLE }),
        ("up to 200 Hz", example_up_to_hz(200.0)),
        ("up to 800 Hz", example_up_to_hz(800.0)),
        ("twice as long and wide", PanelCase { length_m: 0.6, width_m: 0.4, ..EXAMPLE }),
        ("four times as long and wide", PanelCase { length_m: 1.2, width_m: 0.8, ..EXAMPLE }),
    ];
    for (name, case) in cases {
        let scenes = make_design_scenes(case, GROWN)?;
        let panel = QuickPanel::new(&scenes[0], case.options)?;
        let (found, each_s) =
            build_thread_pool(1)?.install(|| find_weakest_places_and_time_per_design_s(&panel, &scenes))?;
        let (frequencies, points) =
            found.iter().fold((0, 0), |sum, found| (sum.0 + found.frequencies, sum.1 + found.points));
        let mean = |sum: usize| (sum / scenes.len()).to_string();
        table.add_row([
            name.to_owned(),
            panel.count_unknowns().to_string(),
            mean(frequencies),
            mean(points),
            format_time(each_s),
        ]);
    }
    Ok(table)
}
