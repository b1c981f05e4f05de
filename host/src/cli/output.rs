//! Files that commands are told to write.

use super::Failure;
use era_files::{Readers, replace_file};
use std::path::Path;

/// Writes a text to a file, whole or not at all.
///
/// # Errors
/// [`Failure::Failed`] with the path and the system's reason.
pub fn write_text_file_atomically(path: &Path, text: &str) -> Result<(), Failure> {
    replace_file(path, Readers::ByUmask, text.as_bytes())
        .map_err(|error| Failure::runtime_error(format!("cannot write {}: {error}", path.display())))
}
