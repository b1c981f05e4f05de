//! `cargo xtask python`: the Python package as a wheel, in an environment of its own, with its tests, types and examples.
//!
//! The wheel is built in release mode, as the tests are.

use crate::error::{Error, file_error};
use crate::process::run_command;
use crate::release_build::build_release_programs_by_package_and_binary_name;
use crate::{repository_root, setup};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Where the package is.
const PACKAGE: &str = "host/python";

/// Sets up what it needs, and the program that the package is compared with, then runs everything.
///
/// # Errors
/// [`Error::Missing`], [`Error::Python`], [`Error::File`], [`Error::Start`], or [`Error::Failed`] with what failed.
pub fn install_needs_build_program_and_check_python_package() -> Result<(), Error> {
    setup::install_missing_needs("cargo xtask python", setup::PYTHON)?;
    let root = repository_root()?;
    build_release_programs_by_package_and_binary_name(&root, &[("era-host", "era")])?;
    build_and_install_wheel_and_run_python_tests_and_type_checks()
}

/// The same beside the program of the workspace's tests.
///
/// # Errors
/// As [`install_needs_build_program_and_check_python_package`].
pub fn build_and_install_wheel_and_run_python_tests_and_type_checks() -> Result<(), Error> {
    let root = repository_root()?;
    let folder = root.join(PACKAGE);
    let python = ensure_package_environment_and_find_interpreter(&root)?;
    let wheel = build_wheel(&root)?;
    let install = ["-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--force-reinstall"];
    run_command(Command::new(&python).args(install).arg(&wheel))?;
    let ask = |arguments: &[&str]| {
        let mut command = Command::new(&python);
        command.current_dir(&folder).args(arguments);
        command.env("ERA_PROGRAM", root.join("target/release/era")).env("MPLBACKEND", "Agg");
        // Whatever a wheel lacks must not be found beside it.
        command.env("PYTHONSAFEPATH", "1").env("PYTHONDONTWRITEBYTECODE", "1");
        run_command(&mut command)
    };
    let cache = format!("cache_dir={}", root.join("target/python-pytest").display());
    ask(&["-m", "pytest", "--quiet", "-o", &cache])?;
    let cache = format!("--cache-dir={}", root.join("target/python-mypy").display());
    ask(&["-m", "mypy", &cache, "tests", "gallery"])?;
    ask(&["-m", "mypy.stubtest", "era", "--ignore-disjoint-bases"])
}

/// The interpreter of an environment with what the package's build and tests need.
fn ensure_package_environment_and_find_interpreter(root: &Path) -> Result<PathBuf, Error> {
    let requirements = root.join(PACKAGE).join("requirements.txt");
    python_environment::ensure_environment_and_return_interpreter(&requirements, &root.join("target/python-venv"))
        .map_err(Error::Python)
}

/// Builds the wheel and returns its file.
///
/// # Errors
/// [`Error::Python`], [`Error::File`], [`Error::Start`], [`Error::Failed`].
pub fn build_wheel(root: &Path) -> Result<PathBuf, Error> {
    let python = ensure_package_environment_and_find_interpreter(root)?;
    let out = root.join("target/python-wheel");
    // Another version's wheel has another name.
    if out.exists() {
        std::fs::remove_dir_all(&out).map_err(file_error("cannot remove", &out))?;
    }
    let mut maturin = Command::new(&python);
    maturin.current_dir(root.join(PACKAGE)).args([
        "-m",
        "maturin",
        "build",
        "--release",
        "--quiet",
        "--features",
        "as-tested",
        "--compatibility",
        "linux",
    ]);
    run_command(maturin.arg("--interpreter").arg(&python).arg("--out").arg(&out))?;
    let entries = std::fs::read_dir(&out).map_err(file_error("cannot read", &out))?;
    let is_wheel = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "whl");
    let wheel = entries.filter_map(Result::ok).map(|entry| entry.path()).find(is_wheel);
    wheel.ok_or_else(|| file_error("found no wheel in", &out)(std::io::ErrorKind::NotFound.into()))
}
