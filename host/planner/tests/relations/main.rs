//! Relations between answers that need no reference: what must be equal, reciprocal, positive or no worse, on random scenes through
//! the public interfaces. The scenes are the same every time; `ERA_RELATIONS=20` tries twenty times as many.
//!
//! Comments say with which planted mistakes the tests were seen to fail.

mod ask;
mod energy;
mod equivalent;
mod plans;
mod scaling;
mod spec;
mod symmetry;
