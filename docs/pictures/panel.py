"""Pictures of the panel: its modes, and node lines at one frequency and at two."""

import math

from canvas import BLUE, GREEN, GREY, INK, ORANGE, PALE, RED, Canvas, Chart, contour, interpolate, thin
from sources import read_scene

G = 9.80665
# Steps of a map's colours.
STEPS = 32
# Columns and rows of maps of the plate: twice as fine as the program's own grid.
GRID = "97,65"


def mix(low, high, part):
    return tuple(round(a + (b - a) * part) for a, b in zip(low, high, strict=True))


def make_palette(stops):
    """STEPS colours through the colours `stops`, at equal distances."""
    palette = []
    for index in range(STEPS):
        at = index / (STEPS - 1) * (len(stops) - 1)
        first = min(int(at), len(stops) - 2)
        palette.append(mix(stops[first], stops[first + 1], at - first))
    return palette


DIVERGING = make_palette([(37, 99, 235), (191, 219, 254), (255, 255, 255), (254, 215, 170), (194, 65, 12)])
RISING = make_palette([(23, 37, 84), (30, 64, 175), (59, 130, 246), (147, 197, 253), (254, 243, 199), (252, 211, 77)])


def draw_map(canvas, x, y, width, height, field, low, high, palette):
    """`field` as colours between `low` and `high`."""
    fine = interpolate(field, len(field[0]) - 1, len(field) - 1)
    scale = STEPS / (high - low)
    rows = [[max(0, min(STEPS - 1, int((value - low) * scale))) for value in row] for row in fine]
    canvas.image(x, y, width, height, rows, palette)


def draw_support(canvas, x, y):
    corners = [(x, y - 6), (x - 6, y + 5), (x + 6, y + 5)]
    canvas.line(corners, fill="#ffffff", color=GREEN, width=1.6, closed=True)


def draw_place(canvas, x, y):
    """The mark of an ERA."""
    canvas.circle(x, y, 5, fill="#ffffff", stroke=RED, stroke_width=2)


def draw_parts(canvas, scene, x, y, scale, *, names=False):
    """Supports (triangles) and ERAs (circles) of a scene."""
    for support in scene.get("support", []):
        at_x, at_y = x + scale * support["x_mm"], y + scale * support["y_mm"]
        draw_support(canvas, at_x, at_y)
    for actuator in scene["actuator"]:
        at_x, at_y = x + scale * actuator["x_mm"], y + scale * actuator["y_mm"]
        draw_place(canvas, at_x, at_y)
        if names:
            # Names stay inside the edges.
            inset, length = 18, scale * scene["surface"]["length_mm"]
            canvas.text(min(max(at_x, x + inset), x + length - inset), at_y - 11, actuator["id"], anchor="middle", size=12)


def draw_modes(era):
    """The example plate with its supports and ERAs, and its first modes."""
    scene = read_scene("plate")
    shapes, axes = era.arrays("modes", "--max-hz", 320, "--grid", GRID)
    surface = scene["surface"]
    length, width = surface["length_mm"], surface["width_mm"]
    shown = 8
    frequencies = axes["frequency_hz"][:shown]
    canvas = Canvas(
        760, 590, "The example plate and its first eight modes",
        f"A plate of {length:.0f} by {width:.0f} millimetres with a spring at each corner and two ERAs, and its modes at "
        + ", ".join(f"{frequency:.0f}" for frequency in frequencies)
        + " hertz. In the first three modes the plate moves nearly as a rigid body; in the others it bends. A black line is a "
        "node line, on which a mode does not move the plate.",
    )
    scale = 0.7
    map_width, map_height = scale * length, scale * width
    lefts, tops = (28, 275, 522), (48, 224, 400)
    canvas.text(lefts[0], tops[0] - 12, "plate", bold=True)
    canvas.box(lefts[0], tops[0], map_width, map_height, fill="#f3f4f6", stroke=GREY)
    draw_parts(canvas, scene, lefts[0], tops[0], scale, names=True)
    canvas.text(lefts[0] + map_width / 2, tops[0] + 22, f"{length:.0f} x {width:.0f} x {surface['thickness_mm']:.0f} mm", anchor="middle", size=12)
    draw_support(canvas, lefts[0] + 17, tops[0] + 60)
    canvas.text(lefts[0] + 30, tops[0] + 65, "spring", size=12)
    draw_place(canvas, lefts[0] + 97, tops[0] + 60)
    canvas.text(lefts[0] + 108, tops[0] + 65, "ERA", size=12)
    for index in range(shown):
        place = index + 1
        x, y = lefts[place % 3], tops[place // 3]
        shape = shapes[index]
        most = max(abs(value) for row in shape for value in row)
        # A numerical zero must not make node lines of rounding.
        field = [[value if abs(value) > 1e-6 * most else 0.0 for value in row] for row in shape]
        canvas.text(x, y - 12, f"mode {index + 1}: {frequencies[index]:.1f} Hz", bold=True)
        canvas.text(x + map_width, y - 12, f"{100 * find_rigid_fraction(shape):.0f} % rigid", anchor="end", size=12, color=GREY)
        draw_map(canvas, x, y, map_width, map_height, field, -most, most, DIVERGING)
        canvas.path(contour(field, 1e-9 * most, x, y, map_width, map_height), color=INK, width=1.6)
        draw_parts(canvas, scene, x, y, scale)
    canvas.text(
        380, 562, "Orange and blue move in opposite directions. Black: node lines. Rigid: fraction of the mean square motion\n"
        "that a rigid plate would have.", anchor="middle", size=12, color=GREY,
    )
    return canvas


def find_rigid_fraction(shape):
    """The fraction of a mode's mean square deflection that is motion as a rigid body: bounce, pitch and roll."""
    rows, columns = len(shape), len(shape[0])
    points = [(2 * j / (columns - 1) - 1, 2 * i / (rows - 1) - 1, shape[i][j]) for i in range(rows) for j in range(columns)]
    total = sum(value * value for _, _, value in points)
    rigid = 0.0
    # 1, x and y are orthogonal over a grid that is symmetrical about the middle.
    for basis in ([1.0 for _ in points], [x for x, _, _ in points], [y for _, y, _ in points]):
        product = sum(a * value for a, (_, _, value) in zip(basis, points, strict=True))
        rigid += product * product / sum(a * a for a in basis)
    return rigid / total


def draw_node_lines(era):
    """Peak over the plate: each of two drives alone, and both, at distinct frequencies."""
    scene = read_scene("plate")
    schemes = era.json("field", "--schemes", "--from", 122)
    distinct = next(entry for entry in schemes["schemes"] if entry["scheme"] == "distinct_frequencies")
    fields = []
    for index, drive in enumerate(distinct["setting"]):
        frequency = drive["frequency_hz"]
        values, _ = era.arrays("sweep", "--from", frequency, "--to", frequency, "--step", 1, "--grid", GRID)
        fields.append([[abs(value) * drive["force_n"] / G for value in row] for row in values[0][index]])
    both = [[sum(values) for values in zip(*rows, strict=True)] for rows in zip(*fields, strict=True)]
    least = min(min(row) for row in both)
    told = distinct["one_setting"]["least"]
    if not 0.95 < least / told < 1.3:
        raise SystemExit(f"the weakest place has {least} g here; era field --schemes says {told}")
    low = told
    settings = distinct["setting"]
    names = [f"{drive['actuator']} alone, {drive['frequency_hz']:.0f} Hz" for drive in settings] + ["both at once"]
    canvas = Canvas(
        760, 300, "Node lines: each of two drives alone, and both at once",
        f"Three maps of the peak acceleration over the example plate. {names[0]}, and {names[1]}: each leaves dark "
        f"places that hardly move; a red line bounds what is below {low:.3f} g. Both at once: every place has at least {low:.3f} g.",
    )
    scale, tops = 0.755, 56
    map_width, map_height = scale * scene["surface"]["length_mm"], scale * scene["surface"]["width_mm"]
    bottom_log, top_log = math.log10(0.03), math.log10(10.0)
    for x, field, name in zip((18, 267, 516), (*fields, both), names, strict=True):
        logs = [[math.log10(max(value, 1e-6)) for value in row] for row in field]
        weakest = min(min(row) for row in field)
        canvas.text(x, 26, name, bold=True)
        canvas.text(x, 44, f"weakest place {told if field is both else weakest:.3f} g", size=12, color=GREY)
        draw_map(canvas, x, tops, map_width, map_height, logs, bottom_log, top_log, RISING)
        if field is not both:
            canvas.path(contour(logs, math.log10(low), x, tops, map_width, map_height), color="#ef4444", width=1.4)
        draw_parts(canvas, scene, x, tops, scale)
    # The scale.
    chart = Chart(267, 238, 267 + map_width, 250, (bottom_log, top_log), (0, 1))
    canvas.image(chart.left, chart.top, map_width, 12, [list(range(STEPS))], RISING)
    for tick in (0.03, 0.1, 0.3, 1.0, 3.0, 10.0):
        x = chart.x(math.log10(tick))
        canvas.line([(x, 250), (x, 254)], color=GREY)
        canvas.text(x, 267, f"{tick:g}", anchor="middle", size=12, color=GREY)
    canvas.text(chart.left + map_width / 2, 285, "peak acceleration in g", anchor="middle")
    canvas.line([(18, 244), (42, 244)], color="#ef4444", width=1.4)
    canvas.text(48, 248, f"{low:.3f} g", size=12)
    canvas.text(18, 267, "on the dark side of a red line: less\nthan both have at their weakest place", size=12)
    draw_support(canvas, 522, 245)
    canvas.text(535, 249, "spring", size=12)
    draw_place(canvas, 603, 244)
    canvas.text(614, 249, "ERA", size=12)
    return canvas


def draw_node_lines_bar(era):
    """Peak over the example bar: one frequency in phase, and two, with what each of them does."""
    scene = read_scene("bar")
    path = "examples/scenes/bar.toml"
    schemes = era.json("field", "--schemes", "--scene", path, "--from", 148)
    chosen = {entry["scheme"]: entry for entry in schemes["schemes"]}
    one, two = chosen["one_frequency_in_phase"], chosen["distinct_frequencies"]
    length = scene["surface"]["length_mm"]

    def responses(frequency):
        # Four times as fine as the grid of the plan table: on these points the program looks for the weakest place.
        values, axes = era.arrays("sweep", "--scene", path, "--from", frequency, "--to", frequency, "--step", 1, "--grid", "193,1")
        return [row[0] for row in values[0]], [1e3 * x for x in axes["x_m"]]

    single = one["setting"]
    values, xs = responses(single[0]["frequency_hz"])
    in_phase = [abs(sum(d["force_n"] * v[i] for d, v in zip(single, values, strict=True))) / G for i in range(len(xs))]
    parts = []
    # The bar is its own mirror image, so rounding decides which actuator has which frequency: here the first one has the higher one.
    places = [actuator["x_mm"] for actuator in scene["actuator"]]
    if abs(sum(places) - length) > 1e-9:
        raise SystemExit("the example bar has lost its symmetry: adapt docs/pictures/panel.py")
    names = [drive["actuator"] for drive in two["setting"]]
    falling = sorted(two["setting"], key=lambda drive: drive["frequency_hz"], reverse=True)
    drives = [drive | {"actuator": name} for name, drive in zip(names, falling, strict=True)]
    for index, drive in enumerate(drives):
        values, _ = responses(drive["frequency_hz"])
        parts.append([abs(value) * drive["force_n"] / G for value in values[index]])
    both = [a + b for a, b in zip(*parts, strict=True)]
    low_log, high_log = -1.0, math.log10(20.0)
    least = (one["one_setting"]["least"], two["one_setting"]["least"])
    frequencies = [drive["frequency_hz"] for drive in drives]
    canvas = Canvas(
        760, 520, "Peak acceleration along the example bar: one frequency, and two",
        f"Upper chart: both ERAs at {single[0]['frequency_hz']:.0f} hertz in phase; the acceleration falls to {least[0]:.2f} g "
        f"at the nodes. Lower chart: {frequencies[0]:.0f} and {frequencies[1]:.0f} hertz; where one of the two has a node "
        f"the other moves the bar, and no place has less than {least[1]:.2f} g.",
    )
    for top, title, floor in (
        (42, f"one frequency: both ERAs at {single[0]['frequency_hz']:.0f} Hz, in phase", least[0]),
        (276, "two frequencies: " + " and ".join(f"{d['frequency_hz']:.0f} Hz ({d['actuator']})" for d in drives), least[1]),
    ):
        chart = Chart(64, top, 738, top + 180, (0, length), (low_log, high_log))
        canvas.text(64, top - 12, title, bold=True)
        canvas.text(738, top - 12, f"weakest place {floor:.2f} g", anchor="end", color=RED)
        for tick in (0.1, 0.3, 1, 3, 10):
            y = chart.y(math.log10(tick))
            canvas.line([(chart.left, y), (chart.right, y)], color=PALE, width=1)
            canvas.text(chart.left - 6, y + 4, f"{tick:g}", anchor="end", size=12, color=GREY)
        canvas.text(24, top + 90, "peak in g", anchor="middle", turn=-90)
        lower = top > 100
        canvas.axis_x(chart, range(0, int(length) + 1, 50), "place along the bar in mm" if lower else "")
        if lower:
            for part, color in zip(parts, (BLUE, ORANGE), strict=True):
                draw_log_curve(canvas, chart, xs, part, color=color, width=1.4, dash="5 3")
            for index, color in enumerate((BLUE, ORANGE)):
                x = 92 + 130 * index
                canvas.line([(x, top + 16), (x + 26, top + 16)], color=color, width=1.4, dash="5 3")
                canvas.text(x + 32, top + 20, f"{frequencies[index]:.0f} Hz", size=12)
            canvas.line([(352, top + 16), (378, top + 16)], width=2)
            canvas.text(384, top + 20, "sum", size=12)
        draw_log_curve(canvas, chart, xs, both if lower else in_phase, color=INK, width=2)
        canvas.line([(chart.left, chart.y(math.log10(floor))), (chart.right, chart.y(math.log10(floor)))], color=RED, width=1, dash="2 3")
        for actuator in scene["actuator"]:
            canvas.circle(chart.x(actuator["x_mm"]), chart.bottom, 4, fill="#ffffff", stroke=RED, stroke_width=2)
        canvas.frame(chart)
    canvas.circle(70, 494, 4, fill="#ffffff", stroke=RED, stroke_width=2)
    canvas.text(80, 498, "ERA", size=12, color=GREY)
    return canvas


def draw_log_curve(canvas, chart, xs, values, **style):
    """A curve on a logarithmic axis, without what is below the axis."""
    low = 10 ** chart.y_range[0]
    points = list(zip(xs, values, strict=True))
    run = []
    for index, (x, value) in enumerate(points):
        before = points[max(index - 1, 0)]
        if (value < low) != (before[1] < low):
            # Where the curve crosses the axis.
            part = (low - before[1]) / (value - before[1])
            run.append((chart.x(before[0] + part * (x - before[0])), chart.bottom))
        if value >= low:
            run.append((chart.x(x), chart.y(math.log10(value))))
        if run and (value < low or index == len(points) - 1):
            canvas.line(thin(run), **style)
            run = []
