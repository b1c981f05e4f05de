//! Reading TOML tables with places: every value knows its line, every mistake is collected. Of scene files, and of other files
//! about scenes.

use super::{ROUNDING, find_nearest_name};
use std::cell::RefCell;
use std::fmt;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

/// Tables that a scene file may contain several times, in double brackets.
const REPEATED_IN_SCENES: &[&str] = &["support", "mass", "actuator", "edge", "patch", "cutout", "layer"];
/// The same of a study file.
const REPEATED_IN_STUDIES: &[&str] = &["variable", "apart", "wish", "limit", "uncertain"];

/// One mistake in a scene file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FileMistake {
    /// Line, counted from 1; 0 if it belongs to no line.
    pub line: usize,
    /// What is wrong: key, value and what is allowed.
    pub text: String,
    /// The key with its path, as `support[2].x_mm`, where one key's value is wrong or missing.
    pub field: Option<String>,
    /// Its value as in the file, where it has one.
    pub value: Option<String>,
    /// What is allowed there.
    pub allowed: Option<String>,
}

/// A scene file that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneError {
    /// The file.
    pub source: String,
    /// Every mistake found, by line.
    pub mistakes: Vec<FileMistake>,
}

impl SceneError {
    pub(super) fn from_read_error(source: &str, error: &std::io::Error) -> Self {
        Self::from_single_mistake(source, 0, format!("cannot read the scene file: {error}"))
    }

    /// An error with one mistake in a line, or in none (0).
    #[must_use]
    pub fn from_single_mistake(source: &str, line: usize, text: String) -> Self {
        Self { source: source.into(), mistakes: vec![FileMistake { line, text, ..FileMistake::default() }] }
    }
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, mistake) in self.mistakes.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            match mistake.line {
                0 => write!(f, "{}: {}", self.source, mistake.text)?,
                line => write!(f, "{}:{line}: {}", self.source, mistake.text)?,
            }
        }
        Ok(())
    }
}

impl std::error::Error for SceneError {}

/// A file's text as a table whose values know where they stand; `source_name` is what messages call the file.
///
/// # Errors
/// [`SceneError`] with the first line that is not valid TOML.
pub fn parse_toml_document<'t>(source_name: &str, text: &'t str) -> Result<Spanned<DeTable<'t>>, SceneError> {
    DeTable::parse(text).map_err(|error| {
        let line = error.span().map_or(0, |span| line_number_of_byte(text, span.start));
        let told = error.message().trim();
        // "duplicate key" does not say which.
        let own = text.lines().nth(line.wrapping_sub(1)).map(str::trim).filter(|_| told == "duplicate key");
        let table = own.and_then(|own| own.strip_prefix('[')).and_then(|own| own.split(']').next()).map(str::trim);
        let table = table.filter(|name| !name.starts_with('['));
        let text = match (table, own) {
            (Some(name), _) if REPEATED_IN_SCENES.contains(&name) || REPEATED_IN_STUDIES.contains(&name) => {
                format!(
                    "not valid TOML: [{name}] is given twice, but a table in single brackets may be given only once; a \
                     table that the file may contain several times is written [[{name}]]"
                )
            }
            (Some(name), _) => format!("not valid TOML: [{name}] is given twice, but may be given only once"),
            (None, Some(own)) => format!("not valid TOML: {told} in the line `{own}`"),
            (None, None) => describe_toml_syntax_mistake(text, line, told),
        };
        SceneError::from_single_mistake(source_name, line, text)
    })
}

/// Line, counted from 1, that contains a byte of the text.
fn line_number_of_byte(text: &str, byte_offset: usize) -> usize {
    text.as_bytes().iter().take(byte_offset).filter(|byte| **byte == b'\n').count() + 1
}

/// Collects mistakes and knows where lines begin.
#[derive(Debug)]
pub struct MistakeReport<'t> {
    text: &'t str,
    mistakes: RefCell<Vec<FileMistake>>,
}

impl<'t> MistakeReport<'t> {
    /// Of a file's text, without mistakes so far.
    #[must_use]
    pub fn new(text: &'t str) -> Self {
        Self { text, mistakes: RefCell::new(Vec::new()) }
    }

    /// Adds a mistake in the line of a byte range.
    pub fn add_mistake_at(&self, at: &Range<usize>, text: impl Into<String>) {
        self.append_mistake_filling_in_line_number(at, FileMistake { text: text.into(), ..FileMistake::default() });
    }

    fn append_mistake_filling_in_line_number(&self, at: &Range<usize>, mistake: FileMistake) {
        self.mistakes.borrow_mut().push(FileMistake { line: self.line_number_at(at.start), ..mistake });
    }

    /// Line, counted from 1, that contains a byte of the text.
    #[must_use]
    pub fn line_number_at(&self, offset: usize) -> usize {
        line_number_of_byte(self.text, offset)
    }

    /// Whether there is none so far.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.mistakes.borrow().is_empty()
    }

    /// `Err` with all mistakes, by line, if there are any.
    ///
    /// # Errors
    /// [`SceneError`].
    pub fn into_result(self, source: &str) -> Result<(), SceneError> {
        let mut mistakes = self.mistakes.into_inner();
        if mistakes.is_empty() {
            return Ok(());
        }
        mistakes.sort_by_key(|mistake| mistake.line);
        Err(SceneError { source: source.into(), mistakes })
    }
}

/// Allowed numbers.
#[derive(Clone, Copy, Debug)]
pub enum AllowedNumbers {
    /// Above zero.
    Positive,
    /// Zero and above.
    NotNegative,
    /// Between the two, both included.
    Within(f64, f64),
    /// From a length to a side's, which may have more digits than are shown.
    Along(f64, f64),
    /// Between the two, both excluded.
    Between(f64, f64),
}

impl AllowedNumbers {
    /// Whether a number is allowed.
    #[must_use]
    pub fn contains_number(self, value: f64) -> bool {
        value.is_finite()
            && match self {
                AllowedNumbers::Positive => value > 0.0,
                AllowedNumbers::NotNegative => value >= 0.0,
                AllowedNumbers::Within(min, max) => (min..=max).contains(&value),
                AllowedNumbers::Along(min, side) => (min - ROUNDING * side..=side * (1.0 + ROUNDING)).contains(&value),
                AllowedNumbers::Between(min, max) => value > min && value < max,
            }
    }

    /// What must be there, as a noun: `a number from 1 to 10`.
    fn describe_number(self) -> String {
        match self {
            AllowedNumbers::Within(min, max) if min.total_cmp(&max).is_eq() => format!("the number {self}"),
            AllowedNumbers::Within(..) | AllowedNumbers::Along(..) => format!("a number from {self}"),
            AllowedNumbers::Positive | AllowedNumbers::NotNegative | AllowedNumbers::Between(..) => {
                format!("a number {self}")
            }
        }
    }
}

impl fmt::Display for AllowedNumbers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            AllowedNumbers::Positive => f.write_str("above 0"),
            AllowedNumbers::NotNegative => f.write_str("at least 0"),
            AllowedNumbers::Within(min, max) if min.total_cmp(max).is_eq() => write!(f, "{min}"),
            AllowedNumbers::Within(min, max) => write!(f, "{} to {}", format_number(*min), format_number(*max)),
            AllowedNumbers::Along(min, side) => write!(f, "{min} to {side}"),
            AllowedNumbers::Between(min, max) => write!(f, "between {min} and {max}, both excluded"),
        }
    }
}

/// What is wrong with a line, from 1, of a text that is no TOML; `message` is the parser's.
#[must_use]
pub fn describe_toml_syntax_mistake(text: &str, line: usize, message: &str) -> String {
    match text.lines().nth(line.wrapping_sub(1)).map(str::trim) {
        Some(own) if own.ends_with('=') => format!("not valid TOML: in the line `{own}`, the key has no value"),
        Some(own) if message.starts_with("string values must be quoted") => {
            format!("not valid TOML: a text must be in quotes (key = \"text\"), but the line is `{own}`")
        }
        _ => format!("not valid TOML: {}", message.trim()),
    }
}

/// A table that must be there, with the line that begins it: `layer[2].material` begins with `[layer.material]`.
fn describe_table_and_how_to_write_its_header(path: &str) -> String {
    let Some((list, rest)) = path.split_once('[') else { return format!("a table, written [{path}]") };
    let key = rest.split_once(']').map_or(rest, |(_, key)| key);
    format!("a table, written as [{list}{key}] below the line [[{list}]]")
}

/// A number as people write it: 10000 and 0.001, but 1e20.
fn format_number(value: f64) -> String {
    if value == 0.0 || (1e-4..1e7).contains(&value.abs()) { value.to_string() } else { format!("{value:e}") }
}

/// One table under reading. Keys that nobody asked for are mistakes when it is closed.
#[derive(Debug)]
pub struct TomlSection<'r, 't> {
    report: &'r MistakeReport<'t>,
    table: &'r DeTable<'t>,
    /// As in messages: `surface.material`, `support[2]`; empty for the whole file.
    path: String,
    at: Range<usize>,
    known: RefCell<Vec<&'static str>>,
}

impl<'r, 't> TomlSection<'r, 't> {
    /// A table that stands at a place; `path` as in messages.
    #[must_use]
    pub fn new(report: &'r MistakeReport<'t>, table: &'r DeTable<'t>, path: String, at: Range<usize>) -> Self {
        Self { report, table, path, at, known: RefCell::new(Vec::new()) }
    }

    /// The report that collects its mistakes.
    #[must_use]
    pub fn mistake_report(&self) -> &'r MistakeReport<'t> {
        self.report
    }

    /// Its path as messages name it.
    #[must_use]
    pub fn path_in_messages(&self) -> &str {
        &self.path
    }

    /// One of its keys with its path.
    #[must_use]
    pub fn key_with_path(&self, key: &str) -> String {
        if self.path.is_empty() { key.into() } else { format!("{}.{key}", self.path) }
    }

    /// Where a key's value stands, or the section if it has none.
    #[must_use]
    pub fn byte_range_of_value_or_section(&self, key: &str) -> Range<usize> {
        self.table.get(key).map_or_else(|| self.at.clone(), Spanned::span)
    }

    /// Whether a key is there; from then on the key is known.
    #[must_use]
    pub fn has_key_marking_known(&self, key: &'static str) -> bool {
        self.mark_key_known(key);
        self.table.contains_key(key)
    }

    fn value_of_key_marking_known(&self, key: &'static str) -> Option<&'r DeValue<'t>> {
        self.mark_key_known(key);
        self.table.get(key).map(Spanned::get_ref)
    }

    fn report_missing_key(&self, key: &'static str, wanted: &str) {
        let (field, allowed) = (self.key_with_path(key), wanted.to_owned());
        let text = format!("{field} is missing, but must be {wanted}");
        self.report.append_mistake_filling_in_line_number(
            &self.at,
            FileMistake { text, field: Some(field), allowed: Some(allowed), ..FileMistake::default() },
        );
    }

    fn report_wrong_type(&self, key: &'static str, value: &DeValue<'_>, wanted: &str) {
        self.report_wrong_value(key, format_value_but_only_name_lists_and_tables(value), wanted);
    }

    /// Reports that a key's value is not what is wanted.
    pub fn report_wrong_value(&self, key: &str, value: String, wanted: &str) {
        let field = self.key_with_path(key);
        let text = format!("{field} is {value}, but must be {wanted}");
        let mistake =
            FileMistake { line: 0, text, field: Some(field), value: Some(value), allowed: Some(wanted.to_owned()) };
        self.report.append_mistake_filling_in_line_number(&self.byte_range_of_value_or_section(key), mistake);
    }

    /// A number, required. `NaN` stands in for a wrong one, so that reading goes on.
    pub fn read_required_number_or_nan(&self, key: &'static str, allowed: AllowedNumbers) -> f64 {
        if self.value_of_key_marking_known(key).is_none() {
            self.report_missing_key(key, &allowed.describe_number());
            return f64::NAN;
        }
        self.read_optional_number_or_nan(key, f64::NAN, allowed)
    }

    /// A number with a default.
    pub fn read_optional_number_or_nan(&self, key: &'static str, default: f64, allowed: AllowedNumbers) -> f64 {
        let Some(value) = self.value_of_key_marking_known(key) else { return default };
        let Some(number) = parse_number_value(value) else {
            self.report_wrong_type(key, value, &allowed.describe_number());
            return f64::NAN;
        };
        if allowed.contains_number(number) {
            return number;
        }
        self.report_wrong_value(key, format_number(number), &allowed.to_string());
        f64::NAN
    }

    /// Reads a whole number from 1 to `max` that has to be there.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the range is checked first")]
    pub fn read_required_positive_count_or_1(&self, key: &'static str, max: u32) -> u32 {
        let Some(value) = self.value_of_key_marking_known(key) else {
            self.report_missing_key(key, &format!("a whole number from 1 to {max}"));
            return 1;
        };
        match parse_number_value(value) {
            Some(number) if number >= 1.0 && number <= f64::from(max) && number.fract() == 0.0 => number as u32,
            Some(number) if number.fract() == 0.0 => {
                self.report_wrong_value(key, format_number(number), &format!("1 to {max}"));
                1
            }
            _ => {
                self.report_wrong_type(key, value, &format!("a whole number from 1 to {max}"));
                1
            }
        }
    }

    /// Reads a text that has to be there.
    pub fn read_required_text_or_empty(&self, key: &'static str) -> String {
        match self.value_of_key_marking_known(key) {
            Some(DeValue::String(text)) if !text.trim().is_empty() => text.to_string(),
            Some(value) => {
                self.report_wrong_type(key, value, "a text that is not empty");
                String::new()
            }
            None => {
                self.report_missing_key(key, "a text");
                String::new()
            }
        }
    }

    /// Numbers in a list, as many as one of `counts` says; `None` if the key is not there, or wrong.
    pub fn read_numbers_if_given_and_allowed(
        &self,
        key: &'static str,
        counts: &[usize],
        allowed: AllowedNumbers,
    ) -> Option<Vec<f64>> {
        let value = self.value_of_key_marking_known(key)?;
        let each = |list: &DeArray<'_>| {
            list.iter().map(|entry| parse_number_value(entry.get_ref())).collect::<Option<Vec<_>>>()
        };
        let numbers = value.as_array().and_then(each).filter(|numbers| counts.contains(&numbers.len()));
        let numbers = numbers.filter(|numbers| numbers.iter().all(|number| allowed.contains_number(*number)));
        if numbers.is_none() {
            let counts = counts.iter().map(ToString::to_string).collect::<Vec<_>>().join(" or ");
            self.report_wrong_value(
                key,
                format_value_with_lists(value),
                &format!("a list of {counts} numbers, each {allowed}"),
            );
        }
        numbers
    }

    /// Whether a key's value is a list.
    #[must_use]
    pub fn is_value_a_list_marking_known(&self, key: &'static str) -> bool {
        self.value_of_key_marking_known(key).is_some_and(DeValue::is_array)
    }

    /// Pairs of numbers in a list; `None` if it is none of these, or a number is not allowed.
    pub fn number_pairs_if_all_allowed_without_report(
        &self,
        key: &'static str,
        first: AllowedNumbers,
        second: AllowedNumbers,
    ) -> Option<Vec<(f64, f64)>> {
        let pair = |entry: &Spanned<DeValue<'_>>| {
            let pair = entry.get_ref().as_array().filter(|pair| pair.len() == 2)?;
            let number = |at: usize, allowed: AllowedNumbers| {
                parse_number_value(pair.get(at)?.get_ref()).filter(|number| allowed.contains_number(*number))
            };
            Some((number(0, first)?, number(1, second)?))
        };
        self.value_of_key_marking_known(key)?.as_array()?.iter().map(pair).collect()
    }

    /// Reports that a key's value, shown as it is written, is not what is wanted.
    pub fn report_wrong_list(&self, key: &'static str, wanted: &str) {
        if let Some(value) = self.value_of_key_marking_known(key) {
            self.report_wrong_value(key, format_value_with_lists(value), wanted);
        }
    }

    /// A text, or a list of texts; `None` if the key is not there, or wrong.
    pub fn read_text_or_texts_if_given_and_valid(&self, key: &'static str) -> Option<Vec<String>> {
        let value = self.value_of_key_marking_known(key)?;
        let texts: Option<Vec<String>> = match value {
            DeValue::Array(list) => list.iter().map(|entry| entry.get_ref().as_str().map(str::to_owned)).collect(),
            value => value.as_str().map(|text| vec![text.to_owned()]),
        };
        let texts = texts.filter(|texts| !texts.is_empty());
        if texts.is_none() {
            self.report_wrong_value(key, format_value_with_lists(value), "a text, or a list of texts");
        }
        texts
    }

    /// Reads one of some words, which has to be there.
    pub fn read_required_word<T: Copy>(&self, key: &'static str, words: &[(&'static str, T)]) -> Option<T> {
        let wanted = words.iter().map(|(word, _)| format!("\"{word}\"")).collect::<Vec<_>>().join(", ");
        let Some(value) = self.value_of_key_marking_known(key) else {
            self.report_missing_key(key, &format!("one of {wanted}"));
            return None;
        };
        let found = value.as_str().and_then(|text| words.iter().find(|(word, _)| *word == text));
        if found.is_none() {
            self.report_wrong_type(key, value, &format!("one of {wanted}"));
        }
        found.map(|(_, entry)| *entry)
    }

    /// Reads a table within this one; `None` if it is not there.
    pub fn read_table_if_given_and_a_table(&self, key: &'static str) -> Option<TomlSection<'r, 't>> {
        match self.value_of_key_marking_known(key)? {
            DeValue::Table(table) => Some(TomlSection::new(
                self.report,
                table,
                self.key_with_path(key),
                self.byte_range_of_value_or_section(key),
            )),
            value => {
                self.report_wrong_type(key, value, "a table");
                None
            }
        }
    }

    /// A table that must be there.
    pub fn read_required_table(&self, key: &'static str) -> Option<TomlSection<'r, 't>> {
        if !self.table.contains_key(key) {
            self.report_missing_key(key, &describe_table_and_how_to_write_its_header(&self.key_with_path(key)));
        }
        self.read_table_if_given_and_a_table(key)
    }

    /// A list of tables, `[[key]]`; empty if there is none.
    pub fn read_tables(&self, key: &'static str) -> Vec<TomlSection<'r, 't>> {
        let Some(value) = self.value_of_key_marking_known(key) else { return Vec::new() };
        let DeValue::Array(list) = value else {
            self.report_wrong_type(key, value, &format!("a list of tables, written [[{key}]]"));
            return Vec::new();
        };
        let mut sections = Vec::new();
        for (i, entry) in list.iter().enumerate() {
            match entry.get_ref() {
                DeValue::Table(table) => {
                    // People count from one.
                    let path = format!("{key}[{}]", i + 1);
                    sections.push(TomlSection::new(self.report, table, path, entry.span()));
                }
                _ => self
                    .report
                    .add_mistake_at(&entry.span(), format!("{key}[{}] must be a table, written [[{key}]]", i + 1)),
            }
        }
        sections
    }

    /// Notes a key as known, once: some are asked for twice, whether they are there and for their value.
    fn mark_key_known(&self, key: &'static str) {
        let mut known = self.known.borrow_mut();
        if !known.contains(&key) {
            known.push(key);
        }
    }

    /// Ends the reading: every key that nobody asked for is a mistake.
    pub fn report_unknown_keys(self) {
        let known = self.known.borrow();
        for (key, _) in self.table {
            if known.iter().any(|known| known == key.get_ref()) {
                continue;
            }
            let nearest = find_nearest_name(key.get_ref(), known.iter().copied());
            let hint = match nearest {
                Some(known) => format!("did you mean {known}?"),
                None => format!("allowed keys: {}", known.join(", ")),
            };
            self.report
                .add_mistake_at(&key.span(), format!("unknown key `{}`; {hint}", self.key_with_path(key.get_ref())));
        }
    }
}

/// A TOML number as `f64`; `None` for any other value.
fn parse_number_value(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str().parse().ok(),
        DeValue::Integer(integer) =>
        {
            #[expect(clippy::cast_precision_loss, reason = "as in any other number")]
            i64::from_str_radix(integer.as_str(), integer.radix()).ok().map(|value| value as f64)
        }
        _ => None,
    }
}

/// A value as messages show it, lists entry by entry.
fn format_value_with_lists(value: &DeValue<'_>) -> String {
    match value {
        DeValue::Array(list) => {
            format!(
                "[{}]",
                list.iter().map(|entry| format_value_with_lists(entry.get_ref())).collect::<Vec<_>>().join(", ")
            )
        }
        value => format_value_but_only_name_lists_and_tables(value),
    }
}

/// A value as messages show it.
fn format_value_but_only_name_lists_and_tables(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("{text:?}"),
        DeValue::Integer(integer) => integer.as_str().into(),
        DeValue::Float(float) => float.as_str().into(),
        DeValue::Boolean(flag) => flag.to_string(),
        DeValue::Datetime(time) => time.to_string(),
        DeValue::Array(_) => "a list".into(),
        DeValue::Table(_) => "a table".into(),
    }
}
