//! The program as its users see it: commands, options, messages, daemon and interfaces.

#[path = "../support/mod.rs"]
mod support;

mod clock;
mod command_line;
mod competing;
mod described;
mod description;
mod doctor;
mod effect_figures;
mod effect_files;
mod examples;
mod hammer;
mod http;
mod monitor;
mod old_board;
mod operation;
mod options;
mod preview;
mod study;
mod touches;
