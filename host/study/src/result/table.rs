//! All designs of a study, side by side.

use super::limits::broken_limits;
use super::pareto::front;
use crate::run::{Folder, FolderError, Outcome, Row, Study, Task, broken, worst};
use crate::space::Column;
use crate::spec::Wanted;

/// What became of a design.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// It keeps all limits.
    Kept,
    /// It has figures, and breaks a limit.
    Broken,
    /// It has none.
    Failed,
}

impl Status {
    /// The word in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Kept => "kept",
            Self::Broken => "breaks a limit",
            Self::Failed => "failed",
        }
    }
}

/// A row of the table.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The design and its figures.
    pub row: Row,
    /// What became of it.
    pub status: Status,
    /// Why, unless it keeps all limits.
    pub reason: Option<String>,
    /// The figure of each wish, the worst of what may be off; empty if it failed.
    pub wishes: Vec<f64>,
    /// Whether no other design surpasses it.
    pub is_on_front: bool,
    /// By how much it breaks limits, as [`broken`] tells it; zero if it keeps them, infinite if it failed.
    pub beyond: f64,
}

/// All designs of a study.
#[derive(Clone, Debug)]
pub struct Table {
    /// Columns of the variables.
    pub columns: Vec<Column>,
    /// What the figures are.
    pub figures: Vec<Wanted>,
    /// Whether figures have a least and a most over what may be off.
    pub has_ends: bool,
    /// The scene as it is in its file.
    pub base: Entry,
    /// The designs, in the order in which they were chosen.
    pub entries: Vec<Entry>,
}

/// A study whose table cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum GatherError {
    /// The folder.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// It is not all there.
    #[error("{missing} of {all} designs are not computed yet: run the study, or its shards, again")]
    Missing {
        /// How many are missing.
        missing: usize,
        /// How many there are to be.
        all: usize,
    },
}

impl Table {
    /// The table of what a folder has of a study.
    ///
    /// # Errors
    /// [`GatherError`].
    pub fn gather(study: &Study, folder: &Folder) -> Result<Self, GatherError> {
        let (mut base, mut rows, mut missing) = (None, Vec::new(), 0);
        for task in study.tasks() {
            match (folder.rows(task)?, task) {
                (Some(own), Task::Base) => base = own.into_iter().next(),
                (Some(own), _) => rows.extend(own),
                // It is none of the designs.
                (None, Task::Base) => {}
                (None, _) => missing += study.size(task),
            }
        }
        let missing = if base.is_none() { missing.max(1) } else { missing };
        let base = base.filter(|_| missing == 0).ok_or(GatherError::Missing { missing, all: study.designs() })?;
        Ok(Self::of(study, base, rows))
    }

    /// Where no design keeps all limits, the one that is least beyond them, the first of equals, with its number from 1; none if all have failed.
    #[must_use]
    pub fn nearest(&self) -> Option<(usize, &Entry)> {
        if self.entries.iter().any(|entry| entry.status == Status::Kept) {
            return None;
        }
        let broken = (1..).zip(&self.entries).filter(|(_, entry)| entry.status == Status::Broken);
        broken.min_by(|(_, a), (_, b)| a.beyond.total_cmp(&b.beyond))
    }

    /// Whether there is no design that has figures: none breaks a limit, and none keeps all.
    #[must_use]
    pub fn has_failed(&self) -> bool {
        self.entries.iter().all(|entry| entry.status == Status::Failed)
    }

    /// Whether any row has a weakest place.
    #[must_use]
    pub fn has_weakest(&self) -> bool {
        let all = std::iter::once(&self.base).chain(&self.entries);
        all.filter_map(|entry| entry.row.figures()).any(|figures| figures.weakest_mm.is_some())
    }

    /// The table of rows.
    #[must_use]
    pub fn of(study: &Study, base: Row, rows: Vec<Row>) -> Self {
        let mut entries: Vec<Entry> = rows.into_iter().map(|row| entry(study, &base, row)).collect();
        let base = entry(study, &base.clone(), base);
        let kept: Vec<usize> = (0..entries.len()).filter(|k| entries[*k].status == Status::Kept).collect();
        let losses: Vec<Vec<f64>> = kept.iter().map(|k| losses(study, &entries[*k])).collect();
        for (own, is_on) in kept.into_iter().zip(front(&losses)) {
            entries[own].is_on_front = is_on;
        }
        let has_ends = study.scenarios() > 0;
        Self { columns: study.space.columns(), figures: study.figures.clone(), has_ends, base, entries }
    }
}

/// An entry's wishes, less being better.
pub(super) fn losses(study: &Study, entry: &Entry) -> Vec<f64> {
    study.spec.wishes.iter().zip(&entry.wishes).map(|(wish, figure)| wish.goal.loss(*figure)).collect()
}

fn entry(study: &Study, base: &Row, row: Row) -> Entry {
    let wishes: Option<Vec<f64>> = study.spec.wishes.iter().map(|wish| worst(&row, &study.figures, wish)).collect();
    let beyond = broken(&row, &study.figures, &study.spec.limits, Some(base));
    let (status, reason) = match (&row.outcome, beyond) {
        (Outcome::Failed(reason), _) => (Status::Failed, Some(reason.clone())),
        (_, Some(0.0)) if wishes.iter().flatten().all(|wish| wish.is_finite()) => (Status::Kept, None),
        (_, Some(0.0)) => (Status::Failed, Some("a wish's figure is not a finite number".into())),
        (_, None) => (Status::Failed, Some("a figure that has a limit has no value".into())),
        _ => (Status::Broken, broken_limits(study, |figure| row.ends(figure))),
    };
    let beyond = beyond.filter(|_| status != Status::Failed).unwrap_or(f64::INFINITY);
    Entry { row, status, reason, wishes: wishes.unwrap_or_default(), is_on_front: false, beyond }
}
