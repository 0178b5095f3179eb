"""Automatic judges patches of a large mesh before it fits all of it (core/glass/surfaces.py)."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.fingerprint import fingerprint
from kiriko.core.glass import surface_fit, surfaces
from kiriko.core.glass.surfaces import SAMPLE, make_surface
from known.reference_rigs import mean_normals, torus


def noisy(share):
    """A torus of 65 536 triangles, with noise of a thousandth of its size but for a share of its
    ring; mean normals.
    """
    mesh = torus(0.018, 0.007, 256, 128)
    x, _, z = mesh.vertices.T
    turn = np.arctan2(z, x) / (2 * np.pi) % 1
    away = 2.5e-5 * np.random.default_rng(0).normal(size=(len(turn), 3))
    away[turn < share] = 0.0
    moved = mean_normals(replace(mesh, vertices=mesh.vertices + away))
    return replace(moved, surface="automatic", has_mean_normals=True)


def fitted_whole(mesh, monkeypatch):
    """The surface without a look at patches."""
    with monkeypatch.context() as patched:
        patched.setattr(surfaces, "SAMPLE", replace(SAMPLE, large=len(mesh.triangles) + 1))
        return make_surface(mesh)


def test_glass_followed_as_drawn_costs_little_more_than_as_drawn(monkeypatch):
    """The fit sees less than a third of the triangles, and takes half of the memory or less.
    What is told of the mesh is what the fit to all of it tells, to a hundredth.
    """
    asked = []

    def looked_at(drawn, *options):
        asked.append(len(drawn.triangles))
        return make_curved(drawn, *options)

    mesh = noisy(0)
    n = len(mesh.triangles)
    make_curved = surface_fit.make_curved
    monkeypatch.setattr(surfaces, "make_curved", looked_at)
    tracemalloc.start()
    found = make_surface(mesh)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.reset_peak()
    whole = fitted_whole(mesh, monkeypatch)
    _, peak_of_whole = tracemalloc.get_traced_memory()
    tracemalloc.stop()

    assert sum(asked[:-1]) < n / 3
    assert asked[-1] == n
    assert peak < peak_of_whole / 2
    assert found.curved is None
    assert found.is_bent.all()
    assert whole.n_curved < 0.01 * n
    for name in ("n_doubted", "n_coarse", "n_contradicted"):
        assert getattr(found, name) == pytest.approx(getattr(whole, name), abs=0.01 * n)


@pytest.mark.parametrize("share", [0.2, 1.0])
def test_glass_that_is_curved_in_part_is_the_same_to_the_bit(share, monkeypatch):
    """Where a fifth of a mesh is regular all of it is fitted, as without a look at patches."""
    mesh = noisy(share)
    found, whole = make_surface(mesh), fitted_whole(mesh, monkeypatch)
    assert share - 0.05 < whole.n_curved / len(mesh.triangles) <= share
    assert fingerprint(found) == fingerprint(whole)
