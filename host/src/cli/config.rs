//! The daemon's configuration file: how it is read and joined with the command line, and `era config`.
//!
//! `toml` parses; the keys are taken one by one rather than by serde. A derived `Deserialize` stops at the first mistake, and `era config
//! check` lists all of them, each with its line, key, value and what is allowed. What serde would replace is 86 of these lines
//! (`parse_text_and_collect_mistakes`, `read_key_value_and_message_text_unless_version`, `convert_toml_value_and_format_for_messages`), and in their place would come a structure of 20 optional spanned fields with a deserializer for
//! each kind of bounded value. The table of keys is needed in either case: for defaults, examples and the command line's precedence.

use super::args::Serve;
use super::config_keys::{GivenValue, KEYS, Key};
use super::serve;
use super::values::parse_listen_address;
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::device::Target;
use crate::scene::{describe_toml_syntax_mistake, find_nearest_name};
use crate::text_file::read_text_file;
use clap::{Args, Subcommand};
use serde_json::json;
use std::fmt::{self, Write};
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// The version of configuration files that is read.
const VERSION: f64 = 1.0;

/// `era config`.
#[derive(Clone, Debug, Args)]
pub struct Config {
    #[command(subcommand)]
    pub command: ConfigCommand,
}

#[derive(Clone, Debug, Subcommand)]
pub enum ConfigCommand {
    /// List the values that `era serve` uses with a configuration file, or the mistakes in the file
    #[command(after_help = "Example:\n  era config check /etc/era/era.toml")]
    Check(ConfigCheck),
    /// Print an example of a configuration file, with every key and its default commented out
    #[command(after_help = "Example:\n  era config example > era.toml")]
    Example,
}

#[derive(Clone, Debug, Args)]
pub struct ConfigCheck {
    /// The configuration file
    pub file: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// A mistake in a configuration file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mistake {
    /// Line of the mistake, counted from 1; 0 if the mistake belongs to no line.
    pub line: usize,
    /// What is wrong: key, value and what is allowed.
    pub text: String,
}

/// A configuration file that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigError {
    /// The file as it was named.
    pub source: String,
    /// Every mistake found, by line.
    pub mistakes: Vec<Mistake>,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, Mistake { line, text }) in self.mistakes.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            match line {
                0 => write!(f, "{}: {text}", self.source)?,
                line => write!(f, "{}:{line}: {text}", self.source)?,
            }
        }
        Ok(())
    }
}

impl std::error::Error for ConfigError {}

/// A key that the file has.
#[derive(Clone, Debug)]
struct Setting {
    key: &'static Key,
    line: usize,
    given: GivenValue,
    /// The value, formatted for messages.
    text: String,
}

/// A configuration file that can be used.
#[derive(Clone, Debug)]
pub struct ConfigFile {
    source: String,
    /// Folder to which relative paths are relative.
    base: PathBuf,
    settings: Vec<Setting>,
}

/// What could be read of a file, and what could not.
struct ExaminedConfig {
    file: ConfigFile,
    mistakes: Vec<Mistake>,
}

impl ExaminedConfig {
    /// The file, if there is no mistake in it.
    fn into_file_if_sound(mut self) -> Result<ConfigFile, ConfigError> {
        if self.mistakes.is_empty() {
            return Ok(self.file);
        }
        self.mistakes.sort_by_key(|mistake| mistake.line);
        Err(ConfigError { source: self.file.source, mistakes: self.mistakes })
    }
}

impl ConfigFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`ConfigError`] with every mistake in it.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        Self::read_file_and_collect_mistakes(path)?.into_file_if_sound()
    }

    /// Reads what can be read of a file.
    ///
    /// # Errors
    /// [`ConfigError`] where the file cannot be read at all, or is no TOML.
    fn read_file_and_collect_mistakes(path: &Path) -> Result<ExaminedConfig, ConfigError> {
        let source = path.display().to_string();
        let failed = |text: String| ConfigError { source: source.clone(), mistakes: vec![Mistake { line: 0, text }] };
        let text =
            read_text_file(path).map_err(|error| failed(format!("cannot read the configuration file: {error}")))?;
        let whole = std::path::absolute(path).map_err(|error| failed(error.to_string()))?;
        let base = whole.parent().map(Path::to_path_buf).unwrap_or_default();
        Self::parse_text_and_collect_mistakes(&source, &text, &base)
    }

    /// Reads what can be read of a file's text; `source` is its name in messages, relative paths count from `base`.
    ///
    /// # Errors
    /// [`ConfigError`] where it is no TOML.
    fn parse_text_and_collect_mistakes(source: &str, text: &str, base: &Path) -> Result<ExaminedConfig, ConfigError> {
        let line_at = |offset: usize| text.bytes().take(offset).filter(|byte| *byte == b'\n').count() + 1;
        let error = |mistakes| ConfigError { source: source.into(), mistakes };
        let document = DeTable::parse(text).map_err(|wrong| {
            let line = wrong.span().map_or(0, |span| line_at(span.start));
            error(vec![Mistake { line, text: describe_toml_syntax_mistake(text, line, wrong.message()) }])
        })?;
        let (mut settings, mut mistakes) = (Vec::new(), Vec::new());
        let mut has_version = false;
        for (name, value) in document.get_ref() {
            let line = line_at(name.span().start);
            match read_key_value_and_message_text_unless_version(name.get_ref(), value, base) {
                Ok(Some((key, given, text))) => settings.push(Setting { key, line, given, text }),
                Ok(None) => has_version = true,
                Err(text) => {
                    has_version |= name.get_ref() == "version";
                    mistakes.push(Mistake { line, text });
                }
            }
        }
        if !has_version {
            mistakes.push(Mistake { line: 0, text: format!("version is missing: add the line `version = {VERSION}`") });
        }
        settings.sort_by_key(|setting| setting.line);
        for (i, setting) in settings.iter().enumerate() {
            let rival = settings[..i].iter().find(|other| setting.key.rival == Some(other.key.name));
            if let Some(rival) = rival {
                let text = format!(
                    "{} and {} are given, but at most one of them is allowed",
                    rival.key.name, setting.key.name
                );
                mistakes.push(Mistake { line: setting.line, text });
            }
        }
        Ok(ExaminedConfig { file: Self { source: source.into(), base: base.to_path_buf(), settings }, mistakes })
    }

    /// What `era serve` is to do: the command line's options before the file's.
    #[must_use]
    pub fn fill_in_missing_options(&self, options: &Serve) -> Serve {
        let mut joined = options.clone();
        for setting in &self.settings {
            if !is_key_decided_on_command_line(setting.key, options) {
                // The value has been tried when the file was read.
                let _ = (setting.key.take)(&mut joined, &setting.given, &self.base);
            }
        }
        joined
    }

    /// What keeps the daemon from starting with this file alone, or clients from talking to it, with the lines that it is about.
    #[must_use]
    pub fn find_mistakes_that_prevent_start_or_hinder_clients(&self) -> Vec<Mistake> {
        let of = |(key, text): (&str, String)| {
            let line = self.settings.iter().find(|setting| setting.key.name == key).map_or(0, |setting| setting.line);
            Mistake { line, text }
        };
        let options = self.fill_in_missing_options(&Serve::default());
        // What the start only warns of is a mistake of the file all the same.
        serve::list_mistakes_that_prevent_daemon_start_by_config_key(&options)
            .into_iter()
            .chain(serve::list_certificate_date_warnings_by_config_key(&options))
            .map(of)
            .collect()
    }

    /// That the file leads to the simulated device, if it does.
    #[must_use]
    pub fn note_if_device_is_simulated(&self) -> Option<&'static str> {
        matches!(self.fill_in_missing_options(&Serve::default()).device, None | Some(Target::Sim))
            .then_some(serve::SIMULATED)
    }

    /// Every key with its value and where that comes from, for `options` on the command line.
    fn list_all_keys_with_origin(&self, options: &Serve) -> Vec<KeyWithOrigin> {
        let used = |key: &'static Key| {
            let setting = self.settings.iter().find(|setting| setting.key.name == key.name);
            match setting {
                _ if is_key_decided_on_command_line(key, options) => KeyWithOrigin { key, value: None, line: None },
                Some(setting) => KeyWithOrigin { key, value: Some(setting.text.clone()), line: Some(setting.line) },
                None => KeyWithOrigin { key, value: Some(key.default.into()), line: None },
            }
        };
        KEYS.iter().map(used).collect()
    }
}

/// Whether the command line has decided what a key decides.
fn is_key_decided_on_command_line(key: &Key, options: &Serve) -> bool {
    (key.is_given)(options) || KEYS.iter().any(|other| key.rival == Some(other.name) && (other.is_given)(options))
}

/// What holds for a key.
struct KeyWithOrigin {
    key: &'static Key,
    /// The value; `None` if an option on the command line overrides the key.
    value: Option<String>,
    /// Line of the key in the file, if the file has the key.
    line: Option<usize>,
}

/// A key with its value and the value as people read it; nothing for the version; or what is wrong.
fn read_key_value_and_message_text_unless_version(
    name: &str,
    value: &Spanned<DeValue<'_>>,
    base: &Path,
) -> Result<Option<(&'static Key, GivenValue, String)>, String> {
    let (given, told) = convert_toml_value_and_format_for_messages(value.get_ref());
    if name == "version" {
        let is_known = matches!(given, GivenValue::Number(number) if number.total_cmp(&VERSION).is_eq());
        return if is_known { Ok(None) } else { Err(format!("version is {told}, but must be {VERSION}")) };
    }
    let Some(key) = KEYS.iter().find(|key| key.name == name) else {
        let known: Vec<&str> = KEYS.iter().map(|key| key.name).collect();
        let hint = match find_nearest_name(name, known.iter().copied()) {
            Some(meant) => format!("did you mean {meant}?"),
            None => format!("known keys: version, {}", known.join(", ")),
        };
        return Err(format!("unknown key `{name}`; {hint}"));
    };
    match (key.take)(&mut Serve::default(), &given, base) {
        Some(()) => Ok(Some((key, given, told))),
        None => {
            // Of a place to listen there is more to say.
            let place = given.as_nonempty_text().filter(|_| key.name == "listen").map(parse_listen_address);
            let reason = place.and_then(Result::err).map(|reason| format!("; {reason}")).unwrap_or_default();
            Err(format!("{name} is {told}, but must be {}{reason}", key.allowed))
        }
    }
}

/// A value, and how messages write it.
fn convert_toml_value_and_format_for_messages(value: &DeValue<'_>) -> (GivenValue, String) {
    match value {
        DeValue::String(text) => (GivenValue::Text(text.to_string()), format!("{text:?}")),
        DeValue::Boolean(flag) => (GivenValue::Flag(*flag), flag.to_string()),
        DeValue::Integer(number) if number.radix() == 10 => {
            (parse_number_value_or_other(number.as_str()), number.as_str().into())
        }
        DeValue::Integer(number) => (GivenValue::Other, number.as_str().into()),
        DeValue::Float(number) => (parse_number_value_or_other(number.as_str()), number.as_str().into()),
        DeValue::Datetime(time) => (GivenValue::Other, time.to_string()),
        DeValue::Array(list) => {
            let texts = |entry: &toml::Spanned<DeValue<'_>>| match entry.get_ref() {
                DeValue::String(text) => Some(text.to_string()),
                _ => None,
            };
            match list.iter().map(texts).collect::<Option<Vec<String>>>() {
                Some(texts) => {
                    let told = format!("{texts:?}");
                    (GivenValue::Texts(texts), told)
                }
                None => (GivenValue::Other, "a list with values that are not strings".into()),
            }
        }
        DeValue::Table(_) => (GivenValue::Other, "a table".into()),
    }
}

fn parse_number_value_or_other(text: &str) -> GivenValue {
    text.parse().map_or(GivenValue::Other, GivenValue::Number)
}

/// The options of `era serve`, with those of its configuration file if it names one.
pub fn fill_in_options_from_config_file_if_named(options: &Serve) -> Result<Serve, Failure> {
    let Some(path) = &options.config else { return Ok(options.clone()) };
    let file = ConfigFile::read(path).map_err(Failure::usage_error)?;
    for KeyWithOrigin { key, value, line } in file.list_all_keys_with_origin(options) {
        let place = line.map_or_else(|| "default".into(), |line| format!("{}:{line}", file.source));
        match value {
            Some(value) => tracing::debug!("{} = {value} ({place})", key.name),
            None => tracing::debug!("{}: an option on the command line overrides this key", key.name),
        }
    }
    Ok(file.fill_in_missing_options(options))
}

/// `era config`.
pub fn run_config(options: &Config) -> CommandResult {
    match &options.command {
        ConfigCommand::Check(options) => check_config_file_and_print_values_in_use(options),
        ConfigCommand::Example => print_text_after_queued_log(&format_example_config()),
    }
}

fn check_config_file_and_print_values_in_use(options: &ConfigCheck) -> CommandResult {
    let found = ConfigFile::read_file_and_collect_mistakes(&options.file).and_then(|mut found| {
        // The scene is tried as well; what is wrong in it has its own lines.
        let file = &found.file;
        if let Err(Failure::Usage(text) | Failure::Failed(text)) =
            file.fill_in_missing_options(&Serve::default()).panel.load_scene()
        {
            let line =
                file.settings.iter().find(|setting| setting.key.name == "scene").map_or(0, |setting| setting.line);
            found.mistakes.push(Mistake { line, text });
        }
        found.mistakes.extend(found.file.find_mistakes_that_prevent_start_or_hinder_clients());
        found.into_file_if_sound()
    });
    let file = match found {
        Ok(file) => file,
        Err(error) => {
            if options.json {
                let mistakes: Vec<_> =
                    error.mistakes.iter().map(|it| json!({"line": it.line, "text": it.text})).collect();
                print_json(&json!({"file": error.source, "mistakes": mistakes, "settings": []}))?;
            }
            return Err(Failure::usage_error(error));
        }
    };
    let used = file.list_all_keys_with_origin(&Serve::default());
    let simulated = file.note_if_device_is_simulated();
    if options.json {
        let settings: Vec<_> =
            used.iter().map(|used| json!({"key": used.key.name, "value": used.value, "line": used.line})).collect();
        return print_json(&json!({
            "file": file.source, "mistakes": [], "settings": settings, "drives_simulation": simulated.is_some(),
        }));
    }
    let width =
        |text: fn(&KeyWithOrigin) -> &str| used.iter().map(|used| text(used).chars().count()).max().unwrap_or(0);
    let (keys, values) = (width(|used| used.key.name), width(|used| used.value.as_deref().unwrap_or_default()));
    let mut text = format!("{} can be used", file.source);
    for KeyWithOrigin { key, value, line } in &used {
        let place = line.map_or_else(|| "default".into(), |line| format!("line {line}"));
        let _ = write!(text, "\n{:keys$}  {:values$}  {place}", key.name, value.as_deref().unwrap_or_default());
    }
    if let Some(note) = simulated {
        let _ = write!(text, "\nthe daemon {note}");
    }
    print_text_after_queued_log(&text)
}

/// A file with every key.
fn format_example_config() -> String {
    let mut text = format!(
        "# Configuration of `era serve`: era serve --config FILE. Options on the command line override this file.\n\
         # Relative paths are relative to the folder of this file. To drive your panel, set the key `scene`, and set the\n\
         # key `device` to \"auto\". If `device` is not set, the daemon drives the simulated device. `era config check FILE`\n\
         # shows the values that are used.\n\nversion = {VERSION}"
    );
    for Key { name, help, default, example, .. } in KEYS {
        let _ = write!(text, "\n\n# {help}. Default: {default}.\n# {name} = {example}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<ConfigFile, ConfigError> {
        ConfigFile::parse_text_and_collect_mistakes("era.toml", text, Path::new("/etc/era"))?.into_file_if_sound()
    }

    #[test]
    fn mistakes_name_line_key_value_and_what_is_allowed() {
        for (text, told) in [
            ("", "era.toml: version is missing: add the line `version = 1`"),
            ("version = 2", "era.toml:1: version is 2, but must be 1"),
            ("version = \"1\"", "era.toml:1: version is \"1\", but must be 1"),
            ("version = 1\nvolts = 1", "era.toml:2: unknown key `volts`; known keys: version, scene"),
            ("version = 1\nsceen = 1", "era.toml:2: unknown key `sceen`; did you mean scene?"),
            ("version = 1\nno-cache = true", "era.toml:2: unknown key `no-cache`; did you mean no_cache?"),
            ("version = 1\nscene = 7", "era.toml:2: scene is 7, but must be the path of a scene file"),
            (
                "version = 1\n\nlisten = \"7878\"",
                "era.toml:3: listen is \"7878\", but must be a text with a host (IP address or name) and a port",
            ),
            ("version = 1\ntolerance = 1", "era.toml:2: tolerance is 1, but must be a number from 1e-8 to 0.1"),
            ("version = 1\nno_cache = \"yes\"", "era.toml:2: no_cache is \"yes\", but must be true or false"),
            ("version = 1\ndevice = \"atuo\"", "era.toml:2: device is \"atuo\", but must be \"sim\", \"emulated\""),
            ("version = 1\ndevice = \"\"", "era.toml:2: device is \"\", but must be \"sim\", \"emulated\""),
            ("version = 1\naccuracy = \"best\"", "must be \"fast\", \"balanced\" or \"reference\""),
            ("version = 1\n[listen]\nport = 1", "era.toml:2: listen is a table, but must be"),
            ("version = 1\ntolerance = 1e-3\naccuracy = \"fast\"", "era.toml:3: tolerance and accuracy are given"),
            ("version = 1\nscene = ", "era.toml:2: not valid TOML"),
            ("version = 1\nversion = 1", "era.toml:2: not valid TOML"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.contains(told), "{text}: {error}");
        }
        let both = parse("lisen = 1\nscene = 2\nversion = 1").unwrap_err();
        assert_eq!(both.mistakes.iter().map(|mistake| mistake.line).collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn the_command_line_comes_before_the_file() {
        let text = "version = 1\nscene = \"panel.toml\"\ndevice = \"auto\"\ntolerance = 1e-3\nno_cache = true";
        let file = parse(text).unwrap();
        let alone = file.fill_in_missing_options(&Serve::default());
        assert_eq!(alone.panel.scene.as_deref(), Some(Path::new("/etc/era/panel.toml")));
        assert_eq!((alone.device, alone.panel.tolerance), (Some(Target::Auto), Some(1e-3)));
        assert!(alone.keep.no_cache && alone.listen.is_none());
        let mut options = Serve { device: Some(Target::Sim), ..Serve::default() };
        options.panel.accuracy = "fast".parse().ok();
        let joined = file.fill_in_missing_options(&options);
        // The rival on the command line goes before the file's key, too.
        assert_eq!((joined.device, joined.panel.tolerance), (Some(Target::Sim), None));
        assert!(joined.panel.accuracy.is_some() && joined.keep.no_cache);
    }

    #[test]
    fn the_example_can_be_read_with_and_without_its_comments() {
        let text = format_example_config();
        assert!(parse(&text).unwrap().settings.is_empty());
        let all: Vec<&str> =
            text.lines().map(|line| line.strip_prefix("# ").filter(|it| it.contains(" = ")).unwrap_or(line)).collect();
        // One of each pair of rivals.
        let all = all.join("\n").replace("\ntolerance = 1e-3", "").replace("\ntls_cert = \"tls_cert.pem\"", "");
        assert_eq!(parse(&all).unwrap().settings.len(), KEYS.len() - 2);
    }
}
