//! Keeps what a touch needs at hand while the board is on.
//!
//! A touch reads some megabytes of tables and runs through as much of the program as a request does. After a second without a touch, the
//! processor's caches hold other data, of this program or of others on the same machine, and the next touch takes up to twice as long. So
//! while the board is on, which means that somebody may touch next, this repeats what a touch would do: the way in, a plan, and what the plan
//! needs to be driven. Nothing of it is driven.
//!
//! The reason to keep this is a measurement: at 4 touches per second the median latency is 0.69 ms with it and 0.89 ms without
//! and the 99th percentile after rests of 1.2 s is 4.13 ms with it and 5.04 ms without
//! (`docs/src/verification-status.md`).

use super::routes;
use crate::daemon::access::client::Peer;
use crate::daemon::access::permissions::Owner;
use crate::daemon::app::App;
use crate::daemon::drive::wait_for_closing;
use crate::device::DeviceSnapshot;
use crate::planner::Target;
use axum::Router;
use axum::body::Body;
use axum::http::{Request, header};
use era_shared::safety::SafetyState;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{MissedTickBehavior, interval};
use tower_service::Service;

/// How often. Once takes some 0.4 ms, a hundredth of a processor.
const EVERY: Duration = Duration::from_millis(50);

/// Does so until the daemon ends.
pub async fn keep_caches_warm_while_armed_and_idle(app: Arc<App>) {
    let (router, mut closing) = (routes::build_router(Arc::clone(&app)), app.driver.subscribe_closing());
    let mut ticks = interval(EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            () = wait_for_closing(&mut closing) => return,
            _ = ticks.tick() => {}
        }
        // Touches that are under way keep it at hand themselves.
        if is_board_connected_and_armed(&app.driver.subscribe_device_snapshots().borrow())
            && app.driver.admission.is_planner_idle()
        {
            tokio::task::block_in_place(|| app.plan_touch_without_driving());
            send_cache_warming_request(router.clone()).await;
        }
    }
}

/// Whether somebody may touch next: the board is there, and armed.
fn is_board_connected_and_armed(device: &DeviceSnapshot) -> bool {
    device.connected && device.state().is_some_and(SafetyState::is_live)
}

/// A request that changes nothing, by the way that all take.
async fn send_cache_warming_request(mut router: Router) {
    let mut request = Request::new(Body::empty());
    *request.uri_mut() = axum::http::Uri::from_static("/v1/scene");
    request.headers_mut().insert(header::HOST, header::HeaderValue::from_static("localhost"));
    request.extensions_mut().insert(Peer::Process(None));
    request.extensions_mut().insert(Owner);
    let Ok(_answer) = router.call(request).await;
}

impl App {
    /// What a touch where the last one was, or in the middle of the screen, would take.
    fn plan_touch_without_driving(&self) {
        let screen = &self.table.scene.screen;
        let middle = || {
            self.table.scene.surface_point_at_px(f64::from(screen.width_px) / 2.0, f64::from(screen.height_px) / 2.0)
        };
        let last = self
            .driver
            .find_active_plan()
            .and_then(|active| active.plan.plan().targets.first().map(|target| (target.x_m, target.y_m)));
        let Some((x_m, y_m)) = last.or_else(|| middle().ok().map(|place| place.coordinates_m())) else { return };
        // A place in a cut-out has no plan, and nothing is lost.
        if let Ok(plan) = self.table.plan(&[Target { x_m, y_m, intensity_g: None }]) {
            std::hint::black_box(self.table.predict_travel_and_free_motion_of_plan_if_poles_known(&plan));
        }
    }
}
