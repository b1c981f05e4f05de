//! What is looked at in the crates that this depends on, with cargo-deny: licences, bans and sources always; advisories from a
//! copy of their database, where there is one.
//!
//! Continuous integration reaches the package registries and nothing else, so it cannot fetch the database: whoever can
//! clones it and names the clone.

use crate::error::{Error, file_error};
use crate::process::{capture_output, run_command};
use crate::repository_root;
use clap::Args;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Names a clone of the advisory database.
const VARIABLE: &str = "ERA_ADVISORY_DB";
/// Where it is looked for otherwise, from the repository's root.
const DATABASE: &str = "target/advisory-db";
/// Where it comes from.
const ORIGIN: &str = "https://github.com/rustsec/advisory-db";
/// What cargo-deny calls its clone of that: the last part of the address, and a hash of the address.
const CLONE: &str = "advisory-db-3157b0e258782691";

/// Which database.
#[derive(Args)]
pub struct Options {
    /// A clone of the RustSec advisory database [default: what ERA_ADVISORY_DB names, or else target/advisory-db]
    #[arg(long, value_name = "DIR")]
    db: Option<PathBuf>,
}

/// Checks both workspaces against a database.
///
/// # Errors
/// [`Error::NoAdvisories`] if there is none, [`Error::Failed`] if a crate is in it.
pub fn check_advisories_in_given_or_local_database(options: &Options) -> Result<(), Error> {
    let root = repository_root()?;
    match options.db.clone().or_else(|| find_advisory_database(&root)) {
        Some(database) => fetch_crates_and_check_advisories_in_database(&root, &database),
        None => Err(Error::NoAdvisories(explain_missing_advisory_database())),
    }
}

/// The same where a database is at hand; otherwise says what is not checked.
///
/// # Errors
/// As [`check_advisories_in_given_or_local_database`], but for a database that is not there.
pub fn check_advisories_if_database_present() -> Result<(), Error> {
    let root = repository_root()?;
    if let Some(database) = find_advisory_database(&root) {
        return fetch_crates_and_check_advisories_in_database(&root, &database);
    }
    println!("{}", explain_missing_advisory_database());
    Ok(())
}

/// Licences, bans and sources of both workspaces.
///
/// # Errors
/// [`Error::Failed`] with the first that is not as `deny.toml` wants it.
pub fn ensure_cargo_deny_and_check_licences_bans_and_sources() -> Result<(), Error> {
    let root = repository_root()?;
    install_crate_if_probe_command_fails(&root, "cargo-deny", &["cargo", "deny", "--version"])?;
    for folder in list_workspace_folders(&root) {
        let mut deny = cargo_deny_command(&folder, &root.join("deny.toml"));
        run_command(deny.args(["check", "licenses", "bans", "sources"]))?;
    }
    Ok(())
}

fn explain_missing_advisory_database() -> String {
    format!(
        "there is no database of advisories, so known vulnerabilities are not checked; to check them, run \
         `git clone {ORIGIN} {DATABASE} && cargo xtask advisories` (--db or {VARIABLE} names another clone)"
    )
}

fn find_advisory_database(root: &Path) -> Option<PathBuf> {
    let named = std::env::var_os(VARIABLE).filter(|path| !path.is_empty()).map(PathBuf::from);
    named.or_else(|| Some(root.join(DATABASE)).filter(|path| path.exists()))
}

fn fetch_crates_and_check_advisories_in_database(root: &Path, database: &Path) -> Result<(), Error> {
    let database = database.canonicalize().map_err(file_error("cannot find", database))?;
    let crates = database.join("crates");
    std::fs::read_dir(&crates).map_err(file_error("no database of advisories: cannot read", &crates))?;
    // Its own date, not that of cloning it: what was found since then is not in it.
    let date =
        capture_output(Command::new("git").arg("-C").arg(&database).args(["show", "-s", "--format=%cs", "HEAD"]))?;
    println!("advisories as of {date}, from {}", database.display());
    install_crate_if_probe_command_fails(root, "cargo-deny", &["cargo", "deny", "--version"])?;
    let config = link_database_and_write_deny_config(root, &database)?;
    for folder in list_workspace_folders(root) {
        // cargo-deny asks cargo for crates of all platforms, which no build has got.
        run_command(Command::new("cargo").current_dir(&folder).args(["fetch", "--locked", "--quiet"]))?;
        run_command(cargo_deny_command(&folder, &config).args(["--offline", "check", "advisories"]))?;
    }
    Ok(())
}

/// Makes cargo-deny take a database for the clone that it would have fetched, and gives the configuration that says so.
fn link_database_and_write_deny_config(root: &Path, database: &Path) -> Result<PathBuf, Error> {
    let folder = root.join("target/advisories");
    std::fs::create_dir_all(&folder).map_err(file_error("cannot make", &folder))?;
    let link = folder.join(CLONE);
    if link.is_symlink() {
        std::fs::remove_file(&link).map_err(file_error("cannot remove", &link))?;
    }
    symlink(database, &link).map_err(file_error("cannot make", &link))?;
    let (own, config) = (root.join("deny.toml"), folder.join("deny.toml"));
    let text = std::fs::read_to_string(&own).map_err(file_error("cannot read", &own))?;
    let text = text.replace("[advisories]\n", &format!("[advisories]\ndb-path = {:?}\n", folder.display().to_string()));
    std::fs::write(&config, text).map_err(file_error("cannot write", &config))?;
    Ok(config)
}

#[cfg(unix)]
fn symlink(target: &Path, link: &Path) -> std::io::Result<()> {
    std::os::unix::fs::symlink(target, link)
}

#[cfg(not(unix))]
fn symlink(_: &Path, _: &Path) -> std::io::Result<()> {
    Err(std::io::Error::new(std::io::ErrorKind::Unsupported, "advisories are checked on Unix"))
}

fn list_workspace_folders(root: &Path) -> [PathBuf; 2] {
    [root.to_path_buf(), root.join("firmware")]
}

fn cargo_deny_command(folder: &Path, config: &Path) -> Command {
    let mut command = Command::new("cargo");
    command.current_dir(folder).args(["deny", "--config"]).arg(config);
    command
}

/// Installs a crate that is a program, if `probe_command`, such as one that prints its version, fails.
///
/// # Errors
/// [`Error::Start`], [`Error::Failed`].
pub fn install_crate_if_probe_command_fails(
    root: &Path,
    crate_name: &str,
    probe_command: &[&str],
) -> Result<(), Error> {
    let Some((program, arguments)) = probe_command.split_first() else { return Ok(()) };
    let mut version = Command::new(program);
    version.args(arguments).stdout(Stdio::null()).stderr(Stdio::null());
    if version.status().is_ok_and(|status| status.success()) {
        return Ok(());
    }
    let mut install = Command::new("cargo");
    install.current_dir(root).args(["install", crate_name, "--locked", "--quiet"]);
    // These programs run for some seconds, and their own release settings take minutes to build them.
    install.envs([
        ("CARGO_PROFILE_RELEASE_OPT_LEVEL", "1"),
        ("CARGO_PROFILE_RELEASE_LTO", "off"),
        ("CARGO_PROFILE_RELEASE_CODEGEN_UNITS", "16"),
        ("CARGO_PROFILE_RELEASE_DEBUG", "false"),
    ]);
    run_command(&mut install)
}
