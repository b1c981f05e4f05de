//! What the environment says of proxies, certificates, keys and logs: it redirects no request and learns no secret.

use crate::servers::Server;
use crate::support::program::{PROXY_VARIABLES, ProgramOutput, build_era_command, run_command, run_era};
use crate::{asking_commands, run_openssl, write_recording, write_secret};
use std::path::Path;
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};

const SECRET: &str = "TTTTTTTTTTTTTTTTTTTTTTTTTTTTTTTT";

/// A key and a certificate for localhost in a folder: `key.pem` and `cert.pem`.
fn make_certificate(folder: &Path) {
    run_openssl(
        folder,
        "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -keyout key.pem -out cert.pem -days 30 -subj /CN=era \
         -addext subjectAltName=DNS:localhost,IP:127.0.0.1",
    );
}

/// A daemon over TLS with the files of [`make_certificate`].
fn tls_daemon(folder: &Path) -> Server {
    let chain = vec![CertificateDer::from_pem_file(folder.join("cert.pem")).unwrap()];
    let key = PrivateKeyDer::from_pem_file(folder.join("key.pem")).unwrap();
    Server::tls_daemon(ServerConfig::builder().with_no_client_auth().with_single_cert(chain, key).unwrap())
}

/// Whatever libraries take for a proxy, every command goes to the daemon itself.
#[test]
fn no_variable_leads_a_request_to_a_proxy() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("day.jsonl");
    write_recording(&recording);
    let proxy = Server::proxy();
    for (i, arguments) in asking_commands(&recording).iter().enumerate() {
        let alone = PROXY_VARIABLES.iter().map(|name| ("http", std::slice::from_ref(name)));
        for (scheme, variables) in alone.chain([("http", PROXY_VARIABLES.as_slice()), ("socks5", &PROXY_VARIABLES)]) {
            // Each variable by itself with one command, and all together with every one.
            if i == 0 || variables.len() > 1 {
                let daemon = Server::daemon();
                let mut command = build_era_command();
                command.args(arguments).args(["--url", &daemon.url()]).env("ERA_TOKEN", SECRET);
                command.envs(variables.iter().map(|name| (*name, format!("{scheme}://{}", proxy.address))));
                // Of programs behind a web server (CGI), by which some libraries leave HTTP_PROXY alone.
                command.env_remove("REQUEST_METHOD").env("NO_PROXY", "");
                let said = run_command(&mut command);
                let received = daemon.received();
                assert_eq!(said.code, Some(0), "{variables:?} {arguments:?}: {}", said.error);
                let is_whole = |request: &String| request.contains(&format!("uthorization: Bearer {SECRET}"));
                assert!(!received.is_empty() && received.iter().any(is_whole), "{variables:?} {arguments:?}");
            }
        }
    }
    assert_eq!(proxy.received(), Vec::<String>::new());
}

/// What measures with a daemon of its own asks that daemon.
#[test]
fn no_variable_leads_a_measurement_to_a_proxy() {
    let proxy = Server::proxy();
    let mut command = build_era_command();
    command.args(["latency", "--touches", "1", "--accuracy", "fast"]);
    command.envs(PROXY_VARIABLES.map(|name| (name, format!("http://{}", proxy.address))));
    let said = run_command(&mut command);
    // It fails where the machine is too busy for its device; it has asked its daemon in any case.
    assert!(proxy.received().is_empty() && said.code != Some(2), "{}", said.error);
}

/// A proxy that an option names sees where a request goes, and nothing else of it.
#[test]
fn a_named_proxy_sees_no_token() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, ca) = (folder.path().join("day.jsonl"), folder.path().join("cert.pem"));
    write_recording(&recording);
    make_certificate(folder.path());
    for arguments in asking_commands(&recording) {
        let (daemon, proxy) = (tls_daemon(folder.path()), Server::proxy());
        let url = format!("https://localhost:{}", daemon.address.port());
        let mut command = build_era_command();
        command.args(&arguments).args(["--url", &url, "--proxy", &proxy.url(), "--ca"]).arg(&ca);
        let said = run_command(command.env("ERA_TOKEN", SECRET));
        assert_eq!(said.code, Some(0), "{arguments:?}: {}", said.error);
        let (through, received) = (proxy.received(), daemon.received());
        assert!(through.len() == received.len() && !through.is_empty(), "{arguments:?}");
        for seen in through {
            let place = format!("localhost:{}", daemon.address.port());
            assert!(seen.starts_with(&format!("CONNECT {place} HTTP/1.1\r\nHost: {place}\r\n\r\n")), "{seen:?}");
            assert!(!["TTTT", "Bearer", "POST", "GET"].iter().any(|word| seen.contains(word)), "{seen:?}");
        }
        assert!(received.iter().any(|request| request.contains(SECRET)), "{arguments:?}");
    }
    // Without TLS the proxy would read the token: nothing is sent anywhere.
    for arguments in asking_commands(&recording) {
        let (daemon, proxy) = (Server::daemon(), Server::proxy());
        let mut command = build_era_command();
        command.args(&arguments).args(["--url", &daemon.url(), "--proxy", &proxy.url()]).env("ERA_TOKEN", SECRET);
        let said = run_command(&mut command);
        assert!(said.code == Some(2) && said.error.contains("https://"), "{arguments:?}: {}", said.error);
        assert!(proxy.received().is_empty() && daemon.received().is_empty() && !said.error.contains(SECRET));
    }
    // Without a token there is nothing to read.
    let (daemon, proxy) = (Server::daemon(), Server::proxy());
    let said = run_era(&["stop", "--url", &daemon.url(), "--proxy", &proxy.url()]);
    assert!(said.code == Some(0) && proxy.received().len() == 1, "{}", said.error);
    assert!(daemon.received()[0].starts_with("POST /v1/stop "));
}

/// What is wrong with a proxy is told as that, and not as the daemon's absence.
#[test]
fn a_proxy_that_refuses_is_reported() {
    for (answer, words) in [
        ("HTTP/1.1 403 Forbidden\r\n\r\n", "403"),
        ("HTTP/1.1 407 Proxy Authentication Required\r\nProxy-Authenticate: Basic\r\n\r\n", "407"),
        ("SSH-2.0-OpenSSH_9.2\r\n\r\n", "gave no HTTP/1 answer"),
        ("", "gave no HTTP/1 answer"),
    ] {
        let proxy = Server::answering(answer);
        let said = run_era(&["stop", "--url", "https://panel.example:7878", "--proxy", &proxy.url()]);
        let names = format!("the proxy {}", proxy.address);
        assert!(said.code == Some(1) && said.error.contains(&names), "{answer:?}: {}", said.error);
        assert!(
            said.error.contains(words) && !said.error.contains("Check that the daemon runs"),
            "{answer:?}: {}",
            said.error
        );
    }
    for (wrong, words) in [
        ("socks5://127.0.0.1:9", "http://HOST:PORT"),
        ("https://127.0.0.1:9", "http://HOST:PORT"),
        ("http://me:secret@127.0.0.1:9", "http://HOST:PORT"),
        ("http://127.0.0.1", "http://HOST:PORT"),
    ] {
        let said = run_era(&["stop", "--proxy", wrong]);
        assert!(said.code == Some(2) && said.error.contains(words), "{wrong}: {}", said.error);
        assert!(!said.error.contains("secret"), "{}", said.error);
    }
    // The daemon's own address, as copied from a browser or with a password: the stop would go elsewhere, and what is secret is not repeated.
    for wrong in
        ["http://127.0.0.1:9/#token=secret", "http://127.0.0.1:9?secret", "me:secret@127.0.0.1:9", "ftp://me:secret@a"]
    {
        let said = run_era(&["stop", "--url", wrong]);
        assert!(said.code == Some(2) && said.error.contains("http://"), "{wrong}: {}", said.error);
        assert!(!said.error.contains("secret"), "{}", said.error);
    }
}

/// Certificates and keys are those of the options: no variable adds one to be trusted, or has the connection's keys written down.
#[test]
fn no_variable_adds_trust_or_writes_keys() {
    let folder = tempfile::tempdir().unwrap();
    make_certificate(folder.path());
    let daemon = tls_daemon(folder.path());
    let (ca, keys) = (folder.path().join("cert.pem"), folder.path().join("keys.log"));
    let url = format!("https://localhost:{}", daemon.address.port());
    let asked = |own: bool| -> ProgramOutput {
        let mut command = build_era_command();
        command.args(["state", "--url", &url]).env("ERA_TOKEN", SECRET);
        if own {
            command.arg("--ca").arg(&ca);
        }
        for name in ["SSL_CERT_FILE", "CURL_CA_BUNDLE", "REQUESTS_CA_BUNDLE"] {
            command.env(name, &ca);
        }
        run_command(command.env("SSL_CERT_DIR", folder.path()).env("SSLKEYLOGFILE", &keys))
    };
    let said = asked(false);
    assert!(said.code == Some(1) && said.error.contains("is not trusted"), "{}", said.error);
    assert!(daemon.received().iter().all(|request| !request.contains(SECRET)));
    assert_eq!(asked(true).code, Some(0));
    assert!(!keys.exists(), "the keys of a connection were written down");
}

/// A log is shown to others, and kept.
#[test]
fn no_variable_has_a_token_logged() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, token) = (folder.path().join("day.jsonl"), folder.path().join("token"));
    write_recording(&recording);
    write_secret(&token, format!("{SECRET}\n").as_bytes());
    for arguments in asking_commands(&recording) {
        for log in ["trace", "ureq_proto=trace,tungstenite=trace,rustls=trace"] {
            let daemon = Server::daemon();
            let mut command = build_era_command();
            command.args(&arguments).args(["--url", &daemon.url(), "--token-file"]).arg(&token);
            let said = run_command(command.env("ERA_LOG", log).env("RUST_LOG", log));
            assert_eq!(said.code, Some(0), "{arguments:?}: {}", said.error);
            assert!(daemon.received().iter().any(|request| request.contains(SECRET)));
            // As it is, and as a dump of bytes has it.
            for shown in ["TTTT", "5454 5454", "54, 54"] {
                assert!(!said.error.contains(shown) && !said.out.contains(shown), "{arguments:?}: {}", said.error);
            }
        }
    }
}
