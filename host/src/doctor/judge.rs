//! What the facts mean.

use super::facts::{Answer, Chosen, Daemon, Facts, File, Heard, Holder, Wanted};
use super::finding::Finding;
use super::judge_board;

/// Every check, in the order in which they are best mended.
#[must_use]
pub fn judge(facts: &Facts) -> Vec<Finding> {
    let mut all: Vec<Finding> = Vec::new();
    all.extend(facts.config.as_ref().map(|file| judge_file("config", file)));
    all.extend(facts.scene.as_ref().map(|file| judge_file("scene", file)));
    all.push(judge_ports(facts));
    all.push(judge_presence(facts));
    all.extend(judge_rule(facts));
    all.push(judge_modem_manager(facts));
    all.push(judge_daemon(facts));
    if let Some(chosen) = &facts.chosen {
        let has_rule = facts.rules.as_ref().is_some_and(|rules| !rules.is_empty());
        all.extend(judge_port(chosen, &facts.daemon, has_rule));
    }
    match heard(facts) {
        (Some(direct), through) => {
            all.extend(judge_board::judge(direct));
            all.extend(through.and_then(judge_board::judge_other));
        }
        (None, Some(through)) => all.extend(judge_board::judge(through)),
        (None, None) => {}
    }
    all.extend(facts.realtime.map(judge_realtime));
    all
}

/// What the board says over its port, and what a daemon says of its device, whichever that is.
fn heard(facts: &Facts) -> (Option<&Heard>, Option<&Heard>) {
    let direct = match &facts.chosen {
        Some(Chosen { answer: Answer::Heard(heard), .. }) => Some(heard),
        _ => None,
    };
    let through = match &facts.daemon {
        Daemon::Runs { heard, .. } => heard.as_deref(),
        _ => None,
    };
    (direct, through)
}

fn judge_file(check: &'static str, file: &File) -> Finding {
    match &file.mistake {
        None => Finding::ok(check, format!("{} can be used", file.path)),
        Some(mistake) => Finding::problem(check, mistake.clone(), format!("mend {}", file.path)),
    }
}

fn judge_ports(facts: &Facts) -> Finding {
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
fn judge_presence(facts: &Facts) -> Finding {
    const CABLE: &str = "connect the board's own USB connector (not only that of its debug probe) with a cable that carries \
                         data, and power it";
    let boards: Vec<&str> = facts.ports.iter().filter(|port| port.is_board()).map(|port| port.path.as_str()).collect();
    let probe = facts.ports.iter().find(|port| port.is_probe());
    match (&facts.wanted, &boards[..]) {
        (Wanted::Simulated(kind), _) => Finding::ok("board", format!("none is needed for the device {kind}")),
        (Wanted::Port(path), _) if !boards.contains(&path.as_str()) => Finding::ok(
            "board",
            format!("{path} is named; by its USB identity it is no board, which a UART need not be"),
        ),
        (_, [one]) => Finding::ok("board", format!("at {one}")),
        (Wanted::Port(path), _) => Finding::ok("board", format!("at {path}")),
        (_, [first, ..]) => Finding::warning(
            "board",
            format!("{} boards are connected: {}", boards.len(), boards.join(", ")),
            format!("name one with --device; {first} was looked at"),
        ),
        (wanted, []) => {
            let (found, advice) = match (facts.bootloader, probe) {
                (Some(true), _) => (
                    "a chip waits in its bootloader".into(),
                    "an update was cut off, or the pin BOOT0 is high: run `era flash` (see docs/src/bring-up.md)".into(),
                ),
                (_, Some(probe)) => (
                    String::from("no board by its USB identity"),
                    format!("{CABLE}; if its UART is at the debug probe, name it: --device {}", probe.path),
                ),
                _ => ("no board is connected".into(), format!("{CABLE}; the simulated device needs none")),
            };
            if *wanted == Wanted::Board {
                Finding::problem("board", found, advice)
            } else {
                Finding::warning("board", found, advice)
            }
        }
    }
}

fn judge_rule(facts: &Facts) -> Option<Finding> {
    Some(match facts.rules.as_deref()? {
        [] => Finding::warning("udev-rule", "no udev rule gives users the board", RULE),
        [rule, ..] => Finding::ok("udev-rule", rule.path.clone()),
    })
}

fn judge_modem_manager(facts: &Facts) -> Finding {
    let keeps_away = facts.rules.iter().flatten().any(|rule| rule.ignores_modem_manager);
    match facts.modem_manager {
        None => Finding::ok("modem-manager", "does not run"),
        Some(_) if keeps_away => Finding::ok("modem-manager", "runs, and the udev rule keeps it away from the board"),
        Some(pid) => Finding::warning(
            "modem-manager",
            format!("runs (process {pid}), and opens the port of a board that is plugged in for some seconds"),
            RULE,
        ),
    }
}

fn judge_daemon(facts: &Facts) -> Finding {
    let address = &facts.address;
    match &facts.daemon {
        Daemon::Absent if facts.is_address_named => Finding::problem(
            "daemon",
            format!("nobody answers at {address}"),
            "see that the daemon runs (`era serve`, `systemctl status era`), that the address is that of its --listen, and that no \
             firewall is in between",
        ),
        Daemon::Absent => Finding::ok("daemon", format!("none runs at {address}")),
        Daemon::Stranger(answer) => Finding::problem(
            "daemon",
            format!("{address} is taken by something that is no era daemon ({answer})"),
            "let the daemon listen elsewhere: era serve --listen 127.0.0.1:PORT, or `listen` in its configuration",
        ),
        Daemon::Guarded(reason) => Finding::warning(
            "daemon",
            format!("one runs at {address} and asks for a token, so nothing is known of its device: {reason}"),
            "era doctor --token-file FILE, or the variable ERA_TOKEN; a token of the role view is enough",
        ),
        Daemon::Hidden { found, advice } => Finding::warning("daemon", found.clone(), advice.clone()),
        Daemon::Runs { version, port, problem: Some(problem), .. } => Finding::problem(
            "daemon",
            format!("version {version} runs at {address}, but its device at {port} is not connected: {problem}"),
            "see what is said of the port below; the daemon connects again by itself",
        ),
        Daemon::Runs { version, port, kind, .. } => {
            let own = env!("CARGO_PKG_VERSION");
            let found = format!("version {version} runs at {address} with the device {kind} at {port}");
            if version == own {
                Finding::ok("daemon", found)
            } else {
                Finding::warning("daemon", format!("{found}; this program is {own}"), "restart the daemon")
            }
        }
    }
}

/// What gives users the board.
const RULE: &str = "sudo era install --only rule, and plug the board in again";

/// The port itself: may it be opened, and who has it.
fn judge_port(chosen: &Chosen, daemon: &Daemon, has_rule: bool) -> Vec<Finding> {
    let Chosen { path, access, holders, answer } = chosen;
    let mut all = vec![match answer {
        Answer::Denied => {
            let own = if access.is_member { ", which this user is in" } else { "" };
            let (group, join) = match &access.group {
                Some(group) => (
                    format!(" (group {group}{own})"),
                    format!("; or: sudo usermod -aG {group} $USER, and sign in again"),
                ),
                None => (String::new(), String::new()),
            };
            let first = if has_rule { "plug the board in again, so that the udev rule acts" } else { RULE };
            Finding::problem("permission", format!("this user may not open {path}{group}"), format!("{first}{join}"))
        }
        Answer::Missing => Finding::problem(
            "permission",
            format!("there is no {path}"),
            "name one of the ports above, or plug the board in",
        ),
        Answer::Failed(reason) => Finding::problem(
            "permission",
            format!("{path} cannot be opened: {reason}"),
            "is it a serial port? Unplug the board and plug it in again",
        ),
        Answer::NotAsked | Answer::Busy => Finding::ok("permission", format!("not tried, as {path} is in use")),
        _ => Finding::ok("permission", format!("this user may open {path}")),
    }];
    let own = matches!(daemon, Daemon::Runs { port, .. } if port == path);
    let name = |it: &Holder| format!("{} (process {})", it.name, it.pid);
    let names: Vec<String> = holders.iter().map(name).collect();
    let beside: Vec<String> = holders.iter().filter(|it| it.name != "era").map(name).collect();
    all.push(match answer {
        _ if own && !beside.is_empty() => Finding::problem(
            "port",
            format!("{path} is the running daemon's, and is open in {} as well", beside.join(", ")),
            "end that program: it takes bytes from the daemon",
        ),
        _ if own => Finding::ok("port", format!("{path} is the running daemon's, which was asked in its place")),
        Answer::NotAsked => Finding::problem(
            "port",
            format!("{path} is open in {}", names.join(", ")),
            "end that program; a second one on the same port takes bytes from the first",
        ),
        Answer::Busy => Finding::problem(
            "port",
            format!("{path} is held by another program"),
            "end it; `sudo era doctor` sees which one it is",
        ),
        Answer::Denied | Answer::Missing | Answer::Failed(_) => return all,
        _ => Finding::ok("port", format!("nobody else has {path} open, as far as this user can see")),
    });
    all.push(match answer {
        Answer::Silent(reason) => Finding::problem(
            "firmware",
            format!("nothing on {path} answers as a board does: {reason}"),
            "is it the board's port? Power it down and up; `era flash` writes its firmware",
        ),
        Answer::Version(reason) => Finding::problem(
            "firmware",
            reason.clone(),
            "`era flash` updates the board; a newer board needs a newer era",
        ),
        _ => return all,
    });
    all
}

fn judge_realtime(limit: u64) -> Finding {
    if limit > 0 {
        return Finding::ok("realtime", format!("threads may have real-time priority (up to {limit})"));
    }
    Finding::warning(
        "realtime",
        "threads of this user get no real-time priority (RLIMIT_RTPRIO): on a busy machine commands may be late",
        "the unit of `era install` sets LimitRTPRIO; for a shell: a line `@GROUP - rtprio 20` in /etc/security/limits.d/era.conf",
    )
}
