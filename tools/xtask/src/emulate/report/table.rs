//! The table that the report prints.

use super::ReportEnd;
use crate::error::Error;

/// Widths of the first two columns in characters; what is longer pushes the rest to the right.
const STEP: usize = 34;
const EXPECTED: usize = 62;

/// Rows so far, and figures for the end.
#[derive(Debug)]
pub struct ReportTable {
    end: ReportEnd,
    lines: Vec<String>,
    wrong: Vec<String>,
    figures: Vec<(String, String)>,
}

impl ReportTable {
    /// Without rows.
    pub const fn new(end: ReportEnd) -> Self {
        Self { end, lines: Vec::new(), wrong: Vec::new(), figures: Vec::new() }
    }

    /// Prints the names of the columns.
    pub fn print_head() {
        println!("{:<STEP$} | {:<EXPECTED$} | seen | ", "step", "expected");
    }

    /// Prints the rows.
    pub fn print_rows(&self) {
        println!("{}", self.lines.join("\n"));
    }

    /// Adds the rows and figures of another table.
    pub fn append(&mut self, other: Self) {
        self.lines.extend(other.lines);
        self.wrong.extend(other.wrong);
        self.figures.extend(other.figures);
    }

    /// One row that is right if both columns are the same.
    pub fn add_comparison_row(&mut self, step: &str, expected: &str, seen: &str) {
        self.add_row(step, expected, seen, expected == seen);
    }

    /// One row. Does not return after a wrong one if the report ends there.
    pub fn add_row(&mut self, step: &str, expected: &str, seen: &str, is_right: bool) {
        let verdict = if is_right { "ok" } else { "WRONG" };
        self.lines.push(format!("{step:<STEP$} | {expected:<EXPECTED$} | {seen} | {verdict}"));
        if !is_right {
            self.wrong.push(step.to_owned());
            if self.end == ReportEnd::FirstWrongRow {
                self.print_rows();
                self.print_measured_values_and_wrong_rows();
                // The emulated boards end as their standard inputs close.
                std::process::exit(1);
            }
        }
    }

    /// A step that must not take longer than `limit_ms`.
    pub fn add_time_limit_row(&mut self, step: &str, limit_ms: f64, seen_ms: Option<f64>) {
        let seen = seen_ms.map_or("never".to_owned(), |ms| format!("{ms:.3} ms"));
        self.add_row(
            step,
            &format!("within {limit_ms} ms"),
            &seen,
            seen_ms.is_some_and(|ms| (0.0..=limit_ms).contains(&ms)),
        );
    }

    /// A step that must take from `least_ms` to `limit_ms`.
    pub fn add_time_range_row(&mut self, step: &str, least_ms: f64, limit_ms: f64, seen_ms: Option<f64>) {
        let seen = seen_ms.map_or("never".to_owned(), |ms| format!("{ms:.3} ms"));
        let right = seen_ms.is_some_and(|ms| (least_ms..=limit_ms).contains(&ms));
        self.add_row(step, &format!("{least_ms} to {limit_ms} ms"), &seen, right);
    }

    /// A part of the report that is wrong as a whole if it cannot be carried out; whether it could.
    pub fn run_part_adding_row_on_error(
        &mut self,
        name: &str,
        work: impl FnOnce(&mut Self) -> Result<(), Error>,
    ) -> bool {
        let result = work(self);
        if let Err(error) = &result {
            self.add_row(name, "carried out", &error.to_string(), false);
        }
        result.is_ok()
    }

    /// A figure for the end.
    pub fn add_figure(&mut self, name: &str, value: String) {
        self.figures.push((name.to_owned(), value));
    }

    /// Prints the figures and what was wrong.
    pub fn print_measured_values_and_wrong_rows(&self) {
        println!();
        for (name, value) in &self.figures {
            println!("{name:<60} {value}");
        }
        println!("{} rows, {} wrong", self.lines.len(), self.wrong.len());
        for step in &self.wrong {
            println!("wrong: {step}");
        }
    }

    /// How many rows are wrong.
    pub fn count_wrong_rows(&self) -> usize {
        self.wrong.len()
    }
}
