"""Motions found from vertices."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.bench.offset import turned
from kiriko.core.glass.motion import find_motion, size_of
from kiriko.core.rig.rig import Mesh
from known.reference_rigs import box

SQUARE = Mesh(
    np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]])
)


def moved(mesh, motion):
    return Mesh(motion.points(mesh.vertices), mesh.triangles)


@pytest.mark.parametrize("mesh", [SQUARE, box([0.05, 0.04, 0.03])], ids=["flat", "solid"])
def test_a_motion_is_found_again(mesh):
    """A flat mesh, too, of which the mirror image has the same vertices."""
    random = np.random.default_rng(0)
    for _ in range(50):
        axis = random.standard_normal(3)
        there = turned(
            axis / np.linalg.norm(axis), random.uniform(-180, 180), random.standard_normal(3)
        )
        found = find_motion(mesh, moved(mesh, there))
        assert np.linalg.det(found.rotation) == pytest.approx(1)
        assert np.abs(found.rotation - there.rotation).max() < 1e-12
        assert np.abs(found.shift - there.shift).max() < 1e-11


def test_a_mirror_image_and_another_size_are_no_motion():
    solid = box([0.05, 0.04, 0.03])
    for change in (np.diag([1, 1, -1.0]), np.diag([1, 1, 1.001])):
        assert find_motion(solid, Mesh(solid.vertices @ change, solid.triangles)) is None
    assert find_motion(SQUARE, Mesh(1.001 * SQUARE.vertices, SQUARE.triangles)) is None


@pytest.mark.parametrize(
    "other",
    ["triangles", "is_smooth", "is_smooth, given", "surface", "has_mean_normals", "polygon"],
)
def test_vertices_in_place_are_not_all(other):
    """Other triangles between the same vertices, other
    shading, another surface that is meant, other polygons: no motion.
    """
    solid = box([0.05, 0.04, 0.03])
    changes = {
        "triangles": {"triangles": solid.triangles[::-1]},
        "is_smooth": {"is_smooth": np.ones(len(solid.triangles), bool)},
        "surface": {"surface": "facets"},
        "has_mean_normals": {"has_mean_normals": True},
        "polygon": {"polygon": np.arange(len(solid.triangles)) // 2},
    }
    before = (
        replace(solid, is_smooth=np.zeros(len(solid.triangles), bool)) if "," in other else solid
    )
    after = replace(solid, **changes[other.partition(",")[0]])

    assert find_motion(before, before) is not None
    assert find_motion(before, after) is None
    assert find_motion(after, before) is None


def test_motions_keep_the_size():
    """Within the loss that goes with it, also of vertices that were rounded to float32 far away."""
    random = np.random.default_rng(1)
    for _ in range(200):
        points = random.standard_normal((30, 3)) * 10.0 ** random.uniform(-3, 1)
        axis = random.standard_normal(3)
        shift = random.standard_normal(3) * 10.0 ** random.uniform(-3, 3)
        there = turned(axis / np.linalg.norm(axis), random.uniform(-180, 180), shift)
        sizes = []
        for place in (points, there.points(points)):
            rounded = place.astype(np.float32).astype(float)
            rounding = float(np.abs(rounded - place).max())
            sizes.append(size_of(Mesh(rounded, SQUARE.triangles, rounding=rounding)))
        (before, loss), (after, other_loss) = sizes
        assert abs(before - after) <= loss + other_loss
