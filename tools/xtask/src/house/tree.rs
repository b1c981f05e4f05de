//! The modules of a crate: which files its `mod` declarations lead to, and what a path in one of them names.

use super::source::{Child, ModuleCode};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The code of every file, by its path in the crate's folder.
pub type Sources = BTreeMap<PathBuf, ModuleCode>;

/// A module.
#[derive(Debug)]
pub struct Module<'a> {
    /// Where it is written.
    pub file: &'a Path,
    /// What is written there.
    pub code: &'a ModuleCode,
    /// The module of its file: itself, unless it is written out inside another.
    home: usize,
    parent: Option<usize>,
    children: BTreeMap<&'a str, usize>,
}

/// All modules from one root on, the root first. Modules that are there in tests only are left out.
#[derive(Debug, Default)]
pub struct ModuleTree<'a> {
    /// The modules.
    pub modules: Vec<Module<'a>>,
    /// Files that only tests lead to.
    pub test_files: BTreeSet<&'a Path>,
}

/// What a path leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PathTarget {
    /// A module.
    Module(usize),
    /// Something in a module.
    Item(usize),
}

impl<'a> ModuleTree<'a> {
    /// The modules from `root` on; none if there is no such file.
    pub fn new(sources: &'a Sources, root: &Path) -> Self {
        let mut tree = Self::default();
        if let Some((file, code)) = sources.get_key_value(root) {
            tree.add_module_and_its_children_returning_index(
                sources,
                (file, code),
                None,
                None,
                root.parent().unwrap_or(Path::new("")),
            );
        }
        tree
    }

    /// Adds a module and all below it, whose files are in `folder`.
    fn add_module_and_its_children_returning_index(
        &mut self,
        sources: &'a Sources,
        (file, code): (&'a Path, &'a ModuleCode),
        home: Option<usize>,
        parent: Option<usize>,
        folder: &Path,
    ) -> usize {
        let own = self.modules.len();
        let home = home.unwrap_or(own);
        self.modules.push(Module { file, code, home, parent, children: BTreeMap::new() });
        for child in &code.children {
            let added =
                match (&child.body, find_module_file_its_code_and_folder_of_children(sources, child, file, folder)) {
                    (Some(body), _) => self.add_module_and_its_children_returning_index(
                        sources,
                        (file, body),
                        Some(home),
                        Some(own),
                        &folder.join(&child.name),
                    ),
                    (None, Some((file, code, folder))) if !child.is_test => self
                        .add_module_and_its_children_returning_index(sources, (file, code), None, Some(own), &folder),
                    (None, Some((file, code, folder))) => {
                        self.record_test_file_and_its_children(sources, (file, code), &folder);
                        continue;
                    }
                    (None, None) => continue,
                };
            self.modules[own].children.insert(&child.name, added);
        }
        own
    }

    fn record_test_file_and_its_children(
        &mut self,
        sources: &'a Sources,
        (file, code): (&'a Path, &'a ModuleCode),
        folder: &Path,
    ) {
        self.test_files.insert(file);
        for child in &code.children {
            if let Some((file, code, folder)) =
                find_module_file_its_code_and_folder_of_children(sources, child, file, folder)
            {
                self.record_test_file_and_its_children(sources, (file, code), &folder);
            }
        }
    }

    /// Whether one of two modules is above the other, or both are the same.
    pub fn are_modules_same_or_one_ancestor_of_other(&self, one: usize, other: usize) -> bool {
        self.is_same_or_ancestor(one, other) || self.is_same_or_ancestor(other, one)
    }

    fn is_same_or_ancestor(&self, upper: usize, lower: usize) -> bool {
        std::iter::successors(Some(lower), |module| self.modules[*module].parent).any(|module| module == upper)
    }

    /// The modules whose files the code of `from` imports by a path: the one in which the thing is declared, and those that hand
    /// it on without having it below them.
    pub fn find_top_modules_of_files_declaring_or_reexporting_path(
        &self,
        from: usize,
        path: &[String],
    ) -> BTreeSet<usize> {
        let mut search = PathSearch { tree: self, asked: BTreeSet::new(), handed_on_by: BTreeSet::new() };
        let found = search.resolve_path(from, path);
        let mut all = search.handed_on_by;
        all.extend(found.map(|(PathTarget::Module(module) | PathTarget::Item(module))| module));
        all.into_iter().map(|module| self.modules[module].home).collect()
    }

    /// The module of the file in which a module is written.
    pub fn find_top_module_of_file(&self, module: usize) -> usize {
        self.modules[module].home
    }
}

/// The file of a module, its code, and the folder of the modules in it.
fn find_module_file_its_code_and_folder_of_children<'a>(
    sources: &'a Sources,
    child: &Child,
    parent: &Path,
    folder: &Path,
) -> Option<(&'a Path, &'a ModuleCode, PathBuf)> {
    let beside = |name: &str| (folder.join(name), folder.join(&child.name));
    let candidates = match &child.path {
        Some(path) => {
            let file = parent.parent()?.join(path);
            let folder = file.parent()?.to_path_buf();
            vec![(file, folder)]
        }
        None => vec![beside(&format!("{}.rs", child.name)), beside(&format!("{}/mod.rs", child.name))],
    };
    candidates.into_iter().find_map(|(file, folder)| {
        let (file, code) = sources.get_key_value(&file)?;
        Some((file.as_path(), code, folder))
    })
}

/// One path's search.
struct PathSearch<'t, 'a> {
    tree: &'t ModuleTree<'a>,
    /// Names that are being looked for, as imports may go round in circles.
    asked: BTreeSet<(usize, String)>,
    handed_on_by: BTreeSet<usize>,
}

impl PathSearch<'_, '_> {
    /// What a path names; `None` for what is not of this crate.
    fn resolve_path(&mut self, from: usize, path: &[String]) -> Option<PathTarget> {
        let (first, rest) = path.split_first()?;
        let mut module = match first.as_str() {
            "crate" => 0,
            "self" => from,
            "super" => self.tree.modules[from].parent?,
            name => match self.resolve_name(from, name)? {
                PathTarget::Module(module) => module,
                item @ PathTarget::Item(_) => return Some(item),
            },
        };
        for name in rest {
            module = match (name.as_str(), self.tree.modules[module].parent) {
                ("super", Some(parent)) => parent,
                _ => match self.resolve_name(module, name) {
                    Some(PathTarget::Module(module)) => module,
                    Some(item @ PathTarget::Item(_)) => return Some(item),
                    // Made by a macro, say.
                    None => return Some(PathTarget::Item(module)),
                },
            };
        }
        Some(PathTarget::Module(module))
    }

    /// What a name stands for in a module.
    fn resolve_name(&mut self, module: usize, name: &str) -> Option<PathTarget> {
        let own = &self.tree.modules[module];
        if let Some(child) = own.children.get(name) {
            return Some(PathTarget::Module(*child));
        }
        if own.code.items.contains(name) {
            return Some(PathTarget::Item(module));
        }
        if !self.asked.insert((module, name.to_owned())) {
            return None;
        }
        if let Some(path) = own.code.imports.get(name) {
            // Something of another crate is this module's as far as this crate goes.
            let found = self.resolve_path(module, path).unwrap_or(PathTarget::Item(module));
            return Some(self.note_reexporter_unless_target_below_it_and_return_target(module, found));
        }
        own.code.globs.iter().find_map(|path| match self.resolve_path(module, path)? {
            PathTarget::Module(all) => self
                .resolve_name(all, name)
                .map(|found| self.note_reexporter_unless_target_below_it_and_return_target(module, found)),
            // Of an enum.
            PathTarget::Item(_) => None,
        })
    }

    /// Notes which module handed something on, unless it is from below that module: then this is only its front.
    fn note_reexporter_unless_target_below_it_and_return_target(
        &mut self,
        reexporter: usize,
        found: PathTarget,
    ) -> PathTarget {
        let (PathTarget::Module(module) | PathTarget::Item(module)) = found;
        if !self.tree.is_same_or_ancestor(reexporter, module) {
            self.handed_on_by.insert(reexporter);
        }
        found
    }
}
