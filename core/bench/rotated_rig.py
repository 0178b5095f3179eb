"""A rig with its glass turned, and the light of its picture then.

Glass that is turned has to be made ready anew. To the light it is the same whether the glass turns
or all else turns the other way about it; so while turns are compared the glass stays.
"""

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from ..base.arrays import Floats
from ..glass.motion import Motion
from ..rig.rig import ROLES, Rig
from .offset import moved, turned
from .picture_light import PlanOf, Traced, traced


def glass_middle(rig: Rig) -> Floats:
    """The middle (3,), m, of the box around all glass of a rig."""
    boxes = np.stack([glass.mesh.bounds for glass in rig.glasses])
    return (boxes[:, 0].min(axis=0) + boxes[:, 1].max(axis=0)) / 2


def turn_of(rig: Rig, turn: Floats) -> Motion:
    """The motion of the glass by a turn (3,), rad about its
    direction, right-handed, through the glass's middle.
    """
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle else np.array([0.0, 0.0, 1.0])
    return turned(axis, np.degrees(angle), glass_middle(rig))


def with_glass_turned(rig: Rig, turn: Floats) -> Rig:
    """The rig with all its glass turned as one."""
    motion = turn_of(rig, turn)
    return replace(rig, glasses=tuple(moved(glass, motion) for glass in rig.glasses))


def with_rest_turned(rig: Rig, turn: Floats) -> Rig:
    """The rig with all but the glass turned the other way: the same to the light."""
    motion = turn_of(rig, -turn)
    return replace(
        rig,
        **{
            role.field: tuple(
                part if getattr(part, "mesh", part) is None else moved(part, motion)
                for part in rig.of(role)
            )
            for role in ROLES
            if role.name != "GLASS"
        },
    )


def light_turned(
    rig: Rig, turn: Floats, plan_of: PlanOf, n_grid: int
) -> Generator[float, None, Traced]:
    """The light of the picture with the glass turned; yields progress 0..1."""
    return (yield from traced(with_rest_turned(rig, turn), plan_of, n_grid))
