//! What shows of a study's variables only with the scene: paths that lead nowhere, names and places that two of them have, values that the
//! scene refuses.

use super::design::{self, CubeDimension, VariableSetting};
use super::draw_latin_hypercube;
use super::{DesignSpace, collect_all_places_of_paths, document};
use crate::spec::{MinimumDistance, PathStep, StudyVariable, VariableKind, WantedFigure};
use era_model::scene::random::RandomSequence;
use era_model::scene::read::MistakeReport;
use std::cell::{Cell, LazyCell};

/// Columns that the table of designs has in any case.
const COLUMNS: [&str; 6] = ["design", "status", "reason", "on_front", "weakest_x_mm", "weakest_y_mm"];
/// Values of each dimension that are tried when a study is read.
const TRIED: [f64; 3] = [0.0, 0.5, 1.0];
/// Points that are tried besides where none of these is taken: hardly ever none of them is in a fiftieth of the space.
const SAMPLES: usize = 256;
/// Bytes of scenes that are read for that, of all variables together: a second of one processor or so in two thousand readings of the example
/// plate. Variables that are left when they are used up are not told of; the rows of the study say of each design why it is refused.
const MOST_READ: usize = 4_000_000;
/// Of random numbers: the same study is told the same.
const SEED: u64 = 1;
/// A stream of random numbers of its own.
const STREAM: u64 = 0x7a1e;

/// Tells of mistakes in a study's file by its lines.
struct LineReporter<'r, 't> {
    report: &'r MistakeReport<'t>,
    /// A report knows lines by bytes.
    starts: Vec<usize>,
}

impl LineReporter<'_, '_> {
    fn report_mistake_in_line(&self, line: usize, message: String) {
        let at = self.starts.get(line.saturating_sub(1)).copied().unwrap_or(0);
        self.report.add_mistake_at(&(at..at), message);
    }
}

/// What is left of the bytes that may be read.
struct ReadBudget(Cell<usize>);

impl ReadBudget {
    /// Takes some of them; whether they were there.
    fn take_bytes_or_use_up_budget_if_too_few_left(&self, bytes: usize) -> bool {
        let left = self.0.get().checked_sub(bytes);
        self.0.set(left.unwrap_or(0));
        left.is_some()
    }
}

/// A variable as messages call it; `variable_index` counts from zero.
fn name_variable_in_message(variable_index: usize, variable: &StudyVariable) -> String {
    format!("variable[{}] ({})", variable_index + 1, variable.name)
}

impl DesignSpace {
    /// Tells of variables that lead nowhere, of those that are not held apart, and of those whose values the scene refuses all; and of what else leads
    /// nowhere. `figures` are the study's.
    pub(super) fn report_all_that_does_not_fit_scene(
        &self,
        report: &MistakeReport<'_>,
        text: &str,
        figures: &[WantedFigure],
    ) {
        let starts = std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect();
        let lines = LineReporter { report, starts };
        let mut is_led = vec![false; self.variables.len()];
        for (number, variable) in self.variables.iter().enumerate() {
            let name = name_variable_in_message(number, variable);
            if let Err(error) = document::check_variable_can_be_set_in_document(&self.base, variable) {
                lines.report_mistake_in_line(variable.line, format!("{name}: {error}"));
                continue;
            }
            if let VariableKind::Mirror { from, .. } = &variable.what
                && !self.variables[..number].iter().any(|before| before.is_place_or_mirror_variable_of_table(from))
            {
                lines.report_mistake_in_line(
                    variable.line,
                    format!("{name}: mirror_of is {from}, but must be the `place` of an earlier [[variable]]"),
                );
                continue;
            }
            is_led[number] = true;
        }
        self.try_values_and_report_variables_always_refused(&lines, &is_led);
        let is_told = self.report_and_flag_variables_setting_keys_of_earlier_variables(&lines);
        self.report_variables_whose_column_name_is_taken(&lines, figures, &is_told);
        self.report_mistakes_of_uncertain_and_distance_entries(&lines);
    }

    /// Tells of variables that change what one before them changes, which would come to nothing. Says of each whether it is one.
    fn report_and_flag_variables_setting_keys_of_earlier_variables(&self, lines: &LineReporter<'_, '_>) -> Vec<bool> {
        let places: Vec<Vec<Vec<PathStep>>> =
            self.variables.iter().map(|own| self.scene_keys_written_by_variable_or_empty(own)).collect();
        let clash = |number: usize| {
            let own = &self.variables[number];
            (0..number).find_map(|before| {
                let mut both =
                    places[number].iter().flat_map(|own| places[before].iter().map(move |other| (own, other)));
                let is_count = matches!(own.what, VariableKind::Count { .. });
                let found = both.find(|(own, other)| {
                    // A table that is put where a key has been set takes that with it.
                    if is_count { own == other } else { other.starts_with(own) }
                });
                found.map(|(_, other)| (before, document::format_place_as_path_with_indices_from_one(other)))
            })
        };
        let tell = |number: usize| {
            let Some((before, place)) = clash(number) else { return false };
            let (own, other) = (&self.variables[number], &self.variables[before]);
            lines.report_mistake_in_line(
                own.line,
                format!(
                    "{}: this variable and variable[{}] ({}) in line {} both change {place}, but only one variable may \
                     do so",
                    name_variable_in_message(number, own),
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
    fn scene_keys_written_by_variable_or_empty(&self, variable: &StudyVariable) -> Vec<Vec<PathStep>> {
        let paths = match &variable.what {
            VariableKind::Number { paths, .. } | VariableKind::Choice { paths, .. } => paths.clone(),
            VariableKind::Place { of, .. } | VariableKind::Mirror { of, .. } => {
                vec![of.child_path("x_mm"), of.child_path("y_mm")]
            }
            VariableKind::Count { list, .. } => return vec![vec![PathStep::Key(list.clone())]],
        };
        collect_all_places_of_paths(&paths, &self.base).unwrap_or_default()
    }

    /// Tells of variables whose columns of the table another column's name would hide.
    fn report_variables_whose_column_name_is_taken(
        &self,
        lines: &LineReporter<'_, '_>,
        figures: &[WantedFigure],
        is_reported: &[bool],
    ) {
        let of_figures: Vec<String> = figures
            .iter()
            .map(WantedFigure::column_name)
            .flat_map(|name| [format!("{name}_low"), format!("{name}_high"), name])
            .collect();
        let columns = design::columns_of_variables(&self.variables);
        let mut last = None;
        for (k, column) in columns.iter().enumerate() {
            let number = column.variable;
            // One of a place's columns is enough to be told.
            if is_reported[number] || last == Some(number) {
                continue;
            }
            let own = &self.variables[number];
            let before = columns[..k].iter().find(|other| other.name == column.name && other.variable != number);
            let whose = if COLUMNS.contains(&column.name.as_str()) {
                "the table itself".to_owned()
            } else if of_figures.contains(&column.name) {
                "a figure".to_owned()
            } else if let Some(before) = before {
                let line = self.variables[before.variable].line;
                format!("variable[{}] in line {line}", before.variable + 1)
            } else {
                continue;
            };
            last = Some(number);
            lines.report_mistake_in_line(
                own.line,
                format!(
                    "{}: the name of this variable's column in the table of designs would be {:?}, but {whose} \
                     already has a column with this name: give the variable another `name`",
                    name_variable_in_message(number, own),
                    column.name
                ),
            );
        }
    }

    /// Tells of `[[uncertain]]` and `[[apart]]` that lead nowhere.
    fn report_mistakes_of_uncertain_and_distance_entries(&self, lines: &LineReporter<'_, '_>) {
        for (number, (own, places)) in self.uncertain.iter().zip(self.places_of_each_uncertain_value()).enumerate() {
            if places.iter().any(|place| document::number_at_place_if_any(&self.base, place).is_none()) {
                let name = format!("uncertain[{}] ({})", number + 1, own.name);
                lines.report_mistake_in_line(
                    own.line,
                    format!("{name}: `key` must be the path of a number in the scene file, but there is no number at this path"),
                );
            }
        }
        let apart = (1..).zip(&self.apart).map(|(number, own)| (format!("apart[{number}]"), own.line, &own.places));
        let off =
            (1..).zip(&self.uncertain).map(|(number, own)| (format!("uncertain[{number}]"), own.line, &own.paths));
        for (number, own) in (1..).zip(&self.apart) {
            self.report_distance_paths_to_no_place_or_fewer_than_two(lines, number, own);
        }
        self.report_values_uncertain_twice(lines);
        for (name, line, path) in
            apart.chain(off).flat_map(|(name, line, paths)| paths.iter().map(move |path| (name.clone(), line, path)))
        {
            if let Err(error) = path.find_places_allowing_new_last_key(&self.base) {
                lines.report_mistake_in_line(line, format!("{name}: {error}"));
            }
        }
    }

    /// Tells of `[[apart]]` whose paths lead to something that has no place, or to fewer than two.
    fn report_distance_paths_to_no_place_or_fewer_than_two(
        &self,
        lines: &LineReporter<'_, '_>,
        entry_number: usize,
        minimum_distance: &MinimumDistance,
    ) {
        let mut places: Vec<Vec<PathStep>> = Vec::new();
        for path in &minimum_distance.places {
            for place in path.find_places_allowing_new_last_key(&self.base).unwrap_or_default() {
                let x = [place.as_slice(), &[PathStep::Key("x_mm".into())]].concat();
                if document::number_at_place_if_any(&self.base, &x).is_none() {
                    let told = format!(
                        "apart[{entry_number}]: the path {path} must be the path of a table with the key x_mm, such as an [[actuator]], \
                         but is not"
                    );
                    lines.report_mistake_in_line(minimum_distance.line, told);
                    return;
                }
                if !places.contains(&place) {
                    places.push(place);
                }
            }
        }
        let leads =
            minimum_distance.places.iter().all(|path| path.find_places_allowing_new_last_key(&self.base).is_ok());
        if leads && places.len() < 2 {
            lines.report_mistake_in_line(
                minimum_distance.line,
                format!(
                    "apart[{entry_number}]: the paths must lead to at least 2 different tables (such as two actuators), \
                     but the number of different tables is {}",
                    places.len()
                ),
            );
        }
    }

    /// Tells of values that two `[[uncertain]]` have off, which would be off by both.
    fn report_values_uncertain_twice(&self, lines: &LineReporter<'_, '_>) {
        let all = self.places_of_each_uncertain_value();
        for (number, (own, places)) in self.uncertain.iter().zip(&all).enumerate() {
            let clash = places.iter().find_map(|place| {
                let before = all[..number].iter().position(|others| others.contains(place))?;
                Some((place, before))
            });
            if let Some((place, before)) = clash {
                let (place, other) =
                    (document::format_place_as_path_with_indices_from_one(place), &self.uncertain[before]);
                lines.report_mistake_in_line(
                    own.line,
                    format!(
                        "uncertain[{}] ({}): this entry and uncertain[{}] ({}) in line {} both make {place} uncertain, \
                         but only one entry may do so",
                        number + 1,
                        own.name,
                        before + 1,
                        other.name,
                        other.line
                    ),
                );
            }
        }
    }

    /// Tells of variables (of those that lead somewhere) none of whose values the scene takes: neither with all else as in the scene's file, nor where
    /// others change along.
    fn try_values_and_report_variables_always_refused(&self, lines: &LineReporter<'_, '_>, has_valid_paths: &[bool]) {
        let left = ReadBudget(Cell::new(MOST_READ));
        let samples = LazyCell::new(|| {
            draw_latin_hypercube(self.dimensions.len(), SAMPLES, &mut RandomSequence::new(SEED, STREAM))
        });
        let by_itself: Vec<Option<String>> = (0..self.variables.len())
            .map(|number| {
                let is_it = |other: usize| has_valid_paths[number] && other == number;
                let reason = self.first_refusal_if_all_points_are_tried_and_refused(
                    &self.points_with_variable_at_ends_and_middle_others_at_middle(number),
                    &is_it,
                    &left,
                )?;
                self.first_refusal_if_all_points_are_tried_and_refused(&samples, &is_it, &left).map(|_| reason)
            })
            .collect();
        let ends = TRIED.map(|part| vec![part; self.dimensions.len()]);
        for (number, reason) in by_itself.iter().enumerate() {
            let Some(reason) = reason else { continue };
            // Those that the scene does not take by themselves may be what is wrong, or only go together.
            let with_others = |other: usize| other == number || has_valid_paths[other] && by_itself[other].is_none();
            let with_all = |other: usize| has_valid_paths[other];
            let each: [&dyn Fn(usize) -> bool; 2] = [&with_others, &with_all];
            let is_taken = |changes: &dyn Fn(usize) -> bool| {
                self.first_refusal_if_all_points_are_tried_and_refused(&ends, changes, &left).is_none()
                    || self.first_refusal_if_all_points_are_tried_and_refused(&samples, changes, &left).is_none()
            };
            if !each.into_iter().any(is_taken) {
                let own = &self.variables[number];
                lines.report_mistake_in_line(
                    own.line,
                    format!(
                        "{}: the program tried several values of this variable, and the scene is valid with none of \
                         them (with the first of these values, the scene is not valid for this reason: {reason})",
                        name_variable_in_message(number, own)
                    ),
                );
            }
        }
    }

    /// Points with all combinations of some values of a variable's dimensions.
    fn points_with_variable_at_ends_and_middle_others_at_middle(&self, variable_index: usize) -> Vec<Vec<f64>> {
        let own = |dimension: &&CubeDimension| dimension.variable == variable_index;
        let count = self.dimensions.iter().filter(own).count();
        let combination = |tried: usize| {
            let mut rest = tried;
            let mut point = vec![0.5; self.dimensions.len()];
            for (value, _) in point.iter_mut().zip(&self.dimensions).filter(|(_, dimension)| own(dimension)) {
                *value = TRIED[rest % TRIED.len()];
                rest /= TRIED.len();
            }
            point
        };
        (0..TRIED.len().pow(u32::try_from(count).unwrap_or(u32::MAX))).map(combination).collect()
    }

    /// Why the scene takes none of the designs at some points, with all that does not change as in its file; `None` if it takes one, or if nothing
    /// is left to try all of them with.
    fn first_refusal_if_all_points_are_tried_and_refused(
        &self,
        points: &[Vec<f64>],
        is_variable_changed: &dyn Fn(usize) -> bool,
        read_budget: &ReadBudget,
    ) -> Option<String> {
        let mut first = None;
        for point in points {
            if !read_budget.take_bytes_or_use_up_budget_if_too_few_left(self.bytes) {
                return None;
            }
            let mut design = self.design_at_point(point);
            let kept = design.settings.iter_mut().enumerate().filter(|(number, _)| !is_variable_changed(*number));
            kept.for_each(|(_, setting)| *setting = VariableSetting::Kept);
            match self
                .design_as_document(&design)
                .and_then(|document| document::parse_document_as_scene(&self.source, &document))
            {
                Ok(_) => return None,
                Err(error) => first = first.or(Some(error.to_string())),
            }
        }
        first
    }
}
