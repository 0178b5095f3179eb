"""All parts of a rig that are no solids: plates, mirrors, blockers and the display."""

from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import FLOAT32, Bools, Floats, Ints
from ..glass.surfaces import Surface
from ..rig.kinds import Kind
from ..rig.rig import MET_ROLES, Rig, Role
from .interactions import LAWS
from .mesh_cache import Kept
from .touching_solids import BULGE


class Sheet(NamedTuple):
    """A part that is no solid, with its surface; the key tells the surface from others."""

    role: Role
    part: Any
    surface: Surface
    key: str


def find_sheets(surfaces: list[Surface], kind: Ints) -> Ints:
    """For each part (p,) the first one in whose plane it lies if both are plates, else itself.

    Light that has met one plate is beyond all of its plane: where plates overlap they act as one.
    """
    sheet = np.arange(len(surfaces))
    plates = np.flatnonzero(kind == Kind.PLATE)
    for n, i in enumerate(plates):
        for j in plates[:n]:
            one = surfaces[j]
            other = surfaces[i].corners
            far = 2 * FLOAT32 * max(np.abs(other).max(), np.abs(one.corners).max())
            if np.abs((other - one.corners[0, 0]) @ one.normals[0]).max() <= far:
                sheet[i] = sheet[j]
                break

    return sheet


def find_clear(surfaces: list[Surface], kind: Ints, aside: Floats) -> Bools:
    """Is all of the rig but the display on one side of each
    plate: (p, 2) none before its normal, none behind it?

    Boxes (a, 2, 3) of glass that stands aside are parts of the rig, too.
    """
    is_clear = np.zeros((len(surfaces), 2), bool)
    for i in np.flatnonzero(kind == Kind.PLATE):
        normal = surfaces[i].normals[0]
        others = [s.bounds for k, s in enumerate(surfaces) if k != i and kind[k] != Kind.DISPLAY]
        boxes = np.concatenate([np.stack(others), aside])

        # how far boxes reach along the normal; a face that bulges out
        # of its facet stays well within half their size
        middle = boxes.mean(axis=1)
        half = (0.5 + BULGE) * (boxes[:, 1] - boxes[:, 0])
        height = (middle - surfaces[i].corners[0, 0]) @ normal
        reach = half @ np.abs(normal)
        is_clear[i] = (height - reach > 0).all(), (height + reach < 0).all()

    return is_clear


def read_sheets(rig: Rig, kept: Kept) -> list[Sheet]:
    """Everything that is no solid, the display last."""
    laws = [(role, LAWS[role.kind].surface) for role in MET_ROLES]
    laws.sort(key=lambda pair: pair[0].kind == Kind.DISPLAY)
    return [
        Sheet(role, part, *surface(part, kept))
        for role, surface in laws
        if surface is not None
        for part in rig.of(role)
    ]
