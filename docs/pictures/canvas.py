"""An SVG picture in the manual's look: white rounded background, text as text."""

import base64
import struct
import zlib
from html import escape

INK = "#1f2937"
GREY = "#6b7280"
PALE = "#e5e7eb"
FILL = "#f3f4f6"
BLUE = "#1d4ed8"
PALE_BLUE = "#dbeafe"
ORANGE = "#c2410c"
PALE_ORANGE = "#ffedd5"
GREEN = "#15803d"
PALE_GREEN = "#dcfce7"
RED = "#b91c1c"
PALE_RED = "#fee2e2"


def number(value):
    """A coordinate with one decimal, without needless zeros."""
    text = f"{value:.1f}"
    text = text[:-2] if text.endswith(".0") else text
    return "0" if text == "-0" else text


class Canvas:
    """One picture of `width` x `height` pixels. `title` and `description` are what a screen reader says."""

    def __init__(self, width, height, title, description):
        self.width, self.height = width, height
        self.parts = []
        self.head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
            'role="img" aria-labelledby="title desc" font-family="sans-serif" font-size="13">\n'
            "<!-- drawn by docs/pictures/draw.py; do not edit -->\n"
            f'<title id="title">{escape(title)}</title>\n<desc id="desc">{escape(description)}</desc>\n'
            f'<rect x="0.5" y="0.5" width="{width - 1}" height="{height - 1}" rx="10" fill="#ffffff" stroke="#d1d5db"/>\n'
        )

    def add(self, text):
        self.parts.append(text)

    def text(self, x, y, text, *, anchor="start", color=INK, size=13, bold=False, italic=False, turn=0):
        """Text whose baseline is at `y`; lines of `text` are 1.3 `size` apart."""
        style = f' font-size="{size}"' if size != 13 else ""
        style += ' font-weight="bold"' if bold else ""
        style += ' font-style="italic"' if italic else ""
        style += f' text-anchor="{anchor}"' if anchor != "start" else ""
        for line_number, line in enumerate(text.split("\n")):
            at = y + 1.3 * size * line_number
            place = f' transform="rotate({turn} {number(x)} {number(at)})"' if turn else ""
            self.add(f'<text x="{number(x)}" y="{number(at)}" fill="{color}"{style}{place}>{escape(line, quote=False)}</text>')

    def box(self, x, y, width, height, *, fill=FILL, stroke=INK, radius=0, stroke_width=1.2, dash=None):
        extra = f' rx="{number(radius)}"' if radius else ""
        extra += f' stroke-dasharray="{dash}"' if dash else ""
        self.add(
            f'<rect x="{number(x)}" y="{number(y)}" width="{number(width)}" height="{number(height)}"{extra} '
            f'fill="{fill}" stroke="{stroke}" stroke-width="{stroke_width}"/>'
        )

    def circle(self, x, y, radius, *, fill=FILL, stroke=INK, stroke_width=1.2):
        self.add(
            f'<circle cx="{number(x)}" cy="{number(y)}" r="{number(radius)}" fill="{fill}" stroke="{stroke}" '
            f'stroke-width="{stroke_width}"/>'
        )

    def line(self, points, *, color=INK, width=1.2, dash=None, fill="none", closed=False):
        """A line through `points`; with `closed`, a polygon."""
        extra = f' stroke-dasharray="{dash}"' if dash else ""
        path = " ".join(f"{number(x)},{number(y)}" for x, y in points)
        shape = "polygon" if closed else "polyline"
        self.add(
            f'<{shape} points="{path}" fill="{fill}" stroke="{color}" stroke-width="{width}" stroke-linejoin="round"{extra}/>'
        )

    def path(self, data, *, color=INK, width=1.2, dash=None, fill="none"):
        extra = f' stroke-dasharray="{dash}"' if dash else ""
        self.add(f'<path d="{data}" fill="{fill}" stroke="{color}" stroke-width="{width}"{extra}/>')

    def head_of_arrow(self, x, y, along_x, along_y, color=INK, size=7):
        """The head of an arrow whose tip is at (x, y) and that points along (along_x, along_y)."""
        length = (along_x**2 + along_y**2) ** 0.5
        ux, uy = along_x / length, along_y / length
        base = (x - size * ux, y - size * uy)
        side = (-0.45 * size * uy, 0.45 * size * ux)
        corners = [(x, y), (base[0] + side[0], base[1] + side[1]), (base[0] - side[0], base[1] - side[1])]
        self.line(corners, color=color, fill=color, width=0.5, closed=True)

    def arrow(self, points, *, color=INK, width=1.4, dash=None, both=False):
        """A line through `points` with a head at its end, or at both ends."""
        self.line(points, color=color, width=width, dash=dash)
        (x0, y0), (x1, y1) = points[-2:]
        self.head_of_arrow(x1, y1, x1 - x0, y1 - y0, color)
        if both:
            (x0, y0), (x1, y1) = points[:2]
            self.head_of_arrow(x0, y0, x0 - x1, y0 - y1, color)

    def spring(self, x, y0, y1, *, coils=5, width=9, color=INK):
        """A vertical spring from `y0` to `y1`."""
        lead = 0.15 * (y1 - y0)
        step = (y1 - y0 - 2 * lead) / (2 * coils)
        points = [(x, y0), (x, y0 + lead)]
        for index in range(2 * coils):
            points.append((x + (width if index % 2 == 0 else -width), y0 + lead + (index + 0.5) * step))
        self.line([*points, (x, y1 - lead), (x, y1)], color=color)

    def ground(self, x, y, width=60):
        """Hatched ground below `y`, centred at `x`."""
        left = x - width / 2
        self.line([(left, y), (left + width, y)], width=1.6)
        count = max(2, int(width / 9))
        for index in range(count):
            at = left + (index + 1) * width / count
            self.line([(at, y), (at - 6, y + 7)], width=0.9, color=GREY)

    def image(self, x, y, width, height, rows, palette):
        """A map: `rows` of indices into `palette` (colours as triples of 0 to 255), as a PNG inside the picture."""

        def chunk(kind, data):
            return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

        data = b"".join(b"\0" + bytes(row) for row in rows)
        png = b"\x89PNG\r\n\x1a\n"
        png += chunk(b"IHDR", struct.pack(">IIBBBBB", len(rows[0]), len(rows), 8, 3, 0, 0, 0))
        png += chunk(b"PLTE", bytes(part for color in palette for part in color))
        png += chunk(b"IDAT", zlib.compress(data, 9)) + chunk(b"IEND", b"")
        encoded = base64.b64encode(png).decode()
        self.add(
            f'<image x="{number(x)}" y="{number(y)}" width="{number(width)}" height="{number(height)}" '
            f'preserveAspectRatio="none" href="data:image/png;base64,{encoded}"/>'
        )

    def axis_x(self, chart, ticks, label, *, grid=True, form="{:g}"):
        """The axis below `chart`, with its ticks."""
        for tick in ticks:
            x = chart.x(tick)
            if grid:
                self.line([(x, chart.top), (x, chart.bottom)], color=PALE, width=1)
            self.text(x, chart.bottom + 16, form.format(tick), anchor="middle", size=12, color=GREY)
        self.text((chart.left + chart.right) / 2, chart.bottom + 34, label, anchor="middle")

    def axis_y(self, chart, ticks, label, *, grid=True, form="{:g}", away=38):
        """The axis left of `chart`, with its ticks."""
        for tick in ticks:
            y = chart.y(tick)
            if grid:
                self.line([(chart.left, y), (chart.right, y)], color=PALE, width=1)
            self.text(chart.left - 6, y + 4, form.format(tick), anchor="end", size=12, color=GREY)
        self.text(chart.left - away, (chart.top + chart.bottom) / 2, label, anchor="middle", turn=-90)

    def frame(self, chart):
        self.box(chart.left, chart.top, chart.right - chart.left, chart.bottom - chart.top, fill="none", stroke=GREY, stroke_width=1)

    def make_svg(self):
        """The picture as the text of its file."""
        return self.head + "\n".join(self.parts) + "\n</svg>\n"


class Chart:
    """A rectangle of a picture with linear axes."""

    def __init__(self, left, top, right, bottom, x_range, y_range):
        self.left, self.top, self.right, self.bottom = left, top, right, bottom
        self.x_range, self.y_range = x_range, y_range

    def x(self, value):
        low, high = self.x_range
        return self.left + (value - low) / (high - low) * (self.right - self.left)

    def y(self, value):
        low, high = self.y_range
        return self.bottom - (value - low) / (high - low) * (self.bottom - self.top)

    def points(self, xs, ys):
        return [(self.x(x), self.y(y)) for x, y in zip(xs, ys, strict=True)]


def thin(points, tolerance=0.25):
    """The points of a curve that are needed to draw it to `tolerance` pixels (Douglas and Peucker)."""
    keep = [False] * len(points)
    keep[0] = keep[-1] = True
    spans = [(0, len(points) - 1)]
    while spans:
        first, last = spans.pop()
        (x0, y0), (x1, y1) = points[first], points[last]
        length = ((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5 or 1e-9
        furthest, distance = None, tolerance
        for index in range(first + 1, last):
            x, y = points[index]
            away = abs((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)) / length
            if away > distance:
                furthest, distance = index, away
        if furthest is not None:
            keep[furthest] = True
            spans += [(first, furthest), (furthest, last)]
    return [point for point, kept in zip(points, keep, strict=True) if kept]


def interpolate(field, columns, rows):
    """`field` (rows of values, border to border) on a finer grid, bilinear; pixels are cells, so values are of their centres."""
    result = []
    for row in range(rows):
        v = (row + 0.5) / rows * (len(field) - 1)
        i = min(int(v), len(field) - 2)
        line = []
        for column in range(columns):
            u = (column + 0.5) / columns * (len(field[0]) - 1)
            j = min(int(u), len(field[0]) - 2)
            a, b = u - j, v - i
            upper = (1 - a) * field[i][j] + a * field[i][j + 1]
            lower = (1 - a) * field[i + 1][j] + a * field[i + 1][j + 1]
            line.append((1 - b) * upper + b * lower)
        result.append(line)
    return result


def contour(field, level, x0, y0, width, height):
    """The lines on which `field` has the value `level`, as SVG path data (marching squares)."""
    step_x, step_y = width / (len(field[0]) - 1), height / (len(field) - 1)
    segments = []
    for i in range(len(field) - 1):
        for j in range(len(field[0]) - 1):
            corners = [(j, i), (j + 1, i), (j + 1, i + 1), (j, i + 1)]
            values = [field[row][column] - level for column, row in corners]
            cuts = []
            for a in range(4):
                b = (a + 1) % 4
                if (values[a] < 0) != (values[b] < 0):
                    part = values[a] / (values[a] - values[b])
                    x = corners[a][0] + part * (corners[b][0] - corners[a][0])
                    y = corners[a][1] + part * (corners[b][1] - corners[a][1])
                    cuts.append((round(x0 + x * step_x, 1), round(y0 + y * step_y, 1)))
            segments += [tuple(cuts[index : index + 2]) for index in range(0, len(cuts) - 1, 2)]
    return join_segments(segments)


def join_segments(segments):
    """Path data of line segments, those that meet joined."""
    meeting = {}
    for segment in segments:
        for end in segment:
            meeting.setdefault(end, []).append(segment)
    left = dict.fromkeys(segments)
    lines = []

    def extend(line):
        while True:
            following = next((s for s in meeting[line[-1]] if s in left), None)
            if following is None:
                return
            del left[following]
            line.append(following[1] if following[0] == line[-1] else following[0])

    while left:
        first = next(iter(left))
        del left[first]
        line = list(first)
        extend(line)
        line.reverse()
        extend(line)
        lines.append(thin(line) if line[0] != line[-1] else thin(line[: len(line) // 2 + 1])[:-1] + thin(line[len(line) // 2 :]))
    return "".join("M" + "L".join(f"{number(x)} {number(y)}" for x, y in line) for line in lines)
