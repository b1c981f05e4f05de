//! Computing a study: its work in tasks, each of which gives the same rows whoever does it, kept in a folder as they are done.

mod fits;
mod folder;
mod losses;
mod row;
mod study;
mod task;
mod work;

pub use folder::{Folder, FolderError, decoded, encoded};
pub use losses::{broken, loss, worst};
pub use row::{Outcome, Row};
pub use study::{Study, StudyError};
pub use task::{Shard, ShardError, Task, TaskError};
pub use work::{Observer, RunError, Stopped, run};
