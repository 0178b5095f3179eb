"""InFloasion as the paper's script has it, against closed forms."""

import numpy as np
import pytest

from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.optics import refract
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.solution import without_glass
from known.reference_rigs import box, cube_rig, rig
from paper.infloasion import GAP, half_before, infloasion

PIXEL = 0.05 / 512  # m, of the display


def landings(a_rig, xy):
    found = trace_all(
        compile_plan(a_rig, Settings(only_through_glass=False)), *a_rig.viewer.rays(xy)
    )
    assert found.has_arrived.all()
    return found.xy * PIXEL


def points(a_rig, n=200):
    """Viewer pixels (n, 2) over the 30 mm in the middle."""
    return a_rig.viewer.width * np.random.default_rng(0).uniform(0.2, 0.8, (n, 2))


def test_before_a_slab_infloasion_undoes_half_of_the_shift():
    """A slab that faces the viewer, cut through its middle:
    half of the bending is undone, ray by ray.
    """
    a_rig = rig(box([0.3, 0.03, 0.3]))
    xy = points(a_rig)
    wanted = landings(without_glass(a_rig), xy)
    bent = landings(a_rig, xy) - wanted
    half = landings(infloasion(a_rig), xy) - wanted
    assert np.linalg.norm(bent, axis=1).max() > 1e-4
    np.testing.assert_allclose(
        half, bent / 2, atol=GAP
    )  # the air before the display, and rays are less than 45 deg


def test_infloasion_leaves_the_bending_on_the_viewers_side_of_the_aerial_plane():
    """The turned cube: light lands where the ray bent by the
    first face alone meets the aerial plane, mirrored.
    """
    a_rig = cube_rig()
    xy = points(a_rig)
    origins, directions = a_rig.viewer.rays(xy)

    # the cube's two faces that look to the viewer; a ray enters by the one it comes to last
    a = np.radians(15.8)
    normals = np.array([[np.sin(a), -np.cos(a), 0.0], [-np.cos(a), -np.sin(a), 0.0]])
    ahead = (0.025 - origins @ normals.T) / (directions @ normals.T)
    face = ahead.argmax(axis=1)
    place = origins + ahead.max(axis=1)[:, None] * directions
    inside, is_tir, _ = refract(directions, normals[face], np.ones(len(xy)), np.full(len(xy), 1.49))

    assert not is_tir.any()
    aerial = place - place[:, 1:2] / inside[:, 1:2] * inside
    wanted = 0.025 + np.stack(
        [aerial[:, 0], -aerial[:, 2]], axis=1
    )  # as a mirror has it, rows count from the top
    np.testing.assert_allclose(landings(infloasion(a_rig), xy), wanted, atol=2 * GAP)


def test_without_refraction_infloasion_changes_nothing():
    a_rig = without_glass(cube_rig())
    xy = points(a_rig)
    np.testing.assert_allclose(landings(infloasion(a_rig), xy), landings(a_rig, xy), atol=1e-12)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_cut_solid_is_closed_and_has_its_part_of_the_volume(share):
    """The divergence theorem over a box cut across.

    Outward faces count positive, so the volume tells both.
    """
    a = np.radians(15.8)
    b = 0.05
    c = 0.03
    normal = np.array([np.cos(a), np.sin(a), 0.0])
    solid = box([b, c, b], degrees_about_z=15.8, centre=(1.0, 2.0, 3.0))
    half = half_before(solid, np.array([1.0, 2.0, 3.0]) + (0.5 - share) * b * normal, normal)
    corners = half.corners
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(share * b * c * b, rel=1e-9)
    edges = np.sort(half.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
