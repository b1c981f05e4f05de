//! Measurements of the panel model, side by side with its peers, of the planner and of studies' quick look at designs:
//! `cargo xtask bench model`, `cargo xtask bench planner`, `cargo xtask bench study`, of clicks: `cargo xtask bench feel`, and of effect
//! files: `cargo xtask bench imports`.

mod arithmetic;
mod before;
mod calculix;
mod case;
mod clock;
mod document;
mod environment;
mod error;
mod feel;
mod fit;
mod growth;
mod imports;
mod own;
mod peers;
mod planner;
mod plot;
mod problem;
mod process;
mod proof;
mod references;
mod study;
mod swarm;
mod table;
mod table1;
mod tradeoff;

use case::Case;
use clap::{Args, Parser, Subcommand, ValueEnum};
use environment::Environment;
use era_model::model::Accuracy;
use error::Error;
use own::{NEXT, TIGHTEST};
use problem::{Problem, WANTED};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use table::{Table, format_relative_error, format_time};

/// Time that one size of the growth with unknowns may take, in s.
const LONGEST_S: f64 = 45.0;
/// The same with `--quick`.
const LONGEST_QUICK_S: f64 = 3.0;

/// Measurements of the ERA haptics system.
#[derive(Parser)]
#[command(name = "era-bench")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// The panel model: what accuracy costs, growth, peers at equal error, motion in time, arithmetic
    Model(Options),
    /// The planner: time per plan, its optimum against brute force, plans with phases
    Planner {
        /// Also put the tables into a document, where it has `<!-- measured: planner -->` and `<!-- end -->`
        #[arg(long, value_name = "FILE")]
        update: Option<PathBuf>,
    },
    /// Studies' quick look at designs: designs a second, beside the thorough look and SciPy
    Study {
        /// Also put the tables into a document, where it has `<!-- measured: study -->` and `<!-- end -->`
        #[arg(long, value_name = "FILE")]
        update: Option<PathBuf>,
    },
    /// Clicks over grids of places: how many are crisp, before and now, on panels off their scenes, beside what is possible
    Feel {
        /// Also put the table into a document, where it has `<!-- measured: feel -->` and `<!-- end -->`
        #[arg(long, value_name = "FILE")]
        update: Option<PathBuf>,
    },
    /// Effect files of every format: what is read, what is left out, and what the example plate makes of it
    Imports {
        /// Also put the table into a document, where it has `<!-- measured: imports -->` and `<!-- end -->`
        #[arg(long, value_name = "FILE")]
        update: Option<PathBuf>,
    },
    /// One case, as JSON: what the measurements run in processes of their own
    #[command(subcommand, hide = true)]
    Case(Case),
}

/// A part of the measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Benchmark {
    Tradeoff,
    Growth,
    Peers,
    Table1,
    Arithmetic,
    Proof,
    #[value(hide = true)]
    Planner,
    #[value(hide = true)]
    Study,
    #[value(hide = true)]
    Feel,
    #[value(hide = true)]
    Imports,
}

#[derive(Args)]
struct Options {
    /// Smaller and fewer cases: a check that everything runs
    #[arg(long)]
    quick: bool,
    /// Parts to measure; all unless given
    #[arg(long, value_enum)]
    only: Vec<Benchmark>,
    /// Time that one size of the growth with unknowns may take [default: 45, with --quick 3]
    #[arg(long, value_name = "S")]
    longest_s: Option<f64>,
    /// Also write the tables to a Markdown file
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Also put the tables into a document, where it has `<!-- measured: PART -->` and `<!-- end -->`
    #[arg(long, value_name = "FILE")]
    update: Option<PathBuf>,
    /// Also write the plot of what accuracy costs to an SVG file
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Model(options) => run_model_benchmark(&options),
        Command::Planner { update } => print_tables_and_update_document(
            Benchmark::Planner,
            swarm::build_planner_tables_with_swarm_and_annealing,
            update.as_deref(),
        ),
        Command::Study { update } => print_tables_and_update_document(
            Benchmark::Study,
            || study::build_study_tables(&Environment::find_program_and_prepare_peers(true, true)?),
            update.as_deref(),
        ),
        Command::Feel { update } => {
            print_tables_and_update_document(Benchmark::Feel, feel::build_click_tables, update.as_deref())
        }
        Command::Imports { update } => print_tables_and_update_document(
            Benchmark::Imports,
            imports::build_table_of_effect_files,
            update.as_deref(),
        ),
        Command::Case(case) => case::run_case(&case).map(|outcome| println!("{}", serde_json::json!(outcome))),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn print_tables_and_update_document(
    part: Benchmark,
    build_tables: impl FnOnce() -> Result<Vec<Table>, Error>,
    document_path: Option<&Path>,
) -> Result<(), Error> {
    println!("{}\n", document::describe_machine()?);
    let tables = build_tables()?;
    for table in &tables {
        println!("{}", table.format_as_text());
    }
    let tables: Vec<(Benchmark, Table)> = tables.into_iter().map(|table| (part, table)).collect();
    document_path.map_or(Ok(()), |path| document::update_tables_in_document(path, &tables))
}

fn run_model_benchmark(options: &Options) -> Result<(), Error> {
    let is_wanted = |part| options.only.is_empty() || options.only.contains(&part);
    let environment = Environment::find_program_and_prepare_peers(
        options.quick,
        is_wanted(Benchmark::Peers) || is_wanted(Benchmark::Table1),
    )?;
    let problem = Problem::from_starting_plate()?;
    let mut tables = Vec::new();
    let mut add_table = |part: Benchmark, table: Table| {
        println!("{}", table.format_as_text());
        tables.push((part, table));
    };
    let started = Instant::now();
    println!("{}\n", document::describe_machine()?);
    if is_wanted(Benchmark::Peers) || is_wanted(Benchmark::Arithmetic) {
        measure_peers_and_arithmetic(&environment, &problem, &is_wanted, &mut add_table)?;
    }
    if is_wanted(Benchmark::Table1) {
        add_table(Benchmark::Table1, table1::build_table_of_motion_in_time(&environment)?);
    }
    if is_wanted(Benchmark::Tradeoff) {
        let (table, responses) = tradeoff::build_table_and_plot_points_of_responses(&environment, &problem)?;
        add_table(Benchmark::Tradeoff, table);
        let (table, modes) = tradeoff::build_table_and_plot_points_of_mode_frequencies(&environment)?;
        add_table(Benchmark::Tradeoff, table);
        if let Some(path) = &options.plot {
            plot::write_accuracy_cost_svg(path, &responses, &modes)?;
        }
    }
    if is_wanted(Benchmark::Proof) {
        add_table(Benchmark::Proof, proof::build_table_of_error_bound_cost(&environment, &problem)?);
        add_table(Benchmark::Proof, proof::build_table_of_bound_over_error(&environment)?);
    }
    if is_wanted(Benchmark::Growth) {
        let longest_s = options.longest_s.unwrap_or(if options.quick { LONGEST_QUICK_S } else { LONGEST_S });
        add_table(Benchmark::Growth, growth::build_table_of_growth_with_unknowns(&environment, &problem, longest_s)?);
        add_table(Benchmark::Growth, growth::build_table_of_growth_with_modes_actuators_and_frequencies(&environment)?);
    }
    println!("{} in all", format_time(started.elapsed().as_secs_f64()));
    if let Some(path) = &options.markdown {
        document::write_tables_as_markdown(path, &tables)?;
    }
    if let Some(path) = &options.update {
        document::update_tables_in_document(path, &tables)?;
    }
    Ok(())
}

/// Elements of these tolerances are tried; the cheapest answer that is right to 0.1 % is compared with the peers.
const TRIED: [f64; 3] = [1e-3, 1e-4, 1e-6];

/// (c) and (e), which have a reference in common.
fn measure_peers_and_arithmetic(
    environment: &Environment,
    problem: &Problem,
    is_wanted: &dyn Fn(Benchmark) -> bool,
    add_table: &mut dyn FnMut(Benchmark, Table),
) -> Result<(), Error> {
    let reference = problem.compute_reference_curves(TIGHTEST)?;
    let runs = if environment.quick { 3 } else { 21 };
    // In the order of cost.
    let mut own = Vec::new();
    let mut good_enough = None;
    for tolerance in TRIED {
        let accuracy = Accuracy::from_tolerance(tolerance)?;
        let double = own::measure_solution_on_one_mesh::<f64>(problem, accuracy, &reference, runs)?.0;
        if double.error <= WANTED {
            good_enough.get_or_insert(accuracy);
        }
        own.push(double);
        own.push(own::measure_solution_on_one_mesh::<f32>(problem, accuracy, &reference, runs)?.0);
    }
    if is_wanted(Benchmark::Peers) {
        let next = problem.compute_reference_curves(NEXT)?;
        let uncertainty = next.compute_largest_relative_error(|curve, f| reference.values[curve * reference.count + f]);
        let file = problem.write_files_and_return_problem_path(&environment.scratch, &reference)?;
        let report = peers::run_scipy_and_numpy(environment, &file)?;
        let good = own.iter().filter(|own| own.error <= WANTED);
        let best = good.min_by(|a, b| a.total_time_s().total_cmp(&b.total_time_s())).cloned();
        let bounded = own::measure_solution_with_bound(problem, Accuracy::BALANCED, &reference, runs)?;
        own.push(bounded.clone());
        let mut all = peers::build_table_of_all_measurements(&report, &own, problem);
        all.below.push(format!(
            "The most accurate answer has elements of order {} and cells of {} mm. With elements of the next lower \
             order on the same cells, the answer differs by {}. In the row with a bound, the program computes all \
             meshes of the sequence, like `era sweep`; the column \"set-up\" has the whole time of this row.",
            TIGHTEST.order,
            TIGHTEST.cell_m * 1e3,
            format_relative_error(uncertainty)
        ));
        add_table(Benchmark::Peers, all);
        if let Some(best) = best {
            add_table(Benchmark::Peers, peers::build_table_of_times_at_equal_error(&report, &best));
        }
        add_table(Benchmark::Peers, peers::build_table_of_times_at_equal_error(&report, &bounded));
        add_table(Benchmark::Peers, calculix::build_table_of_calculix_comparison(environment, problem, &file)?);
    }
    if is_wanted(Benchmark::Arithmetic) {
        let accuracy = good_enough.unwrap_or(Accuracy::REFERENCE);
        add_table(Benchmark::Arithmetic, arithmetic::build_table_of_arithmetics(problem, accuracy, &reference, runs)?);
    }
    Ok(())
}
