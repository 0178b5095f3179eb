"""A picture's plane that only a mirror shows to the viewer."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.image.seen_image import dot_centroids
from kiriko.core.rig.rig import Mirror
from known.reference_rigs import ball_rig, lattice_image, rectangle
from known.work import solve

X, Y, Z = np.eye(3)


def direct_rig():
    """A ball rig of few pixels."""
    return ball_rig(4, pixels=128, display_pixels=256, image=lattice_image(128))


def test_a_picture_by_a_mirror_is_the_plane_at_its_mirror_image():
    """The dots are seen where they are in a rig without the mirror: the whole bench, reflected at
    45 degrees between viewer and glass, and looked at by way of a mirror there.
    """
    direct = direct_rig()
    n = (X + Y) / 2**0.5  # of the mirror through the middle between viewer and glass
    middle = -0.5 * Y

    def image(points):
        away = points - middle
        return points - 2 * (away @ n)[:, None] * n

    def turned(part):
        mesh = part.mesh
        flipped = replace(
            mesh,
            vertices=image(mesh.vertices),
            triangles=mesh.triangles[:, ::-1],
            uv=None if mesh.uv is None else mesh.uv[:, ::-1],
            corner_normals=None
            if mesh.corner_normals is None
            else (mesh.corner_normals - 2 * (mesh.corner_normals @ n)[..., None] * n)[:, ::-1],
        )
        return replace(part, mesh=flipped)

    mirror = Mirror("mirror", rectangle(middle, (X - Y), Z, 0.2, 0.3))
    by_mirror = replace(
        direct,
        glasses=tuple(map(turned, direct.glasses)),
        plates=tuple(map(turned, direct.plates)),
        displays=tuple(map(turned, direct.displays)),
        pictures=tuple(map(turned, direct.pictures)),
        mirrors=(mirror,),
    )
    direct_solution, other = solve(direct), solve(by_mirror)
    assert other.picture_coverage == pytest.approx(direct_solution.picture_coverage, abs=0.01)
    wanted = dot_centroids(direct_solution.ideal())
    for image in (other.ideal(), other.seen()):
        off = dot_centroids(image) - wanted
        assert np.abs(off).max() < 0.05  # viewer px: each of its pixels is one colour


def test_a_picture_that_no_mirror_shows_is_refused():
    """As without mirrors."""
    base = direct_rig()
    away = replace(base.pictures[0], mesh=rectangle(-3 * Y, X, Z, 0.03, 0.03))
    mirror = Mirror("mirror", rectangle(-3 * Y + X, Y, Z, 0.1, 0.1))
    with pytest.raises(RigError, match="does not see the picture"):
        solve(replace(base, pictures=(away,), mirrors=(mirror,)))
