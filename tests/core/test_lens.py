"""Thin lenses and retroreflectors against closed forms."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.native import loading
from kiriko.core.rig.rig import ConstantIndex, Glass, Lens, Retroreflector
from kiriko.core.rig.settings import Settings
from known.lathes import lathe
from known.reference_rigs import ball_rig, rectangle

X, Y, Z = np.eye(3)
FOCAL = 0.1


@pytest.fixture(params=["kernel", "numpy"])
def tracer(request):
    with nullcontext() if request.param == "kernel" else loading.off():
        yield request.param


def behind(lenses, distance, glasses=()):
    """A display at a distance, m, behind lenses at the origin, 0.1 m before a viewer's pinhole."""
    base = ball_rig(2, pixels=64)
    eye = replace(base.viewer, position=-0.2 * Y, window=(-0.1, 0.1, -0.1, 0.1))
    display = replace(
        base.display, mesh=rectangle(distance * Y, X, Z, 0.2, 0.2), width=2000, height=2000
    )
    return replace(
        base, viewers=(eye,), glasses=glasses, plates=(), displays=(display,), lenses=lenses
    )


def test_a_lens_images_the_viewer_at_its_conjugate(tracer):
    """1 / f = 1 / a + 1 / b: all rays of a pinhole 2 f before the lens meet 2 f behind it, on a
    display at twice that mirrored at the axis, also where its outline is not about the axis.
    """
    lens = Lens("lens", rectangle(0 * Y, X, Z, 0.05, 0.05), FOCAL)
    a_rig = behind((lens,), 0.4)
    o, d = a_rig.viewer.rays(np.random.default_rng(0).uniform(8, 56, (300, 2)))
    found = trace_all(compile_plan(a_rig, Settings()), o, d)
    assert found.has_arrived.all()
    height = d / d[:, 1:2] * 0.2  # at the lens
    np.testing.assert_allclose(
        (found.positions - 0.4 * Y)[:, [0, 2]], -height[:, [0, 2]], atol=1e-12
    )
    at_once = trace_all(compile_plan(behind((lens,), 0.2), Settings()), o, d)
    np.testing.assert_allclose(at_once.positions, np.tile(0.2 * Y, (300, 1)), atol=1e-12)


def biconvex(radius, aperture):
    """A lens of two spherical faces that meet at a sharp rim, and its thickness."""
    sine = np.linspace(0, aperture / radius, 17)
    y = radius * (np.sqrt(1 - sine**2) - np.sqrt(1 - sine[-1] ** 2))
    front = np.stack([radius * sine, -y], axis=1)
    return lathe([front, front[::-1] * [1, -1]], 96), 2 * y[0]


def test_a_biconvex_glass_tends_to_the_lens_as_its_aperture_shrinks():
    """Paraxially 1 / f = (n - 1) (2 / R - (n - 1) t / (n R^2)): landings differ from the thin lens
    by the third power of the aperture.
    """
    n, radius = 1.5, 0.1
    offs = []
    for aperture in (0.02, 0.01, 0.005):
        mesh, thickness = biconvex(radius, aperture)
        power = (n - 1) * (2 / radius - (n - 1) * thickness / (n * radius**2))
        thin = Lens("lens", rectangle(0 * Y, X, Z, 0.2, 0.2), 1 / power)
        solid = Glass("lens", mesh, ConstantIndex(n))
        pixel = 32 + 64 / 2 * aperture / 0.2 / 0.1 * 0.7
        at = np.array([[pixel, 32], [32, pixel], [32 - (pixel - 32), 32]])
        found = [
            trace_all(
                compile_plan(a_rig, Settings(only_through_glass=False)), *a_rig.viewer.rays(at)
            )
            for a_rig in (behind((), 0.2, (solid,)), behind((thin,), 0.2))
        ]
        assert all(one.has_arrived.all() for one in found)
        offs.append(np.abs(found[0].positions - found[1].positions).max())
    assert offs[0] > 4 * offs[1] > 12 * offs[2]
    assert offs[2] < 2e-5, offs


def test_a_retroreflector_returns_light_along_its_path(tracer):
    """A ray meets it, and on its way back what it came through: a lens twice is no lens."""
    base = behind((Lens("lens", rectangle(0.02 * Y, X, Z, 0.1, 0.1), FOCAL),), 0.2)
    back = Retroreflector("retro", rectangle(0.1 * Y + 0.01 * Z, X, Y + Z, 0.2, 0.2))
    away = replace(base.display, mesh=rectangle(-0.3 * Y, -X, Z, 0.4, 0.4))
    a_rig = replace(base, displays=(away,), retroreflectors=(back,))
    o, d = a_rig.viewer.rays(np.random.default_rng(0).uniform(16, 48, (100, 2)))
    found = trace_all(compile_plan(a_rig, Settings()), o, d)
    assert found.has_arrived.all()
    np.testing.assert_allclose(found.directions, -d, atol=1e-12)
    np.testing.assert_allclose(found.positions, o - d * (0.1 / d[:, 1:2]), atol=1e-12)


def test_simulated_corner_cubes_shift_and_spread_light():
    """A ray leaves at the point opposite about its cube's middle, and the directions have the given
    standard deviation along both axes; light that is solved for is ideal.
    """
    spread, pitch = np.radians(0.5), 1e-3
    base = behind((), 0.2)
    back = Retroreflector("retro", rectangle(0.1 * Y, X, Z, 0.2, 0.2), spread, pitch)
    a_rig = replace(base, retroreflectors=(back,))
    plan = compile_plan(a_rig, Settings())
    o, d = a_rig.viewer.rays(np.random.default_rng(0).uniform(16, 48, (20_000, 2)))
    at = (o + d * (0.3 / d[:, 1:2]))[:, [0, 2]]
    ideal = trace_all(plan, o, d)
    np.testing.assert_allclose(ideal.positions[:, [0, 2]], at, atol=1e-12)
    found = trace_all(plan, o, d, light="folded")
    cells = found.positions[:, [0, 2]] / pitch
    np.testing.assert_array_equal(np.floor(cells), np.floor(at / pitch))
    np.testing.assert_allclose((cells + at / pitch) / 2 % 1, 0.5, atol=1e-9)
    off = found.directions + d
    across = np.cross(d, X)
    across /= np.linalg.norm(across, axis=1)[:, None]
    for axis in (across, np.cross(d, across)):
        assert (off * axis).sum(axis=1).std() == pytest.approx(spread, rel=0.03)
    again = trace_all(plan, o[5000:], d[5000:], light="folded")
    np.testing.assert_array_equal(again.directions, found.directions[5000:])


def test_impossible_lenses_are_one_sentence():
    """Without a focal length, and bent; a retroreflector that spreads light over the room."""
    wide = Retroreflector("retro", rectangle(0 * Y, X, Z, 0.1, 0.1), 1.0)
    with pytest.raises(RigError, match=r"Spread 57.* from 0 to 10"):
        replace(behind((), 0.2), retroreflectors=(wide,)).check()
    flat = rectangle(0 * Y, X, Z, 0.1, 0.1)
    with pytest.raises(RigError, match="focal length of 0: set another"):
        behind((Lens("lens", flat, 0.0),), 0.2).check()
    bent = replace(flat, vertices=flat.vertices + np.diag([0.01, 0, 0, 0])[:, [3, 0, 3]])
    with pytest.raises(RigError, match="'lens' is not a flat plane: replace it"):
        compile_plan(behind((Lens("lens", bent, FOCAL),), 0.2), Settings())
