"""Which of the points that were found make up a lattice, and which are each other's neighbours."""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...arrays import Floats

# how a lattice goes on
NEAR = 0.3  # spacings, from where a point should be by its neighbours
STRANGE = 0.1  # spacings off: this is never too far
UNLIKE = np.log(2.2)  # in size, two neighbours
FAR = 1e9  # px
# fewer points than these are a lattice only if they are most of those found
BY_CHANCE = 9
FEW_BY_CHANCE = 0.6
N_AROUND = 24  # nearest neighbours that tell a point's spacings
N_SEEDS = 80
N_GROWN = 8
SHAPES = 1j * np.concatenate([[0.5, 0.7, 1.0, 1.4, 2.0], np.exp(1j * np.radians([-30.0, 30.0]))])
MOST_TURNED = np.radians(50.0)
LEAST_SCALE = 0.4
MOST_SCALE = 2.5
FEWEST = 4  # points of a lattice
ABOVE_ROUGHNESS = 6.0  # times the median distance of points from where their neighbours want them
Site = tuple[int, int]
Basis = NDArray[np.complex128]  # (2,) steps to the next column and to the next row, x + iy
Seed = tuple[int, Basis]


def _seeds(
    points: Floats, sizes: Floats, shapes: NDArray, steps: NDArray | None = None
) -> list[Seed]:
    """Points from which a lattice may be grown, and its steps there; the likeliest first.

    Parameters
    ----------
    sizes : (k,) of the points: those of neighbours differ little
    shapes : (q,) complex, step to the next row by that to the next column, as they may be
    steps : (q,) complex px, step to the next column, from which it
        may be turned and scaled somewhat; None: any
    """
    at = points[:, 0] + 1j * points[:, 1]
    if len(at) < FEWEST:
        return []
    chosen = np.unique(np.linspace(0, len(at) - 1, N_SEEDS).astype(int))
    is_alike = np.abs(np.log(sizes / sizes[chosen, None])) < UNLIKE
    apart = np.where(is_alike, at - at[chosen, None], FAR)
    order = np.argsort(np.abs(apart), axis=1)[:, 1 : N_AROUND + 1]
    around = np.take_along_axis(apart, order, axis=1)
    n = min(10, around.shape[1])
    first, second = (k.ravel() for k in np.nonzero(~np.eye(n, dtype=bool)))
    a = around[:, first]
    b = around[:, second]
    is_likely = np.zeros(a.shape, bool)
    for k, shape in enumerate(shapes):
        fits = np.abs(b / a / shape - 1) < 0.4
        if steps is not None:
            grown = a / steps[k]
            fits &= (np.abs(np.angle(grown)) < MOST_TURNED) & (np.abs(grown) > LEAST_SCALE)
            fits &= np.abs(grown) < MOST_SCALE
        is_likely |= fits & (np.abs(a) < FAR) & (np.abs(b) < FAR)
    row, pair = np.nonzero(is_likely)
    a = a[row, pair]
    b = b[row, pair]
    short = np.minimum(np.abs(a), np.abs(b))
    missed = np.zeros(len(a))  # of the eight points around, in NEAR
    for i, j in product((-1, 0, 1), repeat=2):
        if (i, j) != (0, 0):
            off = np.abs(around[row] - (i * a + j * b)[:, None]).min(axis=1)
            missed += np.minimum(off / (NEAR * short), 1)
    missed += 0.05 * (np.abs(a) + np.abs(b)) / np.abs(around[row, 0])  # of equals the shortest
    found = []
    has = set()
    for k in np.argsort(missed, kind="stable"):
        if row[k] not in has:
            has.add(row[k])
            found.append((int(chosen[row[k]]), np.array([a[k], b[k]])))
    return found[:N_GROWN]


def largest(points: Floats, sizes: Floats, *shapes_and_steps: NDArray) -> dict[Site, int]:
    """The largest lattice that grows from a seed: indices of
    points by column and row, counted from anywhere.
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
    """Points that go on from a seed, each where those before
    let it be expected: indices by column and row.
    """
    sites = {(0, 0): seed}
    bases = {(0, 0): basis}
    used = {seed}
    tried: dict[Site, int] = {}
    reach = 1
    while reach <= 2:  # where one is missing the next may be there
        steps = range(-reach, reach + 1)
        front = {
            (i + di, j + dj) for i, j in sites for di, dj in product(steps, steps)
        } - sites.keys()
        found = []
        for site in sorted(front):
            near = neighbours_of(site, sites)
            if tried.get(site) == len(near):
                continue
            tried[site] = len(near)
            known = [sites[s] for s in near]
            place, there = predicted(
                site, near, at[known], np.mean([bases[s] for s in near], axis=0)
            )
            off = np.where(
                np.abs(np.log(sizes / np.median(sizes[known]))) < UNLIKE, np.abs(at - place), np.inf
            )
            nearest = int(off.argmin())
            if off[nearest] < NEAR * np.abs(there).min() and nearest not in used:
                found.append((off[nearest], site, nearest, there))
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
    """Without the points that stand further from where their
    neighbours want them than the others do, worst first.
    """
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
    """How far points stand from where their neighbours want them, in spacings.

    Of those that have enough of these.
    """
    off = {}
    for site in sites:
        near = [s for s in neighbours_of(site, sites) if s != site]
        if len(near) > 3:
            place, there = predicted(site, near, at[[sites[s] for s in near]], bases[site])
            off[site] = float(np.abs(at[sites[site]] - place) / np.abs(there).min())
    return off


def mean_steps(at: NDArray[np.complex128], sites: dict[Site, int]) -> Basis:
    """Steps to the next column and to the next row, by all points."""
    design = np.column_stack([np.ones(len(sites)), np.array(list(sites), float).reshape(-1, 2)])
    return np.linalg.lstsq(design, at[list(sites.values())], rcond=None)[0][1:]


def neighbours_of(site: Site, sites: dict[Site, int]) -> list[Site]:
    """Sites up to three columns and rows away, itself included, that have a point."""
    i, j = site
    return [s for di, dj in product(range(-3, 4), range(-3, 4)) if (s := (i + di, j + dj)) in sites]


def predicted(site: Site, near: list[Site], at: NDArray, basis: Basis) -> tuple[complex, Basis]:
    """Where a point should be, and its steps there: by a
    paraboloid through points near it, held by known steps.
    """
    d = np.array(near, float) - site
    design = np.column_stack([np.ones(len(d)), d, d**2, d[:, 0] * d[:, 1]])
    weight = 1 / (d**2).sum(axis=1)
    held = np.diag([0, 0.01, 0.01, 0.03, 0.03, 0.03])
    right = design.T @ (weight * (at - d @ basis))
    found = np.linalg.solve((design.T * weight) @ design + held, right)
    return found[0], basis + found[1:3]


def is_lattice(points: Floats, sites: dict[Site, int]) -> bool:
    """Are the points that grew together as regular as chance would not have them?"""
    if len(sites) < (FEWEST if len(sites) > FEW_BY_CHANCE * len(points) else BY_CHANCE):
        return False
    at = points[:, 0] + 1j * points[:, 1]
    rough = list(roughness(at, sites, dict.fromkeys(sites, mean_steps(at, sites))).values())
    return not rough or bool(np.quantile(rough, 0.75) < STRANGE)
