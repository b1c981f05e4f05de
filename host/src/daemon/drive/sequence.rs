//! Effect files: all parts are designed at once, and driven one after the other at their times.

use super::active::AskedAt;
use super::driver::TouchDriver;
use super::order::TouchOrder;
use crate::daemon::access::client::Asker;
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::effect_file::{CheckedEffectFile, PlayedEffectFileView};
use crate::device::SessionError;
use crate::effect_files::panel::{PanelEffect, PanelEffectError, design_parts_for_panel};
use crate::effect_files::view::ReadingView;
use crate::effects::DesignError;
use std::sync::{Arc, Weak};
use std::time::Duration;
use tokio::time::Instant;

/// A part that is ready to be driven.
#[derive(Debug)]
struct TimedOrder {
    begin: Duration,
    order: TouchOrder,
}

impl TouchDriver {
    /// Designs all parts of an effect file, begins with the first one, and leaves the others to a task. A stop or a newer touch ends it, and
    /// so does a board that has gone off, faulted or been away.
    ///
    /// # Errors
    /// [`Problem`]; nothing is driven then.
    pub async fn play_effect_file(
        self: &Arc<Self>,
        asker: &Asker,
        id: u64,
        stop_count_at_arrival: u64,
        file: &CheckedEffectFile,
    ) -> Result<PlayedEffectFileView, Problem> {
        if self.is_closing() {
            return Err(SessionError::Closed.into());
        }
        let asked_at =
            AskedAt { stops: stop_count_at_arrival, interruptions: Some(self.count_unrequested_board_interruptions()) };
        let place = self.admission.wait_for_planner_place_unless_queue_full(asker.client).await?;
        self.controller.check_not_superseded(id)?;
        if self.stop_count() != stop_count_at_arrival {
            return Err(SessionError::Stopped.into());
        }
        let (effect, orders) = tokio::task::block_in_place(|| self.prepare_parts(id, asked_at, file))?;
        drop(place);
        let mut orders = orders.into_iter();
        let first = orders.next().ok_or(DesignError::Unbounded)?;
        let device = self.controller.drive_touch_order(first.order).await?.device;
        // From when the first one has begun: it may have waited for the board.
        let start = Instant::now() - first.begin;
        tokio::spawn(drive_orders_at_their_times(Arc::downgrade(self), id, start, orders.collect()));
        Ok(PlayedEffectFileView { reading: ReadingView::new(&file.list, &file.warnings, &effect), plan_id: id, device })
    }

    fn prepare_parts(
        &self,
        id: u64,
        asked_at: AskedAt,
        file: &CheckedEffectFile,
    ) -> Result<(PanelEffect, Vec<TimedOrder>), Problem> {
        let poles = self.table.panel_poles().ok_or(DesignError::Unbounded)?;
        let asked = (file.touched_m, file.asked_g);
        let effect = design_parts_for_panel(&self.table, poles, &file.parts, asked, self.equipment.plays_windows())?;
        let mut orders = Vec::with_capacity(effect.parts.len());
        for part in &effect.parts {
            let Some(place) = effect.places.get(part.place) else { continue };
            let mode = DriveMode::Designed(Arc::new(part.design.clone()));
            let order =
                self.equipment.prepare_touch_order(id, asked_at, place.plan.clone(), vec![file.finger], mode)?;
            let begin = Duration::from_millis(u64::try_from(part.begin_ms).unwrap_or(u64::MAX));
            orders.push(TimedOrder { begin, order });
        }
        Ok((effect, orders))
    }
}

impl From<PanelEffectError> for Problem {
    fn from(error: PanelEffectError) -> Self {
        match error {
            PanelEffectError::Plan(error) => error.into(),
            PanelEffectError::Offset { offset_mm: (dx_mm, _), .. } => Self::new(
                ProblemKind::OutOfRange,
                error.to_string(),
            )
            .with_field_and_value("dx_mm", dx_mm.into(), "a place on the surface".into(), None),
            PanelEffectError::Design(error) => error.into(),
        }
    }
}

/// Holds the daemon only while it drives, so that it can end in between.
async fn drive_orders_at_their_times(driver: Weak<TouchDriver>, id: u64, start: Instant, orders: Vec<TimedOrder>) {
    for TimedOrder { begin, order } in orders {
        tokio::time::sleep_until(start + begin).await;
        let Some(driver) = driver.upgrade() else { return };
        if let Err(problem) = driver.controller.drive_touch_order(order).await {
            tracing::info!(
                plan = id,
                begin_ms = begin.as_secs_f64() * 1e3,
                "this part of the effect and all later parts are not driven: {}",
                problem.detail()
            );
            return;
        }
    }
}
