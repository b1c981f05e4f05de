//! Effect files: all parts are designed at once, and driven one after the other at their times.

use super::driver::TouchDriver;
use super::equipment::DriveEquipment;
use super::order::TouchOrder;
use crate::daemon::access::client::Asker;
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::daemon::design::low_priority::{Deadline, run_low_priority_until_deadline};
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::effect_file::{CheckedEffectFile, PlayedEffectFileView};
use crate::device::{AskedAt, SessionError};
use crate::effect_files::panel::{PanelEffect, PanelEffectError, PartDesigner};
use crate::effect_files::view::ReadingView;
use crate::effects::DesignError;
use crate::planner::PlanTable;
use era_shared::limits::RAIL_SLOPE_MILLIVOLTS_PER_MS;
use era_shared::supply::RAILS;
use std::sync::{Arc, Weak};
use std::time::Duration;
use tokio::time::Instant;

/// Longest time in which a file is read and its parts are designed: a hundred parts at places of their own take some 3 s.
const LONGEST: Duration = Duration::from_secs(10);

/// Before its start a part is sent so long, beside the time in which its rails rise: they settle for 10 ms, or fall for 13 ms, and the link takes some
/// ms.
const AHEAD: Duration = Duration::from_millis(20);

/// A part that is ready to be driven.
#[derive(Debug)]
struct TimedOrder {
    /// When it begins, from the start of the effect; of later parts, from the begin of the first one.
    begin: Duration,
    /// How long its rails rise from the voltages of the part before.
    rise: Duration,
    order: TouchOrder,
}

impl TouchDriver {
    /// Reads an effect file with `read_file` and designs all of its parts, on a thread of low priority and in a slot of the client.
    /// Then drives the first part, and leaves the others to a task. A stop, a newer touch, or a board that has gone off, faulted or
    /// been away ends the effect.
    ///
    /// # Errors
    /// [`Problem`]; nothing is driven then.
    pub async fn design_effect_file_and_begin_to_play_it(
        self: &Arc<Self>,
        asker: &Asker,
        id: u64,
        stop_count_at_arrival: u64,
        read_file: impl FnOnce() -> Result<CheckedEffectFile, Problem> + Send + 'static,
    ) -> Result<PlayedEffectFileView, Problem> {
        if self.is_closing() {
            return Err(SessionError::Closed.into());
        }
        let asked_at = AskedAt {
            stops: stop_count_at_arrival,
            interruptions: Some(self.count_unrequested_disarms_faults_and_outages_of_board()),
        };
        let slot = asker
            .sender
            .run_until_connection_closed(
                self.effect_slots.wait_for_slot_replacing_waiting_request_of_same_client(asker.client),
            )
            .await?;
        self.check_neither_superseded_nor_stopped(id, stop_count_at_arrival)?;
        let (table, equipment) = (Arc::clone(&self.table), Arc::downgrade(&self.equipment));
        let work = move |deadline: &Deadline| {
            // Until the work is done, also if nobody waits for it any more.
            let _slot = slot;
            let file = read_file()?;
            deadline.check_not_cancelled_or_expired()?;
            let (effect, orders) = prepare_parts(&table, &equipment, (id, asked_at), &file, deadline)?;
            Ok((ReadingView::new(&file.list, &file.warnings, &effect), orders))
        };
        let (reading, orders) = run_low_priority_until_deadline("effect file", LONGEST, &asker.sender, work).await?;
        self.check_neither_superseded_nor_stopped(id, stop_count_at_arrival)?;
        let mut orders = orders.into_iter();
        let first = orders.next().ok_or(DesignError::Unbounded)?;
        let device = self.controller.queue_touch_order_and_wait_until_begun(first.order).await?.device;
        // From when the first one begins: it may wait for what is left of earlier touches, and for its rails.
        let (now, until_end) = (Instant::now(), device.time_from_answer_to_effect_end_or_zero());
        let start = now + device.time_from_answer_to_effect_start_or_zero();
        let after_first = |order: TimedOrder| TimedOrder { begin: order.begin.saturating_sub(first.begin), ..order };
        let later: Vec<TimedOrder> = orders.map(after_first).collect();
        if let Some(last) = later.last() {
            self.note_later_parts(id, stop_count_at_arrival, (start + last.begin).into_std());
        }
        tokio::spawn(drive_orders_at_their_times(Arc::downgrade(self), id, (start, now + until_end), later));
        Ok(PlayedEffectFileView { reading, plan_id: id, device })
    }
}

/// Designs the parts and makes orders of them. The equipment is held for one part at a time, so that the daemon's end does not wait.
fn prepare_parts(
    table: &PlanTable,
    equipment: &Weak<DriveEquipment>,
    (id, asked_at): (u64, AskedAt),
    file: &CheckedEffectFile,
    deadline: &Deadline,
) -> Result<(PanelEffect, Vec<TimedOrder>), Problem> {
    let equipment = || equipment.upgrade().ok_or(SessionError::Closed);
    let poles = table.panel_poles().ok_or(DesignError::Unbounded)?;
    let mut designer = PartDesigner::new(
        table,
        poles,
        (file.touched_m, file.asked_g),
        equipment()?.does_board_play_single_drive_windows_or_is_unknown(),
    );
    for part in &file.parts {
        deadline.check_not_cancelled_or_expired()?;
        designer.add_part(part)?;
    }
    let effect = designer.effect;
    let mut orders = Vec::with_capacity(effect.parts.len());
    let mut rails_v = [0.0; RAILS];
    for part in &effect.parts {
        deadline.check_not_cancelled_or_expired()?;
        let Some(place) = effect.places.get(part.place) else { continue };
        let mode = DriveMode::Designed(Arc::new(part.design.clone()));
        let order = equipment()?.prepare_touch_order(id, asked_at, place.plan.clone(), vec![file.finger], mode)?;
        let begin = Duration::from_millis(u64::try_from(part.begin_ms).unwrap_or(u64::MAX));
        let before_v = std::mem::replace(&mut rails_v, part.design.find_rail_voltages_v());
        let rise_v = rails_v.iter().zip(before_v).map(|(after, before)| after - before).fold(0.0, f64::max);
        let rise = Duration::from_secs_f64(rise_v / f64::from(RAIL_SLOPE_MILLIVOLTS_PER_MS));
        orders.push(TimedOrder { begin, rise, order });
    }
    Ok((effect, orders))
}

impl From<PanelEffectError> for Problem {
    fn from(error: PanelEffectError) -> Self {
        match error {
            PanelEffectError::Plan(error) => error.into(),
            PanelEffectError::Offset { offset_mm: (dx_mm, _), .. } => {
                Self::new(ProblemKind::OutOfRange, error.to_string()).with_field_and_value(
                    "dx_mm",
                    dx_mm.into(),
                    "an offset to a place on the surface".into(),
                    None,
                )
            }
            PanelEffectError::Design(error) => error.into(),
        }
    }
}

/// Holds the daemon only while it drives, so that it can end in between. Each part is sent ahead of its time, but not before the part before has
/// ended, in whose place it would be played.
async fn drive_orders_at_their_times(
    driver: Weak<TouchDriver>,
    id: u64,
    (start, mut free_from): (Instant, Instant),
    orders: Vec<TimedOrder>,
) {
    for TimedOrder { begin, rise, mut order } in orders {
        order.start = Some((start + begin).into_std());
        tokio::time::sleep_until((start + begin - AHEAD - rise).max(free_from)).await;
        let Some(driver) = driver.upgrade() else { return };
        match driver.controller.queue_touch_order_and_wait_until_begun(order).await {
            Ok(driven) => free_from = Instant::now() + driven.device.time_from_answer_to_effect_end_or_zero(),
            Err(problem) => {
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
}
