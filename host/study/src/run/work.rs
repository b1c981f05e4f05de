//! Doing a study's tasks.

use super::folder::{FolderError, StudyFolder};
use super::row::DesignRow;
use super::study::Study;
use super::task::{Shard, StudyTask};
use crate::evaluate::Evaluator;
use rayon::prelude::*;

/// Whoever wants to know how far it is, and may stop it.
pub trait StudyObserver: Sync {
    /// Whether no other task shall begin.
    fn is_stop_wanted(&self) -> bool {
        false
    }

    /// So many designs of the share are there from the start, of so many.
    fn report_start(&self, _there: usize, _all: usize) {}

    /// So many designs more were there from the start.
    fn report_found_designs(&self, _designs: usize) {}

    /// So many designs more are there.
    fn report_computed_designs(&self, _designs: usize) {}
}

/// Nobody.
impl StudyObserver for () {}

/// Why a study's work ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunEnd {
    /// All of the share is there.
    Done,
    /// The observer stopped it.
    Early,
}

/// Why it could not go on.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The folder.
    #[error(transparent)]
    Folder(#[from] FolderError),
}

/// Does what is not there yet of a share of a study.
///
/// # Errors
/// [`RunError`]; what was done before is kept.
pub fn run_study_shard(
    study: &Study,
    folder: &StudyFolder,
    evaluator: &dyn Evaluator,
    shard: Shard,
    observer: &dyn StudyObserver,
) -> Result<RunEnd, RunError> {
    let base = match folder.rows(StudyTask::Base)?.and_then(|rows| rows.into_iter().next()) {
        Some(base) => base,
        None => {
            if observer.is_stop_wanted() {
                return Ok(RunEnd::Early);
            }
            let rows = study.compute_task_rows(StudyTask::Base, &[], evaluator);
            folder.write_task_rows(StudyTask::Base, &rows)?;
            match rows.into_iter().next() {
                Some(base) => base,
                None => return Ok(RunEnd::Early),
            }
        }
    };
    let tasks: Vec<StudyTask> =
        study.list_tasks().filter(|task| *task != StudyTask::Base && shard.contains_task(*task)).collect();
    match study.evolution_if_any() {
        None => run_sampled_tasks(study, folder, evaluator, tasks, observer),
        Some(evolution) => {
            let work = EvolutionSearch { study, folder, evaluator, observer, base: &base };
            observer.report_start(0, tasks.len() * evolution.population_size());
            let runs: Vec<usize> = (0..evolution.count_runs())
                .filter(|run| shard.contains_task(StudyTask::Generation { run: *run, generation: 0 }))
                .collect();
            let ended: Vec<RunEnd> =
                runs.into_par_iter().map(|run| work.run_generations(run)).collect::<Result<_, _>>()?;
            Ok(if ended.contains(&RunEnd::Early) { RunEnd::Early } else { RunEnd::Done })
        }
    }
}

fn run_sampled_tasks(
    study: &Study,
    folder: &StudyFolder,
    evaluator: &dyn Evaluator,
    tasks: Vec<StudyTask>,
    observer: &dyn StudyObserver,
) -> Result<RunEnd, RunError> {
    let all = tasks.iter().map(|task| study.count_designs_of_task(*task)).sum();
    let is_there: Vec<bool> =
        tasks.par_iter().map(|task| Ok(folder.rows(*task)?.is_some())).collect::<Result<_, FolderError>>()?;
    let left: Vec<StudyTask> =
        tasks.into_iter().zip(is_there).filter(|(_, there)| !there).map(|(task, _)| task).collect();
    observer.report_start(all - left.iter().map(|task| study.count_designs_of_task(*task)).sum::<usize>(), all);
    let done = left.par_iter().with_max_len(1).map(|task| {
        if observer.is_stop_wanted() {
            return Ok(RunEnd::Early);
        }
        let rows = study.compute_task_rows(*task, &[], evaluator);
        folder.write_task_rows(*task, &rows)?;
        observer.report_computed_designs(rows.len());
        Ok(RunEnd::Done)
    });
    let ended: Vec<RunEnd> = done.collect::<Result<_, RunError>>()?;
    Ok(if ended.contains(&RunEnd::Early) { RunEnd::Early } else { RunEnd::Done })
}

struct EvolutionSearch<'a> {
    study: &'a Study,
    folder: &'a StudyFolder,
    evaluator: &'a dyn Evaluator,
    observer: &'a dyn StudyObserver,
    base: &'a DesignRow,
}

impl EvolutionSearch<'_> {
    /// All generations of a search, one after the other.
    fn run_generations(&self, run: usize) -> Result<RunEnd, RunError> {
        let count = self.study.evolution_if_any().map_or(0, crate::ways::Evolution::count_generations);
        let mut told: Vec<Vec<f64>> = Vec::with_capacity(count);
        for generation in 0..count {
            let task = StudyTask::Generation { run, generation };
            let rows = match self.folder.rows(task)? {
                Some(rows) => {
                    self.observer.report_found_designs(rows.len());
                    rows
                }
                None if self.observer.is_stop_wanted() => return Ok(RunEnd::Early),
                None => {
                    let rows = self.study.compute_task_rows(task, &told, self.evaluator);
                    self.folder.write_task_rows(task, &rows)?;
                    self.observer.report_computed_designs(rows.len());
                    rows
                }
            };
            told.push(self.study.losses_of_generation(run, self.base, &rows));
        }
        Ok(RunEnd::Done)
    }
}
