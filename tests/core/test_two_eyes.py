"""A pair of eyes: the depth at which points are seen, what of the lines of sight does not meet."""

import struct
import xml.etree.ElementTree as ET
import zlib
from dataclasses import replace

import mpmath
import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.files.png import encoded
from kiriko.core.lab.measure.places_seen import Observer, grid_of, places_seen
from kiriko.core.lab.measure.two_eyes import (
    angles_between,
    as_data,
    as_svg,
    nearest_between,
    sights_of,
    two_eyes,
)
from kiriko.core.lab.measure.viewer_errors import displaced
from kiriko.core.rig.rig import PicturePlace
from kiriko.core.rig.settings import Settings
from known.reference_rigs import ball_rig, box, icosphere, rectangle, rig
from known.work import drain, solve

APART = 0.064
SLAB = 0.02  # m, thick; 0.01 m of it is before the picture, as is half of its shift
INDEX = 1.49
DISTANCE = 0.6


def aside(viewer, right, name, up=0.0):
    """The same viewer moved by some m, that looks at the origin."""
    position = viewer.position + np.array([right, 0, up])
    forward = -position / np.linalg.norm(position)
    across = np.cross(forward, [0, 0, 1.0])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(across, forward), forward])
    return replace(viewer, position=position, axes=axes, name=name)


def with_eyes(a_rig, apart=APART, up=0.0):
    viewers = (aside(a_rig.viewer, s * apart / 2, n, up) for s, n in ((-1, "left"), (1, "right")))
    return replace(a_rig, viewers=tuple(viewers))


def slab_rig(ior=INDEX, up=0.0, **options):
    """Eyes before a slab that is parallel to the line between them, and to the picture's plane."""
    small = {"pixels": 64, "display_pixels": 64, "viewer_distance": DISTANCE, "field": 0.06}
    options = small | options
    return with_eyes(rig(box([0.5, SLAB, 0.5]), ior=ior, **options), up=up)


def seen(a_rig, **settings):
    return drain(two_eyes(a_rig, Settings(**settings)))


def every(found):
    return found.uncompensated, found.for_left, found.for_right, found.for_both


def points_of(n=7, side=0.03):
    """Points of the picture (n, n, 3), as the grid has them."""
    along = side * ((np.arange(n) + 0.5) / n - 0.5)
    x, z = np.meshgrid(along, -along)
    return np.stack([x, 0 * x, z], axis=2)


def rises(eye, point):
    """By how much a slab, by Snell's law in 30 digits, lifts what an eye sees of a point towards
    the eye, along the normal: the eye's line of sight passes over the point at that height.

    The ray leaves the eye at an angle a with r = (D - t) tan a + t tan a', sin a = n sin a'.
    """
    with mpmath.workdps(30):
        r = mpmath.hypot(point[0] - eye[0], point[2] - eye[2])
        far, t, n = mpmath.mpf(-float(eye[1])), mpmath.mpf(SLAB), mpmath.mpf(INDEX)
        inside = lambda a: mpmath.asin(mpmath.sin(a) / n)  # noqa: E731
        a = mpmath.findroot(
            lambda a: (far - t) * mpmath.tan(a) + t * mpmath.tan(inside(a)) - r,
            mpmath.atan(r / far),
        )
        return t * (1 - mpmath.tan(inside(a)) / mpmath.tan(a))


def expected_depth(left, right, over_left, over_right):
    """Depth of the nearest approach of lines of sight that pass through points (3,), in 30 digits:
    the two equations that say that the way between them is across both.
    """
    with mpmath.workdps(30):
        p, q = (mpmath.matrix([mpmath.mpf(float(x)) for x in eye]) for eye in (left, right))
        u, v = over_left - p, over_right - q
        dot = lambda a, b: sum(x * y for x, y in zip(a, b, strict=True))  # noqa: E731
        matrix = mpmath.matrix([[dot(u, u), -dot(u, v)], [dot(u, v), -dot(v, v)]])
        s, t = mpmath.lu_solve(matrix, mpmath.matrix([dot(q - p, u), dot(q - p, v)]))
        middle = (p + s * u + q + t * v) / 2
        return float(-middle[1])


def over(point, height):
    return mpmath.matrix([mpmath.mpf(float(point[0])), -height, mpmath.mpf(float(point[2]))])


@pytest.mark.parametrize("up", [0.0, 0.1])
@pytest.mark.parametrize("glass", ["none", "index 1"])
def test_without_glass_all_is_seen_in_the_picture_s_plane(glass, up):
    """To 1e-9 m, with no vertical disparity, whatever the display is made for."""
    a_rig = slab_rig(ior=1.0, up=up)
    if glass == "none":  # a grain of glass far beside the light; a rig has to have some
        glasses = (replace(a_rig.glasses[0], mesh=icosphere(0.001, 1, centre=(0.4, 0, 0))),)
        found = seen(replace(a_rig, glasses=glasses), only_through_glass=False)
    else:
        found = seen(a_rig)
    for sights in every(found):
        assert sights.is_seen.all()
        assert np.abs(sights.depth).max() < 1e-9
        assert np.abs(sights.vertical).max() < 1e-6
        assert np.abs(sights.horizontal).max() < 1e-6


@pytest.mark.parametrize("up", [0.0, 0.1])
def test_behind_a_slab_the_depth_is_the_closed_form_s(up):
    """Uncompensated, an eye's line of sight passes over a point at the height by which the slab
    lifts it for that eye: the depth is that of the nearest approach, to 1e-9 m.
    """
    a_rig = slab_rig(up=up)
    found = seen(a_rig).uncompensated
    left, right = (viewer.position for viewer in a_rig.viewers)
    points = points_of()
    for row, column in [(0, 0), (0, 6), (3, 3), (5, 1), (6, 4)]:
        point = points[row, column]
        heights = [rises(eye, point) for eye in (left, right)]
        lines = [over(point, height) for height in heights]
        depth = expected_depth(left, right, *lines)
        assert found.depth[row, column] == pytest.approx(depth, abs=1e-9)
        assert 0.006 < depth < 0.008
    # where both eyes look through it alike, the lines meet: t (1 - cos a / (n cos a'))
    middle = float(rises(left, points[3, 3]))
    assert found.depth[3, 3] == pytest.approx(middle, abs=1e-9)
    assert abs(found.vertical[3, 3]) < 1e-6
    assert found.mean_depth == pytest.approx(middle, rel=0.01)


def test_what_is_solved_for_one_eye_is_seen_by_the_other_as_the_closed_form_says():
    """The display shows a point where the left eye sees it straight; the right eye sees what is
    shown there, lifted by the slab, and the left one is right to rounding.
    """
    a_rig = slab_rig(up=0.1)
    left, right = (viewer.position for viewer in a_rig.viewers)
    points = points_of()
    found = seen(a_rig)
    for sights, own, other in ((found.for_left, left, right), (found.for_right, right, left)):
        for row, column in [(0, 0), (2, 5), (6, 3)]:
            point = points[row, column]
            shown = shown_at(own, point)
            line = over(shown, rises(other, shown))
            depth = expected_depth(own, other, over(point, mpmath.mpf(0)), line)
            assert sights.depth[row, column] == pytest.approx(depth, abs=1e-9)


def shown_at(eye, point):
    """Where in the picture's plane the plain picture shows what the eye sees straight at a point:
    the ray is shifted to the eye's foot by t (tan a - tan a').
    """
    foot = np.array([eye[0], 0, eye[2]])
    along = point - foot
    r = np.linalg.norm(along)
    tangent = r / -eye[1]
    sine = tangent / np.sqrt(1 + tangent**2) / INDEX
    shift = SLAB * (tangent - sine / np.sqrt(1 - sine**2))
    return point - shift * along / r


def test_places_are_those_of_a_solve_with_pixels():
    """Those that `displaced` finds on the display's own pixels, to 1e-5 viewer px: solved for both,
    and for one, by an eye that counts for nothing.
    """
    a_rig = slab_rig(display_pixels=256)
    left, right = a_rig.viewers
    for weights in ((1.0, 3.0), (1.0, 1e-12)):
        viewers = (replace(left, weight=weights[0]), replace(right, weight=weights[1]))
        solution = solve(replace(a_rig, viewers=viewers), tolerance=1e-5)
        plan = solution.first.plan
        looks = [Observer(plan.seen_by(viewer), viewer.weight) for viewer in viewers]
        found = run_steps(places_seen(looks, grid_of(7)))
        for number in range(2):
            expected, straight = displaced(solution, number)
            np.testing.assert_allclose(found[number], expected, atol=1e-5)
        assert np.abs(expected - straight).max() > 0.01


def test_of_a_solve_with_pixels_the_sights_are_those_of_the_smallest():
    """Depth to 1e-6 m and disparity to 1e-4 arcmin, also where the right eye is the first viewer;
    the largest depth is that of the point seen farthest from the plane.
    """
    a_rig = slab_rig(display_pixels=256)
    expected = seen(a_rig).for_both
    for viewers in (a_rig.viewers, a_rig.viewers[::-1]):
        solution = solve(replace(a_rig, viewers=viewers), tolerance=1e-5)
        left, right, sights = sights_of(solution)
        assert (left.name, right.name) == tuple(viewer.name for viewer in a_rig.viewers)
        np.testing.assert_allclose(sights.depth, expected.depth, atol=1e-6)
        np.testing.assert_allclose(sights.vertical, expected.vertical, atol=1e-4)
        largest = max(sights.nearest_depth, sights.farthest_depth, key=abs)
        assert sights.largest_depth == largest


def test_solved_for_both_lies_between():
    """By weight: as much as one eye counts more, as much nearer it is to what is solved for it."""
    a_rig = with_eyes(ball_rig(4, pixels=128, display_pixels=128))
    found = seen(a_rig)
    for sights in every(found):
        assert sights.is_seen.sum() > 20
    left, right = a_rig.viewers
    more = seen(replace(a_rig, viewers=(left, replace(right, weight=1e9))))
    np.testing.assert_allclose(more.for_both.depth, more.for_right.depth, atol=1e-6)
    np.testing.assert_allclose(more.for_both.vertical, more.for_right.vertical, atol=1e-3)
    swapped = seen(replace(a_rig, viewers=(right, left)))
    assert (swapped.left, swapped.right) == ("left", "right")
    np.testing.assert_allclose(swapped.for_both.depth, found.for_both.depth, atol=1e-9)


def test_the_ball_is_alike_on_both_sides():
    """A mirror image of rig and eyes: the depth of one side is that of the other, and vertical
    disparity is the opposite.
    """
    found = seen(with_eyes(ball_rig(5, pixels=128, display_pixels=128)))
    for sights in (found.uncompensated, found.for_both):
        is_seen = sights.is_seen & sights.is_seen[:, ::-1]
        assert is_seen.any()
        mirrored = sights.depth[:, ::-1]
        np.testing.assert_allclose(sights.depth[is_seen], mirrored[is_seen], atol=2e-5)
        np.testing.assert_allclose(
            sights.vertical[is_seen], -sights.vertical[:, ::-1][is_seen], atol=0.05
        )
        # light through the middle goes straight on
        assert abs(sights.depth[3, 3]) < 1e-7


def test_angles_are_those_of_points_in_space():
    """A direction by azimuth and elevation, put together again; and no vertical disparity between
    the directions of one point.
    """
    rng = np.random.default_rng(1)
    across = np.array([1.0, 0, 0])
    azimuth, elevation = rng.uniform(-0.4, 0.4, (2, 2, 100))
    one, other = (
        np.stack([np.sin(a), np.cos(a) * np.cos(e), np.cos(a) * np.sin(e)], axis=1)
        for a, e in zip(azimuth, elevation, strict=True)
    )
    horizontal, vertical = angles_between(one, other, across)
    np.testing.assert_allclose(horizontal, azimuth[0] - azimuth[1], atol=1e-12)
    np.testing.assert_allclose(vertical, elevation[0] - elevation[1], atol=1e-12)


def test_the_nearest_places_of_two_lines():
    """Two lines across each other, in a turned frame; parallel ones have none."""
    rng = np.random.default_rng(2)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    middle, half = np.array([0.3, -0.2, 0.5]), np.array([0, 0, 0.05])
    u, v = np.array([[1.0, 0, 0]]), np.array([[0.6, 0.8, 0]])
    found = nearest_between(
        turn @ (middle + half - 2 * u[0]), turn @ (middle - half + 3 * v[0]), u @ turn.T, v @ turn.T
    )
    np.testing.assert_allclose(found[0], turn @ middle, atol=1e-14)
    assert np.isnan(nearest_between(middle, middle + half, u, u)).all()


def test_a_point_that_one_eye_alone_sees_has_no_depth():
    """A slab that stops the right eye's light to the side: NaN there, numbers elsewhere."""
    a_rig = slab_rig()
    narrow = replace(a_rig.glasses[0], mesh=box([0.02, SLAB, 0.5]))
    found = seen(replace(a_rig, glasses=(narrow,)))
    sights = found.for_both
    assert not sights.is_seen[:, 0].any()
    assert sights.is_seen[:, 3].all()
    assert np.isnan(sights.depth[~sights.is_seen]).all()
    none = replace(narrow, mesh=box([0.001, 0.001, 0.001], centre=(0.3, 0, 0)))
    nothing = seen(replace(a_rig, glasses=(none,))).for_both
    assert nothing.mean_depth is nothing.largest_vertical is nothing.mean_horizontal is None


def turned_away(viewer):
    """The same viewer looking the other way."""
    return replace(viewer, axes=viewer.axes * np.array([[-1.0], [1.0], [-1.0]]))


NO_PAIR = {
    "one": (lambda a, b: (a,), "but the rig has 1. Choose"),
    "three": (lambda a, b: (a, b, replace(a, name="third")), "but the rig has 3. Choose"),
    "away": (
        lambda a, b: (a, turned_away(b)),
        "'left' and 'right' are not a pair of eyes",
    ),
    "above": (
        lambda a, b: (a, replace(b, position=a.position + np.array([0, 0, 0.06]))),
        "'left' and 'right' are not a pair of eyes",
    ),
    "same place": (
        lambda a, b: (a, replace(b, position=a.position)),
        "'left' and 'right' are not a pair of eyes",
    ),
    "orthographic": (
        lambda a, b: (a, replace(b, projection="orthographic")),
        "'right' is orthographic",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", NO_PAIR)
def test_viewers_other_than_a_pair_of_eyes_are_refused(name):
    change, words = NO_PAIR[name]
    a_rig = slab_rig()
    with pytest.raises(RigError, match=words):
        seen(replace(a_rig, viewers=change(*a_rig.viewers)))


def test_a_picture_that_has_no_plane_is_refused():
    a_rig = slab_rig()
    picture = a_rig.picture
    curved = replace(icosphere(0.01, 1), uv=np.random.default_rng(0).random((80, 3, 2)))
    for mesh, words in ((None, "in the viewer's pixels"), (curved, "not a flat rectangle")):
        with pytest.raises(RigError, match=words):
            seen(replace(a_rig, pictures=(replace(picture, mesh=mesh),)))


def test_a_part_of_the_image_is_looked_at_where_it_is():
    """A plane that shows a quarter of an image: points are of the plane, wherever its UV are."""
    a_rig = slab_rig()
    mesh = rectangle(np.zeros(3), [1, 0, 0], [0, 0, 1], 0.03, 0.03)
    place = PicturePlace("part", 64, 64, replace(mesh, uv=0.25 + 0.5 * mesh.uv))
    found = seen(replace(a_rig, pictures=(place,))).uncompensated
    np.testing.assert_allclose(found.depth, seen(a_rig).uncompensated.depth, atol=1e-9)


def test_the_drawing_has_arrows_and_a_disc_for_each_point():
    """Lengths and areas are in proportion to the numbers, one scale for all panels; the picture's
    own pixels are in it.
    """
    a_rig = with_eyes(ball_rig(4, pixels=64, display_pixels=64))
    found = seen(a_rig)
    drawing = ET.fromstring(as_svg(a_rig, found))
    svg = "{http://www.w3.org/2000/svg}"
    panels = drawing.findall(f"{svg}g")
    assert len(panels) == 12
    for field, axis, sign, row in (("vertical", 1, -1, 0), ("horizontal", 0, 1, 1)):
        lengths = []
        for n, sights in enumerate(every(found)):
            arrows = panels[3 * n + row].findall(f"{svg}path[@class='arrow']")
            lines = [arrow.get("d").split(" ")[:2] for arrow in arrows]
            ends = np.array([[place[1:].split(",") for place in line] for line in lines], float)
            way = ends[:, 1] - ends[:, 0]
            assert not way[:, 1 - axis].any()
            values = getattr(sights, field)[sights.is_seen]
            lengths += zip(sign * way[:, axis], values, strict=True)
            numbers = [text.text for text in panels[3 * n + row].findall(f"{svg}text")[2:]]
            assert [float(text) for text in numbers] == pytest.approx(values, abs=6e-3)
        lengths = np.array(lengths) / np.abs(lengths).max(axis=0)
        np.testing.assert_allclose(*lengths.T, atol=5e-3)

    for n, sights in enumerate(every(found)):
        discs = panels[3 * n + 2].findall(f"{svg}circle[@class='disc']")
        area = np.array([float(disc.get("r")) ** 2 for disc in discs])
        depth = np.abs(sights.depth[sights.is_seen])
        assert area / area.max() == pytest.approx(depth / depth.max(), abs=5e-3)
        is_before = [disc.get("fill") != "none" for disc in discs]
        assert is_before == (sights.depth[sights.is_seen] > 0).tolist()

    told = as_data(found)["for_both"]
    assert np.array(told["depth_m"]) == pytest.approx(found.for_both.depth)
    assert told["n_points"] == 49


def test_the_drawings_picture_is_a_png_of_its_pixels():
    """As zlib and the standard have it: a header, and lines that begin with 0."""
    pixels = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
    data = encoded(pixels)
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert data[12:16] == b"IHDR"
    assert struct.unpack(">II", data[16:24]) == (3, 2)
    start = data.index(b"IDAT")
    (length,) = struct.unpack(">I", data[start - 4 : start])
    lines = np.frombuffer(zlib.decompress(data[start + 4 : start + 4 + length]), np.uint8)
    assert np.array_equal(lines.reshape(2, 10)[:, 1:].reshape(2, 3, 3), pixels)
    assert not lines.reshape(2, 10)[:, 0].any()
