//! What a command needs of the machine besides Rust and a C linker: gets it if it may, and otherwise names all that is
//! missing, and the command that installs it, in one message before anything else is run.
//!
//! Debian's packages are installed by root, or through a `sudo` that asks no question. The compilation target and the
//! toolchain's components come from rustup, which needs no rights. This is the only list of packages.

use crate::error::Error;
use crate::process::{has_python_with_venv, run_command_silently_returning_cause_line_on_failure};
use crate::repository_root;
use crate::target::{self, TARGET};
use std::fmt::Write;
use std::process::{Command, Stdio};

/// Something that may be missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// Python with its modules for virtual environments.
    Python,
    /// A browser that takes commands.
    Browser,
    /// The reverse proxy of the manual.
    Nginx,
    /// What makes certificates as people make them.
    Openssl,
    /// A compiler for libFuzzer.
    Cxx,
    /// What looks through systemd's units.
    Systemd,
    /// What makes a Debian system in a folder.
    Debootstrap,
    /// What looks into Debian's packages.
    Dpkg,
    /// rustfmt and clippy.
    Lints,
    /// What the firmware is compiled with.
    Target,
}

/// What `cargo xtask test` needs.
pub const TEST: &[Need] = &[Need::Python, Need::Browser, Need::Nginx, Need::Openssl, Need::Target];
/// What `cargo xtask ci` needs.
pub const CI: &[Need] =
    &[Need::Python, Need::Browser, Need::Nginx, Need::Openssl, Need::Cxx, Need::Systemd, Need::Lints, Need::Target];

/// What `cargo xtask python` needs.
pub const PYTHON: &[Need] = &[Need::Python];
/// What `cargo xtask dist` needs.
pub const DIST: &[Need] = &[Need::Python, Need::Dpkg, Need::Target];
/// The same with the trial of the package.
pub const DIST_IN_CHROOT: &[Need] = &[Need::Python, Need::Dpkg, Need::Debootstrap, Need::Target];
/// What `cargo xtask crosscheck` needs.
pub const CROSSCHECK: &[Need] = &[Need::Python];

/// Programs that the page's tests take for a browser.
const BROWSERS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];
/// Set by whoever wants the page's tests skipped.
const NO_BROWSER: &str = "ERA_NO_BROWSER";
/// Where nginx may be: Debian has it where only root looks.
const NGINX: [&str; 2] = ["nginx", "/usr/sbin/nginx"];
/// Set by whoever wants the test of the reverse proxy skipped.
const NO_NGINX: &str = "ERA_NO_NGINX";

impl Need {
    /// What it is, and what for.
    fn describe(self) -> String {
        match self {
            Need::Python => {
                "python3 with the modules venv and ensurepip, for the emulated board, the independent reference and the \
                 Python package"
                    .into()
            }
            Need::Browser => format!("a browser ({}), for the tests of the page", BROWSERS.join(", ")),
            Need::Nginx => "nginx, for the test of the reverse proxy that the manual describes".into(),
            Need::Openssl => "openssl, for certificates in the tests of clients".into(),
            Need::Cxx => "a C++ compiler (c++), for the fuzzing engine".into(),
            Need::Systemd => "systemd-analyze, for the units of `era install`".into(),
            Need::Debootstrap => "debootstrap, for the test of the Debian package of `era`".into(),
            Need::Dpkg => "dpkg-deb and dpkg-shlibdeps, for Debian's package".into(),
            Need::Lints => "rustfmt and clippy, for formatting and lints".into(),
            Need::Target => format!("the compilation target {TARGET}, for the firmware"),
        }
    }

    /// Debian's packages for it; none if it is no matter of packages.
    fn debian_packages(self) -> &'static [&'static str] {
        match self {
            Need::Python => &["python3", "python3-venv"],
            Need::Browser => &["chromium"],
            Need::Nginx => &["nginx"],
            Need::Openssl => &["openssl"],
            Need::Cxx => &["g++"],
            Need::Systemd => &["systemd"],
            Need::Debootstrap => &["debootstrap"],
            Need::Dpkg => &["dpkg-dev"],
            Need::Lints | Need::Target => &[],
        }
    }

    /// What rustup gets it by.
    fn rustup_arguments(self) -> Option<&'static [&'static str]> {
        match self {
            Need::Lints => Some(&["component", "add", "rustfmt", "clippy"]),
            Need::Target => Some(&["target", "add", TARGET]),
            Need::Python
            | Need::Browser
            | Need::Nginx
            | Need::Openssl
            | Need::Cxx
            | Need::Systemd
            | Need::Debootstrap
            | Need::Dpkg => None,
        }
    }
}

/// How this user may install packages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum InstallRights {
    /// As root.
    Root,
    /// By a `sudo` that does not ask.
    Sudo,
    /// Only after a question, or not at all.
    None,
}

/// A machine, as far as the set-up is concerned.
trait Machine {
    fn is_need_met(&self, need: Need) -> bool;
    fn has_apt(&self) -> bool;
    fn find_install_rights(&self) -> InstallRights;
    /// Installs Debian's packages, or says why not.
    fn install_packages(&self, packages: &[&str], rights: InstallRights) -> Result<(), String>;
    /// Gets what is no matter of packages, or says why not.
    fn install_need_without_packages(&self, need: Need) -> Result<(), String>;
}

/// Gets what `needing_command` needs.
///
/// # Errors
/// [`Error::Missing`] with all that is missing and how to install it.
pub fn install_missing_needs(needing_command: &str, needs: &[Need]) -> Result<(), Error> {
    install_missing_needs_on_machine(&ThisMachine, needing_command, needs)
}

fn install_missing_needs_on_machine(
    machine: &impl Machine,
    needing_command: &str,
    needs: &[Need],
) -> Result<(), Error> {
    let missing = |needs: &[Need]| needs.iter().copied().filter(|need| !machine.is_need_met(*need)).collect::<Vec<_>>();
    let first = missing(needs);
    let packages = list_debian_packages_of_needs(&first);
    let rights = machine.find_install_rights();
    let mut reasons = Vec::new();
    if !packages.is_empty() && machine.has_apt() && rights != InstallRights::None {
        eprintln!("set-up: installing {}", packages.join(" "));
        if let Err(reason) = machine.install_packages(&packages, rights) {
            reasons.push(reason);
        }
    }
    // Tried even if packages stay missing, so that the message has everything.
    for need in first.iter().copied().filter(|need| need.rustup_arguments().is_some()) {
        if let Err(reason) = machine.install_need_without_packages(need) {
            reasons.push(reason);
        }
    }
    // What is there is not looked for twice.
    let still = missing(&first);
    if still.is_empty() {
        return Ok(());
    }
    Err(Error::Missing {
        command: needing_command.to_owned(),
        list: format_missing_needs(&still, &reasons, machine.has_apt(), rights),
    })
}

fn list_debian_packages_of_needs(missing: &[Need]) -> Vec<&'static str> {
    missing.iter().flat_map(|need| need.debian_packages()).copied().collect()
}

/// All that is missing, why it could not be had, and the command that installs it.
fn format_missing_needs(missing: &[Need], reasons: &[String], has_apt: bool, rights: InstallRights) -> String {
    let mut text = String::new();
    for need in missing {
        let _ = write!(text, "\n  - {}", need.describe());
    }
    for reason in reasons {
        let _ = write!(text, "\n(the installation failed: {reason})");
    }
    let packages = list_debian_packages_of_needs(missing);
    let mut commands = Vec::new();
    if !packages.is_empty() {
        let sudo = if rights == InstallRights::Root { "" } else { "sudo " };
        commands.push(format!("{sudo}apt-get update && {sudo}apt-get install {}", packages.join(" ")));
    }
    commands.extend(missing.iter().filter_map(|need| Some(format!("rustup {}", need.rustup_arguments()?.join(" ")))));
    let on_debian = if packages.is_empty() || has_apt { "" } else { " on Debian and Ubuntu" };
    let _ = write!(text, "\nTo install what is missing{on_debian}, run:\n  {}", commands.join(" && "));
    for (need, variable, what) in
        [(Need::Browser, NO_BROWSER, "the tests of the page"), (Need::Nginx, NO_NGINX, "the test of the reverse proxy")]
    {
        if missing.contains(&need) {
            let _ = write!(text, "\n(Or set {variable}=1 to skip {what}.)");
        }
    }
    text
}

/// The machine that this runs on.
struct ThisMachine;

impl ThisMachine {
    /// Whether a program runs and ends well.
    fn runs_successfully(program: &str, arguments: &[&str]) -> bool {
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    }
}

impl Machine for ThisMachine {
    fn is_need_met(&self, need: Need) -> bool {
        match need {
            Need::Python => has_python_with_venv(),
            Need::Browser => {
                std::env::var_os(NO_BROWSER).is_some()
                    || BROWSERS.iter().any(|name| Self::runs_successfully(name, &["--version"]))
            }
            Need::Nginx => {
                std::env::var_os(NO_NGINX).is_some() || NGINX.iter().any(|name| Self::runs_successfully(name, &["-v"]))
            }
            Need::Openssl => Self::runs_successfully("openssl", &["version"]),
            Need::Cxx => Self::runs_successfully("c++", &["--version"]),
            Need::Systemd => Self::runs_successfully("systemd-analyze", &["--version"]),
            Need::Debootstrap => Self::runs_successfully("debootstrap", &["--version"]),
            Need::Dpkg => {
                Self::runs_successfully("dpkg-deb", &["--version"])
                    && Self::runs_successfully("dpkg-shlibdeps", &["--version"])
            }
            Need::Lints => {
                Self::runs_successfully("cargo", &["fmt", "--version"])
                    && Self::runs_successfully("cargo", &["clippy", "--version"])
            }
            Need::Target => target::is_compile_target_installed_or_buildable(),
        }
    }

    fn has_apt(&self) -> bool {
        Self::runs_successfully("apt-get", &["--version"])
    }

    fn find_install_rights(&self) -> InstallRights {
        let id = Command::new("id").arg("-u").output();
        if id.is_ok_and(|id| id.stdout.trim_ascii() == b"0") {
            InstallRights::Root
        } else if Self::runs_successfully("sudo", &["-n", "true"]) {
            InstallRights::Sudo
        } else {
            InstallRights::None
        }
    }

    fn install_packages(&self, packages: &[&str], rights: InstallRights) -> Result<(), String> {
        let apt = |arguments: &[&str]| {
            let mut command = match rights {
                InstallRights::Root => Command::new("env"),
                InstallRights::Sudo | InstallRights::None => {
                    let mut sudo = Command::new("sudo");
                    sudo.args(["-n", "env"]);
                    sudo
                }
            };
            command.args(["DEBIAN_FRONTEND=noninteractive", "apt-get", "-qq"]).args(arguments).stdin(Stdio::null());
            run_command_silently_returning_cause_line_on_failure(&mut command)
        };
        apt(&["update"])?;
        apt(&[&["install", "--yes", "--no-install-recommends"], packages].concat())
    }

    fn install_need_without_packages(&self, need: Need) -> Result<(), String> {
        match (need, need.rustup_arguments()) {
            (Need::Target, _) => {
                let scratch = repository_root().map_err(|error| error.to_string())?.join("target/rust-src");
                target::ensure_compile_target_available(&scratch, false).map(|_| ()).map_err(|error| error.to_string())
            }
            (_, Some(arguments)) => {
                run_command_silently_returning_cause_line_on_failure(Command::new("rustup").args(arguments))
            }
            (_, None) => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;

    /// Has what it was given or got; notes what is done to it.
    struct Fake {
        has: RefCell<Vec<Need>>,
        rights: InstallRights,
        has_apt: bool,
        /// Whether mirrors and servers answer.
        online: bool,
        done: RefCell<Vec<String>>,
    }

    impl Fake {
        fn new(has: &[Need], rights: InstallRights) -> Self {
            Self { has: RefCell::new(has.to_vec()), rights, has_apt: true, online: true, done: RefCell::default() }
        }

        fn ensure(&self, needs: &[Need]) -> Result<(), String> {
            install_missing_needs_on_machine(self, "cargo xtask test", needs).map_err(|error| error.to_string())
        }
    }

    impl Machine for Fake {
        fn is_need_met(&self, need: Need) -> bool {
            self.has.borrow().contains(&need)
        }
        fn has_apt(&self) -> bool {
            self.has_apt
        }
        fn find_install_rights(&self) -> InstallRights {
            self.rights
        }
        fn install_packages(&self, packages: &[&str], rights: InstallRights) -> Result<(), String> {
            assert_eq!(rights, self.rights);
            self.done.borrow_mut().push(packages.join(" "));
            if !self.online {
                return Err("no mirror".into());
            }
            let all = [Need::Python, Need::Browser, Need::Nginx, Need::Openssl, Need::Cxx, Need::Systemd];
            let got = all.into_iter().filter(|need| need.debian_packages().iter().all(|name| packages.contains(name)));
            self.has.borrow_mut().extend(got);
            Ok(())
        }
        fn install_need_without_packages(&self, need: Need) -> Result<(), String> {
            self.done.borrow_mut().push(format!("{need:?}"));
            if !self.online {
                return Err(format!("no server for {need:?}"));
            }
            self.has.borrow_mut().push(need);
            Ok(())
        }
    }

    #[test]
    fn nothing_is_done_where_all_is_there() {
        let machine = Fake::new(CI, InstallRights::Root);
        machine.ensure(CI).unwrap();
        assert!(machine.done.borrow().is_empty());
    }

    #[test]
    fn what_is_missing_is_installed_by_whoever_may() {
        for rights in [InstallRights::Root, InstallRights::Sudo] {
            let machine = Fake::new(&[Need::Cxx, Need::Lints], rights);
            machine.ensure(CI).unwrap();
            assert_eq!(*machine.done.borrow(), ["python3 python3-venv chromium nginx openssl systemd", "Target"]);
        }
    }

    #[test]
    fn whoever_may_not_is_told_everything_at_once() {
        let machine = Fake { online: false, ..Fake::new(&[], InstallRights::None) };
        let told = machine.ensure(CI).unwrap_err();
        // No package was tried.
        assert_eq!(*machine.done.borrow(), ["Lints", "Target"]);
        for piece in [
            "`cargo xtask test` needs",
            "python3 with",
            "a browser",
            "nginx, for",
            "openssl, for",
            "C++ compiler",
            "systemd-analyze",
            "rustfmt",
            TARGET,
            "the installation failed: no server for Target",
            "sudo apt-get install python3 python3-venv chromium nginx openssl g++ systemd && rustup component add rustfmt clippy && \
             rustup target add thumbv7em-none-eabihf",
        ] {
            assert!(told.contains(piece), "{piece:?} is not in {told}");
        }
        // What could be had is had, and not named.
        let machine = Fake::new(&[Need::Browser, Need::Nginx, Need::Openssl], InstallRights::None);
        let told = machine.ensure(TEST).unwrap_err();
        assert!(machine.is_need_met(Need::Target) && !told.contains(TARGET) && !told.contains("browser"), "{told}");
        assert!(!told.contains("nginx"), "{told}");
    }

    #[test]
    fn an_installation_that_fails_is_reported_with_its_reason() {
        let machine = Fake {
            online: false,
            ..Fake::new(&[Need::Browser, Need::Nginx, Need::Openssl, Need::Target], InstallRights::Root)
        };
        let told = machine.ensure(TEST).unwrap_err();
        assert!(told.contains("the installation failed: no mirror") && !told.contains("sudo"), "{told}");
        let elsewhere = Fake { has_apt: false, ..Fake::new(&[Need::Target], InstallRights::Root) };
        let told = elsewhere.ensure(TEST).unwrap_err();
        assert!(elsewhere.done.borrow().is_empty() && told.contains("on Debian and Ubuntu"), "{told}");
    }

    #[test]
    fn why_a_program_failed_is_kept() {
        // The message begins with the command, so that the texts are put together by the shell.
        let told = run_command_silently_returning_cause_line_on_failure(
            Command::new("sh").args(["-c", "echo fir''st >&2; echo the la''st >&2; exit 3"]),
        )
        .unwrap_err();
        assert!(told.contains("the last") && !told.contains("first") && told.contains('3'), "{told}");
        let told = run_command_silently_returning_cause_line_on_failure(
            Command::new("sh").args(["-c", "echo error: the cau''se >&2; echo a hi''nt >&2; exit 1"]),
        )
        .unwrap_err();
        assert!(told.contains("the cause") && !told.contains("hint"), "{told}");
        assert!(
            run_command_silently_returning_cause_line_on_failure(Command::new("/no/such/program").arg("x"))
                .unwrap_err()
                .contains("/no/such/program x")
        );
    }
}
