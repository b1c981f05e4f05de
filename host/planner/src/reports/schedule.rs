//! Targets with time windows: the time is cut wherever a window begins or ends, and each stretch has a plan for the targets
//! that are wanted in it. The stretches are planned each for itself: a target that goes on may change its frequencies where
//! another joins it or leaves, as what is best for both is not what is best for one. Where the same targets are wanted again
//! the plan is the same again.

use crate::plan::Plan;
use crate::reports::report::Times;
use crate::reports::trade::TradeOffs;
use crate::request::{MAX_TARGETS, PlanError, Request, check_range};
use serde::Serialize;

/// Latest end of a window in ms: as long as the board drives in one burst.
pub const MAX_WINDOW_MS: f64 = 10_000.0;
/// Shortest window in ms.
pub const MIN_WINDOW_MS: f64 = 1.0;

/// When a target is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Window {
    /// In ms from the beginning.
    pub from_ms: f64,
    /// In ms from the beginning, later by at least [`MIN_WINDOW_MS`].
    pub to_ms: f64,
}

impl Window {
    /// Whether it lies within 0 to [`MAX_WINDOW_MS`], its end after its beginning.
    ///
    /// # Errors
    /// [`PlanError::Range`] that names `from_ms` or `to_ms`.
    pub fn check_range(&self) -> Result<(), PlanError> {
        check_range("from_ms", self.from_ms, 0.0, MAX_WINDOW_MS - MIN_WINDOW_MS, 1.0)?;
        check_range("to_ms", self.to_ms, self.from_ms + MIN_WINDOW_MS, MAX_WINDOW_MS, 1.0)
    }
}

/// A time in which the same targets are wanted.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Span {
    /// In ms from the beginning.
    pub from_ms: f64,
    /// In ms from the beginning.
    pub to_ms: f64,
    /// The targets, by their numbers from 0; none in a pause.
    pub targets: Vec<usize>,
}

/// The spans of targets with these windows, in order and without a gap from 0 to the last end.
///
/// # Errors
/// [`PlanError::Range`], [`PlanError::Count`].
pub fn cut_windows_into_spans(windows: &[Window]) -> Result<Vec<Span>, PlanError> {
    if windows.is_empty() || windows.len() > MAX_TARGETS {
        return Err(PlanError::Count { count: windows.len() });
    }
    windows.iter().try_for_each(Window::check_range)?;
    let mut borders: Vec<f64> = windows.iter().flat_map(|window| [window.from_ms, window.to_ms]).collect();
    borders.push(0.0);
    borders.sort_by(f64::total_cmp);
    borders.dedup();
    let mut spans: Vec<Span> = Vec::new();
    for pair in borders.windows(2) {
        let [from_ms, to_ms] = [pair[0], pair[1]];
        let is_active = |window: &Window| window.from_ms <= from_ms && window.to_ms >= to_ms;
        let targets: Vec<usize> = (0..windows.len()).filter(|t| is_active(&windows[*t])).collect();
        match spans.last_mut() {
            Some(last) if last.targets == targets => last.to_ms = to_ms,
            _ => spans.push(Span { from_ms, to_ms, targets }),
        }
    }
    Ok(spans)
}

/// A span with its plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Stretch {
    /// When, and for which targets.
    #[serde(flatten)]
    pub span: Span,
    /// The plan for these; `None` in a pause.
    pub plan: Option<Plan>,
    /// When its first target vibrates, and when it has stopped.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(nullable = false))]
    pub times: Option<Times>,
    /// What can be had of it, where it could not be had in full.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(nullable = false))]
    pub trade: Option<TradeOffs>,
}

/// A plan for each span, by `plan_for` (several targets: [`Request::with_selected_targets`]).
///
/// # Errors
/// Those of `plan_for`.
pub fn plan_each_span<E>(
    spans: Vec<Span>,
    mut plan_for: impl FnMut(&[usize]) -> Result<Plan, E>,
) -> Result<Vec<Stretch>, E> {
    spans
        .into_iter()
        .map(|span| {
            let plan = if span.targets.is_empty() { None } else { Some(plan_for(&span.targets)?) };
            Ok(Stretch { span, plan, times: None, trade: None })
        })
        .collect()
}

impl Request {
    /// The same for some of its targets, by their numbers.
    #[must_use]
    pub fn with_selected_targets(&self, target_indices: &[usize]) -> Self {
        let targets = target_indices.iter().filter_map(|t| self.targets.get(*t).copied()).collect();
        Self { targets, ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(from_ms: f64, to_ms: f64) -> Window {
        Window { from_ms, to_ms }
    }

    #[test]
    fn time_is_cut_at_every_border() {
        let found =
            cut_windows_into_spans(&[window(100.0, 400.0), window(200.0, 300.0), window(500.0, 600.0)]).unwrap();
        let span = |from_ms, to_ms, targets: &[usize]| Span { from_ms, to_ms, targets: targets.to_vec() };
        assert_eq!(
            found,
            [
                span(0.0, 100.0, &[]),
                span(100.0, 200.0, &[0]),
                span(200.0, 300.0, &[0, 1]),
                span(300.0, 400.0, &[0]),
                span(400.0, 500.0, &[]),
                span(500.0, 600.0, &[2]),
            ]
        );
        // One that takes over where another ends leaves no pause, and equal windows are one span.
        let found = cut_windows_into_spans(&[window(0.0, 50.0), window(50.0, 80.0), window(50.0, 80.0)]).unwrap();
        assert_eq!(found, [span(0.0, 50.0, &[0]), span(50.0, 80.0, &[1, 2])]);
    }

    #[test]
    fn windows_out_of_range_are_named() {
        for (from_ms, to_ms, field) in [
            (-1.0, 5.0, "from_ms"),
            (f64::NAN, 5.0, "from_ms"),
            (9_999.5, 10_000.0, "from_ms"),
            (5.0, 5.0, "to_ms"),
            (5.0, 10_001.0, "to_ms"),
            (5.0, f64::INFINITY, "to_ms"),
        ] {
            let error = cut_windows_into_spans(&[window(0.0, 10.0), window(from_ms, to_ms)]).unwrap_err();
            assert!(matches!(error, PlanError::Range { field: named, .. } if named == field), "{error}");
        }
        assert_eq!(cut_windows_into_spans(&[]), Err(PlanError::Count { count: 0 }));
        assert!(cut_windows_into_spans(&[window(0.0, 1.0); MAX_TARGETS + 1]).is_err());
    }
}
