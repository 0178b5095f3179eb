"""The eye box by its button: numbers as core has them, a surface through the six ends."""

from collections import Counter
from dataclasses import asdict

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import inventory, small_rig

NAME = "Kiriko Eye Box"
WAYS = ("left", "right", "up", "down", "nearer", "farther")


@pytest.fixture(autouse=True)
def few_points(kiriko, monkeypatch):
    """Nine points of the picture are looked at."""
    monkeypatch.setattr(loaded("core.lab.measure.head_range"), "N_POINTS", 3)


def kept() -> dict:
    return loaded("operators.eye_box").box_of(bpy.data.objects[NAME])


def by_core(limit: float, least: float) -> dict:
    """The eye box of the scene as core finds it, of a rig that nothing is known of."""
    work = loaded("operators.work")
    rig = work.read(bpy.context).rig
    steps = loaded("core.lab.measure.head_range").eye_box(
        rig, work.settings_of(bpy.context.scene), limit, least
    )
    return asdict(loaded("core.base.steps").run_steps(steps))


def points_of(thing: bpy.types.Object, camera: bpy.types.Object) -> np.ndarray:
    """The points of the surface to the right, up and forward of a camera, Blender units."""
    points = np.array([thing.matrix_world @ v.co for v in thing.data.vertices])
    matrix = np.array(camera.matrix_world)
    return (points - matrix[:3, 3]) @ matrix[:3, :3] * [1, 1, -1]


def test_its_numbers_are_those_of_core(scene):
    """In metres, at the default limit and at another, whatever the scene's unit."""
    small_rig()
    assert bpy.ops.kiriko.eye_box() == {"FINISHED"}
    expected = by_core(5.0, 0.98)
    found = kept()
    for name in WAYS:
        assert found[name] == pytest.approx(expected[name], rel=1e-9), name
    assert found["limit"] == pytest.approx(5.0)
    assert found["is_open"] == list(expected["is_open"])
    assert found["viewer"] == scene.camera.name

    bpy.ops.kiriko.eye_box(limit=0.5, share=0.75)
    expected = by_core(0.5, 0.75)
    narrow = kept()
    for name in WAYS:
        assert narrow[name] == pytest.approx(expected[name], rel=1e-9), name
    assert narrow["left"] < found["left"]


def test_its_surface_is_closed_and_goes_through_the_six_ends(scene):
    """Each octant has its own half axes; open ends are drawn as far as the picture is away."""
    parts = small_rig()
    bpy.ops.kiriko.eye_box(limit=0.5)
    thing, found = bpy.data.objects[NAME], kept()
    ends = [found[name] for name in WAYS]
    camera = scene.camera
    away = (parts["PICTURE"].matrix_world.translation - camera.matrix_world.translation).length
    left, right, up, down, nearer, farther = (
        min(end, away) if is_open else end
        for end, is_open in zip(ends, found["is_open"], strict=True)
    )
    points = points_of(thing, camera)
    size = max(left, right, up, down, nearer, farther)
    assert points.max(axis=0) == pytest.approx([right, up, nearer], abs=1e-5 * size)
    assert points.min(axis=0) == pytest.approx([-left, -down, -farther], abs=1e-5 * size)
    axes = np.where(points > 0, [right, up, nearer], [left, down, farther])
    assert ((points / axes) ** 2).sum(axis=1) == pytest.approx(np.ones(len(points)), abs=1e-3)

    # closed, and looking outward
    n_faces = Counter(key for face in thing.data.polygons for key in face.edge_keys)
    assert set(n_faces.values()) == {2}
    inside = thing.matrix_world.inverted() @ camera.matrix_world.translation
    assert all(face.normal.dot(face.center - inside) > -1e-6 * size for face in thing.data.polygons)
    assert thing.hide_render
    assert thing.kiriko.role == "NONE"


def test_its_colours_tell_how_far_off_the_picture_is(scene):
    """At the ends it is off by the limit at the most, and nowhere by more than twice as much is
    told.
    """
    small_rig()
    bpy.ops.kiriko.eye_box(limit=0.5)
    thing, found = bpy.data.objects[NAME], kept()
    off = np.empty(len(thing.data.vertices), np.float32)
    thing.data.attributes["displacement"].data.foreach_get("value", off)
    assert off.min() >= 0
    assert off.max() <= 1.0 + 1e-6

    points = points_of(thing, scene.camera)
    for n, name in enumerate(("left", "down", "farther", "right", "up", "nearer")):
        axis, sign = n % 3, -1 if n < 3 else 1
        at_end = off[np.argmax(sign * points[:, axis])]
        assert at_end <= 0.5 * (1 + 1e-6), name
        if not found["is_open"][WAYS.index(name)]:
            assert at_end > 0.25, name


def test_it_is_told_in_the_scenes_unit_and_in_the_panel(scene, drawn):
    """Six lengths in mm, in the panel, too; open ways are told to be so."""
    small_rig()
    scene.unit_settings.length_unit = "MILLIMETERS"
    bpy.ops.kiriko.eye_box()
    found = kept()
    ways = loaded("operators.eye_box").ways_in_words(scene, found)
    assert all(" mm" in way for way in ways)
    left = float(f"{1e3 * found['left']:.3g}")
    assert str(ways[0]).startswith(f"{left:g} mm")
    assert sum(str(way).count("over ") for way in ways) == sum(found["is_open"])
    text = " ".join(drawn("viewers_panel", "VIEW3D_PT_kiriko_viewers").texts)
    for way in ways:
        assert str(way) in text
    bpy.ops.kiriko.remove_eye_box()


def test_it_is_made_anew_in_place_and_removed_with_its_mesh(scene):
    """A second one takes the first one's place; then the scene is as it was before."""
    small_rig()
    bare = inventory()
    with pytest.raises(RuntimeError, match="There is nothing to apply or remove"):
        bpy.ops.kiriko.remove_eye_box()
    bpy.ops.kiriko.eye_box()
    before = inventory()
    bpy.ops.kiriko.eye_box(limit=1.0)
    assert inventory() == before != bare
    assert kept()["limit"] == 1.0
    assert bpy.ops.kiriko.remove_eye_box() == {"FINISHED"}
    assert inventory() == bare


def test_where_there_is_none_one_sentence_tells_why(scene, monkeypatch):
    """An orthographic viewer, a picture in its own pixels, a dark display, viewers apart: nothing
    is made, and no way is walked.
    """
    walk = loaded("core.lab.measure.head_range").Walk
    monkeypatch.setattr(walk, "farthest", None)
    parts = small_rig()
    before = inventory()
    camera = scene.camera.data
    camera.type = "ORTHO"
    with pytest.raises(RuntimeError, match="is orthographic"):
        bpy.ops.kiriko.eye_box()
    camera.type = "PERSP"

    scene.kiriko.picture_source = "IMAGE"
    scene.kiriko.picture_image = bpy.data.images["Kiriko Lattice"]
    with pytest.raises(RuntimeError, match="use a picture plane"):
        bpy.ops.kiriko.eye_box()
    scene.kiriko.picture_source = "PLANE"
    assert inventory() == before

    place = parts["DISPLAY"].location.copy()
    parts["DISPLAY"].location = place * 50
    with pytest.raises(RuntimeError, match="can't see the picture"):
        bpy.ops.kiriko.eye_box()
    parts["DISPLAY"].location = place
    assert inventory() == before

    with pytest.raises(RuntimeError, match="Limit nan: set it above 0"):
        bpy.ops.kiriko.eye_box(limit=float("nan"))
    with pytest.raises(RuntimeError, match="Share nan: set it from 0 to 1"):
        bpy.ops.kiriko.eye_box(share=float("nan"))
    assert inventory() == before

    bpy.ops.kiriko.two_eyes()
    with pytest.raises(RuntimeError, match=r"more than 0\.001 arcmin off"):
        bpy.ops.kiriko.eye_box(limit=1e-3)


def test_of_several_viewers_it_tells_how_their_box_is_served(scene, drawn):
    """The numbers of core in the panel's words, whatever curves a report draws; nothing of them
    where there is one viewer, or all are at one place.
    """
    small_rig()
    bpy.ops.kiriko.eye_box()
    room = loaded("operators.eye_box")
    assert room.served_in_words(kept()) == []
    lines = " ".join(drawn("viewers_panel", "VIEW3D_PT_kiriko_viewers").texts)
    assert "box of" not in lines

    bpy.ops.kiriko.two_eyes()
    bpy.ops.kiriko.eye_box()
    work = loaded("operators.work")
    plan = work.session().plan(work.read(bpy.context).rig, work.settings_of(scene))
    found = loaded("core.base.steps").run_steps(loaded("core.lab.measure.head_box").head_box(plan))
    served = kept()["head_box"]
    assert served["n_viewers"] == 2
    assert served["size_m"] == pytest.approx(found.size_m, abs=1e-9)
    for way in ("for_all", "for_middle"):
        assert "curves" not in served[way]
        for name, value in served[way].items():
            assert value == pytest.approx(getattr(getattr(found, way), name), abs=1e-9), name
    lines = " ".join(drawn("viewers_panel", "VIEW3D_PT_kiriko_viewers").texts)
    number = loaded("core.base.numbers").number
    everyone = served["for_all"]
    assert (
        f"In the box of 2 viewers the error is {number(everyone['mean_arcmin'])} arcmin on average,"
        f" {number(everyone['largest_arcmin'])} at most."
    ) in lines
    assert "Solved for its centre only:" in lines
    assert "At the centre the error is" in lines
    assert "if solved for it only" in lines

    first = scene.kiriko.viewers[1].camera
    scene.kiriko.viewers[2].camera.matrix_world = first.matrix_world
    bpy.context.view_layer.update()
    bpy.ops.kiriko.eye_box()
    assert "head_box" not in kept()
