"""Meshes whose faces are uneven: convex hulls of random places on a shape."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.glass import surface_fit
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.native import loading
from known.closed_forms import unit
from known.judged_meshes import BALLS, CHOICES, errors, hull, hull_of

SEEDS = (0, 1)


def found_normals(monkeypatch, shape, n, seed):
    """The means at the places on a shape, what is found in their stead, and the shape's own."""
    asked = []

    def looked_at(v, wanted, exact):
        normal = yield from found(v, wanted, exact)
        asked.append((v.normal, normal, unit(v.at / np.square(BALLS[shape]))))
        return normal

    found = surface_fit.normal_steps
    monkeypatch.setattr(surface_fit, "normal_steps", looked_at)
    make_surface(replace(hull(shape, n, 0.0, seed), surface="smooth"))
    return asked.pop()


def rms(away):
    return np.sqrt((away**2).sum(axis=1).mean())


def test_a_hull_is_closed_and_bulges_all_over():
    """No place is in front of any face, all are corners, and faces and corners obey Euler."""
    places = unit(np.random.default_rng(1).normal(size=(60, 3)))
    triangles = hull_of(places)
    at = places[triangles]
    around = np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])
    in_front = around @ places.T - (around * at[:, 0]).sum(axis=1, keepdims=True)
    assert in_front.max() < 1e-12
    assert set(triangles.ravel()) == set(range(60))
    assert len(triangles) == 2 * 60 - 4


@pytest.mark.parametrize("shape", BALLS)
@pytest.mark.parametrize("seed", SEEDS)
def test_normals_are_found_however_uneven_the_faces_are(monkeypatch, shape, seed):
    """A few of them would make the others grow without end. Those of stiffer fields do not, and
    the error is a fifth of that of the means, and less.
    """
    mean, normal, own = found_normals(monkeypatch, shape, 800, seed)
    assert rms(normal - own) < 0.2 * rms(mean - own)


def test_steep_places_are_not_looked_at_again(monkeypatch):
    """Where normals turn by more than stiffer fields tell of, means stay as they were."""
    knobs = surface_fit.NORMALS
    mean, normal, _ = found_normals(monkeypatch, "lentil", 120, 0)
    monkeypatch.setattr(surface_fit, "NORMALS", replace(knobs, gentle=0.0))
    _, once, _ = found_normals(monkeypatch, "lentil", 120, 0)
    is_again = (normal != once).any(axis=1)
    assert is_again.any()
    assert (once == mean)[is_again].all()


def test_the_kernel_finds_the_same_normals(monkeypatch):
    """As numpy does, where some are looked for twice: to rounding that sweeps let grow."""
    _, normal, _ = found_normals(monkeypatch, "ellipsoid", 250, 0)
    with loading.off():
        _, other, _ = found_normals(monkeypatch, "ellipsoid", 250, 0)
    assert np.abs(normal - other).max() < 1e-9


@pytest.mark.parametrize("shape", BALLS)
@pytest.mark.parametrize(("n", "noise"), [(800, 0.0), (800, 1e-4), (2000, 0.0)])
def test_automatic_is_nearer_than_as_drawn_and_as_near_as_smooth(shape, n, noise):
    """A third nearer to the shape that was meant than as drawn; and where all vertices lie on it
    not farther off than Smooth by more than a tenth of the tolerance, 0.1 display px.
    """
    drawn, smooth, automatic = (errors(shape, hull(shape, n, noise), choice) for choice in CHOICES)
    assert automatic.rest < 2 / 3 * drawn.rest
    assert noise or automatic.rest < smooth.rest + 0.1
