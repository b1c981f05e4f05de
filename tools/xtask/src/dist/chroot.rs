//! The package in a Debian system that has nothing else: installed, started, and asked for its page.

use crate::error::Error;
use crate::process::{capture_output, format_command, run_command};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Longest time until the daemon serves its page: the first start computes the plan table.
const PATIENCE: Duration = Duration::from_secs(120);
/// What the page has.
const TITLE: &str = "<title>";
/// Files that the package installs besides the program.
const FILES: [&str; 6] = [
    "/usr/lib/systemd/system/era.service",
    "/usr/lib/udev/rules.d/70-era.rules",
    "/usr/share/man/man1/era.1.gz",
    "/usr/share/bash-completion/completions/era",
    "/usr/share/doc/era-haptics/html/index.html",
    "/etc/era/era.toml",
];

/// Makes a bare Debian system of this machine's release, installs `package`, has the daemon serve the example, and removes the package. A system in
/// which something fails is left to be looked at.
///
/// # Errors
/// What could not be run or copied; [`Error::Package`] where a file is missing or left, or the daemon serves no page.
pub fn try_package_in_chroot(root: &Path, package: &Path) -> Result<(), Error> {
    let system = root.join("target/dist-chroot");
    // Of a run that was cut short: nothing is mounted in it outside the process that does.
    if system.exists() {
        run_command(Command::new("rm").args(["--recursive", "--force", "--one-file-system"]).arg(&system))?;
    }
    let (mirror, release) = find_mirror_and_release()?;
    println!("making a Debian system ({release}) in {}", system.display());
    let mut debootstrap = Command::new("debootstrap");
    debootstrap.args(["--variant=minbase", &release]).arg(&system).arg(mirror).stdout(Stdio::null());
    run_command(&mut debootstrap)?;
    super::copy_file(package, &system.join("tmp/era.deb"))?;
    run_command(
        chroot_command_with_dev_and_proc_mounted(&system, "dpkg --install /tmp/era.deb").stdout(Stdio::null()),
    )?;
    for file in FILES {
        if !system.join(file.trim_start_matches('/')).is_file() {
            return Err(Error::Package(format!("{file} is not installed")));
        }
    }
    println!("installed: {}", capture_output(&mut chroot_command_with_dev_and_proc_mounted(&system, "era --version"))?);
    start_daemon_in_chroot_and_check_it_serves_page(&system)?;
    run_command(chroot_command_with_dev_and_proc_mounted(&system, "dpkg --purge era-haptics").stdout(Stdio::null()))?;
    match FILES.iter().find(|file| system.join(file.trim_start_matches('/')).exists()) {
        Some(file) => Err(Error::Package(format!("{file} is left after the package was removed"))),
        None => run_command(Command::new("rm").args(["--recursive", "--force", "--one-file-system"]).arg(&system)),
    }
}

/// The first mirror of this machine's own release, as apt knows it, and the release's name.
fn find_mirror_and_release() -> Result<(String, String), Error> {
    let format = "$(REPO_URI) $(CODENAME) $(CREATED_BY)";
    let known = capture_output(Command::new("apt-get").args(["indextargets", "--format", format]))?;
    let release = capture_output(Command::new("sh").args(["-c", ". /etc/os-release && echo \"$VERSION_CODENAME\""]))?;
    let of_release = known.lines().find_map(|line| {
        let mut words = line.split(' ');
        let (mirror, codename) = (words.next()?, words.next()?);
        (codename == release && words.next() == Some("Packages")).then(|| mirror.to_owned())
    });
    let mirror = of_release.ok_or_else(|| Error::Package(format!("apt knows no mirror of {release}")))?;
    Ok((mirror, release))
}

/// A command line in the system, with devices and processes, which are mounted for it alone.
fn chroot_command_with_dev_and_proc_mounted(system: &Path, command_line: &str) -> Command {
    let script =
        format!("mount --rbind /dev \"$0/dev\" && mount -t proc proc \"$0/proc\" && exec chroot \"$0\" {command_line}");
    let mut command = Command::new("unshare");
    command.args(["--mount", "--propagation", "private", "sh", "-c", &script]).arg(system);
    command.env("HOME", "/root").env("PATH", "/usr/sbin:/usr/bin:/sbin:/bin").env("DEBIAN_FRONTEND", "noninteractive");
    command
}

/// Starts the daemon with the simulated device, and gets its page.
fn start_daemon_in_chroot_and_check_it_serves_page(system: &Path) -> Result<(), Error> {
    let free = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
    let address = free.map_err(|error| Error::Package(format!("no free port: {error}")))?;
    let mut serve = chroot_command_with_dev_and_proc_mounted(
        system,
        &format!("era serve --listen {address} --socket none --device sim"),
    );
    let started = serve.stdout(Stdio::null()).spawn();
    let mut daemon = Daemon(started.map_err(|source| Error::Start { command: format_command(&serve), source })?);
    let until = Instant::now() + PATIENCE;
    loop {
        match fetch_root_page_with_http_headers(address) {
            Ok(page) if page.starts_with("HTTP/1.1 200") && page.contains(TITLE) => break,
            Ok(page) => {
                return Err(Error::Package(format!(
                    "the daemon's answer is not its page: {}",
                    page.lines().next().unwrap_or_default()
                )));
            }
            Err(error) if Instant::now() > until => {
                return Err(Error::Package(format!("the daemon serves no page: {error}")));
            }
            Err(_) => std::thread::sleep(Duration::from_millis(100)),
        }
        if let Ok(Some(status)) = daemon.0.try_wait() {
            return Err(Error::Package(format!("the daemon has ended: {status}")));
        }
    }
    println!("the installed program serves its page");
    Ok(())
}

fn fetch_root_page_with_http_headers(address: SocketAddr) -> std::io::Result<String> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(Duration::from_secs(5)))?;
    stream.write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")?;
    let mut page = String::new();
    stream.read_to_string(&mut page)?;
    Ok(page)
}

/// Ends with the check, whatever its result.
struct Daemon(Child);

impl Drop for Daemon {
    fn drop(&mut self) {
        // It is the process that `unshare` became. If it has ended already there is nothing to kill.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
