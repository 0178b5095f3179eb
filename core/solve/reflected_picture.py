"""A picture's plane that viewers see only by way of mirrors: an image in each viewer's pixels."""

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from ..base.stages import section
from ..base.steps import hold_progress, subprogress
from ..image.seen_image import seeing
from ..light.mesh_cache import MeshCache
from ..rig.parts import OwnImage
from ..rig.rig import Display, Picture, Rig
from ..rig.settings import Settings
from .picture_coverage import is_in_view
from .projection import settings_of_projectors, trace_sides


def is_reflected(rig: Rig) -> bool:
    """Whether a rig has mirrors, and a viewer whose direct view has no part of the picture."""
    place = rig.picture_place
    if place.mesh is None or not (rig.mirrors or rig.half_mirrors):
        return False
    return not all(is_in_view(place, viewer) for viewer in rig.viewers)


def reflect_picture(rig: Rig, settings: Settings, cache: MeshCache) -> Generator[float, None, Rig]:
    """The rig with each viewer's image of the picture by its mirrors alone, both sides of the
    plane; yields progress 0..1.

    The rig is unchanged if no mirror shows it.

    Raises
    ------
    RigError : the picture has no pixels
    """
    picture = rig.picture
    height, width = picture.image.shape[:2]
    plane = Display(picture.name, picture.mesh, width, height)
    mirrors = {"mirrors": rig.mirrors, "half_mirrors": rig.half_mirrors, "blockers": rig.blockers}
    own = []
    for k, viewer in enumerate(rig.viewers):
        alone = Rig((viewer,), (), (), (plane,), rig.pictures, **mirrors)
        start, end = section((0.0, 1.0), k, len(rig.viewers))
        steps = trace_sides(alone, viewer, settings_of_projectors(settings), cache)
        shown = np.concatenate([picture.image, np.ones_like(picture.image[..., :1])], axis=2)
        seen = np.zeros((viewer.height, viewer.width, 5), np.float32)
        for batches in (yield from subprogress(steps, start, end)):
            seen += yield from hold_progress(end, seeing(batches, shown))
        own.append(OwnImage(viewer.name, seen[..., :4].copy(), np.minimum(seen[..., 4], 1.0)))

    if not all(one.mask.any() for one in own):
        return rig
    return replace(rig, pictures=(Picture(picture.name, own[0].image, own=tuple(own)),))
