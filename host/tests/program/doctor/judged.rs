//! What facts mean.

use era::device::usb_ids::{BOARD, BOARD_NAME};
use era::doctor::facts::{
    BoardReport, Chosen, Clock, Daemon, Fault, File, Port, PortAnswer, PortGroupAccess, PortHolder, Rule, Supply, Usb,
    Wanted,
};
use era::doctor::{Facts, Finding, Verdict, judge_facts};
use era_shared::protocol::{CURRENT_VERSION, FaultCode};

const PATH: &str = "/dev/ttyACM0";

fn board_port(path: &str) -> Port {
    let usb = Usb { vendor: BOARD.0, product: BOARD.1, name: Some(BOARD_NAME.into()) };
    Port { path: path.into(), usb: Some(usb) }
}

fn well_heard() -> BoardReport {
    BoardReport {
        firmware: "0.1.0+1a2b3c4d".into(),
        protocol: Some(CURRENT_VERSION),
        state: Some("safe".into()),
        supply: Some(Supply {
            rail_v: vec![2.0, 1.5],
            interlock_closed: true,
            stop_released: true,
            earth_bonded: true,
        }),
        clock: Some(Clock { rate_ppm: Some(120.0), half_round_trip_s: 0.4e-3, worst_s: 0.2e-3 }),
        frames: (20, 0),
        ..BoardReport::default()
    }
}

/// A machine with a board on which all is well.
fn well() -> Facts {
    Facts {
        wanted: Wanted::Board,
        ports: vec![board_port(PATH)],
        bootloader: Some(false),
        rules: Some(vec![Rule { path: "/etc/udev/rules.d/70-era.rules".into(), ignores_modem_manager: true }]),
        modem_manager: Some(700),
        realtime: Some(20),
        chosen: Some(Chosen {
            path: PATH.into(),
            access: PortGroupAccess { group: Some("plugdev".into()), is_member: true },
            holders: Vec::new(),
            answer: PortAnswer::Answered(well_heard()),
        }),
        address: "127.0.0.1:7878".into(),
        is_address_named: false,
        daemon: Daemon::Absent,
        config: Some(File { path: "/etc/era/era.toml".into(), mistake: None }),
        scene: Some(File { path: "panel.toml".into(), mistake: None }),
    }
}

/// What is judged after a change, of the one check that it is about; all others stay as they are.
fn after(check: &str, change: impl FnOnce(&mut Facts)) -> Finding {
    let mut facts = well();
    change(&mut facts);
    let findings = judge_facts(&facts);
    findings.into_iter().find(|finding| finding.check == check && finding.verdict != Verdict::Ok).unwrap_or_else(|| {
        panic!("nothing is told of {check}: {:?}", judge_facts(&facts));
    })
}

fn set_port_answer(facts: &mut Facts, answer: PortAnswer) {
    facts.chosen.as_mut().unwrap().answer = answer;
}

fn change_board_report(change: impl FnOnce(&mut BoardReport)) -> impl FnOnce(&mut Facts) {
    move |facts| {
        let mut heard = well_heard();
        change(&mut heard);
        set_port_answer(facts, PortAnswer::Answered(heard));
    }
}

fn is(finding: &Finding, verdict: Verdict, words: &[&str]) {
    let text = format!("{} -> {}", finding.found, finding.advice.clone().unwrap_or_default());
    assert_eq!(finding.verdict, verdict, "{text}");
    assert!(finding.advice.is_some(), "{text}");
    for word in words {
        assert!(text.contains(word), "{word} in {text}");
    }
}

use Verdict::{Problem, Warning};

#[test]
fn nothing_is_said_against_a_machine_on_which_all_is_well() {
    let findings = judge_facts(&well());
    assert!(findings.iter().all(|finding| finding.verdict == Verdict::Ok), "{findings:?}");
    assert!(findings.iter().all(|finding| finding.advice.is_none()), "{findings:?}");
    let checks: Vec<&str> = findings.iter().map(|finding| finding.check).collect();
    let all = [
        "config",
        "scene",
        "ports",
        "board",
        "udev-rule",
        "modem-manager",
        "daemon",
        "permission",
        "port",
        "firmware",
        "fault",
        "interlock",
        "supply",
        "clock",
        "realtime",
    ];
    assert_eq!(checks, all);
}

#[test]
fn a_board_that_is_not_there_is_reported() {
    let gone = |facts: &mut Facts| {
        facts.ports.clear();
        facts.chosen = None;
    };
    is(&after("board", gone), Problem, &["no board is connected", "cable"]);
    // Who asked for none is not told off.
    let any = |facts: &mut Facts| {
        gone(facts);
        facts.wanted = Wanted::Any;
    };
    is(&after("board", any), Warning, &["use --device sim"]);
    let bootloader = |facts: &mut Facts| {
        gone(facts);
        facts.bootloader = Some(true);
    };
    is(&after("board", bootloader), Problem, &["is in its bootloader", "era flash"]);
    let probe = |facts: &mut Facts| {
        gone(facts);
        let usb = Usb { vendor: 0x0483, product: 0x374e, name: Some("STM32 STLink".into()) };
        facts.ports = vec![Port { path: "/dev/ttyACM3".into(), usb: Some(usb) }];
    };
    is(&after("board", probe), Problem, &["--device /dev/ttyACM3"]);
    let two = |facts: &mut Facts| facts.ports.push(board_port("/dev/ttyACM1"));
    is(&after("board", two), Warning, &["2 boards", "/dev/ttyACM1", "--device"]);
}

/// The pair of numbers is anybody's.
#[test]
fn the_numbers_alone_make_no_board() {
    let mut port = board_port(PATH);
    assert!(port.is_board());
    port.usb.as_mut().unwrap().name = Some("another experiment".into());
    assert!(!port.is_board());
    port.usb.as_mut().unwrap().name = None;
    assert!(!port.is_board());
}

#[test]
fn troubles_of_the_port_are_reported() {
    let denied = |facts: &mut Facts| {
        set_port_answer(facts, PortAnswer::Denied);
        facts.chosen.as_mut().unwrap().access = PortGroupAccess { group: Some("dialout".into()), is_member: false };
    };
    is(
        &after("permission", denied),
        Problem,
        &["group dialout", "so that the udev rule takes effect", "usermod -aG dialout"],
    );
    let no_rule = |facts: &mut Facts| {
        denied(facts);
        facts.rules = Some(Vec::new());
    };
    is(&after("permission", no_rule), Problem, &["era install --only rule"]);
    is(
        &after("permission", |facts| set_port_answer(facts, PortAnswer::Missing)),
        Problem,
        &["there is no port /dev/ttyACM0"],
    );
    is(
        &after("permission", |facts| set_port_answer(facts, PortAnswer::Failed("not a typewriter".into()))),
        Problem,
        &["typewriter"],
    );
    let held = |facts: &mut Facts| {
        set_port_answer(facts, PortAnswer::NotAsked);
        facts.chosen.as_mut().unwrap().holders = vec![PortHolder { pid: 4711, name: "minicom".into() }];
    };
    is(&after("port", held), Problem, &["minicom (process 4711)"]);
    is(&after("port", |facts| set_port_answer(facts, PortAnswer::Busy)), Problem, &["open in another program"]);
    is(
        &after("firmware", |facts| set_port_answer(facts, PortAnswer::Silent("no answer".into()))),
        Problem,
        &["era flash"],
    );
    is(
        &after("firmware", |facts| set_port_answer(facts, PortAnswer::Version("versions 3 to 4".into()))),
        Problem,
        &["versions 3 to 4"],
    );
}

#[test]
fn troubles_of_the_machine_are_reported() {
    is(&after("udev-rule", |facts| facts.rules = Some(Vec::new())), Warning, &["era install"]);
    is(&after("modem-manager", |facts| facts.rules = Some(Vec::new())), Warning, &["process 700", "era install"]);
    is(&after("realtime", |facts| facts.realtime = Some(0)), Warning, &["LimitRTPRIO"]);
    let other_program = |facts: &mut Facts| facts.daemon = Daemon::OtherProgram("it answers 404".into());
    is(&after("daemon", other_program), Problem, &["127.0.0.1:7878", "--listen"]);
    for (check, field) in [("config", 0), ("scene", 1)] {
        let broken = |facts: &mut Facts| {
            let file = if field == 0 { &mut facts.config } else { &mut facts.scene };
            file.as_mut().unwrap().mistake = Some("panel.toml:3: unknown key".into());
        };
        is(&after(check, broken), Problem, &["panel.toml:3"]);
    }
    // Where there is no udev, nobody asks for its rules.
    let facts = Facts { rules: None, modem_manager: None, ..well() };
    assert!(judge_facts(&facts).iter().all(|it| it.check != "udev-rule" && it.verdict == Verdict::Ok));
}

#[test]
fn troubles_of_the_board_are_reported() {
    is(
        &after("firmware", change_board_report(|it| it.protocol = Some(1))),
        Warning,
        &["protocol version 1", "era flash"],
    );
    let latched = |it: &mut BoardReport| it.fault = Some(Fault::from(FaultCode::OverCurrent));
    is(&after("fault", change_board_report(latched)), Problem, &["6 (over-current)", "Disconnect the supply"]);
    is(&after("fault", change_board_report(|it| it.failure = Some("panicked at".into()))), Warning, &["panicked at"]);
    is(&after("fault", change_board_report(|it| it.was_watchdog = true)), Warning, &["watchdog"]);
    is(
        &after("armed", change_board_report(|it| it.waits_to_be_armed = true)),
        Warning,
        &["had an outage", "`era arm`"],
    );
    let supply = |change: fn(&mut Supply)| change_board_report(move |it| change(it.supply.as_mut().unwrap()));
    is(&after("interlock", supply(|it| it.interlock_closed = false)), Problem, &["enclosure is open"]);
    is(&after("interlock", supply(|it| it.stop_released = false)), Problem, &["emergency stop"]);
    is(&after("interlock", supply(|it| it.earth_bonded = false)), Problem, &["earth", "do not touch"]);
    is(&after("supply", supply(|it| it.rail_v[1] = 800.0)), Problem, &["800 V", "do not open"]);
    let clock = |rate_ppm, worst_s| {
        change_board_report(move |it| {
            it.clock = Some(Clock { rate_ppm: Some(rate_ppm), half_round_trip_s: 1e-3, worst_s })
        })
    };
    is(&after("clock", clock(-25_000.0, 1e-4)), Problem, &["-25000 ppm", "1 %"]);
    is(&after("clock", clock(10.0, 0.02)), Warning, &["20.00 ms"]);
    is(&after("link", change_board_report(|it| it.frames = (100, 5))), Warning, &["5 of 100", "cable"]);
    // A rail is charged while the board is armed: that is what it is for.
    let armed = change_board_report(|it| {
        it.state = Some("armed".into());
        it.supply.as_mut().unwrap().rail_v = vec![1500.0, 1500.0];
    });
    let mut facts = well();
    armed(&mut facts);
    assert!(judge_facts(&facts).iter().all(|finding| finding.verdict == Verdict::Ok));
}

/// The daemon has the port: it is asked instead, and is no stranger in it.
#[test]
fn a_running_daemon_answers_for_its_board() {
    let mut facts = well();
    set_port_answer(&mut facts, PortAnswer::NotAsked);
    let holder = PortHolder { pid: 900, name: "era".into() };
    facts.chosen.as_mut().unwrap().holders = vec![holder];
    let runs = |problem: Option<&str>, fault: Option<Fault>, version: &str| Daemon::Runs {
        version: version.into(),
        port: PATH.into(),
        kind: "serial".into(),
        problem: problem.map(str::to_owned),
        heard: Some(Box::new(BoardReport { fault, ..well_heard() })),
    };
    let own = env!("CARGO_PKG_VERSION");
    facts.daemon = runs(None, None, own);
    let findings = judge_facts(&facts);
    assert!(findings.iter().all(|finding| finding.verdict == Verdict::Ok), "{findings:?}");
    assert!(findings.iter().any(|finding| finding.check == "interlock"));
    // Somebody else reads what the board says to the daemon.
    let mut shared = facts.clone();
    shared.chosen.as_mut().unwrap().holders.push(PortHolder { pid: 901, name: "cat".into() });
    let findings = judge_facts(&shared);
    let port = findings.iter().find(|finding| finding.check == "port").unwrap();
    assert!(port.verdict == Problem && port.found.contains("cat (process 901)"), "{port:?}");
    let take = |daemon: Daemon| {
        let facts = facts.clone();
        move |own: &mut Facts| *own = Facts { daemon, ..facts }
    };
    is(&after("daemon", take(runs(Some("the cable was pulled"), None, own))), Problem, &["cable was pulled"]);
    is(&after("fault", take(runs(None, Some(FaultCode::EarthOpen.into()), own))), Problem, &["10 (earth-open)"]);
    is(&after("daemon", take(runs(None, None, "0.0.1"))), Warning, &["restart the daemon"]);
    let guarded = Daemon::Guarded("a token is wanted".into());
    is(&after("daemon", take(guarded)), Warning, &["a token is wanted", "--token-file"]);
    let hidden = Daemon::Hidden { found: "127.0.0.1:7878 speaks TLS".into(), advice: "give --ca".into() };
    is(&after("daemon", take(hidden)), Warning, &["speaks TLS", "give --ca"]);
}

/// The daemon's device is asked for its fault whatever it is: nobody else knows it.
#[test]
fn a_fault_of_the_daemons_device_is_reported_whichever_that_is() {
    let runs = |fault: Option<FaultCode>| Daemon::Runs {
        version: env!("CARGO_PKG_VERSION").into(),
        port: "/dev/pts/7".into(),
        kind: "sim".into(),
        problem: None,
        heard: Some(Box::new(BoardReport { fault: fault.map(Fault::from), ..well_heard() })),
    };
    let latched = || runs(Some(FaultCode::HostSilent));
    let alone = |facts: &mut Facts| {
        facts.chosen = None;
        facts.wanted = Wanted::Simulated("sim");
        facts.daemon = latched();
    };
    is(&after("fault", alone), Problem, &["0 (host-silent)", "era clear"]);
    // Beside a board that was asked itself.
    let found = judge_facts(&Facts { daemon: latched(), ..well() });
    let daemons = found.iter().find(|finding| finding.check == "daemon-fault").unwrap();
    is(daemons, Problem, &["0 (host-silent)", "era clear"]);
    let well = judge_facts(&Facts { daemon: runs(None), ..well() });
    assert!(well.iter().all(|finding| finding.verdict == Verdict::Ok && finding.check != "daemon-fault"));
}
