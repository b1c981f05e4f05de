//! Writing the firmware: what is refused, what is written, and that there is a way back from every interruption.

#[cfg(unix)]
#[path = "../support/mod.rs"]
mod support;

mod check;
#[cfg(unix)]
mod command;
mod elf;
mod interrupted;
#[cfg(unix)]
mod probe;
mod rom;
