//! The token that a command sends: of a file, or of the environment; not of the command line, which everybody on the machine can read.

use super::Failure;
use crate::private_file::{self, TOKEN_VARIABLE};
use crate::text_file::BYTE_ORDER_MARK;
use std::path::Path;

/// Reads the token, if there is one.
///
/// # Errors
/// A file without a token, or text that is no token; what it says is not told.
pub fn read_token_from_file_or_else_environment(file: Option<&Path>) -> Result<Option<String>, Failure> {
    let Some(path) = file else { return read_token_from_environment() };
    let wrong = |what: String| Failure::Usage(format!("token file \"{}\": {what}", path.display()));
    let text = private_file::read(path).map_err(wrong)?;
    let token = parse_last_word_outside_comment_lines_as_token(&text).map_err(wrong)?;
    token
        .map(Some)
        .ok_or_else(|| wrong("the file contains no token: write the token into the file, in a line of its own".into()))
}

/// That of the variable; one that is set to nothing is none.
fn read_token_from_environment() -> Result<Option<String>, Failure> {
    let Some(value) = std::env::var_os(TOKEN_VARIABLE) else { return Ok(None) };
    let wrong = |what: &str| Failure::Usage(format!("the variable {TOKEN_VARIABLE}: {what}"));
    let text = value.into_string().map_err(|_| wrong("the value is not UTF-8 text"))?;
    parse_last_word_outside_comment_lines_as_token(text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&text))
        .map_err(|what| wrong(&what))
}

/// The last word of the last line: of a text of the secret alone, or of one of the daemon's, which may have comments.
fn parse_last_word_outside_comment_lines_as_token(text: &str) -> Result<Option<String>, String> {
    let lines = text.lines().filter(|line| !line.trim_start().starts_with('#'));
    let Some(token) = lines.flat_map(str::split_whitespace).last() else { return Ok(None) };
    // A header takes no others. Where it is told, but not what is around it.
    match token.chars().enumerate().find(|(_, c)| !c.is_ascii_graphic()) {
        None => Ok(Some(token.to_owned())),
        Some((i, c)) => Err(format!(
            "character {} of the token is {}, but a token may contain only letters, digits, '-', '_', '.' and '~'",
            i + 1,
            c.escape_unicode()
        )),
    }
}
