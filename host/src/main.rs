//! The program `era`.

use std::process::ExitCode;

fn main() -> ExitCode {
    era::cli::main()
}
