"""Lattice growth from unordered points, and the numbering of its points.

A photograph bends the lattice, so its rows are not straight. The lattice grows from a seed and its
two steps. A paraboloid through the neighbours, regularised by their steps, predicts each next
point, and the nearest point is accepted. Finally, outliers are removed, worst first.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Floats, Ints
from ...base.errors import ImageError
from .drawn import Lattice

# Constants of this file are verified on rendered photographs in tests/core/test_lattice.py.
NEAR = 0.3  # spacings, search radius around a prediction
STRANGE = 0.1  # spacings, a smaller error never makes an outlier
ABOVE_ROUGHNESS = 6.0  # times the median error of the predictions
UNLIKE = np.log(2.2)  # log of the size ratio of two neighbours
FAR_PX = 1e9  # distance of a point without neighbours
FEWEST = 4  # points of a lattice
MOST_TURNED_RAD = np.radians(50)  # rotation of a lattice's steps from the expected ones
REACH = 3  # columns and rows to the farthest neighbours
# possible ratios of the step to the next row and the step to the next column
SHAPES = 1j * np.concatenate([[0.5, 0.7, 1.0, 1.4, 2.0], np.exp(1j * np.radians([-30.0, 30.0]))])
Site = tuple[int, int]
Basis = NDArray[np.complex128]  # (2,) steps to the next column and row, x + iy
Seed = tuple[int, Basis]


def _seeds(
    points: Floats, sizes: Floats, shapes: NDArray, steps: NDArray | None = None
) -> list[Seed]:
    """Seed points and their lattice steps, the most likely first.

    Parameters
    ----------
    sizes : (k,) of the points; neighbours have similar sizes
    shapes : (q,) complex, possible ratios of the row step to the column step
    steps : (q,) complex px, expected column step, up to some rotation and scale; None for any
    """
    at = points[:, 0] + 1j * points[:, 1]
    if len(at) < FEWEST:
        return []

    # the nearest neighbours of some points
    chosen = np.unique(np.linspace(0, len(at) - 1, 80).astype(int))
    is_alike = np.abs(np.log(sizes / sizes[chosen, None])) < UNLIKE
    apart = np.where(is_alike, at - at[chosen, None], FAR_PX)
    order = np.argsort(np.abs(apart), axis=1)[:, 1:25]
    around = np.take_along_axis(apart, order, axis=1)

    # pairs of neighbours as steps, if their shape is possible
    n = min(10, around.shape[1])
    first, second = (k.ravel() for k in np.nonzero(~np.eye(n, dtype=bool)))
    a = around[:, first]
    b = around[:, second]

    is_likely = np.zeros(a.shape, bool)
    for k, shape in enumerate(shapes):
        fits = np.abs(b / a / shape - 1) < 0.4
        if steps is not None:
            grown = a / steps[k]
            fits &= np.abs(np.angle(grown)) < MOST_TURNED_RAD
            fits &= (np.abs(grown) > 0.4) & (np.abs(grown) < 2.5)
        is_likely |= fits & (np.abs(a) < FAR_PX) & (np.abs(b) < FAR_PX)

    # steps are more likely the better they predict the eight points around
    row, pair = np.nonzero(is_likely)
    a = a[row, pair]
    b = b[row, pair]
    short = np.minimum(np.abs(a), np.abs(b))
    missed = np.zeros(len(a))  # sum over the eight points, in search radii

    for i, j in product((-1, 0, 1), repeat=2):
        if (i, j) != (0, 0):
            off = np.abs(around[row] - (i * a + j * b)[:, None]).min(axis=1)
            missed += np.minimum(off / (NEAR * short), 1)

    # prefer the shortest of equally good steps
    missed += 0.05 * (np.abs(a) + np.abs(b)) / np.abs(around[row, 0])

    # the most likely steps of each point
    found = []
    has = set()

    for k in np.argsort(missed, kind="stable"):
        if row[k] not in has:
            has.add(row[k])
            found.append((int(chosen[row[k]]), np.array([a[k], b[k]])))

    return found[:8]


def largest(points: Floats, sizes: Floats, *shapes_and_steps: NDArray) -> dict[Site, int]:
    """The largest lattice grown from a seed: point indices by column and row, with an arbitrary
    origin.
    """
    best: dict[Site, int] = {}
    for seed in _seeds(points, sizes, *shapes_and_steps):
        sites = _grown(points[:, 0] + 1j * points[:, 1], sizes, *seed)
        if len(sites) > len(best):
            best = sites
        if len(best) > 0.97 * len(points):
            break
    return best


def _grown(at: NDArray[np.complex128], sizes: Floats, seed: int, basis: Basis) -> dict[Site, int]:
    """A lattice grown from a seed: point indices by column and row."""
    sites = {(0, 0): seed}
    bases = {(0, 0): basis}
    used = {seed}
    tried: dict[Site, int] = {}
    reach = 1
    while reach <= 2:  # 2 bridges a missing point
        steps = range(-reach, reach + 1)
        front = {
            (i + di, j + dj) for i, j in sites for di, dj in product(steps, steps)
        } - sites.keys()

        # predictions are repeated when more neighbours are found
        found = []
        for site in sorted(front):
            near = neighbours_of(site, sites)
            if tried.get(site) == len(near):
                continue

            tried[site] = len(near)

            # the nearest point of similar size
            neighbours = [sites[s] for s in near]
            place, there = predicted(
                site, near, at[neighbours], np.mean([bases[s] for s in near], axis=0)
            )
            off = np.where(
                np.abs(np.log(sizes / np.median(sizes[neighbours]))) < UNLIKE,
                np.abs(at - place),
                np.inf,
            )
            nearest = int(off.argmin())
            if off[nearest] < NEAR * np.abs(there).min() and nearest not in used:
                found.append((off[nearest], site, nearest, there))

        # best first, since each point has one site
        for _, site, nearest, there in sorted(found, key=lambda some: some[0]):
            if nearest not in used:
                sites[site], bases[site] = nearest, there
                used.add(nearest)

        reach = 1 if found else reach + 1
        if not found:
            tried.clear()

    return without_strangers(at, sites, bases)


def without_strangers(
    at: NDArray[np.complex128],
    sites: dict[Site, int],
    bases: dict[Site, Basis],
    strange: float = STRANGE,
) -> dict[Site, int]:
    """Sites without outliers, removed worst first."""
    sites = dict(sites)
    while off := roughness(at, sites, bases):
        worst = max(off, key=off.get)
        if off[worst] <= max(strange, ABOVE_ROUGHNESS * np.median(list(off.values()))):
            break
        del sites[worst]
    return sites


def roughness(
    at: NDArray[np.complex128], sites: dict[Site, int], bases: dict[Site, Basis]
) -> dict[Site, float]:
    """Errors of the predictions, in spacings, for points with enough neighbours."""
    off = {}
    for site in sites:
        near = [s for s in neighbours_of(site, sites) if s != site]
        if len(near) > 3:
            place, there = predicted(site, near, at[[sites[s] for s in near]], bases[site])
            off[site] = float(np.abs(at[sites[site]] - place) / np.abs(there).min())
    return off


def mean_steps(at: NDArray[np.complex128], sites: dict[Site, int]) -> Basis:
    """Mean steps to the next column and row, by a linear fit."""
    design = np.column_stack([np.ones(len(sites)), np.array(list(sites), float).reshape(-1, 2)])
    return np.linalg.lstsq(design, at[list(sites.values())], rcond=None)[0][1:]


def neighbours_of(site: Site, sites: dict[Site, int]) -> list[Site]:
    """Occupied sites up to three columns and rows away, including the site itself."""
    i, j = site
    steps = range(-REACH, REACH + 1)
    return [s for di, dj in product(steps, steps) if (s := (i + di, j + dj)) in sites]


def predicted(site: Site, near: list[Site], at: NDArray, basis: Basis) -> tuple[complex, Basis]:
    """A site's predicted point and steps: a paraboloid through nearby points, regularised by known
    steps.
    """
    d = np.array(near, float) - site
    design = np.column_stack([np.ones(len(d)), d, d**2, d[:, 0] * d[:, 1]])
    weight = 1 / (d**2).sum(axis=1)
    # weights of steps and curvature, relative to a point one spacing away
    held = np.diag([0, 0.01, 0.01, 0.03, 0.03, 0.03])
    right = design.T @ (weight * (at - d @ basis))
    found = np.linalg.solve((design.T * weight) @ design + held, right)
    return found[0], basis + found[1:3]


def is_lattice(points: Floats, sites: dict[Site, int]) -> bool:
    """Whether a grown lattice is more regular than chance."""
    # a few points must be most of the found ones
    if len(sites) < (FEWEST if len(sites) > 0.6 * len(points) else 9):
        return False
    at = points[:, 0] + 1j * points[:, 1]
    rough = list(roughness(at, sites, dict.fromkeys(sites, mean_steps(at, sites))).values())
    return not rough or bool(np.quantile(rough, 0.75) < STRANGE)


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
    """Number unordered points by growing a lattice: (m, 2), NaN for missing ones.

    The points may be shifted by any amount from the expected ones, rotated by up to 45 degrees,
    scaled by 0.5 to 2 and bent. Some may be missing, and a few may not belong to the lattice. If
    whole rows or columns at the border are missing, the placement nearest to the expected one is
    used.

    Parameters
    ----------
    points : (k, 2) px, in any order
    expected : (m, 2) px, NaN for points out of view

    Raises
    ------
    ImageError : the points do not form the lattice, or their numbering is ambiguous
    """
    expected = np.asarray(expected, float)
    _check_extra(len(points), len(lattice), lattice)  # growing millions of points is slow
    sites = largest(points, np.ones(len(points)), *_expected_steps(expected, lattice))
    if len(sites) < FEWEST:
        raise ImageError(
            "The {n_points} points do not form the lattice of {columns} x {rows}. Choose another"
            " photograph, or number the points in a CSV file.",
            n_points=len(points),
            columns=lattice.columns,
            rows=lattice.rows,
        )

    # number the points
    index = np.array(list(sites.values()))
    places = _placements(np.array(list(sites)), lattice)
    at = points[index]
    place = _nearest_placement(places, at, expected, lattice)
    found = np.full((len(lattice), 2), np.nan)
    found[place[place >= 0]] = at[place >= 0]

    _check_extra(len(points), int((place >= 0).sum()), lattice)
    return found


def _check_extra(n_points: int, n: int, lattice: Lattice) -> None:
    """Raise ImageError if too few (n) of the points have a place in the lattice."""
    extra = n_points - n
    if extra > max(3, n // 4):
        raise ImageError(
            "{extra} of {n_points} points do not fit the lattice of {columns} x {rows}. Remove"
            " other bright spots, or correct the lattice.",
            extra=extra,
            n_points=n_points,
            columns=lattice.columns,
            rows=lattice.rows,
        )


def _expected_steps(expected: Floats, lattice: Lattice) -> tuple[NDArray, NDArray]:
    """Shapes and steps for `_seeds` at samples of the expected lattice."""
    at = (expected[:, 0] + 1j * expected[:, 1]).reshape(lattice.rows, lattice.columns)
    right = (at[:-1, 1:] - at[:-1, :-1]).ravel()
    down = (at[1:, :-1] - at[:-1, :-1]).ravel()

    is_visible = np.isfinite(right) & np.isfinite(down) & (np.abs(right) > 0) & (np.abs(down) > 0)
    if not is_visible.any():
        raise ImageError(
            "The viewer sees too little of the lattice to number its points. Compare its columns,"
            " rows and margin with the picture."
        )

    right = right[is_visible]
    down = down[is_visible]
    some = np.unique(np.linspace(0, len(right) - 1, 9).astype(int))
    return (down / right)[some], right[some]


def _placements(sites: Ints, lattice: Lattice) -> list[tuple[int, Ints]]:
    """Placements of sites (n, 2) in the lattice with at most one more left over than the best.

    Each has the number of its rotation and slant, and the lattice index (n,) of each site, -1 for
    none. Slants are needed because a lattice may grow by steps along its diagonals.
    """
    size = np.array([lattice.columns, lattice.rows])
    counted = []

    for turn, slant in product(QUARTER_TURNS, SLANTS):
        turned = sites @ slant @ turn
        turned -= turned.min(axis=0)

        # number of sites in each window of the lattice's size, beginning at
        # -(size - 1), from a summed-area table
        total = np.zeros(turned.max(axis=0) + 2 * size, int)
        np.add.at(total, tuple((turned + size).T), 1)
        total = total.cumsum(axis=0).cumsum(axis=1)
        w, h = size
        m, n = np.array(total.shape) - size
        counted.append((turned, total[w:, h:] - total[:m, h:] - total[w:, :n] + total[:m, :n]))

    # all windows with at most one site less than the best
    fewest = max(max(count.max() for _, count in counted) - 1, FEWEST)
    places = []

    for number, (turned, count) in enumerate(counted):
        for start in np.argwhere(count >= fewest):
            moved = turned - (start + 1 - size)
            inside = ((moved >= 0) & (moved < size)).all(axis=1)
            places.append((number, np.where(inside, moved[:, 1] * size[0] + moved[:, 0], -1)))

    return places


def _nearest_placement(
    places: list[tuple[int, Ints]], at: Floats, expected: Floats, lattice: Lattice
) -> Ints:
    """The placement with the least rotation from the expected points, then the nearest; ImageError
    if it is ambiguous.
    """
    turned: dict[int, float] = {}
    distance = []

    for number, place in places:
        wanted = np.where((place >= 0)[:, None], expected[place], np.nan)
        both = np.isfinite(wanted).all(axis=1)
        distance.append(np.linalg.norm((at - wanted)[both].mean(axis=0)) if both.any() else np.inf)

        # similarity transform, and residual bend
        p, e = (xy[both, 0] + 1j * xy[both, 1] for xy in (at, wanted))
        if both.sum() >= 2:
            p = p - p.mean()
            e = e - e.mean()
            grown = np.vdot(e, p) / np.vdot(e, e)
            # a bend as large as the lattice counts as 2 rad
            bent = np.linalg.norm(p - grown * e) / np.linalg.norm(grown * e)
            off = abs(np.angle(grown)) + 2 * bent
            turned[number] = min(off, turned.get(number, np.inf))

    if not turned:
        raise ImageError(
            "No point is near its expected position, so the points cannot be numbered. Number them"
            " in a CSV file."
        )

    least, *others = sorted(turned, key=turned.get)
    if others and turned[others[0]] - turned[least] < np.radians(4):
        raise ImageError(
            "The photograph is rotated by about 45 degrees, so its upper side is ambiguous. Rotate"
            " it."
        )

    order = [k for k in np.argsort(distance) if places[k][0] == least]
    if len(order) > 1 and not distance[order[1]] > 1.5 * distance[order[0]]:
        raise ImageError(
            "Too few of the {columns} columns and {rows} rows are visible to number them. Show"
            " more of the lattice, or number the points in a CSV file.",
            columns=lattice.columns,
            rows=lattice.rows,
        )

    return places[order[0]][1]
