"""Several displays and screens as one: their images are stacked, and light meets one surface.

A single map then serves all displays, and a point of the picture is lost only if none shows it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate, combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import FLOAT32, Floats
from ..base.errors import RigError
from ..base.messages import quoted
from .mesh import Mesh
from .parts import Display

GAP_PX = 8  # between images: half the widest square around a sample (core/map/pieces.py)
OVERLAP = 1e-6  # relative to their size: displays that overlap less only touch


class Section(NamedTuple):
    """The rows of stacked images that show one part's image."""

    name: str
    top: int
    width: int
    height: int

    def of(self, image: NDArray) -> NDArray:
        """The part's image (height, width, ...), from stacked images (H, W, ...)."""
        return image[self.top : self.top + self.height, : self.width]

    def window(self, size: tuple[int, int]) -> tuple[float, float, float]:
        """Its place in the UV square of images of a size (width, height), px, which begins at u =
        0: width, height, and the lower edge.
        """
        width, height = size
        return self.width / width, self.height / height, 1 - (self.top + self.height) / height


def sections_of(parts: Sequence[Any]) -> tuple[Section, ...]:
    """Sections of the images of displays, screens or projectors, one below the other."""
    sizes = [part.image_size for part in parts]
    tops = accumulate((height + GAP_PX for _, height in sizes), initial=0)
    return tuple(
        Section(part.name, top, *size) for part, top, size in zip(parts, tops, sizes, strict=False)
    )


def size_of(sections: Sequence[Section]) -> tuple[int, int]:
    """Width and height, px, of stacked images."""
    last = sections[-1]
    return max(one.width for one in sections), last.top + last.height


def stack(sections: Sequence[Section], images: Sequence[NDArray[np.float32]]) -> NDArray:
    """Images (h, w, 3) of the sections, or the first of them, in one image (H, W, 3) on black."""
    width, height = size_of(sections)
    stacked = np.zeros((height, width, 3), np.float32)
    for section, image in zip(sections, images, strict=False):
        section.of(stacked)[:] = image
    return stacked


@dataclass(frozen=True, eq=False)
class JoinedDisplay(Display):
    """Several displays as one; its black level is the highest of theirs.

    members : the displays
    """

    members: tuple[Display, ...] = field(default=())

    @property
    def parts(self) -> tuple[Display, ...]:
        return self.members

    def black_in(self, image: Floats) -> Floats:
        """Black level (H, 1, 1) of each row of an image (H, W, ...) of any resolution."""
        sections = sections_of(self.members)
        rows = np.arange(len(image)) * size_of(sections)[1] // len(image)
        number = np.searchsorted([one.top for one in sections], rows, side="right") - 1
        return np.array([one.black_level for one in self.members])[number, None, None]


def join(displays: Sequence[Display]) -> Display:
    """One display for all of them; a single one is itself."""
    if len(displays) == 1:
        return displays[0]

    sections = sections_of(displays)
    width, height = size_of(sections)
    meshes = [one.mesh for one in displays]
    starts = accumulate((len(mesh.vertices) for mesh in meshes), initial=0)
    uv = [
        np.stack([
            mesh.uv[..., 0] * one.width / width,
            1 - (one.top + (1 - mesh.uv[..., 1]) * one.height) / height,
        ], axis=-1)
        for mesh, one in zip(meshes, sections, strict=True)
    ]  # fmt: skip
    mesh = Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([m.triangles + start for m, start in zip(meshes, starts, strict=False)]),
        uv=np.concatenate(uv),
        rounding=max(mesh.rounding for mesh in meshes),
    )
    black = max(one.black_level for one in displays)
    name = ", ".join(one.name for one in displays)
    return JoinedDisplay(
        name,
        mesh,
        width,
        height,
        black,
        primaries=displays[0].primaries,
        members=tuple(displays),
    )


def check_displays(displays: Sequence[Display]) -> None:
    """Raise RigError if several displays overlap, have views, or a UV map leaves its own image."""
    if len(displays) < 2:
        return

    if len({one.primaries for one in displays}) > 1:
        raise RigError(
            "{names} have different primaries: give them the same.",
            names=quoted(one.name for one in displays),
        )

    for one in displays:
        if one.views is not None:
            raise RigError(
                "'{name}' has views, so it has to be the only display or screen: turn its Views"
                " off, or set the role of the others to None.",
                name=one.name,
            )
        if one.mesh.uv.min() < -OVERLAP or one.mesh.uv.max() > 1 + OVERLAP:
            raise RigError(
                "The UV map of '{name}' is larger than its image: with several displays or"
                " screens, keep it between 0 and 1.",
                name=one.name,
            )

    for one, other in combinations(displays, 2):
        if _overlap(one.mesh, other.mesh):
            raise RigError(
                "{names} overlap: move them apart, or set the role of one to None.",
                names=quoted([one.name, other.name]),
            )


def _overlap(one: Mesh, other: Mesh) -> bool:
    """Whether triangles of two meshes cover part of the same plane."""
    bounds = np.stack([one.bounds, other.bounds])
    near = OVERLAP * float(np.ptp(bounds, axis=1).max()) + 4 * FLOAT32 * float(np.abs(bounds).max())
    theirs = _within(other.corners, one.bounds, near)
    for a in _within(one.corners, other.bounds, near):
        normal = _unit(np.cross(a[1] - a[0], a[2] - a[0]))
        for b in theirs[(np.abs((theirs - a[0]) @ normal) <= near).all(axis=1)]:
            # coplanar triangles are apart if an edge of either separates them
            edges = np.concatenate([np.roll(corners, -1, axis=0) - corners for corners in (a, b)])
            p, q = (corners @ _unit(np.cross(normal, edges)).T for corners in (a, b))
            depth = np.minimum(p.max(axis=0) - q.min(axis=0), q.max(axis=0) - p.min(axis=0))
            if (depth > near).all():
                return True
    return False


def _unit(vectors: Floats) -> Floats:
    """Vectors of length 1; those without a length stay."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def _within(corners: Floats, box: Floats, near: float) -> Floats:
    """Triangles (t, 3, 3) that may meet a box (2, 3)."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    return corners[((high >= box[0] - near) & (low <= box[1] + near)).all(axis=1)]
