//! What surrounds the daemon where it is in daily use: completions, man pages, logs, the service manager.

mod config;
mod install;
mod logs;
mod manual;
mod notify;
