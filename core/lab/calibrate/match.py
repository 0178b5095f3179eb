"""Which point of a photograph is which of the lattice?

A lattice that has grown counts its points from anywhere, along any of its rows, columns and
diagonals. So it is put into the drawn one in all ways that leave the fewest points over: by quarter
turns, slants and shifts. Of these the one counts that is turned least against what is expected, off
= |angle| + 2 |p - g e| / |g e| with g e the expected points e turned and scaled onto those seen, p;
of its shifts the nearest. Where a second one is nearly as good the photograph is refused.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Floats, Ints
from ...base.errors import ImageError
from .drawn import Lattice
from .growth import GROWTH, largest


@dataclass(frozen=True)
class Clarity:
    """When it is clear which points are which; held by tests/core/test_lattice.py.

    turn_rad : how much more the second best way has to be turned
    distance : times the distance of the best, that of the second best
    n_extra, extra_of : points that may have no place in the lattice; or one in so many others
    n_steps : of the expected lattice, that are taken for a seed
    bent : rad, that a lattice bent by its whole size counts as being turned
    """

    turn_rad: float = np.radians(4.0)
    distance: float = 1.5
    n_extra: int = 3
    extra_of: int = 4
    n_steps: int = 9
    bent: float = 2


CLARITY = Clarity()
QUARTER_TURNS = [
    np.array(turn)
    for turn in ([[1, 0], [0, 1]], [[0, 1], [-1, 0]], [[-1, 0], [0, -1]], [[0, -1], [1, 0]])
]
SLANTS = [
    np.array(slant)
    for slant in (
        [[1, 0], [0, 1]],
        [[1, 1], [0, 1]],
        [[1, -1], [0, 1]],
        [[1, 0], [1, 1]],
        [[1, 0], [-1, 1]],
    )
]


def match(points: Floats, expected: Floats, lattice: Lattice) -> Floats:
    """Points told apart by how the lattice goes on from one
    to the next: (m, 2), NaN where none was found.

    They may be shifted by any amount against those expected, turned by up to 45 degrees, scaled by
    0.5 to 2 and bent; some may be missing, a few may be none of the lattice's. Where whole rows or
    columns at the border are missing, the place nearest to the expected one is taken.

    Parameters
    ----------
    points : (k, 2) px, in any order
    expected : (m, 2) px, NaN where a point is not expected to be seen

    Raises
    ------
    ImageError : the points are not those of the lattice, or may be so in several ways
    """
    expected = np.asarray(expected, float)
    _check_extra(len(points), len(lattice), lattice)  # else millions of them would be grown first
    sites = largest(points, np.ones(len(points)), *_expected_steps(expected, lattice))
    if len(sites) < GROWTH.fewest:
        raise ImageError(
            "The {n_points} points do not form the lattice of {columns} x {rows}: choose"
            " another photograph, or name each point in a CSV file.",
            n_points=len(points),
            columns=lattice.columns,
            rows=lattice.rows,
        )

    # the place of each in the lattice
    index = np.array(list(sites.values()))
    places = _placements(np.array(list(sites)), lattice)
    at = points[index]
    place = _nearest_placement(places, at, expected, lattice)
    found = np.full((len(lattice), 2), np.nan)
    found[place[place >= 0]] = at[place >= 0]

    _check_extra(len(points), int((place >= 0).sum()), lattice)
    return found


def _check_extra(n_points: int, n: int, lattice: Lattice) -> None:
    """Raise ImageError if, of so many points, too few (n) have a place in the lattice."""
    extra = n_points - n
    if extra > max(CLARITY.n_extra, n // CLARITY.extra_of):
        raise ImageError(
            "{extra} of {n_points} points have no place in the lattice of {columns} x"
            " {rows}: remove other bright spots, or set the lattice that is shown.",
            extra=extra,
            n_points=n_points,
            columns=lattice.columns,
            rows=lattice.rows,
        )


def _expected_steps(expected: Floats, lattice: Lattice) -> tuple[NDArray, NDArray]:
    """Shapes and steps for `_seeds` at some places of the expected lattice."""
    at = (expected[:, 0] + 1j * expected[:, 1]).reshape(lattice.rows, lattice.columns)
    right = (at[:-1, 1:] - at[:-1, :-1]).ravel()
    down = (at[1:, :-1] - at[:-1, :-1]).ravel()

    is_known = np.isfinite(right) & np.isfinite(down) & (np.abs(right) > 0) & (np.abs(down) > 0)
    if not is_known.any():
        raise ImageError(
            "The viewer sees too little of the lattice to tell its points apart: compare"
            " its columns, rows and margin with the picture."
        )

    right = right[is_known]
    down = down[is_known]
    some = np.unique(np.linspace(0, len(right) - 1, CLARITY.n_steps).astype(int))
    return (down / right)[some], right[some]


def _placements(sites: Ints, lattice: Lattice) -> list[tuple[int, Ints]]:
    """Ways to put sites (n, 2) into the lattice that leave (nearly) the fewest over.

    Each as a number of the turn and slant that it takes, and which point (n,) each is then, -1
    for none. Slanted, because a lattice grows as well by steps along its diagonals.
    """
    size = np.array([lattice.columns, lattice.rows])
    ways = []

    for turn, slant in product(QUARTER_TURNS, SLANTS):
        turned = sites @ slant @ turn
        turned -= turned.min(axis=0)

        # how many sites lie in a window of the lattice's size that
        # begins at - (size - 1), ...: by sums from the corner
        total = np.zeros(turned.max(axis=0) + 2 * size, int)
        np.add.at(total, tuple((turned + size).T), 1)
        total = total.cumsum(axis=0).cumsum(axis=1)
        w, h = size
        m, n = np.array(total.shape) - size
        ways.append((turned, total[w:, h:] - total[:m, h:] - total[w:, :n] + total[:m, :n]))

    # all windows with nearly the most sites
    fewest = max(max(count.max() for _, count in ways) - 1, GROWTH.fewest)
    places = []

    for number, (turned, count) in enumerate(ways):
        for start in np.argwhere(count >= fewest):
            moved = turned - (start + 1 - size)
            inside = ((moved >= 0) & (moved < size)).all(axis=1)
            places.append((number, np.where(inside, moved[:, 1] * size[0] + moved[:, 0], -1)))

    return places


def _nearest_placement(
    places: list[tuple[int, Ints]], at: Floats, expected: Floats, lattice: Lattice
) -> Ints:
    """The placement turned least against those expected, of
    these the nearest; ImageError where it is not clear.
    """
    turned: dict[int, float] = {}
    distance = []

    for number, place in places:
        wanted = np.where((place >= 0)[:, None], expected[place], np.nan)
        both = np.isfinite(wanted).all(axis=1)
        distance.append(np.linalg.norm((at - wanted)[both].mean(axis=0)) if both.any() else np.inf)

        # turned and scaled as a whole, and bent
        p, e = (xy[both, 0] + 1j * xy[both, 1] for xy in (at, wanted))
        if both.sum() >= 2:
            p = p - p.mean()
            e = e - e.mean()
            grown = np.vdot(e, p) / np.vdot(e, e)
            off = abs(np.angle(grown)) + CLARITY.bent * np.linalg.norm(
                p - grown * e
            ) / np.linalg.norm(grown * e)
            turned[number] = min(off, turned.get(number, np.inf))

    if not turned:
        raise ImageError(
            "No point is seen near its expected place, so that the points cannot"
            " be told apart: name each point in a CSV file."
        )

    least, *others = sorted(turned, key=turned.get)
    if others and turned[others[0]] - turned[least] < CLARITY.turn_rad:
        raise ImageError(
            "The photograph is turned by about 45 degrees, so left and upper cannot be told apart:"
            " turn it."
        )

    order = [k for k in np.argsort(distance) if places[k][0] == least]
    if len(order) > 1 and not distance[order[1]] > CLARITY.distance * distance[order[0]]:
        raise ImageError(
            "Too few of the {columns} columns and {rows} rows are seen to number them: show"
            " more of the lattice, or name each point in a CSV file.",
            columns=lattice.columns,
            rows=lattice.rows,
        )

    return places[order[0]][1]
