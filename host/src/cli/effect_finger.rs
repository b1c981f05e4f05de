//! Clicks on a panel with a finger and without: `era effect` designs a click for the panel with the finger of the scene, and the daemon for the panel
//! without it, because a finger may lift at any time.

use crate::effects::{
    EffectDesign, EffectRequest, EffectWindow, design_effect_of_windows_if_common_click_exists_else_of_drives,
    intensity,
};
use crate::planner::click::measures::{ClickMeasures, measure_click};
use crate::planner::click::{ClickWindow, simulate_felt_acceleration_of_windows_m_per_s2};
use crate::planner::rise::PanelPoles;
use crate::planner::{Plan, PlanTable};

/// The panel without the finger, and with the finger at the first target.
#[derive(Clone, Copy, Debug)]
pub struct ClickPanels<'a> {
    pub bare: &'a PlanTable,
    pub with_finger: &'a PlanTable,
    pub rise_with_finger: &'a PanelPoles,
}

/// What clicks do at the first target on the panel that they are not designed for, times from the burst's start; `None` of a click without windows.
#[derive(Clone, Debug)]
pub struct ClicksAcrossFinger {
    /// The click that is designed for the panel with the finger.
    pub same_windows_without_finger: Option<ClickMeasures>,
    /// The click that the daemon would play.
    pub daemon_windows_with_finger: Option<ClickMeasures>,
}

/// Measures the click `design` of the panel with the finger on the panel without it, and the other way round; `bare_plan` is that of the panel without
/// it. `None` where an undamped mode is at its resonance.
pub fn measure_clicks_across_finger_unless_undamped(
    panels: &ClickPanels,
    bare_plan: &Plan,
    request: EffectRequest,
    design: &EffectDesign,
) -> Option<ClicksAcrossFinger> {
    let bare_poles = panels.bare.panel_poles()?;
    let of_daemon = design_effect_of_windows_if_common_click_exists_else_of_drives(
        panels.bare,
        bare_poles,
        bare_plan,
        request,
        request.click_options(),
    );
    let daemon_windows_with_finger = of_daemon.ok().and_then(|of_daemon| {
        measure_windows_at_first_target(panels.with_finger, panels.rise_with_finger, bare_plan, &of_daemon)
    });
    Some(ClicksAcrossFinger {
        same_windows_without_finger: measure_windows_at_first_target(panels.bare, bare_poles, bare_plan, design),
        daemon_windows_with_finger,
    })
}

fn measure_windows_at_first_target(
    table: &PlanTable,
    poles: &PanelPoles,
    plan: &Plan,
    design: &EffectDesign,
) -> Option<ClickMeasures> {
    let target = plan.targets.first()?;
    let windows: Vec<ClickWindow> =
        design.windows.iter().map(EffectWindow::to_click_window_in_seconds_by_actuator_index).collect();
    if windows.is_empty() {
        return None;
    }
    let shapes = [intensity::mode_shape_values_at_point_or_on_bar_axis(table, target.x_m, target.y_m)];
    let motion = simulate_felt_acceleration_of_windows_m_per_s2(table, poles, &shapes, &windows);
    motion.first().map(|motion| measure_click(motion))
}
