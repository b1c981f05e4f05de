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
pub enum Unusable {
    /// There is none, which is no mistake.
    #[error("there is no such file")]
    Missing,
    /// It cannot be read or written.
    #[error("{0}")]
    Io(io::Error),
    /// It is larger than any that is kept.
    #[error("{0} bytes are more than the {MOST_BYTES} that are kept")]
    TooLarge(u64),
    /// Others may have written it.
    #[error("others may have changed it: {0}")]
    NotOwn(NotOwn),
    /// Others may have put files into its directory.
    #[error("others may have changed it: {}: {reason}; or name another directory in ERA_CACHE_DIR", path.display())]
    Directory {
        /// The directory.
        path: PathBuf,
        /// Why.
        reason: NotOwn,
    },
    /// It is not such a file, or cut off before the table.
    #[error("it does not begin as a kept table does")]
    Header,
    /// Of another version.
    #[error("its format is {0}, this program's {FORMAT}")]
    Format(u32),
    /// Of another scene, tolerance or program.
    #[error("it belongs to another scene, tolerance or version")]
    Key,
    /// Cut off, or with something behind it.
    #[error("it holds {found} bytes of {said}")]
    Length {
        /// According to its header.
        said: u64,
        /// After the header.
        found: u64,
    },
    /// Changed since it was written.
    #[error("it has changed since it was written (SHA-256)")]
    Hash,
    /// Its hash is right but its contents are none.
    #[error("it cannot be decoded: {0}")]
    Decode(postcard::Error),
    /// Its contents cannot be right.
    #[error(transparent)]
    Implausible(#[from] ImplausibleStore),
}

impl From<io::Error> for Unusable {
    fn from(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::NotFound { Self::Missing } else { Self::Io(error) }
    }
}

/// The file's bytes.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, Unusable> {
    read_own_file(path, MOST_BYTES).map_err(|reason| match reason {
        NotOwn::Io(error) => error.into(),
        NotOwn::TooLarge { bytes, .. } => Unusable::TooLarge(bytes),
        reason => Unusable::NotOwn(reason),
    })
}

/// The file's bytes for a table.
pub(super) fn encode(key: &Key, table: &StoredTable) -> Result<Vec<u8>, Unusable> {
    let mut bytes = postcard::to_extend(table, vec![0; HEADER]).map_err(Unusable::Decode)?;
    seal(key, &mut bytes);
    if bytes.len() as u64 > MOST_BYTES { Err(Unusable::TooLarge(bytes.len() as u64)) } else { Ok(bytes) }
}

/// Fills in the header of a file whose table follows it.
pub(super) fn seal(key: &Key, bytes: &mut [u8]) {
    let Some((header, table)) = bytes.split_at_mut_checked(HEADER) else { return };
    let fields: [&[u8]; 5] =
        [MAGIC, &FORMAT.to_le_bytes(), &key.0, &(table.len() as u64).to_le_bytes(), &Sha256::digest(&*table)];
    header.iter_mut().zip(fields.concat()).for_each(|(to, from)| *to = from);
}

/// The table of a file, if everything in its header is right.
pub(super) fn decode(key: &Key, bytes: &[u8]) -> Result<StoredTable, Unusable> {
    let (magic, rest) = bytes.split_first_chunk::<8>().ok_or(Unusable::Header)?;
    let (format, rest) = rest.split_first_chunk::<4>().ok_or(Unusable::Header)?;
    let (own, rest) = rest.split_first_chunk::<32>().ok_or(Unusable::Header)?;
    let (said, rest) = rest.split_first_chunk::<8>().ok_or(Unusable::Header)?;
    let (hash, table) = rest.split_first_chunk::<32>().ok_or(Unusable::Header)?;
    let (format, said, found) = (u32::from_le_bytes(*format), u64::from_le_bytes(*said), table.len() as u64);
    if magic != MAGIC {
        return Err(Unusable::Header);
    }
    if format != FORMAT {
        return Err(Unusable::Format(format));
    }
    if *own != key.0 {
        return Err(Unusable::Key);
    }
    if said != found {
        return Err(Unusable::Length { said, found });
    }
    if hash[..] != Sha256::digest(table)[..] {
        return Err(Unusable::Hash);
    }
    let (stored, left) = postcard::take_from_bytes(table).map_err(Unusable::Decode)?;
    if left.is_empty() { Ok(stored) } else { Err(Unusable::Length { said: said - left.len() as u64, found }) }
}
