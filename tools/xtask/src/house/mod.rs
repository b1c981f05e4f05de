//! `cargo xtask house`: how each crate is divided, and circles of imports between its files.
//!
//! A **room** is a folder directly under a crate's `src`, with the file of its name beside it. Lines of tests are those of files
//! that only `#[cfg(test)]` leads to, that are called `tests.rs` or `*_tests.rs` or are in `tests/`, and of `#[cfg(test)]` modules
//! that are written out. The rest is code: empty lines and comments too. Constants are `const` items, associated ones left out.
//!
//! File A **imports** file B if a path in A's code outside tests, in a `use`, inline, in a macro's or an attribute's tokens, leads
//! to a module in B of the same crate or to something declared there. Re-exports are followed to where a thing is declared;
//! a module that hands on what is not below it counts as imported, too. Not seen: methods and fields, paths in strings
//! and documentation, names that `use a::*` brings and that stand alone, paths that macros make.
//!
//! **Parent and child** may import each other: an import between two files counts for no circle if the module of one file is
//! above that of the other, at any distance. All other imports make a graph, and each of its strongly connected
//! components of more than one file is a **circle**, an error. Circles of rooms are those of the same imports between files of
//! different rooms (files in none stand for themselves); they are told, not judged.

mod circles;
mod source;
mod survey;
#[cfg(test)]
mod tests;
mod tree;

use crate::error::Error;
use crate::root;
use circles::Graph;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use survey::Survey;

/// The crate that has a workspace of its own.
const APART: &str = "firmware";
/// Folders without sources.
const BUILT: &str = "target";

/// Options of `cargo xtask house`.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub struct Options {
    /// Print circles between files, but do not fail for them
    #[arg(long)]
    allow_circles: bool,
}

/// What is read of a crate's manifest, or of a workspace's.
#[derive(Debug, Default, Deserialize)]
struct Manifest {
    workspace: Option<Workspace>,
    package: Option<Package>,
    lib: Option<Target>,
    #[serde(default)]
    bin: Vec<Target>,
}

#[derive(Debug, Deserialize)]
struct Workspace {
    #[serde(default)]
    members: Vec<String>,
}

#[derive(Debug, Deserialize)]
struct Package {
    name: String,
}

#[derive(Debug, Deserialize)]
struct Target {
    path: Option<PathBuf>,
}

/// Surveys every crate and prints what it finds.
///
/// # Errors
/// [`Error::Circles`] if there is one between files, unless that is allowed; what cannot be read.
pub fn command(options: Options) -> Result<(), Error> {
    let mut circles = 0;
    for (name, survey) in crates(&root()?)? {
        print!("{}", text(&name, &survey));
        circles += survey.circles.len();
    }
    println!("{circles} circles between files");
    judge(circles, options)
}

fn judge(circles: usize, options: Options) -> Result<(), Error> {
    if circles == 0 || options.allow_circles { Ok(()) } else { Err(Error::Circles(circles)) }
}

/// Every crate's name and what is in it.
fn crates(root: &Path) -> Result<Vec<(String, Survey)>, Error> {
    let workspace = manifest(&root.join("Cargo.toml"))?.workspace;
    let members = workspace.into_iter().flat_map(|workspace| workspace.members).chain([APART.to_owned()]);
    members.map(|member| surveyed(&root.join(member))).collect()
}

fn surveyed(folder: &Path) -> Result<(String, Survey), Error> {
    let manifest = manifest(&folder.join("Cargo.toml"))?;
    let name = manifest.package.map_or_else(|| folder.display().to_string(), |package| package.name);
    let mut texts = BTreeMap::new();
    read(folder, folder, &mut texts)?;
    let named = manifest.lib.into_iter().chain(manifest.bin).filter_map(|target| target.path);
    // Where Cargo looks by itself.
    let usual = ["src/lib.rs", "src/main.rs", "build.rs"].map(PathBuf::from);
    let mut roots: Vec<PathBuf> = usual.into_iter().chain(named).collect();
    roots.extend(texts.keys().filter(|file| file.starts_with("src/bin")).cloned());
    roots.retain(|file| texts.contains_key(file));
    roots.sort();
    roots.dedup();
    let survey = Survey::new(&texts, &roots);
    Ok((name, survey.map_err(|(file, source)| Error::Source { path: folder.join(file), source })?))
}

fn manifest(path: &Path) -> Result<Manifest, Error> {
    let text = read_text(path)?;
    toml::from_str(&text).map_err(|source| Error::Manifest { path: path.to_path_buf(), source: Box::new(source) })
}

/// Adds the texts of all sources in a folder of a crate.
fn read(top: &Path, folder: &Path, texts: &mut BTreeMap<PathBuf, String>) -> Result<(), Error> {
    let unreadable = |source| Error::File { what: "cannot read", path: folder.to_path_buf(), source };
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.is_dir() {
            // A folder with a manifest is another crate's.
            if !path.ends_with(BUILT) && !path.join("Cargo.toml").exists() {
                read(top, &path, texts)?;
            }
        } else if path.extension().is_some_and(|ending| ending == "rs")
            && let Ok(inside) = path.strip_prefix(top)
        {
            texts.insert(inside.to_path_buf(), read_text(&path)?);
        }
    }
    Ok(())
}

fn read_text(path: &Path) -> Result<String, Error> {
    fs::read_to_string(path).map_err(|source| Error::File { what: "cannot read", path: path.to_path_buf(), source })
}

/// What is printed of a crate.
fn text(name: &str, survey: &Survey) -> String {
    let mut lines = vec![
        name.to_owned(),
        format!(
            "  {:<14}{:>7}{:>8}{:>8}{:>8}{:>14}{:>12}",
            "room", "files", "code", "tests", "consts", "in >1 file", ">500 lines"
        ),
    ];
    for (name, room) in &survey.rooms {
        lines.push(format!(
            "  {name:<14}{:>7}{:>8}{:>8}{:>8}{:>14}{:>12}",
            room.files, room.code, room.tests, room.consts, room.shared, room.long
        ));
    }
    lines.extend(survey.long.iter().map(|(file, count)| format!("  long: {file}, {count} lines")));
    lines.extend(survey.lost.iter().map(|file| format!("  no `mod` leads to {file}")));
    for (name, files) in &survey.shared {
        let files: Vec<&str> = files.iter().map(String::as_str).collect();
        lines.push(format!("  const {name} in {} files: {}", files.len(), files.join(", ")));
    }
    told(&mut lines, "files", &survey.circles);
    told(&mut lines, "rooms", &survey.room_circles);
    lines.join("\n") + "\n\n"
}

fn told(lines: &mut Vec<String>, what: &str, circles: &[Graph<String>]) {
    if circles.is_empty() {
        lines.push(format!("  no circle of {what}"));
    }
    for circle in circles {
        lines.push(format!("  a circle of {} {what}, each with those of it that it imports:", circle.len()));
        for (from, to) in circle {
            let to: Vec<&str> = to.iter().map(String::as_str).collect();
            lines.push(format!("    {from} -> {}", to.join(", ")));
        }
    }
}
