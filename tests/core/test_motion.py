"""Motions found from vertices."""

import numpy as np
import pytest
from reference_rigs import box

from kiriko.core.misalignment import turned
from kiriko.core.motion import find_motion
from kiriko.core.rig import Mesh

SQUARE = Mesh(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]]))


def moved(mesh, motion):
    return Mesh(motion.points(mesh.vertices), mesh.triangles)


@pytest.mark.parametrize("mesh", [SQUARE, box([0.05, 0.04, 0.03])], ids=["flat", "solid"])
def test_a_motion_is_found_again(mesh):
    """Of what is flat, too, of which the mirror image has the same vertices."""
    random = np.random.default_rng(0)
    for _ in range(50):
        axis = random.standard_normal(3)
        there = turned(axis / np.linalg.norm(axis), random.uniform(-180, 180), random.standard_normal(3))
        found = find_motion(mesh, moved(mesh, there))
        assert np.linalg.det(found.rotation) == pytest.approx(1)
        assert np.abs(found.rotation - there.rotation).max() < 1e-12
        assert np.abs(found.shift - there.shift).max() < 1e-11


def test_a_mirror_image_and_another_size_are_no_motion():
    solid = box([0.05, 0.04, 0.03])
    for change in (np.diag([1, 1, -1.0]), np.diag([1, 1, 1.001])):
        assert find_motion(solid, Mesh(solid.vertices @ change, solid.triangles)) is None
    assert find_motion(SQUARE, Mesh(1.001 * SQUARE.vertices, SQUARE.triangles)) is None
