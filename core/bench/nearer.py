"""The picture at the glass, and the display with it: bent light spreads less on a shorter way.

For one viewer the place of the picture in depth changes nothing: the display's does. It moves with
the picture, so that both stay where the plate images them.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..base.arrays import Floats
from ..base.errors import RigError
from ..glass.meshes import geometric_normals
from ..light.optics import reflect
from ..rig.rig import Display, PicturePlace, Rig
from .picture_room import plane_of


class Shifts(NamedTuple):
    """Of the picture and the display (3,), m."""

    picture: Floats
    display: Floats


def way_to_glass(rig: Rig) -> float:
    """The way of the picture along its axis towards the first viewer, m: from behind the glass to
    its back, or with a plate, from within to its face. 0 if there is none.
    """
    try:
        middle, axis = plane_of(rig).middle, _axis(rig)
    except RigError:  # it has no place
        return 0.0
    if rig.mirrors or len(rig.plates) > 1:  # the display is on a way of its own
        return 0.0
    ahead = np.concatenate([(glass.mesh.vertices - middle) @ axis for glass in rig.glasses])
    back, face = float(ahead.min()), float(ahead.max())
    if back > 0:
        return back
    return max(face, 0.0) if rig.plates else 0.0


def shifts_by(rig: Rig, way: float) -> Shifts:
    """The shifts of picture and display for a way of the picture towards the first viewer, m."""
    shift = way * _axis(rig)
    if not rig.plates:
        return Shifts(shift, shift)
    normal = geometric_normals(rig.plates[0].mesh.corners)[0]
    return Shifts(shift, reflect(shift, normal))


def nearer(rig: Rig, way: float) -> Rig:
    """The rig with its picture so much nearer to the first viewer, m."""
    shifts = shifts_by(rig, way)
    return replace(
        rig,
        pictures=(_moved(rig.pictures[0], shifts.picture),),
        displays=(_moved(rig.display, shifts.display),),
    )


def _axis(rig: Rig) -> Floats:
    """The direction (3,) perpendicular to the picture, towards the first viewer."""
    plane = plane_of(rig)
    axis = np.cross(*plane.sides)
    axis /= np.linalg.norm(axis)
    return axis * np.sign(axis @ (rig.viewers[0].position - plane.middle))


def _moved(part: PicturePlace | Display, shift: Floats) -> PicturePlace | Display:
    return replace(part, mesh=replace(part.mesh, vertices=part.mesh.vertices + shift))
