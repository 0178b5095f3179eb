"""Warp maps: display pixels to places in the picture."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.lab.warp.map_files import FORMATS, MapOptions, maps_of, suffixes
from kiriko.core.lab.warp.stmap import mesh_grid, view_stmap, warp_map
from kiriko.core.lab.warp.view_from_display import middles, nodes, view_from_display
from kiriko.core.light.trace import trace
from kiriko.core.map.points import in_triangles
from known.closed_forms import landing, through_ball, through_slab
from known.reference_rigs import ball_rig, bottle, box, glass_rig, rig, wavy_slab
from known.warp_readers import ramp
from known.work import drain, solve

SMALL = {"pixels": 64, "display_pixels": 64}
STEP = 0.05 / 64  # m, a display pixel


def places_of(solution):
    channel = solution.first
    grid = middles(channel.view_map.display_size)
    return grid, drain(view_from_display(channel.plan, channel.view_map, grid))


def test_without_refraction_the_map_is_that_of_two_planes():
    """The mirror image of the display lies in the picture's plane: the map is affine."""
    solution = solve(ball_rig(3, ior=1.0, **SMALL))
    found = drain(warp_map(solution.first))
    x = (np.arange(64) + 0.5) * STEP - 0.025
    s, t = np.meshgrid(x / 0.03 + 0.5, -x / 0.03 + 0.5)
    inside = (np.hypot(*np.meshgrid(x, x)) < 0.024) & (solution.display_coverage > 1 - 1e-9)
    assert inside.sum() > 1000
    assert np.abs(found.st[inside] - np.stack([s, t], axis=2)[inside]).max() < 1e-9
    assert (found.multiplicity[inside] == 1).all()
    is_on = (np.abs(s - 0.5) < 0.5) & (np.abs(t - 0.5) < 0.5)
    assert (found.coverage[inside] > 0).tolist() == is_on[inside].tolist()

    # a picture of 512 px over 30 mm: so many of its pixels to one of the display, y down in both
    scale = STEP / 0.03 * 512
    assert np.abs(found.jacobian[inside] - scale * np.eye(2)).max() < 1e-6


def test_slab_shows_each_middle_to_rounding():
    """The light of each place, by Snell's law in closed form, lands on the pixel's middle."""
    slab = rig(box([0.06, 0.02, 0.06]), **SMALL)
    grid, found = places_of(solve(slab))
    lit = np.flatnonzero(found.multiplicity)
    assert len(lit) > 2000

    o, d = slab.viewer.rays(found.view[lit])
    out = through_slab(o, d, np.array([0, -1.0, 0]), 0.01, 0.02, 1.49)
    assert np.abs(landing(slab, *out) - grid.at(lit)).max() < 1e-9
    assert found.off[lit].max() < 1e-6


def test_ball_shows_each_middle():
    """Light that is traced through each place lands on the middle, far within the tolerance of
    the view map, and to the error of the mesh the ball's closed form says so, too.
    """
    ball = ball_rig(4, **SMALL)
    solution = solve(ball, tolerance=0.1)
    grid, found = places_of(solution)
    lit = np.flatnonzero(found.multiplicity)
    assert len(lit) > 0.8 * 64**2

    # at the plate's edge light ends, and the map knows where by its tolerance
    rays = ball.viewer.rays(found.view[lit])
    off = np.abs(trace(solution.first.plan, *rays).xy - grid.at(lit)).max(axis=1)
    assert np.quantile(off, 0.98) < 1e-4
    assert off.max() < 0.1
    assert np.abs(off - found.off[lit]).max() < 0.05
    o, d = through_ball(*rays, 0.025, 1.49)
    assert np.quantile(np.abs(landing(ball, o, d) - grid.at(lit)).max(axis=1), 0.98) < 1e-3


def test_every_pixel_that_is_seen_has_a_place_and_no_other():
    """A pixel at a border shows the middle of the part that is seen; one that nobody sees shows
    nothing.
    """
    solution = solve(ball_rig(3, **SMALL))
    _, found = places_of(solution)
    coverage = solution.display_coverage.ravel()
    assert (np.isfinite(found.view[:, 0]) == (coverage > 0)).all()
    assert (found.multiplicity[coverage > 1 - 1e-6] > 0).all()
    at_border = (coverage > 0) & (found.multiplicity == 0)
    assert 10 < at_border.sum() < 500
    assert found.off[at_border].max() < 1.0


def counted(solution, along):
    """At how many places each pixel's middle (h, w) is seen, by triangles between dense rays."""
    channel = solution.first
    w, h = channel.view_map.view_size
    # beside the symmetries of the rig, on which middles would lie on edges
    x, y = np.meshgrid(
        (np.arange(w * along) + 0.137) / along, (np.arange(h * along) + 0.071) / along
    )
    landings = trace(channel.plan, *channel.viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1)))
    xy = landings.xy.reshape(*x.shape, 2)
    branch = landings.branch.reshape(x.shape)
    width, height = channel.view_map.display_size
    found = np.zeros((height, width), int)

    a, b, c, d = np.s_[:-1, :-1], np.s_[:-1, 1:], np.s_[1:, 1:], np.s_[1:, :-1]
    for corners in ((a, b, c), (a, c, d)):
        triangles = np.stack([xy[corner] for corner in corners], axis=2).reshape(-1, 3, 2)
        same = (branch[a] != 0) & np.logical_and.reduce([branch[k] == branch[a] for k in corners])
        triangles = triangles[same.ravel()]
        first = np.ceil(triangles.min(axis=1) - 0.5)
        for step in np.ndindex(5, 5):  # none of them spans more
            pixel = first + step
            inside, _ = in_triangles(triangles, triangles, pixel + 0.5)
            column, row = pixel[inside].astype(int).T
            on = (column >= 0) & (row >= 0) & (column < width) & (row < height)
            np.add.at(found, (row[on], column[on]), 1)
    return found


@pytest.fixture(scope="module")
def folded():
    """A hollow bottle, whose display is seen up to four times; its picture tells its places."""
    bench = glass_rig(bottle(), pixels=24, display_pixels=32, image=ramp(64, 64))
    return solve(bench, ghosts="strongest")


def test_folds_are_counted_as_dense_rays_count_them():
    """Multiplicity is the number of sheets over a pixel's middle, where the pixel is seen whole.
    Right at a fold the map counts one that dense rays do not.
    """
    solution = solve(rig(wavy_slab(8, amplitude=0.002), pixels=32, display_pixels=48))
    found = drain(warp_map(solution.first)).multiplicity
    expected = counted(solution, 8)
    whole = solution.display_coverage > 1 - 1e-6
    assert (found == 3).sum() >= 15
    assert (found == expected)[whole].mean() > 0.98
    assert (found == expected)[found == 3].mean() > 0.5


@pytest.mark.parametrize("is_plane", [True, False])
def test_chosen_place_is_that_of_the_source_image(folded, is_plane):
    """Of several sheets it is the one on the strongest path: the picture's own places, painted
    by all shares of that path, are those of the map, for a picture on a plane and one in the
    viewer's pixels.
    """
    solution = folded
    if not is_plane:
        picture = replace(folded.rig.picture, mesh=None)
        solution = solve(replace(folded.rig, pictures=(picture,)), ghosts="strongest")
    found = drain(warp_map(solution.first))
    places = np.stack([found.st[..., 0] * 64, (1 - found.st[..., 1]) * 64], axis=2)
    # quads of two sizes leave up to 1e-4 of a pixel between them
    sure = (solution.display_coverage > 1 - 1e-4) & (found.multiplicity > 0)
    sure &= ((places > 3) & (places < 61)).all(axis=2)
    off = np.abs(solution.source[..., :2] - places)[sure].max(axis=1)
    assert sure.sum() > 90
    assert np.percentile(off, 99) < 1
    assert np.median(off) < 0.1


def test_view_map_is_each_pixels_own_landing():
    """(s, t) on the display of the middle of a viewer's pixel, nothing where light ends elsewhere;
    the derivative is that of rays beside it.
    """
    solution = solve(ball_rig(3, **SMALL))
    channel = solution.first
    found = drain(view_stmap(channel, drain(warp_map(channel))))
    view = middles((64, 64)).at(np.arange(64 * 64))
    traced = trace(channel.plan, *channel.viewer.rays(view))
    there = found.is_there.ravel()
    assert (there == (traced.has_arrived & (channel.view_coverage.ravel() > 0))).all()
    st = traced.xy / 64 * [1, -1] + [0, 1]
    assert np.abs(found.st.reshape(-1, 2)[there] - st[there]).max() < 1e-12

    ahead = trace(channel.plan, *channel.viewer.rays(view + np.array([0.01, 0])))
    back = trace(channel.plan, *channel.viewer.rays(view - np.array([0.01, 0])))
    by_x = (ahead.xy - back.xy) / 0.02
    known = there & (ahead.branch == traced.branch) & (back.branch == traced.branch)
    own = found.jacobian.reshape(-1, 2, 2)[known][:, :, 0]
    assert np.percentile(np.abs(own - by_x[known]), 99) < 1e-2


def test_overscan_is_room_around_the_picture():
    """The middle stays, the picture's corner is inset by the overscan; more of the display is on
    the larger image.
    """
    channel = solve(ball_rig(3, **SMALL)).first
    plain = drain(warp_map(channel))
    wide = drain(warp_map(channel, overscan=10.0))
    both = plain.is_there
    assert np.abs(wide.st[both] - (plain.st[both] + 0.1) / 1.2).max() < 1e-12
    assert wide.is_there.sum() > 1.2 * both.sum()
    assert (wide.is_there | ~both).all()


def with_uv(bench, low, high):
    """A rig whose picture's plane has the part of the image between two places of its UV."""
    mesh = bench.picture.mesh
    uv = low + mesh.uv * (np.array(high) - low)
    return replace(bench, pictures=(replace(bench.picture, mesh=replace(mesh, uv=uv)),))


@pytest.mark.parametrize(
    ("low", "high"), [((0.25, 0.25), (0.5, 0.5)), ((-0.5, -0.5), (1.5, 1.5)), ((0.2, 0), (1, 0.4))]
)
def test_pixels_on_the_picture_are_those_that_the_source_image_lights(low, high):
    """The plane is the border, not its image: a part of that, or more than it, whose outermost
    pixels go on, as in the source image.
    """
    image = np.full((64, 64, 3), 0.25, np.float32)
    image[[0, -1]] = image[:, [0, -1]] = 1.0
    solution = solve(with_uv(ball_rig(3, image=image, **SMALL), low, high), ghosts="strongest")
    found = drain(warp_map(solution.first))
    lit = solution.source[..., 0] > 0
    whole = solution.display_coverage > 1 - 1e-9
    away = whole & (found.multiplicity == 1)  # beside the borders, where a pixel has both
    same = np.lib.stride_tricks.sliding_window_view(np.pad(lit, 1), (3, 3)).reshape(64, 64, 9)
    away &= same.all(axis=2) | ~same.any(axis=2)
    assert away.sum() > 1000
    assert (away & ~lit).sum() > 300
    assert (found.is_there == lit)[away].all()

    # a reader that shows nothing beyond the image shows the same colours as the source image
    st = found.st[found.is_there]
    assert ((st >= 0) & (st <= 1)).all()
    if low[0] < 0:
        colour = solution.source[..., 0]
        assert (found.st[away & lit & (colour == 1)] * 64 % 63 == 0.5).any(axis=1).all()


def test_pixels_at_the_edge_of_the_viewers_image_show_the_part_that_is_seen():
    """Their middles are beyond the viewer's image, where a picture in its own pixels has nothing:
    the place is in the middle of the part within.
    """
    bench = rig(box([0.06, 0.02, 0.06]), **SMALL)
    viewer = replace(bench.viewer, window=tuple(0.45 * edge for edge in bench.viewer.window))
    bench = replace(bench, viewers=(viewer,), pictures=(replace(bench.picture, mesh=None),))
    channel = solve(bench).first
    found = drain(warp_map(channel))
    coverage = channel.coverage.of_display
    in_part = (coverage > 0) & (coverage < 0.49)
    assert in_part.sum() > 100
    assert (found.coverage == coverage).all()
    assert (found.multiplicity[in_part] == 0).all()

    # beside the corners the part is as wide as it covers, and its light lands in its middle
    st = found.st[in_part]
    assert ((st > 0) & (st < 1)).all()
    rays = viewer.rays(np.stack([st[:, 0], 1 - st[:, 1]], axis=1) * 64)
    row, column = np.nonzero(in_part)
    off = np.abs(trace(channel.plan, *rays).xy - np.stack([column, row], axis=1) - 0.5)
    at_side = coverage[in_part] > 0.2
    assert np.abs(off.max(axis=1) - (1 - coverage[in_part]) / 2)[at_side].max() < 0.01


def test_parts_of_pixels_have_their_own_places():
    """A map that is twice as large has the middles of quarters; the mean of four is the middle."""
    channel = solve(ball_rig(3, **SMALL)).first
    one = drain(warp_map(channel))
    two = drain(warp_map(channel, times=2))
    assert two.size == (128, 128)
    mean = two.st.reshape(64, 2, 64, 2, 2).mean(axis=(1, 3))
    inner = (one.multiplicity > 0) & (channel.coverage.of_display > 1 - 1e-9)
    assert np.median(np.abs(mean - one.st)[inner]) * 512 < 0.05


def test_nodes_are_at_the_displays_edges():
    grid = nodes((30, 20), 8.0)
    assert (grid.columns, grid.rows) == (5, 3)
    assert grid.at(np.array([0, len(grid) - 1])).tolist() == [[0, 0], [30, 20]]
    assert grid.pixels((30, 20)).max() == 30 * 20 - 1


@pytest.mark.parametrize("step", [1.0, 1.4, 5.5, 8.0, 20.0, 1e4, 1e12])
def test_meshes_have_no_more_nodes_than_the_display_has_pixels_about(step):
    """The cells into which a large one is cut are about a pixel, by its own size: a step beyond the
    display's size is that.
    """
    grid = mesh_grid((64, 40), step)
    assert np.prod(grid.step) == pytest.approx(1, rel=1.0)
    assert len(grid) < 2.1 * 65 * 41
    cells = nodes((64, 40), step)
    assert (grid.columns - 1) % (cells.columns - 1) == (grid.rows - 1) % (cells.rows - 1) == 0
    assert (cells.columns, cells.rows) == (2, 2) if step > 64 else True


def test_picture_that_ffmpeg_has_no_room_for_is_one_sentence():
    """Numbers of 16 bits tell its columns and rows, and 65535 is nothing."""
    place = ball_rig(3, **SMALL).picture_place
    wide = replace(place, width=16384)
    for times, width in ((4, 16383), (2, 32767), (1, 65535)):
        options = MapOptions(("EXR", "FFMPEG"), times=times)
        options.check_for(replace(place, width=width))
        with pytest.raises(RigError, match=rf"has {width + 1} x .* allow {width}: set .*\.$"):
            options.check_for(replace(place, width=width + 1))
    MapOptions(("EXR", "NPZ"), times=4).check_for(wide)
    with pytest.raises(RigError, match=r"x 65536 pixels"):
        MapOptions(("FFMPEG",), times=1).check_for(replace(place, height=65536))


def test_channels_never_share_a_file():
    """One channel alone has plain names; several are told apart by what they differ in, also on
    disks that do not know capitals.
    """
    red, blue = 650e-9, 450e-9
    assert suffixes([("a", red)]) == [""]
    assert suffixes([("Left Eye", red), ("Right/Eye", red)]) == ["_Left_Eye", "_Right_Eye"]
    assert suffixes([("a", red), ("a", blue)]) == ["_650nm", "_450nm"]
    assert suffixes([("a", red), ("A", red), ("a", red)]) == ["_a", "_A_2", "_a_3"]


@pytest.mark.parametrize(
    "options",
    [{"formats": ()}, {"overscan": -1.0}, {"overscan": 101.0}, {"times": 3}, {"mesh_step": 0.5}],
)
def test_options_that_cannot_be_are_one_sentence(options):
    with pytest.raises(RigError, match=r"[Ss]et .*\.$|Select one or more\.$"):
        MapOptions(**options).check()


def test_several_viewers_have_a_map_each():
    """Each channel's map is the map of its viewer alone."""
    small = ball_rig(3, **SMALL)
    aside = small.viewer.position + np.array([0.002, 0, 0])
    other = replace(small.viewer, position=aside, name="other")
    both = solve(replace(small, viewers=(small.viewer, other)))
    alone = solve(replace(small, viewers=(other,)))
    options = MapOptions(formats=tuple(FORMATS), times=1)
    found = drain(maps_of(both.channels[1], options)).warp
    expected = drain(warp_map(alone.first))
    assert np.array_equal(found.st, expected.st, equal_nan=True)
    assert not np.array_equal(found.st, drain(warp_map(both.first)).st, equal_nan=True)
