//! What a study leaves in its folder, and what is said of it: the same whoever has computed it.

use crate::report::{report, rounded_up, shown};
use crate::result::{Entry, Finalist, Finals, GatherError, Status, Table, TableError, write_parquet};
use crate::run::{Folder, FolderError, Study};
use crate::space::Refused;
use crate::spec::Figure;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Results that cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// Designs are missing, or the folder cannot be read.
    #[error(transparent)]
    Gather(#[from] GatherError),
    /// A file cannot be written.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// The table is none that Parquet takes.
    #[error(transparent)]
    Table(#[from] TableError),
    /// A finalist is no scene.
    #[error(transparent)]
    Refused(#[from] Refused),
}

/// What has been written.
#[derive(Clone, Debug)]
pub struct Written {
    /// All designs.
    pub table: Table,
    /// The best, computed anew.
    pub finals: Finals,
}

/// Computes the finalists anew and writes `designs.parquet`, `best-1.toml`, ... and `report.html`; `None` if `stops` said so.
///
/// # Errors
/// [`WriteError`].
pub fn write(study: &Study, folder: &Folder, stops: &dyn Fn() -> bool) -> Result<Option<Written>, WriteError> {
    let table = Table::gather(study, folder)?;
    folder.write("designs.parquet", &write_parquet(&table)?)?;
    let Some(finals) = Finals::of(study, &table, stops)? else { return Ok(None) };
    for (number, best) in finals.best.iter().enumerate() {
        folder.write(&format!("best-{}.toml", number + 1), heading(study, best, number + 1).as_bytes())?;
    }
    folder.write("report.html", report(study, &table, &finals).as_bytes())?;
    Ok(Some(Written { table, finals }))
}

/// A finalist's scene, with what it is above it.
fn heading(study: &Study, best: &Finalist, rank: usize) -> String {
    let mut text = format!("# Best {rank} of the study {:?}: design {}.\n", study.spec.name, best.design);
    for (name, value) in figures(study, best) {
        let _ = writeln!(text, "# {name} = {}", shown(value));
    }
    format!("{text}\n{}", best.text)
}

/// The figures of a finalist with the names of their columns; none if it failed.
#[must_use]
pub fn figures(study: &Study, own: &Finalist) -> Vec<(String, f64)> {
    let names = study.figures.iter().map(|wanted| wanted.column());
    let values = own.verified.as_ref().map(|verified| verified.figures.values.clone()).unwrap_or_default();
    names.zip(values).collect()
}

/// Bounds on the relative errors of a finalist's figures with the names of their columns; `None` where none is known.
#[must_use]
pub fn bounds(study: &Study, own: &Finalist) -> Vec<(String, Option<f64>)> {
    let names = study.figures.iter().map(|wanted| wanted.column());
    let bounds = own.verified.as_ref().map(|verified| verified.bounds.as_slice()).unwrap_or_default();
    names.enumerate().map(|(k, name)| (name, bounds.get(k).copied().flatten())).collect()
}

impl Written {
    fn count(&self, status: Status) -> usize {
        self.table.entries.iter().filter(|entry| entry.status == status).count()
    }

    /// What a design's variables are set to.
    fn settings(&self, entry: &Entry) -> String {
        let columns = self.table.columns.iter();
        let values =
            columns.filter_map(|column| Some(format!("{} = {}", column.name, column.text(&entry.row.design)?)));
        values.collect::<Vec<_>>().join(", ")
    }

    /// For programs.
    #[must_use]
    pub fn summary(&self, study: &Study, path: &Path) -> Value {
        let told = |own: &Finalist| {
            let verified = own.verified.as_ref();
            json!({
                "design": own.design,
                "figures": figures(study, own).into_iter().collect::<BTreeMap<_, _>>(),
                "weakest_mm": verified.ok().and_then(|verified| verified.figures.weakest_mm),
                "error_bound": verified.ok().and_then(|verified| verified.bound),
                "error_bounds": bounds(study, own).into_iter().collect::<BTreeMap<_, _>>(),
                "failed": verified.err(),
            })
        };
        let Self { table, finals } = self;
        json!({
            "study": study.spec.name, "folder": path, "designs": table.entries.len(), "kept": self.count(Status::Kept),
            "broken": self.count(Status::Broken), "failed": self.count(Status::Failed),
            "on_front": table.entries.iter().filter(|entry| entry.is_on_front).count(),
            "nearest": table.nearest().map(|(design, entry)| json!({"design": design, "reason": entry.reason})),
            "tolerance": finals.tolerance, "as_it_is": told(&finals.base),
            "best": finals.best.iter().map(told).collect::<Vec<_>>(),
        })
    }

    /// For people.
    #[must_use]
    pub fn text(&self, study: &Study, path: &Path) -> String {
        let Self { table, finals } = self;
        let mut text = format!(
            "{}: {} designs by {}, {} of them within all limits, {} break one, {} failed",
            study.spec.name,
            table.entries.len(),
            study.spec.method.way.name(),
            self.count(Status::Kept),
            self.count(Status::Broken),
            self.count(Status::Failed)
        );
        if study.spec.wishes.len() > 1 {
            let front = table.entries.iter().filter(|entry| entry.is_on_front).count();
            let _ = write!(text, "; {front} on the front");
        }
        let names: Vec<String> = study.figures.iter().map(|wanted| wanted.column()).collect();
        let _ = write!(
            text,
            "\n\n| | design | {} | error at most |\n|---|---|{}---|\n",
            names.join(" | "),
            "---|".repeat(names.len())
        );
        let all = std::iter::once(("as it is".to_owned(), &finals.base));
        for (name, own) in all.chain(finals.best.iter().enumerate().map(|(k, own)| (format!("best {}", k + 1), own))) {
            let cells = match &own.verified {
                Ok(verified) => verified.figures.values.iter().map(|value| shown(*value)).collect(),
                Err(_) => vec!["failed".to_owned(); names.len()],
            };
            let bound = own.verified.as_ref().ok().and_then(|verified| verified.bound);
            let bound = bound.map_or_else(|| "unknown".into(), rounded_up);
            let _ = writeln!(text, "| {name} | {} | {} | {bound} |", own.design, cells.join(" | "));
        }
        let _ = write!(
            text,
            "\n(computed anew with models for a tolerance of {:.0e}; the error is that of the weakest place's peak)\n",
            finals.tolerance
        );
        if let Some(place) = study.figures.iter().position(|wanted| wanted.figure == Figure::SagUm) {
            let told = std::iter::once(&finals.base).chain(&finals.best).filter_map(|own| own.verified.as_ref().ok());
            let bounds: Option<Vec<f64>> = told.map(|found| found.bounds.get(place).copied().flatten()).collect();
            let most = bounds.and_then(|bounds| bounds.into_iter().reduce(f64::max));
            let most =
                most.map_or_else(|| "by an unknown part".into(), |most| format!("by {} at most", rounded_up(most)));
            let _ = writeln!(text, "(sags are off {most})");
        }
        for (k, own) in finals.best.iter().enumerate() {
            let entry = table.entries.get(own.design.saturating_sub(1));
            let _ = write!(text, "\nbest {}: {}", k + 1, entry.map(|entry| self.settings(entry)).unwrap_or_default());
            if let Err(reason) = &own.verified {
                let _ = write!(text, " (failed: {reason})");
            }
        }
        if finals.best.is_empty() {
            text.push_str("\nNo design keeps all limits.");
            if let Some((design, entry)) = table.nearest() {
                let reason = entry.reason.as_deref().unwrap_or_default();
                let _ =
                    write!(text, " Design {design} comes nearest: {reason}\ndesign {design}: {}", self.settings(entry));
            } else if let Some(reason) = table.entries.iter().find_map(|entry| entry.reason.as_ref()) {
                let _ = write!(text, " The first: {reason}");
            }
        }
        let _ = write!(text, "\n\nresults in {}", path.display());
        text
    }
}
