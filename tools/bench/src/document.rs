//! Tables in documents.

use crate::Part;
use crate::error::Error;
use crate::table::Table;
use clap::ValueEnum;
use std::path::Path;

/// What ends a part of a document that a measurement writes.
const END: &str = "<!-- end -->";

/// What was measured on.
///
/// # Errors
/// [`Error::File`].
pub fn machine() -> Result<String, Error> {
    let path = Path::new("/proc/cpuinfo");
    let text = std::fs::read_to_string(path).map_err(Error::file(path))?;
    let model = text.lines().find(|line| line.starts_with("model name")).and_then(|line| line.split(':').nth(1));
    let cores = text.lines().filter(|line| line.starts_with("processor")).count();
    Ok(format!("Measured on {cores} cores of {}.", model.unwrap_or("an unnamed processor").trim()))
}

/// All tables as a document.
///
/// # Errors
/// [`Error::File`].
pub fn write(path: &Path, tables: &[(Part, Table)]) -> Result<(), Error> {
    let tables: String = tables.iter().map(|(_, table)| table.markdown()).collect();
    std::fs::write(path, format!("## Measurements of the panel model\n\n{}\n\n{tables}", machine()?))
        .map_err(Error::file(path))
}

/// Puts each part's tables where a document has room for them.
///
/// # Errors
/// [`Error::File`], [`Error::NoRoom`].
pub fn update(path: &Path, tables: &[(Part, Table)]) -> Result<(), Error> {
    let mut text = std::fs::read_to_string(path).map_err(Error::file(path))?;
    let machine = machine()?;
    for part in Part::value_variants() {
        let own: String = tables.iter().filter(|table| table.0 == *part).map(|(_, table)| table.markdown()).collect();
        if !own.is_empty() {
            let start = format!("<!-- measured: {} -->", name(*part));
            text = replaced(&text, &start, &format!("{own}{machine}"))
                .ok_or(Error::NoRoom { path: path.to_path_buf(), start })?;
        }
    }
    std::fs::write(path, text).map_err(Error::file(path))
}

/// The part's name on the command line.
fn name(part: Part) -> String {
    part.to_possible_value().map_or_else(String::new, |value| String::from(value.get_name()))
}

/// `text` with what is between `start` and the next end replaced.
fn replaced(text: &str, start: &str, new: &str) -> Option<String> {
    let from = text.find(start)? + start.len();
    let to = from + text[from..].find(END)?;
    Some(format!("{}\n\n{new}\n\n{}", &text[..from], &text[to..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_between_the_marks_changes() {
        let text = "a\n<!-- measured: x -->\nold\n<!-- end -->\nb\n<!-- measured: y -->\n<!-- end -->\n";
        let new = replaced(text, "<!-- measured: x -->", "new").unwrap();
        assert_eq!(new, "a\n<!-- measured: x -->\n\nnew\n\n<!-- end -->\nb\n<!-- measured: y -->\n<!-- end -->\n");
        assert_eq!(replaced(&new, "<!-- measured: x -->", "new").unwrap(), new);
        assert_eq!(replaced(text, "<!-- measured: z -->", "new"), None);
    }
}
