"""Light at normals that contradict their face, beside the angles that decide it in a plane."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.trace import tracing
from kiriko.core.rig.rig import ConstantIndex, Glass
from kiriko.core.rig.settings import Settings
from kiriko.core.solve import accuracy
from kiriko.core.solve.accuracy import find_contradicted
from known.reference_rigs import box, icosphere, rig


def slab(tilt, ior=1.49):
    """A wide slab whose front has normals tilted towards +x by an angle, radians."""
    mesh = box([4.0, 0.02, 4.0])
    own = np.cross(*(mesh.corners[:, k] - mesh.corners[:, 0] for k in (1, 2)))
    own = np.repeat(own[:, None] / np.linalg.norm(own, axis=1)[:, None, None], 3, axis=1)
    front = own[:, 0, 1] < -0.9
    own[front] = [np.sin(tilt), -np.cos(tilt), 0.0]
    mesh = replace(mesh, corner_normals=own, is_smooth=front, surface="facets")
    return rig((Glass("front", mesh, ConstantIndex(ior)),))


def fan(angles):
    """Rays (n, 3) in the plane z = 0 that meet the front in its middle,
    at angles from its normal, positive where they come from +x.
    """
    towards = np.stack([np.sin(angles), -np.cos(angles), 0 * angles], axis=1)
    middle = np.array([0.0, -0.01, 0.0])
    return middle + 0.5 * towards, -towards


def found_in(a_rig, origins, directions):
    """At the first surface that rays meet: by the second step it is known how light went on."""
    plan = compile_plan(a_rig, Settings())
    steps = []
    run_steps(tracing(plan, origins, directions, steps=steps))
    return find_contradicted(plan, origins, steps[:2])


@pytest.mark.parametrize("tilt", [0.2, 0.5, 0.9])
@pytest.mark.usefixtures("has_kernel")
def test_angles_decide_it(tilt):
    """Light at an angle a from the face's normal is mirrored at a normal tilted by t to 2 t - a
    from it, which has to be less than a right angle but for the cosine that Cycles leaves.
    """
    angles = np.linspace(-1.55, 1.55, 2001)
    found = found_in(slab(tilt), *fan(angles)) == 0

    least = np.minimum(0.01, 0.9 * np.cos(angles))
    expected = (np.cos(2 * tilt - angles) < least) | (np.cos(tilt - angles) <= 0)
    assert 0 < expected.sum() < len(angles)
    assert (found == expected).all()


def test_light_that_is_not_bent_does_not_count():
    """Between equal media a normal does nothing."""
    angles = np.linspace(-1.5, 1.5, 101)
    assert (found_in(slab(0.9, ior=1.0), *fan(angles)) == -1).all()
    assert (found_in(slab(0.9, ior=1.0 + 1e-3), *fan(angles)) == 0).any()


def test_the_share_is_told_of_each_glass():
    """Of two balls that are seen side by side the coarse one
    has such light, the one with its own normals none.
    """
    coarse = icosphere(0.012, 0, centre=(-0.013, 0, 0))
    smooth = icosphere(0.012, 2, smooth=False, centre=(0.013, 0, 0))
    glasses = (
        Glass("coarse", replace(coarse, surface="facets"), ConstantIndex(1.49)),
        Glass("flat", smooth, ConstantIndex(1.49)),
    )
    share, none = run_steps(accuracy.contradicted(compile_plan(rig(glasses), Settings())))
    assert 0.01 < share < 0.5
    assert none == 0.0
