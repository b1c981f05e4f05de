//! Measurements of the panel model, side by side with its peers, of the planner and of studies' quick look at designs:
//! `cargo xtask bench model`, `cargo xtask bench planner`, `cargo xtask bench study`, and of clicks: `cargo xtask bench feel`.

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
use table::{Table, relative, seconds};

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
    /// One case, as JSON: what the measurements run in processes of their own
    #[command(subcommand, hide = true)]
    Case(Case),
}

/// A part of the measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Part {
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
}

#[derive(Args)]
struct Options {
    /// Smaller and fewer cases: a check that everything runs
    #[arg(long)]
    quick: bool,
    /// Parts to measure; all unless given
    #[arg(long, value_enum)]
    only: Vec<Part>,
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
        Command::Model(options) => model(&options),
        Command::Planner { update } => {
            measured(Part::Planner, swarm::tables_with_swarm_and_annealing, update.as_deref())
        }
        Command::Study { update } => {
            measured(Part::Study, || study::tables(&Environment::new(true, true)?), update.as_deref())
        }
        Command::Feel { update } => measured(Part::Feel, feel::tables, update.as_deref()),
        Command::Case(case) => case::run(&case).map(|outcome| println!("{}", serde_json::json!(outcome))),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn measured(
    part: Part,
    tables: impl FnOnce() -> Result<Vec<Table>, Error>,
    update: Option<&Path>,
) -> Result<(), Error> {
    println!("{}\n", document::machine()?);
    let tables = tables()?;
    for table in &tables {
        println!("{}", table.text());
    }
    let tables: Vec<(Part, Table)> = tables.into_iter().map(|table| (part, table)).collect();
    update.map_or(Ok(()), |path| document::update(path, &tables))
}

fn model(options: &Options) -> Result<(), Error> {
    let wants = |part| options.only.is_empty() || options.only.contains(&part);
    let environment = Environment::new(options.quick, wants(Part::Peers) || wants(Part::Table1))?;
    let problem = Problem::new()?;
    let mut tables = Vec::new();
    let mut tell = |part: Part, table: Table| {
        println!("{}", table.text());
        tables.push((part, table));
    };
    let started = Instant::now();
    println!("{}\n", document::machine()?);
    if wants(Part::Peers) || wants(Part::Arithmetic) {
        side_by_side(&environment, &problem, &wants, &mut tell)?;
    }
    if wants(Part::Table1) {
        tell(Part::Table1, table1::table(&environment)?);
    }
    if wants(Part::Tradeoff) {
        let (table, responses) = tradeoff::responses(&environment, &problem)?;
        tell(Part::Tradeoff, table);
        let (table, modes) = tradeoff::modes(&environment)?;
        tell(Part::Tradeoff, table);
        if let Some(path) = &options.plot {
            plot::write(path, &responses, &modes)?;
        }
    }
    if wants(Part::Proof) {
        tell(Part::Proof, proof::price(&environment, &problem)?);
        tell(Part::Proof, proof::tightness(&environment)?);
    }
    if wants(Part::Growth) {
        let most_s = options.longest_s.unwrap_or(if options.quick { LONGEST_QUICK_S } else { LONGEST_S });
        tell(Part::Growth, growth::unknowns(&environment, &problem, most_s)?);
        tell(Part::Growth, growth::others(&environment)?);
    }
    println!("{} in all", seconds(started.elapsed().as_secs_f64()));
    if let Some(path) = &options.markdown {
        document::write(path, &tables)?;
    }
    if let Some(path) = &options.update {
        document::update(path, &tables)?;
    }
    Ok(())
}

/// Elements of these tolerances are tried; the cheapest answer that is right to 0.1 % is compared with the peers.
const TRIED: [f64; 3] = [1e-3, 1e-4, 1e-6];

/// (c) and (e), which have a reference in common.
fn side_by_side(
    environment: &Environment,
    problem: &Problem,
    wants: &dyn Fn(Part) -> bool,
    tell: &mut dyn FnMut(Part, Table),
) -> Result<(), Error> {
    let reference = problem.reference(TIGHTEST)?;
    let runs = if environment.quick { 3 } else { 21 };
    // In the order of cost.
    let mut own = Vec::new();
    let mut good_enough = None;
    for tolerance in TRIED {
        let accuracy = Accuracy::from_tolerance(tolerance)?;
        let double = own::solve::<f64>(problem, accuracy, &reference, runs)?.0;
        if double.error <= WANTED {
            good_enough.get_or_insert(accuracy);
        }
        own.push(double);
        own.push(own::solve::<f32>(problem, accuracy, &reference, runs)?.0);
    }
    if wants(Part::Peers) {
        let next = problem.reference(NEXT)?;
        let uncertainty = next.error_of(|curve, f| reference.values[curve * reference.count + f]);
        let file = problem.write(&environment.scratch, &reference)?;
        let report = peers::run(environment, &file)?;
        let good = own.iter().filter(|own| own.error <= WANTED);
        let best = good.min_by(|a, b| a.total_s().total_cmp(&b.total_s())).cloned();
        let bounded = own::solve_bounded(problem, Accuracy::BALANCED, &reference, runs)?;
        own.push(bounded.clone());
        let mut all = peers::table(&report, &own, problem);
        all.below.push(format!(
            "The most accurate answer has elements of order {} and cells of {} mm. With elements of the next lower \
             order on the same cells, the answer differs by {}. In the row with a bound, the program computes all \
             meshes of the sequence, like `era sweep`; the column \"set-up\" has the whole time of this row.",
            TIGHTEST.order,
            TIGHTEST.cell_m * 1e3,
            relative(uncertainty)
        ));
        tell(Part::Peers, all);
        if let Some(best) = best {
            tell(Part::Peers, peers::ratios(&report, &best));
        }
        tell(Part::Peers, peers::ratios(&report, &bounded));
        tell(Part::Peers, calculix::table(environment, problem, &file)?);
    }
    if wants(Part::Arithmetic) {
        let accuracy = good_enough.unwrap_or(Accuracy::REFERENCE);
        tell(Part::Arithmetic, arithmetic::table(problem, accuracy, &reference, runs)?);
    }
    Ok(())
}
