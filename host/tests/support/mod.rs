//! A daemon with a simulated device, for tests.
#![allow(dead_code, reason = "each test program uses a part of this")]

pub mod browser;
pub mod described;
pub mod old_board;
pub mod program;
#[path = "../../model/tests/numerics/scenes.rs"]
pub mod scenes;
pub mod served;
pub mod timed_board;

use era::daemon::{Access, App, BackgroundDaemon, Recorder};
use era::device::session::policy::SessionPolicy;
use era::device::sim::{SimControl, SimPanel};
use era::device::{OpenDevice, Target};
use era::model::levels::ReducedLevels;
use era::model::{Accuracy, PanelModel};
use era::planner::softening::Transducer;
use era::planner::{PlanTable, TableOptions};
use era::scene::Scene;
use era::transient::reduced::ModalSystem;
use nalgebra::{DMatrix, DVector};
use serde_json::Value;
use std::time::{Duration, Instant};

pub struct Daemon {
    pub url: String,
    pub sim: SimControl,
    /// Ends it; nothing where it is a process of its own.
    pub background: Option<BackgroundDaemon>,
}

pub fn table(text: &str) -> PlanTable {
    let scene = Scene::parse("test scene", text).unwrap();
    let options = TableOptions::default();
    let model = PanelModel::build(&scene, Accuracy::FAST, options.to_hz)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(options.to_hz, &[])
        .unwrap();
    PlanTable::build(&scene, model, options).unwrap()
}

/// As `era serve --accuracy fast` makes it: with the coarser levels that give plans an error bound.
fn served_table(text: &str) -> PlanTable {
    let scene = Scene::parse("test scene", text).unwrap();
    let options = TableOptions::default();
    let levels = ReducedLevels::build(&scene, Accuracy::FAST, options.to_hz).unwrap();
    PlanTable::from_levels(&scene, levels, options).unwrap()
}

/// A scene's simulated panel, and the voltages of its channels.
pub fn panel_of(table: &PlanTable) -> (SimPanel, Vec<f64>) {
    (SimPanel::from_plan_table(table), table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect())
}

/// Two actuators on a panel that nothing moves: no model has to be made for it.
pub fn still_panel() -> SimPanel {
    let none = ModalSystem { lambda: DVector::zeros(0), damping: DMatrix::zeros(0, 0), force: DMatrix::zeros(0, 2) };
    SimPanel::new(&none, vec![Transducer::with_fixed_force(0.0); 2])
}

impl Daemon {
    /// The daemon on a scene, once its device answers.
    pub fn start(scene: &str) -> Self {
        Self::start_with(scene, SessionPolicy::default(), Access::default())
    }

    /// The same with what it does without being asked, and who may do what.
    pub fn start_with(scene: &str, policy: SessionPolicy, access: Access) -> Self {
        let table = served_table(scene);
        let device = OpenDevice::open(&Target::Sim, || panel_of(&table)).unwrap();
        let sim = device.sim_control_if_simulated().unwrap();
        let daemon = Self::of(table, scene, device, sim, policy, access);
        daemon.wait_for(|state| state["device"]["connected"] == true);
        daemon
    }

    /// The daemon on a scene, writing down what is asked of it, once its device answers.
    pub fn recording(scene: &str, recorder: Recorder) -> Self {
        let (mut app, sim) = Self::app_and_sim(scene, Access::default());
        app.record = Some(recorder);
        let background = BackgroundDaemon::start(app).unwrap();
        let daemon = Self { url: format!("http://{}", background.address()), sim, background: Some(background) };
        daemon.wait_for(|state| state["device"]["connected"] == true);
        daemon
    }

    /// What a daemon serves, for who serves it otherwise.
    pub fn app(scene: &str, access: Access) -> App {
        Self::app_and_sim(scene, access).0
    }

    fn app_and_sim(scene: &str, access: Access) -> (App, SimControl) {
        let table = served_table(scene);
        let device = OpenDevice::open(&Target::Sim, || panel_of(&table)).unwrap();
        let sim = device.sim_control_if_simulated().unwrap();
        (
            App::start_session_with_policy_and_access(
                table,
                device,
                scene.to_owned(),
                SessionPolicy::default(),
                access,
            )
            .unwrap(),
            sim,
        )
    }

    /// The same behind tokens, once its device answers.
    pub fn start_guarded(scene: &str, access: Access) -> Self {
        let (app, sim) = Self::app_and_sim(scene, access);
        let deadline = Instant::now() + Duration::from_secs(30);
        while !app.driver.subscribe_device_snapshots().borrow().connected {
            assert!(Instant::now() < deadline, "its device does not answer");
            std::thread::sleep(Duration::from_millis(5));
        }
        let background = BackgroundDaemon::start(app).unwrap();
        let url = format!("http://{}", background.address());
        Self { url, sim, background: Some(background) }
    }

    /// The daemon with a board at a serial port's path, which may be there or not.
    pub fn at(scene: &str, path: &str, policy: SessionPolicy) -> Self {
        let device = OpenDevice::new_unconnected_for_serial_or_auto(&Target::Serial(path.into())).unwrap();
        Self::of(served_table(scene), scene, device, SimControl::default(), policy, Access::default())
    }

    fn of(
        table: PlanTable,
        scene: &str,
        device: OpenDevice,
        sim: SimControl,
        policy: SessionPolicy,
        access: Access,
    ) -> Self {
        let app = App::start_session_with_policy_and_access(table, device, scene.to_owned(), policy, access).unwrap();
        let background = BackgroundDaemon::start(app).unwrap();
        Self { url: format!("http://{}", background.address()), sim, background: Some(background) }
    }

    pub fn agent() -> ureq::Agent {
        ureq::Agent::config_builder()
            .http_status_as_error(false)
            .proxy(None)
            .timeout_global(Some(Duration::from_secs(30)))
            .build()
            .into()
    }

    /// Status, content type and JSON of a request with any body; the answer is as the interface's description says.
    #[track_caller]
    pub fn post(&self, path: &str, body: &str) -> (u16, String, Value) {
        let mut answer = Self::agent().post(format!("{}{path}", self.url)).send(body).unwrap();
        let kind = answer.headers().get("content-type").map_or("", |value| value.to_str().unwrap()).to_owned();
        let (status, told) = (answer.status().as_u16(), answer.body_mut().read_json().unwrap());
        described::described().check("post", path, status, &kind, &told);
        (status, kind, told)
    }

    #[track_caller]
    pub fn get(&self, path: &str) -> (u16, Value) {
        let mut answer = Self::agent().get(format!("{}{path}", self.url)).call().unwrap();
        let kind = answer.headers().get("content-type").map_or("", |value| value.to_str().unwrap()).to_owned();
        let (status, told) = (answer.status().as_u16(), answer.body_mut().read_json().unwrap());
        described::described().check("get", path, status, &kind, &told);
        (status, told)
    }

    pub fn get_text(&self, path: &str) -> String {
        Self::agent().get(format!("{}{path}", self.url)).call().unwrap().body_mut().read_to_string().unwrap()
    }

    pub fn state(&self) -> Value {
        self.get("/v1/state").1
    }

    /// Waits until the state is as wanted.
    pub fn wait_for(&self, mut wanted: impl FnMut(&Value) -> bool) -> Value {
        let deadline = Instant::now() + Duration::from_secs(30);
        loop {
            let state = self.state();
            if wanted(&state) {
                return state;
            }
            assert!(Instant::now() < deadline, "still not as wanted: {state}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}
