//! Tables as text and as Markdown.

use std::fmt::Write;

/// A table with a heading and remarks.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Heading.
    pub title: String,
    /// Paragraphs above it.
    pub above: Vec<String>,
    /// Column names.
    pub columns: Vec<&'static str>,
    /// Rows, each as long as `columns`.
    pub rows: Vec<Vec<String>>,
    /// Paragraphs below it.
    pub below: Vec<String>,
}

impl Table {
    /// A table without rows.
    pub fn new(title: impl Into<String>, columns: &[&'static str]) -> Self {
        Self { title: title.into(), columns: columns.to_vec(), ..Self::default() }
    }

    /// Adds a row; missing cells are empty.
    pub fn add_row(&mut self, cells: impl IntoIterator<Item = String>) {
        let mut cells: Vec<String> = cells.into_iter().collect();
        cells.resize(self.columns.len(), String::new());
        self.rows.push(cells);
    }

    /// The table for a terminal: columns of equal width, the first to the left, the others to the right.
    #[must_use]
    pub fn format_as_text(&self) -> String {
        let widths = self.compute_column_widths();
        let mut out = format!("== {}\n", self.title);
        for paragraph in &self.above {
            let _ = writeln!(out, "{paragraph}");
        }
        let line = |cells: &mut dyn Iterator<Item = &str>| {
            let mut line = String::new();
            for (k, (cell, width)) in cells.zip(&widths).enumerate() {
                // Width in characters, as `format!` counts.
                let _ = if k == 0 { write!(line, "{cell:<width$}") } else { write!(line, "  {cell:>width$}") };
            }
            line.trim_end().to_owned()
        };
        if !self.columns.is_empty() {
            let _ = writeln!(out, "{}", line(&mut self.columns.iter().copied()));
        }
        for row in &self.rows {
            let _ = writeln!(out, "{}", line(&mut row.iter().map(String::as_str)));
        }
        for paragraph in &self.below {
            let _ = writeln!(out, "{paragraph}");
        }
        out
    }

    /// The table for a document, as a section of the third level.
    #[must_use]
    pub fn format_as_markdown(&self) -> String {
        let mut out = format!("### {}\n\n", self.title);
        for paragraph in &self.above {
            let _ = writeln!(out, "{}\n", wrap_paragraph(paragraph));
        }
        let line = |cells: &mut dyn Iterator<Item = &str>| {
            let cells: Vec<String> = cells.map(|cell| cell.replace('|', "\\|")).collect();
            format!("| {} |", cells.join(" | "))
        };
        if !self.columns.is_empty() {
            let _ = writeln!(out, "{}", line(&mut self.columns.iter().copied()));
            let _ = writeln!(out, "|{}", "---|".repeat(self.columns.len()));
            for row in &self.rows {
                let _ = writeln!(out, "{}", line(&mut row.iter().map(String::as_str)));
            }
            out.push('\n');
        }
        for paragraph in &self.below {
            let _ = writeln!(out, "{}\n", wrap_paragraph(paragraph));
        }
        out
    }

    /// In characters.
    fn compute_column_widths(&self) -> Vec<usize> {
        let all =
            |k: usize| self.rows.iter().map(move |row| row[k].chars().count()).chain([self.columns[k].chars().count()]);
        (0..self.columns.len()).map(|k| all(k).max().unwrap_or(0)).collect()
    }
}

/// A paragraph in lines of at most 120 characters, as the manual has them.
fn wrap_paragraph(text: &str) -> String {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) if line.chars().count() + 1 + word.chars().count() <= 120 => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines.join("\n")
}

/// A time with three digits in the unit that suits it, from microseconds to hours.
#[must_use]
pub fn format_time(time_s: f64) -> String {
    match time_s {
        v if !v.is_finite() => String::from("-"),
        v if v < 0.999_5e-3 => format!("{} us", format_three_digits(v * 1e6)),
        v if v < 0.999_5 => format!("{} ms", format_three_digits(v * 1e3)),
        v if v < 7200.0 => format!("{} s", format_three_digits(v)),
        v => format!("{} h", format_three_digits(v / 3600.0)),
    }
}

/// A factor with two or three digits.
#[must_use]
pub fn format_factor(factor: f64) -> String {
    if factor.is_finite() { format!("{} x", format_three_digits(factor)) } else { String::from("-") }
}

/// A relative error, bound, difference or tolerance with two digits, as `1.2e-3`.
#[must_use]
pub fn format_relative_error(error: f64) -> String {
    if error.is_finite() { format!("{error:.1e}") } else { String::from("-") }
}

/// A number of bytes with three digits in kB, MB or GB.
#[must_use]
pub fn format_bytes(bytes: f64) -> String {
    match bytes {
        v if v < 1e6 => format!("{} kB", format_three_digits(v / 1e3)),
        v if v < 1e9 => format!("{} MB", format_three_digits(v / 1e6)),
        v => format!("{} GB", format_three_digits(v / 1e9)),
    }
}

/// Three digits, whole numbers from 100 on.
#[must_use]
pub fn format_three_digits(value: f64) -> String {
    match value.abs() {
        v if v >= 99.95 => format!("{value:.0}"),
        v if v >= 9.995 => format!("{value:.1}"),
        _ => format!("{value:.2}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_their_widest_cell() {
        let mut table = Table::new("title", &["name", "t"]);
        table.add_row(["a long name".into(), "1 ms".into()]);
        table.add_row(["b".into()]);
        table.below.push("remark".into());
        assert_eq!(table.format_as_text(), "== title\nname            t\na long name  1 ms\nb\nremark\n");
    }

    #[test]
    fn markdown_escapes_bars() {
        let mut table = Table::new("title", &["a", "b"]);
        table.add_row(["|x|".into(), "y".into()]);
        assert_eq!(table.format_as_markdown(), "### title\n\n| a | b |\n|---|---|\n| \\|x\\| | y |\n\n");
    }

    #[test]
    fn numbers_have_three_digits_and_a_unit() {
        assert_eq!(format_time(12.34e-6), "12.3 us");
        assert_eq!(format_time(0.0405), "40.5 ms");
        assert_eq!(format_time(0.9996), "1.00 s");
        assert_eq!(format_time(207.4), "207 s");
        assert_eq!(format_time(7.3e6), "2028 h");
        assert_eq!(format_time(f64::NAN), "-");
        assert_eq!(format_factor(5012.0), "5012 x");
        assert_eq!(format_bytes(52.4e6), "52.4 MB");
    }
}
