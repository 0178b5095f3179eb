"""How far a head may move: held to a walk by closed form, and to a walk by traced steps."""

import json
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.lab.atlas.heads import viewer_at
from kiriko.core.lab.measure.head_range import (
    BEYOND,
    EDGE,
    MOST,
    N_POINTS,
    WAYS,
    EyeBox,
    Walk,
    as_data,
    as_svg,
    curves_of,
    eye_box,
    octahedron,
    surface_of,
)
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.rig.settings import Settings
from known.reference_rigs import ball_rig, box, rig
from known.work import drain

THICKNESS, INDEX, DISTANCE, SIDE = 0.02, 1.49, 0.6, 0.03
SMALL = {"pixels": 64, "display_pixels": 64}
NAMES = ("left", "right", "up", "down", "nearer", "farther")


def slab_rig():
    """A slab so large that nothing is seen beside it; the display is larger than what is shown."""
    slab = box([2.0, THICKNESS, 2.0])
    return rig(slab, viewer_distance=DISTANCE, field=0.06, plate=3.0, display=0.2, **SMALL)


def points_of():
    along = SIDE * (0.5 - EDGE) * np.linspace(-1, 1, N_POINTS)
    x, z = (grid.ravel() for grid in np.meshgrid(along, -along))
    return np.stack([x, 0 * x, z], axis=1)


def shift(tangent):
    """t (tan a - tan a'), by which a slab shifts a ray along its face."""
    sine = tangent / np.sqrt(1 + tangent**2) / INDEX
    return THICKNESS * (tangent - sine / np.sqrt(1 - sine**2))


def off_by_closed_form(solved, head):
    """Arcmin (n,) between where a head sees points straight, and where it sees the places of the
    plane that an eye at `solved` would see there.
    """
    one, other = (to - head for to in (points_of(), seen_by_closed_form(solved, head)))
    across = np.linalg.norm(np.cross(one, other), axis=1)
    return np.degrees(np.arctan2(across, (one * other).sum(axis=1))) * 60


def seen_by_closed_form(solved, head):
    """Where on the plane (n, 3) a head sees points that are shown for an eye at `solved`."""
    points = points_of()
    shown = points - shifted(solved, points)
    # the ray's tangent is that of the place which the eye sees straight: found by repetition
    straight = shown
    for _ in range(60):
        straight = shown + shifted(head, straight)
    return straight


def shifted(eye, points):
    """By how much (n, 3) the slab shifts the rays of an eye that would meet points straight."""
    along = (points - eye) * [1, 0, 1]
    r = np.linalg.norm(along, axis=1, keepdims=True)
    tangent = r / -eye[1]
    return shift(tangent) * along / np.where(r > 0, r, 1)


def test_behind_a_slab_it_is_that_of_a_walk_by_closed_form():
    """Six ways, each within 2 % of where a walk passes the limit, in steps of 0.2 % near there."""
    a_rig = slab_rig()
    found = drain(eye_box(a_rig, Settings(), limit=0.5))
    eye = a_rig.viewer.position
    for name, (axis, sign, _) in zip(NAMES, WAYS, strict=True):
        way = sign * a_rig.viewer.axes[axis]
        extent = getattr(found, name)
        steps = extent * np.concatenate([np.arange(0.0, 0.95, 0.05), np.arange(0.95, 1.06, 2e-3)])
        is_within = [off_by_closed_form(eye, eye + s * way).max() <= 0.5 for s in steps]
        walked = steps[np.logical_and.accumulate(is_within).sum() - 1]
        if name == "farther":  # nothing is off by so much, however far it is
            assert found.is_open == (False,) * 5 + (True,)
            assert is_within[-1]
            continue
        assert extent == pytest.approx(walked, rel=0.02), name
    # rig and slab are alike to the left and right, up and down
    assert found.left == pytest.approx(found.right, rel=0.01)
    assert found.up == pytest.approx(found.down, rel=0.01)


def test_behind_a_slab_its_curves_are_those_of_closed_form():
    """Angles, px and coverage along six ways; the largest angle is the limit where a way ends."""
    a_rig = slab_rig()
    walk = Walk(compile_plan(a_rig, Settings()), 0.5)
    found = drain(walk.box())
    curves = drain(curves_of(walk, found))
    eye = a_rig.viewer.position
    for curve, name, (axis, sign, most) in zip(curves, NAMES, WAYS, strict=True):
        assert curve.way == name
        extent = getattr(found, name)
        # the way farther is open, and ends as far away as the picture is
        reach = DISTANCE if name == "farther" else min(BEYOND * extent, most * DISTANCE)
        assert curve.distance_m == pytest.approx(reach * np.arange(7) / 6, abs=1e-12)
        assert curve.coverage == (1.0,) * 7
        for k, s in enumerate(curve.distance_m):
            offset = s * sign * np.eye(3)[axis]
            head = viewer_at(a_rig.viewer, a_rig.picture_place, tuple(offset))
            assert head.position == pytest.approx(eye + offset @ a_rig.viewer.axes)
            angle = off_by_closed_form(eye, head.position)
            places = points_of(), seen_by_closed_form(eye, head.position)
            px = np.linalg.norm(np.subtract(*map(head.project, places)), axis=1)
            for numbers, mean, largest, rounding in (
                (angle, curve.mean_arcmin, curve.largest_arcmin, 1e-5),
                (px, curve.mean_px, curve.largest_px, 1e-6),
            ):
                assert mean[k] == pytest.approx(numbers.mean(), abs=rounding)
                assert largest[k] == pytest.approx(numbers.max(), abs=rounding)
        if reach == BEYOND * extent:
            assert curve.largest_arcmin[5] == pytest.approx(0.5, rel=5e-3)

    told = as_data(found, "eye", curves)
    assert told["ends_m"] == {name: getattr(found, name) for name in NAMES}
    assert json.loads(json.dumps(told, allow_nan=False))["curves"][0]["way"] == "left"


def test_its_drawing_has_a_line_for_each_way_and_number():
    """Four curves of angles and of px, two of coverage, for each axis; where
    nothing is seen they stop.
    """
    walk = Walk(compile_plan(slab_rig(), Settings()), 0.5)
    found = drain(walk.box())
    curves = drain(curves_of(walk, found))
    unseen = replace(
        curves[0],
        mean_arcmin=(*curves[0].mean_arcmin[:4], None, None, None),
        largest_arcmin=(*curves[0].largest_arcmin[:4], None, None, None),
    )
    drawing = ET.fromstring(as_svg(found, "eye <1>", (unseen, *curves[1:])))
    svg = "{http://www.w3.org/2000/svg}"
    diagrams = drawing.findall(f"{svg}svg")
    assert len(diagrams) == 9
    lines = [
        [line.get("points").split() for line in one.iter(f"{svg}polyline")] for one in diagrams
    ]
    assert [len(one) for one in lines] == 3 * [4, 4, 2]
    assert [len(line) for line in lines[0]] == [4, 4, 7, 7]
    assert [len(line) for one in lines[1:] for line in one] == 26 * [7]
    titles = {one.find(f"{svg}text").text for one in diagrams}
    assert titles == {
        f"The head of 'eye <1>': {a} and {b}"
        for a, b in (("left", "right"), ("up", "down"), ("nearer", "farther"))
    }


def test_on_the_ball_it_is_that_of_a_walk_by_steps():
    """Six ways, each within 2 % of a walk in steps, by the angles and by what is seen."""
    a_rig = ball_rig(4, display=0.075, **SMALL)
    found = drain(eye_box(a_rig, Settings(), limit=1.0, least=0.9))
    walk = Walk(compile_plan(a_rig, Settings()), 1.0, 0.9)
    run_steps(walk.begin())
    for name, (axis, sign, _) in zip(NAMES, WAYS, strict=True):
        extent = getattr(found, name)
        way = sign * np.eye(3)[axis]
        for s in extent * np.arange(0.15, 0.99, 0.2):
            assert run_steps(walk.part(s * way)) <= 1, name
        assert run_steps(walk.part(0.98 * extent * way)) <= 1, name
        if not found.is_open[NAMES.index(name)]:
            assert run_steps(walk.part(1.02 * extent * way)) > 1, name


def test_more_may_be_off_so_it_goes_farther():
    plan = compile_plan(ball_rig(4, display=0.075, **SMALL), Settings())
    for axis, sign, most in WAYS[:3]:
        narrow, wide = (
            run_steps(begun(plan, limit).farthest([(sign * np.eye(3)[axis], most)]))[0][0]
            for limit in (0.25, 0.5)
        )
        assert 0 < narrow < wide


def begun(plan, limit):
    walk = Walk(plan, limit)
    run_steps(walk.begin())
    return walk


def test_points_on_edges_of_the_ball_are_seen():
    """The picture's middle row is shown along edges of its triangles, where curved faces jump."""
    walk = Walk(compile_plan(ball_rig(4, display=0.075, picture=0.025, **SMALL), Settings()))
    for x in (0.001, 0.003, 0.013):
        off = run_steps(walk.off((-x, 0.0, 0.0)))
        assert np.isfinite(off).all()
        # each row is off as the one is that mirrors it
        rows = off.reshape(N_POINTS, N_POINTS)
        assert rows == pytest.approx(rows[::-1], rel=1e-4)


def test_a_head_at_the_picture_or_behind_it_is_too_far():
    walk = begun(compile_plan(ball_rig(4, display=0.075, **SMALL), Settings()), 1e6)
    distance = np.linalg.norm(walk.plan.viewer.position)
    assert run_steps(walk.part((0.0, 0.0, 0.0))) < np.inf
    for part in (1.0, 1.5):
        assert run_steps(walk.part((0.0, 0.0, part * distance))) == np.inf


def test_viewers_that_disagree_leave_no_box():
    """Solved for two far apart, the first is off by more than a little from the beginning."""
    a_rig = ball_rig(4, display=0.075, **SMALL)
    place = a_rig.picture_place
    viewers = tuple(
        replace(viewer_at(a_rig.viewer, place, (x, 0.0, 0.0)), name=f"{x}") for x in (-0.05, 0.05)
    )
    found = drain(eye_box(replace(a_rig, viewers=viewers), Settings(), limit=0.01))
    assert found.left == found.right == found.up == found.nearer == 0


def test_the_surface_is_closed_and_made_of_eighths_of_ellipsoids():
    """Each point is on its octant's; edges have two faces. The volume is theirs but for that which
    facets leave out: each octant is the sphere's, stretched, and there facets lie within 7.5
    degrees of their middles, at no less than that cosine from the sphere's.
    """
    walk = Walk(compile_plan(slab_rig(), Settings()), 0.5)
    run_steps(walk.begin())
    box = EyeBox(0.01, 0.02, 0.03, 0.04, 0.05, 3.0, 0.5, 0.98, (False,) * 5 + (True,))
    surface = drain(surface_of(walk, box))
    eye = walk.plan.viewer
    points = (surface.positions - eye.position) @ eye.axes.T
    # an open end is drawn no farther away than the picture is
    above, below = np.array([0.02, 0.03, 0.05]), np.array([0.01, 0.04, DISTANCE])
    assert points.max(axis=0) == pytest.approx(above, rel=1e-12)
    assert points.min(axis=0) == pytest.approx(-below, rel=1e-12)
    on_ellipsoid = ((points / np.where(points > 0, above, below)) ** 2).sum(axis=1)
    assert on_ellipsoid == pytest.approx(np.ones(len(points)), rel=1e-12)

    edges = np.concatenate([surface.triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    ways = {tuple(edge) for edge in edges.tolist()}
    assert len(ways) == len(edges)
    assert {(b, a) for a, b in ways} == ways
    corners = surface.positions[surface.triangles] - eye.position
    volume = np.linalg.det(corners).sum() / 6
    whole = np.pi / 6 * (above + below).prod()
    assert np.cos(np.radians(7.5)) ** 3 * whole < volume < whole


def test_the_surface_tells_by_how_much_the_picture_is_off():
    """At each place that is traced, as there; elsewhere between; at the box's ends by the limit."""
    walk = Walk(compile_plan(slab_rig(), Settings()), 0.5)
    box = drain(walk.box())
    surface = drain(surface_of(walk, box))
    assert surface.off.min() >= 0
    assert surface.off.max() <= MOST * 0.5

    eye = walk.plan.viewer
    points = (surface.positions - eye.position) @ eye.axes.T
    coarse, _ = octahedron()
    directions = coarse / np.linalg.norm(coarse, axis=1, keepdims=True)
    above = np.array([box.right, box.up, box.nearer])
    below = np.array([box.left, box.down, DISTANCE])
    for offset in directions * np.where(directions > 0, above, below):
        here = np.linalg.norm(points - offset, axis=1).argmin()
        assert points[here] == pytest.approx(offset, abs=1e-12)
        expected = 0.5 * min(run_steps(walk.part(offset)), MOST)
        assert surface.off[here] == pytest.approx(expected, rel=1e-9)
    for axis, sign, _ in WAYS[:5]:
        at_end = surface.off[(sign * points[:, axis]).argmax()]
        assert at_end == pytest.approx(0.5, rel=0.01)


def test_what_has_no_head_is_refused():
    a_rig = slab_rig()
    flat = replace(a_rig.viewer, projection="orthographic")
    with pytest.raises(RigError, match="is orthographic"):
        drain(eye_box(replace(a_rig, viewers=(flat,)), Settings()))
    own = replace(a_rig.picture, mesh=None)
    with pytest.raises(RigError, match="in the viewer's pixels"):
        drain(eye_box(replace(a_rig, pictures=(own,)), Settings()))
