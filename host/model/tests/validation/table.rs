//! Published figures beside independent ones and the program's, as the tables of `docs/src/validation.md`.

use era_model::model::{Accuracy, compute_modes_with_error_bounds};
use era_model::scene::Scene;

/// What the program is asked for.
pub const TOLERANCE: f64 = 1e-6;

/// A published case.
pub struct Case {
    /// As on the page.
    pub title: &'static str,
    /// As in the publication, in units of its own.
    pub published: &'static [f64],
    /// From an equation or method of these tests, in the same unit, with how wrong it may be, relative.
    pub reference: Vec<(f64, f64)>,
    /// Hz of the scene per unit of the publication.
    pub hz: f64,
    /// Rigid motions.
    pub rigid: usize,
    /// Largest relative difference between the publication and the reference: its rounding, or what it is wrong by.
    pub publication: f64,
    pub scene: Scene,
}

impl Case {
    /// Computes the case, holds it against both, and returns its table's lines.
    pub fn table(&self) -> Vec<String> {
        let highest = self.reference.iter().map(|(value, _)| value).copied().fold(0.0, f64::max) * self.hz;
        let found =
            compute_modes_with_error_bounds(&self.scene, Accuracy::from_tolerance(TOLERANCE).unwrap(), 1.01 * highest)
                .unwrap();
        let rigid = found.answer.iter().take_while(|mode| mode.frequency_hz == 0.0).count();
        assert_eq!(rigid, self.rigid, "{}: rigid motions", self.title);
        assert_eq!(self.reference.len(), self.published.len(), "{}", self.title);
        let mut lines = vec![
            format!("{}:", self.title),
            "| mode | published | reference | era | era to published |".to_owned(),
            "|---|---|---|---|---|".to_owned(),
        ];
        for (k, (published, (reference, digits))) in self.published.iter().zip(&self.reference).enumerate() {
            let value = found.answer[rigid + k].frequency_hz / self.hz;
            let bound = found.bounds[rigid + k].limit_if_known().unwrap();
            let (to_published, to_reference) = (value / published - 1.0, value / reference - 1.0);
            let name = format!("{}, mode {}", self.title, k + 1);
            assert!(bound <= TOLERANCE, "{name}: the bound is {bound:e}");
            assert!(
                to_reference.abs() <= bound + digits,
                "{name}: {value} is off {reference} by {to_reference:e}; bound {bound:e}, reference known to {digits:e}"
            );
            assert!(
                (published / reference - 1.0).abs() <= self.publication,
                "{name}: published {published}, reference {reference}"
            );
            lines.push(format!(
                "| {} | {published} | {} | {} | {} |",
                k + 1,
                digits_of(*reference),
                digits_of(value),
                percent(to_published, 2),
            ));
        }
        lines
    }
}

/// Six significant digits.
pub fn digits_of(value: f64) -> String {
    let before = 1 + value.abs().max(1e-3).log10().floor().max(0.0) as usize;
    format!("{value:.*}", 6_usize.saturating_sub(before))
}

/// A difference with a sign, in percent; none where nothing is left of it.
pub fn percent(difference: f64, decimals: usize) -> String {
    let text = format!("{:+.decimals$}", 100.0 * difference);
    if text.trim_start_matches(['+', '-']).bytes().all(|byte| matches!(byte, b'0' | b'.')) {
        return "0 %".into();
    }
    format!("{text} %")
}
