"""Pictures for the gallery, drawn with numpy.

Each is (height, width, 3) float32, linear Rec.709, row 0 at the top, on black: black adds no light
to the glass.
"""

from __future__ import annotations

import numpy as np

from kiriko.core.base.arrays import Floats

SIZE = 1024  # px of a square picture
SUN = 0.95  # x of the sunset's sun: behind a letter


def plane(width: int = SIZE, height: int = SIZE) -> tuple[Floats, Floats]:
    """x to the right and y up at all pixels; the shorter side is from -1 to 1."""
    y, x = np.mgrid[:height, :width] + 0.5
    scale = 2 / min(width, height)
    return (x - width / 2) * scale, (height / 2 - y) * scale


def inside(distance: Floats, softness: float = 2.0 / SIZE) -> Floats:
    """Coverage 0..1 of an area with a signed distance, negative inside."""
    return np.clip(0.5 - distance / (2 * softness), 0.0, 1.0)


def between(x: Floats, low: float, high: float) -> Floats:
    """Smooth step from 0 at `low` to 1 at `high`."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def paint(picture: Floats, colour: object, coverage: Floats) -> None:
    """Put a colour (3,) or (h, w, 3) over a picture, in place."""
    weight = coverage[..., None]
    picture *= 1 - weight
    picture += weight * np.asarray(colour, float)


def mixed(first: object, second: object, t: Floats) -> Floats:
    """Colours (h, w, 3) from the first, at t = 0, to the second."""
    weight = t[..., None]
    return (1 - weight) * np.asarray(first, float) + weight * np.asarray(second, float)


def segment(x: Floats, y: Floats, start: tuple[float, float], end: tuple[float, float]) -> Floats:
    """Distance of all places from a straight line."""
    along = np.subtract(end, start)
    t = ((x - start[0]) * along[0] + (y - start[1]) * along[1]) / (along @ along)
    t = np.clip(t, 0, 1)
    return np.hypot(x - start[0] - t * along[0], y - start[1] - t * along[1])


def goldfish() -> Floats:
    """A goldfish between two plants, with bubbles."""
    x, y = plane()
    picture = np.zeros((*x.shape, 3))
    for at, sway, height in ((-0.72, 0.09, 0.2), (-0.58, -0.07, -0.25), (0.76, 0.08, 0.0)):
        middle = at + sway * np.sin(4.2 * y + 3 * at)
        width = 0.035 * np.clip((height - y) * 2.2, 0, 1)
        leaf = np.maximum(np.abs(x - middle) - width, y - height)
        paint(picture, mixed((0.02, 0.22, 0.06), (0.10, 0.62, 0.16), (y + 1) / 1.4), inside(leaf))

    # the tail and the fins are fans of rays, the body is before them
    fan(picture, x, y, (0.36, 0.06), (-0.62, 0.62), 0.56)
    fan(picture, x, y, (-0.12, 0.22), (0.75, 2.0), 0.34)
    fan(picture, x, y, (-0.06, -0.24), (-1.25, -0.35), 0.30)
    t = np.clip((x + 0.72) / 1.16, 0, 1)
    half = 0.62 * np.sqrt(t) * (1 - t) ** 0.75 + 0.045 * t
    middle = 0.02 + 0.05 * t
    body = np.maximum(np.abs(y - middle) - half, np.maximum(-0.72 - x, x - 0.44))
    up = (y - middle) / np.maximum(half, 1e-3)
    flank = mixed((1.0, 0.72, 0.34), (1.0, 0.23, 0.015), between(up, -0.9, 0.25))
    flank = flank * (1 - 0.55 * np.clip(up - 0.35, 0, 1))[..., None]
    column, row = x * 15, y * 13
    column = column + 0.5 * (np.floor(row) % 2)
    scale = np.hypot(column - np.floor(column) - 0.15, row - np.floor(row) - 0.5)
    flank = flank * (1 - 0.28 * between(scale, 0.5, 0.72) * between(x, -0.36, -0.2))[..., None]
    paint(picture, flank, inside(body))
    gill = np.abs(np.hypot(x + 0.62, y - 0.02) - 0.30) - 0.008
    paint(
        picture,
        (0.72, 0.12, 0.01),
        0.7 * inside(np.maximum(gill, np.abs(y - 0.03) - 0.19 + 9 * (x < -0.6))),
    )
    fan(picture, x, y, (-0.24, -0.02), (-0.75, 0.12), 0.22)
    for radius, colour in ((0.072, (0.95, 0.85, 0.55)), (0.046, (0.0, 0.0, 0.0))):
        paint(picture, colour, inside(np.hypot(x + 0.55, y - 0.10) - radius))
    paint(picture, (1.0, 1.0, 1.0), inside(np.hypot(x + 0.565, y - 0.118) - 0.014))
    for at in ((-0.76, 0.30, 0.045), (-0.70, 0.47, 0.06), (-0.78, 0.66, 0.075)):
        bubble(picture, x, y, at)
    return picture.astype(np.float32)


def fan(
    picture: Floats,
    x: Floats,
    y: Floats,
    root: tuple[float, float],
    angles: tuple[float, float],
    length: float,
) -> None:
    """Paint a fin: rays from a root, between two angles in rad, with a scalloped edge."""
    radius = np.hypot(x - root[0], y - root[1])
    angle = np.arctan2(y - root[1], x - root[0])
    low, high = angles
    t = (angle - low) / (high - low)
    # the middle of a tail is shorter than its ends
    edge = length * (0.80 + 0.20 * np.abs(2 * t - 1) ** 2 + 0.03 * np.cos(t * 44))
    area = np.maximum(radius - edge, radius * np.maximum(low - angle, angle - high))
    shade = 0.62 + 0.38 * np.abs(np.cos(t * 22)) ** 0.5
    colour = mixed((1.0, 0.24, 0.015), (1.0, 0.52, 0.12), np.clip(radius / length, 0, 1))
    paint(picture, colour * shade[..., None], 0.92 * inside(area))


def bubble(picture: Floats, x: Floats, y: Floats, at: tuple[float, float, float]) -> None:
    """Paint a bubble: middle and radius."""
    radius = np.hypot(x - at[0], y - at[1])
    ring = np.clip(radius / at[2], 0, 1) ** 4
    paint(picture, mixed((0.02, 0.08, 0.12), (0.35, 0.85, 1.0), ring), inside(radius - at[2]))
    spot = np.hypot(x - at[0] + 0.35 * at[2], y - at[1] - 0.35 * at[2]) - 0.16 * at[2]
    paint(picture, (1.0, 1.0, 1.0), inside(spot))


def snowflake() -> Floats:
    """A snow crystal of six branches."""
    x, y = plane()
    radius = np.hypot(x, y)
    turn = np.pi / 3
    angle = np.arctan2(x, y)
    angle = np.abs((angle + turn / 2) % turn - turn / 2)
    across, along = radius * np.sin(angle), radius * np.cos(angle)
    lines = [segment(along, across, (0.0, 0.0), (0.9, 0.0)) - 0.020]
    for root, length in ((0.22, 0.13), (0.40, 0.25), (0.56, 0.30), (0.71, 0.19)):
        tip = root + length * np.cos(turn), length * np.sin(turn)
        lines.append(segment(along, across, (root, 0.0), tip) - 0.015)
    lines.append(np.abs(along - 0.20) - 0.012)
    distance = np.min(lines, axis=0)
    colour = mixed((0.90, 0.97, 1.0), (0.16, 0.52, 1.0), np.clip(radius, 0, 1))
    glow = 0.16 * np.exp(-np.maximum(distance, 0) / 0.035)
    picture = glow[..., None] * np.array([0.1, 0.4, 1.0])
    paint(picture, colour, inside(distance))
    return picture.astype(np.float32)


def ship() -> Floats:
    """A ship under sail, 3 : 2."""
    x, y = plane(1536, 1024)
    picture = np.zeros((*x.shape, 3))
    wood = (0.30, 0.11, 0.035)
    for mast, height in ((-0.48, 0.72), (0.16, 0.92), (0.70, 0.62)):
        paint(picture, wood, inside(segment(x, y, (mast, -0.5), (mast, height)) - 0.016))
        paint(picture, (1.0, 0.10, 0.06), inside(pennant(x, y, mast, height)))
        for low, high, wide in sails(height):
            paint(picture, *sail(x, y, mast, (low, high), wide))
    paint(picture, *jib(x, y))
    sheer = -0.50 + 0.10 * (x + 0.05) ** 2
    keel = -0.80 + 0.05 * x**2
    bow = np.maximum(x - 1.12 - (y + 0.6) * 0.55, -0.98 - x + (y + 0.6) * -0.15)
    hull = np.maximum(np.maximum(y - sheer, keel - y), bow)
    planks = 1 - 0.22 * (np.abs((y - sheer) * 22 % 1 - 0.5) > 0.42)
    colour = mixed((0.16, 0.05, 0.02), (0.62, 0.27, 0.09), between(y, -0.8, -0.45))
    paint(picture, colour * planks[..., None], inside(hull))
    paint(picture, (1.0, 0.72, 0.25), inside(np.maximum(np.abs(y - sheer + 0.05) - 0.013, bow)))
    waves(picture, x, y)
    return picture.astype(np.float32)


def sails(height: float) -> list[tuple[float, float, float]]:
    """Lower edge, upper edge and half width of the square sails of a mast."""
    step = (height + 0.36) / 3.2
    rows = [-0.36 + k * step for k in range(4)]
    return [(rows[k] + 0.02, rows[k + 1] - 0.025, 0.27 - 0.045 * k) for k in range(3)]


def sail(
    x: Floats, y: Floats, mast: float, rows: tuple[float, float], wide: float
) -> tuple[Floats, Floats]:
    """Colour and coverage of a square sail full of wind."""
    low, high = rows
    t = (y - low) / (high - low)
    belly = 0.09 * np.sin(np.pi * np.clip(t, 0, 1))
    u = (x - mast - belly) / (wide * (1.08 - 0.16 * t))
    foot = low + 0.035 * (1 - u**2)
    area = np.maximum(np.maximum(foot - y, y - high), (np.abs(u) - 1) * wide)
    light = 0.62 + 0.38 * np.clip(0.5 + 0.7 * u, 0, 1) + 0.06 * np.cos(u * 15)
    return np.array([1.0, 0.90, 0.70]) * light[..., None], inside(area)


def jib(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Colour and coverage of the sail at the bow."""
    stay = (y - 0.42) + (x - 0.76) * 1.62
    area = np.maximum(np.maximum(stay * 0.52, 0.80 - x + 0.06 * y), -0.36 - y + 0.1 * (x - 0.8))
    light = 0.75 + 0.25 * between(x, 0.78, 1.2)
    return np.array([1.0, 0.86, 0.62]) * light[..., None], inside(area)


def pennant(x: Floats, y: Floats, mast: float, height: float) -> Floats:
    """Signed distance of a flag at the top of a mast."""
    t = (x - mast) / 0.26
    middle = height - 0.035 + 0.02 * np.sin(t * 7)
    return np.maximum(np.abs(y - middle) - 0.04 * (1 - t), np.maximum(-t, t - 1) * 0.26)


def waves(picture: Floats, x: Floats, y: Floats) -> None:
    """Paint three rows of waves, the nearest last."""
    for row, colour in enumerate(((0.02, 0.20, 0.38), (0.03, 0.34, 0.55), (0.05, 0.50, 0.72))):
        phase = x * 9.5 + row * 2.1
        top = -0.70 - 0.075 * row + 0.035 * np.abs(np.sin(phase / 2)) ** 0.8
        edge = 1.38 - 0.03 * row
        area = np.maximum(np.maximum(y - top, -0.95 - y), np.abs(x) - edge)
        paint(picture, colour, inside(area))
        paint(picture, (0.75, 0.95, 1.0), inside(np.maximum(area, top - 0.02 - y)))


def clock() -> Floats:
    """The face of a clock at ten past ten."""
    x, y = plane()
    radius, angle = np.hypot(x, y), np.arctan2(x, y) / (2 * np.pi)
    picture = np.zeros((*x.shape, 3))
    paint(picture, (1.0, 0.60, 0.16), inside(radius - 0.94))
    face = mixed((0.08, 0.20, 0.34), (0.015, 0.05, 0.11), np.clip(radius / 0.86, 0, 1))
    paint(picture, face, inside(radius - 0.865))
    for n, low, half in ((60, 0.785, 0.006), (12, 0.66, 0.022)):
        apart = (angle * n + 0.5) % 1 - 0.5
        off = np.abs(2 * np.pi * radius * apart / n) - half
        mark = np.maximum(off, np.maximum(low - radius, radius - 0.825))
        paint(picture, (1.0, 0.95, 0.85), inside(mark))
    hands = ((10 + 1 / 6) / 12, 0.46, 0.036), (10 / 60, 0.66, 0.025), (37 / 60, 0.72, 0.009)
    for turn, length, half in hands:
        tip = length * np.sin(2 * np.pi * turn), length * np.cos(2 * np.pi * turn)
        tail = -0.18 * tip[0], -0.18 * tip[1]
        colour = (1.0, 0.18, 0.05) if half < 0.02 else (1.0, 0.78, 0.36)
        paint(picture, colour, inside(segment(x, y, tail, tip) - half))
    paint(picture, (1.0, 0.78, 0.36), inside(radius - 0.055))
    return picture.astype(np.float32)


def sunset() -> Floats:
    """The sun over the sea, 4 : 1: hills, a bright sky and its path on the water."""
    x, y = plane(2048, 512)
    sky = mixed((1.0, 0.42, 0.05), (0.05, 0.06, 0.36), between(y, -0.2, 0.95))
    picture = mixed(sky, (1.0, 0.16, 0.12), 0.55 * between(np.abs(x), 0.4, 4.0))
    sun = np.hypot(x - SUN, y - 0.14)
    picture += np.exp(-((sun / 0.55) ** 2))[..., None] * np.array([0.5, 0.22, 0.02])
    paint(picture, (1.0, 0.93, 0.55), inside(sun - 0.36))
    for far, colour in ((0.12, (0.36, 0.06, 0.20)), (-0.02, (0.13, 0.03, 0.14))):
        hills = far + 0.13 * np.sin(1.9 * x + 9 * far) + 0.07 * np.sin(4.3 * x + 2) - 0.08
        paint(picture, colour, inside(np.maximum(y - hills, -0.22 - y)))
    sea = mixed((0.02, 0.16, 0.36), (0.95, 0.38, 0.14), between(y, -1.0, -0.2) * 0.4)
    glint = np.exp(-(((x - SUN) / (0.42 + 0.25 * (-0.2 - y))) ** 2))
    ripple = 0.5 + 0.5 * np.sin(44 * y / (1.2 + y) + 1.4 * np.sin(5 * x + 9 * y))
    sea = sea + (glint * ripple)[..., None] * np.array([1.0, 0.60, 0.20])
    paint(picture, np.minimum(sea, 1.0), inside(y + 0.22))
    return picture.astype(np.float32)


def planet() -> Floats:
    """A planet with rings, and stars."""
    x, y = plane()
    picture = np.zeros((*x.shape, 3))
    random = np.random.default_rng(4)
    for _ in range(46):
        at = random.uniform(-0.93, 0.93, 2)
        size = random.uniform(0.004, 0.011)
        paint(picture, (0.8, 0.9, 1.0), inside(np.hypot(x - at[0], y - at[1]) - size))

    turn = np.radians(20)
    across = x * np.cos(turn) + y * np.sin(turn)
    up = y * np.cos(turn) - x * np.sin(turn)
    rings = np.hypot(across, up / 0.30)
    band = between(rings, 0.60, 0.63) - between(rings, 0.90, 0.92)
    band *= 1 - 0.9 * (between(rings, 0.765, 0.775) - between(rings, 0.795, 0.805))
    band *= 0.62 + 0.38 * np.cos(rings * 83) * np.cos(rings * 27)
    light = np.array([0.95, 0.72, 0.46])
    radius = np.hypot(across, up)
    is_before = up < 0
    paint(picture, light, band * ~is_before)

    z = np.sqrt(np.clip(1 - (radius / 0.5) ** 2, 0, 1))
    latitude = (up * 0.95 + z * 0.5 * 0.30) / 0.5
    stripe = 0.5 + 0.5 * np.sin(latitude * 13 + 0.6 * np.sin(latitude * 29))
    globe = mixed((0.86, 0.44, 0.16), (1.0, 0.80, 0.52), stripe)
    lit = np.clip((-0.55 * across + 0.45 * up) / 0.5 + 0.72 * z, 0.03, 1)
    paint(picture, globe * lit[..., None], inside(radius - 0.5))
    paint(picture, light, band * is_before)
    return picture.astype(np.float32)
