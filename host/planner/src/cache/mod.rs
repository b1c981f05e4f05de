//! Tables kept on disk, so that a program that has seen a scene before plans at once.
//!
//! A file holds the table as plain numbers under a name that is the SHA-256 of all that it follows from ([`Key`]): scene, tolerance,
//! frequencies, the code that computed it. Contents are checked as they come in: header, key, length, hash,
//! sizes, finite numbers, samples computed anew. What fails is told in one line and computed again; a table read is bit for
//! bit the one that was written. A directory that cannot be written to is no error. Files and directory are their owner's alone; what others could have changed is not
//! used.
//!
//! The directory is bounded: [`MOST_FILES`] and [`MOST_BYTES`], of which those go first that have not been used for longest.

#[cfg(test)]
mod code;
#[cfg(test)]
mod code_tests;
mod directory;
mod file;
mod key;
#[cfg(test)]
mod tests;

pub use directory::MOST_FILES;
pub use file::MOST_BYTES;
pub use file::UnusableFile;
pub use key::Key;

use crate::model::bounded::RefinementLevel;
use crate::model::levels::ReducedLevels;
use crate::model::{Accuracy, ModelError};
use crate::response::ResponseError;
use crate::scene::Scene;
use crate::table::stored::StoredTable;
use crate::{PlanTable, TableOptions};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The variable that names the directory.
pub const DIRECTORY_VARIABLE: &str = "ERA_CACHE_DIR";

/// Why there is no table.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// The panel cannot be modelled.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Its response cannot be computed.
    #[error(transparent)]
    Response(#[from] ResponseError),
}

/// Where a table came from, and what that took.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Origin {
    /// It was kept.
    Kept {
        /// To read the file and check its hash.
        read: Duration,
        /// To make a table of it and compare samples.
        restore: Duration,
    },
    /// It was computed.
    Computed {
        /// Meshes, factors, modes of the three levels.
        levels: Duration,
        /// Responses, figures over the surface.
        table: Duration,
        /// To write it down; zero if it was not.
        write: Duration,
    },
}

/// A table, ready for touches.
#[derive(Debug)]
pub struct Prepared {
    /// The table.
    pub table: PlanTable,
    /// The levels of its model, as when they were computed.
    pub steps: Vec<RefinementLevel>,
    /// Where it came from.
    pub origin: Origin,
    /// Its file and that file's size in bytes, if there is one.
    pub kept: Option<(PathBuf, u64)>,
}

/// A directory of tables.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cache {
    directory: PathBuf,
}

impl Cache {
    /// The cache in `directory`, which need not exist yet.
    #[must_use]
    pub fn in_directory(directory: PathBuf) -> Self {
        Self { directory }
    }

    /// The user's cache: `ERA_CACHE_DIR`, or `era` in `XDG_CACHE_HOME`, or `.cache/era` in `HOME`. `None` without any
    /// of them.
    #[must_use]
    pub fn for_user_if_any_variable_set() -> Option<Self> {
        Self::from_environment_variables_if_any(|name| {
            std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from)
        })
    }

    fn from_environment_variables_if_any(variable: impl Fn(&str) -> Option<PathBuf>) -> Option<Self> {
        let of = |name, below: &str| variable(name).filter(|path| path.is_absolute()).map(|path| path.join(below));
        let directory =
            variable(DIRECTORY_VARIABLE).or_else(|| of("XDG_CACHE_HOME", "era")).or_else(|| of("HOME", ".cache/era"));
        directory.map(Self::in_directory)
    }

    /// The file path of a key.
    #[must_use]
    pub fn table_file_path(&self, key: &Key) -> PathBuf {
        self.directory.join(directory::file_name_for_key(key))
    }

    /// The directory.
    #[must_use]
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// The table of a key, if its file exists and is sound. A file that is not sound is reported and ignored.
    fn load_table_and_mark_as_used_if_sound(
        &self,
        key: &Key,
        scene: &Scene,
        accuracy: Accuracy,
        options: TableOptions,
    ) -> Option<Prepared> {
        let path = self.table_file_path(key);
        match load_and_check_table_file(&path, key, scene, accuracy, options) {
            Ok(prepared) => {
                directory::set_modified_time_to_now_if_possible(&path);
                Some(prepared)
            }
            Err(UnusableFile::Missing) => None,
            Err(reason) => {
                tracing::warn!(
                    "the stored plan table {} is not used, so the program computes the table again: {reason}",
                    path.display()
                );
                None
            }
        }
    }

    /// Writes a table to its file; returns the file's size in bytes. A failure is logged at the level debug.
    fn store_table_remove_old_ones_and_return_bytes_if_stored(
        &self,
        key: &Key,
        table: &PlanTable,
        levels: &[RefinementLevel],
    ) -> Option<u64> {
        let bytes = file::encode_table(key, &StoredTable::new(table, levels)?);
        let written = bytes.and_then(|bytes| {
            directory::write_private_file_making_directory(&self.table_file_path(key), &bytes)?;
            Ok(bytes.len() as u64)
        });
        match written {
            Ok(size) => {
                directory::remove_unfinished_files_and_least_recently_used_tables(
                    &self.directory,
                    MOST_FILES,
                    MOST_BYTES,
                );
                Some(size)
            }
            Err(reason) => {
                tracing::debug!("cannot store the table in {}: {reason}", self.table_file_path(key).display());
                None
            }
        }
    }
}

fn load_and_check_table_file(
    path: &Path,
    key: &Key,
    scene: &Scene,
    accuracy: Accuracy,
    options: TableOptions,
) -> Result<Prepared, UnusableFile> {
    let started = Instant::now();
    path.parent().map_or(Ok(()), directory::check_directory_owned_and_writable_only_by_user_if_it_exists)?;
    let bytes = file::read_file_checking_owner_and_size_limit(path)?;
    let stored = file::decode_table(key, &bytes)?;
    let read = started.elapsed();
    let (table, steps) = stored.recompute_table_and_fill_in_stored_parts_if_plausible(scene, accuracy, options)?;
    let origin = Origin::Kept { read, restore: started.elapsed().saturating_sub(read) };
    Ok(Prepared { table, steps, origin, kept: Some((path.to_path_buf(), bytes.len() as u64)) })
}

/// Whether `cache` has a file for the table. Whether the file is sound shows only when it is read.
#[must_use]
pub fn has_table_file(cache: Option<&Cache>, scene: &Scene, accuracy: Accuracy, options: TableOptions) -> bool {
    let key = cache.and_then(|cache| Some(cache.table_file_path(&Key::new(scene, accuracy, options)?)));
    key.is_some_and(|path| path.exists())
}

/// The table of a scene: read from `cache` if it has one, otherwise computed and stored there.
///
/// # Errors
/// [`PrepareError`], from the computation alone.
pub fn prepare_table(
    cache: Option<&Cache>,
    scene: &Scene,
    accuracy: Accuracy,
    options: TableOptions,
) -> Result<Prepared, PrepareError> {
    let keyed = cache.and_then(|cache| Some((cache, Key::new(scene, accuracy, options)?)));
    if let Some(prepared) = keyed
        .as_ref()
        .and_then(|(cache, key)| cache.load_table_and_mark_as_used_if_sound(key, scene, accuracy, options))
    {
        return Ok(prepared);
    }
    let started = Instant::now();
    let levels = ReducedLevels::build(scene, accuracy, options.to_hz)?;
    let steps = levels.steps.clone();
    let of_levels = started.elapsed();
    let table = PlanTable::from_levels(scene, levels, options)?;
    let of_table = started.elapsed().saturating_sub(of_levels);
    let size = keyed
        .as_ref()
        .and_then(|(cache, key)| cache.store_table_remove_old_ones_and_return_bytes_if_stored(key, &table, &steps));
    let write = if size.is_some() { started.elapsed().saturating_sub(of_levels + of_table) } else { Duration::ZERO };
    let kept = keyed.zip(size).map(|((cache, key), size)| (cache.table_file_path(&key), size));
    Ok(Prepared { table, steps, origin: Origin::Computed { levels: of_levels, table: of_table, write }, kept })
}
