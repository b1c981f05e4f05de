//! Files that nobody but their owner can have changed.

use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::path::Path;

/// Why a file or a folder is not trusted.
#[derive(Debug, thiserror::Error)]
pub enum NotOwn {
    /// It cannot be read.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// It is something else.
    #[error("{found} was found, but {wanted} is required")]
    Kind {
        /// What it is.
        found: &'static str,
        /// What it has to be.
        wanted: &'static str,
    },
    /// Somebody else may have written it.
    #[error("the owner has the user ID {owner}, but must be the user who runs this program ({own}) or root")]
    Owner {
        /// Its owner.
        owner: u32,
        /// Who runs this program.
        own: u32,
    },
    /// Others may write to it.
    #[error(
        "the mode is {mode:04o}, so users other than the owner may write: remove this permission with `chmod go-w`"
    )]
    Mode {
        /// Its permissions.
        mode: u32,
    },
    /// It is larger than what is read.
    #[error("the size is {bytes} bytes, but at most {most_bytes} bytes are allowed")]
    TooLarge {
        /// Its size.
        bytes: u64,
        /// The most that is read.
        most_bytes: u64,
    },
}

/// Reads a file of at most `most_bytes` that is a regular one, of this process's user or of root, and that nobody else may write to. Looks at the file that it has opened; follows no link, waits
/// for no pipe.
///
/// # Errors
/// [`NotOwn`].
pub fn read_own_file(path: &Path, most_bytes: u64) -> Result<Vec<u8>, NotOwn> {
    let file = open_unfollowed(path)?;
    let known = file.metadata()?;
    if !known.is_file() {
        return Err(NotOwn::Kind { found: kind_name(known.file_type()), wanted: "a regular file" });
    }
    check_owner_and_mode(&known)?;
    if known.len() > most_bytes {
        return Err(NotOwn::TooLarge { bytes: known.len(), most_bytes });
    }
    let mut bytes = Vec::with_capacity(usize::try_from(known.len()).unwrap_or_default());
    // It may grow under our eyes.
    file.take(most_bytes).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Checks that a folder, or the one that a link leads to, belongs to this process's user or to root, and that nobody else may write to it.
///
/// # Errors
/// [`NotOwn`].
pub fn check_own_folder(path: &Path) -> Result<(), NotOwn> {
    let known = path.metadata()?;
    if !known.is_dir() {
        return Err(NotOwn::Kind { found: kind_name(known.file_type()), wanted: "a folder" });
    }
    check_owner_and_mode(&known)
}

#[cfg(unix)]
fn open_unfollowed(path: &Path) -> Result<File, NotOwn> {
    use rustix::fs::OFlags;
    use std::os::unix::fs::OpenOptionsExt;
    let flags = (OFlags::NOFOLLOW | OFlags::NONBLOCK).bits().cast_signed();
    OpenOptions::new().read(true).custom_flags(flags).open(path).map_err(|error| {
        if path.is_symlink() {
            NotOwn::Kind { found: "a symbolic link", wanted: "a regular file" }
        } else {
            error.into()
        }
    })
}

#[cfg(not(unix))]
fn open_unfollowed(path: &Path) -> Result<File, NotOwn> {
    Ok(OpenOptions::new().read(true).open(path)?)
}

#[cfg(unix)]
fn kind_name(kind: std::fs::FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match kind {
        _ if kind.is_fifo() => "a pipe",
        _ if kind.is_socket() => "a socket",
        _ if kind.is_block_device() || kind.is_char_device() => "a device",
        _ if kind.is_dir() => "a folder",
        _ => "a file",
    }
}

#[cfg(not(unix))]
fn kind_name(kind: std::fs::FileType) -> &'static str {
    if kind.is_dir() { "a folder" } else { "a file" }
}

#[cfg(unix)]
pub(crate) fn check_owner_and_mode(known: &std::fs::Metadata) -> Result<(), NotOwn> {
    use std::os::unix::fs::MetadataExt;
    /// Permissions of the group and of others to write.
    const FOREIGN: u32 = 0o022;
    let (owner, own) = (known.uid(), rustix::process::geteuid().as_raw());
    if owner != own && owner != 0 {
        return Err(NotOwn::Owner { owner, own });
    }
    let mode = known.mode() & 0o7777;
    if mode & FOREIGN == 0 { Ok(()) } else { Err(NotOwn::Mode { mode }) }
}

/// Who may write to a file is not told by a mode here.
#[cfg(not(unix))]
#[expect(clippy::unnecessary_wraps, reason = "as on Unix")]
fn check_owner_and_mode(_: &std::fs::Metadata) -> Result<(), NotOwn> {
    Ok(())
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::fs::{self, Permissions};
    use std::os::unix::fs::{PermissionsExt, chown, symlink};
    use std::process::Command;

    #[test]
    fn only_a_regular_file_that_nobody_else_may_write_to_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("own"), "text").unwrap();
        for (mode, is_read) in
            [(0o600, true), (0o644, true), (0o400, true), (0o620, false), (0o602, false), (0o666, false)]
        {
            fs::set_permissions(at("own"), Permissions::from_mode(mode)).unwrap();
            let read = read_own_file(&at("own"), 100);
            assert_eq!(read.is_ok(), is_read, "{mode:o}: {read:?}");
        }
        fs::set_permissions(at("own"), Permissions::from_mode(0o600)).unwrap();
        assert!(matches!(read_own_file(&at("own"), 3), Err(NotOwn::TooLarge { bytes: 4, most_bytes: 3 })));
        symlink("own", at("link")).unwrap();
        symlink("none", at("broken")).unwrap();
        assert!(Command::new("mkfifo").arg(at("pipe")).status().unwrap().success());
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        for name in ["link", "broken", "pipe", "socket", "none", "."] {
            let refused = read_own_file(&at(name), 100).unwrap_err();
            let is_io = matches!(&refused, NotOwn::Io(_));
            assert_eq!(is_io, ["socket", "none"].contains(&name), "{name}: {refused}");
        }
        assert!(matches!(read_own_file(Path::new("/dev/zero"), 100), Err(NotOwn::Kind { .. })));
        if rustix::process::geteuid().is_root() {
            chown(at("own"), Some(65_534), None).unwrap();
            let refused = read_own_file(&at("own"), 100).unwrap_err();
            assert!(refused.to_string().contains("the owner has the user ID 65534"), "{refused}");
        }
    }

    #[test]
    fn only_a_folder_that_nobody_else_may_write_to_is_used() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("own")).unwrap();
        symlink("own", at("link")).unwrap();
        for (mode, is_own) in [(0o700, true), (0o755, true), (0o770, false), (0o702, false), (0o1777, false)] {
            fs::set_permissions(at("own"), Permissions::from_mode(mode)).unwrap();
            assert_eq!(check_own_folder(&at("own")).is_ok(), is_own, "{mode:o}");
            assert_eq!(check_own_folder(&at("link")).is_ok(), is_own, "{mode:o}");
        }
        fs::write(at("file"), "").unwrap();
        assert!(check_own_folder(&at("file")).unwrap_err().to_string().contains("a file was found"));
        if rustix::process::geteuid().is_root() {
            fs::set_permissions(at("own"), Permissions::from_mode(0o700)).unwrap();
            chown(at("own"), Some(65_534), None).unwrap();
            assert!(matches!(check_own_folder(&at("own")), Err(NotOwn::Owner { owner: 65_534, own: 0 })));
        }
    }
}
