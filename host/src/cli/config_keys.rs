//! The keys of the daemon's configuration file: those of `era serve`'s options, one row each.
//!
//! An option that is added to `serve` gets a row here: how it is named, what it may be, and where its value goes.

use super::args::{AfterOutage, Serve, parse_idle_s, parse_recording_size_mb};
use crate::daemon::{Access, DEFAULT_LISTEN};
use crate::device::Target;
use crate::model::Accuracy;
use clap::ValueEnum;
use std::path::{Path, PathBuf};

/// A value as the file has it.
#[derive(Clone, Debug, PartialEq)]
pub enum GivenValue {
    /// A string.
    Text(String),
    /// An integer or a float.
    Number(f64),
    /// `true` or `false`.
    Flag(bool),
    /// A list of strings.
    Texts(Vec<String>),
    /// A date, a table or another list; no key takes a value of this kind.
    Other,
}

impl GivenValue {
    /// A text that is not empty.
    pub fn as_nonempty_text(&self) -> Option<&str> {
        match self {
            GivenValue::Text(text) if !text.is_empty() => Some(text),
            _ => None,
        }
    }

    fn as_number(&self) -> Option<f64> {
        match self {
            GivenValue::Number(number) => Some(*number),
            _ => None,
        }
    }

    fn as_flag(&self) -> Option<bool> {
        match self {
            GivenValue::Flag(flag) => Some(*flag),
            _ => None,
        }
    }

    fn as_texts(&self) -> Option<&[String]> {
        match self {
            GivenValue::Texts(texts) => Some(texts),
            _ => None,
        }
    }

    /// A path; a relative one counts from `base`.
    fn as_path_from(&self, base: &Path) -> Option<PathBuf> {
        self.as_nonempty_text().map(|text| base.join(text))
    }
}

/// One key.
#[derive(Debug)]
pub struct Key {
    /// The key's name in the file: the option's name, with underscores.
    pub name: &'static str,
    /// What the key sets, for `era config example`.
    pub help: &'static str,
    /// The allowed values, as text that follows "must be".
    pub allowed: &'static str,
    /// The value if neither the file nor the command line sets the key.
    pub default: &'static str,
    /// A value as TOML.
    pub example: &'static str,
    /// Another key that sets the same property: at most one of the two keys may be given.
    pub rival: Option<&'static str>,
    /// Whether an option on the command line sets the key.
    pub is_given: fn(&Serve) -> bool,
    /// Stores the value in the options; relative paths are relative to the given folder. `None` if the
    /// value is not allowed.
    pub take: fn(&mut Serve, &GivenValue, &Path) -> Option<()>,
}

/// All keys, in the order in which they are listed.
pub const KEYS: &[Key] = &[
    Key {
        name: "scene",
        help: "Scene file: the panel with its actuators",
        allowed: "the path of a scene file",
        default: "the example plate",
        example: "\"panel.toml\"",
        rival: None,
        is_given: |serve| serve.panel.scene.is_some(),
        take: |serve, given, base| {
            serve.panel.scene = Some(given.as_path_from(base)?);
            Some(())
        },
    },
    Key {
        name: "accuracy",
        help: "Accuracy of the model: fast, balanced or reference",
        allowed: "\"fast\", \"balanced\" or \"reference\"",
        default: "balanced",
        example: "\"balanced\"",
        rival: Some("tolerance"),
        is_given: |serve| serve.panel.accuracy.is_some(),
        take: |serve, given, _| {
            serve.panel.accuracy = Some(given.as_nonempty_text()?.parse().ok()?);
            Some(())
        },
    },
    Key {
        name: "tolerance",
        help: "Relative tolerance of the model, in place of the key accuracy",
        allowed: "a number from 1e-8 to 0.1",
        default: "the tolerance that the key accuracy names",
        example: "1e-3",
        rival: Some("accuracy"),
        is_given: |serve| serve.panel.tolerance.is_some(),
        take: |serve, given, _| {
            let tolerance = given.as_number()?;
            Accuracy::from_tolerance(tolerance).ok()?;
            serve.panel.tolerance = Some(tolerance);
            Some(())
        },
    },
    Key {
        name: "explain",
        help: "Log what the model contains, what it omits, and the time and the error bound of each mesh",
        allowed: "true or false",
        default: "false",
        example: "false",
        rival: None,
        is_given: |serve| serve.panel.explain,
        take: |serve, given, _| {
            serve.panel.explain = given.as_flag()?;
            Some(())
        },
    },
    Key {
        name: "no_cache",
        help: "Compute the plan table instead of reading it from disk, and do not write it to disk",
        allowed: "true or false",
        default: "false",
        example: "false",
        rival: None,
        is_given: |serve| serve.keep.no_cache,
        take: |serve, given, _| {
            serve.keep.no_cache = given.as_flag()?;
            Some(())
        },
    },
    Key {
        name: "device",
        help: "Device: sim (simulated), emulated, auto (the connected board), or the path of a serial port",
        allowed: "\"sim\", \"emulated\", \"auto\" or the path of a serial port, such as \"/dev/ttyACM0\"",
        default: "sim",
        example: "\"auto\"",
        rival: None,
        is_given: |serve| serve.device.is_some(),
        take: |serve, given, _| {
            serve.device = Some(given.as_nonempty_text()?.parse::<Target>().ok()?);
            Some(())
        },
    },
    Key {
        name: "listen",
        help: "Address or host name to listen on, with a port",
        allowed: "a text with a host (IP address or name) and a port, such as \"127.0.0.1:7878\", \"localhost:7878\" or \"[::1]:7878\"",
        default: DEFAULT_LISTEN,
        example: "\"127.0.0.1:7878\"",
        rival: None,
        is_given: |serve| serve.listen.is_some(),
        take: |serve, given, _| {
            serve.listen = Some(given.as_nonempty_text()?.parse().ok()?);
            Some(())
        },
    },
    Key {
        name: "socket",
        help: "Path of an additional Unix socket, which only this user can open; \"none\" for no socket",
        allowed: "a path, or \"none\"",
        default: "era.sock in $XDG_RUNTIME_DIR, if this variable is set",
        example: "\"none\"",
        rival: None,
        is_given: |serve| serve.socket.is_some(),
        take: |serve, given, base| {
            let text = given.as_nonempty_text()?;
            serve.socket = Some(if text == "none" { text.into() } else { base.join(text) });
            Some(())
        },
    },
    Key {
        name: "token_file",
        help: "File of tokens; each line has a role (view, touch or arm) and a secret",
        allowed: "the path of a file",
        default: "none",
        example: "\"tokens\"",
        rival: None,
        is_given: |serve| serve.token_file.is_some(),
        take: |serve, given, base| {
            serve.token_file = Some(given.as_path_from(base)?);
            Some(())
        },
    },
    Key {
        name: "tls_cert",
        help: "Serve over TLS with the certificate in this file, in PEM; requires tls_key",
        allowed: "the path of a file",
        default: "none",
        example: "\"tls_cert.pem\"",
        rival: Some("tls_dir"),
        is_given: |serve| serve.tls_cert.is_some(),
        take: |serve, given, base| {
            serve.tls_cert = Some(given.as_path_from(base)?);
            Some(())
        },
    },
    Key {
        name: "tls_key",
        help: "File with the private key of tls_cert, in PEM",
        allowed: "the path of a file",
        default: "none",
        example: "\"tls_key.pem\"",
        rival: None,
        is_given: |serve| serve.tls_key.is_some(),
        take: |serve, given, base| {
            serve.tls_key = Some(given.as_path_from(base)?);
            Some(())
        },
    },
    Key {
        name: "tls_dir",
        help: "Serve over TLS with the certificate and key in this folder; if both are missing, the daemon makes both",
        allowed: "the path of a folder",
        default: "none",
        example: "\"tls\"",
        rival: Some("tls_cert"),
        is_given: |serve| serve.tls_dir.is_some(),
        take: |serve, given, base| {
            serve.tls_dir = Some(given.as_path_from(base)?);
            Some(())
        },
    },
    Key {
        name: "allow_origin",
        help: "Origins of web pages, other than the daemon's own page, that may use the daemon",
        allowed: "a list of origins, such as [\"http://kiosk.example:8080\"]",
        default: "none",
        example: "[\"http://kiosk.example:8080\"]",
        rival: None,
        is_given: |serve| !serve.allow_origin.is_empty(),
        take: |serve, given, _| {
            serve.allow_origin =
                given.as_texts()?.iter().map(|text| Access::parse_origin(text).ok()).collect::<Option<_>>()?;
            Some(())
        },
    },
    Key {
        name: "allow_host",
        help: "Other host names that clients may use for the daemon",
        allowed: "a list of host names, such as [\"panel.local\"]",
        default: "none",
        example: "[\"panel.local\"]",
        rival: None,
        is_given: |serve| !serve.allow_host.is_empty(),
        take: |serve, given, _| {
            serve.allow_host =
                given.as_texts()?.iter().map(|text| Access::parse_host(text).ok()).collect::<Option<_>>()?;
            Some(())
        },
    },
    Key {
        name: "idle_s",
        help: "Disarm the board after this time without a touch, in s",
        allowed: "a number from 0.1 to 3600, in s",
        default: "5",
        example: "5",
        rival: None,
        is_given: |serve| serve.idle_s.is_some(),
        take: |serve, given, _| {
            let seconds = given.as_number()?;
            serve.idle_s = Some(parse_idle_s(&seconds.to_string()).ok()?);
            Some(())
        },
    },
    Key {
        name: "clear_silence",
        help: "Clear the fault host-silent (the board received nothing from this daemon for 250 ms) at the next touch or POST /v1/arm",
        allowed: "true or false",
        default: "false",
        example: "false",
        rival: None,
        is_given: |serve| serve.clear_silence,
        take: |serve, given, _| {
            serve.clear_silence = given.as_flag()?;
            Some(())
        },
    },
    Key {
        name: "after_outage",
        help: "Who arms the board after an outage: a person with `era arm`, or the next touch",
        allowed: "\"person\" or \"touch\"",
        default: "person",
        example: "\"person\"",
        rival: None,
        is_given: |serve| serve.after_outage.is_some(),
        take: |serve, given, _| {
            serve.after_outage = Some(AfterOutage::from_str(given.as_nonempty_text()?, false).ok()?);
            Some(())
        },
    },
    Key {
        name: "record",
        help: "Record requests and their results to a new file, or to a folder, in which each start makes a new file",
        allowed: "the path of an existing folder, of a new folder (with a slash at the end), or of a new file",
        default: "none",
        example: "\"records/\"",
        rival: None,
        is_given: |serve| serve.record.is_some(),
        take: |serve, given, base| {
            serve.record = Some(given.as_path_from(base)?);
            Some(())
        },
    },
    Key {
        name: "record_file_mb",
        help: "Largest size in MB of one file of a recording; above this size, the recording continues in a new file",
        allowed: "a number from 1 to 1000000, in MB",
        default: "256",
        example: "256",
        rival: None,
        is_given: |serve| serve.record_file_mb.is_some(),
        take: |serve, given, _| {
            serve.record_file_mb = Some(parse_recording_size_mb(&given.as_number()?.to_string()).ok()?);
            Some(())
        },
    },
    Key {
        name: "record_total_mb",
        help: "Largest total size in MB of a recording's files; above this size, the daemon removes the oldest file",
        allowed: "a number from 1 to 1000000, in MB",
        default: "2000",
        example: "2000",
        rival: None,
        is_given: |serve| serve.record_total_mb.is_some(),
        take: |serve, given, _| {
            serve.record_total_mb = Some(parse_recording_size_mb(&given.as_number()?.to_string()).ok()?);
            Some(())
        },
    },
];

#[cfg(test)]
mod tests {
    use super::super::command::Arguments;
    use super::*;
    use clap::CommandFactory;

    /// Options of `serve` that are no keys: the file itself, and those of every command.
    const NO_KEYS: [&str; 5] = ["config", "verbose", "log_format", "help", "version"];

    #[test]
    fn every_option_of_serve_is_a_key() {
        let mut command = Arguments::command();
        command.build();
        let serve = command.find_subcommand("serve").unwrap();
        let options: Vec<&str> =
            serve.get_arguments().map(|option| option.get_id().as_str()).filter(|id| !NO_KEYS.contains(id)).collect();
        for option in &options {
            assert!(KEYS.iter().any(|key| key.name == *option), "add a row to KEYS for --{option}");
        }
        for key in KEYS {
            assert!(options.contains(&key.name), "{} is no option of serve", key.name);
        }
    }

    #[test]
    fn rivals_know_each_other_and_values_land_where_the_command_line_looks() {
        for key in KEYS {
            if let Some(rival) = key.rival {
                let other = KEYS.iter().find(|other| other.name == rival).unwrap();
                assert_eq!(other.rival, Some(key.name));
            }
            let given = match key.example.parse::<f64>() {
                Ok(number) => GivenValue::Number(number),
                Err(_) if key.example == "false" => GivenValue::Flag(true),
                Err(_) if key.example.starts_with('[') => {
                    GivenValue::Texts(vec![key.example.trim_matches(['[', ']', '"']).into()])
                }
                Err(_) => GivenValue::Text(key.example.trim_matches('"').into()),
            };
            let mut serve = Serve::default();
            assert!(!(key.is_given)(&serve), "{}", key.name);
            assert!((key.take)(&mut serve, &given, Path::new("/base")).is_some(), "{}: {given:?}", key.name);
            assert!((key.is_given)(&serve), "{}", key.name);
            assert!((key.take)(&mut serve, &GivenValue::Other, Path::new("/base")).is_none(), "{}", key.name);
        }
    }
}
