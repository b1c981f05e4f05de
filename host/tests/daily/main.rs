//! The daemon in daily use: nothing hangs, nothing is lost, nobody gets in.

#[path = "../support/mod.rs"]
mod support;

mod access;
mod boards;
mod bodies;
mod busy;
mod by_hand;
mod closing;
mod controls;
mod costs;
mod drags;
mod figures;
mod fingers;
mod hang_up;
mod heads;
mod late;
mod limits;
mod line;
mod loss;
mod measured;
mod numbers;
mod order;
mod pages;
mod peaks;
mod raw;
mod recorded;
mod secrets;
mod serving;
mod sliders;
mod stops;
mod wrong_fingers;
