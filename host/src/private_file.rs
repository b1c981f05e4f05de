//! Files with secrets: read only where nobody else than their owner can.

use crate::text_file::decode_text;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Reads a file of text with a secret in it.
///
/// Looks at the file that it has opened: what is put in its place meanwhile is not read.
///
/// # Errors
/// That it cannot be read, is no text in UTF-8, or that others than its owner may read or write it, with its mode and what to do.
pub fn read(path: &Path) -> Result<String, String> {
    decode_text(read_bytes(path)?).map_err(|error| error.to_string())
}

/// The same of a file that may have other bytes than text.
///
/// # Errors
/// As [`read`].
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, String> {
    let mut file = File::open(path).map_err(|error| error.to_string())?;
    check(path, &file)?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    Ok(bytes)
}

/// Permissions of the group and of others to read and to write: whoever may write tokens may add one.
#[cfg(unix)]
const FOREIGN: u32 = 0o066;
/// The same of others alone.
#[cfg(unix)]
const OF_OTHERS: u32 = 0o006;

#[cfg(unix)]
fn check(path: &Path, file: &File) -> Result<(), String> {
    use std::os::unix::fs::PermissionsExt;
    let mode = file.metadata().map_err(|error| error.to_string())?.permissions().mode() & 0o7777;
    // systemd lets a service's user read its credentials by an access control list, whose mask stands where the mode of the
    // group does: 0440 for a file that no group may read.
    let credentials = std::env::var_os("CREDENTIALS_DIRECTORY").filter(|folder| !folder.is_empty());
    let foreign = if credentials.is_some_and(|folder| path.starts_with(folder)) { OF_OTHERS } else { FOREIGN };
    if mode & foreign == 0 {
        return Ok(());
    }
    Err(format!(
        "the file contains a secret, but its mode is {mode:04o}, so other users may read or write the file: run `chmod 600 {}`",
        path.display()
    ))
}

/// Who may read a file is not told by a mode here.
#[cfg(not(unix))]
#[expect(clippy::unnecessary_wraps, reason = "as on Unix")]
fn check(_: &Path, _: &File) -> Result<(), String> {
    Ok(())
}
