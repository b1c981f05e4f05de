//! How this workspace's programs write and trust files.
//!
//! A file that is replaced ([`replace_file`], [`replace_file_by`]) holds its old content or all of the new one, whatever happens
//! meanwhile: a full disk, a limit of file sizes, a kill, a power loss. It is written under another name in the same folder, forced onto
//! the disk and renamed, and the folder is forced onto the disk after it. What a killed writer has left is removed when an hour has gone by and
//! somebody writes to the folder. A file that grows ([`AppendedFile`]) holds whole records from its beginning on.
//! What only its owner may change is checked by [`read_own_file`] and [`check_own_folder`].

mod appended;
mod own;
mod replaced;
mod size_limit;

pub use appended::{AppendedFile, has_no_records};
pub use own::{NotOwn, check_own_folder, read_own_file};
pub use replaced::{
    Readers, make_private_folder, remove_unfinished, replace_file, replace_file_by, replace_link_or_file,
};
pub use size_limit::tell_size_limit_as_error;
