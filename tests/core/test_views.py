"""Displays with views: the beam of light, its view, the quilt, and what several viewers gain."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base import free_memory
from kiriko.core.base.errors import RigError
from kiriko.core.files.quilt import tile_of
from kiriko.core.image.simulation import simulate
from kiriko.core.image.source_image import splat
from kiriko.core.lab.measure.viewer_errors import conflict_in_light
from kiriko.core.light.beams import beams
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import main_landings
from kiriko.core.light.trace import trace_all
from kiriko.core.native import loading
from kiriko.core.rig.rig import Display, Picture, Rig, Viewer
from kiriko.core.rig.settings import Settings
from kiriko.core.rig.views import Views
from kiriko.core.solve.view_remarks import view_figures
from known.reference_rigs import ball_rig, rectangle
from known.work import drain, solve

CONE = np.radians(60.0), np.radians(40.0)


def camera(place, pixels=48, field=0.05, name="camera"):
    """A viewer at x, y and distance, m, from the middle of a display in the plane y = 0 that faces
    -y: its frame is the display, as that of a camera with lens shift.
    """
    x, z, away = place
    window = np.array([-field / 2 - x, field / 2 - x, -field / 2 - z, field / 2 - z]) / away
    axes = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
    return Viewer(name, "perspective", np.array([x, -away, z]), axes, tuple(window), pixels, pixels)


def bare_rig(viewers, views, image=None, depth=0.0, side=0.05, pixels=48):
    """A display with views and nothing else, seen by cameras; the picture is so far behind it."""
    x, y, z = np.eye(3)
    image = np.random.default_rng(1).random((16, 16, 4)) if image is None else image
    image[..., 3] = 1
    return Rig(
        viewers,
        (),
        (),
        (Display("display", rectangle(0 * x, x, z, side, side), pixels, pixels, views=views),),
        (Picture("picture", image.astype(np.float32), rectangle(depth * y, x, z, side, side)),),
    )


def turned(viewer, degrees, name):
    """The viewer on a circle around the origin's vertical."""
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
    axes = viewer.axes @ turn.T
    return replace(viewer, position=turn @ viewer.position, axes=axes, name=name)


def two_viewers(views, **options):
    """A ball on the bench, seen by two viewers 10 degrees apart."""
    a_rig = ball_rig(**{"pixels": 64, "display_pixels": 96} | options)
    viewers = turned(a_rig.viewer, -5, "left"), turned(a_rig.viewer, 5, "right")
    display = replace(a_rig.displays[0], views=views)
    return replace(a_rig, viewers=viewers, displays=(display,))


@pytest.mark.parametrize("distance", [np.inf, 0.5])
def test_the_beam_of_a_camera(distance):
    """Light from a place p to a camera at c, both from the display's middle, and m away, has the
    tangent (c - p) / m. Views that meet at m see the camera c as the view at (c - 0) / m, whatever
    the place.
    """
    views = Views(9, 5, CONE, distance=distance)
    place = 0.04, -0.03, 0.5
    plan = compile_plan(bare_rig((camera(place),), views), Settings())
    xy = np.random.default_rng(0).uniform(0, 48, (100, 2))
    landings = main_landings(trace_all(plan, *plan.viewer.rays(xy)), 100)
    found = beams(plan, landings)

    at = (landings.xy / 48 - 0.5) * [0.05, -0.05]
    tangent = (np.array(place[:2]) - (at if distance == np.inf else 0)) / 0.5
    wanted = tangent / np.tan(np.divide(CONE, 2)) * [4, 2] + [4, 2]
    assert np.abs(found - wanted).max() < 1e-9


@pytest.mark.parametrize("overlap", [0.0, 0.3, 1.0])
def test_weights_are_the_part_of_an_interval(overlap):
    """A view's weight is the part of the interval of width `overlap` around the beam that rounds to
    the view: found by many points.
    """
    views = Views(5, 3, CONE, overlap)
    beam = np.random.default_rng(0).uniform(-1.5, 5.5, (200, 2))
    found = np.zeros((200, 15))
    for rays, view, weight in views.shown(beam):
        np.add.at(found, (rays, view), weight)

    along = (np.arange(400) + 0.5) / 400 - 0.5
    wanted = np.ones((200, 15))
    column, row = np.arange(15) % 5, np.arange(15) // 5
    for axis, number in (0, column), (1, row):
        near = np.floor(beam[:, axis, None] + overlap * along + 0.5)
        wanted *= (near[:, :, None] == number).mean(axis=1)
    assert np.abs(found - wanted).max() < 2 / 400
    is_whole = views.are_within(beam)
    assert np.allclose(found[is_whole].sum(axis=1), 1)
    assert (found[~is_whole].sum(axis=1) < 1 - 1e-9).all()


def test_the_quilt_begins_in_the_lower_left_corner():
    """Players read view 0, the leftmost, from the lower left tile, then to the right and upward."""
    views = Views(6, cone=CONE)
    assert views.quilt_size((4, 5)) == (12, 10)
    quilt = np.zeros((10, 12), int)
    for view in range(6):
        tile_of(quilt, view, (3, 2))[:] = view
    assert quilt[::5, ::4].tolist() == [[3, 4, 5], [0, 1, 2]]
    pixels = np.arange(20)
    assert (quilt.ravel()[views.in_quilt(pixels, np.full(20, 4), (4, 5))] == 4).all()
    left, right = views.beam(np.array([[-0.1, 0], [0.1, 0]]), np.zeros((2, 2)))[:, 0]
    assert left < 2.5 < right
    assert Views(45, cone=CONE).tiling((1600, 900)) == (5, 9)  # Looking Glass's own


@pytest.mark.parametrize("is_native", [True, False])
def test_each_view_is_a_picture_behind_the_window(is_native, monkeypatch):
    """A viewer at a view's camera gets its whole picture from that view: its tile is the viewer's
    own image, and all others are black.
    """
    if not is_native:
        monkeypatch.setattr(loading, "library", lambda: None)
    views = Views(5, 1, CONE, distance=0.5)
    places = 0.5 * np.tan(CONE[0] / 2) * np.linspace(-1, 1, 5)
    cameras = [camera((x, 0, 0.5), name=f"{x:.3f}") for x in places]
    for k in 0, 3:
        found = solve(bare_rig((cameras[k],), views, depth=0.02))
        tiles = [tile_of(found.source, view, views.tiling((48, 48))) for view in range(5)]
        wanted = found.ideal()
        assert np.abs(tiles[k] - wanted).max() < 1e-5
        assert all(not tiles[other].any() for other in range(5) if other != k)
        assert np.abs(found.seen() - wanted).max() < 1e-5


def test_conflict_falls_with_the_number_of_views():
    """Two viewers 10 degrees apart share a pixel only if they share its view. With one view nothing
    changes; with enough of them each sees its own picture, and the conflict is 0.
    """
    lone = [solve(two_viewers(None))]
    conflicts = []
    for n in 1, 8, 45:
        found = solve(two_viewers(Views(n, cone=(np.radians(80.0), 0.0))))
        conflicts.append(max(drain(conflict_in_light(found))[0]))
        lone.append(found)
    assert (lone[0].source == lone[1].source).all()
    assert conflicts[0] > 2 * conflicts[1] > 0
    assert conflicts[2] < 1e-12
    assert all(one.picture_coverage > 0.97 for one in lone[3].channels)
    assert "views of the display" in lone[3].used
    assert "views of the display" in lone[0].left_out


@pytest.mark.parametrize("overlap", [0.0, 0.6])
def test_the_seen_image_by_rays(overlap):
    """Shares in views are the light of single rays: the quilt's pixels by brute force, each ray in
    the view of its beam, converge to the painted ones.
    """
    views = Views(8, cone=(np.radians(60.0), 0.0), overlap=overlap)
    image = np.zeros((8, 8, 4), np.float32)
    image[..., :3] = np.linspace(0.2, 1, 8)[:, None]
    a_rig = two_viewers(views, display_pixels=24, pixels=48, image=image)
    found = solve(a_rig)
    wanted = drain(splat(compile_plan(a_rig, Settings()), 60))
    assert wanted.shape == found.source.shape
    is_lit = found.weight > 2
    assert is_lit.sum() > 300
    difference = (found.source - wanted)[is_lit]
    assert np.sqrt((difference**2).mean()) < 0.01


def test_light_outside_the_cone_is_lost_and_reported():
    """A camera at 40 degrees sees nothing of views within 30: beyond half a view past the outermost
    there is none.
    """
    views = Views(13, 1, (np.radians(30.0), 0.0), distance=0.5)
    a_rig = bare_rig((camera((0.5 * np.tan(np.radians(40.0)), 0, 0.5)),), views)
    with pytest.raises(RigError, match="cone"):
        solve(a_rig)
    edge = 0.5 * np.tan(np.radians(15.0)) * (1 + 1 / 12)
    for off, seen in (-1e-6, 1.0), (1e-6, 0.0):
        both = replace(a_rig, viewers=(camera((0, 0, 0.5)), camera((edge + off, 0, 0.5), name="b")))
        found = solve(both)
        assert found.channels[1].picture_coverage == pytest.approx(seen, abs=1e-6)
    assert found.channels[1].misses == {"outside the cone of the views": pytest.approx(1.0)}


def test_refusals(monkeypatch):
    """Impossible numbers, a bent display and several displays are refused in one sentence."""
    good = bare_rig((camera((0, 0, 0.5)),), Views(4, cone=CONE))

    def refused(views, match, **changes):
        display = replace(good.displays[0], views=views, **changes)
        with pytest.raises(RigError, match=match):
            solve(replace(good, displays=(display,)))

    refused(Views(0), "has no views")
    refused(Views(4, cone=(np.pi, 0)), "cone of 180 degrees")
    refused(Views(4, cone=CONE, overlap=1.5), "Overlap")
    refused(Views(4, cone=CONE, distance=0.0), "Distance")
    mesh = good.displays[0].mesh
    refused(Views(4, cone=CONE), "not one flat rectangle", mesh=replace(mesh, uv=mesh.uv * 0.5))
    monkeypatch.setattr(free_memory, "available", lambda: 2e8)
    refused(Views(45, cone=CONE), "fewer than 45 views", width=1000, height=1000)
    monkeypatch.undo()
    other = replace(good.displays[0], mesh=rectangle(np.eye(3)[0], *np.eye(3)[::2], 0.1, 0.1))
    with pytest.raises(RigError, match="only display"):
        solve(replace(good, displays=(*good.displays, other)))


@pytest.mark.parametrize(("depth", "n"), [(0.0, 9), (0.1, 9), (0.1, 45)])
def test_disparity_of_a_picture_behind_the_window(depth, n):
    """A point d behind a display moves on it by d / (D + d) of the eye's way at the distance D, and
    neighbouring views are D times their tangents' distance apart.
    """
    views = Views(n, 1, CONE, distance=0.5)
    found = solve(bare_rig((camera((0.01, 0, 0.5)),), views, depth=depth))
    (figures,) = view_figures(found.channels)
    wanted = depth / (0.5 + depth) * 0.5 * views.spacing[0] / 0.05 * 48
    assert figures.disparity == pytest.approx(wanted, rel=1e-3, abs=1e-6)
    assert figures.outside == 0
    assert any("look doubled" in text for text in found.notes) == (wanted > 5)


def test_disparity_does_not_depend_on_the_turn_of_the_display():
    """Views over the same cone along another axis move a point just as far, also if the axis runs
    upward for the viewer.
    """
    across, upward = Views(5, 1, CONE, distance=0.5), Views(1, 5, CONE[::-1], distance=0.5)
    found = [
        view_figures(solve(bare_rig((camera((0, 0, 0.5)),), views, depth=0.05)).channels)
        for views in (across, upward)
    ]
    (one,), (other,) = found
    assert one.disparity == pytest.approx(other.disparity, rel=1e-6)
    assert one.disparity > 0


def test_crosstalk_is_the_light_of_shared_pixels():
    """Two viewers that need the same pixels share all of their light: half of each pixel's weight
    is the other's. As many views as separate them leave none, and overlap gives some back.
    """

    def crosstalk(views):
        return [one.crosstalk for one in view_figures(solve(two_viewers(views)).channels)]

    wide = np.radians(80.0), 0.0
    assert max(crosstalk(Views(45, cone=wide))) < 1e-12
    few, some = (max(crosstalk(Views(8, cone=wide, overlap=overlap))) for overlap in (0, 1))
    assert 0.05 < few < some < 0.5
    image = np.ones((4, 4, 4))
    same = camera((0, 0, 0.5)), camera((1e-9, 0, 0.5), name="same")
    shared = view_figures(solve(bare_rig(same, Views(3, cone=CONE), image)).channels)
    assert [one.crosstalk for one in shared] == pytest.approx([0.5, 0.5])


@pytest.mark.parametrize("overlap", [0.0, 0.6])
def test_views_leave_no_seams(overlap):
    """A white picture, seen by single rays, each in the view of its beam, is as bright by views as
    without: where two views share a pixel of the display, both show it.
    """

    def brightness(views):
        a_rig = two_viewers(views, pixels=48, display_pixels=24, image=np.ones((4, 4, 4), "f4"))
        found = solve(a_rig)
        simulated = drain(simulate(compile_plan(a_rig, Settings()), found.source, 32)).image
        whole = (found.first.view_coverage > 0.999) & (found.ideal().min(axis=2) > 0.999)
        return simulated[whole].mean()

    views = Views(45, cone=(np.radians(60.0), 0.0), overlap=overlap)
    assert brightness(views) > brightness(None) - 0.005
