"""Where rays meet curved faces, as seen from the side that they come from.

Roots are followed from where the ray engine found the hull (`curved_roots`). Where a root is of the
side that cannot be, the other one of the two is looked for: first by the ray's own course along the
face, then from many places on the faces around.
"""

from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.products import combine
from ..base.vectors import dot
from .curved import EDGE, FACES_AT_ONCE, CurvedFaces
from .curved_roots import ROOTS, Lines, Roots, Spots, follow
from .quartics import TO_BEZIER, cross, tangents, value_and_slopes


def find_roots(
    faces: CurvedFaces,
    spots: Spots,
    lines: Lines,
    leaves: Bools | None,
    least: float,
    is_last: bool = False,
) -> Roots:
    """Where rays meet the curved surface, beginning at places (n,) on it.

    Parameters
    ----------
    leaves : (n,) do rays come from within, so that only hits from behind can be; None: from
        either side. Where a root is of the other side, the one before or after it is looked
        for; but not for rays that have just left the surface, whose root is nearer than
        `least`, m
    is_last : all faces near the ray are asked, so that those around need not be searched
    """
    walks = ROOTS.last_walks if is_last else ROOTS.walks
    found = follow(faces, spots, lines, walks)
    if leaves is None:
        return found

    def find_odd() -> Ints:
        """Rays whose root is of the wrong side."""
        is_odd = found.is_met & (found.enters == leaves)
        return np.flatnonzero(is_odd & (leaves | (found.distance > least)))

    # first as far on the other side of where the ray touches the surface
    lost = np.flatnonzero(~found.is_met)
    odd = find_odd()
    if len(odd):
        some = lines.at(odd)
        beyond = _reflected(faces, found.spots.at(odd), some.directions)
        others = follow(faces, beyond, some, walks)
        better = others.is_met & (others.enters != leaves[odd])
        found.put(odd[better], others, better)
        odd = find_odd()
        # a ray that starts on the surface goes on to the next hit
        odd = odd[found.distance[odd] > least]

    if not is_last and len(odd) + len(lost):
        # light on its way in meets the front before the back it was found to meet; within, the
        # back is beyond; a ray that grazes may meet the surface where no root was found, but most
        # often it does not
        wrong = found.distance[odd]
        around = _Around(
            rays=np.append(odd, lost),
            near=np.append(found.triangle[odd], spots.triangle[lost]),
            least=np.append(np.where(leaves[odd], wrong, -np.inf), np.full(len(lost), least)),
            most=np.append(np.where(leaves[odd], np.inf, wrong), np.full(len(lost), np.inf)),
            n_starts=np.repeat([len(ROOTS.starts), ROOTS.few_starts], [len(odd), len(lost)]),
        )
        _search_around(faces, found, around, lines, leaves)

    return found


def pass_by(spheres: tuple[Floats, Floats], lines: Lines) -> tuple[Ints, Ints]:
    """Rays (m,) and the spheres (m,) that their lines enter, by number,
    of spheres with centres (t, 3) and radii (t,).
    """
    origins, directions = lines
    centre, radius = spheres
    middle = centre[0]  # from near here the squares lose nothing that matters
    o = origins - middle
    o -= dot(o, directions)[:, None] * directions
    away = centre - middle
    columns = np.ascontiguousarray(away.T)

    # distance of the centres from the lines, squared; by
    # products of matrices, many times as fast
    squares = dot(away, away)
    apart = combine(2 * o, columns)
    np.subtract(squares, apart, out=apart)
    apart += dot(o, o)[:, None]
    along = combine(directions, columns)
    along *= along
    apart -= along
    return np.nonzero(apart <= (1 + 1e-5) * radius**2 + 1e-12 * squares.max())


def are_in_boxes(faces: CurvedFaces, k: Ints, lines: Lines) -> Bools:
    """As seen along each of n rays, is it in the box around the curved face of triangle k (n,)?"""
    parts = [slice(first, first + FACES_AT_ONCE) for first in range(0, len(k), FACES_AT_ONCE)]
    holds = [_is_in_box(faces, k[some], lines.at(some)) for some in parts]
    return np.concatenate([np.zeros(0, bool), *holds])


def _is_in_box(faces: CurvedFaces, k: Ints, lines: Lines) -> Bools:
    """As seen along each ray, does the box around the Bezier
    points of the curved face of triangle k hold it?

    Faces that are followed beyond their edges may be met anywhere.
    """
    c = faces.terms(k)
    away = (faces.corners[k, 0] - lines.origins).T
    holds = np.ones(len(k), bool)

    for axis in tangents(lines.directions):
        a = axis.T
        seen = combine(TO_BEZIER, c[:, 0] * a[0] + c[:, 1] * a[1] + c[:, 2] * a[2])
        low = seen.min(axis=0)
        high = seen.max(axis=0)
        at = -(away * a).sum(axis=0)
        slack = 2 * EDGE * (high - low)
        holds &= (low - slack <= at) & (at <= high + slack)

    return holds | (np.asarray(faces.slack(faces.row[k])) > EDGE)


class _Around(NamedTuple):
    """Rays (n,) that are looked for on triangles (n,) and around, between two distances (n,), m,
    from so many places (n,) on each.
    """

    rays: Ints
    near: Ints
    least: Floats
    most: Floats
    n_starts: Ints


def _search_around(
    faces: CurvedFaces,
    found: Roots,
    around: _Around,
    lines: Lines,
    leaves: Bools,
) -> None:
    """Put the nearest roots on the right side on each of the faces around."""
    starts = np.array(ROOTS.starts)
    for first in range(0, len(around.rays), ROOTS.searched_at_once):
        some = _Around(*(column[first : first + ROOTS.searched_at_once] for column in around))
        near = _faces_around(faces, some.near)

        # the roots from all places on all of them
        i, j = np.nonzero(near >= 0)
        k = near[i, j]
        holds = are_in_boxes(faces, k, lines.at(some.rays[i]))
        i, k = i[holds], k[holds]
        start, of_place = np.nonzero(np.arange(len(starts))[:, None] < some.n_starts[i])
        i, k = i[of_place], k[of_place]
        u, v = starts[start].T
        if not len(k):
            continue
        rays = some.rays[i]
        others = follow(faces, Spots(k, u, v), lines.at(rays), ROOTS.walks)
        is_between = (others.distance > some.least[i]) & (others.distance < some.most[i])
        good = np.flatnonzero(others.is_met & (others.enters != leaves[rays]) & is_between)

        # nearest last, so that it is the one that stays
        good = good[np.argsort(-others.distance[good], kind="stable")]
        found.put(rays[good], others, good)


def _faces_around(faces: CurvedFaces, triangles: Ints) -> Ints:
    """Triangles (n, m): those (n,) given, and the curved ones around their corners; -1 for none."""
    n = len(triangles)
    first = np.tile(triangles, 3)
    corner = np.repeat(np.arange(3), n)
    is_open = np.ones(3 * n, bool)  # not yet once around
    ways = []
    for way in (1, 0):
        k, at = np.where(is_open, first, -1), corner  # of the face, where the corner is
        turns = [np.full(3 * n, -1)]
        for _ in range(ROOTS.corner_turns):
            row, edge = faces.row[k], (at + 2 + way) % 3
            beside = np.where(k >= 0, faces.neighbour[row, edge], -1)
            is_open &= beside != first
            at = (faces.neighbour_edge[row, edge] + way) % 3
            k = np.where(is_open, beside, -1)
            if (k < 0).all():
                break
            turns.append(k)
        ways.append(np.stack(turns, axis=1).reshape(3, n, -1))

    # one corner after the other, each first one way around and then the other
    around = np.concatenate(ways, axis=2).transpose(1, 0, 2).reshape(n, -1)
    return np.concatenate([triangles[:, None], around], axis=1)


def _reflected(faces: CurvedFaces, spots: Spots, directions: Floats) -> Spots:
    """Places about as far beyond where rays touch the
    surface as others are before it, or the reverse.
    """
    k, u, v = spots
    c = faces.terms(k)
    d = directions.T

    def facing(u: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
        _, by_u, by_v = value_and_slopes(c, u, v)
        return (d * cross(by_u, by_v)).sum(axis=0), by_u, by_v

    # the ray along the face: d = a by_u + b by_v, without the part perpendicular to both
    here, by_u, by_v = facing(u, v)
    uu = (by_u**2).sum(axis=0)
    uv = (by_u * by_v).sum(axis=0)
    vv = (by_v**2).sum(axis=0)
    du = (d * by_u).sum(axis=0)
    dv = (d * by_v).sum(axis=0)

    with np.errstate(invalid="ignore", divide="ignore"):
        a = (vv * du - uv * dv) / (uu * vv - uv * uv)
        b = (uu * dv - uv * du) / (uu * vv - uv * uv)
        size = np.maximum(np.abs(a), np.abs(b))
        a = a / size
        b = b / size

        # twice the way to the place where the face is seen edge on
        step = ROOTS.course_step
        way = -2 * here * step / (facing(u + step * a, v + step * b)[0] - here)

    way = np.clip(np.nan_to_num(way), -1.0, 1.0)
    return Spots(k, u + way * np.nan_to_num(a), v + way * np.nan_to_num(b))
