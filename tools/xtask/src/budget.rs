//! The budgets of `firmware/budget.toml`, and how an image stands against them.

use crate::error::Error;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::path::Path;

/// All budgets.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Budget {
    /// Code, constants, initial values.
    pub flash: Bytes,
    /// Variables.
    pub ram: Bytes,
    /// Worst-case stack, and what its analysis must be told.
    pub stack: Stack,
    /// Load of the processor with four channels running.
    pub cpu: Percent,
}

/// A budget in bytes.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bytes {
    /// Most that may be used.
    pub bytes: u32,
    /// Why this number.
    #[cfg_attr(not(test), expect(dead_code, reason = "for readers of the file, who must find one; a test reads it"))]
    why: String,
}

/// A budget in per cent.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Percent {
    /// Most that may be used.
    pub percent: f64,
    /// Why this number.
    #[cfg_attr(not(test), expect(dead_code, reason = "for readers of the file, who must find one; a test reads it"))]
    why: String,
}

/// The budget of the stack.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stack {
    /// Most that may be used.
    pub bytes: u32,
    /// Why this number.
    #[cfg_attr(not(test), expect(dead_code, reason = "for readers of the file, who must find one; a test reads it"))]
    why: String,
    /// Functions that call tasks.
    pub executors: Vec<String>,
    /// How often each function of a circle of calls may be on the stack at once.
    pub recursion: u32,
    /// Interrupt handlers whose priority is not 0.
    pub priorities: BTreeMap<String, u8>,
}

impl Budget {
    /// Reads the file.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::Budget`].
    pub fn read(root: &Path) -> Result<Self, Error> {
        let path = root.join("firmware/budget.toml");
        let text = fs::read_to_string(&path).map_err(|source| Error::File {
            what: "cannot read",
            path: path.clone(),
            source,
        })?;
        toml::from_str(&text).map_err(|source| Error::Budget { path, source: Box::new(source) })
    }
}

/// What was used of one budget.
#[derive(Clone, Debug, PartialEq)]
pub struct BudgetRow {
    /// As in "flash".
    pub name: &'static str,
    /// As in "bytes".
    pub unit: &'static str,
    /// Used.
    pub used: f64,
    /// Allowed.
    pub budget: f64,
}

impl BudgetRow {
    /// A row in bytes.
    pub fn in_bytes(name: &'static str, used: u32, budget: u32) -> Self {
        Self { name, unit: "bytes", used: f64::from(used), budget: f64::from(budget) }
    }

    /// The row of the processor's load with four channels running, in per cent.
    pub fn of_processor_load(used_percent: f64, budget: &Budget) -> Self {
        Self { name: "CPU", unit: "%", used: used_percent, budget: budget.cpu.percent }
    }

    /// Whether it is within its budget. What is not a number is not.
    pub fn is_within_budget(&self) -> bool {
        self.used <= self.budget
    }
}

impl fmt::Display for BudgetRow {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, unit, used, budget } = self;
        let digits = if *unit == "%" { 1 } else { 0 };
        let margin = 100.0 * (budget - used) / budget;
        write!(out, "{name:<8}{used:>9.digits$} of {budget:>8.digits$} {unit:<6}margin {margin:>5.1} %")?;
        if self.is_within_budget() { Ok(()) } else { write!(out, "  OVER THE BUDGET") }
    }
}

/// Prints the rows and fails if one does not hold.
///
/// # Errors
/// [`Error::OverBudget`] with the names of those over it.
pub fn print_and_check_rows(rows: &[BudgetRow]) -> Result<(), Error> {
    for row in rows {
        println!("{row}");
    }
    let over: Vec<&str> = rows.iter().filter(|row| !row.is_within_budget()).map(|row| row.name).collect();
    if over.is_empty() { Ok(()) } else { Err(Error::OverBudget(over.join(", "))) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_over_its_budget_fails_by_name() {
        let within = BudgetRow::in_bytes("flash", 100, 100);
        let over = BudgetRow::in_bytes("stack", 101, 100);
        assert!(print_and_check_rows(std::slice::from_ref(&within)).is_ok());
        let error = print_and_check_rows(&[within, over]).expect_err("one is over").to_string();
        assert!(error.contains("stack") && !error.contains("flash"), "{error}");
        assert!(!BudgetRow { used: f64::NAN, ..BudgetRow::in_bytes("CPU", 0, 1) }.is_within_budget());
    }

    #[test]
    fn the_budget_file_is_read_and_every_number_has_a_reason() {
        let budget = Budget::read(&crate::repository_root().expect("a checkout")).expect("a budget");
        for why in [&budget.flash.why, &budget.ram.why, &budget.stack.why, &budget.cpu.why] {
            assert!(why.len() > 20, "{why}");
        }
    }
}
