"""Rays that are followed over curved faces one by one come to what they come to together."""

import numpy as np
import pytest

from kiriko.core.glass import curved_roots
from kiriko.core.glass.curved_hits import find_roots
from kiriko.core.glass.curved_roots import ROOTS, Lines, Spots, follow
from kiriko.core.glass.surfaces import make_surface
from known.reference_rigs import bottle, icosphere

N = 300


def both_ways(monkeypatch, of):
    """What is found by steps of all rays together, and one ray after the other."""
    for few in (0, N * 1000):
        monkeypatch.setattr(curved_roots, "FEW_ALONE", few)
        yield of()


def are_same(a, b):
    """Are all columns the same, bit by bit?"""
    return all(x.tobytes() == y.tobytes() for x, y in zip(a, b, strict=True))


def some_rays(curved, seed=0):
    """Rays anywhere near curved faces, and places on these to begin at; among them rays that run
    along their faces, and some of no direction, whose steps are no numbers.
    """
    dice = np.random.default_rng(seed)
    size = np.ptp(curved.corners, axis=(0, 1)).max()
    k = dice.choice(curved.triangle, N)
    u, v = dice.random((2, N)) / 2
    directions = dice.normal(size=(N, 3))
    edge = curved.corners[k, 1] - curved.corners[k, 0]
    directions[: N // 4] = edge[: N // 4]
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    directions[-5:] = 0.0
    origins = curved.points(k, u, v) - size * dice.random((N, 1)) * directions
    origins += 0.1 * size * dice.random((N, 1)) * dice.normal(size=(N, 3))
    return Spots(k, u, v), Lines(origins, directions)


@pytest.mark.parametrize("mesh", [icosphere(0.02, 2), bottle()], ids=["ball", "bottle"])
def test_rays_followed_one_by_one_come_to_the_same_to_the_last_bit(monkeypatch, mesh):
    """Those that meet a face, that wander over several, and that meet none."""
    curved = make_surface(mesh).curved
    spots, lines = some_rays(curved)
    together, alone = both_ways(monkeypatch, lambda: follow(curved, spots, lines, ROOTS.walks))
    assert are_same(together, alone)
    assert 20 < together.is_met.sum() < N - 20
    assert (together.triangle[together.is_met] != spots.triangle[together.is_met]).any()
    assert not together.is_met[-5:].any()


@pytest.mark.parametrize("mesh", [icosphere(0.02, 2), bottle()], ids=["ball", "bottle"])
def test_roots_of_the_other_side_are_the_same_too(monkeypatch, mesh):
    """Where faces around are searched as well."""
    curved = make_surface(mesh).curved
    spots, lines = some_rays(curved, seed=1)
    leaves = np.arange(N) % 2 == 0
    together, alone = both_ways(monkeypatch, lambda: find_roots(curved, spots, lines, leaves, 1e-9))
    assert are_same(together, alone)
    assert (together.enters != leaves)[together.is_met].any()
