"""Effects in quick succession, as the daemon sends them to a board: single clicks, pushes, clicks for several fingers, sequences of effect
files, with a finger that rests on the panel and without. What the frames say is played on own modes in gaps that move: no mass may go
beyond a third of its gap, whatever an earlier effect has left.
"""

import time

import numpy as np

from ..harness import Program, Result, not_comparable
from ..reference import effects, link, motion
from ..reference.board import Board
from ..reference.panel import Panel
from ..reference.random_scenes import log_uniform, to_toml
from ..reference.scene import parse
from .clicks import BAND_HZ, MAX_HZ, MOST
from .frames import touch_px

QUANTITIES = ("succession: travel",)
PLANTS = {"succession: travel": "answer"}
EVERY, FIRST = 6, 5
# Requests of a session, the longest pause between the end of one effect and the next request, and the time after the last, in s.
REQUESTS, LONGEST_PAUSE_S, AFTER_S = 10, 0.1, 0.1
STEP_S = 5e-5
# A planted mistake: voltages are so many times those of the frames, on a board that holds them.
PLANTED_VOLTAGE = 3.0
# The daemon plans for the panel without the finger, which may lift at any time. On a lighter panel a finger changes more than travel has room for:
# on a bar of 0.9 g, one of 0.3 g took a mass to 0.46 of its gap.
LEAST_WEIGHT_KG = 0.05
PRIMITIVES = ("click", "tick", "low_tick", "thud", "press", "release", "error")
TICK_S = 1e-7


def run(context):
    """One session of a daemon with a board of this program's own."""
    rng, name, scene = context.rng("succession"), context.name, context.scene
    weight_kg = scene.material.density_kg_m3 * scene.length * scene.width * scene.thickness
    with_finger = weight_kg > LEAST_WEIGHT_KG and bool(rng.random() < 0.5)
    x_px, y_px = touch_px(scene, rng)
    era, panel = context.era, None
    if with_finger:
        path = context.folder / "succession.toml"
        text = to_toml(context.table | {"finger": fingertip(rng)})
        path.write_text(text, encoding="utf-8")
        era = Program(context.era.binary, path, context.folder)
        panel = Panel(parse(text).touched(*scene.screen.to_m(x_px, y_px)), MAX_HZ)
    # The finger rests where the first touch is, and the panel is the same all the time.
    place = (lambda: (x_px, y_px)) if with_finger else (lambda: touch_px(scene, rng))
    played, refused = [], []
    with Board() as board, era.serve("--device", board.path) as request:
        for _ in range(REQUESTS):
            since = board.now()
            path, body = random_request(rng, place, several=not with_finger)
            status, answer = request("POST", path, body)
            if status != 200:
                refused.append(f"{status} {answer.get('detail', '')}")
                continue
            # Further parts of an effect file are sent later.
            wait_s = max((part["begin_ms"] for part in answer.get("parts", [])), default=0.0) * 1e-3
            time.sleep(max(0.0, wait_s - (board.now() - since)))
            _, ends_s = windows_of_frames(board, len(scene.actuators), np.random.default_rng(0))
            time.sleep(max(0.0, ends_s - board.now()) + rng.uniform(0, LONGEST_PAUSE_S))
        played, ends_s = windows_of_frames(board, len(scene.actuators), rng)
    where = f"{'finger, ' if with_finger else ''}{len(played)} windows, {len(refused)} of {REQUESTS} requests refused{': ' + refused[0] if refused else ''}"
    if not played:
        return [not_comparable(QUANTITIES[0], name, f"nothing was played: {refused[:1]}")]
    if context.planted(QUANTITIES[0]):
        played = [motion.Window(w.actuator, w.on, w.off, w.sign, PLANTED_VOLTAGE * w.voltage_v) for w in played]
    system = motion.System(panel or context.panel(MAX_HZ), BAND_HZ, [scene.screen.to_m(x_px, y_px)])
    if system.size > MOST or system.defective:
        return [not_comparable(QUANTITIES[0], name, f"{system.size} modes, or poles that coincide")]
    begin_s = min(window.on for window in played)
    played = [motion.Window(w.actuator, w.on - begin_s, w.off - begin_s, w.sign, w.voltage_v) for w in played]
    voltages = motion.Voltages(played, len(system.gap), times=system.times)
    record = motion.integrate(system, voltages, ends_s - begin_s + AFTER_S, STEP_S)
    travel = np.inf if record.pulled_in else np.abs(record.gap_change / system.gap).max()
    return [Result(QUANTITIES[0], name, 3 * travel, 1.0, note=where)]


def fingertip(rng):
    """A finger's table, around 8 g, 2 N s/m and 800 N/m."""
    return {
        "mass_g": log_uniform(rng, 1.0, 15.0),
        "damping_n_s_per_m": log_uniform(rng, 0.5, 5.0),
        "stiffness_n_per_m": log_uniform(rng, 200.0, 3000.0),
    }


def random_request(rng, place, several):
    """A path and a body: a click for up to three fingers, a push, or a sequence of a file."""
    x_px, y_px = place()
    strength = 1000.0 if rng.random() < 0.3 else log_uniform(rng, 0.2, 3.0)
    body = {"x_px": x_px, "y_px": y_px, "intensity_g": float(strength)}
    kind = rng.random()
    if kind < 0.5:
        others = [place() for _ in range(int(rng.integers(0, 3)))] if several else []
        also = [{"x_px": x, "y_px": y, "intensity_g": float(strength)} for x, y in others]
        return "/v1/touch", body | {"effect": "click"} | ({"also": also} if also else {})
    if kind < 0.75:
        effect = str(rng.choice([effect for effect in link.EFFECTS if effect != "click"]))
        return "/v1/touch", body | {"effect": effect} | link.EFFECTS[effect]
    events = [
        {"primitive": str(rng.choice(PRIMITIVES)), "pause_ms": float(rng.uniform(0, 80)), "intensity": float(rng.uniform(0.3, 1))}
        for _ in range(int(rng.integers(2, 5)))
    ]
    return "/v1/effects", body | {"effect": {"version": 1, "events": events}}


def windows_of_frames(board, count, rng):
    """All windows that the frames ask for, in s of the board's clock, and when the last one ends. A push begins at the first boundary of each
    channel's own period after its start, so a random part of a period later."""
    found, prepared = [], {}
    for at_s, name, content in board.named("PlayWindows", "Prepare", "PlayOnce"):
        if name == "Prepare":
            prepared = {drive["channel"]: drive for drive in content["drives"]}
            continue
        start_s = content["start_us"] * 1e-6 or at_s
        if name == "PlayWindows":
            found += windows_of_burst(content, start_s)
        elif content["channel"] in prepared:
            found += windows_of_push(prepared[content["channel"]], content["effect"], start_s, rng)
    return [window for window in found if window.actuator < count], max((window.off for window in found), default=0.0)


def windows_of_burst(sequence, start_s):
    """Of one sequence of single windows; each waits from the end of the one before on its channel."""
    ends, found = {}, []
    for window in sequence["windows"]:
        channel = window["channel"]
        on = ends.get(channel, start_s) + window["wait_ticks"] * TICK_S
        off = ends[channel] = on + window["width_ticks"] * TICK_S
        sign = 1 if window["electrode"][0] == "A" else -1
        found.append(motion.Window(channel, on, off, sign, sequence["rail_millivolts"][channel % 2] * 1e-3))
    return found


def windows_of_push(drive, effect, start_s, rng):
    """Of a drive whose level changes at the boundaries of its periods."""
    period_s, pulse_width = 1e3 / drive["frequency_millihertz"], drive["pulse_width_ppm"] * 1e-6
    segments = [segment_of_frame(kind, content) for kind, content in effect["segments"]]
    begin_s, found = start_s + rng.uniform(0, period_s), []
    for index, level in enumerate(effects.levels(segments, effect["times"], period_s)):
        half_s = effects.width(level, pulse_width) * period_s / 4
        # A's window in the middle of the first half period, B's of the second; a negative level changes their places.
        for middle, sign in ((0.25, 1), (0.75, -1)) if half_s > 0 else ():
            at_s = begin_s + (index + middle) * period_s
            found.append(motion.Window(drive["channel"], at_s - half_s, at_s + half_s, sign if level > 0 else -sign, drive["voltage_millivolts"] * 1e-3))
    return found


def segment_of_frame(kind, content):
    """A segment as `effects.levels` takes it."""
    match kind:
        case "Cycles":
            return {"cycles": content["count"], "level": content["level"] * 1e-3}
        case "Hold":
            return {"duration_ms": content["milliseconds"], "level": content["level"] * 1e-3}
    return {"duration_ms": content["milliseconds"], "from_level": content["from"] * 1e-3, "to_level": content["to"] * 1e-3}
