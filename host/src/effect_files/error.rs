//! Files that cannot be read.

use super::format::FileFormat;

/// Why a file cannot be read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ReadError {
    /// Too large.
    #[error("the file has {bytes} bytes, but a file of format {format} may have at most {max}")]
    TooLarge {
        /// Its size.
        bytes: usize,
        /// Its format.
        format: FileFormat,
        /// The most allowed.
        max: usize,
    },
    /// Not of its format.
    #[error("the file is not a valid {format} file: {detail}")]
    Syntax {
        /// The format.
        format: FileFormat,
        /// What is wrong.
        detail: String,
    },
    /// A value that is not allowed.
    #[error("{field} is {value}, but must be {allowed}")]
    Field {
        /// The field's name.
        field: String,
        /// As given.
        value: String,
        /// What is allowed.
        allowed: String,
    },
    /// A field that is not known or missing, with what is wrong.
    #[error("{0}")]
    UnreadField(String),
    /// A format that is not read.
    #[error("{0}")]
    NotRead(String),
    /// Only what nobody feels.
    #[error("no event of the effect reaches the intensity {least}, below which nothing is felt")]
    NothingFelt {
        /// The least that is played.
        least: f64,
    },
    /// Nothing is left.
    #[error("the file ({format}) has no event that can be played{}", .warnings.iter().map(|warning| format!("; {warning}")).collect::<String>())]
    NoEvents {
        /// The format.
        format: FileFormat,
        /// What was left out, and why.
        warnings: Vec<String>,
    },
}

impl ReadError {
    /// A value that is not allowed.
    pub fn new_field_error(field: impl Into<String>, value: impl ToString, allowed: impl Into<String>) -> Self {
        Self::Field { field: field.into(), value: value.to_string(), allowed: allowed.into() }
    }
}
