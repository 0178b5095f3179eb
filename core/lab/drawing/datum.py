"""The edge that all of a bench is measured from, and the places of its parts from there."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arrays import Floats
from ...base.messages import Message
from ...base.vectors import normalise
from ...rig.rig import Rig, Role, Viewer
from .outlines import Rectangle, rectangle

UPRIGHT = 1e-6  # of 1: a viewer that looks nearer to straight up or down has no way forward


@dataclass(frozen=True, eq=False)
class Datum:
    """A place on the bench and the ways from there.

    name : of the edge whose middle it is
    place : (3,) m, world
    axes : (3, 3) unit rows: forward, as the viewer looks, but level; to the viewer's right; up
    """

    name: str
    place: Floats
    axes: Floats

    def of(self, points: Floats) -> Floats:
        """Points (..., 3), m, as forward, right and up of the datum."""
        return np.einsum("...i,ki->...k", points - self.place, self.axes)


@dataclass(frozen=True, eq=False)
class Standing:
    """A part as it stands on the bench.

    rectangle : of a flat part; None of others
    box : (2, 3) m from the datum, of all its vertices
    """

    role: Role
    part: Any
    rectangle: Rectangle | None
    box: Floats
    centre: Floats
    tilt: float | None
    azimuth: float | None

    @property
    def size(self) -> tuple[float, ...]:
        """Width and height of a flat part, m; of others length, width and height of the box."""
        return tuple(np.ptp(self.box, axis=0)) if self.rectangle is None else self.rectangle.size


def level_axes(viewer: Viewer) -> Floats:
    """Forward, right and up (3, 3) of a viewer who stands level; up is +z of the world."""
    up = np.array([0.0, 0.0, 1.0])
    forward = viewer.axes[2] * (1, 1, 0)
    if np.linalg.norm(forward) < UPRIGHT:  # it looks down: the top of its image is ahead
        forward = viewer.axes[1] * (1, 1, 0)
    forward = normalise(forward)
    return np.stack([forward, np.cross(forward, up), up])


def find_datum(rig: Rig, viewer: Viewer) -> Datum:
    """The middle of the lowest edge of the first plate, or of the display of a rig without one.

    Of edges that are as low as each other, the one nearest to the viewer.
    """
    axes = level_axes(viewer)
    for part in (*rig.plates, rig.display):
        found = rectangle(part.mesh)
        if found is not None:
            middles = (found.corners + np.roll(found.corners, -1, axis=0)) / 2
            forward, _, up = np.round(middles @ axes.T, 9).T
            lowest = np.lexsort([forward, up])[0]
            return Datum(
                Message("middle of the lowest edge of '{part}'", part=part.name),
                middles[lowest],
                axes,
            )

    bounds = rig.display.mesh.bounds
    return Datum(
        Message("middle of the box around '{part}'", part=rig.display.name),
        bounds.mean(axis=0),
        axes,
    )


def standing(rig: Rig, datum: Datum) -> list[Standing]:
    """All parts that have a mesh, in the order of the table of roles."""
    return [
        _standing(role, part, datum)
        for role, part in rig.parts()
        if getattr(part, "mesh", None) is not None
    ]


def _standing(role: Role, part: Any, datum: Datum) -> Standing:
    vertices = datum.of(part.mesh.corners.reshape(-1, 3))
    box = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
    flat = rectangle(part.mesh)
    if flat is None:
        return Standing(role, part, None, box, box.mean(axis=0), None, None)

    forward, right, up = flat.normal @ datum.axes.T
    tilt = np.degrees(np.arccos(min(1.0, abs(up))))
    # rounded, or straight back would be 180 or -180 by chance
    right = np.round(right, 9) + 0.0
    azimuth = np.degrees(np.arctan2(right, forward)) if np.hypot(forward, right) > UPRIGHT else None
    return Standing(role, part, flat, box, datum.of(flat.centre), float(tilt), azimuth)
