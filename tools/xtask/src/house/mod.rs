//! `cargo xtask house`: circles of imports between a crate's files, an error; files that are too long, and files that no `mod` leads to.
//!
//! File A **imports** file B if a path in A's code outside tests, in a `use`, inline, in a macro's or an attribute's tokens, leads
//! to a module in B of the same crate or to something declared there. Re-exports are followed to where a thing is declared;
//! a module that hands on what is not below it counts as imported, too. Not seen: methods and fields, paths in strings
//! and documentation, names that `use a::*` brings and that stand alone, paths that macros make.
//!
//! **Parent and child** may import each other: an import between two files counts for no circle if the module of one file is
//! above that of the other, at any distance. All other imports make a graph, and each of its strongly connected
//! components of more than one file is a **circle**.
//!
//! The folders of the daemon, of the planner and of the studies use each other in one direction ([`order::ORDERS`]); an import against it is an
//! error, too.
//!
//! Why not `cargo modules dependencies --acyclic`: cargo-modules 0.27 looks for circles in the graph of modules *and* items with the
//! edges from parent to child in it, so that it stops at the first `use super::Thing`; and modules that import items of each other
//! are no circle to it (its issue 185). It brings 303 crates, rust-analyzer's among them; this needs `syn` and `proc-macro2`.

mod circles;
mod order;
mod source;
mod survey;
#[cfg(test)]
mod tests;
mod tree;

use crate::error::Error;
use crate::repository_root;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use survey::Survey;

/// The crate that has a workspace of its own.
const APART: &str = "firmware";
/// Folders without sources.
const BUILT: &str = "target";

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
/// [`Error::Circles`] if there is one; [`Error::FolderOrder`]; what cannot be read.
pub fn survey_crates_failing_on_import_cycles_or_folder_order() -> Result<(), Error> {
    let (mut circles, mut breaches) = (0, Vec::new());
    for (name, survey) in survey_each_crate(&repository_root()?)? {
        print!("{}", describe_survey_findings_if_any(&name, &survey));
        circles += survey.circles.len();
        let orders = order::ORDERS.iter().filter(|order| order.crate_name == name);
        breaches.extend(orders.flat_map(|order| order.find_order_breaches(&survey.imports)));
    }
    println!("{circles} circles between files");
    if !breaches.is_empty() {
        return Err(Error::FolderOrder(breaches.join(", ")));
    }
    if circles == 0 { Ok(()) } else { Err(Error::Circles(circles)) }
}

/// Every crate's name and what is found in it.
fn survey_each_crate(root: &Path) -> Result<Vec<(String, Survey)>, Error> {
    let workspace = read_manifest(&root.join("Cargo.toml"))?.workspace;
    let members = workspace.into_iter().flat_map(|workspace| workspace.members).chain([APART.to_owned()]);
    members.map(|member| survey_crate(&root.join(member))).collect()
}

fn survey_crate(folder: &Path) -> Result<(String, Survey), Error> {
    let manifest = read_manifest(&folder.join("Cargo.toml"))?;
    let name = manifest.package.map_or_else(|| folder.display().to_string(), |package| package.name);
    let mut texts = BTreeMap::new();
    read_sources(folder, folder, &mut texts)?;
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

fn read_manifest(path: &Path) -> Result<Manifest, Error> {
    let text = read_text(path)?;
    toml::from_str(&text).map_err(|source| Error::Manifest { path: path.to_path_buf(), source: Box::new(source) })
}

/// Adds the texts of all sources in a folder of a crate.
fn read_sources(crate_folder: &Path, folder: &Path, texts: &mut BTreeMap<PathBuf, String>) -> Result<(), Error> {
    let unreadable = |source| Error::File { what: "cannot read", path: folder.to_path_buf(), source };
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.is_dir() {
            // A folder with a manifest is another crate's.
            if !path.ends_with(BUILT) && !path.join("Cargo.toml").exists() {
                read_sources(crate_folder, &path, texts)?;
            }
        } else if path.extension().is_some_and(|ending| ending == "rs")
            && let Ok(inside) = path.strip_prefix(crate_folder)
        {
            texts.insert(inside.to_path_buf(), read_text(&path)?);
        }
    }
    Ok(())
}

fn read_text(path: &Path) -> Result<String, Error> {
    fs::read_to_string(path).map_err(|source| Error::File { what: "cannot read", path: path.to_path_buf(), source })
}

/// What is printed of a crate: nothing where nothing is wrong.
fn describe_survey_findings_if_any(name: &str, survey: &Survey) -> String {
    let mut lines: Vec<String> =
        survey.long.iter().map(|(file, count)| format!("{name}: {file} has {count} lines, more than 500")).collect();
    lines.extend(survey.lost.iter().map(|file| format!("{name}: no `mod` leads to {file}")));
    for circle in &survey.circles {
        lines.push(format!(
            "{name}: a circle of {} files, each with the files of the circle that it imports:",
            circle.len()
        ));
        for (from, to) in circle {
            let to: Vec<&str> = to.iter().map(String::as_str).collect();
            lines.push(format!("  {from} -> {}", to.join(", ")));
        }
    }
    lines.iter().flat_map(|line| [line, "\n"]).collect()
}
