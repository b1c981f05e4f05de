//! The daemon's start and end.

use super::args::Serve;
use super::panel::prepared_table;
use super::{Failure, Outcome, config, notify};
use crate::daemon::{App, DEFAULT_LISTEN, serve};
use crate::device::sim::Panel;
use crate::device::{OpenDevice, Target};
use crate::planner::cache::{Origin, Prepared};
use crate::planner::{Plan, PlanTable, Target as TouchTarget};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Where the first plan is tried, in parts of the way to the screen's middle.
const DIAGONAL: [f64; 6] = [1.0, 0.8, 1.2, 0.6, 1.4, 0.4];

/// Serves; `started` is when the program was.
pub fn run(options: &Serve, started: Instant) -> Outcome {
    let options = &config::joined(options)?;
    let (scene, text) = options.panel.load_text()?;
    let default: Result<SocketAddr, _> = DEFAULT_LISTEN.parse();
    let listen = match options.listen {
        Some(listen) => listen,
        None => default.map_err(Failure::failed)?,
    };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().map_err(Failure::failed)?;
    // A port in use is told before the panel is computed.
    let listener = runtime.block_on(tokio::net::TcpListener::bind(listen)).map_err(|error| {
        Failure::failed(format!(
            "cannot listen on {listen}: {error}. Is another daemon running? `era serve --listen 127.0.0.1:PORT` takes another port (0: any that is free), which \
             clients are told with --url"
        ))
    })?;
    let address = listener.local_addr().map_err(Failure::failed)?;
    let prepared = prepared_table(&options.panel, options.keep, &scene)?;
    tracing::info!("{}", account(&prepared));
    let table = prepared.table;
    let target = options.device.clone().unwrap_or(Target::Sim);
    let device = open_device(&target, &table)?;
    let app = Arc::new(App::new(table, device, text).map_err(Failure::failed)?);
    let first = first_plan(&app.table);
    let planned = started.elapsed();
    tracing::info!(
        "ready after {:.3} s: open http://{address} (scene {}, device {target})",
        planned.as_secs_f64(),
        scene.name
    );
    if let Some(plan) = first {
        let own_us = plan.elapsed_us;
        tracing::info!("first plan {:.0} ms after the start, {own_us:.0} us of which it took itself", ms(planned));
    }
    warm_up(&app);
    notify::ready(runtime.handle(), &format!("serving on http://{address}"), || true);
    runtime.block_on(serve(app, listener, notify::stopping_after(shutdown()))).map_err(Failure::failed)
}

/// What it took to have a table, and what it takes.
fn account(prepared: &Prepared) -> String {
    let Prepared { table, origin, kept, .. } = prepared;
    let origin = match origin {
        Origin::Kept { read, restore } => {
            format!("from the cache: read in {:.0} ms, restored and checked in {:.0} ms", ms(*read), ms(*restore))
        }
        Origin::Computed { levels, table, write } => {
            format!(
                "computed: model {:.0} ms, table {:.0} ms, written in {:.0} ms",
                ms(*levels),
                ms(*table),
                ms(*write)
            )
        }
    };
    let file = kept.as_ref().map_or_else(
        || String::from("not on disk"),
        |(path, bytes)| format!("{:.1} MB in {}", megabytes(*bytes), path.display()),
    );
    format!("plan table {origin}; {:.1} MB in memory, {file}", megabytes(table.bytes() as u64))
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

#[expect(clippy::cast_precision_loss, reason = "to one decimal place")]
fn megabytes(bytes: u64) -> f64 {
    bytes as f64 / 1e6
}

/// A plan for the screen's middle, or the nearest place to it on its diagonal that has not been cut out. Nothing is driven.
fn first_plan(table: &PlanTable) -> Option<Plan> {
    let screen = &table.scene.screen;
    let middle = [f64::from(screen.width_px), f64::from(screen.height_px)].map(|side| side / 2.0);
    DIAGONAL.iter().find_map(|part| {
        let (x_m, y_m) = table.scene.place_px(middle[0] * part, middle[1] * part).ok()?.xy_m();
        table.plan(&[TouchTarget { x_m, y_m, intensity_g: None }]).ok()
    })
}

/// Makes ready what the first request for the objective `reach` needs, while nobody waits for it.
fn warm_up(app: &Arc<App>) {
    let app = Arc::clone(app);
    let started = std::thread::Builder::new().name("warm-up".into()).spawn(move || {
        let started = Instant::now();
        app.table.prepare_reach();
        tracing::debug!("reach prepared in {:.0} ms", ms(started.elapsed()));
    });
    if let Err(error) = started {
        tracing::debug!(%error, "the first request for reach will prepare it itself");
    }
}

/// Opens the device; the simulated one gets the table's panel.
pub fn open_device(target: &Target, table: &PlanTable) -> Result<OpenDevice, Failure> {
    let panel = || {
        let volts = table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
        (Panel::of(table), volts)
    };
    OpenDevice::open(target, panel).map_err(Failure::failed)
}

/// Resolves on Ctrl-C or, on Unix, the signal that service managers send.
async fn shutdown() {
    let interrupt = tokio::signal::ctrl_c();
    #[cfg(unix)]
    {
        let terminate = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate());
        if let Ok(mut terminate) = terminate {
            tokio::select! {
                _ = interrupt => {}
                _ = terminate.recv() => {}
            }
            tracing::info!("stopping");
            return;
        }
    }
    let _ = interrupt.await;
    tracing::info!("stopping");
}
