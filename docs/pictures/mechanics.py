"""Pictures of one ERA: its cross-section, and its two mounts."""

from canvas import BLUE, GREY, INK, ORANGE, PALE_BLUE, PALE_ORANGE, RED, Canvas
from sources import read_scene

SURFACE = "#bfdbfe"
MASS = "#d1d5db"
INSULATOR = "#fde68a"
# The gap in pixels; stop and sag have the same scale.
GAP_PX = 80


def draw_era(canvas, middle, sag_px, stop_px, notes):
    """One grounded ERA whose mass and surface have moved down by `sag_px`; with `notes`, its parts are named."""
    top_a, mass_height = 136, 36
    mass_top = top_a + 10 + GAP_PX + sag_px
    bottom_b = top_a + 10 + 2 * GAP_PX + mass_height
    base = bottom_b + 40
    surface = 66 + sag_px
    # Housing of insulator with both electrodes.
    canvas.box(middle - 138, top_a, 10, base - top_a, fill=INSULATOR, stroke=GREY)
    canvas.box(middle + 128, top_a, 10, base - top_a, fill=INSULATOR, stroke=GREY)
    for left, width in ((-128, 112), (16, 112)):
        canvas.box(middle + left, top_a, width, 10, fill=PALE_BLUE, stroke=BLUE)
    canvas.box(middle - 128, bottom_b, 256, 10, fill=PALE_ORANGE, stroke=ORANGE)
    # Stops: bumps on the electrodes that leave stop_px to the mass at rest.
    bump = GAP_PX - stop_px
    canvas.box(middle - 106, top_a + 10, 12, bump, fill=INSULATOR, stroke=GREY)
    canvas.box(middle - 106, bottom_b - bump, 12, bump, fill=INSULATOR, stroke=GREY)
    # What moves.
    canvas.box(middle - 8, surface + 14, 16, mass_top - surface - 14, fill=MASS)
    canvas.box(middle - 120, mass_top, 240, mass_height, fill=MASS)
    canvas.box(middle - 175, surface, 350, 14, fill=SURFACE, radius=2)
    for side in (-158, 158):
        canvas.spring(middle + side, surface + 14, base, coils=7)
    canvas.ground(middle, base, 350)
    if notes:
        canvas.text(middle + 165, surface - 7, "surface", anchor="end")
        canvas.text(middle, mass_top + 23, "mass, grounded", anchor="middle")
        canvas.text(middle + 124, top_a - 7, "electrode A", anchor="end", color=BLUE)
        canvas.text(middle, bottom_b + 27, "electrode B", anchor="middle", color=ORANGE)
        canvas.text(middle - 146, surface + 52, "springs")
        canvas.text(middle, base + 26, "base", anchor="middle")
    return top_a + 10, mass_top, mass_top + mass_height, bottom_b, surface


def draw_cross_section(era):
    """An ERA of the example plate at rest, and under a press."""
    actuator = read_scene("plate")["actuator"][0]
    press = era.json("press")
    sagging = next(entry for entry in press["actuators"] if entry["actuator"] == actuator["id"])
    gap, stop = actuator["air_gap_um"], actuator["stop_um"]
    sag, remaining = sagging["sag_um"], sagging["gap_left_um"]
    scale = GAP_PX / gap
    canvas = Canvas(
        760, 446, "Cross-section of an ERA, at rest and under a press",
        "Left: a grounded mass hangs between electrode A above it and electrode B below it. The mass is joined to the "
        f"surface, and springs hold both on the base. Each gap is {gap:.0f} micrometres wide; stops leave {stop:.0f} "
        f"micrometres to the mass. Right: a press of {press['force_n']:.0f} newton moves surface and mass down by the sag "
        f"of {sag:.0f} micrometres, until the mass rests on its stop. A gap of {remaining:.0f} micrometres remains.",
    )
    canvas.text(195, 28, "at rest", anchor="middle", size=15, bold=True)
    canvas.text(565, 28, f"under a press of {press['force_n']:.0f} N", anchor="middle", size=15, bold=True)

    a, mass_top, mass_bottom, b, _ = draw_era(canvas, 195, 0, stop * scale, notes=True)
    for low, high in ((a, mass_top), (mass_bottom, b)):
        canvas.arrow([(235, low), (235, high)], both=True, color=INK)
        canvas.text(242, (low + high) / 2 + 4, f"gap {gap:.0f} µm", size=12)
    canvas.line([(80, mass_bottom + stop * scale), (138, mass_bottom + stop * scale)], width=0.8, dash="3 2", color=GREY)
    canvas.arrow([(122, mass_bottom), (122, mass_bottom + stop * scale)], both=True)
    canvas.text(129, mass_bottom + 14, f"{stop:.0f} µm", size=12)
    canvas.text(105, mass_bottom + stop * scale + 30, "stop", size=12)

    middle = 565
    a, mass_top, mass_bottom, b, surface = draw_era(canvas, middle, sag * scale, stop * scale, notes=False)
    canvas.box(middle - 175, surface - sag * scale, 350, 14, fill="none", stroke=GREY, dash="4 3", stroke_width=1)
    rest = mass_top - sag * scale
    outline = [(middle - 120, mass_top), (middle - 120, rest), (middle + 120, rest), (middle + 120, mass_top)]
    canvas.line(outline, color=GREY, width=1, dash="4 3")
    canvas.arrow([(middle, 38), (middle, surface)], color=RED, width=2.4)
    canvas.arrow([(middle + 40, mass_bottom), (middle + 40, b)], both=True)
    canvas.text(middle + 47, (mass_bottom + b) / 2 - 3, "remaining", size=12)
    canvas.text(middle + 47, (mass_bottom + b) / 2 + 12, f"gap {remaining:.0f} µm", size=12)
    canvas.arrow([(middle + 40, rest), (middle + 40, mass_top)], both=True, color=RED)
    canvas.text(middle + 47, rest - 6, f"sag {sag:.0f} µm", size=12, color=RED)
    canvas.text(middle, mass_top + 23, "mass on its stop", anchor="middle")
    canvas.text(
        middle, 412, f"The remaining gap safely holds {sagging['holds_v'] / 1e3:.2f} kV.\n"
        f"Without the stop the mass would move by {sagging['alone_um']:.0f} µm.", anchor="middle", size=12,
    )
    canvas.text(195, 428, "gap, stop and sag to scale; the rest is not", anchor="middle", size=12, color=GREY)
    return canvas


def draw_mounts(_era):
    """The grounded and the inertial mount."""
    canvas = Canvas(
        760, 390, "The two mounts of an ERA: grounded and inertial",
        "Grounded: both electrodes stand on the base; the mass is joined to the surface, and springs stand between base and "
        "surface. The force acts on mass and surface, and against the base. Inertial: a housing with both electrodes is "
        "fixed under the surface, and the mass hangs in it on springs. The force acts on the surface, and against the mass.",
    )
    for middle, title in ((195, "grounded"), (565, "inertial")):
        canvas.text(middle, 28, f'mount = "{title}"', anchor="middle", size=15, bold=True)
        canvas.box(middle - 165, 70, 330, 14, fill=SURFACE, radius=2)
        canvas.text(middle - 160, 62, "surface")

    middle, base = 195, 300
    canvas.box(middle - 8, 84, 16, 90, fill=MASS)
    for left in (-92, 16):
        canvas.box(middle + left, 126, 76, 10, fill=PALE_BLUE, stroke=BLUE)
    canvas.box(middle - 84, 174, 168, 34, fill=MASS)
    canvas.box(middle - 92, 246, 184, 10, fill=PALE_ORANGE, stroke=ORANGE)
    for side in (-102, 92):
        canvas.box(middle + side, 126, 10, base - 126, fill=INSULATOR, stroke=GREY)
    for side in (-140, 140):
        canvas.spring(middle + side, 84, base, coils=7)
    canvas.ground(middle, base, 340)
    canvas.text(middle, 196, "mass", anchor="middle")
    canvas.text(middle + 54, 120, "A", anchor="middle", color=BLUE, bold=True)
    canvas.text(middle, 274, "B", anchor="middle", color=ORANGE, bold=True)
    canvas.text(middle, base + 26, "base", anchor="middle")
    canvas.arrow([(middle - 50, 174), (middle - 50, 144)], color=RED, width=2.4)
    canvas.text(middle - 44, 158, "F", color=RED, bold=True)
    canvas.arrow([(middle + 52, 142), (middle + 52, 168)], color=RED, width=2.4)
    canvas.text(middle + 58, 158, "−F", color=RED, bold=True)
    canvas.text(middle, 350, "The springs hold the surface. F moves mass and surface;\nthe base takes the reaction −F.", anchor="middle", size=12)

    middle = 565
    canvas.box(middle - 120, 84, 240, 186, fill="#ffffff", stroke=GREY, stroke_width=1.6)
    canvas.text(middle + 126, 180, "housing", size=12, color=GREY)
    canvas.box(middle - 60, 84, 120, 10, fill=PALE_BLUE, stroke=BLUE)
    canvas.box(middle - 105, 159, 210, 36, fill=MASS)
    canvas.box(middle - 60, 260, 120, 10, fill=PALE_ORANGE, stroke=ORANGE)
    for side in (-86, 86):
        canvas.spring(middle + side, 84, 159, coils=5, width=8)
        canvas.spring(middle + side, 195, 270, coils=5, width=8)
    canvas.text(middle, 182, "mass", anchor="middle")
    canvas.text(middle + 46, 110, "A", anchor="middle", color=BLUE, bold=True)
    canvas.text(middle + 46, 253, "B", anchor="middle", color=ORANGE, bold=True)
    canvas.arrow([(middle - 24, 159), (middle - 24, 124)], color=RED, width=2.4)
    canvas.text(middle - 42, 142, "F", color=RED, bold=True)
    canvas.arrow([(middle + 8, 96), (middle + 8, 131)], color=RED, width=2.4)
    canvas.text(middle + 16, 130, "−F", color=RED, bold=True)
    canvas.ground(middle, 300, 340)
    canvas.text(middle, 326, "base", anchor="middle")
    canvas.text(middle, 350, "The mass hangs on its springs. F moves the mass;\nthe surface takes the reaction −F.", anchor="middle", size=12)
    return canvas
