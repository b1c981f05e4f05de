//! What shows of a study's variables only with the scene: paths that lead nowhere, names and places that two of them have, values that the
//! scene refuses.

use super::design::{self, Dimension, Setting};
use super::{Design, Space, all_places, document};
use crate::spec::{Step, Variable, Wanted, What};
use era_model::scene::read::Report;

/// Columns that the table of designs has in any case.
const COLUMNS: [&str; 6] = ["design", "status", "reason", "on_front", "weakest_x_mm", "weakest_y_mm"];
/// Values of each dimension of a variable that are tried when a study is read.
const TRIED: [f64; 3] = [0.0, 0.5, 1.0];

/// Tells of mistakes in a study's file by its lines.
struct Lines<'r, 't> {
    report: &'r Report<'t>,
    /// A report knows lines by bytes.
    starts: Vec<usize>,
}

impl Lines<'_, '_> {
    fn tell(&self, line: usize, told: String) {
        let at = self.starts.get(line.saturating_sub(1)).copied().unwrap_or(0);
        self.report.add(&(at..at), told);
    }
}

/// A variable as messages call it; `number` counts from zero.
fn named(number: usize, variable: &Variable) -> String {
    format!("variable[{}] ({})", number + 1, variable.name)
}

impl Space {
    /// Tells of variables that lead nowhere, of those that are not held apart, and of those whose values the scene refuses all; and of what else leads
    /// nowhere. `figures` are the study's.
    pub(super) fn check(&self, report: &Report<'_>, text: &str, figures: &[Wanted]) {
        let starts = std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect();
        let lines = Lines { report, starts };
        for (number, variable) in self.variables.iter().enumerate() {
            let name = named(number, variable);
            if let Err(error) = document::leads(&self.base, variable) {
                lines.tell(variable.line, format!("{name}: {error}"));
                continue;
            }
            if let What::Mirror { from, .. } = &variable.what
                && !self.variables[..number].iter().any(|before| before.is_place_of(from))
            {
                lines.tell(
                    variable.line,
                    format!("{name}: mirror_of is {from}, but must be a place of a variable before this one"),
                );
                continue;
            }
            if let Some(reason) = self.refusal_of_all(number) {
                lines.tell(variable.line, format!("{name}: the scene takes none of its values: {reason}"));
            }
        }
        let is_told = self.check_places(&lines);
        self.check_names(&lines, figures, &is_told);
        self.check_others(&lines);
    }

    /// Tells of variables that change what one before them changes, which would come to nothing. Says of each whether it is one.
    fn check_places(&self, lines: &Lines<'_, '_>) -> Vec<bool> {
        let places: Vec<Vec<Vec<Step>>> = self.variables.iter().map(|own| self.written(own)).collect();
        let clash = |number: usize| {
            let own = &self.variables[number];
            (0..number).find_map(|before| {
                let mut both =
                    places[number].iter().flat_map(|own| places[before].iter().map(move |other| (own, other)));
                let is_count = matches!(own.what, What::Count { .. });
                let found = both.find(|(own, other)| {
                    // A table that is put where a key has been set takes that with it.
                    if is_count { own == other } else { other.starts_with(own) }
                });
                found.map(|(_, other)| (before, document::written(other)))
            })
        };
        let tell = |number: usize| {
            let Some((before, place)) = clash(number) else { return false };
            let (own, other) = (&self.variables[number], &self.variables[before]);
            lines.tell(
                own.line,
                format!(
                    "{}: it changes {place}, which variable[{}] ({}) in line {} changes too: only one of them may",
                    named(number, own),
                    before + 1,
                    other.name,
                    other.line
                ),
            );
            true
        };
        (0..self.variables.len()).map(tell).collect()
    }

    /// The places that a variable writes to; none where it leads nowhere.
    fn written(&self, variable: &Variable) -> Vec<Vec<Step>> {
        let paths = match &variable.what {
            What::Number { paths, .. } | What::Choice { paths, .. } => paths.clone(),
            What::Place { of, .. } | What::Mirror { of, .. } => vec![of.below("x_mm"), of.below("y_mm")],
            What::Count { list, .. } => return vec![vec![Step::Key(list.clone())]],
        };
        all_places(&paths, &self.base).unwrap_or_default()
    }

    /// Tells of variables whose columns of the table another column's name would hide.
    fn check_names(&self, lines: &Lines<'_, '_>, figures: &[Wanted], is_told: &[bool]) {
        let of_figures: Vec<String> = figures
            .iter()
            .map(Wanted::column)
            .flat_map(|name| [format!("{name}_low"), format!("{name}_high"), name])
            .collect();
        let columns = design::columns(&self.variables);
        let mut last = None;
        for (k, column) in columns.iter().enumerate() {
            let number = column.variable;
            // One of a place's columns is enough to be told.
            if is_told[number] || last == Some(number) {
                continue;
            }
            let own = &self.variables[number];
            let before = columns[..k].iter().find(|other| other.name == column.name && other.variable != number);
            let whose = if COLUMNS.contains(&column.name.as_str()) {
                "the table of designs has in any case".to_owned()
            } else if of_figures.contains(&column.name) {
                "is that of a figure".to_owned()
            } else if let Some(before) = before {
                let line = self.variables[before.variable].line;
                format!("is that of variable[{}] in line {line}", before.variable + 1)
            } else {
                continue;
            };
            last = Some(number);
            lines.tell(
                own.line,
                format!("{}: its column would be {:?}, which {whose}: give it another `name`", named(number, own), column.name),
            );
        }
    }

    /// Tells of `[[uncertain]]` and `[[apart]]` that lead nowhere.
    fn check_others(&self, lines: &Lines<'_, '_>) {
        for (number, (own, places)) in self.uncertain.iter().zip(self.uncertain_places()).enumerate() {
            if places.iter().any(|place| document::number(&self.base, place).is_none()) {
                let name = format!("uncertain[{}] ({})", number + 1, own.name);
                lines.tell(own.line, format!("{name}: the scene's file has no number there"));
            }
        }
        let apart = (1..).zip(&self.apart).map(|(number, own)| (format!("apart[{number}]"), own.line, &own.places));
        let off =
            (1..).zip(&self.uncertain).map(|(number, own)| (format!("uncertain[{number}]"), own.line, &own.paths));
        for (name, line, path) in
            apart.chain(off).flat_map(|(name, line, paths)| paths.iter().map(move |path| (name.clone(), line, path)))
        {
            if let Err(error) = path.places(&self.base) {
                lines.tell(line, format!("{name}: {error}"));
            }
        }
    }

    /// Why none of some values of a variable is taken, all else as in the scene's file; `None` if one is.
    fn refusal_of_all(&self, number: usize) -> Option<String> {
        let own = |dimension: &&Dimension| dimension.variable == number;
        let count = self.dimensions.iter().filter(own).count();
        let mut first = None;
        for tried in 0..TRIED.len().pow(u32::try_from(count).unwrap_or(u32::MAX)) {
            let mut rest = tried;
            let mut point = vec![0.5; self.dimensions.len()];
            for (value, _) in point.iter_mut().zip(&self.dimensions).filter(|(_, dimension)| own(dimension)) {
                *value = TRIED[rest % TRIED.len()];
                rest /= TRIED.len();
            }
            let mut settings = vec![Setting::Kept; self.variables.len()];
            settings[number] = self.design(&point).settings[number];
            let taken =
                self.document(&Design { settings }).and_then(|document| document::scene(&self.source, &document));
            match taken {
                Ok(_) => return None,
                Err(error) => first = first.or(Some(error.to_string())),
            }
        }
        first
    }
}
