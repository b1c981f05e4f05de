//! A touch, from what is asked for to what is answered, without planning or driving it.
//!
//! `request` is what is asked for as it comes, `check` makes of it a [`Touch`], the one type that planner and board are asked with; `admission` numbers requests and gives
//! places at the planner in turn. `answer` is what a touch has led to, `outcome` what became of a request, `plan_view` plans and fields
//! as JSON, `active_plan` a plan that is driven.
//!
//! Uses `api` and `access`.

pub mod active_plan;
pub mod admission;
pub mod answer;
pub mod check;
pub mod effect_file;
pub mod outcome;
pub mod plan_view;
pub mod request;

pub use check::Touch;
