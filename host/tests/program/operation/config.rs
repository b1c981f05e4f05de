//! The daemon's configuration file on the command line.

use crate::support::program::{run_era, run_era_json};
use serde_json::Value;

#[test]
fn what_would_be_used_is_reported_with_where_it_comes_from() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("era.toml");
    std::fs::write(folder.path().join("panel.toml"), era::scene::STARTING_PLATE).unwrap();
    std::fs::write(&file, "version = 1\n\nscene = \"panel.toml\"\nlisten = \"127.0.0.1:9000\"\n").unwrap();
    let name = file.to_str().unwrap();
    let output = run_era(&["config", "check", name]);
    let told = &output.out;
    assert!(output.is_success() && told.contains("can be used"), "{told}");
    let line = |key: &str| told.lines().find(|line| line.starts_with(key)).unwrap().to_owned();
    assert!(line("listen").contains("127.0.0.1:9000") && line("listen").ends_with("line 4"));
    assert!(line("device").contains("sim") && line("device").ends_with("default"));
    let json = run_era_json(&["config", "check", name, "--json"]);
    let scene = json["settings"].as_array().unwrap().iter().find(|it| it["key"] == "scene").unwrap();
    assert_eq!((&scene["line"], json["mistakes"].as_array().unwrap().len()), (&Value::from(3), 0));
    // Values begin and end in the same column; that no board is driven is said.
    let rows = || told.lines().filter(|line| line.ends_with("default") || line.contains("  line "));
    let column = |line: &str| line.rfind("  ").unwrap();
    assert!(rows().count() > 15 && rows().all(|line| column(line) == column(rows().next().unwrap())), "{told}");
    assert!(told.contains("drives the simulated device: set device = \"auto\"") && json["drives_simulation"] == true);
    std::fs::write(&file, "version = 1\ndevice = \"auto\"\n").unwrap();
    assert!(!run_era(&["config", "check", name]).out.contains("simulated device:"));
    // What `config example` prints can be read.
    std::fs::write(&file, run_era(&["config", "example"]).out).unwrap();
    assert!(run_era(&["config", "check", name]).is_success());
}

#[test]
fn mistakes_are_reported_with_their_lines_by_check_and_by_serve() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("era.toml");
    let name = file.to_str().unwrap();
    std::fs::write(&file, "version = 1\nlisten = \"nowhere\"\nsceen = \"x\"\n").unwrap();
    for arguments in [&["config", "check", name][..], &["serve", "--config", name]] {
        let output = run_era(arguments);
        let told = &output.error;
        assert_eq!(output.code, Some(2), "{told}");
        assert!(told.contains(&format!("{name}:2: listen is \"nowhere\", but must be a text with a host")), "{told}");
        assert!(told.contains(&format!("{name}:3: unknown key `sceen`")), "{told}");
    }
    let json = run_era(&["config", "check", name, "--json"]).parse_json();
    assert_eq!(json["mistakes"][1]["line"], 3);
    // A missing scene is told together with the others.
    std::fs::write(&file, "version = 1\nscene = \"none.toml\"\nlisten = \"nowhere\"\n").unwrap();
    let told = run_era(&["config", "check", name]).error;
    assert!(told.contains(&format!("{name}:2: ")) && told.contains(&format!("{name}:3: listen")), "{told}");
    // A scene that cannot be read belongs to the line that names it.
    std::fs::write(&file, "version = 1\nscene = \"none.toml\"\n").unwrap();
    let output = run_era(&["config", "check", name]);
    let told = &output.error;
    assert!(output.code == Some(2) && told.contains(&format!("{name}:2: ")), "{told}");
    assert!(told.contains("none.toml: cannot read the scene file"), "{told}");
    let output = run_era(&["config", "check", "/nowhere/era.toml"]);
    assert!(output.code == Some(2) && output.error.contains("cannot read the configuration file"));
}

/// The file's port is taken; the command line's is not. Both are told before any panel is computed.
#[test]
fn serve_takes_the_file_and_the_command_line_before_it() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("era.toml");
    let name = file.to_str().unwrap();
    std::fs::write(&file, format!("version = 1\nlisten = \"{address}\"\ndevice = \"/dev/none\"\n")).unwrap();
    let output = run_era(&["serve", "--config", name]);
    let told = &output.error;
    assert!(output.code == Some(1) && told.contains(&format!("cannot listen on {address}")), "{told}");
    let other = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = other.local_addr().unwrap().to_string();
    let output = run_era(&["-v", "serve", "--config", name, "--listen", &address, "--accuracy", "fast"]);
    let told = &output.error;
    assert!(output.code == Some(1) && told.contains(&format!("cannot listen on {address}")), "{told}");
    assert!(
        told.contains("listen: an option on the command line overrides") && told.contains("device = \"/dev/none\""),
        "{told}"
    );
}

/// With what `era serve` does not start, `era config check` and `era doctor` do not call good; and what does not start leaves nothing behind.
#[cfg(unix)]
#[test]
fn what_serve_refuses_check_and_doctor_refuse() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let write = |name: &str, text: &str, mode: u32| {
        std::fs::write(path(name), text).unwrap();
        std::fs::set_permissions(path(name), std::fs::Permissions::from_mode(mode)).unwrap();
    };
    let secret = "A".repeat(24);
    write("good", &format!("arm {secret}\n"), 0o600);
    write("open", &format!("arm {secret}\n"), 0o644);
    write("short", "arm short\n", 0o600);
    write("role", &format!("boss {secret}\n"), 0o600);
    // A whole certificate, which clients may have been given; a damaged one would be replaced.
    std::fs::remove_file(era::daemon::listener::find_or_make_certificate(&path("alone"), &[]).unwrap().key).unwrap();
    let outside = "listen = \"0.0.0.0:0\"\n";
    for (more, line, words) in [
        (outside.to_owned(), 3, "is not a loopback address"),
        (format!("{outside}tls_dir = \"tls\"\n"), 3, "is not a loopback address"),
        (format!("{outside}token_file = \"good\"\n"), 3, "is not a loopback address"),
        ("token_file = \"none\"\n".into(), 3, "none: "),
        ("token_file = \"open\"\n".into(), 3, "its mode is 0644"),
        ("token_file = \"short\"\n".into(), 3, "line 1: the secret must have"),
        ("token_file = \"role\"\ntls_dir = \"tls\"\n".into(), 3, "line 1: the first word must be a role"),
        ("tls_dir = \"alone\"\n".into(), 3, "is missing, but"),
        ("tls_cert = \"none.pem\"\ntls_key = \"good\"\n".into(), 3, "none.pem"),
        // Plain HTTP, where somebody wanted TLS.
        ("tls_cert = \"none.pem\"\n".into(), 3, "but tls_key, the private key of this certificate, is missing"),
        ("tls_key = \"good\"\n".into(), 3, "but tls_cert, the certificate of this key, is missing"),
        ("record = \"good\"\n".into(), 3, "never replaces a file"),
        ("record = \"nowhere/run.jsonl\"\n".into(), 3, "nowhere\" does not exist. Name a new file"),
        ("socket = \"good\"\n".into(), 2, "cannot listen on the socket"),
        (format!("socket = \"{}\"\n", "s".repeat(200)), 2, "cannot listen on the socket"),
    ] {
        let file = path("era.toml");
        let none = if more.contains("socket") { "" } else { "socket = \"none\"\n" };
        std::fs::write(&file, format!("version = 1\n{none}{more}")).unwrap();
        let name = file.to_str().unwrap();
        let served = run_era(&["serve", "--config", name]);
        let told = &served.error;
        assert!(served.code == Some(2) && told.contains(words), "{more}: {told}");
        let checked = run_era(&["config", "check", name]);
        let told = &checked.error;
        let place = format!("{name}:{line}: ");
        assert!(checked.code == Some(2) && told.contains(&place) && told.contains(words), "{more}: {told}");
        let doctor = run_era(&["doctor", "--config", name, "--device", "sim", "--json"]);
        let found: Value = doctor.parse_json();
        let config = found["findings"].as_array().unwrap().iter().find(|finding| finding["check"] == "config").unwrap();
        assert!(config["verdict"] == "problem" && config["found"].as_str().unwrap().contains(words), "{config}");
        assert!(!path("tls").exists(), "{more}: a certificate was made");
    }
}

/// A daemon that somebody names is expected to answer.
#[test]
fn a_named_daemon_that_is_not_there_is_a_problem() {
    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let output = run_era(&["doctor", "--device", "sim", "--json", "--url", &free]);
    let found: Value = output.parse_json();
    let daemon = found["findings"].as_array().unwrap().iter().find(|finding| finding["check"] == "daemon").unwrap();
    assert!(daemon["verdict"] == "problem" && output.code == Some(1), "{found}");
}
