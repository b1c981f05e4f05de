//! What a study's file asks for that shows only with its scene and its variables: told with its lines, before anything is computed.

use crate::spec::{MOST_DESIGNS, Spec, Way};
use era_model::scene::SceneError;
use era_model::scene::read::{self, Report, Section};

/// Whether a study of so many designs can be computed; `source` and `text` are its file's.
///
/// # Errors
/// [`SceneError`] with every mistake found.
pub(super) fn check(spec: &Spec, designs: usize, source: &str, text: &str) -> Result<(), SceneError> {
    let document = read::document(source, text)?;
    let report = Report::new(text);
    {
        let file = Section::new(&report, document.get_ref(), String::new(), 0..0);
        if let Some(method) = file.table("method") {
            grid(&method, spec, designs);
        }
    }
    report.finish(source)
}

/// A grid has as many designs as it has: no more than may be asked for by number.
fn grid(method: &Section<'_, '_>, spec: &Spec, designs: usize) {
    if spec.method.way != Way::Grid || designs <= MOST_DESIGNS as usize {
        return;
    }
    // What cannot be counted is the largest number.
    let count = if designs == usize::MAX { "more than can be counted".to_owned() } else { designs.to_string() };
    let text = format!(
        "method.levels is {}: with the levels and steps of the variables that makes {count} designs, but there may be at most {MOST_DESIGNS}",
        spec.method.levels
    );
    method.report().add(&method.place("levels"), text);
}
