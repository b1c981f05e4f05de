//! A table's file: a header, and the table as `postcard` writes it.
//!
//! ```text
//! 0   8 bytes   "era-plan"
//! 8   4 bytes   version of this format, little-endian as all numbers
//! 12  32 bytes  key
//! 44  8 bytes   length of what follows the header
//! 52  32 bytes  SHA-256 of it
//! 84  ...       the table
//! ```

use super::Key;
use super::key::FORMAT;
use crate::model::stored::ImplausibleStore;
use crate::table::stored::StoredTable;
use era_files::{NotOwn, read_own_file};
use sha2::{Digest, Sha256};
use std::io;
use std::path::{Path, PathBuf};

/// Most bytes that are kept, in one file or all of them.
pub const MOST_BYTES: u64 = 256 << 20;
const MAGIC: &[u8; 8] = b"era-plan";
/// Bytes before the table.
const HEADER: usize = 8 + 4 + 32 + 8 + 32;

/// Why a file is not used.
#[derive(Debug, thiserror::Error)]
pub enum UnusableFile {
    /// There is none, which is no mistake.
    #[error("the file does not exist")]
    Missing,
    /// It cannot be read or written.
    #[error("{0}")]
    Io(io::Error),
    /// It is larger than any that is kept.
    #[error("the table has {0} bytes, but may have at most {MOST_BYTES} bytes")]
    TooLarge(u64),
    /// Others may have written it.
    #[error("the file is not trusted, because {0}")]
    NotOwn(NotOwn),
    /// Others may have put files into its directory.
    #[error(
        "other users may have changed the file, because its directory {} is not protected: {reason}. Correct the owner \
         and the mode of the directory, or set ERA_CACHE_DIR to another directory",
        path.display()
    )]
    Directory {
        /// The directory.
        path: PathBuf,
        /// Why.
        reason: NotOwn,
    },
    /// It is not such a file, or cut off before the table.
    #[error("the file does not begin with the header of a stored table")]
    Header,
    /// Of another version.
    #[error("the file has the format {0}, but this program reads the format {FORMAT}")]
    Format(u32),
    /// Of another scene, tolerance or program.
    #[error("the file belongs to another scene, another tolerance or another version of the program")]
    Key,
    /// Cut off, or with something behind it.
    #[error("the table in the file has {found} bytes, but the header of the file states {said} bytes")]
    Length {
        /// According to its header.
        said: u64,
        /// After the header.
        found: u64,
    },
    /// Changed since it was written.
    #[error("the file has changed since it was written (its SHA-256 hash differs)")]
    Hash,
    /// Its hash is right but its contents are none.
    #[error("the file cannot be decoded: {0}")]
    Decode(postcard::Error),
    /// Its contents cannot be right.
    #[error(transparent)]
    Implausible(#[from] ImplausibleStore),
}

impl From<io::Error> for UnusableFile {
    fn from(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::NotFound { Self::Missing } else { Self::Io(error) }
    }
}

/// The file's bytes.
pub(super) fn read_file_checking_owner_and_size_limit(path: &Path) -> Result<Vec<u8>, UnusableFile> {
    read_own_file(path, MOST_BYTES).map_err(|reason| match reason {
        NotOwn::Io(error) => error.into(),
        NotOwn::TooLarge { bytes, .. } => UnusableFile::TooLarge(bytes),
        reason => UnusableFile::NotOwn(reason),
    })
}

/// The file's bytes for a table.
pub(super) fn encode_table(key: &Key, table: &StoredTable) -> Result<Vec<u8>, UnusableFile> {
    let mut bytes = postcard::to_extend(table, vec![0; HEADER]).map_err(UnusableFile::Decode)?;
    fill_in_file_header(key, &mut bytes);
    if bytes.len() as u64 > MOST_BYTES { Err(UnusableFile::TooLarge(bytes.len() as u64)) } else { Ok(bytes) }
}

/// Fills in the header of a file whose table follows it.
pub(super) fn fill_in_file_header(key: &Key, bytes: &mut [u8]) {
    let Some((header, table)) = bytes.split_at_mut_checked(HEADER) else { return };
    let fields: [&[u8]; 5] =
        [MAGIC, &FORMAT.to_le_bytes(), &key.0, &(table.len() as u64).to_le_bytes(), &Sha256::digest(&*table)];
    header.iter_mut().zip(fields.concat()).for_each(|(to, from)| *to = from);
}

/// The table of a file, if everything in its header is right.
pub(super) fn decode_table(key: &Key, bytes: &[u8]) -> Result<StoredTable, UnusableFile> {
    let (magic, rest) = bytes.split_first_chunk::<8>().ok_or(UnusableFile::Header)?;
    let (format, rest) = rest.split_first_chunk::<4>().ok_or(UnusableFile::Header)?;
    let (own, rest) = rest.split_first_chunk::<32>().ok_or(UnusableFile::Header)?;
    let (said, rest) = rest.split_first_chunk::<8>().ok_or(UnusableFile::Header)?;
    let (hash, table) = rest.split_first_chunk::<32>().ok_or(UnusableFile::Header)?;
    let (format, said, found) = (u32::from_le_bytes(*format), u64::from_le_bytes(*said), table.len() as u64);
    if magic != MAGIC {
        return Err(UnusableFile::Header);
    }
    if format != FORMAT {
        return Err(UnusableFile::Format(format));
    }
    if *own != key.0 {
        return Err(UnusableFile::Key);
    }
    if said != found {
        return Err(UnusableFile::Length { said, found });
    }
    if hash[..] != Sha256::digest(table)[..] {
        return Err(UnusableFile::Hash);
    }
    let (stored, left) = postcard::take_from_bytes(table).map_err(UnusableFile::Decode)?;
    if left.is_empty() { Ok(stored) } else { Err(UnusableFile::Length { said: said - left.len() as u64, found }) }
}
