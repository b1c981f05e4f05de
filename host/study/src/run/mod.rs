//! Computing a study: its work in tasks, each of which gives the same rows whoever does it, kept in a folder as they are done.

mod fits;
mod folder;
mod losses;
mod row;
mod study;
mod task;
mod work;

pub use folder::{FolderError, StudyFolder, decode_task_rows, encode_task_rows};
pub use losses::{compute_design_loss, measure_broken_limits, worst_wished_figure};
pub use row::{DesignOutcome, DesignRow};
pub use study::{Study, StudyError};
pub use task::{Shard, ShardError, StudyTask, TaskError};
pub use work::{RunEnd, RunError, StudyObserver, run_study_shard};
