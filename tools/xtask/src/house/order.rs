//! Folders that use each other in one direction only.

use super::circles::Graph;

/// A folder of `src` whose folders, and files directly in it, use only those that come before them in a list.
#[derive(Clone, Copy, Debug)]
pub struct FolderOrder {
    /// The crate.
    pub crate_name: &'static str,
    /// The folder, with a slash at its end; nothing for `src` itself.
    pub folder: &'static str,
    /// Its folders and files, the most basic first. The folder's own `mod.rs` may use all of them, and be used by all.
    pub entries: &'static [&'static str],
}

/// The daemon of `era-host`; `docs/src/architecture.md` says what each folder is for.
pub const DAEMON: FolderOrder = FolderOrder {
    crate_name: "era-host",
    folder: "daemon/",
    entries: &["api", "access", "touch", "observe", "design", "drive", "app.rs", "live", "http"],
};

/// The planner.
pub const PLANNER: FolderOrder = FolderOrder {
    crate_name: "era-planner",
    folder: "",
    entries: &[
        "millimetres.rs",
        "drive.rs",
        "perception.rs",
        "physics",
        "table",
        "chosen_drive.rs",
        "request",
        "choose",
        "motion",
        "reach",
        "quick",
        "plan",
        "reports",
        "cache",
        "click",
        "effects",
        "maps",
    ],
};

/// The studies.
pub const STUDY: FolderOrder = FolderOrder {
    crate_name: "era-study",
    folder: "",
    entries: &[
        "spec",
        "space",
        "evaluate",
        "methods",
        "bounds.rs",
        "run",
        "result",
        "report",
        "written.rs",
        "tolerances.rs",
    ],
};

/// All orders that are checked.
pub const ORDERS: [FolderOrder; 3] = [DAEMON, PLANNER, STUDY];

impl FolderOrder {
    /// The imports that lead from an entry to a later one, or from or to an entry that has no place in the list, each as `FILE -> FILE`.
    pub fn find_order_breaches(&self, imports: &Graph<String>) -> Vec<String> {
        let edges = imports.iter().flat_map(|(from, to)| to.iter().map(move |to| (from, to)));
        let breach = |(from, to): (&String, &String)| {
            let (from_entry, to_entry) = (
                self.first_path_part_below_folder_unless_mod_or_lib_rs(from)?,
                self.first_path_part_below_folder_unless_mod_or_lib_rs(to)?,
            );
            let place = |entry: &str| self.entries.iter().position(|known| *known == entry);
            let is_allowed = place(from_entry).zip(place(to_entry)).is_some_and(|(from, to)| to <= from);
            (!is_allowed).then(|| format!("{from} -> {to}"))
        };
        edges.filter_map(breach).collect()
    }

    /// The folder or file directly below, in which a file is; `None` for files elsewhere and for the folder's `mod.rs`.
    fn first_path_part_below_folder_unless_mod_or_lib_rs<'f>(&self, file: &'f str) -> Option<&'f str> {
        let entry = file.strip_prefix(self.folder)?.split('/').next()?;
        (entry != "mod.rs" && entry != "lib.rs").then_some(entry)
    }
}
