//! What is in a crate: rooms, constants, long files, circles of imports.

use super::circles::{Graph, circles};
use super::source::Code;
use super::tree::{Sources, Tree};
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Lines of a file from which on it is told.
const LONG: usize = 500;
/// The room of files that are in no folder of `src`.
const ROOT: &str = "(root)";
/// The folder of sources.
const SOURCES: &str = "src";

/// What is in a room.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Room {
    /// Files, those of tests too.
    pub files: usize,
    /// Lines outside tests.
    pub code: usize,
    /// Lines of tests.
    pub tests: usize,
    /// `const` items outside tests.
    pub consts: usize,
    /// Those of them whose name another file of the crate has as well.
    pub shared: usize,
    /// Files above 500 lines.
    pub long: usize,
}

/// What is in a crate.
#[derive(Debug)]
pub struct Survey {
    /// Its rooms.
    pub rooms: BTreeMap<String, Room>,
    /// Names of constants in several files, with these.
    pub shared: BTreeMap<String, BTreeSet<String>>,
    /// Files above 500 lines, and how many they have.
    pub long: BTreeMap<String, usize>,
    /// Files of `src` that no `mod` leads to.
    pub lost: Vec<String>,
    /// Circles of files.
    pub circles: Vec<Graph<String>>,
    /// Circles of rooms; a file in no room stands for itself.
    pub room_circles: Vec<Graph<String>>,
}

impl Survey {
    /// Of a crate's files, by their paths in its folder, and the roots of its targets among these.
    ///
    /// # Errors
    /// The file that is not Rust, and why.
    pub fn new(texts: &BTreeMap<PathBuf, String>, roots: &[PathBuf]) -> Result<Self, (PathBuf, syn::Error)> {
        let mut sources = Sources::new();
        for (file, text) in texts {
            sources.insert(file.clone(), Code::parse(text).map_err(|error| (file.clone(), error))?);
        }
        let trees: Vec<Tree<'_>> = roots.iter().map(|root| Tree::new(&sources, root)).collect();
        let reached: BTreeSet<&Path> = trees.iter().flat_map(|tree| tree.modules.iter().map(|m| m.file)).collect();
        let in_tests: BTreeSet<&Path> = trees.iter().flat_map(|tree| tree.test_files.iter().copied()).collect();
        let is_test = |file: &Path| is_named_as_test(file) || in_tests.contains(file) && !reached.contains(file);

        let mut files_of: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
        for (file, code) in sources.iter().filter(|(file, _)| !is_test(file)) {
            for name in code.consts.iter().filter(|name| *name != "_") {
                files_of.entry(name).or_default().insert(shown(file));
            }
        }
        files_of.retain(|_, files| files.len() > 1);

        let mut tally: BTreeMap<String, Room> = BTreeMap::new();
        let (mut long, mut lost) = (BTreeMap::new(), Vec::new());
        for ((file, text), code) in texts.iter().zip(sources.values()) {
            let lines = text.lines().count();
            let room = tally.entry(room_of(file, texts).unwrap_or_else(|| ROOT.to_owned())).or_default();
            room.files += 1;
            if is_test(file) {
                room.tests += lines;
            } else {
                room.code += lines - code.test_lines;
                room.tests += code.test_lines;
                room.consts += code.consts.len();
                room.shared += code.consts.iter().filter(|name| files_of.contains_key(name.as_str())).count();
            }
            if lines > LONG {
                room.long += 1;
                long.insert(shown(file), lines);
            }
            if file.starts_with(SOURCES) && !reached.contains(file.as_path()) && !in_tests.contains(file.as_path()) {
                lost.push(shown(file));
            }
        }

        let imports = imports(&trees, is_test);
        let (mut of_files, mut of_rooms) = (Graph::new(), Graph::new());
        for (from, to) in imports {
            of_files.entry(shown(from)).or_insert_with(BTreeSet::new).insert(shown(to));
            let of = |file| room_of(file, texts).unwrap_or_else(|| shown(file));
            if of(from) != of(to) {
                of_rooms.entry(of(from)).or_insert_with(BTreeSet::new).insert(of(to));
            }
        }
        let shared = files_of.into_iter().map(|(name, files)| (name.to_owned(), files)).collect();
        Ok(Self { rooms: tally, shared, long, lost, circles: circles(&of_files), room_circles: circles(&of_rooms) })
    }
}

/// Which file imports which, but for modules above or below each other.
fn imports<'a>(trees: &[Tree<'a>], is_test: impl Fn(&Path) -> bool) -> BTreeSet<(&'a Path, &'a Path)> {
    let mut imports = BTreeSet::new();
    for tree in trees {
        for (from, module) in tree.modules.iter().enumerate().filter(|(_, module)| !is_test(module.file)) {
            for to in module.code.named.iter().flat_map(|path| tree.imported(from, path)) {
                if !tree.are_kin(tree.home(from), to) {
                    imports.insert((module.file, tree.modules[to].file));
                }
            }
        }
    }
    imports
}

/// Whether a file is one of tests by its name or its folder.
fn is_named_as_test(file: &Path) -> bool {
    let name = file.file_stem().and_then(OsStr::to_str).unwrap_or_default();
    file.starts_with("tests") || name == "tests" || name.ends_with("_tests")
}

/// The folder directly under `src`, with the file of its name beside it, or another folder of the crate; `None` for files
/// in none.
fn room_of(file: &Path, all: &BTreeMap<PathBuf, String>) -> Option<String> {
    let (inside, base) = match file.strip_prefix(SOURCES) {
        Ok(inside) => (inside, Path::new(SOURCES)),
        Err(_) => (file, Path::new("")),
    };
    let first = inside.iter().next()?.to_str()?;
    if inside.iter().count() > 1 {
        return Some(first.to_owned());
    }
    let folder = base.join(inside.file_stem()?);
    let is_beside = all.keys().any(|other| other.starts_with(&folder));
    is_beside.then(|| inside.file_stem()?.to_str().map(str::to_owned)).flatten()
}

/// A file's path as it is told: in `src` where it is there.
fn shown(file: &Path) -> String {
    file.strip_prefix(SOURCES).unwrap_or(file).display().to_string()
}
