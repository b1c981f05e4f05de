//! What came of a study: a table of all designs, the front of those that no other surpasses, finalists, effects of the variables.

mod effects;
mod finalists;
mod limits;
mod pareto;
mod parquet;
mod table;
mod verify;

pub use self::parquet::{TableError, write as write_parquet};
pub use effects::{Cut, Effect, Effects, Interaction};
pub use finalists::finalists;
pub use limits::{broken_limits, constraints_of, objectives_of};
pub use pareto::front;
pub use table::{Entry, GatherError, Status, Table};
pub use verify::{Finalist, Finals};
