"""A viewer's pupil: a thin lens that sees one plane sharp.

Through each place of the pupil the viewer is a pinhole camera of its own, sheared so that points of
the plane of focus have the same pixels from all of them. The viewer's image is the mean of theirs
(Potmesil and Chakravarty, A lens and aperture camera model for synthetic image generation, SIGGRAPH
1981, doi 10.1145/800224.806818).
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ..base.arrays import Floats
from ..base.errors import RigError
from ..base.messages import Length
from ..base.vectors import normalise
from .mesh import Mesh
from .parts import PicturePlace
from .viewer import Viewer

GOLDEN_ANGLE = np.pi * (3 - 5**0.5)


def in_pupil(viewer: Viewer, square: Floats) -> Floats:
    """Places (n, 2), m right and up, evenly spread in a viewer's pupil as places (n, 2) of the unit
    square are in it.

    Equal areas stay equal (Shirley and Chiu, A low distortion map between disk and square, Journal
    of Graphics Tools 2(3), 1997).
    """
    x, y = (2 * square - 1).T
    is_wide = np.abs(x) > np.abs(y)
    radius = np.where(is_wide, x, y)
    ratio = np.divide(np.where(is_wide, y, x), radius, out=np.zeros(len(x)), where=radius != 0)
    angle = np.pi / 4 * ratio
    along, across = radius * np.cos(angle), radius * np.sin(angle)
    unit = np.where(is_wide, [along, across], [across, along])
    return viewer.pupil / 2 * unit.T


def even_places(viewer: Viewer, n: int) -> Floats:
    """n even places (n, 2), m right and up, of a viewer's pupil: the seeds of a sunflower (Vogel, A
    better way to construct the sunflower head, Mathematical Biosciences 44, 1979, 179-189).
    """
    k = np.arange(n)
    radius, angle = viewer.pupil / 2 * np.sqrt((k + 0.5) / n), GOLDEN_ANGLE * k
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def focus_of(place: PicturePlace, viewer: Viewer) -> float:
    """Distance, m along forward, of the plane that a viewer with a pupil sees sharp.

    place : of the viewer's picture

    Raises
    ------
    RigError : the picture has no place to focus on
    """
    if viewer.focus is not None:
        return viewer.focus
    middle = np.full(3, np.nan) if place.mesh is None else place.mesh.bounds.mean(axis=0)
    distance = float((middle - viewer.position) @ viewer.axes[2])
    if not distance > 0:
        raise RigError(
            "The viewer '{viewer}' has no picture in front of it to focus on: set its focus"
            " distance.",
            viewer=viewer.name,
        )
    return distance


def pinhole_at(viewer: Viewer, place: Floats, focus: float) -> Viewer:
    """The pinhole camera at a place (2,), m, of a viewer's pupil.

    focus : m along forward, of the plane whose points keep their pixels
    """
    right, up, _ = viewer.axes
    x, y = place
    left, other, bottom, top = viewer.window
    return replace(
        viewer.pinhole,
        position=viewer.position + x * right + y * up,
        window=(left - x / focus, other - x / focus, bottom - y / focus, top - y / focus),
    )


def pinholes(place: PicturePlace, viewer: Viewer, n: int) -> list[Viewer]:
    """Cameras at n even places of a viewer's pupil."""
    focus = focus_of(place, viewer)
    return [pinhole_at(viewer, at, focus) for at in even_places(viewer, n)]


def rays_through(viewer: Viewer, xy: Floats, places: Floats, focus: float) -> tuple[Floats, Floats]:
    """Origins and unit directions (n, 3) of rays through viewer px (n, 2) and places (n, 2), m, of
    the pupil.
    """
    middle, directions = viewer.rays(xy)
    origins = middle + places @ viewer.axes[:2]
    seen_sharp = middle + focus * directions / (directions @ viewer.axes[2])[:, None]
    return origins, normalise(seen_sharp - origins)


def check_pupil(viewer: Viewer, place: PicturePlace, meshes: Iterable[Mesh]) -> None:
    """Raise RigError for a pupil wider than the distance to its focus or to a part's vertices."""
    near = min(np.linalg.norm(one.vertices - viewer.position, axis=1).min() for one in meshes)
    distance = min(float(near), focus_of(place, viewer))
    if not viewer.pupil < distance:
        raise RigError(
            "The pupil of the viewer '{viewer}' is {pupil} wide, but its focus or the nearest"
            " part is {distance} away: make the pupil smaller.",
            viewer=viewer.name,
            pupil=Length(viewer.pupil),
            distance=Length(max(distance, 0.0)),
        )
