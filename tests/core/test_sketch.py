"""The sketch of a rig: lost parts, distances and aerial plane are where they should be."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.bench.sketch import (
    HATCH,
    OUT_OF_VIEW,
    canvas_of,
    grid,
    hatched,
    outline_of,
    sight_lines,
    sketching,
)
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Reason
from kiriko.core.light.trace import trace
from kiriko.core.rig.rig import PicturePlace
from kiriko.core.rig.settings import Settings
from known.reference_rigs import ball_rig, box, rectangle, rig

X, Y, Z = np.eye(3)
SLAB = box([0.1, 0.02, 0.1])


def sketch_of(a_rig):
    return run_steps(sketching(a_rig, compile_plan(a_rig, Settings())))


def points_of(sketch):
    """All places of a sketch (n, 3)."""
    places = [line.points for line in sketch.lines]
    places += [note.place[None] for note in sketch.notes]
    places += [np.stack([d.start, d.end, d.offset]) for d in sketch.dimensions]
    return np.concatenate([*places, sketch.light.hatch.reshape(-1, 3)])


def with_plate(a_rig, mesh):
    return replace(a_rig, plates=(replace(a_rig.plates[0], mesh=mesh),))


def half_plate():
    """A plate that takes the light of the picture's left half alone."""
    return rectangle(0.15 * Y - 0.05 * X, X, (Y + Z) / 2**0.5, 0.1, 0.2)


def test_corners_and_middle_are_looked_at_straight():
    """Each way begins at the viewer and goes straight to its place of the picture, until it meets
    the glass.
    """
    a_rig = rig(SLAB)
    sketch = sketch_of(a_rig)
    corners = 0.015 * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1], [0, 0, 0]])
    assert len(sketch.light.ways) == 5
    for way, corner in zip(sketch.light.ways, corners, strict=True):
        start, first = way.points[:2]
        assert (start == a_rig.viewer.position).all()
        assert np.abs(np.cross(first - start, corner - start)).max() < 1e-12
        assert way.has_arrived
    assert not len(sketch.light.hatch)
    assert [note.text for note in sketch.notes] == ["mid-air image of the display"]


def test_the_lost_half_is_hatched_and_only_that():
    """Light along each hatch line is lost; the hatch's reach is the
    lost half but for the grid; the reason stands where the light is lost.
    """
    a_rig = with_plate(rig(SLAB), half_plate())
    sketch = sketch_of(a_rig)
    hatch = sketch.light.hatch
    assert np.abs(hatch[..., 1]).max() < 1e-12  # in the picture's plane

    plan = compile_plan(a_rig, Settings())
    o, d, _, _ = sight_lines(a_rig.viewer, hatch.mean(axis=1))
    assert (trace(plan, o, d).reason == Reason.MISSED_PLATE).all()
    part = 0.03 / HATCH.n_grid
    assert hatch[..., 0].min() == pytest.approx(0.0, abs=part)
    assert hatch[..., 0].max() == pytest.approx(0.015, abs=1e-9)

    lost = [way for way in sketch.light.ways if not way.has_arrived]
    assert len(lost) in (2, 3)  # the middle is on the edge
    words = [note for note in sketch.notes if note.state == "lost"]
    assert {note.text for note in words} == {"missed the plate"}
    normal = (Y - Z) / 2**0.5
    for note in words:
        assert abs((note.place - 0.15 * Y) @ normal) < 1e-9


def test_a_picture_beyond_the_frame_is_lost_there():
    """Places that are not in the viewer's image end at the picture, outside its frame."""
    a_rig = rig(SLAB, field=0.02)
    sketch = sketch_of(a_rig)
    *corners, middle = sketch.light.ways
    assert middle.has_arrived
    for way in corners:
        assert not way.has_arrived
        assert np.abs(np.abs(way.points[-1]) - [0.015, 0, 0.015]).max() < 1e-12
    assert {n.text for n in sketch.notes if n.state == "lost"} == {OUT_OF_VIEW}


def test_hatch_lines_cover_the_lost_part_evenly():
    """Their length, by the distance between them, is the lost part's area, and they rise at 45
    degrees on a picture of any shape.
    """
    places = grid()
    for size in ((0.03, 0.03), (0.06, 0.02), (1.0, 5.0)):
        is_lost = np.linalg.norm(places - [0.4, 0.6], axis=1) < 0.3
        lines = hatched(is_lost, size) * size
        along = lines[:, 1] - lines[:, 0]
        assert np.abs(along[:, 0] - along[:, 1]).max() < 1e-12 * max(size)
        between = 2 / HATCH.n_lines * max(size) / 2**0.5
        area = np.linalg.norm(along, axis=1).sum() * between
        assert area == pytest.approx(is_lost.mean() * size[0] * size[1], rel=0.06)
    assert not len(hatched(np.zeros(len(places), bool), (1.0, 1.0)))
    assert not len(hatched(np.ones(len(places), bool), (0.0, 0.0)))


@pytest.mark.parametrize("distance", [0.08, 0.15, 0.4])
def test_distances_and_aerial_plane_are_those_of_the_bench(distance):
    """Middle of glass to plate to display, along the middle's light: with a plate that is moved
    within its plane, too. The aerial plane is the display's mirror image, point for point.
    """
    a_rig = rig(SLAB, distance=distance)
    moved = rectangle(distance * Y + 0.05 * X, X, (Y + Z) / 2**0.5, 0.4, 0.4)
    lengths = [d.length for d in sketch_of(with_plate(a_rig, moved)).dimensions]
    assert lengths == pytest.approx([distance, distance], abs=1e-12)
    sketch = sketch_of(a_rig)
    assert [d.length for d in sketch.dimensions] == pytest.approx([distance, distance], abs=1e-12)
    assert all(np.abs(d.offset @ (d.end - d.start)) < 1e-12 for d in sketch.dimensions)
    assert all(np.linalg.norm(d.offset) > 0.05 for d in sketch.dimensions)  # clear of the glass

    aerial = np.concatenate([line.points for line in sketch.lines if line.state == "aerial"])
    assert np.abs(aerial[:, 1]).max() < 1e-12
    assert np.abs(np.abs(aerial[:, [0, 2]]) - 0.025).max() < 1e-12


def test_by_two_plates_the_display_seems_to_stand_behind_both():
    """Light that goes by two plates comes from the mirror image of a
    mirror image, and each distance between the parts is told.
    """
    a_rig = rig(SLAB)
    second = rectangle(0.15 * (Y - Z), X, (Y + Z) / 2**0.5, 0.3, 0.3)
    display = rectangle(0.3 * Y - 0.15 * Z, X, Z, 0.05, 0.05)
    a_rig = replace(
        a_rig,
        plates=(*a_rig.plates, replace(a_rig.plates[0], mesh=second)),
        displays=(replace(a_rig.displays[0], mesh=display),),
    )
    sketch = sketch_of(a_rig)
    assert sketch.light.ways[4].has_arrived
    assert [d.length for d in sketch.dimensions] == pytest.approx([0.15] * 3, abs=1e-12)

    def mirrored(points, at):
        normal = (Y - Z) / 2**0.5
        return points - 2 * ((points - at) @ normal)[..., None] * normal

    expected = mirrored(mirrored(outline_of(display.corners), 0.15 * (Y - Z)), 0.15 * Y)
    aerial = np.stack([line.points for line in sketch.lines if line.state == "aerial"])
    assert np.abs(aerial - expected).max() < 1e-12


def test_a_picture_in_the_viewers_pixels_is_looked_at_over_the_whole_frame():
    """Its corners are those of the frame, as far away as the glass."""
    a_rig = replace(ball_rig(3), pictures=(PicturePlace("image", 64, 64),))
    sketch = sketch_of(a_rig)
    o, d = a_rig.viewer.rays(np.array([[0.0, 512.0], [512, 512], [512, 0], [0, 0], [256, 256]]))
    for way, start, direction in zip(sketch.light.ways, o, d, strict=True):
        assert np.abs(np.cross(way.points[1] - start, direction)).max() < 1e-12
    frame = np.concatenate([line.points for line in sketch.lines if line.state == "picture"])
    assert np.abs(np.abs(frame) - [0.025, 0, 0.025]).max() < 1e-12
    assert len(sketch.light.hatch)  # a ball does not fill its frame
    assert not sketch.light.ways[0].has_arrived


def test_a_canvas_has_each_place_of_its_uv_map():
    """Places of a bent, of a divided and of a turned picture are where interpolation has them."""
    flat = rectangle(np.zeros(3), X, Z, 0.3, 0.2)
    some = np.random.default_rng(1).random((50, 2))
    expected = (some[:, :1] - 0.5) * 0.3 * X + (some[:, 1:] - 0.5) * 0.2 * Z
    for mesh in (flat, divided(flat), replace(flat, uv=flat.uv * 0.5 + 0.25)):
        canvas = canvas_of(PicturePlace("p", 3, 2, mesh), None, np.zeros(3))
        points, is_on = canvas.points(some)
        assert is_on.all()
        assert np.abs(points - expected).max() < 1e-12
        assert canvas.size == pytest.approx((0.3, 0.2))
    assert len(canvas_of(PicturePlace("p", 3, 2, divided(flat)), None, X).corners) == 2

    bent = divided(flat)
    vertices = bent.vertices.copy()
    vertices[:, 1] = np.abs(vertices[:, 0])
    canvas = canvas_of(PicturePlace("p", 3, 2, replace(bent, vertices=vertices)), None, np.zeros(3))
    points, is_on = canvas.points(some)
    assert is_on.all()
    assert np.abs(points - expected - np.abs(expected[:, :1]) * Y).max() < 1e-12

    half = replace(flat, triangles=flat.triangles[:1], uv=flat.uv[:1])
    _, is_on = canvas_of(PicturePlace("p", 3, 2, half), None, X).points(some)
    assert (is_on == (some[:, 1] <= some[:, 0])).all()


def divided(mesh, n=4):
    """The same rectangle of n x n quads."""
    at = np.linspace(0, 1, n + 1)
    u, v = (x.ravel() for x in np.meshgrid(at, at))
    low, *_ = mesh.vertices
    vertices = low + u[:, None] * (mesh.vertices[1] - low) + v[:, None] * (mesh.vertices[3] - low)
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (
        x.ravel() for x in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1])
    )
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    uv = np.stack([u, v], axis=1)[triangles]
    return replace(mesh, vertices=vertices, triangles=triangles, uv=uv)


@pytest.mark.parametrize("without", ["viewers", "glasses", "plates", "displays", "pictures"])
def test_an_incomplete_rig_is_sketched_as_far_as_it_goes(without):
    """Each part may be missing: what needs it is not there, all else is."""
    sketch = run_steps(sketching(replace(rig(SLAB), **{without: ()}), None))
    assert sketch.light.ways == ()
    assert np.isfinite(points_of(sketch)).all()
    states = {line.state for line in sketch.lines}
    assert ("aerial" in states) == (without not in {"plates", "displays"})
    n_dimensions = {"glasses": 1, "plates": 1, "displays": 1}
    assert len(sketch.dimensions) == n_dimensions.get(without, 2)


@pytest.mark.parametrize("part", ["glasses", "plates", "displays", "pictures"])
def test_numbers_that_are_none_are_not_drawn(part):
    """A part with a vertex at NaN is left out: all that is drawn is finite."""
    a_rig = rig(SLAB)
    (broken,) = getattr(a_rig, part)
    vertices = broken.mesh.vertices.copy()
    vertices[0, 0] = np.nan
    broken = replace(broken, mesh=replace(broken.mesh, vertices=vertices))
    sketch = run_steps(sketching(replace(a_rig, **{part: (broken,)}), None))
    assert np.isfinite(points_of(sketch)).all()
    assert len(sketch.lines)
