"""Pictures of the board and its host: wiring, states, data flow, times of silence."""

import re

from canvas import BLUE, FILL, GREEN, GREY, INK, ORANGE, PALE_BLUE, PALE_GREEN, PALE_ORANGE, PALE_RED, RED, Canvas, Chart
from sources import read_constant, read_duration_ms, read_source

TABLE = "shared/src/safety/table.rs"
PINS = "firmware/src/pins.rs"
LIMITS = "shared/src/limits.rs"


def label_box(canvas, x, y, width, height, title, text="", *, fill=FILL, stroke=INK, size=12):
    """A box with a bold title and lines of text, centred."""
    canvas.box(x, y, width, height, fill=fill, stroke=stroke, radius=5)
    lines = text.split("\n") if text else []
    block = 15 + 1.3 * size * len(lines)
    at = y + (height - block) / 2 + 12
    canvas.text(x + width / 2, at, title, anchor="middle", bold=True)
    if lines:
        canvas.text(x + width / 2, at + 17, text, anchor="middle", size=size)


def read_transitions():
    """The transition table of the code: a dictionary from (state, event) to (state, action), without what is refused."""
    text = read_source(TABLE)
    states = re.findall(r"SafetyState::(\w+)", text.split("pub const ALL: [SafetyState; 7]", 1)[1].split(";", 1)[0])
    body = text.split("match (state, event) {", 1)[1]
    table = {}
    arm = re.compile(r"\(([\w| ]+), ((?:SafetyEvent::\w+(?: \| )?)+)\) => (?:\{\s*)?(?:Go\((\w+), (\w+)\)|(Refuse))")
    arms = arm.findall(body)
    if len(arms) != body.count("=>"):
        raise SystemExit(f"{TABLE} has arms that docs/pictures/device.py does not read")
    for sources, events, target, action, refused in arms:
        for source in states if sources == "_" else sources.split(" | "):
            for event in re.findall(r"SafetyEvent::(\w+)", events):
                outcome = None if refused else (source if target == "state" else target, action)
                table.setdefault((source, event), outcome)
    events = {event for _, event in table}
    if len(table) != len(states) * len(events):
        raise SystemExit(f"{TABLE}: {len(table)} pairs of {len(states)} states and {len(events)} events were read")
    return {pair: outcome for pair, outcome in table.items() if outcome}


# What the picture of the states shows: every change of state that the table has. Arrows from a dashed box stand for those
# from every state within it.
LIVE = ("Arming", "Armed", "Running")
DRAWN_CHANGES = {
    ("Boot", "BootComplete", "Discharging"),
    ("Discharging", "Discharged", "Safe"),
    ("Safe", "Arm", "Arming"),
    ("Discharging", "Arm", "Arming"),
    ("Arming", "TestPassed", "Armed"),
    ("Armed", "Drive", "Running"),
    ("Running", "Rest", "Armed"),
    ("Fault", "Clear", "Discharging"),
    *((state, event, "Discharging") for state in LIVE for event in ("Stop", "Disarm")),
    *((state, "HostSilent", "Fault") for state in LIVE),
    *((state, "Fault", "Fault") for state in ("Boot", "Safe", "Discharging", *LIVE)),
}


def draw_states(_era):
    """The states of the board and every event that changes them."""
    changes = {(state, event, target) for (state, event), (target, _) in read_transitions().items() if target != state}
    if changes != DRAWN_CHANGES:
        raise SystemExit(f"{TABLE} and the picture of the states differ: {sorted(changes ^ DRAWN_CHANGES)}")
    deadman = read_constant(LIMITS, "DEADMAN_DEFAULT_MS")
    volts = read_constant(LIMITS, "DISCHARGED_MILLIVOLTS") // 1000
    canvas = Canvas(
        760, 420, "States of the board and the events that change them",
        "Boot leads to discharging when start-up is complete, discharging to safe when the rails are measured below "
        f"{volts} volts. The request to arm leads from safe or discharging to arming, the passed self-test to armed, drives to "
        "running, and a request without drives back to armed. Stop or disarm leads from arming, armed and running to "
        f"discharging. A silence of {deadman} milliseconds leads from these three states, and any fault from every state, to fault. Only clear "
        "leads out of fault, to discharging.",
    )
    width, height = 104, 44
    canvas.box(20, 40, 330, 222, fill="none", stroke=GREY, radius=10, dash="5 4")
    canvas.text(32, 58, "high voltage off", size=12, color=GREY)
    canvas.box(408, 40, 332, 222, fill="#fffbeb", stroke=ORANGE, radius=10, dash="5 4")
    canvas.text(728, 58, "high voltage may be on", anchor="end", size=12, color=ORANGE)
    places = {
        "boot": (38, 76), "discharging": (38, 192), "safe": (228, 192), "arming": (426, 192), "armed": (618, 192),
        "running": (618, 84), "fault": (290, 340),
    }
    fills = {"safe": PALE_GREEN, "fault": PALE_RED, "arming": PALE_ORANGE, "armed": PALE_ORANGE, "running": PALE_ORANGE}
    for name, (x, y) in places.items():
        box_width = 180 if name == "fault" else width
        canvas.box(x, y, box_width, height, fill=fills.get(name, FILL), radius=8, stroke=RED if name == "fault" else INK)
        text = "fault (latched)" if name == "fault" else name
        canvas.text(x + box_width / 2, y + 27, text, anchor="middle", bold=True)
    canvas.arrow([(90, 120), (90, 192)])
    canvas.text(98, 144, "start-up complete", size=12)
    canvas.arrow([(142, 214), (228, 214)])
    canvas.text(185, 206, f"rails < {volts} V", anchor="middle", size=12)
    canvas.arrow([(332, 214), (426, 214)])
    canvas.text(379, 206, "arm", anchor="middle", size=12)
    canvas.arrow([(530, 214), (618, 214)])
    canvas.text(574, 193, "self-test\npassed", anchor="middle", size=12)
    canvas.arrow([(650, 192), (650, 128)])
    canvas.text(644, 164, "drives", anchor="end", size=12)
    canvas.arrow([(690, 128), (690, 192)])
    canvas.text(696, 158, "no\ndrives", size=12)
    # Arm while the rails still fall.
    canvas.arrow([(110, 192), (110, 176), (448, 176), (448, 192)])
    canvas.text(232, 170, "arm (the self-test waits)", anchor="middle", size=12)
    # Stop.
    canvas.arrow([(574, 262), (574, 288), (124, 288), (124, 236)])
    canvas.text(350, 282, "stop, disarm", anchor="middle", size=12)
    # Faults.
    canvas.arrow([(640, 262), (640, 362), (470, 362)], color=RED)
    canvas.text(648, 320, f"host silent\n({deadman} ms),\nany fault", size=12, color=RED)
    canvas.arrow([(270, 262), (270, 318), (330, 318), (330, 340)], color=RED)
    canvas.text(262, 310, "any fault", anchor="end", size=12, color=RED)
    canvas.arrow([(290, 362), (70, 362), (70, 236)])
    canvas.text(180, 378, "clear, and the cause is gone", anchor="middle", size=12)
    canvas.text(380, 406, "At every arrow that leaves the right dashed box, everything is switched off first.", anchor="middle", size=12, color=GREY)
    return canvas


def draw_silence(_era):
    """What host and board do after the board's last answer."""
    alive, again, doubt, stop, most = (read_duration_ms(name) for name in ("keep_alive", "again", "doubt", "stop", "most"))
    tries = int(re.search(r"\btries: (\d+),\n        doubt: Duration::from", read_source("host/src/device/timing.rs")).group(1))
    deadman = read_constant(LIMITS, "DEADMAN_DEFAULT_MS")
    waits = [min(again * 2**index, most) for index in range(tries)]
    # `request_with_retries_sending_stop_when_due` of host/src/device/client.rs: when the stop falls due, the try under way ends, and a stop is sent at once.
    asked, at = [], alive
    for wait in waits:
        asked.append(at)
        at = alive + stop if at < alive + stop < at + wait else at + wait
    outage = at
    canvas = Canvas(
        760, 400, "Silence, doubt and outage: what host and board do after the last answer",
        f"Times in milliseconds after the last answer of the board. Host: at {alive} it asks for a sign of life, at {alive + again} "
        f"it asks again, at {alive + doubt} it reports a doubt, from {alive + stop} on it sends stops instead of questions, at "
        f"about {outage} it reports an outage and opens the port again. A board that hears nothing more switches off by itself {deadman} "
        "milliseconds after the last frame. A board that hears the host, though its answers are lost, switches off at the first stop.",
    )
    left, broken, resumed, right = 150, 600, 624, 738
    early = Chart(left, 0, broken, 1, (0, 300), (0, 1))
    late = Chart(resumed, 0, right, 1, (outage - 60, outage + 45), (0, 1))
    bottom = 348
    host, deaf, hearing = 92, 204, 282
    for y, height, name in ((host, 36, "host"), (deaf, 36, "board that\nhears nothing"), (hearing, 36, "board that hears,\nanswers are lost")):
        canvas.text(14, y + (22 if "\n" not in name else 15), name, bold=True, size=11)
        for chart in (early, late):
            canvas.box(chart.left, y, chart.right - chart.left, height, stroke="none", fill="#f9fafb")

    def span(y, start, end, label, fill, stroke):
        canvas.box(early.x(start), y, early.x(end) - early.x(start), 36, fill=fill, stroke=stroke, stroke_width=1)
        canvas.text((early.x(start) + early.x(end)) / 2, y + 22, label, anchor="middle", size=12)

    def rest(y, start, label, fill, stroke):
        canvas.box(early.x(start), y, broken - early.x(start), 36, fill=fill, stroke=stroke, stroke_width=1)
        canvas.text((early.x(start) + broken) / 2, y + 22, label, anchor="middle", size=12)

    span(host, 0, alive + doubt, "connected", PALE_GREEN, GREEN)
    rest(host, alive + doubt, "doubt: touches are refused", PALE_ORANGE, ORANGE)
    at_outage = late.x(outage)
    canvas.box(resumed, host, at_outage - resumed, 36, fill=PALE_ORANGE, stroke=ORANGE, stroke_width=1)
    canvas.box(at_outage, host, right - at_outage, 36, fill=PALE_RED, stroke=RED, stroke_width=1)
    canvas.text((at_outage + right) / 2, host + 22, "outage", anchor="middle", size=11)
    span(deaf, 0, deadman, "still drives", PALE_BLUE, BLUE)
    rest(deaf, deadman, "off", PALE_RED, RED)
    span(hearing, 0, alive + stop, "still drives", PALE_BLUE, BLUE)
    rest(hearing, alive + stop, "off", PALE_RED, RED)
    for y in (deaf, hearing):
        canvas.box(resumed, y, right - resumed, 36, fill=PALE_RED, stroke=RED, stroke_width=1)
        canvas.text((resumed + right) / 2, y + 22, "off", anchor="middle", size=12)
    # Frames of the host.
    for at in asked:
        chart = early if at <= 300 else late if at >= outage - 60 else None
        if chart:
            color = INK if at < alive + stop else RED
            canvas.arrow([(chart.x(at), host + 36), (chart.x(at), host + 62)], color=color)
    canvas.arrow([(at_outage, host + 36), (at_outage, host + 62)], color=RED)
    canvas.text(at_outage, host + 76, "last stop", anchor="middle", size=12, color=RED)
    canvas.text(left, 28, "What happens after the last answer of the board", bold=True, size=15)
    for at, label, color in ((alive + doubt, "doubt", ORANGE), (alive + stop, "first stop", RED)):
        canvas.line([(early.x(at), host - 4), (early.x(at), host)], color=color)
        canvas.text(early.x(at), 66, f"{label}\n{at} ms", anchor="middle", size=12, color=color)
    canvas.text(at_outage, 66, f"outage\nabout {outage / 1000:.1f} s", anchor="middle", size=12, color=RED)
    canvas.text(early.x(alive), host + 76, f"questions ({alive}, {alive + again} ms, ...)", size=12)
    canvas.text(early.x(alive + stop) + 8, host + 76, "stops", size=12, color=RED)
    canvas.text(broken, deaf + 50, f"dead-man time {deadman} ms: off, host-silent latched", anchor="end", size=12, color=RED)
    for tick in range(0, 301, 50):
        x = early.x(tick)
        canvas.line([(x, bottom - 8), (x, bottom - 3)], color=GREY)
        canvas.text(x, bottom + 11, f"{tick}", anchor="middle", size=12, color=GREY)
    tick = round(outage / 100) * 100
    canvas.line([(late.x(tick), bottom - 8), (late.x(tick), bottom - 3)], color=GREY)
    canvas.text(late.x(tick), bottom + 11, f"{tick}", anchor="middle", size=12, color=GREY)
    canvas.line([(left, bottom - 8), (broken, bottom - 8)], color=GREY)
    canvas.line([(resumed, bottom - 8), (right, bottom - 8)], color=GREY)
    for x in (broken + 6, resumed - 6):
        canvas.line([(x - 4, bottom - 2), (x + 4, bottom - 14)], color=GREY)
    canvas.text((left + right) / 2, bottom + 32, "time after the last answer in ms", anchor="middle")
    return canvas


def read_pins():
    """The pin table of firmware/src/pins.rs: the pin of each function."""
    rows = re.findall(r"^//! \| (P[A-D]\d+) +\| ([^|]+?) +\|", read_source(PINS), re.MULTILINE)
    return {function: pin for pin, function in rows}


def read_resistance(words):
    """The resistance in the sentence of firmware/src/pins.rs that begins with `words`."""
    text = " ".join(re.findall(r"//! ?\*? *(.*)", read_source(PINS)))
    found = re.search(re.escape(words) + r" (\d+ [kM]ohm)", text)
    if found is None:
        raise SystemExit(f"{PINS} has no resistance after {words!r}: adapt docs/pictures")
    return found.group(1)


def draw_wiring(_era):
    """Host, board, supply, power stage, ERAs and loops, with the board's pins."""
    pins = read_pins()

    def pin(*functions):
        return ", ".join(pins[function] for function in functions)

    limit_kv = read_constant(LIMITS, "MAX_RAIL_MILLIVOLTS") / 1e6
    charging = read_resistance("Each electrode is charged through")
    discharging = read_resistance("discharged through")
    pull_down = re.search(r"ERA 1 electrode A .*; (\d+ kohm) to ground", read_source(PINS)).group(1)
    canvas = Canvas(
        760, 560, "Wiring of host, board, high-voltage supply, power stage, ERAs and safety loops",
        "The host is connected to the board by USB or through the ST-LINK serial port. The board sets and measures two rails of the "
        f"high-voltage supply, up to {limit_kv:.0f} kilovolts each, enables the supply and opens one discharge switch for each rail. "
        "Without the permit the supply is off, the discharge switches are closed and the electrodes of ERA 4 are off. "
        "Its timers switch the electrodes of four ERAs through the power stage. Rail 1 feeds ERAs 1 and 3, rail 2 feeds ERAs 2 "
        "and 4. Masses and panel are earthed. The loops of interlock and emergency stop and the earth bond lead to the board; the "
        "emergency stop also cuts the supply.",
    )
    # Host and board.
    label_box(canvas, 20, 30, 150, 50, "host", "daemon: era serve")
    canvas.box(20, 122, 250, 330, fill="#f9fafb", radius=8, stroke=INK)
    canvas.text(145, 144, "board: NUCLEO-G474RE", anchor="middle", bold=True)
    canvas.arrow([(95, 80), (95, 122)], both=True)
    canvas.text(104, 98, f"USB ({pin('USB D-', 'USB D+')})", size=12)
    canvas.text(104, 114, f"or ST-LINK ({pin('LPUART1 TX', 'LPUART1 RX')})", size=12)
    rails = [
        (184, pin("set-point of rail 1", "set-point of rail 2"), "set-points of the rails", True),
        (210, pin("voltage of rail 1", "voltage of rail 2"), "voltages of the rails", False),
        (236, pin("momentary current", "average current"), "currents", False),
        (262, pins["high-voltage enable"], "high-voltage enable", True),
        (288, pin("discharge switch, rail 1", "discharge switch, rail 2"), "discharge switches", True),
        (314, pins["permit"], "permit, also for ERA 4", True),
    ]
    for y, names, label, out in rails:
        canvas.text(262, y + 4, f"{label}: {names}", anchor="end", size=12)
        ends = [(270, y), (340, y)]
        canvas.arrow(ends if out else ends[::-1], color=BLUE)
    canvas.text(262, 384, "electrodes A: " + pin(*(f"ERA {n} electrode A" for n in (1, 2, 3, 4))), anchor="end", size=12)
    canvas.text(262, 404, "electrodes B: " + pin(*(f"ERA {n} electrode B" for n in (1, 2, 3, 4))), anchor="end", size=12)
    canvas.text(262, 430, f"8 lines, {pull_down} to ground each", anchor="end", size=11, color=GREY)
    # Supply.
    canvas.box(340, 166, 174, 174, fill=PALE_RED, stroke=RED, radius=8)
    canvas.text(427, 192, "high-voltage supply", anchor="middle", bold=True)
    canvas.text(427, 216, f"rail 1: 0 to {limit_kv:.0f} kV\nrail 2: 0 to {limit_kv:.0f} kV", anchor="middle", size=12)
    canvas.text(427, 264, "dividers, bleeders\nshunts\ndischarge switches:\nclosed unless driven", anchor="middle", size=12)
    # Power stage.
    canvas.box(340, 372, 174, 80, fill=PALE_ORANGE, stroke=ORANGE, radius=8)
    canvas.text(427, 392, "power stage", anchor="middle", bold=True)
    canvas.text(427, 410, f"8 switch pairs\n{charging} to the rail,\n{discharging} to ground", anchor="middle", size=12)
    canvas.arrow([(270, 394), (340, 394)], color=BLUE)
    canvas.arrow([(410, 340), (410, 372)], color=RED, width=2)
    canvas.text(402, 361, "rail 1", anchor="end", size=12, color=RED)
    canvas.arrow([(452, 340), (452, 372)], color=RED, width=2)
    canvas.text(460, 361, "rail 2", size=12, color=RED)
    # ERAs.
    for index in range(4):
        y = 150 + 80 * index
        rail = 1 if index % 2 == 0 else 2
        canvas.box(590, y, 100, 58, radius=6, stroke=INK)
        canvas.text(640, y + 18, f"ERA {index + 1}", anchor="middle", bold=True)
        canvas.text(640, y + 35, f"rail {rail}", anchor="middle", size=12, color=RED)
        canvas.text(597, y + 24, "A", size=11)
        canvas.text(597, y + 46, "B", size=11)
        for electrode, offset in enumerate((20, 42)):
            line = 2 * index + electrode
            start, across = 380 + 9 * line, 522 + 8 * line
            canvas.line([(514, start), (across, start), (across, y + offset), (590, y + offset)], color=RED, width=1.1)
        canvas.line([(690, y + 30), (716, y + 30)], color=GREEN, width=1.3)
    canvas.text(586, 138, "one line for each electrode", anchor="middle", size=11, color=GREY)
    canvas.line([(716, 180), (716, 462)], color=GREEN, width=1.3)
    # Loops.
    y = 490
    label_box(canvas, 20, y, 150, 46, "interlock loop", pins["interlock loop"], fill=PALE_GREEN, stroke=GREEN)
    label_box(canvas, 190, y, 190, 46, "emergency-stop loop", pins["emergency stop loop"], fill=PALE_GREEN, stroke=GREEN)
    label_box(canvas, 590, y - 28, 146, 74, "panel and masses", f"earthed; earth bond\nmeasured: {pins['earth bond']}", fill=PALE_GREEN, stroke=GREEN)
    canvas.arrow([(95, y), (95, 452)], color=GREEN)
    canvas.arrow([(230, y), (230, 452)], color=GREEN)
    canvas.arrow([(300, y), (300, 468), (318, 468), (318, 330), (340, 330)], color=RED, dash="4 3")
    canvas.text(326, 476, "also cuts the supply", size=12, color=RED)
    canvas.arrow([(663, 536), (663, 548), (180, 548), (180, 452)], color=GREEN)
    canvas.text(420, 543, "earth bond", anchor="middle", size=12, color=GREEN)
    return canvas


def draw_data_flow(_era):
    """From a scene file to the device."""
    alive = read_duration_ms("keep_alive")
    canvas = Canvas(
        760, 434, "Data flow from a scene file and a touch to the device",
        "Once for each scene: the scene file becomes a model with modes and responses, and then the plan table. For each touch: an "
        "application or the page sends a request to the daemon, the planner makes a plan with the plan table, and the session "
        "sends frames to the device logic. The device logic is the same code in the simulated device, in the emulated board and on the real "
        "board; it drives the panel.",
    )
    canvas.text(20, 30, "once for each scene", bold=True, color=BLUE)
    blue = {"fill": PALE_BLUE, "stroke": BLUE}
    label_box(canvas, 20, 44, 160, 72, "scene file", "TOML: surface,\nsupports, actuators", **blue)
    label_box(canvas, 300, 44, 160, 72, "model", "finite elements, modes,\nreduced model", **blue)
    label_box(canvas, 580, 44, 160, 72, "plan table", "response of each place\nto each actuator", **blue)
    canvas.arrow([(180, 80), (300, 80)])
    canvas.text(240, 72, "SI units", anchor="middle", size=12)
    canvas.arrow([(460, 80), (580, 80)])
    canvas.text(520, 72, "responses", anchor="middle", size=12)
    canvas.text(20, 160, "for each touch", bold=True, color=ORANGE)
    orange = {"fill": PALE_ORANGE, "stroke": ORANGE}
    label_box(canvas, 20, 174, 160, 72, "application, page", "places of fingers,\nstrength, effect", **orange)
    label_box(canvas, 300, 174, 160, 72, "daemon", "checks the request,\nwaits for its turn", **orange)
    label_box(canvas, 580, 174, 160, 72, "planner", "frequency and force\nof each actuator", **orange)
    canvas.arrow([(180, 200), (300, 200)])
    canvas.text(240, 192, "request", anchor="middle", size=12)
    canvas.arrow([(300, 226), (180, 226)])
    canvas.text(240, 242, "plan, state", anchor="middle", size=12)
    canvas.arrow([(460, 200), (580, 200)])
    canvas.text(520, 192, "targets", anchor="middle", size=12)
    canvas.arrow([(580, 226), (460, 226)])
    canvas.text(520, 242, "drives", anchor="middle", size=12)
    canvas.arrow([(660, 116), (660, 174)])
    green = {"fill": PALE_GREEN, "stroke": GREEN}
    canvas.text(20, 290, "while the board is connected", bold=True, color=GREEN)
    label_box(canvas, 300, 304, 160, 92, "session", f"arms, drives, asks for\na sign of life\nevery {alive} ms", **green)
    label_box(canvas, 580, 304, 160, 92, "device logic", "era-shared, in the\nsimulated device,\nemulated board\nor real board", **green)
    label_box(canvas, 20, 304, 160, 92, "panel", "electrodes A and B\nof each ERA move\nthe surface", **green)
    canvas.arrow([(380, 246), (380, 304)])
    canvas.text(388, 280, "drive commands", size=12)
    canvas.arrow([(460, 338), (580, 338)])
    canvas.text(520, 330, "frames", anchor="middle", size=12)
    canvas.arrow([(580, 362), (460, 362)])
    canvas.text(520, 378, "answers", anchor="middle", size=12)
    canvas.arrow([(660, 396), (660, 416), (100, 416), (100, 396)])
    canvas.text(240, 410, "waveforms, rails", anchor="middle", size=12)
    return canvas
