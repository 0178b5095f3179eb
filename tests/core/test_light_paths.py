"""Whole ways of rays against closed forms: points on the surfaces, laws obeyed at each, ends at the
landing or at the place where light is lost.
"""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.light_paths import NOTHING, Tails, following
from kiriko.core.light.rays import Reason
from kiriko.core.light.trace import trace
from kiriko.core.rig.rig import Blocker, Kind, Mirror
from kiriko.core.rig.settings import Settings
from known import closed_forms
from known.closed_forms import snell, unit
from known.reference_rigs import ball_rig, box, rectangle, rig

RADIUS = 0.025
INDEX = 1.49
TAILS = Tails(tail=0.02, reach=0.3)
# pixels of the middle, and of others all over the view
PIXELS = np.array([[256.0, 256.0], [200.5, 301.0], [311.0, 180.0], [222.0, 222.0]])


def ways_of(a_rig, xy=PIXELS, aim=1.0, **settings):
    plan = compile_plan(a_rig, Settings(**settings))
    o, d = a_rig.viewer.rays(xy)
    ways = run_steps(following(plan, o, d, np.full(len(xy), aim), TAILS))
    landings = trace(plan, o, d)
    kinds = [
        ["NONE" if p == NOTHING else Kind(plan.parts.kind[p]).name for p in w.parts] for w in ways
    ]
    return o, d, ways, kinds, landings


def directions_of(points):
    return unit(np.diff(points, axis=0))


def obeys_plate(before, after, normal):
    """An ideal plate turns the part along it round, and lets that across it be."""
    return np.abs(after - (2 * (before @ normal) * normal - before)).max()


@pytest.mark.usefixtures("has_kernel")
def test_through_a_slab_each_point_is_that_of_the_closed_form():
    """Near face, far face, plate and display, each to 1e-12 m and refracted to
    1e-9; the end is the landing.
    """
    a_rig = rig(box([0.3, 0.02, 0.3]), display=0.1)
    o, d, ways, kinds, landings = ways_of(a_rig)
    y = np.array([0.0, 1.0, 0.0])
    leaves, _ = closed_forms.through_slab(o, d, y, -0.01 * y, 0.02, INDEX)

    for k, found in enumerate(ways):
        assert found.reason == Reason.ARRIVED
        assert kinds[k] == ["NONE", "GLASS", "GLASS", "PLATE", "DISPLAY"]
        start, near, far, plate, end = found.points
        assert (start == o[k]).all()
        assert abs(near[1] + 0.01) < 1e-12
        assert np.abs(far - leaves[k]).max() < 1e-12
        normal = np.array([0.0, 1.0, -1.0]) / 2**0.5
        assert abs((plate - [0, 0.15, 0]) @ normal) < 1e-12
        assert (end == landings.positions[k]).all()
        assert abs(end[2] + 0.15) < 1e-12

        way_to = directions_of(found.points)
        assert np.abs(way_to[1] - snell(way_to[0], y, 1, INDEX)).max() < 1e-9
        assert np.abs(way_to[2] - snell(way_to[1], y, INDEX, 1)).max() < 1e-9
        assert obeys_plate(way_to[2], way_to[3], normal) < 1e-9


@pytest.mark.usefixtures("has_kernel")
def test_through_a_ball_each_point_lies_on_it_and_light_is_bent_there():
    """Points within 1e-9 m of the sphere; Snell's law by its own
    normals to 1e-7, which is as well as the curved faces know them.
    """
    o, d, ways, _, landings = ways_of(ball_rig())
    leaves, _ = closed_forms.through_ball(o, d, RADIUS, INDEX)
    for k, found in enumerate(ways):
        _, near, far, *_, end = found.points
        assert np.abs(np.linalg.norm([near, far], axis=1) - RADIUS).max() < 1e-9
        assert np.abs(far - leaves[k]).max() < 1e-9
        assert (end == landings.positions[k]).all()

        way_to = directions_of(found.points)
        assert np.abs(way_to[1] - snell(way_to[0], near / RADIUS, 1, INDEX)).max() < 1e-7
        assert np.abs(way_to[2] - snell(way_to[1], far / RADIUS, INDEX, 1)).max() < 1e-7


@pytest.mark.usefixtures("has_kernel")
def test_light_that_is_lost_ends_at_the_place_where_it_is():
    """Beside the glass at the place looked at and a tail beyond; on the planes of plate and display
    that it passes by; on a blocker; on the display's back; at the last event that is allowed.
    """
    slab = box([0.3, 0.02, 0.3])
    middle = PIXELS[:1]
    normal = np.array([0.0, 1.0, -1.0]) / 2**0.5

    # the glass
    _, _, (found,), kinds, _ = ways_of(ball_rig(3), np.array([[2.0, 2.0]]))
    assert found.reason == Reason.MISSED_GLASS
    assert kinds == [["NONE", "NONE"]]
    assert np.linalg.norm(np.diff(found.points, axis=0)) == pytest.approx(1.0 + TAILS.tail)

    # the plate: on its plane, and a tail beyond the glass where that is too far off
    beside = replace(rig(slab), plates=(replace(rig(slab).plates[0], mesh=moved_plate(0.1)),))
    _, _, (found,), kinds, _ = ways_of(beside, middle)
    assert found.reason == Reason.MISSED_PLATE
    assert kinds == [["NONE", "GLASS", "GLASS", "NONE"]]
    assert abs((found.points[-1] - [0, 0.15, 0]) @ normal) < 1e-12

    far = replace(beside, plates=(replace(beside.plates[0], mesh=moved_plate(0.1, 5.0)),))
    _, _, (found,), _, _ = ways_of(far, middle)
    assert np.linalg.norm(found.points[-1] - found.points[-2]) == pytest.approx(TAILS.tail)

    # where it is nearest to the plate, whose plane it runs along
    aside = rectangle(np.array([0.2, 0.1, 0.0]), [0, 1, 0], [0, 0, 1], 0.1, 0.1)
    along = replace(beside, plates=(replace(beside.plates[0], mesh=aside),))
    _, _, (found,), _, _ = ways_of(along, middle)
    assert np.abs(found.points[-1] - [0, 0.1, 0]).max() < 1e-12

    # the display
    small = rig(slab, display=0.002)
    _, _, ways, kinds, _ = ways_of(small, PIXELS[1:])
    for k, found in enumerate(ways):
        assert found.reason == Reason.MISSED_DISPLAY
        assert kinds[k] == ["NONE", "GLASS", "GLASS", "PLATE", "NONE"]
        assert abs(found.points[-1][2] + 0.15) < 1e-12

    # a blocker before the plate, and the display's back
    wall = rectangle(np.array([0, 0.05, 0]), [1, 0, 0], [0, 0, 1], 0.1, 0.1)
    _, _, (found,), kinds, _ = ways_of(
        replace(rig(slab), blockers=(Blocker("wall", wall),)), middle
    )
    assert found.reason == Reason.BLOCKED
    assert kinds == [["NONE", "GLASS", "GLASS", "BLOCKER"]]
    assert np.abs(found.points[-1] - [0, 0.05, 0]).max() < 1e-12

    turned = rig(slab)
    display = turned.displays[0]
    mesh = replace(display.mesh, triangles=display.mesh.triangles[:, ::-1])
    turned = replace(turned, displays=(replace(display, mesh=mesh),))
    _, _, (found,), _, _ = ways_of(turned, middle)
    assert found.reason == Reason.BLOCKED
    assert abs(found.points[-1][2] + 0.15) < 1e-12

    # the last event that is allowed
    _, _, (found,), kinds, _ = ways_of(rig(slab), middle, max_events=2)
    assert found.reason == Reason.CUT_OFF
    assert kinds == [["NONE", "GLASS", "GLASS"]]


def moved_plate(across, along=0.15):
    x, y, z = np.eye(3)
    return rectangle(along * y + across * x, x, (y + z) / 2**0.5, 0.1, 0.1)


def test_by_a_mirror_the_way_turns_as_the_law_has_it():
    """A mirror between plate and display is one more point of the way, where both angles are the
    same.
    """
    x, y, z = np.eye(3)
    a_rig = rig(box([0.3, 0.02, 0.3]))
    mirror = Mirror("mirror", rectangle(0.15 * y - 0.1 * z, x, (y - z) / 2**0.5, 0.1, 0.1))
    moved = replace(a_rig.display, mesh=rectangle(0.25 * y - 0.1 * z, x, z, 0.1, 0.1))
    a_rig = replace(a_rig, mirrors=(mirror,), displays=(moved,))
    _, _, (found,), kinds, landings = ways_of(a_rig, PIXELS[:1])
    assert kinds == [["NONE", "GLASS", "GLASS", "PLATE", "MIRROR", "DISPLAY"]]
    assert found.reason == landings.reason[0]
    assert (found.points[-1] == landings.positions[0]).all()
    way_to = directions_of(found.points)
    normal = (y + z) / 2**0.5
    assert np.abs(way_to[3] - 2 * (way_to[3] @ normal) * normal - way_to[4]).max() < 1e-9


def test_no_rays_have_no_ways():
    """Nothing asked, nothing found."""
    assert ways_of(rig(box([0.3, 0.02, 0.3])), np.empty((0, 2)))[2] == []
