"""Projectors and screens: a projector's image is that of a viewer who sees the wanted image on the
screens, and several share their light.
"""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import MeshError, RigError
from kiriko.core.light.mesh_cache import MeshCache
from kiriko.core.rig.rig import ConstantIndex, Glass, Mirror, Picture, Projector, Rig, Screen
from kiriko.core.rig.settings import Settings
from kiriko.core.rig.viewer import Viewer
from kiriko.core.solve.projection import blend_weights, project, trace_projector
from kiriko.core.solve.session import Session
from known import closed_forms
from known.reference_rigs import box, icosphere, lattice_image, rectangle
from known.work import drain, solve

SIZE = 512  # texture px
X, Y, Z = np.eye(3)


def camera(kind, name, position, aim, pixels, half):
    """A camera at a position that looks at a point; `half` is the tangent of half its view."""
    forward = closed_forms.unit(np.asarray(aim, float) - position)
    right = closed_forms.unit(np.cross(forward, [0, 0.1, 1.0]))
    axes = np.stack([right, np.cross(right, forward), forward])
    return kind(
        name,
        "perspective",
        np.asarray(position, float),
        axes,
        (-half, half, -half, half),
        pixels,
        pixels,
    )


def screen(tilt=0.4, width=0.4, name="screen", x=0.0):
    """A flat screen at the origin, tilted about the x axis, its front towards -y."""
    up = np.array([0, np.sin(tilt), np.cos(tilt)])
    return Screen(name, rectangle([x, 0, 0], X, up, width, width), SIZE, SIZE)


def bench(projectors, screens=None, glasses=None, picture=0.3, **parts):
    """A viewer before a screen."""
    image = np.dstack([lattice_image(128), np.ones((128, 128), np.float32)])
    place = rectangle([0, 0, 0], X, Z, picture, picture)
    return Rig(
        (camera(Viewer, "viewer", [0, -1.5, 0], [0, 0, 0], 200, 0.12),),
        glasses or (),
        (),
        (),
        (Picture("picture", image, place),),
        screens=screens or (screen(),),
        projectors=tuple(projectors),
        **parts,
    )


def on_screen(a_rig, projector):
    """Places (h, w, 2), texture px, of light of a projector's pixels, as its image of a screen
    that shows its own coordinates; NaN for none.
    """
    one = drain_part(trace_projector(a_rig, projector, Settings(), MeshCache()))
    size = a_rig.display
    x, y = np.meshgrid(np.arange(size.width) + 0.5, np.arange(size.height) + 0.5)
    source = np.stack([x, y, np.ones_like(x)], axis=-1).astype(np.float32)
    image = drain_part(project([one], a_rig, source))[0]
    return np.where(image[..., 2:] > 0.999, image[..., :2], np.nan)


def drain_part(steps):
    while True:
        try:
            next(steps)
        except StopIteration as done:
            return done.value


def pixel_rays(projector):
    x, y = np.meshgrid(np.arange(projector.width) + 0.5, np.arange(projector.height) + 0.5)
    return projector.rays(np.stack([x.ravel(), y.ravel()], axis=1))


def place_on(one, o, d):
    """Texture px (n, 2) of rays on a flat screen, by its plane; NaN beside it."""
    corner = one.mesh.vertices[0]
    right, up = one.mesh.vertices[1] - corner, one.mesh.vertices[3] - corner
    normal = np.cross(right, up)
    p = o + ((corner - o) @ normal / (d @ normal))[:, None] * d - corner
    uv = np.stack([p @ right / (right @ right), p @ up / (up @ up)], axis=1)
    place = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1) * SIZE
    return np.where(((uv > 0) & (uv < 1)).all(axis=1)[:, None], place, np.nan)


def worst(found, expected):
    """Largest error, px of the projector, of places away from the screen's border, which must all
    be found.
    """
    expected = expected.reshape(found.shape)
    is_inner = ((expected > 8) & (expected < SIZE - 8)).all(axis=2)
    assert is_inner.sum() > 1000
    texels = np.linalg.norm(np.diff(expected, axis=1), axis=2)  # between pixels
    return np.linalg.norm(found - expected, axis=2)[is_inner].max() / np.nanmin(texels)


@pytest.mark.parametrize("side", [-1, 1])
def test_light_on_a_tilted_plane_is_a_homography(side):
    """From its front and from its back: the projector's pixels equal the plane's closed form."""
    projector = camera(Projector, "projector", [0.3, side * 0.8, 0.2], [0, 0, 0], 128, 0.2)
    a_rig = bench([projector])
    expected = place_on(a_rig.screens[0], *pixel_rays(projector))
    assert worst(on_screen(a_rig, projector), expected) < 0.1


def test_light_passes_glass_on_its_way_to_the_screen():
    """A slab shifts the light: the places equal the closed form."""
    projector = camera(Projector, "projector", [0.1, -0.8, 0.1], [0, 0, 0], 128, 0.2)
    slab = Glass("slab", box([2, 0.03, 2], (0, -0.4, 0)), ConstantIndex(1.49))
    a_rig = bench([projector], glasses=(slab,))
    o, d = pixel_rays(projector)
    through = closed_forms.through_slab(o, d, Y, np.array([0, -0.415, 0]), 0.03, 1.49)
    assert worst(on_screen(a_rig, projector), place_on(a_rig.screens[0], *through)) < 0.1


def test_light_comes_by_a_mirror():
    """A mirror at x = 0.5: the places are those of the mirrored projector's light."""
    projector = camera(Projector, "projector", [0.2, -0.9, 0.1], [0.5, -0.5, 0.05], 128, 0.3)
    mirror = Mirror("mirror", rectangle([0.5, 0, 0], Y, Z, 3, 3))
    a_rig = bench([projector], mirrors=(mirror,))
    o, d = pixel_rays(projector)
    t = (0.5 - o[:, 0]) / d[:, 0]
    p = o + t[:, None] * d
    expected = place_on(a_rig.screens[0], p, d * [-1, 1, 1])
    assert worst(on_screen(a_rig, projector), expected) < 0.1


def two_projectors(pixels=256):
    return (
        camera(Projector, "left", [-0.5, -0.9, 0.1], [-0.06, 0, 0], pixels, 0.16),
        camera(Projector, "right", [0.5, -0.8, 0.3], [0.06, 0, 0], pixels, 0.18),
    )


def test_shares_of_two_projectors_sum_to_one_and_change_slowly():
    """On all texture px that any reaches; a share is 1 where the other has no light, and does not
    jump at its border.
    """
    a_rig = bench(two_projectors())
    found = [drain(trace_projector(a_rig, p, Settings(), MeshCache())) for p in a_rig.projectors]
    shares = np.array(blend_weights(found))
    reached = np.array([one.on_screen > 0 for one in found])
    is_lit = reached.any(axis=0)

    assert reached.all(axis=0).mean() > 0.3
    assert np.abs(shares.sum(axis=0)[is_lit] - 1).max() < 1e-9
    assert not shares.sum(axis=0)[~is_lit].any()
    only = reached[0] & ~reached[1]
    assert only.sum() > 1000
    assert (shares[0][only] == 1).all()

    # where borders of both cross, shares have no limit
    strongest = np.max([one.on_screen for one in found], axis=0)
    is_inner = strongest > 0.1**2
    assert is_inner.sum() > 0.6 * is_lit.sum()
    for axis in (0, 1):
        first, second = (is_inner.take(range(k, SIZE - 1 + k), axis=axis) for k in (0, 1))
        assert np.abs(np.diff(shares[0], axis=axis))[first & second].max() < 0.05


def test_the_viewer_sees_the_picture_as_the_sum_of_all_projected_light():
    """Forward, ray by ray: each viewer ray's place on the screen, projected by matrix into each
    projector and read there, gives the sum that shows the picture.
    """
    a_rig = bench(two_projectors(512), screens=(replace(screen(), width=1024, height=1024),))
    solution = solve(a_rig)
    assert solution.picture_coverage == pytest.approx(1, abs=1e-3)
    assert not any("projector" in note for note in solution.notes)

    viewer = a_rig.viewer
    n = 4  # rays along a pixel's side
    at = (np.arange(n * viewer.width) + 0.5) / n
    x, y = np.meshgrid(at, at)
    o, d = viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    corner = a_rig.screens[0].mesh.vertices[0]
    normal = np.cross(*(a_rig.screens[0].mesh.vertices[[1, 3]] - corner))
    points = o + ((corner - o) @ normal / (d @ normal))[:, None] * d
    is_on = np.isfinite(place_on(a_rig.screens[0], o, d)[:, 0])

    total = np.zeros((len(points), 3))
    for projector, image in zip(a_rig.projectors, solution.projected, strict=True):
        total += read(image, projector.project(points)) * is_on[:, None]
    seen = total.reshape(viewer.height, n, viewer.width, n, 3).mean(axis=(1, 3))
    apart = np.abs(seen - solution.ideal())
    assert np.sqrt((apart**2).mean()) < 0.01
    assert apart.max() < 0.2


def read(image, xy):
    """Bilinear colours (n, 3) of an image at px (n, 2); black outside."""
    padded = np.pad(image, [(1, 1), (1, 1), (0, 0)])
    at = np.clip(xy + 0.5, 0, np.array(image.shape[1::-1]) + 0.999)
    (x, y), (u, v) = at.astype(int).T, (at % 1).T[..., None]
    top = padded[y, x] * (1 - u) + padded[y, x + 1] * u
    return top * (1 - v) + padded[y + 1, x + 1] * u * v + padded[y + 1, x] * (1 - u) * v


def test_errors_name_the_part_and_the_remedy():
    """Missing parts, a projector inside glass and a screen without a UV map are refused; a
    projector that lights nothing, and a dark part of a screen, are remarked on.
    """
    left, right = two_projectors(64)
    sealed = Glass("ball", icosphere(0.1, 3, centre=left.position))
    bare = replace(screen(), mesh=replace(screen().mesh, uv=None))
    cases = [
        (replace(bench([left]), projectors=()), "has screens but no projector"),
        (replace(bench([left]), screens=(), displays=(screen(),)), "projectors but no screen"),
        (bench([left], glasses=(sealed,)), "The projector 'left' is inside the glass 'ball'"),
        (bench([left], screens=(bare,)), "The screen 'screen' has no UV map"),
    ]
    for a_rig, sentence in cases:
        with pytest.raises(RigError if "UV" not in sentence else MeshError, match=sentence):
            solve(a_rig)

    away = replace(right, axes=right.axes * [[1], [-1], [-1]])
    notes = solve(bench([replace(left, window=(-0.04, 0.04) * 2), away])).notes
    assert "The projector 'right' lights no screen: aim it at one." in notes
    assert any(note.startswith("No projector reaches") for note in notes)


def test_a_session_traces_a_projector_once():
    """A moved viewer traces no projector again, and the image is that of a new session."""
    a_rig = bench(two_projectors(64))
    session = Session()
    solve(a_rig, session)
    before = dict(session._projections)
    moved = replace(a_rig, viewers=(replace(a_rig.viewer, position=np.array([0.05, -1.5, 0])),))
    again = solve(moved, session)
    assert all(session._projections[key] is one for key, one in before.items())
    for one, other in zip(again.projected, solve(moved).projected, strict=True):
        np.testing.assert_array_equal(one, other)
