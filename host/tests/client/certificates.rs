//! Certificates and keys as `openssl` and others make them: which are trusted, and what is said of those that are no good.

use crate::support::Daemon;
use crate::support::program::{ProgramOutput, build_era_command, run_command, run_era};
use crate::support::served::Served;
use crate::{run_openssl, write_secret};
use era::daemon::listener::TlsFiles;
use era::daemon::{Access, Listener};
use era::scene::STARTING_PLATE;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio_rustls::rustls::crypto::ring::sign::any_supported_type;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::server::{ClientHello, ResolvesServerCert};
use tokio_rustls::rustls::sign::CertifiedKey;
use tokio_rustls::rustls::{ServerConfig, SignatureScheme};

const NAMES: &str = "-addext subjectAltName=DNS:localhost,IP:127.0.0.1";
const SECRET: &str = "TTTTTTTTTTTTTTTTTTTTTTTTTTTTTTTT";

/// The kinds of keys that `openssl req -newkey` makes and TLS takes.
const KINDS: [&str; 4] =
    ["rsa:2048", "ec -pkeyopt ec_paramgen_curve:prime256v1", "ec -pkeyopt ec_paramgen_curve:secp384r1", "ed25519"];

/// A certificate of `openssl req -x509`, which says of itself that it may sign others (CA:TRUE), in `name.pem` and `name.key`.
fn make_self_signed(folder: &Path, name: &str, kind: &str, more: &str) -> TlsFiles {
    let line = format!(
        "req -x509 -newkey {kind} -nodes -keyout {name}.key -out {name}.pem -days 30 -subj /CN=localhost {more}"
    );
    run_openssl(folder, line.trim());
    files_named(folder, name)
}

fn files_named(folder: &Path, name: &str) -> TlsFiles {
    let files = TlsFiles { certificate: folder.join(format!("{name}.pem")), key: folder.join(format!("{name}.key")) };
    #[cfg(unix)]
    std::fs::set_permissions(&files.key, std::os::unix::fs::PermissionsExt::from_mode(0o600)).unwrap();
    files
}

/// A daemon at a port for each of the certificates, and where those are.
fn serve_over_tls(all: &[TlsFiles]) -> (Served, Vec<u16>) {
    let app = Arc::new(Daemon::app(STARTING_PLATE, Access::default()));
    let mut ports = Vec::new();
    let served = Served::on(&app, async {
        let mut listeners = Vec::new();
        for files in all {
            let listener = Listener::bind_tcp("127.0.0.1:0".parse().unwrap(), Some(files), false).await.unwrap();
            ports.push(listener.url().rsplit_once(':').unwrap().1.parse().unwrap());
            listeners.push(listener);
        }
        listeners
    });
    (served, ports)
}

fn ask_state(host: &str, port: u16, ca: &Path) -> ProgramOutput {
    run_era(&["state", "--url", &format!("https://{host}:{port}"), "--ca", ca.to_str().unwrap()])
}

/// What `openssl req -x509` makes is trusted where it is given itself, for its names and for no others.
#[test]
fn a_certificate_that_openssl_made_is_trusted_when_given() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut all: Vec<TlsFiles> =
        KINDS.iter().enumerate().map(|(i, kind)| make_self_signed(path, &format!("kind{i}"), kind, NAMES)).collect();
    // The same that may sign nothing, and one without names of hosts.
    all.push(make_self_signed(path, "leaf", KINDS[1], &format!("{NAMES} -addext basicConstraints=critical,CA:FALSE")));
    all.push(make_self_signed(path, "nameless", KINDS[1], ""));
    // One that an authority has signed, whose certificate is given instead.
    make_self_signed(path, "authority", KINDS[1], "");
    run_openssl(
        path,
        "req -new -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -keyout signed.key -out signed.csr -subj /CN=x",
    );
    std::fs::write(path.join("names"), "subjectAltName=DNS:localhost,IP:127.0.0.1\n").unwrap();
    run_openssl(
        path,
        "x509 -req -in signed.csr -CA authority.pem -CAkey authority.key -CAcreateserial -days 30 -extfile names -out signed.pem",
    );
    all.push(files_named(path, "signed"));
    // Somebody else's, with the names of the first.
    let other = make_self_signed(path, "other", KINDS[1], NAMES);
    let (_served, ports) = serve_over_tls(&all);
    for (files, port) in all.iter().zip(&ports) {
        let is_signed = files.certificate.ends_with("signed.pem");
        let ca = if is_signed { path.join("authority.pem") } else { files.certificate.clone() };
        let name = files.certificate.file_name().unwrap();
        for host in ["localhost", "127.0.0.1"] {
            let said = ask_state(host, *port, &ca);
            assert_eq!(said.code, Some(0), "{name:?} {host}: {}", said.error);
        }
        let said = ask_state("other.localhost", *port, &ca);
        let is_nameless = files.certificate.ends_with("nameless.pem");
        assert!(is_nameless || said.code == Some(1) && said.error.contains("other names"), "{name:?}: {}", said.error);
        let said = ask_state("localhost", *port, &other.certificate);
        assert!(said.code == Some(1) && said.error.contains("although --ca is given"), "{name:?}: {}", said.error);
        let said = run_era(&["state", "--url", &format!("https://localhost:{port}")]);
        assert!(said.code == Some(1) && said.error.contains("is not trusted"), "{name:?}: {}", said.error);
        // The live socket trusts as requests do.
        let recording = path.join("day.jsonl");
        crate::write_recording(&recording);
        let (url, ca) = (format!("https://localhost:{port}"), ca.to_str().unwrap());
        let said = run_era(&["replay", recording.to_str().unwrap(), "--url", &url, "--ca", ca, "--json"]);
        assert!(said.out.contains("\"messages_lost\":0"), "{name:?}: {} {}", said.out, said.error);
    }
    // Several in one file, in any order, and what else a file has in it.
    let bundle = path.join("bundle.pem");
    let text = |name: &str| std::fs::read_to_string(path.join(name)).unwrap();
    std::fs::write(
        &bundle,
        format!("of the kiosk\n{}{}{}", text("other.pem"), text("authority.pem"), text("kind0.pem")),
    )
    .unwrap();
    for (files, port) in all.iter().zip(&ports) {
        let is_in = files.certificate.ends_with("kind0.pem") || files.certificate.ends_with("signed.pem");
        assert_eq!(
            ask_state("localhost", *port, &bundle).code,
            Some(if is_in { 0 } else { 1 }),
            "{:?}",
            files.certificate
        );
    }
}

/// A certificate is known to everybody: who shows it must have its key, too.
#[test]
fn a_trusted_certificate_without_its_key_is_no_good() {
    #[derive(Debug)]
    struct Impostor(Arc<CertifiedKey>);
    impl ResolvesServerCert for Impostor {
        fn resolve(&self, hello: ClientHello<'_>) -> Option<Arc<CertifiedKey>> {
            assert!(hello.signature_schemes().contains(&SignatureScheme::ECDSA_NISTP256_SHA256));
            Some(Arc::clone(&self.0))
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let own = make_self_signed(folder.path(), "own", KINDS[1], NAMES);
    let other = make_self_signed(folder.path(), "other", KINDS[1], NAMES);
    let chain = vec![CertificateDer::from_pem_file(&own.certificate).unwrap()];
    let key = any_supported_type(&PrivateKeyDer::from_pem_file(&other.key).unwrap()).unwrap();
    let impostor = Impostor(Arc::new(CertifiedKey::new(chain, key)));
    for versions in [&[&tokio_rustls::rustls::version::TLS12], &[&tokio_rustls::rustls::version::TLS13]] {
        let config = ServerConfig::builder_with_protocol_versions(versions).with_no_client_auth();
        let daemon =
            crate::servers::Server::tls_daemon(config.with_cert_resolver(Arc::new(Impostor(Arc::clone(&impostor.0)))));
        let url = format!("https://localhost:{}", daemon.address.port());
        let mut command = build_era_command();
        command.args(["stop", "--url", &url, "--ca"]).arg(&own.certificate).env("ERA_TOKEN", SECRET);
        let said = run_command(&mut command);
        assert!(said.code == Some(1) && daemon.received().iter().all(|seen| !seen.contains(SECRET)), "{}", said.error);
    }
}

/// A certificate with the given years, for localhost.
fn make_dated(folder: &Path, name: &str, from: i32, to: i32) -> TlsFiles {
    let mut wanted = rcgen::CertificateParams::new(vec!["localhost".into()]).unwrap();
    wanted.not_before = rcgen::date_time_ymd(from, 1, 2);
    wanted.not_after = rcgen::date_time_ymd(to, 3, 4);
    let key = rcgen::KeyPair::generate().unwrap();
    std::fs::write(folder.join(format!("{name}.pem")), wanted.self_signed(&key).unwrap().pem()).unwrap();
    std::fs::write(folder.join(format!("{name}.key")), key.serialize_pem()).unwrap();
    files_named(folder, name)
}

/// Dates are told as dates, with what to do, by whoever is shown the certificate.
#[test]
fn a_client_reports_the_dates_of_a_certificate() {
    let folder = tempfile::tempdir().unwrap();
    let all = [make_dated(folder.path(), "old", 2019, 2020), make_dated(folder.path(), "new", 2091, 2092)];
    let (_served, ports) = serve_over_tls(&all);
    for ((files, port), words) in
        all.iter().zip(ports).zip(["expired on 2020-03-04 00:00", "is not valid before 2091-01-02 00:00"])
    {
        for command in ["state", "stop", "doctor --device sim"] {
            let (url, ca) = (format!("https://localhost:{port}"), files.certificate.to_str().unwrap());
            let arguments: Vec<&str> = command.split(' ').chain(["--url", &url, "--ca", ca]).collect();
            let said = run_era(&arguments);
            let told = format!("{}{}", said.out, said.error);
            assert!(told.contains(words) && told.contains("clock"), "{command}: {told}");
            assert!(!told.contains("UNIX") && !told.contains("although --ca is given"), "{command}: {told}");
        }
    }
}

/// What `era config check`, `era doctor` and `era serve` say of a certificate and key.
struct Judged {
    checked: ProgramOutput,
    served: ProgramOutput,
    doctor: ProgramOutput,
}

/// With a socket that is taken, so that the daemon ends once it has read all files.
fn judge_files(folder: &Path, keys: &str) -> Judged {
    let (config, socket) = (folder.join("era.toml"), folder.join("taken.sock"));
    let _ = std::fs::remove_file(&socket);
    let _taken = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    let text = format!("version = 1\nlisten = \"127.0.0.1:0\"\nsocket = \"taken.sock\"\n{keys}\n");
    std::fs::write(&config, text).unwrap();
    let name = config.to_str().unwrap();
    Judged {
        checked: run_era(&["config", "check", name]),
        served: run_era(&["serve", "--config", name]),
        doctor: run_era(&["doctor", "--device", "sim", "--config", name]),
    }
}

fn keys_of(files: &TlsFiles) -> String {
    format!("tls_cert = \"{}\"\ntls_key = \"{}\"", files.certificate.display(), files.key.display())
}

/// Certificates that are out of their time: the check and the doctor call that a mistake; the start tells it and serves, as the clock of a
/// machine that has just come up may be wrong.
#[test]
fn dates_are_reported_before_anybody_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let chained = make_dated(path, "chained", 2019, 2092);
    let (old, new) = (make_dated(path, "old", 2019, 2020), make_dated(path, "new", 2091, 2092));
    let text = |files: &TlsFiles| std::fs::read_to_string(&files.certificate).unwrap();
    std::fs::write(&chained.certificate, text(&chained) + &text(&old)).unwrap();
    std::fs::create_dir(path.join("tls")).unwrap();
    std::fs::copy(&old.certificate, path.join("tls/era-cert.pem")).unwrap();
    std::fs::copy(&old.key, path.join("tls/era-key.pem")).unwrap();
    for (keys, words) in [
        (keys_of(&old), "expired on 2020-03-04 00:00"),
        (keys_of(&new), "is not valid before 2091-01-02 00:00"),
        (keys_of(&chained), "expired on 2020-03-04 00:00"),
        ("tls_dir = \"tls\"".into(), "expired on 2020-03-04 00:00"),
    ] {
        let Judged { checked, served, doctor } = judge_files(path, &keys);
        let place = format!("{}:4: ", path.join("era.toml").display());
        assert!(checked.code == Some(2) && checked.error.contains(words), "{keys}: {}", checked.error);
        assert!(checked.error.contains(&place) && !checked.error.contains("UNIX"), "{keys}: {}", checked.error);
        assert!(doctor.out.contains(words) && doctor.code == Some(1), "{keys}: {}", doctor.out);
        assert!(served.error.contains(words) && served.code == Some(1), "{keys}: {}", served.error);
        assert!(served.error.contains("another daemon listens on the socket"), "{keys}: {}", served.error);
    }
    let Judged { checked, served, .. } = judge_files(path, &keys_of(&make_dated(path, "good", 2019, 2092)));
    assert!(checked.code == Some(0) && !served.error.contains("expired"), "{}{}", checked.error, served.error);
}

/// Certificates and keys that cannot be used: what is wrong with which file, and what to do, from the check, the doctor and the start.
#[test]
fn what_is_wrong_with_a_certificate_or_key_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let good = make_self_signed(path, "good", KINDS[0], NAMES);
    let other = make_self_signed(path, "other", KINDS[0], NAMES);
    let text = |file: &PathBuf| std::fs::read_to_string(file).unwrap();
    let with_key = |name: &str, bytes: &[u8]| {
        write_secret(&path.join(name), bytes);
        TlsFiles { certificate: good.certificate.clone(), key: path.join(name) }
    };
    let with_certificate = |name: &str, bytes: &[u8]| {
        std::fs::write(path.join(name), bytes).unwrap();
        TlsFiles { certificate: path.join(name), key: good.key.clone() }
    };
    run_openssl(path, "pkey -in good.key -aes256 -passout pass:word -out locked.key");
    run_openssl(path, "rsa -in good.key -traditional -aes256 -passout pass:word -out locked_old.key");
    run_openssl(path, "pkey -in good.key -pubout -out public.key");
    run_openssl(path, "pkey -in good.key -outform der -out der.key");
    run_openssl(path, "x509 -in good.pem -outform der -out der.pem");
    run_openssl(path, "genrsa -out small.key 1024");
    run_openssl(path, "req -x509 -key small.key -out small.pem -days 30 -subj /CN=localhost");
    let read = |name: &str| std::fs::read(path.join(name)).unwrap();
    let key = text(&good.key);
    let certificate = text(&good.certificate);
    let half = |text: &str| text[..text.len() / 2].to_owned();
    let spoiled = |text: &str| text.replacen("\nMII", "\n\u{a7}II", 1);
    let (small_certificate, small_key) = (read("small.pem"), read("small.key"));
    write_secret(&path.join("small2.key"), &small_key);
    std::fs::write(path.join("small2.pem"), &small_certificate).unwrap();
    let cases: Vec<(TlsFiles, &[&str])> = vec![
        (with_key("a.key", &read("locked.key")), &["a.key", "encrypted", "openssl pkey -in"]),
        (with_key("b.key", &read("locked_old.key")), &["b.key", "encrypted", "openssl pkey -in"]),
        (with_key("c.key", text(&other.key).as_bytes()), &["c.key", "does not belong to", "good.pem"]),
        (with_key("d.key", b""), &["d.key", "is empty"]),
        (with_key("e.key", half(&key).as_bytes()), &["e.key", "damaged"]),
        (with_key("f.key", spoiled(&key).as_bytes()), &["f.key", "damaged"]),
        (with_key("g.key", &read("public.key")), &["g.key", "public key", "private key"]),
        (with_key("h.key", &read("der.key")), &["h.key", "PEM", "openssl pkey -in"]),
        (with_key("i.key", certificate.as_bytes()), &["i.key", "certificate", "private key"]),
        (with_key("j.key", b"secret\n"), &["j.key", "no private key", "PEM"]),
        (with_certificate("k.pem", b""), &["k.pem", "is empty"]),
        (with_certificate("l.pem", half(&certificate).as_bytes()), &["l.pem", "damaged"]),
        (with_certificate("m.pem", spoiled(&certificate).as_bytes()), &["m.pem", "damaged"]),
        (with_certificate("n.pem", &read("der.pem")), &["n.pem", "PEM", "openssl x509 -in"]),
        (with_certificate("o.pem", key.as_bytes()), &["o.pem", "private key", "certificate"]),
        (with_certificate("p.pem", b"hello\n"), &["p.pem", "no certificate", "PEM"]),
        // Base64 that is no certificate.
        (
            with_certificate("q.pem", b"-----BEGIN CERTIFICATE-----\naGVsbG8gd29ybGQ=\n-----END CERTIFICATE-----\n"),
            &["q.pem", "damaged"],
        ),
        (files_named(path, "small2"), &["small2.key", "2048"]),
    ];
    for (files, words) in cases {
        let Judged { checked, served, doctor } = judge_files(path, &keys_of(&files));
        let place = format!("{}:", path.join("era.toml").display());
        assert!(checked.code == Some(2) && checked.error.contains(&place), "{files:?}: {}", checked.error);
        assert!(served.code == Some(2) && doctor.code == Some(1), "{files:?}: {}{}", served.error, doctor.out);
        for word in words {
            for told in [&checked.error, &served.error, &doctor.out] {
                assert!(told.contains(word), "{files:?}: {word:?} not in {told}");
            }
        }
        assert!(!served.error.contains("PRIVATE KEY-----"), "{}", served.error);
    }
    // And the other way round: the daemon's own certificate behind others in its file.
    let chain = path.join("turned.pem");
    std::fs::write(&chain, text(&other.certificate) + &certificate).unwrap();
    let turned = TlsFiles { certificate: chain, key: good.key.clone() };
    let told = judge_files(path, &keys_of(&turned)).checked.error;
    assert!(told.contains("does not belong to") && told.contains("first"), "{told}");
    let Judged { checked, served, .. } = judge_files(path, &keys_of(&good));
    assert!(checked.code == Some(0) && served.code == Some(1), "{}{}", checked.error, served.error);
}
