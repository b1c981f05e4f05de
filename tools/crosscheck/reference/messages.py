"""Layout of the messages of protocol version 4.

docs/src/protocol.md names requests and replies and points to shared/src/protocol for their fields: order and width of the
fields are the definition of the format, and are stated here a second time, as a schema.
"""

from . import frames

VERSION = 4

_DRIVE = {
    "channel": "u8",
    "frequency_millihertz": "u32",
    "pulse_width_ppm": "u32",
    "phase_microturns": "u32",
    "voltage_millivolts": "u32",
}
_ACHIEVED = {
    "channel": "u8",
    "frequency_nanohertz": "u64",
    "pulse_width_ppm": "u32",
    "phase_microturns": "u32",
    "guard_ns": "u32",
    "voltage_millivolts": "u32",
}
_SEGMENT = (
    "enum",
    [
        ("Hold", {"level": "i16", "milliseconds": "u16"}),
        ("Ramp", {"from": "i16", "to": "i16", "milliseconds": "u16"}),
        ("Cycles", {"level": "i16", "count": "u16"}),
    ],
)
_EFFECT = {"segments": ("list", _SEGMENT), "times": "u16"}
_WINDOW = {"channel": "u8", "electrode": ("enum", [("A", None), ("B", None)]), "wait_ticks": "u32", "width_ticks": "u32"}
_SEQUENCE = {
    "number": "u32",
    "start_us": "u64",
    "rail_millivolts": ("array", 2, "u32"),
    "windows": ("list", _WINDOW),
}

REQUEST = (
    "enum",
    [
        ("Hello", {"host_min": "u8", "host_current": "u8"}),
        ("Arm", {"deadman_ms": ("option", "u16")}),
        ("Disarm", None),
        ("SetDrives", {"drives": ("list", _DRIVE)}),
        ("Stop", None),
        ("KeepAlive", None),
        ("Status", None),
        ("Faults", None),
        ("ClearFaults", None),
        ("Telemetry", None),
        ("ArmWith", {"deadman_ms": ("option", "u16"), "burst_ms": ("option", "u16")}),
        ("Prepare", {"drives": ("list", _DRIVE)}),
        ("Play", {"channel": "u8", "start_us": "u64", "effect": _EFFECT}),
        ("Clock", None),
        ("Details", None),
        ("Log", None),
        ("Bootloader", {"key": "u32"}),
        ("Credit", None),
        ("PlayOnce", {"number": "u32", "channel": "u8", "start_us": "u64", "effect": _EFFECT}),
        ("PlayWindows", _SEQUENCE),
        ("NumberedFault", None),
        ("ClearFault", {"number": "u32"}),
    ],
)

_STATE = ("enum", [(name, None) for name in ("boot", "safe", "armed", "running", "fault", "arming", "discharging")])
# Faults are only told of by number here: the check's board has none.
_FAULT = {"code": "u8", "at_us": "u64", "detail": "u32", "count": "u16"}
_LIMITS = {
    "min_frequency_millihertz": "u32",
    "max_frequency_millihertz": "u32",
    "max_voltage_millivolts": "u32",
    "min_guard_ns": "u32",
    "timer_clock_hz": "u32",
}
_FIRMWARE = {"major": "u8", "minor": "u8", "patch": "u8", "commit": ("array", 8, "u8")}
_WELCOME = {
    "protocol_min": "u8",
    "protocol_current": "u8",
    "board": "u8",
    "board_id": ("array", 12, "u8"),
    "boot_id": "u32",
    "reset_cause": "u8",
    "image": "string",
    "firmware": _FIRMWARE,
    "channels": ("list", _LIMITS),
    "failure": "string",
}
_STATUS = {
    "state": _STATE,
    "uptime_us": "u64",
    "boot_id": "u32",
    "fault": ("option", _FAULT),
    "channels": ("list", {"drive": ("option", _ACHIEVED)}),
    "link": {"good_frames": "u32", "bad_frames": "u32", "refused": "u32"},
}
_TELEMETRY = {
    "uptime_us": "u64",
    "state": _STATE,
    "acceleration_peak_mm_per_s2": ("option", "u32"),
    "rail_millivolts": ("list", "u32"),
}
_DETAILS = {
    "state": _STATE,
    "set_point_millivolts": ("array", 2, "u32"),
    "rail_millivolts": ("array", 2, "u32"),
    "average_microamps": "u32",
    "interlock_closed": "bool",
    "stop_released": "bool",
    "earth_bonded": "bool",
    "credit_ms": ("list", "u32"),
}
_CREDIT = {
    "rule": ("enum", [("Time", None), ("ForceSquared", None)]),
    "earned_ppm": "u32",
    "channels": ("list", {"left_ms": "u32", "charge_ppm": "u32"}),
}

REPLY = (
    "enum",
    [
        ("Hello", None),  # of version 1, which is not spoken here
        ("Armed", {"deadman_ms": "u16"}),
        ("Disarmed", None),
        ("DrivesSet", {"achieved": ("list", _ACHIEVED)}),
        ("Stopped", None),
        ("Alive", {"state": _STATE}),
        ("Status", _STATUS),
        ("Faults", {"latched": ("option", _FAULT)}),
        ("FaultsCleared", None),
        ("Telemetry", _TELEMETRY),
        ("Refused", ("enum", [("Version", {"got": "u8", "min": "u8", "current": "u8"}), ("Malformed", None)])),
        ("Welcome", _WELCOME),
        ("ArmedWith", {"deadman_ms": "u16", "burst_ms": "u16"}),
        ("Prepared", {"achieved": ("list", _ACHIEVED)}),
        ("Playing", None),
        ("Clock", {"now_us": "u64"}),
        ("Details", _DETAILS),
        ("Log", {"bytes": "bytes"}),
        ("Bootloader", None),
        ("Credit", _CREDIT),
        ("WindowsPlaying", {"start_us": "u64"}),
        ("NumberedFault", {"number": "u32", "latched": ("option", _FAULT)}),
    ],
)


def request(encoded):
    """(frame, name, content) of a request's bytes between two zeros."""
    frame = frames.frame(encoded)
    if (frame.version, frame.kind) != (VERSION, frames.REQUEST):
        raise frames.FrameError(f"version {frame.version}, kind {frame.kind}")
    return frame, *frames.read(REQUEST, frame.body)


def reply(sequence, name, content=None):
    """The bytes of a reply."""
    return frames.Frame(VERSION, frames.REPLY, sequence, frames.written(REPLY, (name, content))).encoded()
