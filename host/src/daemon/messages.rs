//! Answers and messages as JSON.

use super::active::{Active, Touched};
use super::app::App;
use crate::device::Identity;
use crate::device::convert::from_wire;
use crate::planner::STANDARD_GRAVITY;
use era_shared::protocol::ChargeRule;
use serde::Serialize;
use serde_json::{Value, json};

/// The answer to a touch: the plan, the device's acknowledgement, and what there is of stretches and what can be had.
#[must_use]
pub fn touched(touched: Touched) -> Value {
    let Touched { active, device, stretches, trade, .. } = touched;
    let mut answer = json!(active.plan);
    if let Some(map) = answer.as_object_mut() {
        map.insert("plan_id".into(), active.id.into());
        map.insert("device".into(), device);
        map.extend(stretches.map(|stretches| ("stretches".into(), json!(stretches))));
        map.extend(trade.map(|trade| ("trade".into(), json!(trade))));
    }
    answer
}

/// The plan and its field, for a page.
#[must_use]
pub fn plan_message(active: &Active) -> Value {
    json!({
        "type": "plan", "plan": active.plan, "field": active.field, "touches": active.touches, "effect": active.effect,
    })
}

/// `content` with its type, for a page.
#[must_use]
pub fn typed(kind: &str, content: &impl Serialize) -> Value {
    let mut message = json!(content);
    if let Some(map) = message.as_object_mut() {
        map.insert("type".into(), kind.into());
    }
    message
}

/// Everything there is to know now.
#[must_use]
pub fn state(app: &App) -> Value {
    let receiver = app.device();
    let device = receiver.borrow();
    let active = app.active();
    let status = device.status.as_ref();
    let fault = status.and_then(|status| status.fault).map(|fault| {
        json!({
            "code": fault.code.number(), "name": fault.code.name(), "message": fault.code.advice(),
            "action": "clear", "detail": fault.detail, "count": fault.count,
        })
    });
    let names = &app.table.scene.actuators;
    let channels: Vec<_> = status
        .map(|status| {
            status
                .channels
                .iter()
                .enumerate()
                .map(|(i, channel)| {
                    let si = channel.drive.as_ref().map(from_wire);
                    json!({
                        "actuator": names.get(i).map(|actuator| actuator.id.as_str()),
                        "active": si.is_some(),
                        "frequency_hz": si.map(|d| d.frequency_hz), "voltage_v": si.map(|d| d.voltage_v),
                        "pulse_width": si.map(|d| d.pulse_width),
                    })
                })
                .collect()
        })
        .unwrap_or_default();
    let telemetry = device.telemetry.as_ref().map(|telemetry| {
        json!({
            "uptime_ms": telemetry.uptime_us / 1000,
            "acceleration_peak_g": telemetry.acceleration_peak_mm_per_s2
                .map(|peak| f64::from(peak) / 1e3 / STANDARD_GRAVITY),
            "channels": channels,
        })
    });
    let identity = device.identity.as_ref();
    let supply = device.details.as_ref().map(|details| {
        let volts = |values: &[u32]| values.iter().map(|millivolts| f64::from(*millivolts) / 1e3).collect::<Vec<_>>();
        json!({
            "set_point_v": volts(&details.set_point_millivolts), "rail_v": volts(&details.rail_millivolts),
            "average_current_ma": f64::from(details.average_microamps) / 1e3,
            "interlock_closed": details.interlock_closed, "stop_released": details.stop_released,
            "earth_bonded": details.earth_bonded,
            "credit_s": details.credit_ms.iter().map(|ms| f64::from(*ms) / 1e3).collect::<Vec<_>>(),
            // A board that does not tell charges by time.
            "credit_rule": device.credit.as_ref().map_or(ChargeRule::Time, |credit| credit.rule).name(),
            "credit_lasts_s": device.credit.as_ref().map(|credit| {
                (0..credit.channels.len()).map(|i| credit.lasts_ms(i).map(|ms| ms as f64 / 1e3)).collect::<Vec<_>>()
            }),
        })
    });
    let clock = device.clock.map(|clock| {
        json!({
            "rate_ppm": clock.rate_ppm, "half_round_trip_us": clock.half_round_trip_s * 1e6,
            "residual_rms_us": clock.residual_rms_s * 1e6, "residual_worst_us": clock.residual_worst_s * 1e6,
            "samples": clock.samples, "outliers": clock.outliers,
        })
    });
    json!({
        "device": {
            "kind": device.kind, "port": device.path,
            "connected": device.connected, "in_doubt": device.in_doubt, "problem": device.problem,
            "state": status.map(|status| status.state.name()), "fault": fault,
            "firmware": identity.map(Identity::firmware_text), "image": identity.map(|known| known.image.as_str()),
            "protocol": device.protocol,
            "board_id": identity.map(|known| Identity::hex(known.board_id)), "boot_id": identity.map(|known| known.boot_id),
            "reset_cause": identity.map(|known| format!("{:?}", known.reset_cause)),
            "failure": identity.map(|known| known.failure.as_str()).filter(|failure| !failure.is_empty()),
            "restarts": device.restarts, "outages": device.outages, "doubts": device.doubts, "faults": device.faults, "silences_cleared": device.cleared,
            "mismatch": device.mismatch, "waits_to_be_armed": device.waits_to_be_armed, "supply": supply, "clock": clock,
        },
        "plan": active.as_ref().map(|active| &active.plan),
        "plan_id": active.as_ref().map(|active| active.id),
        "touches": active.as_ref().map(|active| active.touches.clone()).unwrap_or_default(),
        "telemetry": telemetry,
        "link": {
            "round_trip_ms_median": device.round_trip.map(|time| time.as_secs_f64() * 1e3),
            "round_trip_ms_worst": device.round_trip_worst.map(|time| time.as_secs_f64() * 1e3),
            "frames_sent": device.link.frames_sent, "repeats": device.link.repeats,
            "crc_errors": device.link.bad_frames, "longest_gap_ms": device.longest_gap.as_secs_f64() * 1e3,
        },
        "daemon": { "version": env!("CARGO_PKG_VERSION"), "uptime_s": app.started.elapsed().as_secs_f64() },
    })
}
