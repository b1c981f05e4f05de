//! Reading TOML tables with places: every value knows its line, every mistake is collected. Of scene files, and of other files
//! about scenes.

use super::ROUNDING;
use std::cell::RefCell;
use std::fmt;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

/// One mistake in a scene file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mistake {
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
    pub mistakes: Vec<Mistake>,
}

impl SceneError {
    pub(super) fn unreadable(source: &str, error: &std::io::Error) -> Self {
        Self::of(source, 0, format!("cannot read the scene file: {error}"))
    }

    /// One mistake in a line, or in none (0).
    #[must_use]
    pub fn of(source: &str, line: usize, text: String) -> Self {
        Self { source: source.into(), mistakes: vec![Mistake { line, text, ..Mistake::default() }] }
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

/// A file's text as a table whose values know where they stand; `source` is what messages call the file.
///
/// # Errors
/// [`SceneError`] with the first line that is not valid TOML.
pub fn document<'t>(source: &str, text: &'t str) -> Result<Spanned<DeTable<'t>>, SceneError> {
    DeTable::parse(text).map_err(|error| {
        let line = error.span().map_or(0, |span| line_of(text, span.start));
        let told = error.message().trim();
        // "duplicate key" does not say which.
        let own = text.lines().nth(line.wrapping_sub(1)).map(str::trim).filter(|_| told == "duplicate key");
        let text = match own {
            Some(own) if own.starts_with('[') && !own.starts_with("[[") => {
                format!("not valid TOML: {own} for the second time; each of several is written [{own}]")
            }
            Some(own) => format!("not valid TOML: {told}: {own}"),
            None => format!("not valid TOML: {told}"),
        };
        SceneError::of(source, line, text)
    })
}

/// The line, counted from 1, that has a byte of the text.
fn line_of(text: &str, offset: usize) -> usize {
    text.as_bytes().iter().take(offset).filter(|byte| **byte == b'\n').count() + 1
}

/// Collects mistakes and knows where lines begin.
#[derive(Debug)]
pub struct Report<'t> {
    text: &'t str,
    mistakes: RefCell<Vec<Mistake>>,
}

impl<'t> Report<'t> {
    /// Of a file's text, without mistakes so far.
    #[must_use]
    pub fn new(text: &'t str) -> Self {
        Self { text, mistakes: RefCell::new(Vec::new()) }
    }

    /// A mistake in the line of a place.
    pub fn add(&self, at: &Range<usize>, text: impl Into<String>) {
        self.put(at, Mistake { text: text.into(), ..Mistake::default() });
    }

    fn put(&self, at: &Range<usize>, mistake: Mistake) {
        self.mistakes.borrow_mut().push(Mistake { line: self.line(at.start), ..mistake });
    }

    /// The line, counted from 1, that has a byte of the text.
    #[must_use]
    pub fn line(&self, offset: usize) -> usize {
        line_of(self.text, offset)
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
    pub fn finish(self, source: &str) -> Result<(), SceneError> {
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
pub enum Allowed {
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

impl Allowed {
    /// Whether a number is allowed.
    #[must_use]
    pub fn holds(self, value: f64) -> bool {
        value.is_finite()
            && match self {
                Allowed::Positive => value > 0.0,
                Allowed::NotNegative => value >= 0.0,
                Allowed::Within(min, max) => (min..=max).contains(&value),
                Allowed::Along(min, side) => (min - ROUNDING * side..=side * (1.0 + ROUNDING)).contains(&value),
                Allowed::Between(min, max) => value > min && value < max,
            }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Allowed::Positive => f.write_str("above 0"),
            Allowed::NotNegative => f.write_str("0 and above"),
            Allowed::Within(min, max) if min.total_cmp(max).is_eq() => write!(f, "{min}"),
            Allowed::Within(min, max) => write!(f, "{} to {}", plain(*min), plain(*max)),
            Allowed::Along(min, side) => write!(f, "{min} to {side}"),
            Allowed::Between(min, max) => write!(f, "between {min} and {max}, both excluded"),
        }
    }
}

/// A number as people write it: 10000 and 0.001, but 1e20.
fn plain(value: f64) -> String {
    if value == 0.0 || (1e-4..1e7).contains(&value.abs()) { value.to_string() } else { format!("{value:e}") }
}

/// One table under reading. Keys that nobody asked for are mistakes when it is closed.
#[derive(Debug)]
pub struct Section<'r, 't> {
    report: &'r Report<'t>,
    table: &'r DeTable<'t>,
    /// As in messages: `surface.material`, `support[2]`; empty for the whole file.
    path: String,
    at: Range<usize>,
    known: RefCell<Vec<&'static str>>,
}

impl<'r, 't> Section<'r, 't> {
    /// A table that stands at a place; `path` as in messages.
    #[must_use]
    pub fn new(report: &'r Report<'t>, table: &'r DeTable<'t>, path: String, at: Range<usize>) -> Self {
        Self { report, table, path, at, known: RefCell::new(Vec::new()) }
    }

    /// Where its mistakes go.
    #[must_use]
    pub fn report(&self) -> &'r Report<'t> {
        self.report
    }

    /// Its path, as in messages.
    #[must_use]
    pub fn path(&self) -> &str {
        &self.path
    }

    /// A key of it with its path.
    #[must_use]
    pub fn key(&self, key: &str) -> String {
        if self.path.is_empty() { key.into() } else { format!("{}.{key}", self.path) }
    }

    /// Where a key's value stands, or the section if it has none.
    #[must_use]
    pub fn place(&self, key: &str) -> Range<usize> {
        self.table.get(key).map_or_else(|| self.at.clone(), Spanned::span)
    }

    /// Whether a key is there.
    #[must_use]
    pub fn has(&self, key: &'static str) -> bool {
        self.note(key);
        self.table.contains_key(key)
    }

    fn value(&self, key: &'static str) -> Option<&'r DeValue<'t>> {
        self.note(key);
        self.table.get(key).map(Spanned::get_ref)
    }

    fn missing(&self, key: &'static str, wanted: &str) {
        let (field, allowed) = (self.key(key), wanted.to_owned());
        let text = format!("{field} is missing ({wanted})");
        self.report.put(&self.at, Mistake { text, field: Some(field), allowed: Some(allowed), ..Mistake::default() });
    }

    fn wrong_type(&self, key: &'static str, value: &DeValue<'_>, wanted: &str) {
        self.wrong(key, describe(value), wanted);
    }

    /// A key's value is not what is wanted.
    pub fn wrong(&self, key: &str, value: String, wanted: &str) {
        let field = self.key(key);
        let text = format!("{field} is {value}, but must be {wanted}");
        let mistake =
            Mistake { line: 0, text, field: Some(field), value: Some(value), allowed: Some(wanted.to_owned()) };
        self.report.put(&self.place(key), mistake);
    }

    /// A number, required. `NaN` stands in for a wrong one, so that reading goes on.
    pub fn number(&self, key: &'static str, allowed: Allowed) -> f64 {
        if self.value(key).is_none() {
            self.missing(key, &format!("a number {allowed}"));
            return f64::NAN;
        }
        self.number_or(key, f64::NAN, allowed)
    }

    /// A number with a default.
    pub fn number_or(&self, key: &'static str, default: f64, allowed: Allowed) -> f64 {
        let Some(value) = self.value(key) else { return default };
        let Some(number) = as_number(value) else {
            self.wrong_type(key, value, &format!("a number {allowed}"));
            return f64::NAN;
        };
        if allowed.holds(number) {
            return number;
        }
        self.wrong(key, number.to_string(), &allowed.to_string());
        f64::NAN
    }

    /// A whole number, required.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the range is checked first")]
    pub fn count(&self, key: &'static str, max: u32) -> u32 {
        let Some(value) = self.value(key) else {
            self.missing(key, &format!("a whole number 1 to {max}"));
            return 1;
        };
        match as_number(value) {
            Some(number) if number >= 1.0 && number <= f64::from(max) && number.fract() == 0.0 => number as u32,
            _ => {
                self.wrong_type(key, value, &format!("a whole number 1 to {max}"));
                1
            }
        }
    }

    /// A piece of text, required.
    pub fn text(&self, key: &'static str) -> String {
        match self.value(key) {
            Some(DeValue::String(text)) if !text.trim().is_empty() => text.to_string(),
            Some(value) => {
                self.wrong_type(key, value, "a text that is not empty");
                String::new()
            }
            None => {
                self.missing(key, "a text");
                String::new()
            }
        }
    }

    /// Numbers in a list, as many as one of `counts` says; `None` if the key is not there, or wrong.
    pub fn numbers(&self, key: &'static str, counts: &[usize], allowed: Allowed) -> Option<Vec<f64>> {
        let value = self.value(key)?;
        let each = |list: &DeArray<'_>| list.iter().map(|entry| as_number(entry.get_ref())).collect::<Option<Vec<_>>>();
        let numbers = value.as_array().and_then(each).filter(|numbers| counts.contains(&numbers.len()));
        let numbers = numbers.filter(|numbers| numbers.iter().all(|number| allowed.holds(*number)));
        if numbers.is_none() {
            let counts = counts.iter().map(ToString::to_string).collect::<Vec<_>>().join(" or ");
            self.wrong(key, written(value), &format!("a list of {counts} numbers, each {allowed}"));
        }
        numbers
    }

    /// Whether a key's value is a list.
    #[must_use]
    pub fn is_list(&self, key: &'static str) -> bool {
        self.value(key).is_some_and(DeValue::is_array)
    }

    /// Pairs of numbers in a list; `None` if it is none of these, or a number is not allowed.
    pub fn pairs(&self, key: &'static str, first: Allowed, second: Allowed) -> Option<Vec<(f64, f64)>> {
        let pair = |entry: &Spanned<DeValue<'_>>| {
            let pair = entry.get_ref().as_array().filter(|pair| pair.len() == 2)?;
            let number = |at: usize, allowed: Allowed| {
                as_number(pair.get(at)?.get_ref()).filter(|number| allowed.holds(*number))
            };
            Some((number(0, first)?, number(1, second)?))
        };
        self.value(key)?.as_array()?.iter().map(pair).collect()
    }

    /// A key's value, which is told as it is written, is not what is wanted.
    pub fn wrong_list(&self, key: &'static str, wanted: &str) {
        if let Some(value) = self.value(key) {
            self.wrong(key, written(value), wanted);
        }
    }

    /// A text, or a list of texts; `None` if the key is not there, or wrong.
    pub fn texts(&self, key: &'static str) -> Option<Vec<String>> {
        let value = self.value(key)?;
        let texts: Option<Vec<String>> = match value {
            DeValue::Array(list) => list.iter().map(|entry| entry.get_ref().as_str().map(str::to_owned)).collect(),
            value => value.as_str().map(|text| vec![text.to_owned()]),
        };
        let texts = texts.filter(|texts| !texts.is_empty());
        if texts.is_none() {
            self.wrong(key, written(value), "a text, or a list of texts");
        }
        texts
    }

    /// One of some words, required.
    pub fn word<T: Copy>(&self, key: &'static str, words: &[(&'static str, T)]) -> Option<T> {
        let wanted = words.iter().map(|(word, _)| format!("\"{word}\"")).collect::<Vec<_>>().join(", ");
        let Some(value) = self.value(key) else {
            self.missing(key, &format!("one of {wanted}"));
            return None;
        };
        let found = value.as_str().and_then(|text| words.iter().find(|(word, _)| *word == text));
        if found.is_none() {
            self.wrong_type(key, value, &format!("one of {wanted}"));
        }
        found.map(|(_, entry)| *entry)
    }

    /// A table within this one.
    pub fn table(&self, key: &'static str) -> Option<Section<'r, 't>> {
        match self.value(key)? {
            DeValue::Table(table) => Some(Section::new(self.report, table, self.key(key), self.place(key))),
            value => {
                self.wrong_type(key, value, "a table");
                None
            }
        }
    }

    /// A table that must be there.
    pub fn required_table(&self, key: &'static str) -> Option<Section<'r, 't>> {
        if !self.table.contains_key(key) {
            self.missing(key, &format!("a table [{}]", self.key(key)));
        }
        self.table(key)
    }

    /// A list of tables, `[[key]]`; empty if there is none.
    pub fn tables(&self, key: &'static str) -> Vec<Section<'r, 't>> {
        let Some(value) = self.value(key) else { return Vec::new() };
        let DeValue::Array(list) = value else {
            self.wrong_type(key, value, &format!("a list of tables, [[{key}]]"));
            return Vec::new();
        };
        let mut sections = Vec::new();
        for (i, entry) in list.iter().enumerate() {
            match entry.get_ref() {
                DeValue::Table(table) => {
                    // People count from one.
                    let path = format!("{key}[{}]", i + 1);
                    sections.push(Section::new(self.report, table, path, entry.span()));
                }
                _ => self.report.add(&entry.span(), format!("{key}[{}] must be a table, [[{key}]]", i + 1)),
            }
        }
        sections
    }

    /// Notes a key as known, once: some are asked for twice, whether they are there and for their value.
    fn note(&self, key: &'static str) {
        let mut known = self.known.borrow_mut();
        if !known.contains(&key) {
            known.push(key);
        }
    }

    /// Ends the reading: every key that nobody asked for is a mistake.
    pub fn close(self) {
        let known = self.known.borrow();
        for (key, _) in self.table {
            if known.iter().any(|known| known == key.get_ref()) {
                continue;
            }
            let nearest = known
                .iter()
                .map(|known| (distance(known, key.get_ref()), known))
                .filter(|(distance, known)| *distance <= 2.max(known.len() / 3))
                .min();
            let hint = match nearest {
                Some((_, known)) => format!("did you mean {known}?"),
                None => format!("known keys here: {}", known.join(", ")),
            };
            self.report.add(&key.span(), format!("unknown key {}; {hint}", self.key(key.get_ref())));
        }
    }
}

fn as_number(value: &DeValue<'_>) -> Option<f64> {
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

/// A value as in messages that show lists, too.
fn written(value: &DeValue<'_>) -> String {
    match value {
        DeValue::Array(list) => {
            format!("[{}]", list.iter().map(|entry| written(entry.get_ref())).collect::<Vec<_>>().join(", "))
        }
        value => describe(value),
    }
}

fn describe(value: &DeValue<'_>) -> String {
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

/// Levenshtein distance.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, left) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, right) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(left != *right);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}
