//! Folders that use each other in one direction only.

use super::circles::Graph;

/// A folder of `src` whose folders, and files directly in it, use only those that come before them in a list.
#[derive(Clone, Copy, Debug)]
pub struct Order {
    /// The folder, with a slash at its end.
    folder: &'static str,
    /// Its folders and files, the most basic first. The folder's own `mod.rs` may use all of them, and be used by all.
    rooms: &'static [&'static str],
}

/// The daemon of `era-host`; `docs/src/architecture.md` says what each folder is for.
pub const DAEMON: Order = Order {
    folder: "daemon/",
    rooms: &["api", "access", "touch", "observe", "design", "drive", "app.rs", "live", "http"],
};

impl Order {
    /// The imports that lead from a room to a later one, or from or to a room that has no place in the list, each as `FILE -> FILE`.
    pub fn find_breaches(&self, imports: &Graph<String>) -> Vec<String> {
        let edges = imports.iter().flat_map(|(from, to)| to.iter().map(move |to| (from, to)));
        let breach = |(from, to): (&String, &String)| {
            let (from_room, to_room) = (self.room_of(from)?, self.room_of(to)?);
            let place = |room: &str| self.rooms.iter().position(|known| *known == room);
            let is_allowed = place(from_room).zip(place(to_room)).is_some_and(|(from, to)| to <= from);
            (!is_allowed).then(|| format!("{from} -> {to}"))
        };
        edges.filter_map(breach).collect()
    }

    /// The folder or file directly below, in which a file is; `None` for files elsewhere and for the folder's `mod.rs`.
    fn room_of<'f>(&self, file: &'f str) -> Option<&'f str> {
        let room = file.strip_prefix(self.folder)?.split('/').next()?;
        (room != "mod.rs").then_some(room)
    }
}
