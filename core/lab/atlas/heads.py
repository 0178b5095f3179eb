"""Head positions: a box, a grid over it, and the viewer at each position."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ...base.arrays import Floats
from ...base.errors import RigError
from ...base.messages import Message
from ...rig.rig import PicturePlace, Rig
from ...rig.viewer import Viewer

AXES = ("right", "up", "forward")
AT_HEAD = 1e-6  # of the distance; a nearer picture is at the head
Offset = tuple[float, float, float]


@dataclass(frozen=True)
class HeadBox:
    """The range of the head, in the frame of the viewer's own position.

    low, high : right, up and forward, m; equal on an axis without movement
    """

    low: Offset
    high: Offset

    def check(self) -> None:
        """Raise RigError if the box is invalid or has no movement."""
        for low, high in zip(self.low, self.high, strict=True):
            if not (np.isfinite(low) and np.isfinite(high) and low <= high):
                raise RigError(
                    "The head's range from {low:g} to {high:g} mm is not valid. Set the smaller"
                    " number first.",
                    low=1e3 * low,
                    high=1e3 * high,
                )
        if not self.axes:
            raise RigError("The head does not move. Set its range to the right, up or forward.")

    @property
    def axes(self) -> tuple[int, ...]:
        """Axes of movement."""
        return tuple(k for k in range(3) if self.low[k] < self.high[k])


@dataclass(frozen=True)
class HeadGrid:
    """Evenly spaced positions in a box.

    halvings : number of halvings along each axis; 0 has only the two ends
    """

    box: HeadBox
    halvings: tuple[int, int, int] = (0, 0, 0)

    @property
    def nodes(self) -> tuple[Floats, Floats, Floats]:
        """Coordinates along each axis, m; a single one on an axis without movement."""
        return tuple(
            np.linspace(low, high, 2**n + 1) if low < high else np.array([low])
            for low, high, n in zip(self.box.low, self.box.high, self.halvings, strict=True)
        )

    def __len__(self) -> int:
        return int(np.prod([len(nodes) for nodes in self.nodes]))

    def offsets(self) -> list[Offset]:
        """All positions, forward fastest."""
        right, up, forward = np.meshgrid(*self.nodes, indexing="ij")
        return list(zip(right.ravel(), up.ravel(), forward.ravel(), strict=True))

    def halved(self, axis: int) -> "HeadGrid":
        """The grid with one more halving along an axis."""
        halvings = tuple(n + (k == axis) for k, n in enumerate(self.halvings))
        return replace(self, halvings=halvings)

    def middles(self, axis: int) -> Floats:
        """Midpoints between neighbours along an axis, which one more halving adds."""
        return self.halved(axis).nodes[axis][1::2]

    def around(self, offset: Offset) -> tuple[list[int], Floats]:
        """Numbers and weights of the positions at the corners of an offset's cell. The weights sum
        to 1; corners of weight 0 are omitted.
        """
        numbers, weights = np.zeros(1, np.int64), np.ones(1)
        for nodes, x in zip(self.nodes, offset, strict=True):
            first = int(np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, len(nodes) - 1))
            last = min(first + 1, len(nodes) - 1)
            step = nodes[last] - nodes[first]
            t = (x - nodes[first]) / step if step else 0.0
            numbers = (numbers[:, None] * len(nodes) + np.array([first, last])).ravel()
            weights = (weights[:, None] * np.array([1 - t, t])).ravel()

        has_weight = weights > 0
        return numbers[has_weight].tolist(), weights[has_weight]


def evenly(counts: Sequence[int], sizes: Sequence[float]) -> list[Offset]:
    """Positions spaced evenly over `sizes`, m, around the viewer's own position; forward fastest. A
    count of 1 is in the middle.
    """
    along = [
        np.linspace(-size / 2, size / 2, n) if n > 1 else np.zeros(1)
        for n, size in zip(counts, sizes, strict=True)
    ]
    return list(product(*along))


def check_perspective(viewer: Viewer) -> None:
    """Raise RigError if a viewer is orthographic, and so has no head."""
    if viewer.projection == "orthographic":
        raise RigError(
            "The viewer '{viewer}' is orthographic, so it has no eye position. Set it to"
            " Perspective.",
            viewer=viewer.name,
        )


def check_viewer(rig: Rig, viewer: Viewer) -> None:
    """Raise RigError if a viewer, the picture or the display does not allow head movement."""
    check_perspective(viewer)
    rig.picture_place.check_still()
    if rig.display.views is not None:
        raise RigError(
            "'{display}' shows another image in each direction, so the range of a head cannot be"
            " measured: turn its Views off.",
            display=rig.display.name,
        )


def viewer_at(viewer: Viewer, place: PicturePlace, offset: Offset) -> Viewer:
    """The viewer moved by an offset, looking at the same point of the picture.

    The smallest possible rotation keeps the picture's middle at its position in the image. The
    window grows as the viewer approaches, so the picture keeps its size in the image.

    offset : right, up, forward, m, along the axes of the unmoved viewer

    Raises
    ------
    RigError : the head is at the picture, or behind it
    """
    return viewer_about(viewer, *middle_of(place), offset)


def middle_of(place: PicturePlace) -> tuple[Floats, Message]:
    """The middle (3,) m of a flat picture, and its name in messages."""
    return place.mesh.bounds.mean(axis=0), Message("the picture '{picture}'", picture=place.name)


def viewer_about(viewer: Viewer, middle: Floats, name: Message, offset: Offset) -> Viewer:
    """The viewer moved by an offset, looking at the same point (3,) m; `name` is its name in
    messages.
    """
    before = middle - viewer.position
    position = viewer.position + np.array(offset) @ viewer.axes
    after = middle - position

    far, near = np.linalg.norm(before), np.linalg.norm(after)
    if near < AT_HEAD * far or after @ before <= 0:
        raise RigError(
            "The head position {right:.4g}, {up:.4g}, {forward:.4g} mm is at {point} or behind it."
            " Reduce the range.",
            **dict(zip(AXES, (1e3 * x for x in offset), strict=True)),
            point=name,
        )

    window = tuple(edge * far / near for edge in viewer.window)
    turned = viewer.axes @ _turn(before / far, after / near).T
    # products of turns drift from a right angle by rounding
    axes = np.linalg.qr(turned.T)[0].T
    axes *= np.sign((axes * turned).sum(axis=1))[:, None]
    return replace(viewer, position=position, axes=axes, window=window)


def _turn(start: Floats, end: Floats) -> Floats:
    """The smallest rotation (3, 3) from one unit vector (3,) to another; they must not be
    opposite.
    """
    axis = np.cross(start, end)
    x, y, z = axis
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + across + across @ across / (1 + start @ end)
