"""Newton's method of `curved_roots` for a single ray, in Python's own numbers.

A step of a ray or two takes numpy as long as one of hundreds. Most steps would be such, for a few
rays wander from face to face while all others are there. In Python they take a tenth of the time.
The operations are the same in the same order, and so is each bit of what they come to.
"""

from collections.abc import Sequence
from math import copysign, inf
from typing import TYPE_CHECKING, NamedTuple

from .quartics import horner

if TYPE_CHECKING:
    from .curved_roots import RootKnobs

Vector = Sequence[float]


class LoneSeen(NamedTuple):
    """A face as seen from a ray: 14 coefficients of each coordinate (3, 14), its first corner
    relative to the ray's origin (3,), m, and the ray's direction (3,).
    """

    terms: Sequence[Vector]
    away: Vector
    direction: Vector


class LonePlace(NamedTuple):
    """u, v on a face, the size of the last step, and how many there were."""

    u: float
    v: float
    size: float
    n_steps: int


def step_to_end(seen: LoneSeen, place: LonePlace, knobs: "RootKnobs") -> LonePlace:
    """The place at which the ray is through with its face, after a step or more."""
    u, v, _, n_steps = place
    longest = knobs.longest_step
    goes_on = True
    while goes_on:
        du, dv = _newton_step(seen, u, v)
        along, across = abs(du), abs(dv)
        # NaN where one of the two is; and -1 in its place as u, v
        size = across if across > along or across != across else along
        limit = longest / size if size > longest else 1.0
        u += limit * du
        v += limit * dv
        u = min(u, 2.0) if u > -1.0 else -1.0
        v = min(v, 2.0) if v > -1.0 else -1.0

        n_steps += 1
        is_near = min(u, v, 1.0 - u - v) > -knobs.aside
        is_hopeful = n_steps <= knobs.patience or size < knobs.hopeless
        is_open = is_near and is_hopeful and not size < knobs.converged
        goes_on = (is_open and n_steps < knobs.iterations) or n_steps < 2

    return LonePlace(u, v, size, n_steps)


def _newton_step(seen: LoneSeen, u: float, v: float) -> tuple[float, float]:
    x_of, y_of, z_of = seen.terms
    x, xu, xv = horner(x_of, u, v)
    y, yu, yv = horner(y_of, u, v)
    z, zu, zv = horner(z_of, u, v)
    away_x, away_y, away_z = seen.away
    x += away_x
    y += away_y
    z += away_z

    # across the ray
    dx, dy, dz = seen.direction
    ax = y * dz - z * dy
    ay = z * dx - x * dz
    az = x * dy - y * dx
    det = dx * (yu * zv - zu * yv) + dy * (zu * xv - xu * zv) + dz * (xu * yv - yu * xv)
    inverse = 1.0 / det if det else copysign(inf, det)
    du = (ax * xv + ay * yv + az * zv) * inverse
    dv = -(ax * xu + ay * yu + az * zu) * inverse
    return du, dv
