//! Building the firmware's image, as it is for flashing.

use crate::error::Error;
use crate::process::{format_command, run_command};
use crate::repository_root;
use crate::target::{self, CompileTargetSource, TARGET};
use serde::Deserialize;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// Name of the executable.
const IMAGE: &str = "era-firmware";

/// Builds the image and returns its path, and how the target was had.
///
/// # Errors
/// What went wrong in getting the target or building.
pub fn build_image_and_return_target_source(build_std: bool) -> Result<(PathBuf, CompileTargetSource), Error> {
    let (mut cargo, way) = ensure_target_and_get_firmware_cargo_command("build", build_std)?;
    cargo.args(["--message-format", "json-render-diagnostics"]).stdout(Stdio::piped());
    let mut child = cargo.spawn().map_err(|source| Error::Start { command: format_command(&cargo), source })?;
    let mut image = None;
    for line in child.stdout.take().map(BufReader::new).into_iter().flat_map(BufRead::lines).map_while(Result::ok) {
        if let Ok(Message { executable: Some(path), target: Some(target) }) = serde_json::from_str(&line)
            && target.name == IMAGE
        {
            image = Some(path);
        }
    }
    let status = child.wait().map_err(|source| Error::Start { command: format_command(&cargo), source })?;
    if !status.success() {
        return Err(Error::Failed { command: format_command(&cargo), status });
    }
    Ok((image.ok_or(Error::NoImage(IMAGE))?, way))
}

/// Runs another cargo command over the firmware as it is built for flashing.
///
/// # Errors
/// What went wrong in getting the target or running.
pub fn run_firmware_cargo(subcommand: &str, arguments: &[&str]) -> Result<(), Error> {
    let (mut cargo, _) = ensure_target_and_get_firmware_cargo_command(subcommand, false)?;
    run_command(cargo.args(arguments))
}

fn ensure_target_and_get_firmware_cargo_command(
    subcommand: &str,
    build_std: bool,
) -> Result<(Command, CompileTargetSource), Error> {
    let root = repository_root()?;
    let way = target::ensure_compile_target_available(&root.join("target/rust-src"), build_std)?;
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo
        // From its own folder, so that its own .cargo/config.toml applies.
        .current_dir(root.join("firmware"))
        .args([subcommand, "--release", "--locked", "--target", TARGET])
        // Two builds of one image must not depend on where the host's own build goes.
        .env_remove("CARGO_TARGET_DIR");
    if way == CompileTargetSource::BuildStd {
        cargo.arg("-Zbuild-std=core,alloc").env("RUSTC_BOOTSTRAP", "1");
    }
    Ok((cargo, way))
}

/// What is of interest in a line of cargo's output.
#[derive(Deserialize)]
struct Message {
    executable: Option<PathBuf>,
    target: Option<MessageTarget>,
}

#[derive(Deserialize)]
struct MessageTarget {
    name: String,
}
