//! Files that are replaced as a whole.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs::{self, File, Metadata, OpenOptions};
use std::hash::{BuildHasher, RandomState};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

/// How the name of a file begins that is being written, and how it ends. Between them are 16 random digits.
const UNFINISHED: (&str, &str) = (".era-", ".part");
/// Age after which an unfinished file is one that nobody writes any more.
const LEFT_BEHIND: Duration = Duration::from_secs(3600);
/// Links that are followed from one to the next, as many as Linux does.
const MOST_LINKS: usize = 40;

/// Who may read a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Readers {
    /// A new file: whom the process's umask lets. A file that is replaced keeps its mode, and its owner where this process may give files away.
    ByUmask,
    /// Its owner alone (0600), from its first byte on and whatever the umask is.
    Owner,
    /// Everybody (0644), whatever the umask is.
    Everybody,
}

/// Replaces the content of a file by `bytes`, as [`replace_file_by`] does.
///
/// # Errors
/// As [`replace_file_by`].
pub fn replace_file(path: &Path, readers: Readers, bytes: &[u8]) -> io::Result<()> {
    replace_file_by(path, readers, |file| file.write_all(bytes))
}

/// Replaces the content of a file by what `write` writes. Links are followed, and stay. A pipe or a device (`/dev/stdout`) cannot be replaced, and is
/// written to as it is.
///
/// # Errors
/// Those of `write` and of the file system: the file has its old content then, or is not there if it was not. Where forcing the folder onto the disk is what fails, it has the new
/// one.
pub fn replace_file_by(
    path: &Path,
    readers: Readers,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    match find_replaceable_target(path)? {
        Some(target) => write_beside_and_rename(&target, readers, write),
        None => {
            let mut stream = BufWriter::new(OpenOptions::new().append(true).open(path)?);
            write(&mut stream)?;
            stream.flush()
        }
    }
}

/// The same, but a link in the file's place is replaced rather than followed.
///
/// # Errors
/// As [`replace_file_by`].
pub fn replace_link_or_file(path: &Path, readers: Readers, bytes: &[u8]) -> io::Result<()> {
    write_beside_and_rename(path, readers, |file| file.write_all(bytes))
}

/// Makes a folder and those above it, each for its owner alone; those that are there stay as they are.
///
/// # Errors
/// As the file system has it.
pub fn make_private_folder(path: &Path) -> io::Result<()> {
    let mut builder = fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(path)
}

/// Whether a name is that of a file that is being written, or was when its writer was killed.
fn is_unfinished_file_name(name: &OsStr) -> bool {
    let digits = name.to_str().and_then(|name| name.strip_prefix(UNFINISHED.0)?.strip_suffix(UNFINISHED.1));
    digits.is_some_and(|digits| digits.len() == 16 && digits.bytes().all(|digit| digit.is_ascii_hexdigit()))
}

/// [`remove_unfinished`], the first time that this process writes to a folder.
fn remove_unfinished_once(folder: &Path) {
    static SEEN: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    if SEEN.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_owned()) {
        remove_unfinished(folder);
    }
}

/// Removes from a folder what killed writers have left there: unfinished files that nobody has written to for an hour.
pub fn remove_unfinished(folder: &Path) {
    for entry in
        fs::read_dir(folder).into_iter().flatten().flatten().filter(|entry| is_unfinished_file_name(&entry.file_name()))
    {
        let age = entry.metadata().ok().and_then(|known| SystemTime::now().duration_since(known.modified().ok()?).ok());
        if age.is_some_and(|age| age > LEFT_BEHIND) {
            // Another process may have done it.
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// The regular file that a path leads to, which need not be there; `None` if it leads to something that cannot be replaced: a pipe, a device, an open file
/// of a process.
fn find_replaceable_target(path: &Path) -> io::Result<Option<PathBuf>> {
    let mut at = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        if is_path_of_open_descriptor(&at) {
            return Ok(None);
        }
        let kind = match fs::symlink_metadata(&at) {
            Ok(known) => known.file_type(),
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Some(at)),
            Err(error) => return Err(error),
        };
        if kind.is_dir() {
            return Err(ErrorKind::IsADirectory.into());
        }
        if !kind.is_symlink() {
            return Ok(kind.is_file().then_some(at));
        }
        let to = fs::read_link(&at)?;
        at = parent_folder(&at).join(to);
    }
    Err(io::Error::other(format!("the path leads through {MOST_LINKS} or more symbolic links")))
}

/// Whether a path names an open file of a process, as what `/dev/stdout` leads to does. Such a file has been opened by somebody else (a shell, for `>`), who goes on writing to
/// it: it must not be replaced.
fn is_path_of_open_descriptor(path: &Path) -> bool {
    let folder = fs::canonicalize(parent_folder(path));
    folder.is_ok_and(|folder| folder.starts_with("/proc") || folder.starts_with("/dev/fd"))
}

pub(crate) fn parent_folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn write_beside_and_rename(
    target: &Path,
    readers: Readers,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    if target.file_name().is_none() {
        return Err(io::Error::new(ErrorKind::InvalidInput, "the path does not end with the name of a file"));
    }
    // Renaming asks nobody whether the file may be written to.
    let before = match fs::symlink_metadata(target) {
        Ok(known) if known.is_file() => Some(OpenOptions::new().write(true).open(target)?.metadata()?),
        _ => None,
    };
    remove_unfinished_once(parent_folder(target));
    // Random, as processes on other machines and in containers may have the same numbers; no file that is there is taken.
    let number = RandomState::new().hash_one(std::process::id());
    let unfinished = parent_folder(target).join(format!("{}{number:016x}{}", UNFINISHED.0, UNFINISHED.1));
    let mut file = create_unfinished_file(&unfinished, readers == Readers::ByUmask && before.is_none())?;
    let written = set_mode(&file, readers, before.as_ref()).and_then(|()| {
        let mut buffered = BufWriter::new(&mut file);
        write(&mut buffered)?;
        buffered.flush()?;
        drop(buffered);
        file.sync_all()?;
        fs::rename(&unfinished, target)
    });
    if let Err(error) = written {
        // What is there of it is of no use to anybody.
        let _ = fs::remove_file(&unfinished);
        return Err(error);
    }
    sync_folder(parent_folder(target))
}

#[cfg_attr(not(unix), expect(unused_variables, reason = "this system has no file modes"))]
fn create_unfinished_file(path: &Path, is_by_umask: bool) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, if is_by_umask { 0o666 } else { 0o600 });
    options.open(path)
}

/// Gives a file that is new and empty the mode that it is to have, and the owner of the one that it replaces.
#[cfg(unix)]
fn set_mode(file: &File, readers: Readers, before: Option<&Metadata>) -> io::Result<()> {
    use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
    let mode = match (readers, before) {
        (Readers::Owner, _) => 0o600,
        (Readers::Everybody, _) => 0o644,
        (Readers::ByUmask, None) => return Ok(()),
        (Readers::ByUmask, Some(before)) => {
            let own = file.metadata()?;
            if (own.uid(), own.gid()) != (before.uid(), before.gid()) {
                // Only root may give files away; whoever else may write here has the file from now on.
                let _ = fchown(file, Some(before.uid()), Some(before.gid()));
            }
            before.mode() & 0o7777
        }
    };
    file.set_permissions(fs::Permissions::from_mode(mode))
}

#[cfg(not(unix))]
fn set_mode(_: &File, _: Readers, _: Option<&Metadata>) -> io::Result<()> {
    Ok(())
}

/// Forces a folder's names onto the disk, where the file system can.
pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    if !cfg!(unix) {
        return Ok(());
    }
    match File::open(folder).and_then(|folder| folder.sync_all()) {
        // A folder that may be written to and not read; a file system that does not force folders.
        Err(error)
            if matches!(
                error.kind(),
                ErrorKind::PermissionDenied | ErrorKind::InvalidInput | ErrorKind::Unsupported
            ) =>
        {
            Ok(())
        }
        done => done,
    }
}

#[cfg(all(test, unix))]
mod tests;
