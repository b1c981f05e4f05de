//! Panels and plans, without a daemon but for a few: what is computed agrees with the simulated device, with recorded plans and with itself.

#[path = "../support/mod.rs"]
mod support;

mod edges;
mod effects;
mod faces;
mod golden_plans;
mod mode_shapes;
mod panels_off;
mod patched_scenes;
mod pictures;
mod planning;
mod press;
mod reach;
mod resistors;
#[path = "../../planner/tests/relations/spec.rs"]
#[allow(dead_code, reason = "the relations of the planner use all of it")]
mod spec;
mod succession;
mod tolerance;
mod verification;
