//! Panels and plans, without a daemon but for a few: what is computed agrees with the simulated device, with recorded plans and with itself.

#[path = "../support/mod.rs"]
mod support;

mod edges;
mod effects;
mod golden_plans;
mod mode_shapes;
mod panels_off;
mod patched_scenes;
mod pictures;
mod planning;
mod press;
mod reach;
mod relations;
mod resistors;
mod scene;
mod succession;
mod tolerance;
mod verification;
