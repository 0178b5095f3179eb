"""Faces between curved and as drawn, where a mesh is irregular (core/glass/trust.py)."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.glass import trust
from kiriko.core.glass.agreement import ErrorEstimate
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.glass.trust import PART, weights
from known.judged_meshes import CHOICES, disturbed, errors
from known.reference_rigs import torus


def test_weights_are_those_of_least_squares():
    """Of errors e and f that do not know of each other the mean of least error weighs the first by
    f^2 / (e^2 + f^2), where jumps tell e and the gain is the sum of both squared.
    """
    vertex = np.array([[0, 1, 2], [3, 4, 5], [6, 7, 8]])
    curved = np.array([1e-3, 2e-3, 2e-3])
    drawn = np.array([3e-3, 2e-3, 1e-3])
    trial = ErrorEstimate(
        curved**2 / PART.squared_error, curved**2 + drawn**2, np.zeros(3), np.zeros(3)
    )
    found = weights(9, vertex, trial, np.zeros(3, bool))
    assert found == pytest.approx(np.repeat([0.9, 0.5, 0.0], 3), abs=1e-4)
    assert (weights(9, vertex, trial, np.ones(3, bool)) == 1).all()


@pytest.mark.parametrize(
    ("name", "aside", "noise"), [("ball, 5120", 0, 3e-5), ("torus, 4096", 0.3, 0)]
)
def test_the_mean_of_two_surfaces_is_better_than_either(name, aside, noise):
    """Where both are about as far off the mean lands light a seventh
    nearer to the shape that was meant, and more.
    """
    shape = name.split(",")[0]
    mesh = disturbed(name, aside, noise)
    drawn, smooth, automatic = (errors(shape, mesh, choice) for choice in CHOICES)
    assert automatic.rms < 6 / 7 * min(drawn.rms, smooth.rms)


def test_regular_meshes_are_followed_whole_or_not_at_all(monkeypatch):
    """A torus too coarse to trust, and one with noise along its smooth lines, have no weights."""
    asked = []

    def looked_at(*given):
        trusted = yield from found(*given)
        asked.append(trusted.weight)
        return trusted

    found = trust.trust_steps
    monkeypatch.setattr("kiriko.core.glass.surface_fit.trust_steps", looked_at)
    for mesh in (torus(0.018, 0.007, 12, 6), disturbed("torus, 4096", 0, 1e-4)):
        surface = make_surface(replace(mesh, has_mean_normals=True, surface="automatic"))
        assert surface.n_doubted > 0
        assert (asked.pop() == 1).all()


def test_faces_that_are_known_exactly_stay_whole_among_irregular_ones(monkeypatch):
    """As where a part of subdivided glass was decimated."""
    asked = []

    def every_third_is_known(v, size, faces, trial, parts):
        is_known = np.arange(len(faces.chosen)) % 3 == 0
        trusted = yield from found(v, size, faces, trial, parts._replace(is_exact=is_known))
        weight = trusted.weight[v.of_corner[faces.chosen]]
        asked.append((is_known & ~faces.is_swollen, trusted.is_curved, weight))
        return trusted

    found = trust.trust_steps
    monkeypatch.setattr("kiriko.core.glass.surface_fit.trust_steps", every_third_is_known)
    mesh = disturbed("torus, 4096", 0.3, 0)
    make_surface(replace(mesh, has_mean_normals=True, surface="automatic"))
    is_known, is_kept, weight = asked.pop()
    assert is_kept[is_known].all()
    assert (weight[is_known] == 1).all()
    assert (weight < 1).any()
