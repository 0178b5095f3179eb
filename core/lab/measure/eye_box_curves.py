"""By how much is the picture off, and how much of it is seen, as a head moves away?

Along each of the six ways of an eye box, on to a fifth farther than the head may go: the angle and
the way in its own image by which points of the picture are off, and the share of them that is seen.
"""

from collections.abc import Generator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...base.arrays import Floats
from ...base.numbers import number
from ...base.steps import Pauses, at
from ...image.flat_picture import view_of_picture
from ...rig.viewer import Viewer
from .diagram import Curve, linear, points_mm, sheet
from .eye_box import WAYS, EyeBox, Walk
from .viewer_errors import arcmin_between

NAMES = ("left", "right", "up", "down", "nearer", "farther")  # of WAYS
FILE = "eye_box.svg"
BEYOND = 1.2  # times as far as the head may go
AT_NONE = 0.05  # of the picture's distance: so far where it may go nowhere
N_STEPS = 6  # of which one ends where the head may not go on
NOTHING_SEEN = (None, None, None, None, 0.0)
DISTANCE = "distance of the head from its own place (mm)"


@dataclass(frozen=True)
class WayCurve:
    """The picture as seen along one way of a head, by its distance, m, from its own place.

    way : one of NAMES
    distance_m : to which the other lists belong
    mean_arcmin, largest_arcmin : by which points are off; None where none is seen
    mean_px, largest_px : the same, viewer px of an image in which the picture keeps its size
    coverage : share of the points that is seen, 0..1
    """

    way: str
    distance_m: tuple[float, ...]
    mean_arcmin: tuple[float | None, ...]
    largest_arcmin: tuple[float | None, ...]
    mean_px: tuple[float | None, ...]
    largest_px: tuple[float | None, ...]
    coverage: tuple[float, ...]


def curves_of(walk: Walk, box: EyeBox) -> Generator[float, None, tuple[WayCurve, ...]]:
    """A curve for each way of an eye box that a walk has found; yields progress 0..1.

    An open way is followed as far as the picture is away.
    """
    distances, offsets = [], [np.zeros(3)]  # where all ways begin
    for k, (axis, sign, most) in enumerate(WAYS):
        reach = box.ends[k]
        reach = min(reach, walk.distance) if box.is_open[k] else BEYOND * reach
        reach = min(reach or AT_NONE * walk.distance, most * walk.distance)
        distances.append(np.linspace(0.0, reach, N_STEPS + 1))
        offsets += [distance * sign * np.eye(3)[axis] for distance in distances[-1][1:]]

    own, *others = yield from at(0.0, _at(walk, offsets))
    yield 1.0
    found = []
    for k, name in enumerate(NAMES):
        columns = [own, *others[k * N_STEPS : (k + 1) * N_STEPS]]
        found.append(WayCurve(name, tuple(distances[k].tolist()), *zip(*columns, strict=True)))
    return tuple(found)


def _at(walk: Walk, offsets: list[Floats]) -> Pauses[list[tuple[float | None, ...]]]:
    """The numbers of a curve, in their order, at each of some places of the head."""
    heads = walk.heads_at(offsets)
    seen = yield from walk.seen_by(list(heads.values()))
    of_head = dict(zip(heads, seen, strict=True))
    return [
        _numbers(walk, heads[k], of_head[k]) if k in heads else NOTHING_SEEN
        for k in range(len(offsets))
    ]


def _numbers(walk: Walk, head: Viewer, seen: Floats) -> tuple[float | None, ...]:
    """The same from a head that sees the points at (n, 2) px of its image."""
    straight = view_of_picture(walk.plan.rig.picture_place, head, walk.uv)
    is_seen = np.isfinite(seen).all(axis=1)
    if not is_seen.any():
        return NOTHING_SEEN
    seen, straight = seen[is_seen], straight[is_seen]
    told = []
    for off in (arcmin_between(head, seen, straight), np.linalg.norm(seen - straight, axis=1)):
        told += [float(off.mean()), float(off.max())]
    return *told, float(walk.weights[is_seen].sum() / walk.weights.sum())


def as_data(box: EyeBox, viewer: str, curves: tuple[WayCurve, ...]) -> dict[str, Any]:
    """An eye box and its curves, as they stand in a report: m, arcmin, px, shares."""
    return {
        "viewer": viewer,
        "limit_arcmin": box.limit,
        "least_share_of_seen": box.least,
        "ends_m": dict(zip(NAMES, box.ends, strict=True)),
        "is_open": dict(zip(NAMES, box.is_open, strict=True)),
        "curves": [asdict(curve) for curve in curves],
    }


def as_svg(box: EyeBox, viewer: str, curves: tuple[WayCurve, ...]) -> str:
    """Diagrams of all curves: a column for each axis, below each other angle, px and coverage."""
    columns = []
    for one, other in ((0, 1), (2, 3), (4, 5)):
        pair = [curves[one], curves[other]]
        title = f"The head of '{viewer}': {pair[0].way} and {pair[1].way}"
        note = [
            "; ".join(
                f"{NAMES[k]} {number(1e3 * box.ends[k])} mm{' and more' if box.is_open[k] else ''}"
                for k in (one, other)
            )
            + f" within {number(box.limit)} arcmin"
        ]
        rows = (
            ("off by (arcmin)", ("largest_arcmin", "mean_arcmin")),
            ("off by (px)", ("largest_px", "mean_px")),
            ("share of points that is seen", ("coverage",)),
        )
        column = []
        for label, fields in rows:
            drawn = [
                Curve(_name(curve.way, name), points_mm(curve.distance_m, getattr(curve, name)))
                for curve in pair
                for name in fields
            ]
            column.append(linear(title, DISTANCE, label, drawn, note, is_rising=True))
        columns.append(column)
    return sheet(columns)


def _name(way: str, field: str) -> str:
    word = field.split("_")[0]
    return way if word == "coverage" else f"{way}, {word}"
