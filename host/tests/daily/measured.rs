//! `era latency`: touches that are held back or refused do not end it.

use serde_json::Value;
use std::process::Command;

#[test]
fn the_latency_of_weak_touches_is_measured() {
    let out = Command::new(env!("CARGO_BIN_EXE_era"))
        .args(["latency", "--touches", "40", "--intensity-g", "0.1", "--accuracy", "fast", "--no-cache", "--json"])
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let told: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(told["to_device_ms"]["median"].as_f64().unwrap() > 0.0, "{told}");
    assert!(told["refused"].is_array() && told["delayed"].is_u64(), "{told}");
}
