//! `cargo xtask dist`: all that a release has, in `target/dist`: Debian's package, the Python wheel, the firmware's image, the manual, and checksums.
//! The package is tried in a Debian system of its own.

mod chroot;
mod package;

use crate::error::{Error, file_error};
use crate::process::{capture_output, run_command};
use crate::release_build::build_release_programs_by_package_and_binary_name;
use crate::{dependencies, image, python, repository_root, setup};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What to make.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Do not install the package in a Debian system of its own, which root alone can make
    #[arg(long)]
    no_chroot: bool,
}

/// Makes everything, and tries the package.
///
/// # Errors
/// What could not be built, written or installed; [`Error::Package`] where the installed program does not do what it should.
pub fn build_release_and_try_package_in_chroot_unless_disabled(options: &Options) -> Result<(), Error> {
    setup::install_missing_needs(
        "cargo xtask dist",
        if options.no_chroot { setup::DIST } else { setup::DIST_IN_CHROOT },
    )?;
    let root = repository_root()?;
    let out = root.join("target/dist");
    clear_folder(&out)?;
    build_release_programs_by_package_and_binary_name(&root, &[("era-host", "era")])?;
    let manual = build_manual_folder_and_archive(&root, &out)?;
    let package = package::build_package(&root, &out, &manual)?;
    copy_into_folder(&python::build_wheel(&root)?, &out)?;
    let (firmware, _) = image::build_image_and_return_target_source(false)?;
    // All parts have one version.
    copy_file(&firmware, &out.join(concat!("era-firmware-", env!("CARGO_PKG_VERSION"), ".elf")))?;
    write_checksums(&out)?;
    if options.no_chroot {
        println!("skipped: the test of the package in a separate Debian system (--no-chroot)");
    } else {
        chroot::try_package_in_chroot(&root, &package)?;
    }
    println!(
        "the release is in {}:\n{}",
        out.display(),
        capture_output(Command::new("sha256sum").current_dir(&out).args(["--check", "SHA256SUMS"]))?
    );
    Ok(())
}

/// The manual as pages for a browser, in a folder of `out`.
fn build_manual_folder_and_archive(root: &Path, out: &Path) -> Result<PathBuf, Error> {
    dependencies::install_crate_if_probe_command_fails(root, "mdbook", &["mdbook", "--version"])?;
    let manual = out.join("manual");
    run_command(Command::new("mdbook").current_dir(root).args(["build", "docs", "--dest-dir"]).arg(&manual))?;
    run_command(Command::new("tar").current_dir(out).args([
        "--create",
        "--gzip",
        "--file",
        "era-manual.tar.gz",
        "manual",
    ]))?;
    Ok(manual)
}

/// SHA-256 of each file of `out`, as `sha256sum --check` reads them.
fn write_checksums(out: &Path) -> Result<(), Error> {
    let mut names: Vec<PathBuf> = list_files_directly_in_folder_unsorted(out)?
        .iter()
        .filter_map(|path| path.file_name().map(PathBuf::from))
        .collect();
    names.sort();
    let sums = capture_output(Command::new("sha256sum").current_dir(out).args(&names))?;
    write_file(&out.join("SHA256SUMS"), &format!("{sums}\n"))
}

fn list_files_directly_in_folder_unsorted(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let entries = fs::read_dir(folder).map_err(file_error("cannot read", folder))?;
    Ok(entries.filter_map(Result::ok).map(|entry| entry.path()).filter(|path| path.is_file()).collect())
}

fn clear_folder(folder: &Path) -> Result<(), Error> {
    if folder.exists() {
        fs::remove_dir_all(folder).map_err(file_error("cannot remove", folder))?;
    }
    make_folder(folder)
}

fn make_folder(folder: &Path) -> Result<(), Error> {
    fs::create_dir_all(folder).map_err(file_error("cannot make", folder))
}

fn write_file(path: &Path, text: &str) -> Result<(), Error> {
    fs::write(path, text).map_err(file_error("cannot write", path))
}

fn copy_file(from: &Path, to: &Path) -> Result<(), Error> {
    fs::copy(from, to).map(drop).map_err(file_error("cannot copy", from))
}

fn copy_into_folder(from: &Path, folder: &Path) -> Result<(), Error> {
    copy_file(from, &folder.join(from.file_name().unwrap_or_default()))
}
