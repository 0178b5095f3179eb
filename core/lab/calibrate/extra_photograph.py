"""Which other photograph would tell most of a bench's errors?

A photograph narrows the errors' covariance C down, from that which the first one left. It tells
1/2 log2(det C before / det C after) bits, the second viewer's own place aside. Nothing is fitted
for it: movements of points, which are found for each place, are enough.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ...base.arrays import Bools, Floats
from ...base.errors import RigError
from ...base.messages import Message
from ...base.steps import within
from ...bench.offset import moved, parameters, turned
from ...glass.motion import Motion
from ...rig.rig import Viewer
from .fit import Fit, condition_of, covariance_of
from .misalignment import FEWEST, Bench

ASIDE_DEGREES = 10.0  # from which another photograph is considered
NEARER = 0.7  # of the distance to the glass, likewise


@dataclass(frozen=True, eq=False)
class Extra:
    """Another photograph, of the same display from another place, and the knowledge it would add.

    where : the place, from the viewer
    errors : (p,) standard deviations of the amounts then
    condition : that of both photographs' movements together
    gain : bits that it tells of the errors, the second viewer's own place aside
    """

    where: str
    errors: Floats
    condition: float
    gain: float


def extra_photographs(
    bench: Bench, found: Fit, tolerances: Floats, noise: float = 0.3
) -> Generator[float, None, list[Extra]]:
    """Other places to take a photograph from, the most telling first; yields progress.

    The place of the second viewer is as uncertain as that
    of the first; its focal length is the same.
    """
    viewer = bench.viewer
    pivot = bench.rig.glasses[0].mesh.bounds.mean(axis=0)
    away = viewer.axes[2]

    n = len(bench.parameters)
    own = np.array(
        [
            p.name.startswith(f"{viewer.name}: ") and p.unit in {"mm", "deg"}
            for p in bench.parameters
        ]
    )
    shared = np.flatnonzero(~own)

    # the second viewer's own place is a parameter more
    first = np.hstack([found.movements, np.zeros((len(found.movements), own.sum()))])
    columns = np.arange(n)
    columns[own] = n + np.arange(own.sum())
    before = covariance_of(first)[np.ix_(shared, shared)]

    # about where the points are: as far away as the glass
    origins, directions = viewer.rays(bench.view)
    points = origins + directions * ((pivot - origins) @ away / (directions @ away))[:, None]
    extras = []
    places = _places(viewer, pivot)
    for k, (where, motion) in enumerate(places.items()):
        try:
            there = _bench_from(bench, motion, points, own)
            d = yield from within(there.sensitivities(), k / len(places), (k + 1) / len(places))
        except RigError:  # nothing is seen from there
            continue

        used = np.isfinite(d).all(axis=(0, 2))
        if used.sum() < FEWEST:
            continue

        # with the movements of both photographs
        second = np.zeros((2 * used.sum(), first.shape[1]))
        second[:, columns] = d[:, used].reshape(n, -1).T * tolerances / noise
        both = np.vstack([first, second])

        covariance = covariance_of(both)
        after = covariance[np.ix_(shared, shared)]
        gain = 0.5 * (np.linalg.slogdet(before)[1] - np.linalg.slogdet(after)[1]) / np.log(2)
        extras.append(
            Extra(
                where=where,
                errors=np.sqrt(np.diag(covariance))[:n] * tolerances,
                condition=condition_of(both),
                gain=float(gain),
            )
        )

    return sorted(extras, key=lambda extra: -extra.gain)


def _places(viewer: Viewer, pivot: Floats) -> dict[Message, Motion]:
    """Other places of the viewer around a point (3,), m, in words, and how it gets there."""
    right, up, away = viewer.axes
    angle = ASIDE_DEGREES
    nearer = (1 - NEARER) * ((pivot - viewer.position) @ away) * away
    return {
        Message("{angle:g} degrees further right", angle=angle): turned(up, angle, pivot),
        Message("{angle:g} degrees further left", angle=angle): turned(up, -angle, pivot),
        Message("{angle:g} degrees higher", angle=angle): turned(right, -angle, pivot),
        Message("{angle:g} degrees lower", angle=angle): turned(right, angle, pivot),
        Message("{factor:g} times the distance", factor=NEARER): Motion(np.eye(3), nearer),
    }


def _bench_from(bench: Bench, motion: Motion, points: Floats, own: Bools) -> Bench:
    """A bench whose viewer stands elsewhere and sees the points (m, 3), m, that it shows.

    own (p,) : parameters of the viewer's own place: the second is shifted
        and turned about its own axes
    """
    viewer = moved(bench.viewer, motion)
    rig = replace(bench.rig, viewers=(viewer, *bench.rig.viewers[1:]))
    theirs = {p.name: p for p in parameters(rig)}
    among = [
        theirs[p.name] if is_own else p for p, is_own in zip(bench.parameters, own, strict=True)
    ]
    there = Bench(rig, bench.settings, viewer.project(points), among)
    at = there.seen(np.zeros(len(among)), display=bench.display)

    return Bench(rig, bench.settings, at, among)
