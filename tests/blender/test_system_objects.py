"""Add Rig > More: the rigs of the field's systems as objects."""

from dataclasses import fields, replace
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest

from extension import loaded
from kiriko.core.bench.systems import SYSTEMS
from small_rigs import cube, inventory, new_object

SINGLE = 1e-6  # of a part's size: float32 in a mesh and in its object's matrix


@pytest.fixture
def systems(core) -> ModuleType:
    """The table, as the extension has it."""
    return loaded("core.bench.systems")


def add(kind: str, **options: object) -> None:
    assert bpy.ops.kiriko.add_rig(kind=kind, **options) == {"FINISHED"}
    bpy.context.view_layer.update()


def rig_of(core: ModuleType) -> Any:
    return core.blender.read.scene.read(bpy.context).rig


def assert_same_parts(found: Any, expected: Any) -> None:
    """Names, meshes to float32, and all numbers; cameras by their rays."""
    found, expected = list(found.parts()), list(expected.parts())
    assert [role.name for role, _ in found] == [role.name for role, _ in expected]
    for (role, ours), (_, theirs) in zip(found, expected, strict=True):
        assert ours.name == f"Kiriko {theirs.name}"
        if hasattr(theirs, "window"):
            assert (ours.width, ours.height) == (theirs.width, theirs.height)
            xy = np.random.default_rng(0).uniform(0, ours.width, (99, 2))
            for one, other in zip(ours.rays(xy), theirs.rays(xy), strict=True):
                np.testing.assert_allclose(one, other, atol=SINGLE * (1 + np.abs(other).max()))
            continue
        assert_same_mesh(ours.mesh, theirs.mesh)
        ours = ours.place if role.name == "PICTURE" else ours
        for field in fields(theirs):
            # the mirrors' frame, which landings compare, is that of the object
            if field.name not in {"name", "mesh", "side", "centre"}:
                assert_same(getattr(ours, field.name), getattr(theirs, field.name), field.name)


def assert_same(one: Any, other: Any, name: str) -> None:
    """Numbers to float32, also those of a record; the rest as it is."""
    if hasattr(other, "__dataclass_fields__"):
        for field in fields(other):
            assert_same(getattr(one, field.name), getattr(other, field.name), field.name)
    elif isinstance(other, float | tuple):
        np.testing.assert_allclose(one, other, rtol=SINGLE, atol=1e-12, err_msg=name)
    else:
        assert one == other, name


def assert_same_mesh(ours: Any, theirs: Any) -> None:
    size = np.ptp(theirs.bounds, axis=0).max() + np.abs(theirs.bounds).max()
    np.testing.assert_allclose(ours.corners, theirs.corners, rtol=0, atol=SINGLE * size)
    assert (ours.is_smooth is None) == (theirs.is_smooth is None)
    assert ours.has_mean_normals == theirs.has_mean_normals
    if theirs.corner_normals is not None:
        # those of a closed surface, which Blender averages: they only mark a smooth one
        assert (ours.corner_normals * theirs.corner_normals).sum(axis=-1).min() > 0.999
        assert (ours.is_smooth == theirs.is_smooth).all()
    if ours.uv is not None:
        np.testing.assert_allclose(ours.uv, theirs.uv, atol=SINGLE)


@pytest.mark.every_blender
@pytest.mark.parametrize("kind", SYSTEMS)
def test_objects_are_the_parts_and_solve(core, systems, scene, kind):
    """Read from Blender, each system is the rig of the table: meshes, numbers, rays of the viewer,
    landings to a hundredth of a pixel. It solves.
    """
    expected = systems.SYSTEMS[kind].make()
    add(kind)
    found = rig_of(core)
    assert_same_parts(found, expected)

    settings = core.rig.settings.Settings(only_through_glass=bool(expected.glasses))
    o, d = expected.viewer.rays(np.random.default_rng(1).uniform(0, 512, (4000, 2)))
    ours, theirs = (
        core.light.rays.main_landings(
            core.light.trace.trace_all(core.light.compile_plan.compile_plan(one, settings), o, d),
            len(o),
        )
        for one in (found, expected)
    )
    both = ours.has_arrived & theirs.has_arrived
    assert theirs.has_arrived.mean() > 0.2
    assert (ours.has_arrived == theirs.has_arrived).mean() > 0.999
    apart = np.linalg.norm(ours.xy - theirs.xy, axis=1)[both]
    assert np.quantile(apart, 0.99) < 0.01

    for thing in scene.objects:
        thing.kiriko.resolution = [max(n // 8, 1) for n in thing.kiriko.resolution]
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    assert scene.kiriko.result.coverage > 0.5


# display px, 99 % of the light: Cycles meets fine triangles of a curved surface
CURVED = {"ANAMORPHOSIS": 0.25, "I_BALL": 0.1, "DCRA": 0.1, "RADIAL_DCRA": 0.1}


@pytest.mark.parametrize("kind", SYSTEMS)
def test_cycles_follows_the_same_light(core, scene, kind):
    """With a sample a pixel Cycles chooses a path wherever light splits, as often as it is bright;
    each that arrives lands where Kiriko's does, to 0.01 display px. Plates are ideal.
    """
    add(kind)
    for thing in scene.objects:
        thing.kiriko.plate.model = "IDEAL"
    scene.kiriko.viewer.kiriko.resolution = (128, 128)
    reading = core.blender.read.scene.read(bpy.context)
    found = core.blender.preview.cycles_preview.render_map(scene, reading)
    size = core.rig.joined_display.size_of(core.rig.joined_display.sections_of(reading.rig.outputs))
    ours = main_light(core, reading.rig)
    xy = ours.xy.reshape(128, 128, 2)
    has_arrived = ours.has_arrived.reshape(128, 128)

    by_cycles = found[..., 2] > 0.5
    both = by_cycles & has_arrived
    uv = found[..., :2] * [1, -1] + [0, 1]
    apart = np.abs(uv * size - xy)[both].max(axis=1)
    assert np.quantile(apart, 0.99) < CURVED.get(kind, 0.01)

    share = np.where(ours.has_arrived, ours.throughput, 0.0).mean()
    noise = np.sqrt(share * (1 - share) / has_arrived.size)
    splits = any(part.splits for _, part in reading.rig.parts())
    if not reading.rig.is_polarised:  # Cycles has no polarisation
        # a ray along the common edge of two triangles meets a portal twice
        assert by_cycles.mean() == pytest.approx(share, abs=4 * noise if splits else 0.01)
    assert (by_cycles & ~has_arrived).mean() < 0.002


def main_light(core: ModuleType, rig: Any) -> Any:
    """The main landings of the centres of the viewer's pixels, all light followed."""
    eye = rig.viewer
    x, y = np.meshgrid(np.arange(eye.width) + 0.5, np.arange(eye.height) + 0.5)
    o, d = eye.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    settings = core.rig.settings.Settings(only_through_glass=False, only_through_plate=False)
    plan = core.light.compile_plan.compile_plan(rig, settings)
    return core.light.rays.main_landings(core.light.trace.trace_all(plan, o, d), len(o))


def test_light_that_a_half_mirror_absorbs_is_missing_in_cycles(core, scene):
    """A white display by way of a reflection and a passage: their shares' product."""
    add("AIRR")
    (pane,) = (thing for thing in scene.objects if thing.kiriko.role == "HALF_MIRROR")
    pane.kiriko.element.reflectance, pane.kiriko.element.absorption = 0.5, 0.2
    scene.kiriko.viewer.kiriko.resolution = (32, 32)
    reading = core.blender.read.scene.read(bpy.context)
    white = np.ones((4, 4, 3), np.float32)
    seen = core.blender.preview.cycles_preview.render_preview(scene, reading, white, samples=64)
    assert seen[..., :3].mean() == pytest.approx(0.5 * 0.3, abs=0.005)


def test_other_rigs_are_made_too(core, systems, scene):
    """Two viewers, off-axis and orthographic, with weights; a plate whose mirrors are turned and
    out of the middle; a picture in the viewer's pixels.
    """
    rig = core.rig.rig
    base = systems.SYSTEMS["DCRA"].make()
    (plate,), eye = base.plates, base.viewer
    turned = replace(
        plate,
        side=np.array([1.0, 1.0, 1.0]),
        centre=plate.mesh.bounds.mean(axis=0) + np.array([0.03, 0.01, 0.01]),
        array=replace(plate.array, phase=(0.25, 0.5)),
    )
    shifted = replace(eye, name="Left", window=(-0.02, 0.05, -0.01, 0.025), width=200, height=100)
    flat = replace(
        eye, name="Flat", projection="orthographic", weight=2.0,
        window=(-0.03, 0.03, -0.05, 0.07), width=50, height=100,
    )  # fmt: skip
    own = rig.PicturePlace("own", 1024, 1024)
    expected = replace(base, viewers=(shifted, flat), plates=(turned,), pictures=(own,))
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 1e-3
    loaded("core.blender.lifecycle.rig_from_parts").make_rig_from(scene, expected)
    found = rig_of(core)
    assert found.place_of(found.viewer).mesh is None
    assert_same_parts(replace(found, pictures=()), replace(expected, pictures=()))
    ours, theirs = (
        core.light.plate.array_frame(one.plates[0], np.array([0, -1, 1]) / np.sqrt(2))
        for one in (found, expected)
    )
    np.testing.assert_allclose(ours.centre, theirs.centre, atol=SINGLE)
    np.testing.assert_allclose(ours.axes, theirs.axes, atol=SINGLE)


def test_scale_and_the_3d_cursor_place_the_whole_rig(core, systems, scene):
    """Twice the lengths about the cursor, in any unit; lands as before."""
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 0.1
    scene.cursor.location = (3, -2, 1)
    add("I_BALL", scale=2.0)
    found, base = rig_of(core), systems.SYSTEMS["I_BALL"].make()
    assert found.lenses[0].focal_length == pytest.approx(2 * base.lenses[0].focal_length)
    for (_, ours), (_, theirs) in zip(found.parts(), base.parts(), strict=True):
        if ours.name != "Kiriko Viewer":
            expected = 2 * theirs.mesh.bounds + [0.3, -0.2, 0.1]
            np.testing.assert_allclose(ours.mesh.bounds, expected, atol=1e-6)
    assert_same_parts(found, systems.placed(base, 2.0, np.array([0.3, -0.2, 0.1])))


def test_remove_rig_takes_all_of_it_away(scene):
    """Selected glass is left alone, and after Remove Rig the file holds what it held before."""
    glass = cube()
    before = inventory()
    for kind in SYSTEMS:
        add(kind)
        assert glass.kiriko.role == "NONE"
        assert scene.kiriko.viewer is not None
        assert scene.kiriko.only_through_glass == any(
            thing.kiriko.role == "GLASS" for thing in scene.objects
        )
        assert bpy.ops.kiriko.remove_rig() == {"FINISHED"}
        assert inventory() == before


@pytest.mark.parametrize("kind", ["AIRR", "DCRA", "CAKE"])
def test_its_display_or_screen_is_selected(scene, kind):
    """Alone and active; there is no glass of the artist to set up."""
    add(kind)
    rig = loaded("core.blender.data.rigs").active_rig(scene)
    loaded("operators.add_rig")._show(bpy.context, rig, ())
    role = "SCREEN" if kind == "CAKE" else "DISPLAY"
    assert bpy.context.view_layer.objects.active.kiriko.role == role
    assert len(bpy.context.selected_objects) == 1


def test_a_failure_leaves_nothing(scene, monkeypatch):
    """An error at the last object removes the others; the sentence names no traceback."""
    before = inventory()
    module = loaded("core.blender.lifecycle.rig_from_parts")

    def fail(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(module, "make_viewer", fail)
    with pytest.raises(RuntimeError, match="ran out of memory"):
        bpy.ops.kiriko.add_rig(kind="AIRR")
    assert inventory() == before
    assert scene.kiriko_scene.rig is None


def test_a_display_outside_all_rigs_is_refused(scene):
    """It would be a part of the new rig."""
    new_object(bpy.data.meshes.new("mesh"), "DISPLAY")
    with pytest.raises(RuntimeError, match="The scene already has a display"):
        bpy.ops.kiriko.add_rig(kind="PEPPER")


def test_parts_with_several_displays_solve_at_once(core, scene):
    """Two systems in a scene are two rigs; the newest is active."""
    add("PEPPER")
    add("P_CUBEE")
    assert len(rig_of(core).displays) == 5
    assert len(loaded("core.blender.data.rigs").rigs(scene)) == 2
