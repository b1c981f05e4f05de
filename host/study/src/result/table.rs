//! All designs of a study, side by side.

use super::limits::describe_broken_limits_if_any;
use super::pareto::flag_losses_on_pareto_front;
use crate::run::{
    DesignOutcome, DesignRow, FolderError, Study, StudyFolder, StudyTask,
    sum_relative_limit_violations_if_all_limited_figures_known, worst_case_figure_of_wish_unless_failed,
};
use crate::space::DesignColumn;
use crate::spec::WantedFigure;

/// What became of a design.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DesignStatus {
    /// It keeps all limits.
    Kept,
    /// It has figures, and breaks a limit.
    Broken,
    /// It has none.
    Failed,
}

impl DesignStatus {
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
pub struct TableEntry {
    /// The design and its figures.
    pub row: DesignRow,
    /// What became of it.
    pub status: DesignStatus,
    /// Why, unless it keeps all limits.
    pub reason: Option<String>,
    /// The figure of each wish, the worst of what may be off; empty if it failed.
    pub wishes: Vec<f64>,
    /// Whether no other design surpasses it.
    pub is_on_front: bool,
    /// By how much it breaks limits, as [`sum_relative_limit_violations_if_all_limited_figures_known`](crate::run::sum_relative_limit_violations_if_all_limited_figures_known) tells it; zero if it keeps them, infinite if it failed.
    pub beyond: f64,
}

/// All designs of a study.
#[derive(Clone, Debug)]
pub struct DesignTable {
    /// Columns of the variables.
    pub columns: Vec<DesignColumn>,
    /// What the figures are.
    pub figures: Vec<WantedFigure>,
    /// Whether figures have a least and a most over what may be off.
    pub has_ends: bool,
    /// The scene as it is in its file.
    pub base: TableEntry,
    /// The designs, in the order in which they were chosen.
    pub entries: Vec<TableEntry>,
}

/// A study whose table cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum GatherError {
    /// The folder.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// It is not all there.
    #[error(
        "the results of {missing} of {all} designs are missing: run the study again, or run all of its shares (`era study --shard`)"
    )]
    Missing {
        /// How many are missing.
        missing: usize,
        /// How many there are to be.
        all: usize,
    },
}

impl DesignTable {
    /// The table of what a folder has of a study.
    ///
    /// # Errors
    /// [`GatherError`].
    pub fn gather_from_folder(study: &Study, folder: &StudyFolder) -> Result<Self, GatherError> {
        let (mut base, mut rows, mut missing) = (None, Vec::new(), 0);
        for task in study.list_tasks() {
            match (folder.load_task_rows_if_complete(task)?, task) {
                (Some(own), StudyTask::Base) => base = own.into_iter().next(),
                (Some(own), _) => rows.extend(own),
                // It is none of the designs.
                (None, StudyTask::Base) => {}
                (None, _) => missing += study.count_designs_of_task(task),
            }
        }
        let missing = if base.is_none() { missing.max(1) } else { missing };
        let base = base.filter(|_| missing == 0).ok_or(GatherError::Missing { missing, all: study.count_designs() })?;
        Ok(Self::from_rows(study, base, rows))
    }

    /// Where no design keeps all limits, the one that is least beyond them, the first of equals, with its number from 1; none if all have failed.
    #[must_use]
    pub fn find_one_based_design_nearest_to_limits_if_none_meets_them(&self) -> Option<(usize, &TableEntry)> {
        if self.entries.iter().any(|entry| entry.status == DesignStatus::Kept) {
            return None;
        }
        let broken = (1..).zip(&self.entries).filter(|(_, entry)| entry.status == DesignStatus::Broken);
        broken.min_by(|(_, a), (_, b)| a.beyond.total_cmp(&b.beyond))
    }

    /// Whether there is no design that has figures: none breaks a limit, and none keeps all.
    #[must_use]
    pub fn have_all_designs_failed(&self) -> bool {
        self.entries.iter().all(|entry| entry.status == DesignStatus::Failed)
    }

    /// Whether any row has a weakest place.
    #[must_use]
    pub fn has_weakest_places(&self) -> bool {
        let all = std::iter::once(&self.base).chain(&self.entries);
        all.filter_map(|entry| entry.row.figures_unless_failed()).any(|figures| figures.weakest_mm.is_some())
    }

    /// The table of a study's rows.
    #[must_use]
    pub fn from_rows(study: &Study, base: DesignRow, rows: Vec<DesignRow>) -> Self {
        let mut entries: Vec<TableEntry> =
            rows.into_iter().map(|row| build_table_entry_with_status_and_reason(study, &base, row)).collect();
        let base = build_table_entry_with_status_and_reason(study, &base.clone(), base);
        let kept: Vec<usize> = (0..entries.len()).filter(|k| entries[*k].status == DesignStatus::Kept).collect();
        let losses: Vec<Vec<f64>> = kept.iter().map(|k| worst_case_loss_of_each_wish(study, &entries[*k])).collect();
        for (own, is_on) in kept.into_iter().zip(flag_losses_on_pareto_front(&losses)) {
            entries[own].is_on_front = is_on;
        }
        let has_ends = study.count_uncertainty_samples() > 0;
        Self { columns: study.space.table_columns(), figures: study.figures.clone(), has_ends, base, entries }
    }
}

/// A design's loss for each wish: less is better.
pub(super) fn worst_case_loss_of_each_wish(study: &Study, entry: &TableEntry) -> Vec<f64> {
    study.spec.wishes.iter().zip(&entry.wishes).map(|(wish, figure)| wish.goal.loss_of_figure(*figure)).collect()
}

/// The table's entry for a row: its status, wishes and reason.
fn build_table_entry_with_status_and_reason(study: &Study, base: &DesignRow, row: DesignRow) -> TableEntry {
    let wishes: Option<Vec<f64>> = study
        .spec
        .wishes
        .iter()
        .map(|wish| worst_case_figure_of_wish_unless_failed(&row, &study.figures, wish))
        .collect();
    let beyond = sum_relative_limit_violations_if_all_limited_figures_known(
        &row,
        &study.figures,
        &study.spec.limits,
        Some(base),
    );
    let (status, reason) = match (&row.outcome, beyond) {
        (DesignOutcome::Failed(reason), _) => (DesignStatus::Failed, Some(reason.clone())),
        (_, Some(0.0)) if wishes.iter().flatten().all(|wish| wish.is_finite()) => (DesignStatus::Kept, None),
        (_, Some(0.0)) => {
            (DesignStatus::Failed, Some("the value of a [[wish]] is not a finite number for this design".into()))
        }
        (_, None) => (DesignStatus::Failed, Some("a [[limit]] has no value for this design".into())),
        _ => (
            DesignStatus::Broken,
            describe_broken_limits_if_any(study, |figure| {
                row.least_and_most_of_figure_over_samples_unless_failed(figure)
            }),
        ),
    };
    let beyond = beyond.filter(|_| status != DesignStatus::Failed).unwrap_or(f64::INFINITY);
    TableEntry { row, status, reason, wishes: wishes.unwrap_or_default(), is_on_front: false, beyond }
}
