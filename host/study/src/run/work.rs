//! Doing a study's tasks.

use super::folder::{FolderError, StudyFolder};
use super::row::DesignRow;
use super::study::Study;
use super::task::{Shard, StudyTask};
use crate::evaluate::Evaluator;
use era_model::stop::StopRequest;
use rayon::prelude::*;

/// Whoever wants to know how far it is, and may stop it.
pub trait StudyObserver: Sync {
    /// Whether no other task shall begin.
    fn is_stop_wanted(&self) -> bool {
        false
    }

    /// So many designs of the share are there from the start, of so many.
    fn report_already_computed_of_all_at_start(&self, _already_computed: usize, _designs_of_shard: usize) {}

    /// So many designs more were there from the start.
    fn report_further_designs_found_in_folder(&self, _designs: usize) {}

    /// So many designs more are there.
    fn report_newly_computed_designs(&self, _designs: usize) {}
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
pub fn compute_missing_rows_of_shard(
    study: &Study,
    folder: &StudyFolder,
    evaluator: &dyn Evaluator,
    shard: Shard,
    observer: &dyn StudyObserver,
) -> Result<RunEnd, RunError> {
    let base = match folder.load_task_rows_if_complete(StudyTask::Base)?.and_then(|rows| rows.into_iter().next()) {
        Some(base) => base,
        None => {
            if observer.is_stop_wanted() {
                return Ok(RunEnd::Early);
            }
            let Some(rows) = study.compute_task_rows_unless_stopped(StudyTask::Base, &[], evaluator) else {
                return Ok(RunEnd::Early);
            };
            folder.write_task_rows(StudyTask::Base, &rows)?;
            match rows.into_iter().next() {
                Some(base) => base,
                None => return Ok(RunEnd::Early),
            }
        }
    };
    let tasks: Vec<StudyTask> = study
        .list_tasks()
        .filter(|task| *task != StudyTask::Base && shard.contains_task_counting_base_in_every_shard(*task))
        .collect();
    match study.evolution_if_points_depend_on_results() {
        None => compute_missing_rows_of_tasks(study, folder, evaluator, tasks, observer),
        Some(evolution) => {
            let work = EvolutionSearch { study, folder, evaluator, observer, base: &base };
            observer.report_already_computed_of_all_at_start(
                0,
                tasks.len() * evolution.designs_per_generation_of_one_search(),
            );
            let runs: Vec<usize> = (0..evolution.searches_beside_each_other())
                .filter(|run| {
                    shard.contains_task_counting_base_in_every_shard(StudyTask::Generation { run: *run, generation: 0 })
                })
                .collect();
            let stop = StopRequest::current_request_of_thread();
            let ended: Vec<RunEnd> = runs
                .into_par_iter()
                .map(|run| {
                    stop.run_with_self_as_current_stop_request_of_thread(|| {
                        work.run_remaining_generations_of_search(run)
                    })
                })
                .collect::<Result<_, _>>()?;
            Ok(if ended.contains(&RunEnd::Early) { RunEnd::Early } else { RunEnd::Done })
        }
    }
}

fn compute_missing_rows_of_tasks(
    study: &Study,
    folder: &StudyFolder,
    evaluator: &dyn Evaluator,
    tasks: Vec<StudyTask>,
    observer: &dyn StudyObserver,
) -> Result<RunEnd, RunError> {
    let all = tasks.iter().map(|task| study.count_designs_of_task(*task)).sum();
    let is_there: Vec<bool> = tasks
        .par_iter()
        .map(|task| Ok(folder.load_task_rows_if_complete(*task)?.is_some()))
        .collect::<Result<_, FolderError>>()?;
    let left: Vec<StudyTask> =
        tasks.into_iter().zip(is_there).filter(|(_, there)| !there).map(|(task, _)| task).collect();
    observer.report_already_computed_of_all_at_start(
        all - left.iter().map(|task| study.count_designs_of_task(*task)).sum::<usize>(),
        all,
    );
    let stop = StopRequest::current_request_of_thread();
    let compute = |task: &StudyTask| {
        if observer.is_stop_wanted() {
            return Ok(RunEnd::Early);
        }
        let Some(rows) = study.compute_task_rows_unless_stopped(*task, &[], evaluator) else {
            return Ok(RunEnd::Early);
        };
        folder.write_task_rows(*task, &rows)?;
        observer.report_newly_computed_designs(rows.len());
        Ok(RunEnd::Done)
    };
    // Whatever thread a task is computed on, it belongs to this study's request: a thread that waits takes up work of others too.
    let done = left
        .par_iter()
        .with_max_len(1)
        .map(|task| stop.run_with_self_as_current_stop_request_of_thread(|| compute(task)));
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
    fn run_remaining_generations_of_search(&self, run_index: usize) -> Result<RunEnd, RunError> {
        let count = self
            .study
            .evolution_if_points_depend_on_results()
            .map_or(0, crate::methods::Evolution::generations_per_search);
        let mut told: Vec<Vec<f64>> = Vec::with_capacity(count);
        for generation in 0..count {
            let task = StudyTask::Generation { run: run_index, generation };
            let rows = match self.folder.load_task_rows_if_complete(task)? {
                Some(rows) => {
                    self.observer.report_further_designs_found_in_folder(rows.len());
                    rows
                }
                None if self.observer.is_stop_wanted() => return Ok(RunEnd::Early),
                None => {
                    let Some(rows) = self.study.compute_task_rows_unless_stopped(task, &told, self.evaluator) else {
                        return Ok(RunEnd::Early);
                    };
                    self.folder.write_task_rows(task, &rows)?;
                    self.observer.report_newly_computed_designs(rows.len());
                    rows
                }
            };
            told.push(self.study.compute_losses_for_search_run(run_index, self.base, &rows));
        }
        Ok(RunEnd::Done)
    }
}
