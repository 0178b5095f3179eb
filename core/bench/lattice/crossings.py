"""Crossings of lines in a photograph, to a hundredth of a pixel.

On circles around a crossing two lines show as four bright arms. Along each line the ridge of its
light is a parabola, z = a + b t + c t^2 across it, by centroids at stations on both sides; the
crossing is where both parabolas meet. The middle itself, where the lines lie on each other, is left
out, or each would draw the other.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Bools, Floats, Ints
from .windows import Marks, read_between


@dataclass(frozen=True)
class CrossingRule:
    """What is a crossing; held to rendered photographs by tests/core/test_lattice.py.

    dark_percent : of directions, that are darker than the ground between the arms
    edge : of the contrast, above which a direction is an arm
    widest_arms : share of all directions that are arms
    bent_rad : an arm against its opposite
    floor : of the contrast across a line, below which light does not count
    wavy_px : px of a level, rms by which a line may be off its parabola
    most_parallel : sine, below which lines do not cross
    farthest_px : px of a level, of the crossing from the window's middle
    reach_px : along a line, to which a crossing is looked for
    """

    dark_percent: float = 30
    edge: float = 0.4
    widest_arms: float = 0.6
    bent_rad: float = np.radians(40.0)
    floor: float = 0.15
    wavy_px: float = 0.7
    most_parallel: float = 0.1
    farthest_px: float = 3.0
    reach_px: float = 5


CROSSINGS = CrossingRule()
RADII_PX = np.arange(5.0, 14.0)  # of a level, at which arms are looked for
TURNS_AROUND = np.exp(1j * (2 * np.pi * np.arange(72) / 72))  # directions, x + iy
# px of a level, along a line, and across it
STATIONS_PX = np.concatenate([-np.arange(5.0, 13.0), np.arange(5.0, 13.0)])
ACROSS_PX = np.arange(-4.5, 4.75, 0.5)
N_RIDGES = 3  # times a parabola is laid through the ridge, each around the one before
N_NEWTON = 5


def find_crossings(windows: NDArray[np.float32]) -> Marks:
    """The crossings in the middles of windows (k, s, s); their radius is 1."""
    kept, lines, contrast = _arms(windows)
    parabolas, is_line = _ridges(windows[kept], lines)
    place = _meeting(lines, parabolas)
    is_line &= np.abs(place) < CROSSINGS.farthest_px

    place = place[is_line]
    return Marks(
        which=kept[is_line],
        off=np.stack([place.real, place.imag], axis=1),
        radius=np.ones(len(place)),
        contrast=contrast[is_line],
    )


def _arms(windows: NDArray[np.float32]) -> tuple[Ints, NDArray[np.complex128], Floats]:
    """Windows (n,) with four arms, two by two straight on, the
    directions (n, 2) of their lines, and their contrast (n,).
    """
    at = RADII_PX[:, None] * TURNS_AROUND
    arms = np.sort(read_between(windows, np.broadcast_to(at, (len(windows), *at.shape))), 1)
    along = arms[:, len(RADII_PX) // 3]  # an arm is bright nearly all the way
    low = np.percentile(along, CROSSINGS.dark_percent, axis=1)
    high = along.max(axis=1)
    excess = along - (low + CROSSINGS.edge * (high - low))[:, None]

    is_arm = excess > 0
    starts = is_arm & ~np.roll(is_arm, 1, axis=1)
    has_four = (starts.sum(axis=1) == 4) & (is_arm.mean(axis=1) < CROSSINGS.widest_arms)
    kept = np.flatnonzero(has_four)
    contrast = (high - low)[kept]
    excess = np.maximum(excess[kept], 0)

    # the mean direction of each
    number = np.cumsum(starts[kept], axis=1) % 4
    directions = np.stack([(excess * (number == k)) @ TURNS_AROUND for k in range(4)], axis=1)
    ahead = directions[:, :2]
    behind = -directions[:, 2:]
    straight = (np.abs(np.angle(ahead * behind.conj())) < CROSSINGS.bent_rad).all(axis=1)
    lines = ahead[straight] / np.abs(ahead[straight]) + behind[straight] / np.abs(behind[straight])
    lines /= np.abs(lines)

    return kept[straight], lines, contrast[straight]


def _ridges(windows: NDArray[np.float32], lines: NDArray[np.complex128]) -> tuple[Floats, Bools]:
    """Parabolas (n, 2, 3) along two lines of windows (n, s, s) with
    directions (n, 2), and whether both lines (n,) keep to them.
    """
    design = np.stack([np.ones_like(STATIONS_PX), STATIONS_PX, STATIONS_PX**2], axis=1)
    parabolas = np.zeros((len(lines), 2, 3))
    is_line = np.ones(len(lines), bool)

    for k, line in enumerate(lines.T):
        for _ in range(N_RIDGES):
            ridge = parabolas[:, k] @ design.T
            at = STATIONS_PX[:, None] + 1j * (ridge[:, :, None] + ACROSS_PX)
            values = read_between(windows, line[:, None, None] * at)

            # by the centroid of the light across it
            dark = values.min(axis=2, keepdims=True)
            bright = values.max(axis=2, keepdims=True)
            weight = np.maximum(values - dark - CROSSINGS.floor * (bright - dark), 1e-12)
            ridge = ridge + weight @ ACROSS_PX / weight.sum(axis=2)
            parabolas[:, k] = np.linalg.lstsq(design, ridge.T, rcond=None)[0].T

        off = ridge - parabolas[:, k] @ design.T
        is_line &= np.sqrt((off**2).mean(axis=1)) < CROSSINGS.wavy_px

    return parabolas, is_line


def _meeting(lines: NDArray[np.complex128], parabolas: Floats) -> NDArray[np.complex128]:
    """Where the two lines (n, 2) meet, x + iy: line 0 at t0, line 1 at t1, by Newton's method."""
    t = np.zeros((len(lines), 2))
    one = np.stack([np.ones(len(lines)), np.zeros(len(lines)), np.zeros(len(lines))], axis=1)
    reach = CROSSINGS.reach_px

    for _ in range(N_NEWTON):
        powers = np.stack([one[:, :1] + 0 * t, t, t**2], axis=2)
        slopes = np.stack([0 * t, one[:, :1] + 0 * t, 2 * t], axis=2)
        place = lines * (t + 1j * (parabolas * powers).sum(axis=2))
        tangent = lines * (1 + 1j * (parabolas * slopes).sum(axis=2))
        gap = place[:, 1] - place[:, 0]

        cross = (tangent[:, 0].conj() * tangent[:, 1]).imag
        cross = np.where(np.abs(cross) < CROSSINGS.most_parallel, 1.0, cross)
        step = np.stack(
            [(gap.conj() * tangent[:, 1]).imag / cross, (gap.conj() * tangent[:, 0]).imag / cross],
            axis=1,
        )
        t = np.clip(t + step, -reach, reach)

    return place[:, 0]
