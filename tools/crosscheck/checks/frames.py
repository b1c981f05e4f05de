"""Bytes on the link: `era serve --device PATH` against a board that this program plays on a pseudo-terminal."""

import numpy as np

from ..harness import Result
from ..reference import link, pulses

QUANTITIES = (
    "frames: drives of a touch",
    "frames: what the board says it does",
    "frames: signs of life",
    "frames: effects",
    "frames: end and stop",
    "frames: bad answers survived",
    "frames: guard of 200 us",
)
PLANTS = dict.fromkeys(QUANTITIES, "answer")
# A session takes some five seconds, most of them waiting.
EVERY, FIRST = 15, 4
# Half a unit of what the link counts in (mHz, ppm, millionths of a turn); a voltage may be rounded down by a whole mV.
ROUNDING = 1.0
# What a JSON number of nanohertz or nanoseconds keeps.
PRINTED = 1e-9
DEADMAN_S = 0.25
GUARD_LIMIT_S = pulses.GUARD_S


def drive_difference(planned, sent, ids):
    """Largest deviation of what was sent from what is printed, in units of what rounding may do; infinite if the channels are not
    the actuators'."""
    by_channel = {drive["channel"]: drive for drive in sent}
    if sorted(by_channel) != sorted(ids.index(drive["actuator"]) for drive in planned) or len(by_channel) != len(sent):
        return np.inf
    worst = 0.0
    for drive in planned:
        got = by_channel[ids.index(drive["actuator"])]
        turns = (drive["phase_rad"] / (2 * np.pi)) % 1.0
        phase = abs((got["phase_microturns"] * 1e-6 - turns + 0.5) % 1.0 - 0.5)
        volts = got["voltage_millivolts"] * 1e-3 - drive["voltage_v"]
        worst = max(
            worst,
            abs(got["frequency_millihertz"] * 1e-3 - drive["frequency_hz"]) / 0.5e-3,
            abs(got["pulse_width_ppm"] * 1e-6 - drive["pulse_width"]) / 0.5e-6,
            phase / 0.5e-6,
            # Never above what is planned.
            abs(volts) / 1e-3 if volts <= 1e-6 else np.inf,
        )
    return worst * (1 - 1e-6)


def achieved_difference(answered, told, ids):
    """Largest relative deviation of `device.achieved` from what the board said."""
    if len(answered) != len(told):
        return np.inf
    worst = 0.0
    for got, said in zip(answered, told):
        if (got["channel"], ids.index(got["actuator"])) != (said["channel"], said["channel"]):
            return np.inf
        pairs = [
            (got["frequency_hz"], said["frequency_nanohertz"] * 1e-9),
            (got["pulse_width"], said["pulse_width_ppm"] * 1e-6),
            (got["voltage_v"], said["voltage_millivolts"] * 1e-3),
            (got["guard_us"], said["guard_ns"] * 1e-3),
            (got["phase_rad"], said["phase_microturns"] * 2e-6 * np.pi),
        ]
        worst = max([worst, *(abs(a - b) / max(abs(b), 1e-9) for a, b in pairs)])
    return worst


def windows_difference(effect, sequences, ids):
    """Largest deviation of a window sequence from what is printed of it, in ticks of 0.1 us; infinite if anything but times differs, if a
    window breaks a limit of the board (protocol.md, window sequences), or if a rail gets more than what is printed for its windows."""
    if len(sequences) != 1 or len(sequences[0]["windows"]) != len(effect["windows"]):
        return np.inf
    sequence, ends, sent = sequences[0], {}, []
    for window in sequence["windows"]:
        channel, electrode = window["channel"], window["electrode"][0]
        if not 2_000 <= window["wait_ticks"] <= 10_000_000 or not 3_000 <= window["width_ticks"] <= 56_034:
            return np.inf
        begin = ends.get(channel, 0) + window["wait_ticks"]
        ends[channel] = begin + window["width_ticks"]
        sent.append((channel, electrode, begin, window["width_ticks"]))
    printed = [(ids.index(w["actuator"]), w["electrode"].upper(), 10 * w["begin_us"], 10 * w["width_us"], w["voltage_v"]) for w in effect["windows"]]
    by_time = lambda window: (window[0], window[2])
    worst = 0.0
    for got, said in zip(sorted(sent, key=by_time), sorted(printed, key=by_time)):
        if got[:2] != said[:2]:
            return np.inf
        worst = max(worst, abs(got[2] - said[2]), abs(got[3] - said[3]))
    for rail, millivolts in enumerate(sequence["rail_millivolts"]):
        # Channels 0 and 2 are on the first rail.
        most_v = max((said[4] for said in printed if said[0] % 2 == rail), default=0.0)
        if not most_v * 1e3 - 1.001 <= millivolts <= most_v * 1e3 + 1e-3:
            return np.inf
    # Half a tick of rounding at each end.
    return worst * (1 - 1e-6)


def effect_difference(answer, prepared, played, windows, ids):
    """Largest deviation of an effect's frames from what is printed of it: drives in units of their rounding, levels in
    thousandths (those printed have three digits), and everything that is counted must be equal."""
    effect = answer["device"]["effect"]
    if effect["windows"]:
        return windows_difference(effect, windows, ids) if not played and not prepared else np.inf
    if windows:
        return np.inf
    worst = drive_difference(effect["drives"], prepared, ids)
    if len(played) != len(effect["drives"]):
        return np.inf
    by_channel = {play["channel"]: play for play in played}
    for drive in effect["drives"]:
        play = by_channel.get(ids.index(drive["actuator"]))
        if play is None or play["start_us"] != effect["start_board_us"] or play["effect"]["times"] != drive["times"]:
            return np.inf
        if len(play["effect"]["segments"]) != len(drive["segments"]):
            return np.inf
        for (kind, sent), printed in zip(play["effect"]["segments"], drive["segments"]):
            expected = {
                "Cycles": ("count", "cycles", (("level", "level"),)),
                "Hold": ("milliseconds", "duration_ms", (("level", "level"),)),
                "Ramp": ("milliseconds", "duration_ms", (("from", "from_level"), ("to", "to_level"))),
            }[kind]
            count, printed_count, levels = expected
            if set(printed) != {printed_count, *(name for _, name in levels)} or sent[count] != printed[printed_count]:
                return np.inf
            worst = max([worst, *(abs(sent[a] - 1e3 * printed[b]) / 0.5 for a, b in levels)])
    return worst


def silences(keep_alives):
    """Dead-man times of a touch per sign of life."""
    return link.TOUCH_MS / 1e3 / DEADMAN_S / keep_alives if keep_alives else np.inf


def run(context):
    """One session on the link."""
    rng = context.rng("frames")
    ids = [actuator.id for actuator in context.scene.actuators]
    x_px, y_px = touch_px(context.scene, rng)
    effects = [str(name) for name in rng.permutation(list(link.EFFECTS))[:3]]
    seen = link.session(context.era.serve, x_px, y_px, effects, tamper=tamper(context), **board(context))
    if context.planted("frames: what the board says it does"):
        seen.touch["device"]["achieved"][0]["frequency_hz"] *= 1 + 1e-8
    name = context.name
    where = f"touch {x_px:.1f} {y_px:.1f}"
    guards = [pulses.guard(d["frequency_millihertz"] * 1e-3, d["pulse_width_ppm"] * 1e-6) for d in seen.drives]
    guards += [
        pulses.guard(d["frequency_millihertz"] * 1e-3, d["pulse_width_ppm"] * 1e-6) for _, drives, _, _ in seen.effects.values() for d in drives
    ]
    results = [
        Result("frames: drives of a touch", name, drive_difference(seen.touch["drives"], seen.drives, ids), ROUNDING, note=where),
        Result("frames: what the board says it does", name, achieved_difference(seen.touch["device"]["achieved"], seen.told, ids), PRINTED),
        # Dead-man times for each sign of life: at 1 they would just do if they came evenly.
        Result("frames: signs of life", name, silences(seen.keep_alives), 1.0),
        Result("frames: end and stop", name, float(not seen.ended) + float(not seen.stopped) + len(seen.broken), 0.0, note=str(seen.broken[:1])),
        Result(
            "frames: guard of 200 us",
            name,
            # How far the shortest guard is below the least, relative; the pulse's width is rounded to a millionth of a half period.
            max(0.0, 1 - min(guards) / GUARD_LIMIT_S),
            1e-4,
        ),
    ]
    for effect, (answer, prepared, played, windows) in seen.effects.items():
        results.append(Result("frames: effects", name, effect_difference(answer, prepared, played, windows, ids), ROUNDING, note=f"{effect}, {where}"))
    failed = [what for what, good in {**seen.bad_answers, **seen.foreign}.items() if not good]
    results.append(Result("frames: bad answers survived", name, float(len(failed)), 0.0, note=", ".join(failed)))
    return results


def touch_px(scene, rng):
    """A pixel that is on the surface."""
    screen = scene.screen
    for _ in range(1000):
        x_px, y_px = rng.uniform(0.03, 0.97) * screen.width_px, rng.uniform(0.03, 0.97) * screen.height_px
        if not scene.in_cutout(*screen.to_m(x_px, y_px)):
            return float(x_px), float(y_px)
    raise ValueError("no pixel found")


def board(context):
    """For planted mistakes: a board that answers badly for ever, or does not hear signs of life."""
    deaf = ("KeepAlive", "Status", "Details") if context.planted("frames: signs of life") else ()
    return {"stubborn": context.planted("frames: bad answers survived"), "deaf": deaf}


def tamper(context):
    """For planted mistakes: what the board takes a request for."""

    def mistake(name, content):
        if context.planted("frames: drives of a touch") and name == "SetDrives" and content["drives"]:
            content["drives"][0]["frequency_millihertz"] += 1
        if context.planted("frames: guard of 200 us") and name == "Prepare":
            drive = content["drives"][0]
            drive["pulse_width_ppm"] = round(1e6 * (1 - 2e-3 * drive["frequency_millihertz"] * 199e-6))
        if context.planted("frames: effects") and name == "PlayOnce":
            kind, segment = content["effect"]["segments"][0]
            level = "from" if kind == "Ramp" else "level"
            segment[level] += 1 if segment[level] < 1000 else -1
        if context.planted("frames: effects") and name == "PlayWindows":
            content["windows"][0]["width_ticks"] += 2
        if context.planted("frames: end and stop") and name == "Stop":
            name = "KeepAlive"
        return name, content

    return mistake if context.plant in QUANTITIES else None
