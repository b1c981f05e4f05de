//! Files with secrets: read only where nobody else than their owner can.

use crate::text_file::decode_utf8_and_drop_byte_order_mark;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// The environment variable with a token, if no file is named. Programs that this one starts do not get it.
pub const TOKEN_VARIABLE: &str = "ERA_TOKEN";

/// Reads a file of text with a secret in it.
///
/// Looks at the file that it has opened: what is put in its place meanwhile is not read. A pipe is read to its end (`--token-file <(pass show era)`), but
/// one that nobody writes to is not waited for.
///
/// # Errors
/// That it cannot be read, is no text in UTF-8, is neither a file nor a pipe, belongs to another user, or that others than its owner may read or write it,
/// with its mode and what to do.
pub fn read(path: &Path) -> Result<String, String> {
    decode_utf8_and_drop_byte_order_mark(read_bytes(path)?).map_err(|error| error.to_string())
}

/// The same of a file that may have other bytes than text.
///
/// # Errors
/// As [`read`].
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, String> {
    let mut file = open_without_waiting(path).map_err(|error| format!("cannot read the file: {error}"))?;
    check_kind_owner_and_mode(path, &file)?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(|error| format!("cannot read the file: {error}"))?;
    Ok(bytes)
}

/// Opens a file. A pipe that nobody writes to is at its end.
///
/// # Errors
/// As [`File::open`].
#[cfg(unix)]
pub fn open_without_waiting(path: &Path) -> io::Result<File> {
    use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
    use std::os::unix::fs::OpenOptionsExt;
    let flags = OFlags::NONBLOCK.bits().cast_signed();
    let file = File::options().read(true).custom_flags(flags).open(path)?;
    // Whoever writes to it may take a while.
    fcntl_setfl(&file, fcntl_getfl(&file)? - OFlags::NONBLOCK)?;
    Ok(file)
}

/// Opens a file.
///
/// # Errors
/// As [`File::open`].
#[cfg(not(unix))]
pub fn open_without_waiting(path: &Path) -> io::Result<File> {
    File::open(path)
}

/// Permissions of the group and of others to read and to write: whoever may write tokens may add one.
#[cfg(unix)]
const FOREIGN: u32 = 0o066;
/// The same of others alone.
#[cfg(unix)]
const OF_OTHERS: u32 = 0o006;

#[cfg(unix)]
fn check_kind_owner_and_mode(path: &Path, file: &File) -> Result<(), String> {
    use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
    let known = file.metadata().map_err(|error| error.to_string())?;
    if !known.is_file() && !known.file_type().is_fifo() {
        return Err("this must be a file with a secret, but it is a folder, a device or a socket".into());
    }
    let (owner, user) = (known.uid(), rustix::process::geteuid().as_raw());
    if owner != 0 && owner != user {
        return Err(format!(
            "the file contains a secret, but its owner (user ID {owner}) can change the file: the owner must be the \
            user who runs this program (user ID {user}) or root"
        ));
    }
    let mode = known.permissions().mode() & 0o7777;
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
fn check_kind_owner_and_mode(_: &Path, _: &File) -> Result<(), String> {
    Ok(())
}
