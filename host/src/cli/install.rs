//! `era install`: the udev rule and the systemd unit.

use super::args::Serve;
use super::config::{self, ConfigFile};
use super::headings::{ACCESS, FILES, SERVICE};
use super::terminal_messages::tell;
use super::{CommandResult, Failure, print_text_after_queued_log};
use crate::daemon::Recorder;
use crate::install::files::{self, FileChange};
use crate::install::{rule, unit};
use crate::private_file;
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};

/// One of the files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum InstalledPart {
    /// The udev rule, which sets who may drive the board
    Rule,
    /// The systemd unit, which runs the daemon as a service
    Service,
}

#[derive(Clone, Debug, Args)]
pub struct Install {
    /// Install a service of this user instead of a system service. The udev rule is not installed, because its installation needs root
    #[arg(long, help_heading = SERVICE)]
    pub user: bool,
    /// The service's configuration file [default: /etc/era/era.toml; if --user is given: ~/.config/era/era.toml]
    #[arg(long, value_name = "FILE", help_heading = SERVICE)]
    pub config: Option<PathBuf>,
    /// The program that the service runs [default: this program]
    #[arg(long, value_name = "PATH", help_heading = SERVICE)]
    pub program: Option<PathBuf>,
    /// The group of users who may drive the board
    #[arg(long, value_name = "NAME", default_value = rule::GROUP, value_parser = parse_group_name, help_heading = ACCESS)]
    pub group: String,
    /// The group of users who may write firmware to the board [default: none, so only root may do this]
    #[arg(long, value_name = "NAME", value_parser = parse_group_name, help_heading = ACCESS)]
    pub flash_group: Option<String>,
    /// Print the files, and write nothing
    #[arg(long, conflicts_with = "remove", help_heading = FILES)]
    pub print: bool,
    /// Install or remove only one of the two files: the udev rule or the systemd unit
    #[arg(long, value_name = "PART", value_enum, help_heading = FILES)]
    pub only: Option<InstalledPart>,
    /// Remove the installed files
    #[arg(long, help_heading = FILES)]
    pub remove: bool,
    /// Also overwrite or remove files that this command did not write
    #[arg(long, help_heading = FILES)]
    pub force: bool,
    /// Use this folder as the root folder in place of /, to build a package
    #[arg(long, value_name = "DIR", help_heading = FILES)]
    pub root: Option<PathBuf>,
}

/// A name that neither udev nor systemd takes for something else.
fn parse_group_name(text: &str) -> Result<String, String> {
    let is_fit = !text.is_empty()
        && text.len() <= 32
        && !text.starts_with('-')
        && text.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-'));
    if is_fit {
        Ok(text.into())
    } else {
        Err("must be the name of a group: at most 32 letters, digits, '_' and '-', without '-' at the beginning".into())
    }
}

/// A file that is to be.
struct WantedFile {
    part: InstalledPart,
    path: PathBuf,
    text: String,
}

pub fn install_print_or_remove_udev_rule_and_unit(options: &Install) -> CommandResult {
    // Paths of the configuration are absolute, and are cut by this one.
    let root = options.root.as_deref().map(std::path::absolute).transpose().map_err(Failure::runtime_error)?;
    let options = &Install { root, ..options.clone() };
    if !cfg!(target_os = "linux") {
        return Err(Failure::usage_error("udev rules and systemd units exist only on Linux"));
    }
    if options.user && options.only == Some(InstalledPart::Rule) {
        return Err(Failure::usage_error("a udev rule applies to the whole machine: omit --user"));
    }
    let config = find_config_path(options)?;
    let wanted = list_udev_rule_and_unit_files(options, &config)?;
    if options.print {
        let files: Vec<String> =
            wanted.iter().map(|file| format!("# {}\n{}", file.path.display(), file.text)).collect();
        warn_what_keeps_service_from_working(options, &config, &wanted);
        return print_text_after_queued_log(files.join("\n").trim_end());
    }
    // All or nothing, as far as it can be known beforehand.
    for file in &wanted {
        files::check_writable(&file.path, options.force).map_err(Failure::runtime_error)?;
    }
    let mut changed = Vec::new();
    for file in &wanted {
        let done = if options.remove {
            files::remove_marked(&file.path, options.force)
        } else {
            files::write_marked(&file.path, &file.text, options.force)
        };
        let done = done.map_err(Failure::runtime_error)?;
        if options.remove && file.part == InstalledPart::Service {
            remove_dangling_enable_links_of_unit(&file.path);
        }
        print_text_after_queued_log(&format!("{done} {}", file.path.display()))?;
        if !matches!(done, FileChange::Unchanged | FileChange::Absent) {
            changed.push(file.part);
        }
    }
    if !options.remove {
        warn_what_keeps_service_from_working(options, &config, &wanted);
    }
    let steps = list_commands_to_run_next(options, &changed, &config);
    // Whoever makes a package runs nothing now.
    if options.root.is_none() && !steps.is_empty() {
        print_text_after_queued_log(&format!("now run:\n  {}", steps.join("\n  ")))?;
    }
    Ok(())
}

fn list_udev_rule_and_unit_files(options: &Install, config_path: &Path) -> Result<Vec<WantedFile>, Failure> {
    let is_wanted = |part| options.only.is_none_or(|only| only == part);
    let mut wanted = Vec::new();
    if is_wanted(InstalledPart::Rule) && !options.user {
        let path = target_root_folder(options).join(rule::PATH);
        wanted.push(WantedFile {
            part: InstalledPart::Rule,
            path,
            text: rule::format_rule(&options.group, options.flash_group.as_deref()),
        });
    }
    if is_wanted(InstalledPart::Service) {
        let program = find_service_program(options)?;
        let secrets = &list_secret_files_that_systemd_must_pass_to_service(options, config_path);
        let unit = unit::Unit {
            program: &program,
            config: config_path,
            group: &options.group,
            secrets,
            is_user: options.user,
        };
        let text = unit.text().map_err(Failure::usage_error)?;
        wanted.push(WantedFile { part: InstalledPart::Service, path: find_unit_path(options)?, text });
    }
    Ok(wanted)
}

/// What `era serve` would use of the configuration, as far as it can be read; paths as the service sees them.
fn read_serve_options_with_target_root_removed_from_paths(options: &Install, config: &Path) -> Option<Serve> {
    let (root, there) = (target_root_folder(options), path_below_target_root(options, config));
    let mut serve =
        config::fill_in_options_from_config_file_if_named(&Serve { config: Some(there), ..Serve::default() }).ok()?;
    for path in [&mut serve.token_file, &mut serve.tls_cert, &mut serve.tls_key, &mut serve.tls_dir, &mut serve.record]
    {
        if let Some(path) = path.as_mut()
            && let Ok(inner) = path.strip_prefix(root)
        {
            *path = Path::new("/").join(inner);
        }
    }
    Some(serve)
}

/// What of it the service, whose user is its own, can only have from root.
fn list_secret_files_that_systemd_must_pass_to_service(options: &Install, config: &Path) -> unit::Secrets {
    let Some(serve) = read_serve_options_with_target_root_removed_from_paths(options, config).filter(|_| !options.user)
    else {
        return unit::Secrets::default();
    };
    unit::Secrets { tokens: serve.token_file, tls: serve.tls_cert.zip(serve.tls_key) }
}

/// The program that the service runs.
fn find_service_program(options: &Install) -> Result<PathBuf, Failure> {
    match &options.program {
        Some(program) => std::path::absolute(program).map_err(Failure::runtime_error),
        None => std::env::current_exe().map_err(|error| {
            Failure::runtime_error(format!(
                "the path of this program is not known: {error}; name the program with --program"
            ))
        }),
    }
}

/// Takes away the link by which `systemctl enable` starts the unit: once the unit is gone, `disable` does not know it.
fn remove_dangling_enable_links_of_unit(unit: &Path) {
    for target in ["multi-user.target.wants", "default.target.wants"] {
        let link = unit.with_file_name(target).join(unit::NAME);
        if link.is_symlink() && !link.exists() {
            let _ = std::fs::remove_file(link);
        }
    }
}

/// Where a path of the service is now.
fn path_below_target_root(options: &Install, path: &Path) -> PathBuf {
    target_root_folder(options).join(path.strip_prefix("/").unwrap_or(path))
}

fn target_root_folder(options: &Install) -> &Path {
    options.root.as_deref().unwrap_or(Path::new("/"))
}

fn find_unit_path(options: &Install) -> Result<PathBuf, Failure> {
    match (options.user, &options.root) {
        (false, _) => Ok(target_root_folder(options).join(unit::SYSTEM_PATH)),
        (true, Some(root)) => Ok(root.join(unit::USERS_PATH)),
        (true, None) => Ok(find_user_config_folder()?.join("systemd/user").join(unit::NAME)),
    }
}

fn find_config_path(options: &Install) -> Result<PathBuf, Failure> {
    match &options.config {
        Some(path) => std::path::absolute(path).map_err(Failure::runtime_error),
        None if options.user && options.root.is_none() => Ok(find_user_config_folder()?.join("era/era.toml")),
        None => Ok("/etc/era/era.toml".into()),
    }
}

/// Where this user's configuration is.
fn find_user_config_folder() -> Result<PathBuf, Failure> {
    let folder = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    folder("XDG_CONFIG_HOME").or_else(|| folder("HOME").map(|home| home.join(".config"))).ok_or_else(|| {
        Failure::runtime_error(
            "neither of the environment variables XDG_CONFIG_HOME and HOME is an absolute path: set one of these \
             variables, or use --root and --config",
        )
    })
}

/// What will not work as it is.
fn warn_what_keeps_service_from_working(options: &Install, config: &Path, wanted: &[WantedFile]) {
    let Some(service) = wanted.iter().find(|file| file.part == InstalledPart::Service) else { return };
    let there = path_below_target_root(options, config);
    if there.exists() {
        match ConfigFile::read(&there) {
            Err(error) => tell!("the service will not start with this configuration:\n{error}"),
            Ok(file) => {
                if let Some(note) = file.note_if_device_is_simulated() {
                    tell!("with the configuration file \"{}\", the service {note}", there.display());
                }
            }
        }
    } else if options.root.is_none() {
        tell!("{} does not exist yet: the service does not start without this file", config.display());
    }
    if let Some(serve) =
        read_serve_options_with_target_root_removed_from_paths(options, config).filter(|_| !options.user)
    {
        for path in serve.token_file.iter().chain(&serve.tls_key) {
            if let Err(error) = private_file::read(&path_below_target_root(options, path)) {
                tell!("{}: {error}", path.display());
            }
        }
        if let Some(path) = serve.record.as_ref().filter(|path| !Recorder::is_folder_path(path)) {
            tell!(
                "`record` is the file \"{}\", but a recording never replaces a file: the service would not start a \
                 second time. Name a folder (with a slash at its end): each start then makes a new file in this folder",
                path.display()
            );
        }
        for (key, path) in [("tls_dir", serve.tls_dir), ("record", serve.record)] {
            if let Some(path) = path.filter(|path| !path.starts_with(unit::STATE)) {
                tell!(
                    "`{key}` is {}, but the service may write only below {}: name a path there",
                    path.display(),
                    unit::STATE
                );
            }
        }
    }
    if options.root.is_some() {
        // The program is not where it will be.
        return;
    }
    let run = service.text.lines().find_map(|line| line.strip_prefix("ExecStart=")).unwrap_or_default();
    if let Ok(program) = find_service_program(options)
        && is_in_build_folder(&program)
    {
        tell!(
            "{} is in a build folder of cargo: the next build replaces this program, and `cargo clean` removes it. \
             Install a copy instead:\n \
             sudo install -m 755 {} /usr/local/bin/\n  sudo /usr/local/bin/era install",
            program.display(),
            program.display()
        );
    }
    if !options.user && ["/root/", "/home/", "/tmp/"].iter().any(|private| run.contains(private)) {
        tell!(
            "the user of the service may have no right to read the files that `{run}` names: put program and \
             configuration into folders that every user can read (/usr/local/bin, /etc/era), or use --user"
        );
    }
}

/// Whether a program lies where cargo builds.
fn is_in_build_folder(program: &Path) -> bool {
    let folder = |path: Option<&Path>| path.and_then(Path::file_name).and_then(|name| name.to_str()).map(str::to_owned);
    let (own, above) = (program.parent(), program.parent().and_then(Path::parent));
    let is_profile = matches!(folder(own).as_deref(), Some("release" | "debug"));
    is_profile
        && (folder(above).as_deref() == Some("target") || above.is_some_and(|it| it.join("CACHEDIR.TAG").exists()))
}

/// The commands that make the change known.
fn list_commands_to_run_next(options: &Install, changed: &[InstalledPart], config: &Path) -> Vec<String> {
    let mut steps = Vec::new();
    let (manager, sudo) = if options.user { ("systemctl --user", "") } else { ("sudo systemctl", "sudo ") };
    if changed.contains(&InstalledPart::Rule) {
        let groups = std::iter::once(&options.group).chain(&options.flash_group);
        for group in groups.filter(|group| !options.remove && !group_exists_or_groups_unreadable(group)) {
            steps.push(format!("sudo groupadd --system {group}"));
        }
        steps.push("sudo udevadm control --reload".into());
        steps.push("sudo udevadm trigger --subsystem-match=usb --subsystem-match=tty".into());
    }
    if changed.contains(&InstalledPart::Service) {
        if options.remove {
            // Its link is gone already, so that there is nothing to disable.
            steps.push(format!("{manager} stop {}", unit::NAME));
            steps.push(format!("{manager} daemon-reload"));
            return steps;
        }
        if !config.exists() {
            let folder = config.parent().unwrap_or(Path::new("/")).display();
            steps.push(format!("{sudo}mkdir -p {folder}"));
            let writer = if options.user { ">" } else { "| sudo tee" };
            steps.push(format!("era config example {writer} {}", config.display()));
        }
        if ConfigFile::read(config).map_or(true, |file| file.note_if_device_is_simulated().is_some()) {
            let editor = if options.user { "${EDITOR:-vi}" } else { "sudoedit" };
            steps.push(format!(
                "{editor} {}    # set the scene and the device, for example scene = \"panel.toml\", device = \"auto\"",
                config.display()
            ));
        }
        steps.push(format!("era config check {}", config.display()));
        steps.push(format!("{manager} daemon-reload"));
        steps.push(format!("{manager} enable --now {}", unit::NAME));
    }
    steps
}

/// Whether the machine has a group; where that cannot be read, it is taken to have it.
fn group_exists_or_groups_unreadable(name: &str) -> bool {
    std::fs::read_to_string("/etc/group")
        .map_or(true, |groups| groups.lines().any(|line| line.split(':').next() == Some(name)))
}
