//! Doing a study's tasks.

use super::folder::{Folder, FolderError};
use super::row::Row;
use super::study::Study;
use super::task::{Shard, Task};
use crate::evaluate::Evaluator;
use rayon::prelude::*;

/// Whoever wants to know how far it is, and may stop it.
pub trait Observer: Sync {
    /// Whether no other task shall begin.
    fn stops(&self) -> bool {
        false
    }

    /// So many designs of the share are there from the start, of so many.
    fn begins(&self, _there: usize, _all: usize) {}

    /// So many designs more were there from the start.
    fn finds(&self, _designs: usize) {}

    /// So many designs more are there.
    fn does(&self, _designs: usize) {}
}

/// Nobody.
impl Observer for () {}

/// Why a study's work ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stopped {
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
pub fn run(
    study: &Study,
    folder: &Folder,
    evaluator: &dyn Evaluator,
    shard: Shard,
    observer: &dyn Observer,
) -> Result<Stopped, RunError> {
    let base = match folder.rows(Task::Base)?.and_then(|rows| rows.into_iter().next()) {
        Some(base) => base,
        None => {
            if observer.stops() {
                return Ok(Stopped::Early);
            }
            let rows = study.compute(Task::Base, &[], evaluator);
            folder.keep(Task::Base, &rows)?;
            match rows.into_iter().next() {
                Some(base) => base,
                None => return Ok(Stopped::Early),
            }
        }
    };
    let tasks: Vec<Task> = study.tasks().filter(|task| *task != Task::Base && shard.has(*task)).collect();
    match study.evolution() {
        None => samples(study, folder, evaluator, tasks, observer),
        Some(evolution) => {
            let work = Search { study, folder, evaluator, observer, base: &base };
            observer.begins(0, tasks.len() * evolution.population());
            let runs: Vec<usize> =
                (0..evolution.runs()).filter(|run| shard.has(Task::Generation { run: *run, generation: 0 })).collect();
            let ended: Vec<Stopped> =
                runs.into_par_iter().map(|run| work.generations(run)).collect::<Result<_, _>>()?;
            Ok(if ended.contains(&Stopped::Early) { Stopped::Early } else { Stopped::Done })
        }
    }
}

fn samples(
    study: &Study,
    folder: &Folder,
    evaluator: &dyn Evaluator,
    tasks: Vec<Task>,
    observer: &dyn Observer,
) -> Result<Stopped, RunError> {
    let all = tasks.iter().map(|task| study.size(*task)).sum();
    let is_there: Vec<bool> =
        tasks.par_iter().map(|task| Ok(folder.rows(*task)?.is_some())).collect::<Result<_, FolderError>>()?;
    let left: Vec<Task> = tasks.into_iter().zip(is_there).filter(|(_, there)| !there).map(|(task, _)| task).collect();
    observer.begins(all - left.iter().map(|task| study.size(*task)).sum::<usize>(), all);
    let done = left.par_iter().with_max_len(1).map(|task| {
        if observer.stops() {
            return Ok(Stopped::Early);
        }
        let rows = study.compute(*task, &[], evaluator);
        folder.keep(*task, &rows)?;
        observer.does(rows.len());
        Ok(Stopped::Done)
    });
    let ended: Vec<Stopped> = done.collect::<Result<_, RunError>>()?;
    Ok(if ended.contains(&Stopped::Early) { Stopped::Early } else { Stopped::Done })
}

struct Search<'a> {
    study: &'a Study,
    folder: &'a Folder,
    evaluator: &'a dyn Evaluator,
    observer: &'a dyn Observer,
    base: &'a Row,
}

impl Search<'_> {
    /// All generations of a search, one after the other.
    fn generations(&self, run: usize) -> Result<Stopped, RunError> {
        let count = self.study.evolution().map_or(0, crate::ways::Evolution::generations);
        let mut told: Vec<Vec<f64>> = Vec::with_capacity(count);
        for generation in 0..count {
            let task = Task::Generation { run, generation };
            let rows = match self.folder.rows(task)? {
                Some(rows) => {
                    self.observer.finds(rows.len());
                    rows
                }
                None if self.observer.stops() => return Ok(Stopped::Early),
                None => {
                    let rows = self.study.compute(task, &told, self.evaluator);
                    self.folder.keep(task, &rows)?;
                    self.observer.does(rows.len());
                    rows
                }
            };
            told.push(self.study.losses(run, self.base, &rows));
        }
        Ok(Stopped::Done)
    }
}
