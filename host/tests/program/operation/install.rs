//! The files of `era install`, below a folder of the test's own.
#![cfg(target_os = "linux")]

use crate::support::program::{ERA, ProgramOutput, build_era_command, run_command, run_era};
use std::path::Path;

const RULE: &str = "etc/udev/rules.d/70-era.rules";
const UNIT: &str = "etc/systemd/system/era.service";

fn run_era_install(root: &Path, more: &[&str]) -> ProgramOutput {
    run_era(&[&["install", "--root", root.to_str().unwrap(), "--program", "/usr/bin/era"], more].concat())
}

#[test]
fn rule_and_unit_are_written_once_and_removed_again() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let first = run_era_install(root, &["--group", "haptics"]);
    assert!(first.is_success(), "{}", first.error);
    assert_eq!(first.out.matches("wrote ").count(), 2, "{}", first.out);
    let rule = std::fs::read_to_string(root.join(RULE)).unwrap();
    for words in ["1209", "0001", "df11", "GROUP=\"haptics\"", "uaccess", "ENV{ID_MM_DEVICE_IGNORE}=\"1\""] {
        assert!(rule.contains(words), "{words} in {rule}");
    }
    let unit = std::fs::read_to_string(root.join(UNIT)).unwrap();
    for line in [
        "Type=notify",
        "WatchdogSec=10",
        "Restart=on-failure",
        "LimitRTPRIO=20",
        "SupplementaryGroups=haptics",
        "ExecStart=/usr/bin/era serve --config /etc/era/era.toml",
    ] {
        assert!(unit.lines().any(|own| own == line), "{line} in {unit}");
    }
    let again = run_era_install(root, &["--group", "haptics"]).out;
    assert_eq!(again.matches("unchanged ").count(), 2, "{again}");
    let changed = run_era_install(root, &["--group", "haptics", "--config", "/srv/my panel.toml"]).out;
    assert!(changed.contains("unchanged ") && changed.contains("replaced "), "{changed}");
    let unit = std::fs::read_to_string(root.join(UNIT)).unwrap();
    assert!(unit.contains("serve --config \"/srv/my panel.toml\"\n"), "{unit}");
    // Of a package nothing is to be run now; and no half file is left.
    assert!(!changed.contains("udevadm"), "{changed}");
    assert_eq!(std::fs::read_dir(root.join("etc/systemd/system")).unwrap().count(), 1);
    let removed = run_era_install(root, &["--remove"]).out;
    assert_eq!(removed.matches("removed ").count(), 2, "{removed}");
    assert!(!root.join(RULE).exists() && !root.join(UNIT).exists());
    assert_eq!(run_era_install(root, &["--remove"]).out.matches("absent ").count(), 2);
}

#[test]
fn somebody_elses_files_are_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let unit = root.join(UNIT);
    std::fs::create_dir_all(unit.parent().unwrap()).unwrap();
    std::fs::write(&unit, "[Service]\n").unwrap();
    for more in [&[][..], &["--remove"]] {
        let output = run_era_install(root, more);
        let told = &output.error;
        assert!(output.code == Some(1) && told.contains("was not written by `era install`"), "{told}");
        assert_eq!(std::fs::read_to_string(&unit).unwrap(), "[Service]\n");
    }
    // Nothing is done by half.
    assert!(!root.join(RULE).exists());
    assert!(run_era_install(root, &["--force"]).is_success());
    assert!(std::fs::read_to_string(&unit).unwrap().contains("Type=notify"));
    // A unit that is masked is somebody's wish, too.
    std::fs::remove_file(&unit).unwrap();
    std::os::unix::fs::symlink("/dev/null", &unit).unwrap();
    assert_eq!(run_era_install(root, &[]).code, Some(1));
    assert!(unit.is_symlink());
}

#[test]
fn parts_can_be_had_one_by_one_and_looked_at() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let printed = run_era_install(root, &["--print"]).out;
    assert!(printed.contains("Type=notify") && printed.contains("uaccess") && printed.contains(RULE), "{printed}");
    assert_eq!(std::fs::read_dir(root).unwrap().count(), 0);
    assert!(run_era_install(root, &["--only", "rule"]).is_success());
    assert!(root.join(RULE).exists() && !root.join(UNIT).exists());
    let user = run_era_install(root, &["--user"]).out;
    assert!(user.contains("etc/systemd/user/era.service") && !user.contains("rules.d"), "{user}");
    let unit = std::fs::read_to_string(root.join("etc/systemd/user/era.service")).unwrap();
    assert!(unit.contains("WantedBy=default.target") && !unit.contains("DynamicUser"), "{unit}");
    assert_eq!(run_era_install(root, &["--user", "--only", "rule"]).code, Some(2));
    for group in ["", "a b", "-x", "a\"b"] {
        assert_eq!(run_era_install(root, &[&format!("--group={group}")]).code, Some(2), "{group}");
    }
}

/// Below the user's own folder nothing else than the unit is written, and what to run is said.
#[test]
fn a_user_is_told_what_to_run() {
    let home = tempfile::tempdir().unwrap();
    let mut command = build_era_command();
    let output = run_command(command.args(["install", "--user"]).env("XDG_CONFIG_HOME", home.path()));
    let (told, warned) = (&output.out, &output.error);
    assert!(output.is_success(), "{warned}");
    for words in ["systemctl --user daemon-reload", "systemctl --user enable --now era.service", "era config example >"]
    {
        assert!(told.contains(words), "{words} in {told}");
    }
    assert!(!told.contains("udevadm") && warned.contains("does not exist yet"), "{told} {warned}");
    assert!(home.path().join("systemd/user/era.service").is_file());
    assert!(told.contains("scene = \"panel.toml\", device = \"auto\""), "{told}");
}

/// What would look like a working service and is none.
#[test]
fn a_service_that_drives_no_board_or_a_program_of_a_build_is_reported() {
    let home = tempfile::tempdir().unwrap();
    let config = home.path().join("era/era.toml");
    std::fs::create_dir_all(config.parent().unwrap()).unwrap();
    let said = |content: &str, program: &str| {
        std::fs::write(&config, content).unwrap();
        let mut command = build_era_command();
        command.args(["install", "--user", "--program", program]).env("XDG_CONFIG_HOME", home.path());
        run_command(&mut command).error
    };
    let told = said("version = 1\n", "/opt/era/target/release/era");
    assert!(told.contains("drives the simulated device: set device = \"auto\""), "{told}");
    assert!(told.contains("sudo install -m 755 /opt/era/target/release/era /usr/local/bin/"), "{told}");
    let told = said("version = 1\ndevice = \"auto\"\n", "/usr/local/bin/era");
    assert!(!told.contains("simulated") && !told.contains("install -m"), "{told}");
    let record = |to: &str| said(&format!("version = 1\ndevice = \"auto\"\nrecord = \"{to}\"\n"), "/usr/local/bin/era");
    assert!(!record("/tmp/era-records/").contains("a second time"), "{}", record("/tmp/era-records/"));
}

/// Tokens and key, which only root may read, are handed over; what the service writes has its places.
#[test]
fn what_only_root_may_read_is_handed_to_the_service() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    std::fs::create_dir_all(root.join("etc/era")).unwrap();
    let configuration =
        "version = 1\ntoken_file = \"tokens\"\ntls_cert = \"cert.pem\"\ntls_key = \"/etc/ssl/era.pem\"\n";
    std::fs::write(root.join("etc/era/era.toml"), configuration).unwrap();
    assert!(run_era_install(root, &[]).is_success());
    let unit = std::fs::read_to_string(root.join(UNIT)).unwrap();
    for line in [
        "LoadCredential=tokens:/etc/era/tokens",
        "LoadCredential=key:/etc/ssl/era.pem",
        "ExecStart=/usr/bin/era serve --config /etc/era/era.toml --token-file ${CREDENTIALS_DIRECTORY}/tokens \
         --tls-key ${CREDENTIALS_DIRECTORY}/key --tls-cert /etc/era/cert.pem",
        "StateDirectory=era",
        "RuntimeDirectory=era",
        "CacheDirectory=era",
    ] {
        assert!(unit.lines().any(|own| own == line), "{line} in {unit}");
    }
    // The command line that the unit has is one that the program takes, and comes before the file.
    let credentials = tempfile::tempdir().unwrap();
    let run = unit.lines().find_map(|line| line.strip_prefix("ExecStart=/usr/bin/era ")).unwrap();
    let run = run.replace("${CREDENTIALS_DIRECTORY}", credentials.path().to_str().unwrap());
    let run = run.replace("/etc/era", root.join("etc/era").to_str().unwrap());
    let told = run_era(&run.split(' ').collect::<Vec<_>>()).error;
    assert!(told.contains(&format!("{}/tokens: ", credentials.path().display())), "{told}");
    // A user's service reads its user's files.
    assert!(run_era_install(root, &["--user"]).is_success());
    let unit = std::fs::read_to_string(root.join("etc/systemd/user/era.service")).unwrap();
    assert!(!unit.contains("LoadCredential") && !unit.contains("CREDENTIALS_DIRECTORY"), "{unit}");
}

/// systemd's own opinion of both units, with secrets and without.
#[test]
fn systemd_takes_the_units_and_finds_them_fenced_in() {
    let folder = tempfile::tempdir().unwrap();
    // A user's manager has a folder at run time.
    let analyze = |arguments: &[&str], unit: &Path| {
        std::process::Command::new("systemd-analyze")
            .args(arguments)
            .arg(unit)
            .env("SYSTEMD_LOG_LEVEL", "info")
            .env("XDG_RUNTIME_DIR", folder.path())
            .output()
            .map(ProgramOutput::from)
    };
    if analyze(&["--version"], Path::new("")).is_err() {
        assert!(std::env::var_os("CI").is_none(), "no systemd-analyze here: Debian's package systemd has it");
        eprintln!("skipped: no systemd-analyze here");
        return;
    }
    let root = folder.path();
    std::fs::create_dir_all(root.join("etc/era")).unwrap();
    let configuration =
        "version = 1\ntoken_file = \"my tokens\"\ntls_cert = \"100% $cert.pem\"\ntls_key = \"100% key.pem\"\n";
    for text_of_file in ["version = 1\n", configuration] {
        std::fs::write(root.join("etc/era/era.toml"), text_of_file).unwrap();
        for (more, path) in [(&[][..], UNIT), (&["--user"], "etc/systemd/user/era.service")] {
            // The program must be there.
            let own = [&["install", "--root", root.to_str().unwrap(), "--program", ERA], more];
            assert!(run_era(&own.concat()).is_success());
            let unit = root.join(path);
            let manager = if more.is_empty() { "--system" } else { "--user" };
            let verified = analyze(&["verify", "--man=no", manager], &unit).unwrap();
            let said = &verified.error;
            assert!(verified.is_success() && !said.contains("era.service"), "{said}");
            if more.is_empty() {
                // Of 100; an unfenced service has 96.
                let fenced = analyze(&["security", "--offline=yes", "--threshold=25", "--no-pager"], &unit).unwrap();
                assert!(fenced.is_success(), "{}{}", fenced.out, fenced.error);
            }
        }
    }
    // A mistake is told.
    let unit = root.join(UNIT);
    let wrong = std::fs::read_to_string(&unit).unwrap().replace("StateDirectory=era", "StateDirectory=../era");
    std::fs::write(&unit, wrong).unwrap();
    assert!(analyze(&["verify", "--man=no"], &unit).unwrap().error.contains("era.service"));
}

/// A folder for a package, named from where one stands: what the unit says is as it will be on the machine that gets it, and what will not
/// work there is told.
#[test]
fn a_package_is_staged_below_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let etc = folder.path().join("stage/etc/era");
    std::fs::create_dir_all(&etc).unwrap();
    std::fs::write(etc.join("era.toml"), "version = 1\ntoken_file = \"tokens\"\ntls_dir = \"/home/me/tls\"\n").unwrap();
    std::fs::write(etc.join("tokens"), format!("arm {}\n", "A".repeat(32))).unwrap();
    for more in [&[][..], &["--print"]] {
        let mut command = build_era_command();
        command.current_dir(folder.path()).args(["install", "--root", "stage", "--program", "/usr/bin/era"]).args(more);
        let output = run_command(&mut command);
        let told = &output.error;
        assert!(output.is_success(), "{told}");
        assert!(told.contains("`tls_dir` is /home/me/tls, but the service may write only below"), "{told}");
        assert!(told.contains("simulated"), "{told}");
        let unit = match more {
            [] => std::fs::read_to_string(folder.path().join("stage/etc/systemd/system/era.service")).unwrap(),
            _ => output.out,
        };
        assert!(unit.contains("LoadCredential=tokens:/etc/era/tokens\n"), "{unit}");
    }
}
