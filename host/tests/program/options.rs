//! The help of a command lists exactly the options that it takes: each one listed is taken, and none of any other command's is.
//!
//! All of it is asked of the program, a process for each question: the commands, their options, and what becomes of each option.

use crate::support::program::{ProgramOutput, build_era_command, run_command};
use std::collections::{BTreeMap, BTreeSet};
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};

/// A port on which nobody listens: what asks a daemon fails there at once, after its options have been taken.
const NOBODY: &str = "http://127.0.0.1:9";

fn run_era_in_folder(folder: &Path, words: &[String]) -> ProgramOutput {
    run_command(build_era_command().current_dir(folder).args(words))
}

fn words(text: &str) -> Vec<String> {
    text.split_whitespace().map(str::to_owned).collect()
}

/// A command's `--help`: its options with whether each takes a value, and its subcommands.
struct Help {
    options: BTreeMap<String, bool>,
    commands: Vec<String>,
}

fn help(folder: &Path, command: &[String]) -> Help {
    let output = run_era_in_folder(folder, &[command, &["--help".to_owned()]].concat());
    assert!(output.is_success(), "{command:?}: {}", output.error);
    let text = &output.out;
    let (mut options, mut commands, mut section) = (BTreeMap::new(), Vec::new(), "");
    for line in text.lines().filter(|line| !line.is_empty()) {
        if !line.starts_with(' ') {
            section = line;
            continue;
        }
        let entry = line.trim_start();
        let is_entry = line.len() - entry.len() <= 6;
        if section.starts_with("Commands") && is_entry {
            commands.extend(entry.split_whitespace().next().filter(|name| *name != "help").map(str::to_owned));
        }
        if is_entry && entry.starts_with('-') {
            let long = entry.split([' ', ',']).find(|word| word.starts_with("--")).unwrap();
            let name: String = long.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '-').collect();
            // `[=<X>]` may be left out, and is.
            options.insert(name, entry.contains('<') && !entry.contains("[="));
        }
    }
    assert!(!commands.is_empty() || text.contains("\nExample"), "{command:?} has no example");
    Help { options, commands }
}

/// All commands, `config check` among them, with their options; the program without a command is no command.
fn all_commands(folder: &Path) -> BTreeMap<String, BTreeMap<String, bool>> {
    let (mut all, mut open) = (BTreeMap::new(), vec![String::new()]);
    while let Some(command) = open.pop() {
        let Help { options, commands } = help(folder, &words(&command));
        open.extend(commands.iter().map(|name| format!("{command} {name}").trim().to_owned()));
        if commands.is_empty() {
            all.insert(command, options);
        }
    }
    all
}

/// What a command wants in any case, so that it runs, quickly and without doing anything to this machine.
fn base(command: &str) -> Vec<String> {
    words(match command {
        // Where somebody else listens: it ends when it is to listen, too.
        "serve" => "--scene bar.toml --accuracy fast --listen TAKEN",
        "touch" => "960 640 --url NOBODY",
        "stop" | "clear" | "arm" | "state" => "--url NOBODY",
        "replay" => "day.jsonl --url NOBODY",
        "modes" => "--scene bar.toml --accuracy fast --max-hz 200",
        "press" => "--scene bar.toml --accuracy fast",
        "response" => "--scene bar.toml --accuracy fast --at 60,10 --step 100",
        "sweep" => "--scene bar.toml --accuracy fast --step 100 --grid 3,1",
        "transient" => "--scene bar.toml --accuracy fast --at 60,10 --drive left:120:0.1 --duration 0.01",
        "plan" => "--scene bar.toml --accuracy fast --at 480,80",
        "effect" => "--scene bar.toml --accuracy fast --at 480,80 --effect buzz",
        "field" => "--scene bar.toml --accuracy fast --at 480,80",
        "study" => "study.toml --out results",
        "verify" => "--scene bar.toml --accuracy fast --points 1",
        "latency" => "--scene bar.toml --accuracy fast --touches 1",
        "flash" => "image.elf --yes --port /dev/nothing",
        "monitor" => "--port /dev/nothing",
        "doctor" => "--url NOBODY",
        "install" => "--root root",
        "config check" => "era.toml",
        "completions" => "bash",
        "config example" => "",
        "man" => "--dir man",
        other => panic!("say what `era {other}` wants in any case"),
    })
}

/// A value that an option takes.
fn value(command: &str, option: &str) -> &'static str {
    match (command, option) {
        ("touch" | "plan" | "effect", "--window") => "0-100",
        ("effect", "--count") => "3",
        (_, "--file") => "click.toml",
        (_, "--format") => "toml",
        (_, "--export") => "out.csv",
        ("field", "--effect") => "click",
        ("transient", "--step") => "1e-3",
        ("doctor", "--device") | ("serve", "--device") => "sim",
        ("modes" | "sweep", "--npy") => "out.npy",
        (_, "--scene") => "bar.toml",
        (_, "--accuracy") => "fast",
        (_, "--tolerance") => "0.01",
        (_, "--within") => "50ms",
        (_, "--log-format") => "json",
        (_, "--config") => "era.toml",
        (_, "--listen") => "TAKEN",
        (_, "--socket") => "none",
        (_, "--token-file") => "token",
        (_, "--tls-cert") => "cert.pem",
        (_, "--tls-key") => "key.pem",
        (_, "--tls-dir") => "tls",
        (_, "--ca") => "cert.pem",
        (_, "--allow-origin") => "http://127.0.0.1:1",
        (_, "--allow-host") => "panel.local",
        (_, "--record") => "records/",
        (_, "--idle-s") => "5",
        (_, "--after-outage") => "touch",
        (_, "--url" | "--proxy") => NOBODY,
        (_, "--intensity-g") => "0.1",
        (_, "--intensity-db") => "10",
        (_, "--duration-ms") => "100",
        (_, "--duration") => "0.01",
        (_, "--effect") => "buzz",
        (_, "--count" | "--workers" | "--touches" | "--points" | "--first-clicks") => "1",
        (_, "--period-ms") => "50",
        (_, "--crisp-ms") => "40",
        (_, "--prefer") => "crispness",
        (_, "--also") => "900,80:0.1",
        (_, "--quiet") => "1200,80:5:0.5",
        (_, "--objective") => "power",
        (_, "--grouping") => "shared",
        (_, "--weigh") => "felt",
        (_, "--speed") => "2",
        (_, "--max-hz") => "200",
        (_, "--grid") => "3,1",
        (_, "--csv") => "out.csv",
        (_, "--png") => "out.png",
        (_, "--unit") => "mm",
        (_, "--at") => "60,10",
        (_, "--from") => "100",
        (_, "--to") => "300",
        (_, "--step") => "100",
        (_, "--drive") => "right:90:0.1",
        (_, "--force-n") => "1",
        (_, "--zone") => "0,0,100,20",
        (_, "--limit") => "0.9",
        (_, "--out") => "other-results",
        (_, "--shard") => "1/2",
        (_, "--port") => "/dev/nothing",
        (_, "--elf") => "image.elf",
        (_, "--only") => "service",
        (_, "--program") => "/usr/bin/era",
        (_, "--group" | "--flash-group") => "dialout",
        (_, "--record-file-mb") => "10",
        (_, "--record-total-mb") => "100",
        (_, "--root") => "root",
        (_, "--dir") => "man",
        _ => panic!("say what {option} of `era {command}` takes"),
    }
}

/// What has to be given beside an option as its help says, in place of what it does not go with.
fn instead_of_base(command: &str, option: &str) -> Option<&'static str> {
    Some(match (command, option) {
        (_, "--tolerance" | "--within") => "-accuracy",
        ("serve", "--tls-cert") => "--tls-key key.pem",
        ("serve", "--tls-key") => "--tls-cert cert.pem",
        // Of these effects.
        ("touch", "--count") | ("touch", "--period-ms") => "--effect pulse_train",
        ("effect", "--count" | "--period-ms") => "=--scene bar.toml --accuracy fast --at 480,80 --effect pulse_train",
        ("touch", "--crisp-ms" | "--prefer") => "--effect click",
        ("touch", "--format") => "--file click.toml",
        ("effect", "--crisp-ms" | "--prefer") => "=--scene bar.toml --accuracy fast --at 480,80 --effect click",
        ("effect", "--file") => "=--scene bar.toml --accuracy fast --at 480,80",
        ("effect", "--format" | "--export") => "=--scene bar.toml --accuracy fast --at 480,80 --file click.toml",
        ("plan", "--zone") => "--objective reach",
        ("field", "--effect" | "--reach" | "--schemes") => "=--scene bar.toml --accuracy fast",
        ("field", "--crisp-ms" | "--prefer") => "=--scene bar.toml --accuracy fast --effect click",
        ("field", "--zone" | "--from" | "--to") => "=--scene bar.toml --accuracy fast --reach",
        ("field", "--felt") => "=--scene bar.toml --accuracy fast --schemes",
        ("field", "--csv") => "",
        ("latency", "--first-clicks") => "=--scene bar.toml --accuracy fast",
        ("monitor", "--probe") => "=",
        ("flash", "--probe" | "--dfu") => "=image.elf --yes",
        ("doctor", "--device") => "=",
        _ => return None,
    })
}

/// The words after a command for one of its options.
fn call(command: &str, option: &str, takes_value: bool) -> Vec<String> {
    let mut all = base(command);
    match instead_of_base(command, option) {
        Some("-accuracy") => drop_option(&mut all, "--accuracy", true),
        Some(other) if other.starts_with('=') => all = words(&other[1..]),
        Some(more) => all.extend(words(more)),
        None => {}
    }
    // Given twice it would be refused for that; but where it may be given several times.
    drop_option(&mut all, option, takes_value);
    all.push(option.to_owned());
    all.extend(takes_value.then(|| value(command, option).to_owned()));
    filled(&all)
}

/// The words with the places that are known when the test runs only.
fn filled(words: &[String]) -> Vec<String> {
    static TAKEN: OnceLock<TcpListener> = OnceLock::new();
    let taken = TAKEN.get_or_init(|| TcpListener::bind("127.0.0.1:0").unwrap()).local_addr().unwrap().to_string();
    words.iter().map(|word| word.replace("NOBODY", NOBODY).replace("TAKEN", &taken)).collect()
}

fn drop_option(all: &mut Vec<String>, option: &str, takes_value: bool) {
    if let Some(at) = all.iter().position(|word| word == option) {
        all.drain(at..(at + 1 + usize::from(takes_value)).min(all.len()));
    }
}

fn scratch() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_owned();
    let write = |name: &str, text: &str| std::fs::write(path.join(name), text).unwrap();
    write("bar.toml", era::scene::EXAMPLE_BAR);
    write("click.toml", "version = 1\n[[events]]\nprimitive = \"click\"\n");
    write("day.jsonl", "{\"at_ms\":0.0,\"kind\":\"begin\",\"format\":1,\"scene\":\"bar\"}\n");
    write("study.toml", "version = 1\nscene = \"bar.toml\"\n");
    write("era.toml", "version = 1\n");
    write("image.elf", "no image");
    write("cert.pem", "none");
    write("key.pem", "none");
    write("token", "arm 0123456789abcdefghijklmnopqrstuvwxyz\n");
    std::fs::set_permissions(path.join("token"), std::fs::Permissions::from_mode(0o600)).unwrap();
    std::fs::create_dir(path.join("root")).unwrap();
    (folder, path)
}

/// Runs a check for each of many calls, on both processors.
fn each<T: Sync>(calls: &[T], check: impl Fn(&T) -> Result<(), String> + Sync) {
    let (next, wrong) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                while let Some(call) = calls.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if let Err(what) = check(call) {
                        wrong.lock().unwrap().push(what);
                    }
                }
            });
        }
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), calls.len(), wrong.join("\n"));
}

/// Whatever becomes of the command: it is not the option that is refused.
#[test]
fn every_option_of_the_help_is_taken() {
    let (_folder, path) = scratch();
    let commands = all_commands(&path);
    assert!(commands.len() > 20, "{:?}", commands.keys());
    let calls: Vec<(String, String, bool)> = commands
        .iter()
        .flat_map(|(command, options)| options.iter().map(move |(name, value)| (command.clone(), name.clone(), *value)))
        .filter(|(_, option, _)| option != "--help" && option != "--version")
        .collect();
    assert!(calls.len() > 150, "{}", calls.len());
    each(&calls, |(command, option, takes_value)| {
        let output = run_era_in_folder(&path, &[words(command), call(command, option, *takes_value)].concat());
        let told = &output.error;
        let is_refused = output.code == Some(2) && told.contains(option.as_str());
        let has_ended = output.code.is_some_and(|code| (0..=2).contains(&code));
        if has_ended && !is_refused { Ok(()) } else { Err(format!("era {command} {option}: {:?} {told}", output.code)) }
    });
}

/// What a command's help does not list it refuses, and names it.
#[test]
fn options_of_other_commands_are_refused() {
    let (_folder, path) = scratch();
    let commands = all_commands(&path);
    let all: BTreeSet<&String> = commands.values().flat_map(BTreeMap::keys).collect();
    let calls: Vec<(&String, &String)> = commands
        .iter()
        .flat_map(|(command, options)| {
            all.iter().filter(|option| !options.contains_key(**option)).map(move |o| (command, *o))
        })
        .filter(|(_, option)| *option != "--version")
        .collect();
    assert!(calls.len() > 500, "{}", calls.len());
    each(&calls, |(command, option)| {
        let output =
            run_era_in_folder(&path, &[words(command), vec![(*option).clone()], filled(&base(command))].concat());
        let told = &output.error;
        let is_refused =
            output.code == Some(2) && told.contains("unexpected argument") && told.contains(option.as_str());
        if is_refused { Ok(()) } else { Err(format!("era {command} {option}: {:?} {told}", output.code)) }
    });
}
