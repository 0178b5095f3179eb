"""Draw Light Paths: curves through the points where light meets surfaces, one object for each
outcome.
"""

from itertools import chain

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from extension import loaded
from known.closed_forms import through_slab, unit
from small_rigs import cube, inventory, new_object, primitive, small_rig
from test_operators_live import live, settle, turn  # noqa: F401, a fixture

SINGLE = 1e-6  # of the rig's size of half a metre: float32 in the points and in all matrices
GOLDEN = (5**0.5 - 1) / 2


def curves() -> dict[str, bpy.types.Object]:
    """The curve objects by the outcome in their names."""
    things = [thing for thing in bpy.context.scene.objects if thing.type == "CURVE"]
    return {thing.name.split(": ")[1]: thing for thing in things}


def lines(outcome: str) -> list[np.ndarray]:
    """The points (k, 3) of each path, in the world."""
    thing = curves()[outcome]
    place = np.array(thing.matrix_world)[:3, 3]
    return [np.array([p.co[:3] for p in one.points]) + place for one in thing.data.splines]


def all_lines() -> list[np.ndarray]:
    return [*chain(*map(lines, curves()))]


def frame(thing: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """The place (3,) and the axes (3, 3), in rows, of an object."""
    matrix = np.array(thing.matrix_world, float)
    return matrix[:3, 3], unit(matrix[:3, :3].T)


def to_plane(o: np.ndarray, d: np.ndarray, thing: bpy.types.Object) -> np.ndarray:
    """Where rays meet the plane of an object."""
    at, axes = frame(thing)
    return o + (((at - o) @ axes[2]) / (d @ axes[2]))[:, None] * d


def test_systems_without_glass_or_displays_have_paths(scene):
    """A screen lit by projectors has a size, too; all paths end on it."""
    bpy.ops.kiriko.add_rig(kind="CAKE")
    assert bpy.ops.kiriko.draw_light_paths(count=12) == {"FINISHED"}
    assert len(lines("Arrived")) == 12


def by_closed_form(rig: dict[str, bpy.types.Object], count: int, side: float) -> np.ndarray:
    """The paths (count, 5, 3) from the eye to a Fibonacci lattice on the picture, bent by the flat
    faces of an unturned cube, sent back by an ideal plate to the display's plane.
    """
    n = np.arange(count) + 0.5
    places = np.stack([n / count, n * GOLDEN % 1, np.full(count, 0.5)], axis=1) - 0.5
    sides = [*rig["PICTURE"].dimensions[:2], 0.0]
    at, axes = frame(rig["PICTURE"])
    eye, eyes = frame(bpy.context.scene.camera)
    d = unit(at + places * sides @ axes - eye)
    normal = np.round(eyes[2])  # of the face that the viewer is in front of
    o = np.tile(eye, (count, 1))
    near = o + ((side / 2 - o @ normal) / (d @ normal))[:, None] * d
    far, d = through_slab(o, d, normal, side / 2 * normal, side, 1.49)
    plate = to_plane(far, d, rig["PLATE"])
    across = frame(rig["PLATE"])[1][2]
    d = 2 * (d @ across)[:, None] * across - d
    return np.stack([o, near, far, plate, to_plane(plate, d, rig["DISPLAY"])], axis=1)


@pytest.mark.every_blender
@pytest.mark.parametrize("metres", [1.0, 0.001])
def test_points_are_those_of_a_slab_by_closed_form(scene, metres):
    """Eye, near face, far face, plate and display within 1e-6 of the rig's size, in the order of
    the lattice, in scenes of metres and millimetres.
    """
    scene.unit_settings.scale_length = metres
    side = 0.05 / metres
    glass = cube(side)
    glass.kiriko.use_ior, glass.kiriko.ior = True, 1.49
    bpy.ops.kiriko.add_rig(field=0.04 / metres, picture_size=0.02 / metres)
    rig = {thing.kiriko.role: thing for thing in scene.objects}
    assert bpy.ops.kiriko.draw_light_paths(count=30) == {"FINISHED"}
    expected = by_closed_form(rig, 30, side)
    found = np.array(lines("Arrived"))
    assert found.shape == expected.shape
    assert np.abs(found - expected).max() < SINGLE * 0.5 / metres
    assert len(all_lines()) == 30


def test_each_path_is_in_the_curve_of_its_reason(scene):
    """As traced: rays that arrive, those past a smaller display, and those that a wall blocks; a
    reason is in one outcome only. A pixel image's rays fill the viewer's frame.
    """
    rig = small_rig()
    rig["DISPLAY"].scale *= 0.6
    scene.kiriko.picture_source = "IMAGE"
    scene.kiriko.picture_image = bpy.data.images.new("own", 8, 8)
    wall = new_object(primitive("cube", size=0.012), "BLOCKER")
    wall.matrix_world = Matrix.Translation(rig["PLATE"].location + rig["GLASS"].location) @ (
        Matrix.Scale(0.5, 4)
    )
    bpy.context.view_layer.update()
    bpy.ops.kiriko.draw_light_paths(count=200)

    work, module = loaded("operators.work"), loaded("core.blender.result.light_path_curves")
    reasons = [*chain(*(reasons for _, reasons in module.OUTCOMES.values()))]
    assert sorted(reasons) == sorted(loaded("core.light.rays").Reason)
    plan = work.session().plan(work.read(bpy.context).rig, work.settings_of(scene))
    n = np.arange(200) + 0.5
    uv = np.stack([n / 200, 1 - n * GOLDEN % 1], axis=1)
    landings = loaded("core.light.trace").trace(plan, *plan.viewer.rays(uv * 64))
    for name, (_, reasons) in module.OUTCOMES.items():
        expected = np.isin(landings.reason, [*reasons]).sum()
        assert len(lines(name.split(": ")[1])) == expected
    assert min(len(lines("Arrived")), len(lines("Missed")), len(lines("Blocked"))) > 0


@pytest.mark.every_blender
def test_a_second_press_replaces_points_and_keeps_looks(scene):
    """No new datablocks; a material and a bevel by the artist stay, and so does the rig's image."""
    small_rig()
    bpy.ops.kiriko.draw_light_paths(count=10)
    thing = curves()["Arrived"]
    thing.data.bevel_depth = 0.002
    thing.data.materials[0] = bpy.data.materials.new("Mine")
    before = {**inventory(), "curves": [*bpy.data.curves]}
    bpy.ops.kiriko.draw_light_paths(count=20)
    assert {**inventory(), "curves": [*bpy.data.curves]} == before
    assert len(all_lines()) == 20
    assert thing.data.bevel_depth == pytest.approx(0.002)
    assert thing.active_material.name == "Mine"

    bpy.data.objects.remove(curves()["Missed"])
    bpy.ops.kiriko.draw_light_paths(count=20)
    assert len(curves()) == 4


@pytest.mark.every_blender
def test_live_updates_drawn_paths_only(live):  # noqa: F811
    """After the glass was turned and the display moved, they are those of a new press; Live draws
    none by itself, and leaves deleted curves deleted.
    """
    rig = small_rig()
    bpy.ops.kiriko.live()
    settle(live)
    assert not curves()
    bpy.ops.kiriko.draw_light_paths(count=12)
    bpy.data.objects.remove(curves()["Blocked"])
    before = all_lines()
    turn(rig["GLASS"], 0.05)
    rig["DISPLAY"].location.z -= 0.01
    settle(live)
    followed = all_lines()
    assert (len(curves()), len(followed)) == (3, 12)
    bpy.ops.kiriko.draw_light_paths(count=12)
    assert all(np.array_equal(a, b) for a, b in zip(followed, all_lines(), strict=True))
    assert np.abs(followed[0][-1] - before[0][-1]).max() > 0.005


def test_kiriko_does_not_see_them(scene, look, read):
    """The rig, its checklist and the preview are the same with drawn paths: none of them is a part,
    a possible glass or in the surroundings.
    """
    small_rig()
    bpy.ops.kiriko.solve()
    prints = loaded("operators.work").rig_now
    before, listed = prints(bpy.context).as_text(), [str(entry.text) for entry in look()]
    bpy.ops.kiriko.draw_light_paths()
    assert prints(bpy.context).as_text() == before
    assert [str(entry.text) for entry in look()] == listed
    preview = loaded("core.blender.preview.cycles_preview").Preview
    with preview(scene, read(), scene.kiriko.result.source, surroundings=True) as made:
        assert not [thing for thing in made.scene.objects if thing.type == "CURVE"]


@pytest.mark.every_blender
def test_remove_rig_and_undo_leave_nothing(scene):
    """Objects, curves and materials go with the rig, and by one undo."""
    small_rig()
    bpy.ops.ed.undo_push(message="rig")
    before = inventory()
    bpy.ops.kiriko.draw_light_paths("EXEC_DEFAULT", True)
    assert len(curves()) == 4 == len(bpy.data.curves)
    bpy.ops.ed.undo()
    assert inventory() == before
    assert not bpy.data.curves

    bpy.ops.kiriko.draw_light_paths()
    bpy.ops.kiriko.remove_rig()
    assert [thing.name for thing in bpy.context.scene.objects] == ["Cube"]
    assert not [*bpy.data.curves, *bpy.data.materials]


def test_a_refusal_is_one_sentence(scene):
    """Without a rig, without a viewer, with a picture behind the viewer: nothing is drawn."""
    for damage, words in (
        (lambda: bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True), "No "),
        (lambda: bpy.data.objects.remove(bpy.context.scene.camera), "No viewer: "),
        (lambda: bpy.context.scene.camera.rotation_euler.rotate_axis("X", np.pi), "turn it"),
    ):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        small_rig()
        damage()
        bpy.context.view_layer.update()
        with pytest.raises(RuntimeError, match=words) as refused:
            bpy.ops.kiriko.draw_light_paths()
        assert str(refused.value).strip().count("\n") == 0
        assert not bpy.data.curves
