"""Can several viewers look at one display?"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from ..base.errors import RigError
from .mesh import Mesh
from .parts import Picture, Plate
from .viewer import Viewer


def check_together(viewers: Sequence[Viewer], plates: Sequence[Plate], has_mirrors: bool) -> None:
    """Raise RigError where a viewer is there twice, two have one name, or a plate stands between
    two of them.

    By way of mirrors the light of viewers on both sides of a plate may come to the same one.
    """
    if len(viewers) < 2:
        return

    name, n = Counter(viewer.name for viewer in viewers).most_common(1)[0]
    if n > 1:
        first, *others = (viewer for viewer in viewers if viewer.name == name)
        if not all(_is_same(first, other) for other in others):
            raise RigError(
                "{n} viewers are called '{viewer}', and results tell viewers by their names: rename"
                " all but one.",
                n=n,
                viewer=name,
            )
        raise RigError(
            "The viewer '{viewer}' is in the list {n} times: keep one.", viewer=name, n=n
        )

    for plate in () if has_mirrors else plates:
        sides = [_side(viewer, plate.mesh) for viewer in viewers]
        if min(sides) < 0 < max(sides):
            one, other = (viewers[int(pick(sides))].name for pick in (np.argmax, np.argmin))
            raise RigError(
                "The plate '{plate}' stands between the viewers '{one}' and '{other}': move one of"
                " them to the other's side.",
                plate=plate.name,
                one=one,
                other=other,
            )


def check_own_images(viewers: Sequence[Viewer], picture: Picture) -> None:
    """Raise RigError where a viewer has no image, though others have one of their own, or where the
    picture stands on a plane, which is the same for all.
    """
    if picture.mesh is not None:
        raise RigError(
            "The picture '{picture}' stands on a plane, and has an image for each viewer: take"
            " these away, or the plane.",
            picture=picture.name,
        )

    known = {one.name for one in picture.own}
    for viewer in viewers:
        if viewer.name not in known:
            raise RigError(
                "The viewer '{viewer}' has no image of its own, but others have: choose one in"
                " the list of viewers, or take theirs away.",
                viewer=viewer.name,
            )


def _is_same(one: Viewer, other: Viewer) -> bool:
    """Do two viewers look alike from one place, whatever they are called and weigh?"""
    pairs = ((one.position, other.position), (one.axes, other.axes), (one.window, other.window))
    return one.projection == other.projection and all(np.array_equal(a, b) for a, b in pairs)


def _side(viewer: Viewer, mesh: Mesh) -> float:
    """On which side of a flat mesh a viewer is: above 0 before its front."""
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    normals = np.cross(b - a, c - a)
    largest = np.argmax(np.linalg.norm(normals, axis=1))
    normal = normals[largest]
    if viewer.projection == "orthographic":
        return float(-viewer.axes[2] @ normal)
    return float((viewer.position - a[largest]) @ normal)
