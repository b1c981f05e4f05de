//! What is found in a crate: circles of imports, long files, files that no `mod` leads to.

use super::circles::{Graph, find_strongly_connected_components_of_several_nodes};
use super::source::ModuleCode;
use super::tree::{ModuleTree, Sources};
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Lines from which on a file is listed as too long.
const LONG: usize = 500;
/// The folder of sources.
const SOURCES: &str = "src";

/// What is found in a crate.
#[derive(Debug)]
pub struct Survey {
    /// Which files import which, but for modules above or below each other.
    pub imports: Graph<String>,
    /// Circles of files.
    pub circles: Vec<Graph<String>>,
    /// Files above 500 lines, and how many they have.
    pub long: BTreeMap<String, usize>,
    /// Files of `src` that no `mod` leads to.
    pub lost: Vec<String>,
}

impl Survey {
    /// Surveys a crate's files, by their paths in its folder, from the roots of its targets on.
    ///
    /// # Errors
    /// The file that is not Rust, and why.
    pub fn new(texts: &BTreeMap<PathBuf, String>, roots: &[PathBuf]) -> Result<Self, (PathBuf, syn::Error)> {
        let mut sources = Sources::new();
        for (file, text) in texts {
            sources.insert(file.clone(), ModuleCode::parse(text).map_err(|error| (file.clone(), error))?);
        }
        let trees: Vec<ModuleTree<'_>> = roots.iter().map(|root| ModuleTree::new(&sources, root)).collect();
        let reached: BTreeSet<&Path> = trees.iter().flat_map(|tree| tree.modules.iter().map(|m| m.file)).collect();
        let in_tests: BTreeSet<&Path> = trees.iter().flat_map(|tree| tree.test_files.iter().copied()).collect();
        let is_test = |file: &Path| {
            is_in_tests_folder_or_named_as_test(file) || in_tests.contains(file) && !reached.contains(file)
        };
        let is_lost = |file: &Path| file.starts_with(SOURCES) && !reached.contains(file) && !in_tests.contains(file);
        let lost = sources
            .keys()
            .filter(|file| is_lost(file))
            .map(|file| format_path_relative_to_src_if_inside(file))
            .collect();
        let lengths =
            texts.iter().map(|(file, text)| (format_path_relative_to_src_if_inside(file), text.lines().count()));
        let long = lengths.filter(|(_, lines)| *lines > LONG).collect();
        let mut graph = Graph::new();
        for (from, to) in find_imports_between_files_unless_one_contains_other(&trees, is_test) {
            graph
                .entry(format_path_relative_to_src_if_inside(from))
                .or_insert_with(BTreeSet::new)
                .insert(format_path_relative_to_src_if_inside(to));
        }
        Ok(Self { circles: find_strongly_connected_components_of_several_nodes(&graph), imports: graph, long, lost })
    }
}

/// Which file imports which, but for modules above or below each other.
fn find_imports_between_files_unless_one_contains_other<'a>(
    trees: &[ModuleTree<'a>],
    is_importer_left_out: impl Fn(&Path) -> bool,
) -> BTreeSet<(&'a Path, &'a Path)> {
    let mut imports = BTreeSet::new();
    for tree in trees {
        for (from, module) in tree.modules.iter().enumerate().filter(|(_, module)| !is_importer_left_out(module.file)) {
            for to in module
                .code
                .named
                .iter()
                .flat_map(|path| tree.find_top_modules_of_files_declaring_or_reexporting_path(from, path))
            {
                if !tree.are_modules_same_or_one_ancestor_of_other(tree.find_top_module_of_file(from), to) {
                    imports.insert((module.file, tree.modules[to].file));
                }
            }
        }
    }
    imports
}

/// Whether a file is one of tests by its name or its folder.
fn is_in_tests_folder_or_named_as_test(file: &Path) -> bool {
    let name = file.file_stem().and_then(OsStr::to_str).unwrap_or_default();
    file.starts_with("tests") || name == "tests" || name.ends_with("_tests")
}

/// A file's path for people: in `src` where it is there.
fn format_path_relative_to_src_if_inside(file: &Path) -> String {
    file.strip_prefix(SOURCES).unwrap_or(file).display().to_string()
}
