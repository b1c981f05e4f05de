//! What is installed beside the program on Linux: a udev rule for the board ([`rule`]) and a systemd unit for the daemon
//! ([`mod@unit`]), as files that know who wrote them ([`files`]).

pub mod files;
pub mod rule;
pub mod unit;
