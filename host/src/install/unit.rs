//! The systemd unit: how the daemon is started, watched and fenced in.
//!
//! Why a writer beside the unit of Debian's package: there is one unit, and this is it; `cargo xtask dist` packages what it writes. Its lines
//! depend on the machine: the program's path (built here, or packaged), the group (Debian's `plugdev` is not everywhere), the
//! service manager, and the paths of tokens and key, which the configuration names, which root alone may read and which a user without
//! an account gets by `LoadCredential`. Whoever sets `token_file` on a machine with the package runs `era install --only service`. The lines
//! that depend on none of these are four fifths of the text, in plain sight below.

use super::files::MARK;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The unit's name.
pub const NAME: &str = "era.service";
/// Where the machine's own unit goes.
pub const SYSTEM_PATH: &str = "etc/systemd/system/era.service";
/// Where a unit for every user goes.
pub const USERS_PATH: &str = "etc/systemd/user/era.service";
/// Seconds without a sign of life after which the daemon is started anew.
const WATCHDOG_S: u32 = 10;
/// Most memory in MB. A daemon of the example plate has 50 (`cargo xtask soak`); each of the eight pieces of work that may be computed aside (two
/// previews, two effect files, a study or a look at tolerances, two requests for such that are checked, a trade) is reckoned with 100, a model of 6000 unknowns with its factors
/// and modes; 576 connections with a body of 528 KiB each are 310, and 8 a recording whose disk does not answer: 1170. Nearly twice that for larger scenes of one's own.
const MEMORY_MAX_MB: u32 = 2048;
/// Most threads. Those that serve and those that compute are one or two for each processor, half as many for each of the eight pieces of work that may be
/// computed aside, and a dozen are the device's, the recorder's and the runtime's for blocking calls: 100 on a machine with 16 processors.
const TASKS_MAX: u32 = 512;
/// Highest real-time priority that the daemon's threads may have.
const PRIORITY: u32 = 20;

/// Where the machine's service may write, and keeps what it has written: certificates that it makes, recordings.
pub const STATE: &str = "/var/lib/era";

/// What the configuration names that only root may read: the machine's service manager hands it to the service.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Secrets {
    /// The file of tokens.
    pub tokens: Option<PathBuf>,
    /// Certificate, which is no secret, and its key.
    pub tls: Option<(PathBuf, PathBuf)>,
}

/// What the unit runs.
#[derive(Clone, Copy, Debug)]
pub struct Unit<'a> {
    /// The program.
    pub program: &'a Path,
    /// Its configuration file.
    pub config: &'a Path,
    /// The group that may use the board.
    pub group: &'a str,
    /// Handed over by the machine's service manager; a user's service reads its own files.
    pub secrets: &'a Secrets,
    /// Run by a user's own service manager rather than the machine's.
    pub is_user: bool,
}

impl Unit<'_> {
    /// The unit's text.
    ///
    /// # Errors
    /// If a path cannot be written in a unit: it is not UTF-8, or has a control character.
    pub fn text(&self) -> Result<String, String> {
        // Variables are replaced in arguments, but not in the program's path.
        let (program, config) = (quote_word(self.program)?, quote_word(self.config)?.replace('$', "$$"));
        let (own, options) = if self.is_user {
            Default::default()
        } else {
            let (credentials, options) = format_credentials(self.secrets)?;
            (format_system_section(self.group) + &credentials, options)
        };
        let wanted = if self.is_user { "default.target" } else { "multi-user.target" };
        let manager = if self.is_user { "systemctl --user" } else { "systemctl" };
        let after = if self.is_user { "" } else { "After=network.target\n" };
        Ok(format!(
            "{MARK}\n\
             # `{manager} edit {NAME}` writes your changes to another file, which `era install` does not replace.\n\
             [Unit]\n\
             Description=ERA haptics daemon\n\
             {after}# No limit on the number of restarts, so that the daemon runs whenever a board is connected.\n\
             StartLimitIntervalSec=0\n\n\
             [Service]\n\
             Type=notify\n\
             ExecStart={program} serve --config {config}{options}\n\
             # The first start with a scene computes its plan table.\n\
             TimeoutStartSec=300\n\
             TimeoutStopSec=10\n\
             WatchdogSec={WATCHDOG_S}\n\
             Restart=on-failure\n\
             RestartSec=2\n\
             # Exit status 2 is a mistake in the configuration or the scene, which another start does not correct.\n\
             RestartPreventExitStatus=2\n\
             LimitRTPRIO={PRIORITY}\n\
             # Several times the memory that the daemon needs for the largest load that it accepts.\n\
             MemoryMax={MEMORY_MAX_MB}M\n\
             TasksMax={TASKS_MAX}\n\
             Environment=ERA_CACHE_DIR=%C/era\n\
             {own}\
             NoNewPrivileges=yes\n\
             KeyringMode=private\n\
             LockPersonality=yes\n\
             MemoryDenyWriteExecute=yes\n\
             RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6\n\
             RestrictNamespaces=yes\n\
             RestrictSUIDSGID=yes\n\
             SystemCallArchitectures=native\n\
             UMask=0077\n\n\
             [Install]\n\
             WantedBy={wanted}\n"
        ))
    }
}

/// What only the machine's own service manager can do. `RestrictRealtime` is left out on purpose.
fn format_system_section(group: &str) -> String {
    format!(
        "# The daemon may write plan tables in /var/cache/era, certificates and recordings in {STATE}, and its socket in /run/era.\n\
         CacheDirectory=era\n\
         CacheDirectoryMode=0700\n\
         StateDirectory=era\n\
         StateDirectoryMode=0700\n\
         RuntimeDirectory=era\n\
         RuntimeDirectoryMode=0700\n\
         Environment=XDG_RUNTIME_DIR=%t/era\n\
         # A separate user without a home directory, who may use the board and the pseudo-terminal of the simulated device.\n\
         DynamicUser=yes\n\
         SupplementaryGroups={group}\n\
         DevicePolicy=closed\n\
         # USB serial ports (ttyACM, ttyUSB) by major number, because systemd does not know the names of these device \
         classes until a driver is loaded.\n\
         DeviceAllow=char-166 rw\n\
         DeviceAllow=char-188 rw\n\
         DeviceAllow=/dev/ptmx rw\n\
         DeviceAllow=char-pts rw\n\
         CapabilityBoundingSet=\n\
         PrivateTmp=yes\n\
         ProtectClock=yes\n\
         ProtectControlGroups=yes\n\
         ProtectHome=read-only\n\
         ProtectHostname=yes\n\
         ProtectKernelLogs=yes\n\
         ProtectKernelModules=yes\n\
         ProtectKernelTunables=yes\n\
         ProtectProc=invisible\n\
         ProtectSystem=strict\n\
         SystemCallFilter=@system-service\n"
    )
}

/// The lines that hand over what only root may read, and the options by which the program finds it.
fn format_credentials(secrets: &Secrets) -> Result<(String, String), String> {
    let (mut lines, mut options) = (String::new(), String::new());
    let mut load = |id: &str, path: &Path, option: &str| -> Result<(), String> {
        let _ = writeln!(lines, "LoadCredential={id}:{}", escape_specifiers(path)?);
        let _ = write!(options, " {option} ${{CREDENTIALS_DIRECTORY}}/{id}");
        Ok(())
    };
    if let Some(tokens) = &secrets.tokens {
        load("tokens", tokens, "--token-file")?;
    }
    if let Some((certificate, key)) = &secrets.tls {
        load("key", key, "--tls-key")?;
        let _ = write!(options, " --tls-cert {}", quote_word(certificate)?.replace('$', "$$"));
    }
    if !lines.is_empty() {
        lines.insert_str(
            0,
            "# Secret files that the configuration named when `era install` wrote this unit; systemd reads them as root.\n",
        );
    }
    Ok((lines, options))
}

/// A path as the rest of a line.
fn escape_specifiers(path: &Path) -> Result<String, String> {
    Ok(check_path_text(path)?.replace('%', "%%"))
}

/// A path's text.
fn check_path_text(path: &Path) -> Result<&str, String> {
    let text = path
        .to_str()
        .ok_or_else(|| format!("the path {} is not UTF-8 text, so a systemd unit cannot contain it", path.display()))?;
    if text.chars().any(char::is_control) {
        return Err(format!("the path {text:?} has a control character, so a systemd unit cannot contain it"));
    }
    Ok(text)
}

/// A path as one word of `ExecStart` (systemd.service(5), "Command lines"; systemd.unit(5), "Specifiers").
fn quote_word(path: &Path) -> Result<String, String> {
    let escaped = escape_specifiers(path)?;
    if escaped.chars().any(|c| c.is_whitespace() || matches!(c, '"' | '\'' | '\\' | ';')) {
        return Ok(format!("\"{}\"", escaped.replace('\\', "\\\\").replace('"', "\\\"")));
    }
    Ok(escaped)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(is_user: bool) -> String {
        let (program, config) = (Path::new("/usr/bin/era"), Path::new("/etc/era/era.toml"));
        let secrets = &Secrets {
            tokens: Some("/etc/era/tokens".into()),
            tls: Some(("/etc/era/my panel.pem".into(), "/etc/era/100% key.pem".into())),
        };
        Unit { program, config, group: "plugdev", secrets, is_user }.text().unwrap()
    }

    #[test]
    fn the_machines_unit_is_watched_and_fenced_in() {
        let text = text(false);
        for line in [
            "Type=notify",
            "ExecStart=/usr/bin/era serve --config /etc/era/era.toml --token-file ${CREDENTIALS_DIRECTORY}/tokens --tls-key \
             ${CREDENTIALS_DIRECTORY}/key --tls-cert \"/etc/era/my panel.pem\"",
            "LoadCredential=tokens:/etc/era/tokens",
            "LoadCredential=key:/etc/era/100%% key.pem",
            "CacheDirectory=era",
            "StateDirectory=era",
            "RuntimeDirectory=era",
            "Environment=XDG_RUNTIME_DIR=%t/era",
            "WatchdogSec=10",
            "Restart=on-failure",
            "LimitRTPRIO=20",
            "MemoryMax=2048M",
            "TasksMax=512",
            "DynamicUser=yes",
            "SupplementaryGroups=plugdev",
            "ProtectSystem=strict",
            "WantedBy=multi-user.target",
        ] {
            assert!(text.lines().any(|own| own == line), "{line} in {text}");
        }
        assert!(!text.contains("RestrictRealtime"));
    }

    #[test]
    fn nothing_is_handed_over_that_the_configuration_does_not_name() {
        let (program, config, secrets) =
            (Path::new("/usr/bin/era"), Path::new("/etc/era/era.toml"), &Secrets::default());
        let text = Unit { program, config, group: "plugdev", secrets, is_user: false }.text().unwrap();
        assert!(text.contains("serve --config /etc/era/era.toml\n") && !text.contains("LoadCredential"), "{text}");
        let secrets = &Secrets { tokens: Some("/a\nb".into()), tls: None };
        let unit = Unit { program, config, group: "plugdev", secrets, is_user: false };
        assert!(unit.text().unwrap_err().contains("control character"));
    }

    /// A user's service manager may not change users, nor fence devices in.
    #[test]
    fn a_users_unit_asks_for_nothing_that_needs_root() {
        let text = text(true);
        for key in [
            "DynamicUser",
            "SupplementaryGroups",
            "Protect",
            "DevicePolicy",
            "CapabilityBoundingSet",
            "PrivateTmp",
            "LoadCredential",
            "CREDENTIALS_DIRECTORY",
            "Directory=",
            "XDG_RUNTIME_DIR",
        ] {
            assert!(!text.contains(key), "{key} in {text}");
        }
        assert!(text.contains("WantedBy=default.target") && text.contains("Type=notify"));
    }

    #[test]
    fn paths_are_one_word_each() {
        assert_eq!(quote_word(Path::new("/opt/era/bin/era")).unwrap(), "/opt/era/bin/era");
        assert_eq!(quote_word(Path::new("/my panel/100%.toml")).unwrap(), "\"/my panel/100%%.toml\"");
        assert_eq!(quote_word(Path::new("/a\"b\\c$d")).unwrap(), "\"/a\\\"b\\\\c$d\"");
        assert!(quote_word(Path::new("/a\nExecStart=/bin/x")).unwrap_err().contains("control character"));
    }
}
