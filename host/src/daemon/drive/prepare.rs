//! From a plan to what the session takes: as much of its forces as the channels' credit allows, and as there is room for.

use super::credit;
use super::equipment::DriveEquipment;
use super::order::{PreparedMode, PreparedPlan, TouchOrder};
use crate::daemon::api::kinds::ProblemKind;
use crate::daemon::api::problem::Problem;
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::request::Finger;
use crate::device::AskedAt;
use crate::effects::{
    DesignError, design_effect, design_effect_of_windows_if_common_click_exists_else_of_drives,
    is_click_for_up_to_three_targets_without_quiet_zones,
};
use crate::planner::Plan;
use crate::planner::click::ClickOptions;
use crate::planner::drive::assign_channels_in_order_of_drives;
use crate::planner::limitation::Limitation;

/// The first protocol version with single windows.
const WINDOWS_VERSION: u8 = 4;

impl DriveEquipment {
    /// Prepares a plan for the board: an even drive as strong as the channels' credit allows for as long as it may be held.
    ///
    /// # Errors
    /// [`Problem`]: an effect that cannot be designed, or a plan of which nobody can tell what it leaves.
    pub fn prepare_touch_order(
        &self,
        id: u64,
        asked_at: AskedAt,
        whole_plan: Plan,
        touches: Vec<Finger>,
        drive_mode: DriveMode,
    ) -> Result<TouchOrder, Problem> {
        let credit_fraction = if matches!(drive_mode, DriveMode::Hold(_)) {
            self.find_force_fraction_allowed_by_credit(&whole_plan)
        } else {
            1.0
        };
        let first = self.prepare_scaled_plan(&whole_plan, credit_fraction, 1.0, &drive_mode)?;
        Ok(TouchOrder { id, asked_at, start: None, touches, drive_mode, whole_plan, credit_fraction, first })
    }

    /// The fraction of a plan's forces that the channels' credit allows ([`credit::find_force_fraction_allowed_by_credit`]), as far as the credit is known.
    #[must_use]
    pub fn find_force_fraction_allowed_by_credit(&self, plan: &Plan) -> f64 {
        let snapshots = self.session.subscribe_snapshots();
        let snapshot = snapshots.borrow();
        let (Some(credit), Some(identity)) = (&snapshot.credit, &snapshot.identity) else { return 1.0 };
        let most_v: Vec<f64> =
            identity.channels.iter().map(|channel| f64::from(channel.max_voltage_millivolts) / 1e3).collect();
        credit::find_force_fraction_allowed_by_credit(
            &assign_channels_in_order_of_drives(&plan.drives),
            &most_v,
            credit,
        )
    }

    /// Whether the device plays single windows, as those of protocol version 4 on do; if none is known, it is taken for one that does.
    #[must_use]
    pub fn does_board_play_single_drive_windows_or_is_unknown(&self) -> bool {
        self.session.subscribe_snapshots().borrow().protocol.is_none_or(|version| version >= WINDOWS_VERSION)
    }

    /// Prepares the fraction `credit_fraction` of a plan's forces, which credit allows, and of these the fraction `force_fraction`, for which there is room.
    ///
    /// # Errors
    /// As [`Self::prepare_touch_order`].
    pub fn prepare_scaled_plan(
        &self,
        whole_plan: &Plan,
        credit_fraction: f64,
        force_fraction: f64,
        drive_mode: &DriveMode,
    ) -> Result<PreparedPlan, Problem> {
        let mut plan = if credit_fraction * force_fraction < 1.0 {
            crate::planner::plan::derate_plan(&self.table, whole_plan, credit_fraction * force_fraction)?
        } else {
            whole_plan.clone()
        };
        if force_fraction >= 1.0 {
            // Nothing is left of the touches before that would be in its way.
            (plan.limits, plan.limited_by) = (whole_plan.limits.clone(), whole_plan.limited_by.clone());
        }
        self.design_effect_and_predict_motion_of_scaled_plan(plan, force_fraction, drive_mode)
    }

    /// Works out what it takes to drive a plan that has the fraction `force_fraction` of the forces first planned.
    fn design_effect_and_predict_motion_of_scaled_plan(
        &self,
        plan: Plan,
        force_fraction: f64,
        drive_mode: &DriveMode,
    ) -> Result<PreparedPlan, Problem> {
        let (motion, mode) = match drive_mode {
            DriveMode::Hold(hold) => {
                (self.table.predict_travel_and_free_motion_of_plan_if_poles_known(&plan), PreparedMode::Hold(*hold))
            }
            DriveMode::Designed(design) => {
                let mut design = design.scale_copy_to_force_fraction(force_fraction);
                if force_fraction < 1.0 {
                    design.add_limitation_if_new(Limitation::StillMoving);
                }
                (
                    design.predict_travel_and_free_motion_left_by_effect_if_poles_known(&self.table),
                    PreparedMode::Effect(Box::new(design)),
                )
            }
            DriveMode::Effect(request) => {
                let request = *request;
                let rise = self.table.panel_poles().ok_or(DesignError::Unbounded)?;
                let mut wished = plan.clone();
                let is_burst = self.does_board_play_single_drive_windows_or_is_unknown()
                    && is_click_for_up_to_three_targets_without_quiet_zones(&plan, request);
                let mut design = if is_burst {
                    // A weaker wish may have another click: the same one is weakened.
                    let standing_rails_v = self.standing_rail_voltages_v_or_zeros();
                    let options = ClickOptions { force_fraction, standing_rails_v, ..request.click_options() };
                    self.clicks.get_or_design(&wished, options, || {
                        design_effect_of_windows_if_common_click_exists_else_of_drives(
                            &self.table,
                            rise,
                            &wished,
                            request,
                            options,
                        )
                    })?
                } else {
                    wished.targets.iter_mut().for_each(|target| target.wanted_g *= force_fraction);
                    design_effect(&self.table, rise, &wished, request)?
                };
                if force_fraction < 1.0 {
                    design.add_limitation_if_new(Limitation::StillMoving);
                }
                (
                    design.predict_travel_and_free_motion_left_by_effect_if_poles_known(&self.table),
                    PreparedMode::Effect(Box::new(design)),
                )
            }
        };
        let untold = || {
            let detail = "the vibration that remains after the end of the plan cannot be predicted: a drive excites an undamped mode at its resonance";
            Problem::new(ProblemKind::NoPlan, detail)
        };
        Ok(PreparedPlan { plan, motion: motion.ok_or_else(untold)?, mode })
    }
}
