//! Tables in documents.

use crate::Benchmark;
use crate::error::Error;
use crate::table::Table;
use clap::ValueEnum;
use std::path::Path;

/// What ends a part of a document that a measurement writes.
const END: &str = "<!-- end -->";

/// The processor that was measured on, and its cores, as a sentence.
///
/// # Errors
/// [`Error::File`].
pub fn describe_machine() -> Result<String, Error> {
    let path = Path::new("/proc/cpuinfo");
    let text = std::fs::read_to_string(path).map_err(Error::file_error(path))?;
    let model = text.lines().find(|line| line.starts_with("model name")).and_then(|line| line.split(':').nth(1));
    let cores = text.lines().filter(|line| line.starts_with("processor")).count();
    Ok(format!("Measured on {cores} cores of {}.", model.unwrap_or("an unnamed processor").trim()))
}

/// Writes all tables as a document.
///
/// # Errors
/// [`Error::File`].
pub fn write_tables_as_markdown(path: &Path, tables: &[(Benchmark, Table)]) -> Result<(), Error> {
    let tables: String = tables.iter().map(|(_, table)| table.format_as_markdown()).collect();
    std::fs::write(path, format!("## Measurements of the panel model\n\n{}\n\n{tables}", describe_machine()?))
        .map_err(Error::file_error(path))
}

/// Puts each part's tables where a document has room for them.
///
/// # Errors
/// [`Error::File`], [`Error::NoRoom`].
pub fn update_tables_in_document(path: &Path, tables: &[(Benchmark, Table)]) -> Result<(), Error> {
    let mut text = std::fs::read_to_string(path).map_err(Error::file_error(path))?;
    let machine = describe_machine()?;
    for part in Benchmark::value_variants() {
        let own: String =
            tables.iter().filter(|table| table.0 == *part).map(|(_, table)| table.format_as_markdown()).collect();
        if !own.is_empty() {
            let start = format!("<!-- measured: {} -->", get_command_line_name(*part));
            text = replace_between_marks_if_found(&text, &start, &format!("{own}{machine}"))
                .ok_or(Error::NoRoom { path: path.to_path_buf(), start })?;
        }
    }
    std::fs::write(path, text).map_err(Error::file_error(path))
}

/// The part's name on the command line.
fn get_command_line_name(part: Benchmark) -> String {
    part.to_possible_value().map_or_else(String::new, |value| String::from(value.get_name()))
}

/// `text` with what is between `start_mark` and the next end mark replaced; `None` without the marks.
fn replace_between_marks_if_found(text: &str, start_mark: &str, new_text: &str) -> Option<String> {
    let start = text.find(start_mark)? + start_mark.len();
    let end = start + text[start..].find(END)?;
    Some(format!("{}\n\n{new_text}\n\n{}", &text[..start], &text[end..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_between_the_marks_changes() {
        let text = "a\n<!-- measured: x -->\nold\n<!-- end -->\nb\n<!-- measured: y -->\n<!-- end -->\n";
        let new = replace_between_marks_if_found(text, "<!-- measured: x -->", "new").unwrap();
        assert_eq!(new, "a\n<!-- measured: x -->\n\nnew\n\n<!-- end -->\nb\n<!-- measured: y -->\n<!-- end -->\n");
        assert_eq!(replace_between_marks_if_found(&new, "<!-- measured: x -->", "new").unwrap(), new);
        assert_eq!(replace_between_marks_if_found(text, "<!-- measured: z -->", "new"), None);
    }
}
