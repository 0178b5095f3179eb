"""The judge of `dev.py meant`: the surface that Blender's Subdivision goes towards."""

import numpy as np
import pytest


@pytest.mark.parametrize("name", ["wine glass", "bottle"])
def test_blender_puts_the_vertices_of_a_subdivided_glass_on_the_limit(kiriko, name):
    """To the rounding of float32."""
    from mathutils.kdtree import KDTree

    from bench.meant import as_drawn, as_meant

    drawn = as_drawn(name, 1)
    meant = as_meant(name, 1)
    tree = KDTree(len(meant.vertices))
    for k, place in enumerate(meant.vertices):
        tree.insert(place, k)
    tree.balance()
    off = max(tree.find(place)[2] for place in drawn.vertices)
    assert len(drawn.vertices) == len(meant.vertices)
    assert off < 1e-6 * np.abs(drawn.vertices).max()


def test_the_normals_of_the_vase_are_those_of_its_curve():
    """Means over finer and finer faces come near them, twice as fine by four times."""
    from bench.meant import vase

    off = []
    for n in (1, 2):
        own, means = (vase(32 * n + 1, 64 * n, is_own) for is_own in (True, False))
        cosine = (own.corner_normals * means.corner_normals).sum(axis=2).clip(-1, 1)
        off.append(np.median(np.arccos(cosine)))
    assert off[1] == pytest.approx(off[0] / 4, rel=0.1)
