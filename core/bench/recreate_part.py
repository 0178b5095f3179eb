"""Where a part of a rig stands that is made anew, by what is left of the rig. Lengths in m.

Picture and display are mirror images of each other in the plate, as in `placement.py`, or stand
close together where there is none, as in `behind.py`. So each of the three is where the other two
ask for it.
"""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Floats
from ..base.errors import RigError
from ..base.vectors import normalise
from ..glass.meshes import box_of
from ..light.display import affine_fit
from ..light.optics import reflect
from ..rig.mesh import Mesh
from ..rig.rig import Rig
from .behind import STRAIGHT_BENCH
from .part_sizes import plate_outline
from .placement import REFERENCE_BENCH, frame

LEAST = 1e-6  # of a frame's place: nearer ones are in the same


@dataclass(frozen=True, eq=False)
class Stand:
    """Where a part stands, and how large it is.

    frame : (4, 4) columns right, up, front, position, world
    side : m, of a picture or a plate; the shorter one of a display; the width that a viewer sees
    distance : m, of a viewer from what it sees
    """

    frame: Floats
    side: float
    distance: float = 0.0


def stand_of(role: str, rig: Rig) -> Stand:
    """Where a part of a role is to be made, in a rig that has none of it.

    Raises
    ------
    RigError : too little is left of the rig to tell
    """
    makers = {"DISPLAY": _display, "PICTURE": _picture, "PLATE": _plate, "VIEWER": _viewer}
    if not rig.glasses:
        raise _too_little()
    return makers[role](rig)


def _too_little() -> RigError:
    return RigError(
        "Too little is left of the rig to tell where the part stands: press Undo, or remove the rig"
        " and add it again."
    )


def _display(rig: Rig) -> Stand:
    picture = _picture_left(rig) or _in_glass(rig)
    if rig.plates:
        return Stand(_mirrored(picture.frame, rig), picture.side)
    lift = STRAIGHT_BENCH.lift_share * picture.side
    return Stand(_shifted(picture.frame, -lift), picture.side)


def _picture(rig: Rig) -> Stand:
    in_glass = _in_glass(rig)
    if not rig.displays:
        return in_glass
    shown = _frame_of(rig.display.mesh)
    if rig.plates:
        return Stand(_mirrored(shown, rig), in_glass.side)
    return Stand(_shifted(shown, STRAIGHT_BENCH.lift_share * in_glass.side), in_glass.side)


def _plate(rig: Rig) -> Stand:
    """Half way between picture and display, before the viewer's eyes."""
    picture = (_picture_left(rig) or _in_glass(rig)).frame
    if not rig.displays:
        raise _too_little()
    way = _frame_of(rig.display.mesh)[:3, 3] - picture[:3, 3]
    if np.linalg.norm(way) <= LEAST * _wide(rig):
        raise _too_little()

    normal = normalise(way)
    middle = picture[:3, 3] + way / 2
    if rig.viewers:
        sight = normalise(picture[:3, 3] - rig.viewers[0].position)
        steep = sight @ normal
        if steep > LEAST:
            middle = picture[:3, 3] + sight * (np.linalg.norm(way) / 2 / steep)
    right = picture[:3, 0]
    right = normalise(right - (right @ normal) * normal)
    side = REFERENCE_BENCH.plate_m * _grow(rig)
    return Stand(frame(right, np.cross(normal, right), middle), side)


def _viewer(rig: Rig) -> Stand:
    """In front of the picture, as far from the glass's middle as Add Rig has it."""
    picture = (_picture_left(rig) or _in_glass(rig)).frame
    distance = REFERENCE_BENCH.viewer_distance_m * _grow(rig)
    to_glass = (_bounds(rig).mean(axis=0) - picture[:3, 3]) @ picture[:3, 2]
    return Stand(_shifted(picture, distance + to_glass), _wide(rig), distance)


def _picture_left(rig: Rig) -> Stand | None:
    """The picture that is there; None for one in the viewer's own pixels, too."""
    mesh = rig.picture_place.mesh if rig.pictures else None
    if mesh is None:
        return None
    fit, _ = affine_fit(mesh.uv.reshape(-1, 2), mesh.corners.reshape(-1, 3))
    return Stand(_frame_of(mesh), float(np.linalg.norm(fit[:2], axis=1).min()))


def _in_glass(rig: Rig) -> Stand:
    """A picture in the middle of the glass, which faces the viewer, or whoever looks along +y."""
    right, up = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    if rig.viewers:
        right, up, _ = rig.viewers[0].axes
    low, high = _bounds(rig)
    corners = np.stack(np.meshgrid(*_bounds(rig).T), axis=-1).reshape(-1, 3)
    width, height = (float(np.ptp(corners @ np.asarray(axis))) for axis in (right, up))
    side = REFERENCE_BENCH.picture_share * (min(width, height) or max(width, height))
    return Stand(frame(np.asarray(right), np.asarray(up), (low + high) / 2), side)


def _bounds(rig: Rig) -> Floats:
    return box_of(np.concatenate([glass.mesh.bounds for glass in rig.glasses]))


def _wide(rig: Rig) -> float:
    return float(np.ptp(_bounds(rig), axis=0).max())


def _grow(rig: Rig) -> float:
    return max(1.0, _wide(rig) / REFERENCE_BENCH.large_m)


def _frame_of(mesh: Mesh) -> Floats:
    """The frame of a flat rectangle, by its UV: right along u, up along v."""
    uv = mesh.uv.reshape(-1, 2)
    fit, _ = affine_fit(uv, mesh.corners.reshape(-1, 3))
    right = normalise(fit[0])
    up = normalise(fit[1] - (fit[1] @ right) * right)
    return frame(right, up, (uv.min(axis=0) + uv.max(axis=0)) / 2 @ fit[:2] + fit[2])


def _mirrored(of: Floats, rig: Rig) -> Floats:
    """A frame's mirror image in the rig's first plate."""
    plate = plate_outline(rig.plates[0])
    normal = np.cross(*plate.axes)
    right, up, _, at = of[:3].T
    at = at + 2 * ((plate.middle - at) @ normal) * normal
    return frame(reflect(right, normal), reflect(up, normal), at)


def _shifted(of: Floats, along: float) -> Floats:
    """A frame that is moved along its front."""
    moved = of.copy()
    moved[:3, 3] += along * of[:3, 2]
    return moved
