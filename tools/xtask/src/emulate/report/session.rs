//! The image in good health: boot, hello, refusals, arm, drive, change, envelope, stop, silence.

use super::board::{CLOCKS_PER_MS, EmulatedBoard};
use super::channels::CHANNELS;
use super::drives::{
    self, add_reply_row, add_rows_of_rapid_drive_changes, add_rows_of_registers_rails_and_phases,
    set_drives_and_add_rows_comparing_registers_and_pins,
};
use super::effects;
use super::expected::{
    ALL_OFF, compute_expected_registers, describe_high_voltage_enable_and_discharge_pins,
    describe_timer_enables_output_pins_and_rail_dac_codes, format_read_registers, format_registers,
};
use super::table::ReportTable;
use super::windows;
use crate::error::Error;
use era_shared::limits::DEADMAN_DEFAULT_MS;
use era_shared::link::{FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::{CURRENT_VERSION, ChannelDrive, FaultCode, MIN_VERSION, Refusal, Reply, Request};
use era_shared::safety::{SafetyEvent, SafetyState};

/// What the dead-man time may be exceeded by in ms: one tick of the device's task, one slice of the emulator.
const SILENCE_MARGIN_MS: f64 = 2.0;
/// A version that is not spoken yet.
const TOO_NEW: u8 = CURRENT_VERSION + 7;

type SessionPart = fn(&mut EmulatedBoard, &mut ReportTable) -> Result<(), Error>;

/// All of it, in one life of the board; what cannot be carried out ends it.
pub fn check_healthy_session_from_boot_to_host_silence(board: &mut EmulatedBoard, table: &mut ReportTable) {
    let parts: [(&str, SessionPart); 8] = [
        ("boot and questions", add_rows_of_boot_and_hello),
        ("refusals", add_rows_of_unarmed_drive_refusal_and_garbage),
        ("arm", add_rows_of_arming),
        ("drive and change", add_rows_of_driving_and_changes),
        ("envelopes", effects::add_rows_of_click_and_ramp_envelopes),
        ("windows", windows::add_rows_of_window_sequence_at_pins),
        ("stop", add_rows_of_stop),
        ("silence", add_rows_of_host_silence),
    ];
    // Each part begins where the one before it has ended.
    let _ = parts.into_iter().all(|(name, part)| table.run_part_adding_row_on_error(name, |table| part(board, table)));
}

fn add_rows_of_boot_and_hello(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    table.add_comparison_row("boot", ALL_OFF, &describe_timer_enables_output_pins_and_rail_dac_codes(board)?);
    let safe = board.await_state_and_measure_ms(SafetyState::Safe, 100)?;
    table.add_time_limit_row("boot: rails measured, safe", 100.0, safe.ok());
    let hello = Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION };
    let versions = |min: u8, current: u8, channels: usize| format!("protocol {min} to {current}, {channels} channels");
    let expected = versions(MIN_VERSION, CURRENT_VERSION, CHANNELS.len());
    let seen = match board.send_request(&hello)? {
        Reply::Welcome(welcome) => versions(welcome.protocol_min, welcome.protocol_current, welcome.channels.len()),
        other => format!("{other:?}"),
    };
    table.add_comparison_row("hello", &expected, &seen);
    let seen = match board.send_request_as_version(1, &hello)? {
        Reply::Hello(hello) => versions(hello.protocol_min, hello.protocol_current, hello.channels.len()),
        other => format!("{other:?}"),
    };
    table.add_comparison_row("hello in the words of version 1", &expected, &seen);
    let refused =
        Reply::Refused(Refusal::Version { got: TOO_NEW, device_min: MIN_VERSION, device_current: CURRENT_VERSION });
    let seen = board.send_request_as_version(TOO_NEW, &hello)?;
    table.add_comparison_row("hello in a version that is too new", &format!("{refused:?}"), &format!("{seen:?}"));
    Ok(())
}

fn add_rows_of_unarmed_drive_refusal_and_garbage(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
) -> Result<(), Error> {
    let refused = board.set_drives(&drives::FIRST)?;
    let expected = Some(Refusal::State { state: SafetyState::Safe, event: SafetyEvent::Drive });
    table.add_comparison_row("drive without arming", &format!("{expected:?}"), &format!("{refused:?}"));
    let before = board.read_status()?.link;
    board.exchange_raw_bytes_until_first_frame(&make_noise_then_half_frame_then_corrupted_frame_bytes()?, 0.05)?;
    let after = board.read_status()?;
    let seen = format!("state {}, {} bad frames", after.state.name(), after.link.bad_frames - before.bad_frames);
    table.add_comparison_row("garbage, a cut frame, a changed bit", "state safe, 3 bad frames", &seen);
    table.add_comparison_row(
        "after refusals and garbage",
        ALL_OFF,
        &describe_timer_enables_output_pins_and_rail_dac_codes(board)?,
    );
    Ok(())
}

/// A stretch of bytes that is no frame, the first half of an `Arm`, and an `Arm` with one bit changed.
fn make_noise_then_half_frame_then_corrupted_frame_bytes() -> Result<Vec<u8>, Error> {
    let mut frame = [0; MAX_ENCODED];
    let arm = Request::Arm { deadman_ms: None };
    let length = encode_frame(CURRENT_VERSION, FrameKind::Request, 9, &arm, &mut frame).map_err(Error::Encode)?;
    let frame: Vec<u8> = frame.iter().take(length).copied().collect();
    // Every value but the frame's end, scattered.
    let noise = (0..300_u32).map(|i| u8::try_from(i * 167 % 255 + 1).unwrap_or(1));
    let mut changed = frame.clone();
    if let Some(byte) = changed.get_mut(length / 2) {
        *byte ^= 0x10;
    }
    let half = frame.iter().copied().take(length / 2);
    Ok(noise.chain([0]).chain(half).chain([0]).chain(changed).collect())
}

fn add_rows_of_arming(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let begin = board.read_clock_cycles()?;
    board.arm_and_wait()?;
    let took = board.milliseconds_since(begin)?;
    table.add_time_limit_row("arm: self-test passed", 1_000.0, Some(took));
    table.add_figure("from arm to armed (self-test)", format!("{took:.1} ms"));
    for (channel, seen) in CHANNELS.into_iter().zip(board.read_timer_registers()?) {
        let name = format!("armed: {} counts, blank", channel.timer);
        let expected = compute_expected_registers(channel, None)?;
        // Nothing may reach a pin before a drive is set, whether MOE is on already or not.
        let main_output = format_read_registers(channel, &seen).ends_with("MOE 1");
        table.add_comparison_row(
            &name,
            &format_registers(channel, &expected, main_output),
            &format_read_registers(channel, &seen),
        );
    }
    table.add_comparison_row(
        "armed: switches",
        "HV 1 discharge 11",
        &describe_high_voltage_enable_and_discharge_pins(&board.read_pins()?),
    );
    board.update_pin_edges_until_now()?;
    let (_, _, pulses) = board.edges.overlap_and_least_guard_clocks_and_pulse_count();
    table.add_comparison_row("armed: pulses on any electrode", "0", &pulses.to_string());
    Ok(())
}

fn add_rows_of_driving_and_changes(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    // By hand: 8 x 116 pF x 2 kV x 300 Hz are 557 uA, rounded up, and the bleeders of both rails take 80 uA.
    let beyond = drives::FIRST.map(|drive| drives::make_drive(drive.channel, 300_000, 500_000, 0, 2_000_000));
    let refused = board.set_drives(&beyond)?;
    let expected = Some(Refusal::Current { requested_microamps: 637, max_microamps: 500 });
    table.add_comparison_row("drives beyond the supply", &format!("{expected:?}"), &format!("{refused:?}"));
    set_drives_and_add_rows_comparing_registers_and_pins(board, table, "drive", None, &drives::FIRST)?;
    let mut now = drives::FIRST;
    let mut next = |table: &mut ReportTable, name: &str, edit: &dyn Fn(&mut [ChannelDrive; 4])| {
        let before = now;
        edit(&mut now);
        set_drives_and_add_rows_comparing_registers_and_pins(board, table, name, Some(&before), &now)
    };
    next(table, "other frequency", &|drives| {
        drives[0].frequency_millihertz = 250_000;
        drives[1].frequency_millihertz = 250_000;
    })?;
    next(table, "other width", &|drives| drives[0].pulse_width_ppm = 400_000)?;
    next(table, "other phase", &|drives| drives[1].phase_microturns = 600_000)?;
    next(table, "lowest and highest frequency", &|drives| {
        drives[2].frequency_millihertz = 20_000;
        drives[3].frequency_millihertz = 999_999;
    })?;
    // The board stays as it is for half a second: equal frequencies must not drift by a tick.
    board.advance_time_with_keep_alives(0.5)?;
    board.update_pin_edges_until_now()?;
    add_rows_of_registers_rails_and_phases(board, table, "half a second later", &now)?;
    add_rows_of_rapid_drive_changes(board, table, &now)
}

fn add_rows_of_stop(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let before = board.read_clock_cycles()?;
    board.send_request(&Request::Stop)?;
    let answered = board.milliseconds_since(before)?;
    board.update_pin_edges_until_now()?;
    let off = board.edges.all_off_since_clock().map(|off| off.saturating_sub(before) as f64 / CLOCKS_PER_MS);
    table.add_time_limit_row("stop: all electrodes off", answered, off);
    table.add_comparison_row("stop", ALL_OFF, &describe_timer_enables_output_pins_and_rail_dac_codes(board)?);
    let safe = board.await_state_and_measure_ms(SafetyState::Safe, 1_100)?;
    let volts = board.read_set_points_and_rail_voltages()?.rail_volts;
    table.add_time_limit_row("stop: safe", 1_000.0, safe.ok());
    let highest = volts.into_iter().fold(0.0, f64::max);
    table.add_row("stop: true rail voltage when safe", "below 60 V", &format!("{highest:.1} V"), highest < 60.0);
    Ok(())
}

fn add_rows_of_host_silence(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    board.arm_and_wait()?;
    let refused = board.set_drives(&drives::FIRST)?;
    table.add_comparison_row("silence: drives set", "None", &format!("{refused:?}"));
    board.advance_time_with_keep_alives(0.2)?;
    let last = board.read_clock_cycles()?;
    board.send_request(&Request::KeepAlive)?;
    board.advance_time(2.0 * f64::from(DEADMAN_DEFAULT_MS) / 1e3)?;
    board.update_pin_edges_until_now()?;
    let off = board.edges.all_off_since_clock().map(|off| off.saturating_sub(last) as f64 / CLOCKS_PER_MS);
    let deadman_ms = f64::from(DEADMAN_DEFAULT_MS);
    table.add_time_range_row("silence: all electrodes off", deadman_ms, deadman_ms + SILENCE_MARGIN_MS, off);
    if let Some(off) = off {
        table.add_figure(
            "from the last keep-alive to all outputs off",
            format!("{off:.3} ms (dead-man time {DEADMAN_DEFAULT_MS} ms)"),
        );
    }
    table.add_comparison_row("silence", ALL_OFF, &describe_timer_enables_output_pins_and_rail_dac_codes(board)?);
    let fault = board.read_latched_fault()?.map(|fault| fault.code);
    table.add_comparison_row("silence: fault", &format!("{:?}", Some(FaultCode::HostSilent)), &format!("{fault:?}"));
    let arm = board.send_request(&Request::Arm { deadman_ms: None })?;
    let expected = Reply::Refused(Refusal::State { state: SafetyState::Fault, event: SafetyEvent::Arm });
    table.add_comparison_row("silence: arm before clearing", &format!("{expected:?}"), &format!("{arm:?}"));
    add_reply_row(board.send_request(&Request::ClearFaults)?, Reply::FaultsCleared, table, "silence: clear");
    let safe = board.await_state_and_measure_ms(SafetyState::Safe, 1_100)?;
    table.add_time_limit_row("silence: cleared, safe", 1_000.0, safe.ok());
    Ok(())
}
