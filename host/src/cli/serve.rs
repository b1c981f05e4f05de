//! The daemon's start and end.

use super::args::Serve;
use super::panel::plan_table;
use super::{Failure, Outcome};
use crate::daemon::{App, DEFAULT_LISTEN, serve};
use crate::device::sim::Panel;
use crate::device::{OpenDevice, Target};
use crate::planner::PlanTable;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Instant;

pub fn run(options: &Serve) -> Outcome {
    let started = Instant::now();
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
            "cannot listen on {listen}: {error}. Is another daemon running? --listen names another port"
        ))
    })?;
    let address = listener.local_addr().map_err(Failure::failed)?;
    let table = plan_table(&options.panel, &scene)?;
    let target = options.device.clone().unwrap_or(Target::Sim);
    let device = open_device(&target, &table)?;
    let app = Arc::new(App::new(table, device, text).map_err(Failure::failed)?);
    tracing::info!(
        "ready after {:.1} s: open http://{address} (scene {}, device {target})",
        started.elapsed().as_secs_f64(),
        scene.name
    );
    runtime.block_on(serve(app, listener, shutdown())).map_err(Failure::failed)
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
