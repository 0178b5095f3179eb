"""The same rays by numpy's way and by the kernel: where do
they part, and which of them meets the nearer face?
"""

from typing import NamedTuple

import numpy as np

from kiriko.core.base.arrays import Bools, Floats, Ints
from kiriko.core.base.steps import run_steps
from kiriko.core.light.hits import is_within
from kiriko.core.light.plan import Plan
from kiriko.core.light.trace import Step, tracing
from kiriko.core.native import loading

SAME = 1e-12  # of the rig's size: so close are ways that have been the same so far
# of the rig's size: so close are two triangles on both sides of an edge that a ray meets
BESIDE = 1e-7


class Parted(NamedTuple):
    """Of rays whose ways were the same up to an event: how many
    parted there, and how many of those by a wrong turn.

    A turn is wrong where the kernel goes further than numpy's way does, which has met a face: the
    kernel has passed by it. Numpy's way takes the word of an engine in float32 for the triangle,
    which in a mesh of kilometres is right to tenths of a millimetre. So whether the ray meets the
    face is asked in float64.
    """

    n_rays: int
    n_parted: int
    n_wrong: int


def find_parted(plan: Plan, origins: Floats, directions: Floats) -> Parted:
    """Follow rays (n, 3) both ways, event by event."""
    by_numpy: list[Step] = []
    by_kernel: list[Step] = []
    with loading.off():
        run_steps(tracing(plan, origins, directions, steps=by_numpy))
    run_steps(tracing(plan, origins, directions, steps=by_kernel))
    n = len(origins)
    size = float(
        np.ptp(
            np.concatenate([held.layer.corners.reshape(-1, 3) for held in plan.layers]), axis=0
        ).max()
    )

    here = np.stack([origins, origins])
    is_alike = np.ones(n, bool)
    n_parted = n_wrong = 0
    for event in range(max(len(by_numpy), len(by_kernel))):
        met = np.full((2, n), -1)
        place = np.full((2, n, 3), np.inf)
        for k, steps in enumerate((by_numpy, by_kernel)):
            if event < len(steps):
                met[k, steps[event].rays], place[k, steps[event].rays] = (
                    steps[event].triangle,
                    steps[event].place,
                )
        way = np.full((2, n), np.inf)
        for k in range(2):
            has_met = is_alike & (met[k] >= 0)
            way[k, has_met] = np.linalg.norm(place[k, has_met] - here[k, has_met], axis=1)
        with np.errstate(invalid="ignore"):  # neither meets anything
            is_near = np.abs(way[0] - way[1]) <= BESIDE * size
        parts = is_alike & (met[0] != met[1]) & ~is_near
        n_parted += int(parts.sum())
        by = np.flatnonzero(parts & (way[1] > way[0]))
        n_wrong += int(are_on_faces(plan, met[0, by], place[0, by]).sum())
        is_alike &= (met >= 0).all(axis=0)
        with np.errstate(invalid="ignore"):
            is_alike &= np.abs(place[0] - place[1]).max(axis=1) <= SAME * size
        here = place

    return Parted(n, n_parted, n_wrong)


def are_on_faces(plan: Plan, triangles: Ints, places: Floats) -> Bools:
    """Do places (n, 3) in the planes of triangles (n,) of a plan lie on them? On curved faces,
    within which hits are found, they do.
    """
    are_on = np.zeros(len(triangles), bool)
    for held in plan.layers:
        layer = held.layer
        k = held.places(len(plan.triangles))[triangles]
        some = np.flatnonzero(k >= 0)
        k, at = k[some], places[some]
        if layer.motion is not None:
            at, _ = layer.motion.back(at, at)
        is_on = is_within(*layer.frames.barycentric(k, at))
        if layer.curved is not None:
            is_on |= layer.curved.row[k] >= 0
        are_on[some] = is_on
    return are_on
