//! What came of a study: a table of all designs, the front of those that no other surpasses, finalists, effects of the variables.

mod effects;
mod finalists;
mod limits;
mod pareto;
mod parquet;
mod table;
mod verify;

pub use self::parquet::{TableError, write_parquet_table as write_parquet};
pub use effects::{DimensionLevels, EffectAnalysis, Interaction, MainEffect};
pub use finalists::choose_distinct_finalist_indices_meeting_limits_best_first;
pub use limits::{
    constraint_names_and_signed_excesses_of_design, describe_broken_limits_if_any, objective_names_and_losses_of_design,
};
pub use pareto::flag_losses_on_pareto_front;
pub use table::{DesignStatus, DesignTable, GatherError, TableEntry};
pub use verify::{Finalist, VerifiedFinalists};
