"""Several displays and screens as one: their images are stacked, and light meets one surface.

A single map then serves all displays, and a point of the picture is lost only if none shows it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, combinations
from typing import NamedTuple, Protocol

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


class Sized(Protocol):
    """A part with an image: a display, a screen or a projector."""

    name: str
    width: int
    height: int


def sections_of(parts: Sequence[Sized]) -> tuple[Section, ...]:
    """Sections of the parts' images, one below the other."""
    tops = accumulate((part.height + GAP_PX for part in parts), initial=0)
    return tuple(
        Section(part.name, top, part.width, part.height)
        for part, top in zip(parts, tops, strict=False)
    )


def size_of(sections: Sequence[Section]) -> tuple[int, int]:
    """Width and height, px, of stacked images."""
    last = sections[-1]
    return max(one.width for one in sections), last.top + last.height


def stack(sections: Sequence[Section], images: Sequence[NDArray[np.float32]]) -> NDArray:
    """Images (h, w, 3) of the sections in one image (H, W, 3), black between them."""
    width, height = size_of(sections)
    stacked = np.zeros((height, width, 3), np.float32)
    for section, image in zip(sections, images, strict=True):
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
    return JoinedDisplay(name, mesh, width, height, black, members=tuple(displays))


def check_displays(displays: Sequence[Display]) -> None:
    """Raise RigError if several displays overlap, or a UV map leaves its own image."""
    if len(displays) < 2:
        return

    for one in displays:
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
    for corners in _within(one.corners, other.bounds, near):
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal /= max(float(np.linalg.norm(normal)), 1e-300)
        is_coplanar = (np.abs((theirs - corners[0]) @ normal) <= near).all(axis=1)
        for triangle in theirs[is_coplanar]:
            if all(covered > near for covered in _depths(corners, triangle, normal)):
                return True
    return False


def _within(corners: Floats, box: Floats, near: float) -> Floats:
    """Triangles (t, 3, 3) that may meet a box (2, 3)."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    return corners[((high >= box[0] - near) & (low <= box[1] + near)).all(axis=1)]


def _depths(one: Floats, other: Floats, normal: Floats) -> Iterator[float]:
    """Overlap, m, of two triangles (3, 3) in a plane, across each of their edges."""
    for corners in (one, other):
        for edge in np.roll(corners, -1, axis=0) - corners:
            across = np.cross(normal, edge)
            across /= max(float(np.linalg.norm(across)), 1e-300)
            a, b = one @ across, other @ across
            yield min(a.max() - b.min(), b.max() - a.min())
