//! What the facts mean.

use super::facts::{BoardReport, Chosen, Daemon, Facts, File, PortAnswer, PortHolder, Wanted};
use super::finding::Finding;
use super::judge_board;

/// Every check, in the order in which they are best mended.
#[must_use]
pub fn judge_facts(facts: &Facts) -> Vec<Finding> {
    let mut all: Vec<Finding> = Vec::new();
    all.extend(facts.config.as_ref().map(|file| judge_read_file("config", file)));
    all.extend(facts.scene.as_ref().map(|file| judge_read_file("scene", file)));
    all.push(list_serial_ports_as_finding(facts));
    all.push(judge_board_presence(facts));
    all.extend(judge_udev_rule_if_machine_has_udev(facts));
    all.push(judge_modem_manager(facts));
    all.push(judge_daemon(facts));
    if let Some(chosen) = &facts.chosen {
        let has_rule = facts.rules.as_ref().is_some_and(|rules| !rules.is_empty());
        all.extend(judge_permission_use_and_answer_of_chosen_serial_port(chosen, &facts.daemon, has_rule));
    }
    match find_direct_and_daemon_board_reports(facts) {
        (Some(direct), through) => {
            all.extend(judge_board::judge_board_report(direct));
            all.extend(through.and_then(judge_board::judge_fault_of_daemon_device));
        }
        (None, Some(through)) => all.extend(judge_board::judge_board_report(through)),
        (None, None) => {}
    }
    all.extend(facts.realtime.map(judge_realtime_priority));
    all
}

/// What the board says over its port, and what a daemon says of its device, whichever that is.
fn find_direct_and_daemon_board_reports(facts: &Facts) -> (Option<&BoardReport>, Option<&BoardReport>) {
    let direct = match &facts.chosen {
        Some(Chosen { answer: PortAnswer::Answered(heard), .. }) => Some(heard),
        _ => None,
    };
    let through = match &facts.daemon {
        Daemon::Runs { heard, .. } => heard.as_deref(),
        _ => None,
    };
    (direct, through)
}

fn judge_read_file(check: &'static str, file: &File) -> Finding {
    match &file.mistake {
        None => Finding::ok(check, format!("{} can be used", file.path)),
        Some(mistake) => Finding::problem(check, mistake.clone(), format!("correct the file \"{}\"", file.path)),
    }
}

fn list_serial_ports_as_finding(facts: &Facts) -> Finding {
    let list: Vec<String> = facts
        .ports
        .iter()
        .map(|port| match &port.usb {
            Some(usb) => {
                let name = usb.name.as_deref().unwrap_or("no name");
                format!("{} ({:04x}:{:04x} {name})", port.path, usb.vendor, usb.product)
            }
            None => port.path.clone(),
        })
        .collect();
    Finding::ok("ports", if list.is_empty() { "no serial ports".into() } else { list.join(", ") })
}

/// Whether there is a board.
fn judge_board_presence(facts: &Facts) -> Finding {
    const CABLE: &str = "connect a USB cable that carries data to the board's pins PA11 (D-) and PA12 (D+), and switch \
                         the board on. The NUCLEO-G474RE has no USB connector for these pins, only one for its debug \
                         probe";
    let boards: Vec<&str> = facts.ports.iter().filter(|port| port.is_board()).map(|port| port.path.as_str()).collect();
    let probe = facts.ports.iter().find(|port| port.is_probe());
    match (&facts.wanted, &boards[..]) {
        (Wanted::Simulated(kind), _) => Finding::ok("board", format!("the device {kind} needs no board")),
        (Wanted::Port(path), _) if !boards.contains(&path.as_str()) => Finding::ok(
            "board",
            format!(
                "--device or the configuration names {path}. This port does not have the USB identity of a board. \
                 This is normal if the board is connected through a UART"
            ),
        ),
        (_, [one]) => Finding::ok("board", format!("a board is connected at {one}")),
        (Wanted::Port(path), _) => Finding::ok("board", format!("a board is connected at {path}")),
        (_, [first, ..]) => Finding::warning(
            "board",
            format!("{} boards are connected: {}", boards.len(), boards.join(", ")),
            format!("name one of these ports with --device; the checks below use {first}"),
        ),
        (wanted, []) => {
            let (found, advice) = match (facts.bootloader, probe) {
                (Some(true), _) => (
                    "a chip is in its bootloader and does not run the firmware".into(),
                    "an update was interrupted, or the pin BOOT0 is high: run `era flash` (see docs/src/bring-up.md)"
                        .into(),
                ),
                (_, Some(probe)) => (
                    String::from("no port has the USB identity of a board"),
                    format!(
                        "{CABLE}. If the board's UART is connected to the debug probe, name the port: --device {}",
                        probe.path
                    ),
                ),
                _ => ("no board is connected".into(), format!("{CABLE}. To work without a board, use --device sim")),
            };
            if *wanted == Wanted::Board {
                Finding::problem("board", found, advice)
            } else {
                Finding::warning("board", found, advice)
            }
        }
    }
}

fn judge_udev_rule_if_machine_has_udev(facts: &Facts) -> Option<Finding> {
    Some(match facts.rules.as_deref()? {
        [] => Finding::warning("udev-rule", "no udev rule lets users open the board's port", RULE),
        [rule, ..] => Finding::ok("udev-rule", format!("the udev rule is in {}", rule.path)),
    })
}

fn judge_modem_manager(facts: &Facts) -> Finding {
    let keeps_away = facts.rules.iter().flatten().any(|rule| rule.ignores_modem_manager);
    match facts.modem_manager {
        None => Finding::ok("modem-manager", "ModemManager does not run"),
        Some(_) if keeps_away => {
            Finding::ok("modem-manager", "ModemManager runs, and ignores the board because of the udev rule")
        }
        Some(pid) => Finding::warning(
            "modem-manager",
            format!(
                "ModemManager runs (process {pid}), and opens the port of a newly connected board for some seconds"
            ),
            RULE,
        ),
    }
}

fn judge_daemon(facts: &Facts) -> Finding {
    let address = &facts.address;
    match &facts.daemon {
        Daemon::Absent if facts.is_address_named => Finding::problem(
            "daemon",
            format!("no daemon answers at {address}"),
            "check that the daemon runs (`era serve`, `systemctl status era`) and listens at this address \
             (--listen), and that no firewall blocks the connection",
        ),
        Daemon::Absent => Finding::ok("daemon", format!("no daemon runs at {address}")),
        Daemon::OtherProgram(answer) => Finding::problem(
            "daemon",
            format!("the program that answers at {address} is not an era daemon ({answer})"),
            "use another address for the daemon: era serve --listen 127.0.0.1:PORT, or `listen` in its configuration",
        ),
        Daemon::Guarded(reason) => Finding::warning(
            "daemon",
            format!("a daemon runs at {address} and needs a token, so its device was not checked: {reason}"),
            "use era doctor --token-file FILE, or put a token into the environment variable ERA_TOKEN; a token of the \
             role `view` is sufficient",
        ),
        Daemon::Hidden { found, advice } => Finding::warning("daemon", found.clone(), advice.clone()),
        Daemon::Runs { version, port, problem: Some(problem), .. } => Finding::problem(
            "daemon",
            format!(
                "a daemon of version {version} runs at {address}, but its device at {port} is not connected: {problem}"
            ),
            "see the checks of the port below; the daemon connects again when the cause is removed",
        ),
        Daemon::Runs { version, port, kind, .. } => {
            let own = env!("CARGO_PKG_VERSION");
            let found = format!("a daemon of version {version} runs at {address} with the device {kind} at {port}");
            if version == own {
                Finding::ok("daemon", found)
            } else {
                Finding::warning(
                    "daemon",
                    format!("{found}; this program has version {own}"),
                    "restart the daemon with the newer version",
                )
            }
        }
    }
}

/// What gives users the board.
const RULE: &str = "run `sudo era install --only rule`, and connect the board again";

/// The port itself: may it be opened, and who has it.
fn judge_permission_use_and_answer_of_chosen_serial_port(
    chosen: &Chosen,
    daemon: &Daemon,
    has_udev_rule: bool,
) -> Vec<Finding> {
    let Chosen { path, access, holders, answer } = chosen;
    let mut all = vec![match answer {
        PortAnswer::Denied => {
            let own = if access.is_member { ", of which this user is a member" } else { "" };
            let (group, join) = match &access.group {
                Some(group) => (
                    format!(" (group {group}{own})"),
                    format!("; or run `sudo usermod -aG {group} $USER`, and sign in again"),
                ),
                None => (String::new(), String::new()),
            };
            let first =
                if has_udev_rule { "connect the board again, so that the udev rule takes effect" } else { RULE };
            Finding::problem(
                "permission",
                format!("this user has no permission to open {path}{group}"),
                format!("{first}{join}"),
            )
        }
        PortAnswer::Missing => Finding::problem(
            "permission",
            format!("there is no port {path}"),
            "name one of the ports in the check `ports` above, or connect the board",
        ),
        PortAnswer::Failed(reason) => Finding::problem(
            "permission",
            format!("{path} cannot be opened: {reason}"),
            "check that this path is a serial port; disconnect the board and connect it again",
        ),
        PortAnswer::NotAsked | PortAnswer::Busy => {
            Finding::ok("permission", format!("not checked, because {path} is in use"))
        }
        _ => Finding::ok("permission", format!("this user has the permission to open {path}")),
    }];
    let own = matches!(daemon, Daemon::Runs { port, .. } if port == path);
    let name = |it: &PortHolder| format!("{} (process {})", it.name, it.pid);
    let names: Vec<String> = holders.iter().map(name).collect();
    let beside: Vec<String> = holders.iter().filter(|it| it.name != "era").map(name).collect();
    all.push(match answer {
        _ if own && !beside.is_empty() => Finding::problem(
            "port",
            format!("{path} is open in the running daemon, but also in {}", beside.join(", ")),
            "end the other program, because it receives bytes that the daemon needs",
        ),
        _ if own => {
            Finding::ok("port", format!("the running daemon has {path} open, and reports the state of the device"))
        }
        PortAnswer::NotAsked => Finding::problem(
            "port",
            format!("{path} is open in {}", names.join(", ")),
            "end that program, because only one program at a time can use a port",
        ),
        PortAnswer::Busy => Finding::problem(
            "port",
            format!("{path} is open in another program"),
            "end that program; `sudo era doctor` shows its name",
        ),
        PortAnswer::Denied | PortAnswer::Missing | PortAnswer::Failed(_) => return all,
        _ => Finding::ok("port", format!("no other program has {path} open, as far as this user can see")),
    });
    all.push(match answer {
        PortAnswer::Silent(reason) => Finding::problem(
            "firmware",
            format!("no board answers at {path}: {reason}"),
            "check that this is the board's port; switch the board's power off and on; if the board has no firmware, \
             write the \
             firmware with `era flash`",
        ),
        PortAnswer::Version(reason) => Finding::problem(
            "firmware",
            reason.clone(),
            "if the firmware is too old, update it with `era flash`; if it is too new, install a newer version of era",
        ),
        _ => return all,
    });
    all
}

fn judge_realtime_priority(priority_limit: u64) -> Finding {
    if priority_limit > 0 {
        return Finding::ok(
            "realtime",
            format!("threads of this user can get real-time priority (up to {priority_limit})"),
        );
    }
    Finding::warning(
        "realtime",
        "threads of this user get no real-time priority (RLIMIT_RTPRIO): on a busy machine commands to the board \
         may be late",
        "the service of `era install` has real-time priority (LimitRTPRIO); for a daemon that you start in a shell, \
         add the line `@GROUP - rtprio 20` to /etc/security/limits.d/era.conf (replace GROUP by a group of this \
         user), and sign in again",
    )
}
