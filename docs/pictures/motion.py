"""Pictures of a drive and of an effect over time."""

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


CLICK_AT = "150,60"
CLICK_G = "0.4"
STEP_S = 2e-5
SHOWN_S = 0.2


def draw_click(era):
    """A click on the example plate: levels of both drives, and the acceleration with and without its brake."""
    click = era.json("effect", "click", "--at", CLICK_AT, "--unit", "mm", "--intensity-g", CLICK_G)
    count = round(SHOWN_S / STEP_S) + 1
    braked, unbraked = [0.0] * count, [0.0] * count
    for drive in click["drives"]:
        columns = era.columns(
            "transient", "--at", CLICK_AT, "--duration", SHOWN_S, "--step", STEP_S,
            "--drive", f"{drive['actuator']}:{drive['frequency_hz']}:{drive['force_n']}",
        )
        response = columns["acceleration_m_per_s2"]
        # The panel is linear: a level that changes at whole periods is a sum of sines that are switched on then.
        changes = find_changes(drive)
        add_steps(braked, response, changes)
        add_steps(unbraked, response, [changes[0], (changes[1][0], -1.0)])
    peak = max(map(abs, braked)) / G
    predicted = click["predicted"]
    if not 0.9 * predicted["peak_least_g"] < peak < 1.1 * predicted["peak_most_g"]:
        raise SystemExit(f"the click's peak is {peak:.3f} g here; era effect says {predicted}")
    push_ms = max(find_changes(drive)[1][0] for drive in click["drives"]) * 1e3
    canvas = Canvas(
        760, 520, "A click: levels of both drives, and the acceleration of the touched place",
        f"A click of {CLICK_G} g at {CLICK_AT} millimetres of the example plate. Each drive pushes for a few periods at full "
        "level and then brakes at other levels, some of them reversed. The acceleration rises to its peak "
        f"within about {predicted['peak_at_ms']:.0f} milliseconds. With the brake it falls below a tenth of the peak after "
        f"{predicted['quiet_ms']:.0f} milliseconds, without it after {predicted['quiet_unbraked_ms']:.0f}.",
    )
    left, right, span = 78, 738, (0.0, SHOWN_S * 1e3)
    canvas.text(left, 26, "level of each drive: push, then brake", bold=True)
    for drive, top, color in zip(click["drives"], (44, 118), (BLUE, ORANGE), strict=True):
        chart = Chart(left, top, right, top + 56, span, (-1.15, 1.15))
        canvas.axis_y(chart, (-1, 0, 1), "")
        points, level = [(0.0, 0.0)], 0.0
        for at, change in find_changes(drive):
            points += [(at * 1e3, level), (at * 1e3, level + change)]
            level += change
        points.append((SHOWN_S * 1e3, 0.0))
        canvas.line(chart.points(*zip(*points, strict=True)), color=color, width=2)
        canvas.frame(chart)
        canvas.text(
            right - 8, top + 17, f"{drive['actuator']}: {drive['frequency_hz']:.0f} Hz, {drive['voltage_v'] / 1e3:.2f} kV",
            anchor="end", color=color,
        )
    top_g = math.ceil(max(map(abs, braked + unbraked)) / G * 10) / 10
    times = [index * STEP_S * 1e3 for index in range(count)]
    for values, top, color, label in (
        (braked, 216, INK, f"with the brake: below a tenth of the peak from {predicted['quiet_ms']:.1f} ms on"),
        (unbraked, 346, RED, f"push alone: below a tenth from {predicted['quiet_unbraked_ms']:.1f} ms on"),
    ):
        chart = Chart(left, top, right, top + 114, span, (-top_g, top_g))
        tenth = 0.1 * predicted["peak_g"]
        canvas.box(left, chart.y(tenth), right - left, chart.y(-tenth) - chart.y(tenth), fill="#f3f4f6", stroke="none")
        canvas.axis_y(chart, (-0.4, -0.2, 0, 0.2, 0.4), "")
        canvas.line(thin(chart.points(times, [value / G for value in values]), 0.4), color=color, width=1.1)
        canvas.frame(chart)
        canvas.text(right - 8, top + 17, label, anchor="end", color=color)
        if color == RED:
            canvas.axis_x(chart, range(0, 201, 25), "time in ms", grid=False)
    canvas.text(22, 338, "acceleration in g", anchor="middle", turn=-90)
    canvas.text(22, 110, "level", anchor="middle", turn=-90)
    place = CLICK_AT.replace(",", " mm, ")
    note = f"Example plate at {place} mm. Grey: a tenth of the peak. Pushes end at {push_ms:.0f} ms at the latest."
    canvas.text(left, 510, note, size=12, color=GREY)
    return canvas


def find_changes(drive):
    """When a drive's level changes, in s, and by how much; at its end to 0."""
    changes, at, level = [], 0.0, 0.0
    for segment in drive["segments"]:
        changes.append((at, segment["level"] - level))
        level = segment["level"]
        at += segment["cycles"] / drive["frequency_hz"]
    return [*changes, (at, -level)]


def add_steps(total, response, changes):
    """Adds the responses to a sine that is switched on at each change, times the change, to `total`."""
    for at, change in changes:
        offset = at / STEP_S
        first = math.ceil(offset)
        part = first - offset
        for index in range(first, len(total)):
            later = index - first
            before = response[later]
            after = response[later + 1] if later + 1 < len(response) else before
            total[index] += change * ((1 - part) * before + part * after)
