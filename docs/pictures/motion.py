"""Pictures of a drive and of an effect over time."""

import cmath
import math

from canvas import BLUE, GREY, INK, ORANGE, PALE_BLUE, PALE_ORANGE, RED, Canvas, Chart, thin
from sources import read_constant

G = 9.80665
LIMITS = "shared/src/limits.rs"
IDENTITY = "shared/src/protocol/identity.rs"
PERIOD = "shared/src/waveform/period.rs"


def find_division(clock_hz, frequency_hz, most_ticks):
    """Clock divider and ticks of the period that come nearest to the frequency: `divide` of shared/src/waveform/program.rs."""
    clocks = clock_hz / frequency_hz
    least = max(1, math.ceil(clocks / most_ticks))
    choices = [(divider, round(clocks / divider)) for divider in range(least, least + 8)]
    return min((choice for choice in choices if 8 <= choice[1] <= most_ticks), key=lambda c: abs(c[0] * c[1] - clocks))


def find_windows(ticks, width):
    """Windows of A and B in ticks of a period: `TimerPeriod::with_windows` of shared/src/waveform/period.rs."""
    first = (ticks - 2 * width) // 4
    return (first, first + width), (first + ticks // 2, first + ticks // 2 + width)


def draw_waveforms(era):
    """Electrodes A and B over two periods of the example plan's first drive."""
    drive = era.json("plan", "--at", "480,640")["drives"][0]
    clock = read_constant(IDENTITY, "timer_clock_hz")
    least_guard_us = read_constant(LIMITS, "GUARD_NANOSECONDS") / 1e3
    divider, ticks = find_division(clock, drive["frequency_hz"], read_constant(PERIOD, "MOST_TICKS"))
    width = int(ticks * drive["pulse_width"] / 2)
    windows = find_windows(ticks, width)
    tick_us = divider / clock * 1e6
    period_us = ticks * tick_us
    window_us, guard_us = width * tick_us, (ticks // 2 - width) * tick_us
    if guard_us < least_guard_us:
        raise SystemExit("the example drive has too little guard")
    volts = drive["voltage_v"]
    canvas = Canvas(
        760, 452, "Electrodes A and B over two periods of a drive",
        f"A drive of {drive['frequency_hz']:.0f} hertz. In each period of {period_us:.0f} microseconds electrode A is on for "
        f"a window of {window_us:.0f} microseconds, then both are off for a guard of {guard_us:.0f} microseconds, then "
        "electrode B is on. The force on the mass is positive while A is on and negative while B is on; its fundamental "
        "is a sine.",
    )
    left, right, span = 96, 738, (0.0, 2 * period_us)
    rows = [("electrode A", BLUE, PALE_BLUE, 74), ("electrode B", ORANGE, PALE_ORANGE, 182)]
    for index in range(3):
        x = Chart(left, 0, right, 1, span, (0, 1)).x(index * period_us)
        canvas.line([(x, 52), (x, 398)], color=GREY, width=1, dash="3 4")
    for (name, color, pale, top), (on, off) in zip(rows, windows, strict=True):
        chart = Chart(left, top, right, top + 56, span, (0, volts))
        points = [(0, 0)]
        for index in range(2):
            start, end = (index * ticks + on) * tick_us, (index * ticks + off) * tick_us
            points += [(start, 0), (start, volts), (end, volts), (end, 0)]
            canvas.box(chart.x(start), chart.top, chart.x(end) - chart.x(start), 56, fill=pale, stroke="none")
        points.append((2 * period_us, 0))
        canvas.line([(chart.x(x), chart.y(y)) for x, y in points], color=color, width=2)
        canvas.text(14, top + 28, name.replace(" ", "\n"), color=color, bold=True)
        canvas.text(left - 5, chart.top + 5, f"{volts / 1e3:.2f} kV", anchor="end", size=11, color=GREY)
        canvas.text(left - 5, chart.bottom + 4, "0", anchor="end", size=11, color=GREY)
    chart = Chart(left, 290, right, 370, span, (-1.35, 1.35))
    canvas.line([(left, chart.y(0)), (right, chart.y(0))], color=GREY, width=1)
    points = [(0, 0)]
    for index in range(2):
        for (on, off), sign in zip(windows, (1, -1), strict=True):
            start, end = (index * ticks + on) * tick_us, (index * ticks + off) * tick_us
            points += [(start, 0), (start, sign), (end, sign), (end, 0)]
    points.append((2 * period_us, 0))
    canvas.line([(chart.x(x), chart.y(y)) for x, y in points], width=2)
    # Fundamental of a square force with windows of this fraction of half a period: 4/pi sin(pi w/2).
    height = 4 / math.pi * math.sin(math.pi * width / ticks)
    middle = sum(windows[0]) / 2 * tick_us
    sine = [(x, height * math.cos(2 * math.pi * (x - middle) / period_us)) for x in (2 * period_us * i / 240 for i in range(241))]
    canvas.line(thin([(chart.x(x), chart.y(y)) for x, y in sine]), color=RED, width=1.4, dash="6 3")
    canvas.text(14, 308, "force on\nthe mass", bold=True)
    canvas.text(right - 4, 286, "dashed: its fundamental", anchor="end", color=RED, size=12)
    for index in range(0, int(2 * period_us / 1000) + 1):
        x = chart.x(index * 1000)
        canvas.line([(x, 398), (x, 403)], color=GREY)
        canvas.text(x, 417, f"{index}", anchor="middle", size=12, color=GREY)
    canvas.line([(left, 398), (right, 398)], color=GREY, width=1)
    canvas.text((left + right) / 2, 436, "time in ms", anchor="middle")

    def dimension(start_us, end_us, y, label, *, above=True):
        canvas.arrow([(chart.x(start_us), y), (chart.x(end_us), y)], both=True, color=INK, width=1)
        canvas.text((chart.x(start_us) + chart.x(end_us)) / 2, y - 5 if above else y + 15, label, anchor="middle", size=12)

    (a_on, a_off), (b_on, _) = windows
    dimension(0, period_us, 44, f"period 1/f = {period_us:.0f} µs (f = {drive['frequency_hz']:.0f} Hz)")
    dimension(a_on * tick_us, a_off * tick_us, 108, f"window {window_us:.0f} µs")
    for x in (a_off, b_on):
        canvas.line([(chart.x(x * tick_us), 130), (chart.x(x * tick_us), 238 if x == b_on else 160)], color=GREY, width=0.8)
    dimension(a_off * tick_us, b_on * tick_us, 154, "")
    canvas.text(chart.x(a_off * tick_us) - 6, 158, f"guard {guard_us:.0f} µs", anchor="end", size=12)
    half = ticks // 2 * tick_us
    dimension(period_us, period_us + half, 154, f"half a period {half:.0f} µs")
    canvas.text(left + 4, 264, f"pulse width = window / half a period = {width / (ticks // 2):.3f}", size=12)
    canvas.text(right - 4, 264, f"guard: at least {least_guard_us:.0f} µs", anchor="end", size=12)
    return canvas


CLICK_AT = "40,100"
CLICK_G = "0.4"
STEP_S = 2.5e-4
SHOWN_S = 0.08


def weigh_felt(hertz):
    """What a frequency counts in the felt band: full to 300 Hz, a raised cosine to nothing at 500 Hz."""
    return math.cos(math.pi / 2 * min(max((hertz - 300) / 200, 0.0), 1.0)) ** 2


def compute_felt_motion(era, click, force_n):
    """Felt acceleration in m/s^2 of the clicked place, from `era response` and the windows alone, line by line of 1 Hz; `force_n` is that of each
    actuator's electrode at 1 V."""
    response = era.json("response", "--at", CLICK_AT, "--from", 1, "--to", 499, "--step", 1)
    motion = [0.0] * round(SHOWN_S / STEP_S)
    for number, hertz in enumerate(response["frequency_hz"]):
        omega = 2 * math.pi * hertz
        line = 0j
        for actuator in response["actuators"]:
            force = 0j
            for window in (own for own in click["windows"] if own["actuator"] == actuator["id"]):
                begin, width = window["begin_us"] * 1e-6, window["width_us"] * 1e-6
                turned = cmath.exp(-1j * omega * begin) * (1 - cmath.exp(-1j * omega * width)) / (1j * omega)
                force += (1 if window["electrode"] == "A" else -1) * force_n * window["voltage_v"] ** 2 * turned
            line += complex(actuator["acceleration_re"][number], actuator["acceleration_im"][number]) * force
        line *= 2 * weigh_felt(hertz)
        step, now = cmath.exp(1j * omega * STEP_S), line
        for index in range(len(motion)):
            motion[index] += now.real
            now *= step
    return motion


def draw_push_and_brake(canvas, chart, predicted):
    """Below the windows of `chart`: which part of a click is before the peak, and which is from the peak until the panel is quiet."""
    times = (0.0, predicted["peak_at_ms"], predicted["quiet_ms"])
    for time in times[1:]:
        canvas.line([(chart.x(time), 44), (chart.x(time), 330)], color=GREY, width=1, dash="3 4")
    for start, end, name in zip(times[:-1], times[1:], ("push", "brake"), strict=True):
        canvas.arrow([(chart.x(start), 200), (chart.x(end), 200)], both=True, width=1)
        canvas.text((chart.x(start) + chart.x(end)) / 2, 193, name, anchor="middle", bold=True)


def draw_click(era):
    """A click on the example plate: the windows of both actuators, and the felt acceleration that they make."""
    click = era.json("effect", "click", "--at", CLICK_AT, "--unit", "mm", "--intensity-g", CLICK_G)
    predicted = click["predicted"]
    # eps0 S / (2 g^2) of the example plate's electrodes: 1963.5 mm^2, 500 um.
    motion = compute_felt_motion(era, click, 8.8541878128e-12 * 1963.5e-6 / (2 * 500e-6**2))
    peak = max(map(abs, motion)) / G
    # The gaps move by a few hundredths, which this leaves out.
    if not 0.93 * predicted["peak_g"] < peak < 1.07 * predicted["peak_g"]:
        raise SystemExit(f"the click's peak is {peak:.3f} g here; era effect says {predicted}")
    canvas = Canvas(
        760, 400, "A click: windows of both actuators, and the acceleration of the touched place",
        f"A click of {CLICK_G} g at {CLICK_AT} millimetres of the example plate. Single windows of electrodes A and B push until "
        f"the peak, and then brake. The felt acceleration has its peak after {predicted['peak_at_ms']:.0f} milliseconds and is "
        f"below a tenth of the peak from {predicted['quiet_ms']:.0f} milliseconds on.",
    )
    left, right, span = 78, 738, (0.0, SHOWN_S * 1e3)
    canvas.text(left, 26, "windows: electrode A upwards, electrode B downwards", bold=True)
    names = list(dict.fromkeys(drive["actuator"] for drive in click["plan"]["drives"]))
    for name, top, color in zip(names, (44, 118), (BLUE, ORANGE), strict=True):
        chart = Chart(left, top, right, top + 56, span, (-1.15, 1.15))
        canvas.axis_y(chart, (), "")
        points = [(0.0, 0.0)]
        for window in (own for own in click["windows"] if own["actuator"] == name):
            begin, end = window["begin_us"] / 1e3, (window["begin_us"] + window["width_us"]) / 1e3
            level = 1.0 if window["electrode"] == "A" else -1.0
            points += [(begin, 0.0), (begin, level), (end, level), (end, 0.0)]
        points.append((SHOWN_S * 1e3, 0.0))
        canvas.line(chart.points(*zip(*points, strict=True)), color=color, width=1.5)
        canvas.frame(chart)
        volts = max((own["voltage_v"] for own in click["windows"] if own["actuator"] == name), default=0.0)
        canvas.text(right - 8, top + 17, f"{name}: {volts / 1e3:.2f} kV", anchor="end", color=color)
    draw_push_and_brake(canvas, chart, predicted)
    top_g = math.ceil(peak * 10) / 10
    chart = Chart(left, 216, right, 330, span, (-top_g, top_g))
    tenth = 0.1 * predicted["peak_g"]
    canvas.box(left, chart.y(tenth), right - left, chart.y(-tenth) - chart.y(tenth), fill="#f3f4f6", stroke="none")
    canvas.axis_y(chart, (-0.4, -0.2, 0, 0.2, 0.4), "")
    times = [index * STEP_S * 1e3 for index in range(len(motion))]
    canvas.line(thin(chart.points(times, [value / G for value in motion]), 0.4), color=INK, width=1.1)
    canvas.frame(chart)
    canvas.text(
        right - 8, 233, f"peak {predicted['peak_g']:.2f} g, below a tenth from {predicted['quiet_ms']:.1f} ms on", anchor="end", color=INK
    )
    canvas.axis_x(chart, range(0, 81, 10), "time in ms", grid=False)
    canvas.text(22, 273, "acceleration in g", anchor="middle", turn=-90)
    place = CLICK_AT.replace(",", " mm, ")
    canvas.text(left, 390, f"Example plate at {place} mm. Grey: a tenth of the peak.", size=12, color=GREY)
    return canvas
