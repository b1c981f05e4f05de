"""Whether two drawings are the same picture: words and colours exactly, coordinates and maps to rounding.

Another processor or another zlib may change the last bits of a result, and with them the bytes of a file.
"""

import base64
import math
import re
import zlib

TAG = re.compile(r"<[^>]*>")
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
# Polylines and paths of straight lines: rounding may choose other points of the same curve.
CURVE = re.compile(r' (?:points|d)="([ML0-9., -]+)"')
IMAGE = re.compile(r"data:image/png;base64,([^\"]*)")
# Coordinates have one decimal.
MOST_PX = 0.11
# Curves are thinned out to 0.4 pixels.
MOST_CURVE_PX = 0.9
# Colours of a map have no gap between them: rounding may choose the next one.
MOST_STEPS = 1


def find_difference(one, other):
    """What differs between the texts of two SVG files, or `None` if they show the same."""
    if one == other:
        return None
    lines, other_lines = one.splitlines(), other.splitlines()
    if len(lines) != len(other_lines):
        return f"{len(lines)} and {len(other_lines)} lines"
    for number, (line, other_line) in enumerate(zip(lines, other_lines, strict=True), 1):
        difference = None if line == other_line else find_difference_of_lines(line, other_line)
        if difference is not None:
            return f"line {number}: {difference}"
    return None


def find_difference_of_lines(line, other):
    words, other_words = TAG.sub(" ", line).strip(), TAG.sub(" ", other).strip()
    if words != other_words:
        return f'"{words}" and "{other_words}"'
    tags, other_tags = "".join(TAG.findall(line)), "".join(TAG.findall(other))
    for pattern, is_same in ((CURVE, is_same_curve), (IMAGE, is_same_map)):
        parts, other_parts = pattern.findall(tags), pattern.findall(other_tags)
        if len(parts) != len(other_parts) or not all(map(is_same, parts, other_parts)):
            return f"another curve or map: {shorten(tags)} and {shorten(other_tags)}"
        tags, other_tags = pattern.sub("", tags), pattern.sub("", other_tags)
    values, other_values = [list(map(float, NUMBER.findall(text))) for text in (tags, other_tags)]
    if NUMBER.sub("0", tags) != NUMBER.sub("0", other_tags) or any(
        abs(a - b) > MOST_PX for a, b in zip(values, other_values, strict=True)
    ):
        return f"{shorten(tags)} and {shorten(other_tags)}"
    return None


def shorten(text):
    return text if len(text) <= 120 else f"{text[:117]}..."


def is_same_curve(data, other):
    """Whether no point of either curve is away from the other curve."""
    curves = [read_segments(data), read_segments(other)]
    return all(
        min(find_distance(point, segment) for segment in there) <= MOST_CURVE_PX
        for here, there in (curves, curves[::-1])
        for segment_here in here
        for point in segment_here
    )


def read_segments(data):
    """The segments of a curve's data: those of an SVG's `points`, or of a path of `M` and `L`."""
    segments = []
    for part in data.split("M"):
        values = list(map(float, NUMBER.findall(part)))
        points = list(zip(values[::2], values[1::2], strict=True))
        segments += zip(points, points[1:])
    return segments


def find_distance(point, segment):
    (x, y), ((x0, y0), (x1, y1)) = point, segment
    dx, dy = x1 - x0, y1 - y0
    part = ((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy or 1.0)
    part = min(max(part, 0.0), 1.0)
    return math.hypot(x - x0 - part * dx, y - y0 - part * dy)


def is_same_map(data, other):
    """Whether two PNG files of `Canvas.image` have the same size and palette, and nearly the same colours."""
    (head, pixels), (other_head, other_pixels) = read_map(data), read_map(other)
    return head == other_head and len(pixels) == len(other_pixels) and all(
        abs(a - b) <= MOST_STEPS for a, b in zip(pixels, other_pixels, strict=True)
    )


def read_map(data):
    """What comes before the pixels of a PNG, and its pixels."""
    head, body = base64.b64decode(data).split(b"IDAT", 1)
    # The four bytes before the kind of a part are its length.
    return head[:-4], zlib.decompressobj().decompress(body)
