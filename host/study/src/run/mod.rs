//! Computing a study: its work in tasks, each of which gives the same rows whoever does it, kept in a folder as they are done.

mod fits;
mod folder;
mod losses;
mod row;
mod study;
mod task;
mod work;

pub use folder::{FolderError, StudyFolder, decode_task_rows_if_of_study_and_task, encode_task_rows};
pub use losses::{
    compute_search_loss_of_weighted_wishes_or_only_broken_limits,
    sum_relative_limit_violations_if_all_limited_figures_known, worst_case_figure_of_wish_unless_failed,
};
pub use row::{DesignOutcome, DesignRow};
pub use study::{Study, StudyError};
pub use task::{Shard, ShardError, StudyTask, TaskError};
pub use work::{RunEnd, RunError, StudyObserver, compute_missing_rows_of_shard};
