//! The daemon's start and end.

use super::args::{AfterOutage, Serve};
use super::panel::load_or_compute_plan_table_with_origin;
use super::signals::{EndSignals, stop_and_suspend_on_terminal_request};
use super::{CommandResult, Failure, notify};
use crate::connection::HostPort;
use crate::daemon::listener::{ListenError, TlsFiles, find_or_make_certificate, list_names_missing_in_certificate};
use crate::daemon::{
    Access, App, DEFAULT_LISTEN, EndReason, KeptBytes, Listener, Recorder, serve_until_shutdown_or_session_end,
};
use crate::device::session::policy::SessionPolicy;
use crate::device::sim::SimPanel;
use crate::device::{OpenDevice, SessionError, Target};
use crate::planner::cache::{Origin, Prepared};
use crate::planner::{Plan, PlanTable, Target as TouchTarget};
use crate::private_file;
use std::io::ErrorKind;
use std::path::Path;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};
use tokio::net::TcpListener;

/// Name of the daemon's socket in the user's folder for such.
const SOCKET: &str = "era.sock";
/// What can be recorded to.
const NEW_RECORD: &str = "Name a new file in a folder that exists, or name a folder with a slash at the end of its name: each start of the daemon then makes a new file in this folder";
/// Where the first plan is tried, in parts of the way to the screen's middle.
const DIAGONAL: [f64; 6] = [1.0, 0.8, 1.2, 0.6, 1.4, 0.4];

/// Told where nothing says which device: a service without its board would look as if all were well.
pub const SIMULATED: &str = "drives the simulated device: set device = \"auto\" to drive a board";

/// Serves, with what a configuration file says among the options; `started` is when the program was.
pub fn run_serve(options: &Serve, started: Instant) -> CommandResult {
    let (scene, text) = options.panel.load_scene_and_text()?;
    // Before anything is written.
    if let Some((_, mistake)) = list_mistakes_that_prevent_daemon_start_by_config_key(options).into_iter().next() {
        return Err(Failure::Usage(mistake));
    }
    let access = read_access_rules(options)?;
    // Said here, so that `TOKIO_WORKER_THREADS` counts for nothing; two at least, so that a stop does not wait for what is read.
    let threads = std::thread::available_parallelism().map_or(2, usize::from).max(2);
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(threads).enable_all().build();
    let runtime = runtime.map_err(Failure::runtime_error)?;
    // A port in use is told before the panel is computed, or a certificate made.
    let has_tokens = !access.tokens.is_empty();
    let place = listen_place_or_default(options)?;
    let ports = runtime
        .block_on(Listener::bind_ports_of_all_addresses(&place, is_tls_configured(options), has_tokens))
        .map_err(convert_listen_error)?;
    for warning in list_certificate_date_warnings_by_config_key(options) {
        tracing::warn!("{}", warning.1);
    }
    // In the runtime, in which sockets are opened.
    let listeners =
        runtime.block_on(async { make_port_and_unix_listeners_making_missing_certificate(options, &place, ports) })?;
    // After all that may keep the daemon from starting: a file that was begun is in the next start's way.
    let recorder = match &options.record {
        None => None,
        Some(path) => Some(
            Recorder::start_with_kept_bytes(path, &scene.name, recording_size_limits(options)).map_err(|error| {
                Failure::Usage(format!(
                    "--record {}: {error}{}",
                    path.display(),
                    advise_on_record_error_or_empty(&error)
                ))
            })?,
        ),
    };
    let urls: Vec<String> = listeners
        .iter()
        .map(|listener| replace_wildcard_host_by_usable_names(&listener.url(), &options.allow_host))
        .collect();
    let prepared = load_or_compute_plan_table_with_origin(&options.panel, options.keep, &scene)?;
    tracing::info!("{}", describe_table_preparation(&prepared));
    let table = prepared.table;
    if table.scene.finger.is_some() {
        tracing::warn!(
            "the daemon's plans ignore the scene's [finger], because a drive must be safe when the finger is \
             lifted; `era plan` and `era field` include the finger"
        );
    }
    let target = options.device.clone().unwrap_or(Target::Sim);
    // From before there is a session on.
    let signals = {
        let _runtime = runtime.enter();
        EndSignals::listen()
    };
    // A board that is not there yet is waited for.
    let device = match OpenDevice::new_unconnected_for_serial_or_auto(&target) {
        Some(device) => device,
        None => open_device(&target, &table)?,
    };
    let mut app = App::start_session_with_policy_and_access(
        table,
        device,
        text,
        read_idle_clear_silence_and_rearm_policy(options),
        access,
    )
    .map_err(Failure::runtime_error)?;
    app.record = recorder;
    let app = Arc::new(app);
    let first = plan_touch_near_screen_middle(&app.table);
    let planned = started.elapsed();
    tracing::info!(
        "ready after {:.3} s: open {} (scene {}, device {target})",
        planned.as_secs_f64(),
        urls.join(", "),
        scene.name
    );
    if let Some(file) = &options.token_file {
        tracing::info!(
            "in a browser, add #token=TOKEN to the address, where TOKEN is one of the secrets in the file \"{}\"",
            file.display()
        );
    }
    if target == Target::Sim && options.device.is_none() {
        match &options.config {
            Some(path) => {
                tracing::warn!("with the configuration file \"{}\", the daemon {}", path.display(), SIMULATED)
            }
            None => tracing::info!("this daemon drives the simulated device: use --device auto to drive a board"),
        }
    }
    if let Some(plan) = first {
        let own_us = plan.elapsed_us;
        tracing::info!(
            "the first plan was ready {:.0} ms after the program started (the planning itself took {own_us:.0} us)",
            duration_ms(planned)
        );
    }
    compute_what_first_requests_need_in_background(&app);
    let watched = Arc::clone(&app);
    notify::notify_ready_and_start_watchdog_messages_while_alive(
        runtime.handle(),
        &format!("serving on {}", urls.join(", ")),
        move || watched.driver.is_session_thread_working(),
    );
    let stopped = Arc::downgrade(&app);
    runtime.spawn(stop_and_suspend_on_terminal_request(move || stop_device(Weak::clone(&stopped))));
    match runtime.block_on(serve_until_shutdown_or_session_end(
        app,
        listeners,
        notify::notify_stopping_after(await_end_signal(signals)),
    )) {
        EndReason::Asked => Ok(()),
        // A failure, so that the service manager starts it anew.
        EndReason::Session => Err(Failure::runtime_error(SessionError::Ended)),
    }
}

/// How much of a recording is kept.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within a range of positive numbers")]
fn recording_size_limits(options: &Serve) -> KeptBytes {
    let bytes = |megabytes: Option<f64>, usual: u64| megabytes.map_or(usual, |number| (number * 1e6) as u64);
    let usual = KeptBytes::default();
    KeptBytes {
        file_bytes: bytes(options.record_file_mb, usual.file_bytes),
        total_bytes: bytes(options.record_total_mb, usual.total_bytes),
    }
}

/// What is done without being asked.
fn read_idle_clear_silence_and_rearm_policy(options: &Serve) -> SessionPolicy {
    SessionPolicy {
        idle: options.idle_s.map_or(SessionPolicy::IDLE, Duration::from_secs_f64),
        clears_silence: options.clear_silence,
        arms_after_outage: options.after_outage == Some(AfterOutage::Touch),
    }
}

/// An address as it can be opened: 0.0.0.0 and [::] are all of this machine's, and no name of it. TLS has a certificate for
/// localhost and the names that were allowed.
fn replace_wildcard_host_by_usable_names(url: &str, names: &[String]) -> String {
    let Some((scheme, place)) = url.split_once("://") else { return url.to_owned() };
    let Some(port) = place.strip_prefix("0.0.0.0:").or_else(|| place.strip_prefix("[::]:")) else {
        return url.to_owned();
    };
    let all: Vec<String> = std::iter::once("localhost")
        .chain(names.iter().map(String::as_str))
        .map(|name| format!("{scheme}://{name}:{port}"))
        .collect();
    format!("{} (the daemon listens on all addresses of this computer)", all.join(" or "))
}

/// Who may do what.
fn read_access_rules(options: &Serve) -> Result<Access, Failure> {
    let tokens = match &options.token_file {
        None => Vec::new(),
        Some(path) => {
            let wrong = |what: &dyn std::fmt::Display| Failure::Usage(format!("{}: {what}", path.display()));
            let text = private_file::read(path).map_err(|error| wrong(&error))?;
            Access::parse_tokens(&text).map_err(|error| wrong(&error))?
        }
    };
    let (origins, mut hosts) = (options.allow_origin.clone(), options.allow_host.clone());
    // Who listens at a name is called by it.
    hosts.extend(listen_place_or_default(options)?.name().map(str::to_ascii_lowercase));
    Ok(Access { origins, hosts, tokens, ..Access::default() })
}

fn convert_listen_error(error: ListenError) -> Failure {
    match error {
        ListenError::Open { .. } | ListenError::Tls { .. } => Failure::Usage(error.to_string()),
        _ => Failure::runtime_error(error),
    }
}

/// Where the daemon listens with these options.
pub fn listen_place_or_default(options: &Serve) -> Result<HostPort, Failure> {
    options.listen.clone().map_or_else(|| DEFAULT_LISTEN.parse().map_err(Failure::Failed), Ok)
}

/// The files of certificate and key that are there.
fn find_tls_files_given_or_already_in_folder(options: &Serve) -> Result<Option<TlsFiles>, ListenError> {
    match (&options.tls_cert, &options.tls_key, &options.tls_dir) {
        (Some(certificate), Some(key), _) => Ok(Some(TlsFiles { certificate: certificate.clone(), key: key.clone() })),
        (.., Some(folder)) => TlsFiles::find_whole_pair_in_folder_or_error_if_only_key_missing(folder),
        _ => Ok(None),
    }
}

/// The key that names the certificate.
const fn certificate_config_key(options: &Serve) -> &'static str {
    if options.tls_dir.is_some() { "tls_dir" } else { "tls_cert" }
}

/// What does not keep the daemon from starting, but clients from talking to it, each with its key: dates of its certificate, which are wrong
/// for as long as the clock is, too.
pub fn list_certificate_date_warnings_by_config_key(options: &Serve) -> Vec<(&'static str, String)> {
    let files = find_tls_files_given_or_already_in_folder(options).ok().flatten();
    let faults = files.map(|files| files.list_date_faults()).unwrap_or_default();
    faults.into_iter().map(|fault| (certificate_config_key(options), fault)).collect()
}

const fn is_tls_configured(options: &Serve) -> bool {
    options.tls_dir.is_some() || (options.tls_cert.is_some() && options.tls_key.is_some())
}

/// What keeps the daemon from starting with these options, each with its key: all that can be told without listening or writing anything.
/// Of files that are not for this user nothing is said: a service may be given them by its manager.
pub fn list_mistakes_that_prevent_daemon_start_by_config_key(options: &Serve) -> Vec<(&'static str, String)> {
    let mut all = Vec::new();
    let is_anothers = |path: &Path| {
        private_file::open_without_waiting(path).is_err_and(|error| error.kind() == ErrorKind::PermissionDenied)
    };
    if options.token_file.as_ref().is_some_and(|path| !is_anothers(path))
        && let Err(Failure::Usage(text) | Failure::Failed(text)) = read_access_rules(options)
    {
        all.push(("token_file", text));
    }
    // A configuration file may have one without the other, which would be served without TLS.
    match (&options.tls_cert, &options.tls_key) {
        (Some(path), None) => {
            all.push((
                "tls_cert",
                format!("tls_cert is {}, but tls_key, the private key of this certificate, is missing", path.display()),
            ));
        }
        (None, Some(path)) => {
            all.push((
                "tls_key",
                format!("tls_key is {}, but tls_cert, the certificate of this key, is missing", path.display()),
            ));
        }
        _ => {}
    }
    if let Some(path) = &options.record
        && let Some(text) = find_record_path_mistake(path)
    {
        all.push(("record", text));
    }
    #[cfg(unix)]
    if let Some(path) = options.socket.as_ref().filter(|path| path.as_os_str() != "none")
        && let Err(error) = Listener::check_unix_path(path)
    {
        all.push(("socket", error.to_string()));
    }
    let usable = find_tls_files_given_or_already_in_folder(options).and_then(|files| match files {
        Some(files) if ![&files.certificate, &files.key].into_iter().any(|path| is_anothers(path)) => {
            files.check_usable()
        }
        _ => Ok(()),
    });
    if let Err(error) = usable {
        let is_of_key = options.tls_key.as_ref().is_some_and(|key| error.is_about_tls_file(key));
        all.push((if is_of_key { "tls_key" } else { certificate_config_key(options) }, error.to_string()));
    }
    // A name that has no address now may have one when the daemon starts.
    let addresses =
        listen_place_or_default(options).ok().and_then(|place| place.find_addresses().ok()).unwrap_or_default();
    let is_open = |address| {
        Listener::check_address_allowed(address, is_tls_configured(options), options.token_file.is_some()).err()
    };
    all.extend(addresses.into_iter().find_map(is_open).map(|error| ("listen", error.to_string())));
    all
}

/// What to do about a recording that cannot be begun, where another place is the answer.
fn advise_on_record_error_or_empty(error: &std::io::Error) -> String {
    use std::io::ErrorKind::{AlreadyExists, IsADirectory, NotADirectory, NotFound};
    match error.kind() {
        AlreadyExists | IsADirectory | NotADirectory | NotFound => format!(". {NEW_RECORD}"),
        _ => String::new(),
    }
}

/// What keeps a recording from being begun there. A file that was begun is not written over: a service that records to one is started once.
fn find_record_path_mistake(path: &Path) -> Option<String> {
    if Recorder::is_folder_path(path) {
        return None;
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let shown = path.display();
    if path.exists() && !era_files::has_no_records(path) {
        return Some(format!(
            "`record` is {shown}, but this file already exists, and a recording never replaces a file. {NEW_RECORD}"
        ));
    }
    let lacking = folder.filter(|folder| !folder.is_dir())?;
    Some(format!("`record` is {shown}, but the folder \"{}\" does not exist. {NEW_RECORD}", lacking.display()))
}

/// Where to listen: the ports that there are, with TLS where that is wanted, and the socket in the file system.
fn make_port_and_unix_listeners_making_missing_certificate(
    options: &Serve,
    place: &HostPort,
    ports: Vec<TcpListener>,
) -> Result<Vec<Listener>, Failure> {
    let tls = match (&options.tls_cert, &options.tls_key, &options.tls_dir) {
        (Some(certificate), Some(key), _) => {
            let files = TlsFiles { certificate: certificate.clone(), key: key.clone() };
            warn_of_names_missing_in_certificate(
                &files,
                &options.allow_host,
                "clients that use such a name need a certificate that contains the name",
            );
            if files.has_no_dns_name_or_ip_address() {
                tracing::warn!(
                    "the certificate {} names no host (subjectAltName): `era` with --ca accepts this certificate, but \
                     browsers and other clients refuse it",
                    files.certificate.display()
                );
            }
            Some(files)
        }
        (.., Some(folder)) => {
            let mut names = options.allow_host.clone();
            let is_every = place.address().is_some_and(|address| address.ip().is_unspecified());
            names.extend((!is_every).then(|| place.host().to_owned()));
            let files = find_or_make_certificate(folder, &names).map_err(convert_listen_error)?;
            let advice = format!(
                "the daemon keeps the certificate, because clients trust it; to get a new certificate with these names, move \
                 era-cert.pem and era-key.pem out of {}, restart the daemon, and give the new era-cert.pem to every client",
                folder.display()
            );
            warn_of_names_missing_in_certificate(&files, &names, &advice);
            Some(files)
        }
        _ => None,
    };
    let over = |port| Listener::from_bound_port(port, tls.as_ref()).map_err(convert_listen_error);
    let mut all = ports.into_iter().map(over).collect::<Result<Vec<_>, _>>()?;
    #[cfg(unix)]
    match &options.socket {
        Some(path) if path.as_os_str() == "none" => {}
        Some(path) => all.push(Listener::bind_unix(path).map_err(convert_listen_error)?),
        None => {
            let folder = std::env::var_os("XDG_RUNTIME_DIR").filter(|folder| !folder.is_empty());
            // Nobody has asked for it: a second daemon does without.
            match folder.map(|folder| Listener::bind_unix(&Path::new(&folder).join(SOCKET))) {
                Some(Ok(listener)) => all.push(listener),
                Some(Err(error)) => tracing::info!("the daemon runs without a Unix socket: {error}"),
                None => {}
            }
        }
    }
    Ok(all)
}

/// Warns of names that are allowed and that clients will not find in the certificate.
fn warn_of_names_missing_in_certificate(files: &TlsFiles, names: &[String], advice: &str) {
    let lacking = list_names_missing_in_certificate(files, names);
    if !lacking.is_empty() {
        tracing::warn!(
            "the certificate {} does not contain the names {}: {advice}",
            files.certificate.display(),
            lacking.join(", ")
        );
    }
}

/// What it took to have a table, and what it takes.
fn describe_table_preparation(prepared: &Prepared) -> String {
    let Prepared { table, origin, kept, .. } = prepared;
    let origin = match origin {
        Origin::Kept { read, restore } => {
            format!(
                "from the cache: read in {:.0} ms, restored and checked in {:.0} ms",
                duration_ms(*read),
                duration_ms(*restore)
            )
        }
        Origin::Computed { levels, table, write } => {
            format!(
                "computed (the model took {:.0} ms, the table {:.0} ms) and written to the cache (this took {:.0} \
                ms)",
                duration_ms(*levels),
                duration_ms(*table),
                duration_ms(*write)
            )
        }
    };
    let file = kept.as_ref().map_or_else(
        || String::from("not on disk"),
        |(path, bytes)| format!("{:.1} MB in {}", bytes_to_megabytes(*bytes), path.display()),
    );
    format!("plan table {origin}; {:.1} MB in memory, {file}", bytes_to_megabytes(table.memory_bytes() as u64))
}

fn duration_ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

#[expect(clippy::cast_precision_loss, reason = "to one decimal place")]
fn bytes_to_megabytes(bytes: u64) -> f64 {
    bytes as f64 / 1e6
}

/// A plan for the screen's middle, or the nearest place to it on its diagonal that has not been cut out. Nothing is driven.
fn plan_touch_near_screen_middle(table: &PlanTable) -> Option<Plan> {
    let screen = &table.scene.screen;
    let middle = [f64::from(screen.width_px), f64::from(screen.height_px)].map(|side| side / 2.0);
    DIAGONAL.iter().find_map(|part| {
        let (x_m, y_m) = table.scene.surface_point_at_px(middle[0] * part, middle[1] * part).ok()?.coordinates_m();
        table.plan(&[TouchTarget { x_m, y_m, intensity_g: None }]).ok()
    })
}

/// Makes ready what the first click, and the first request for the objective `reach`, need, while nobody waits for it.
fn compute_what_first_requests_need_in_background(app: &Arc<App>) {
    let app = Arc::clone(app);
    let started = std::thread::Builder::new().name("warm-up".into()).spawn(move || {
        let started = Instant::now();
        if let Some(poles) = app.table.panel_poles() {
            crate::planner::click::sound::get_or_compute_mean_acceleration_products_of_cells(&app.table, poles);
        }
        crate::planner::reach::compute_and_cache_max_min_setting_of_whole_surface(&app.table);
        tracing::debug!(
            "motion of the surface for clicks, and actuator settings for the objective `reach`, computed in {:.0} ms",
            duration_ms(started.elapsed())
        );
    });
    if let Err(error) = started {
        tracing::debug!(
            %error,
            "could not compute in advance what the first click and the first request with the objective `reach` need; \
             these requests will compute it"
        );
    }
}

/// Opens the device; the simulated one gets the table's panel.
pub fn open_device(target: &Target, table: &PlanTable) -> Result<OpenDevice, Failure> {
    let panel = || {
        let volts = table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
        (SimPanel::from_plan_table(table), volts)
    };
    OpenDevice::open(target, panel).map_err(Failure::runtime_error)
}

/// Resolves on the first signal that asks the program to end, or would end it.
pub(super) async fn await_end_signal(signals: EndSignals) {
    let name = signals.wait_for_first_signal().await;
    tracing::info!("stopping: {name}");
}

/// Everything off, as far as that can be reached.
async fn stop_device(app: Weak<App>) {
    if let Some(app) = app.upgrade()
        && let Err(error) = app.stop_device().await
    {
        tracing::warn!(
            %error,
            "cannot stop the device before the process is suspended; the device's dead-man timer stops the device"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::command::{Arguments, Command};
    use super::*;
    use clap::Parser;

    #[test]
    fn a_board_that_was_away_waits_for_a_person_unless_told_otherwise() {
        for (more, arms) in [("", false), ("--after-outage person", false), ("--after-outage touch", true)] {
            let arguments = format!("era serve {more}");
            let Some(Command::Serve(serve)) = Arguments::parse_from(arguments.split_whitespace()).command else {
                panic!("{arguments}");
            };
            assert_eq!(read_idle_clear_silence_and_rearm_policy(&serve).arms_after_outage, arms, "{arguments}");
        }
    }
}
