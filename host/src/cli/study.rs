//! The command `study`: a study computed, or a share of it, and its results written.

use super::args_study::Study as Options;
use super::progress_of::{Shown, stop_on_signals};
use super::{Failure, Outcome, print_json, print_text};
use crate::design::evaluate::{Evaluator, Quick, Thorough};
use crate::design::report::{report, shown};
use crate::design::result::{Finalist, Finals, GatherError, Status, Table, write_parquet};
use crate::design::run::{self, Folder, FolderError, RunError, Shard, Stopped, Study, StudyError};
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

impl From<StudyError> for Failure {
    fn from(error: StudyError) -> Self {
        Failure::usage(error)
    }
}

impl From<FolderError> for Failure {
    fn from(error: FolderError) -> Self {
        match error {
            FolderError::Other { .. } => Failure::usage(error),
            FolderError::Io { .. } => Failure::failed(format!(
                "{error}; what was computed before is kept, and the same command goes on from there"
            )),
        }
    }
}

impl From<GatherError> for Failure {
    fn from(error: GatherError) -> Self {
        match error {
            GatherError::Folder(error) => error.into(),
            GatherError::Missing { .. } => Failure::failed(error),
        }
    }
}

/// Runs it.
pub fn run(options: &Options) -> Outcome {
    let study = Study::load(&options.study)?;
    let path = options.out.clone().unwrap_or_else(|| usual_folder(&options.study));
    let folder = Folder::open(&path, study.key())?;
    let stops = stop_on_signals();
    let shard = options.shard.unwrap_or(Shard::ALL);
    if !options.gather {
        let shown = Shown::new(stops.clone());
        let evaluator: Box<dyn Evaluator> = if study.spec.method.thorough {
            Box::new(Thorough::new(study.options()))
        } else {
            Box::new(Quick::new(study.options()))
        };
        let mut pool = rayon::ThreadPoolBuilder::new();
        if let Some(workers) = options.workers {
            pool = pool.num_threads(usize::from(workers));
        }
        let pool = pool.build().map_err(Failure::failed)?;
        let ended = pool.install(|| run::run(&study, &folder, &*evaluator, shard, &shown));
        let (there, all) = shown.finish();
        match ended {
            Err(RunError::Folder(error)) => return Err(error.into()),
            Ok(Stopped::Early) => {
                return Err(Failure::failed(format!(
                    "stopped: {there} of {all} designs are in {}; the same command goes on from there",
                    path.display()
                )));
            }
            Ok(Stopped::Done) if !shard.is_all() => {
                return print_text(&format!(
                    "{}: share {shard} is in {}, {all} designs; when all shares are, `--gather` makes the results",
                    study.spec.name,
                    path.display()
                ));
            }
            Ok(Stopped::Done) => {}
        }
    }
    let table = Table::gather(&study, &folder)?;
    folder.write("designs.parquet", &write_parquet(&table).map_err(Failure::failed)?)?;
    let halt = || stops.load(std::sync::atomic::Ordering::Relaxed);
    let finals = super::progress::with_progress("computing the finalists anew", || Finals::of(&study, &table, &halt))
        .map_err(Failure::failed)?;
    let Some(finals) = finals else {
        return Err(Failure::failed("stopped while the finalists were computed anew; the same command goes on"));
    };
    for (number, best) in finals.best.iter().enumerate() {
        folder.write(&format!("best-{}.toml", number + 1), heading(&study, best, number + 1).as_bytes())?;
    }
    folder.write("report.html", report(&study, &table, &finals).as_bytes())?;
    if options.json {
        return print_json(&summary(&study, &table, &finals, &path));
    }
    print_text(&text(&study, &table, &finals, &path))
}

/// The study's name with `-results`, in the current directory.
fn usual_folder(study: &Path) -> PathBuf {
    let stem = study.file_stem().map_or_else(|| "study".into(), |stem| stem.to_string_lossy());
    PathBuf::from(format!("{stem}-results"))
}

/// A finalist's scene, with what it is above it.
fn heading(study: &Study, best: &Finalist, rank: usize) -> String {
    let mut text = format!("# Best {rank} of the study {:?}: design {}.\n", study.spec.name, best.design);
    for (name, value) in figures(study, best) {
        let _ = writeln!(text, "# {name} = {}", shown(value));
    }
    format!("{text}\n{}", best.text)
}

fn figures(study: &Study, own: &Finalist) -> Vec<(String, f64)> {
    let names = study.figures.iter().map(|wanted| wanted.column());
    let values = own.verified.as_ref().map(|verified| verified.figures.values.clone()).unwrap_or_default();
    names.zip(values).collect()
}

fn text(study: &Study, table: &Table, finals: &Finals, path: &Path) -> String {
    let count = |status: Status| table.entries.iter().filter(|entry| entry.status == status).count();
    let mut text = format!(
        "{}: {} designs by {}, {} of them within all limits, {} break one, {} failed",
        study.spec.name,
        table.entries.len(),
        study.spec.method.way.name(),
        count(Status::Kept),
        count(Status::Broken),
        count(Status::Failed)
    );
    if study.spec.wishes.len() > 1 {
        let front = table.entries.iter().filter(|entry| entry.is_on_front).count();
        let _ = write!(text, "; {front} on the front");
    }
    let names: Vec<String> = study.figures.iter().map(|wanted| wanted.column()).collect();
    let _ = write!(
        text,
        "\n\n| | design | {} | error at most |\n|---|---|{}---|\n",
        names.join(" | "),
        "---|".repeat(names.len())
    );
    let all = std::iter::once(("as it is".to_owned(), &finals.base));
    for (name, own) in all.chain(finals.best.iter().enumerate().map(|(k, own)| (format!("best {}", k + 1), own))) {
        let cells = match &own.verified {
            Ok(verified) => verified.figures.values.iter().map(|value| shown(*value)).collect(),
            Err(_) => vec!["failed".to_owned(); names.len()],
        };
        let bound = own.verified.as_ref().ok().and_then(|verified| verified.bound);
        let bound = bound.map_or_else(|| "unknown".into(), |bound| format!("{bound:.0e}"));
        let _ = writeln!(text, "| {name} | {} | {} | {bound} |", own.design, cells.join(" | "));
    }
    let _ = write!(
        text,
        "\n(computed anew with models for a tolerance of {:.0e}; the error is that of the weakest place's peak)\n",
        finals.tolerance
    );
    for (k, own) in finals.best.iter().enumerate() {
        let entry = table.entries.get(own.design.saturating_sub(1));
        let values = table
            .columns
            .iter()
            .filter_map(|column| Some(format!("{} = {}", column.name, column.text(&entry?.row.design)?)));
        let _ = write!(text, "\nbest {}: {}", k + 1, values.collect::<Vec<_>>().join(", "));
        if let Err(reason) = &own.verified {
            let _ = write!(text, " (failed: {reason})");
        }
    }
    if finals.best.is_empty() {
        text.push_str("\nNo design keeps all limits.");
        if let Some(reason) = table.entries.iter().find_map(|entry| entry.reason.as_ref()) {
            let _ = write!(text, " The first: {reason}");
        }
    }
    let _ = write!(text, "\n\nresults in {}", path.display());
    text
}

fn summary(study: &Study, table: &Table, finals: &Finals, path: &Path) -> serde_json::Value {
    let count = |status: Status| table.entries.iter().filter(|entry| entry.status == status).count();
    let told = |own: &Finalist| {
        let values = figures(study, own);
        let verified = own.verified.as_ref();
        json!({
            "design": own.design,
            "figures": values.into_iter().collect::<std::collections::BTreeMap<_, _>>(),
            "weakest_mm": verified.ok().and_then(|verified| verified.figures.weakest_mm),
            "error_bound": verified.ok().and_then(|verified| verified.bound),
            "failed": verified.err(),
        })
    };
    json!({
        "study": study.spec.name, "folder": path, "designs": table.entries.len(), "kept": count(Status::Kept),
        "broken": count(Status::Broken), "failed": count(Status::Failed),
        "on_front": table.entries.iter().filter(|entry| entry.is_on_front).count(),
        "tolerance": finals.tolerance, "as_it_is": told(&finals.base),
        "best": finals.best.iter().map(told).collect::<Vec<_>>(),
    })
}
