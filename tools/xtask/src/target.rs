//! The compilation target of the firmware: from rustup, or built from the standard library's sources.
//!
//! rustup's server is not reachable from everywhere, Debian's mirrors mostly are: Debian packages the sources of the
//! same compiler. With them cargo builds `core` and `alloc` itself, which stable cargo only does when told to behave
//! like a nightly one (`RUSTC_BOOTSTRAP`).

use crate::error::{Error, file_error};
use crate::process::{capture_output, run_command, run_command_silently_returning_cause_line_on_failure};
pub use crate::triple::TARGET;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Debian suite whose `rust-src` is that of this project's compiler.
const SUITE: &str = "trixie-backports";
/// Signs Debian's package lists; in the package debian-archive-keyring.
const KEYRING: &str = "/usr/share/keyrings/debian-archive-keyring.gpg";

/// How the target was had.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CompileTargetSource {
    /// It is installed as rustup or the distribution put it there.
    Installed,
    /// rustup has just added it.
    Rustup,
    /// Cargo must build `core` and `alloc` from the sources that are now there.
    BuildStd,
}

impl CompileTargetSource {
    /// For a person.
    pub fn describe(self) -> &'static str {
        match self {
            CompileTargetSource::Installed => "target installed",
            CompileTargetSource::Rustup => "target added by rustup",
            CompileTargetSource::BuildStd => "core and alloc built from Debian's rust-src",
        }
    }
}

/// Gets the target. `build_std` skips the first way.
///
/// # Errors
/// [`Error::NoTarget`] if both ways fail.
pub fn ensure_compile_target_available(scratch: &Path, build_std: bool) -> Result<CompileTargetSource, Error> {
    if !build_std && is_target_installed()? {
        return Ok(CompileTargetSource::Installed);
    }
    if build_std {
        return ensure_std_sources_in_sysroot(scratch).map(|()| CompileTargetSource::BuildStd);
    }
    eprintln!("firmware: adding the target {TARGET} with rustup");
    let rustup = match run_command_silently_returning_cause_line_on_failure(
        Command::new("rustup").args(["target", "add", TARGET]),
    ) {
        Ok(()) if is_target_installed()? => return Ok(CompileTargetSource::Rustup),
        Ok(()) => "the target was added to a toolchain that is not in use".to_owned(),
        Err(reason) => reason,
    };
    match ensure_std_sources_in_sysroot(scratch) {
        Ok(()) => Ok(CompileTargetSource::BuildStd),
        Err(source) => Err(Error::NoTarget { rustup, source: Box::new(source) }),
    }
}

/// Whether the target is installed, or can be built from sources that are there.
pub fn is_compile_target_installed_or_buildable() -> bool {
    is_target_installed().unwrap_or(false)
        || find_compiler_version_and_std_source_path().is_ok_and(|(_, library)| has_core_sources(&library))
}

fn rustc_command() -> Command {
    Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()))
}

fn is_target_installed() -> Result<bool, Error> {
    let directory = capture_output(rustc_command().args(["--print", "target-libdir", "--target", TARGET]))?;
    Ok(fs::read_dir(directory).is_ok_and(|entries| {
        entries.flatten().any(|entry| entry.file_name().to_string_lossy().starts_with("libcore-"))
    }))
}

/// The compiler's version, and where cargo looks for the sources of its standard library.
fn find_compiler_version_and_std_source_path() -> Result<(String, PathBuf), Error> {
    let verbose = capture_output(rustc_command().arg("-vV"))?;
    let compiler = verbose.lines().find_map(|line| line.strip_prefix("release: ")).unwrap_or("unknown").to_owned();
    let sysroot = PathBuf::from(capture_output(rustc_command().args(["--print", "sysroot"]))?);
    Ok((compiler, sysroot.join("lib/rustlib/src/rust/library")))
}

fn has_core_sources(library: &Path) -> bool {
    library.join("core/src/lib.rs").exists()
}

/// Puts the standard library's sources where cargo looks for them.
fn ensure_std_sources_in_sysroot(scratch: &Path) -> Result<(), Error> {
    let (compiler, library) = find_compiler_version_and_std_source_path()?;
    if has_core_sources(&library) {
        return Ok(());
    }
    // Before anything is downloaded: it may not be this user's to write to.
    let parent = library.parent().unwrap_or(&library);
    fs::create_dir_all(parent).map_err(|source| Error::NoSources {
        compiler: compiler.clone(),
        reason: format!("cannot make {}: {source}", parent.display()),
    })?;
    eprintln!("firmware: fetching the sources of the standard library from Debian's {SUITE}");
    let package = download_debian_rust_src_package(scratch, &compiler)?;
    let unpacked = scratch.join("unpacked");
    run_command(Command::new("dpkg-deb").arg("-x").args([&package, &unpacked]))?;
    let sources = unpacked.join(format!("usr/src/rustc-{compiler}/library"));
    if !sources.exists() {
        let reason = format!("{} does not contain usr/src/rustc-{compiler}/library", package.display());
        return Err(Error::NoSources { compiler, reason });
    }
    // Copied under another name and renamed last, so that a copy that was broken off is not taken for a whole one.
    let partial = parent.join("library.partial");
    run_command(Command::new("rm").arg("-rf").arg(&partial))?;
    run_command(Command::new("cp").arg("-r").args([&sources, &partial]))?;
    fs::rename(&partial, &library).map_err(|source| Error::File { what: "cannot rename to", path: library, source })
}

/// Downloads Debian's `rust-src` with an apt configuration of its own, which needs no rights and leaves the machine's
/// package lists alone.
fn download_debian_rust_src_package(scratch: &Path, compiler: &str) -> Result<PathBuf, Error> {
    for directory in ["state/lists/partial", "cache/archives/partial", "package"] {
        let path = scratch.join(directory);
        fs::create_dir_all(&path).map_err(file_error("cannot make", &path))?;
    }
    let sources = scratch.join("sources.list");
    let mirror = find_debian_mirror().ok_or_else(|| Error::NoSources {
        compiler: compiler.to_owned(),
        reason: "this machine's apt configuration names no Debian mirror".to_owned(),
    })?;
    let line = format!("deb [signed-by={KEYRING}] {mirror} {SUITE} main\n");
    fs::write(&sources, line).map_err(file_error("cannot write", &sources))?;
    if !Path::new(KEYRING).exists() {
        let reason = format!("{KEYRING} is missing; install the package debian-archive-keyring");
        return Err(Error::NoSources { compiler: compiler.to_owned(), reason });
    }

    let apt = |program: &str, arguments: &[&str]| {
        let mut command = Command::new(program);
        command
            .arg("--quiet")
            .args(["-o", &format!("Dir::Etc::SourceList={}", sources.display())])
            .args(["-o", "Dir::Etc::SourceParts=-"])
            .args(["-o", &format!("Dir::State={}", scratch.join("state").display())])
            .args(["-o", &format!("Dir::Cache={}", scratch.join("cache").display())])
            // apt otherwise fetches as a user of its own, which may not write here.
            .args(["-o", "APT::Sandbox::User="])
            .args(arguments)
            .current_dir(scratch.join("package"))
            .stdout(Stdio::null());
        command
    };
    let failed = |reason| Error::NoSources { compiler: compiler.to_owned(), reason };
    run_command_silently_returning_cause_line_on_failure(&mut apt("apt-get", &["update"])).map_err(failed)?;
    // The suite keeps the packages of several compilers; the newest is not the one wanted.
    let listed = capture_output(apt("apt-cache", &["madison", "rust-src"]).stdout(Stdio::piped()))?;
    let versions: Vec<&str> = listed.lines().filter_map(|line| line.split('|').nth(1)).map(str::trim).collect();
    let Some(version) = versions.iter().find(|version| version.starts_with(&format!("{compiler}+"))) else {
        let reason = format!("{SUITE} has only the versions {}", versions.join(", "));
        return Err(Error::NoSources { compiler: compiler.to_owned(), reason });
    };
    run_command_silently_returning_cause_line_on_failure(&mut apt(
        "apt-get",
        &["download", &format!("rust-src={version}")],
    ))
    .map_err(failed)?;
    let directory = scratch.join("package");
    let entries = fs::read_dir(&directory).map_err(file_error("cannot read", &directory))?;
    entries
        .flatten()
        .map(|entry| entry.path())
        .find(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            name.starts_with(&format!("rust-src_{compiler}")) && name.ends_with(".deb")
        })
        .ok_or_else(|| Error::NoSources { compiler: compiler.to_owned(), reason: "apt downloaded nothing".to_owned() })
}

/// The Debian mirror that this machine uses already.
fn find_debian_mirror() -> Option<String> {
    let listed = capture_output(Command::new("apt-get").args([
        "indextargets",
        "--format",
        "$(REPO_URI)",
        "Created-By: Packages",
    ]));
    let text = listed.ok()?;
    text.lines().map(|line| line.trim_end_matches('/')).find(|line| line.ends_with("/debian")).map(str::to_owned)
}
