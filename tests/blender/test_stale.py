"""A result knows the scene it was solved for, and says when that is another one."""

import json
from collections.abc import Callable, Iterator
from types import ModuleType

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import new_object, primitive, small_rig

pytestmark = pytest.mark.usefixtures("no_remedies")

CHANGED = "The scene has changed"


@pytest.fixture
def watch(scene, kiriko, monkeypatch) -> Iterator[ModuleType]:
    """Module operators.watch, which does not wait for quiet.

    Nothing is followed by Live before and after.
    """
    module = loaded("operators.watch")
    monkeypatch.setattr(module, "QUIET", 0.0)
    monkeypatch.setattr(module, "SHARE", 0.0)
    monkeypatch.setattr(module.chosen, "POLLING", 0.0)
    surfaces = loaded("operators.outdated_surfaces")
    monkeypatch.setattr(surfaces, "PAUSE", 0.0)
    surfaces.forget()
    yield module
    kiriko.operators.live.stop()


@pytest.fixture
def rig(watch, scene) -> dict[str, bpy.types.Object]:
    """A rig that was solved; the objects by role."""
    rig = small_rig()
    mesh = primitive("uvsphere", u_segments=16, v_segments=8, radius=0.025)
    mesh.shade_smooth()
    rig["GLASS"].data = mesh
    bpy.ops.kiriko.solve()
    return rig


def is_stale(watch: ModuleType) -> bool:
    """By a fresh look, and by the timer, which have to agree."""
    found = watch.has_changed(bpy.context)
    watch.tick()
    assert watch.is_reported_changed(bpy.context.scene) == found
    return found


def move(thing: bpy.types.Object) -> None:
    thing.location.x += 1e-5


def edit(thing: bpy.types.Object) -> None:
    thing.data.vertices[3].co.z *= 1.001
    thing.data.update()


def paint(rig: dict[str, bpy.types.Object]) -> None:
    image = bpy.data.images["Kiriko Lattice"]
    numbers = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(numbers)
    numbers[400:404] = 0.25
    image.pixels.foreach_set(numbers)
    image.update()
    image.update_tag()


def refract(rig: dict[str, bpy.types.Object]) -> None:
    rig["GLASS"].kiriko.ior += 0.001


def turn_smooth(rig: dict[str, bpy.types.Object]) -> None:
    rig["GLASS"].kiriko.surface = "FACETS"


def add_viewer(rig: dict[str, bpy.types.Object]) -> None:
    new = ours().viewer.copy()
    new.location.x += 0.001
    bpy.context.scene.collection.objects.link(new)
    bpy.context.view_layer.objects.active = new
    bpy.ops.kiriko.add_viewer()


def ours() -> bpy.types.PropertyGroup:
    return bpy.context.scene.kiriko


COUNT: dict[str, Callable[[dict[str, bpy.types.Object]], object]] = {
    "glass moved": lambda rig: move(rig["GLASS"]),
    "plate moved": lambda rig: move(rig["PLATE"]),
    "display moved": lambda rig: move(rig["DISPLAY"]),
    "picture moved": lambda rig: move(rig["PICTURE"]),
    "viewer moved": lambda rig: move(ours().viewer),
    "glass scaled": lambda rig: setattr(rig["GLASS"], "scale", (1, 1, 1.001)),
    "mesh edited": lambda rig: edit(rig["GLASS"]),
    "surface as drawn": turn_smooth,
    "modifier": lambda rig: rig["GLASS"].modifiers.new("s", "SUBSURF"),
    "index": refract,
    "Abbe number": lambda rig: setattr(rig["GLASS"].kiriko, "dispersion", "ABBE"),
    "tint": lambda rig: setattr(rig["GLASS"].kiriko, "use_tint", True),
    "catalogued dispersion": lambda rig: setattr(rig["GLASS"].kiriko, "dispersion", "N-SF11"),
    "primaries": lambda rig: setattr(rig["DISPLAY"].kiriko.display, "primaries", "P3"),
    "priority": lambda rig: setattr(rig["GLASS"].kiriko, "priority", 3),
    "mirrors": lambda rig: setattr(rig["PLATE"].kiriko.plate, "model", "CROSSED"),
    "pixels of the picture": paint,
    "views of the display": lambda rig: setattr(rig["DISPLAY"].kiriko.views, "use", True),
    "resolution of the display": lambda rig: setattr(rig["DISPLAY"].kiriko, "resolution", (64, 65)),
    "resolution of the viewer": lambda rig: setattr(ours().viewer.kiriko, "resolution", (65, 64)),
    "another viewer": add_viewer,
    "disagreement": lambda rig: setattr(ours(), "disagreement", "BLENDED"),
    "lens": lambda rig: setattr(ours().viewer.data, "lens", ours().viewer.data.lens * 1.001),
    "tolerance": lambda rig: setattr(ours(), "tolerance", 0.2),
    "max events": lambda rig: setattr(ours(), "max_events", 31),
    "effort": lambda rig: setattr(ours(), "effort", 25),
    "margin": lambda rig: setattr(ours(), "margin", 1),
    "brightness": lambda rig: setattr(ours(), "brightness", True),
    "sharpen": lambda rig: setattr(ours(), "sharpen", True),
    "glare": lambda rig: setattr(ours(), "suppress_glare", 0.5),
    "ghosts": lambda rig: setattr(ours(), "ghosts", "STRONGEST"),
    "through glass": lambda rig: setattr(ours(), "only_through_glass", False),
    "through plate": lambda rig: setattr(ours(), "only_through_plate", False),
    "picture brightness": lambda rig: setattr(rig["PICTURE"].kiriko.picture, "brightness", 0.9),
    "picture gamma": lambda rig: setattr(rig["PICTURE"].kiriko.picture, "gamma", 1.1),
    "picture black level": lambda rig: setattr(rig["PICTURE"].kiriko.picture, "black_level", 0.1),
    "black level": lambda rig: setattr(rig["DISPLAY"].kiriko.display, "black_level", 0.01),
    "polarised display": lambda rig: setattr(rig["DISPLAY"].kiriko.element, "is_polarised", True),
    "offset": lambda rig: setattr(ours().calibration, "offset", '[{"Cube: shift x": 0.1}]'),
    "role": lambda rig: setattr(rig["PLATE"].kiriko, "role", "MIRROR"),
    "new part": lambda rig: setattr(
        new_object(rig["PLATE"].data, "BLOCKER"), "location", (9, 9, 9)
    ),
    "hidden in the viewport": lambda rig: setattr(rig["GLASS"], "hide_viewport", True),
    "hidden in renders": lambda rig: setattr(rig["GLASS"], "hide_render", True),
    "deleted": lambda rig: bpy.data.objects.remove(rig["GLASS"]),
    "unit": lambda rig: setattr(bpy.context.scene.unit_settings, "scale_length", 0.5),
}


@pytest.mark.parametrize("change", COUNT.values(), ids=COUNT)
def test_what_changes_the_source_image_counts(watch, rig, change):
    """After it the result is that of another scene, and says so."""
    assert not is_stale(watch)
    change(rig)
    bpy.context.view_layer.update()
    assert is_stale(watch)


ELEMENTS = (
    ("AIRR", "HALF_MIRROR", "reflectance", 0.45),
    ("AIRR", "HALF_MIRROR", "absorption", 0.1),
    ("AIRR", "HALF_MIRROR", "prefers", "REFLECTED"),
    ("AIRR", "HALF_MIRROR", "polarising", True),
    ("AIRR", "DISPLAY", "is_polarised", True),
    ("ENCHANTABLE", "GLASS", "reflects", False),
    ("EYEPIECE", "LENS", "focal_length", 51.0),
    ("KOIZUMI_SANO", "POLARISER", "angle", 0.3),
    ("KOIZUMI_SANO", "POLARISER", "extinction", 0.01),
    ("AIRR_POLARISED", "WAVE_PLATE", "retardance", 0.3),
)


@pytest.mark.parametrize(("kind", "role", "name", "value"), ELEMENTS, ids=lambda v: str(v))
def test_numbers_of_elements_count(watch, scene, kind, role, name, value):
    """Those of half mirrors, lenses, films, glass that reflects and polarised displays."""
    bpy.ops.kiriko.add_rig(kind=kind)
    for thing in scene.objects:
        thing.kiriko.resolution = (32, 32)
    bpy.ops.kiriko.solve()
    assert not is_stale(watch)
    part = next(thing for thing in scene.objects if thing.kiriko.role == role)
    assert getattr(part.kiriko.element, name) != value
    setattr(part.kiriko.element, name, value)
    assert is_stale(watch)


def add_light(rig: dict[str, bpy.types.Object]) -> None:
    new_object(bpy.data.lights.new("l", "POINT"))


def select(rig: dict[str, bpy.types.Object]) -> None:
    rig["GLASS"].select_set(False)
    bpy.context.view_layer.objects.active = rig["PLATE"]


def export(rig: dict[str, bpy.types.Object]) -> None:
    ours().export_path = "//other.exr"
    ours().export_format = "EXR_HALF"
    ours().report_folder = "//elsewhere"
    ours().calibration.columns = 9


DO_NOT_COUNT: dict[str, Callable[[dict[str, bpy.types.Object]], object]] = {
    "settings of the export": export,
    "selecting": select,
    "light": add_light,
    "frame": lambda rig: bpy.context.scene.frame_set(7),
    "other name": lambda rig: setattr(rig["GLASS"], "name", "Aardvark"),
    "material's colour": lambda rig: rig["GLASS"].data.materials.append(
        bpy.data.materials.new("m")
    ),
    "simulation": lambda rig: bpy.ops.kiriko.simulate(samples=2),
    "preview": lambda rig: bpy.ops.kiriko.preview(samples=1, percentage=10),
    "another solve": lambda rig: bpy.ops.kiriko.solve(),
    "no role": lambda rig: new_object(rig["GLASS"].data),
}


@pytest.mark.parametrize("change", DO_NOT_COUNT.values(), ids=DO_NOT_COUNT)
def test_what_leaves_the_source_image_as_it_is_does_not_count(watch, rig, change):
    """The result stays that of the scene."""
    change(rig)
    bpy.context.view_layer.update()
    assert not is_stale(watch)


SURFACES = {"visible_range": "Kiriko Visible Range", "eye_box": "Kiriko Eye Box"}
OUTDATED = " (outdated)"


@pytest.fixture
def surface(watch, kiriko, monkeypatch) -> Callable[[str], dict[str, bpy.types.Object]]:
    """Make a surface of a rig that was never solved; the objects by role."""
    eye_box = loaded("core.lab.measure.head_range")
    monkeypatch.setattr(eye_box, "N_POINTS", 3)

    def make(name: str) -> dict[str, bpy.types.Object]:
        rig = small_rig(viewer_resolution=32, display_resolution=(32, 32))
        getattr(bpy.ops.kiriko, name)()
        return rig

    return make


@pytest.mark.parametrize("name", SURFACES)
def test_a_surface_tells_that_it_is_of_the_rig_as_it_was(
    watch, surface, kiriko, drawn, tmp_path, name
):
    """In the panel and in its legend, without a result; moved back, it is of the rig again. What
    is painted does not count; a file that was saved knows; made anew, it is of the rig.
    """
    range_view = loaded("panels.range_view")
    legend = next(one for one in range_view.SURFACES if one.name == SURFACES[name])
    label = {"visible_range": "Visible Range", "eye_box": "Eye Box"}[name]
    words = f"{label} is outdated"

    def is_old() -> bool:
        bpy.context.view_layer.update()
        watch.tick()
        found = watch.is_reported_outdated(bpy.context.scene, SURFACES[name])
        assert (OUTDATED in range_view.heading_of(bpy.context.scene, legend)) == found
        return found

    def is_in_panel() -> bool:
        return words in " ".join(drawn("viewers_panel", "VIEW3D_PT_kiriko_viewers").texts)

    rig = surface(name)
    assert not is_old()
    paint(rig)
    ours().margin = 2
    ours().disagreement = "BLENDED"
    assert not is_old()
    assert not is_in_panel()
    for owner, setting, value in (
        (rig["GLASS"], "location", (0.001, 0.0, 0.0)),
        (rig["GLASS"].kiriko, "ior", 1.6),
        (ours(), "max_events", 31),
    ):
        before = getattr(owner, setting)
        before = tuple(before) if setting == "location" else before
        setattr(owner, setting, value)
        assert is_old()
        assert is_in_panel()
        setattr(owner, setting, before)
        assert not is_old()

    move(ours().viewer)
    assert is_old()
    getattr(bpy.ops.kiriko, name)()
    assert not is_old()
    rig["GLASS"].location.x += 0.001
    path = str(tmp_path / "rig.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert is_old()
    bpy.data.objects["Cube"].location.x -= 0.001
    assert not is_old()
    getattr(bpy.ops.kiriko, f"remove_{name}")()
    move(bpy.data.objects["Cube"])
    assert not is_old()
    assert not watch._watched  # nothing is read any more


def test_saved_and_opened_again_it_is_known(watch, rig, tmp_path):
    """A current result stays current; one that was not is not; put back it is again."""
    path = str(tmp_path / "rig.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert not is_stale(watch)

    glass = bpy.data.objects["Cube"]
    before = glass.location.x
    glass.location.x = 0.003
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)

    assert is_stale(watch)
    bpy.data.objects["Cube"].location.x = before
    bpy.context.view_layer.update()
    assert not is_stale(watch)


def test_moved_away_and_back_it_is_current_again(watch, rig):
    """By a metre, which leaves a rounding in float32; and turned there and back."""
    glass = rig["GLASS"]
    glass.location = (0.0123, 0.0456, 0.0)
    bpy.ops.kiriko.solve()
    for there, back in (((1.0, 0.0, 0.3), (-1.0, 0.0, -0.3)),):
        for step, expected in ((there, True), (back, False)):
            glass.location = np.add(np.float32(glass.location), np.float32(step))
            glass.rotation_euler.rotate_axis("Z", step[0])
            bpy.context.view_layer.update()
            assert is_stale(watch) == expected
    assert tuple(glass.location) != (np.float32(0.0123), np.float32(0.0456), 0.0)


def test_undo_makes_it_current_again(watch, rig):
    """The scene and the result come back together; and redo takes both forward."""
    bpy.ops.ed.undo_push(message="before")
    rig["GLASS"].location.x = 0.004
    bpy.context.view_layer.update()
    bpy.ops.ed.undo_push(message="moved")
    assert is_stale(watch)
    bpy.ops.ed.undo()
    assert not is_stale(watch)
    bpy.ops.ed.redo()
    assert is_stale(watch)


def test_an_animation_counts_where_it_moves_something(watch, rig, capfd):
    """On the frame that was solved the result is current, on others not.

    No handler fails on the way.
    """
    glass = rig["GLASS"]
    for frame, x in ((1, 0.0), (9, 0.004)):
        glass.location.x = x
        glass.keyframe_insert("location", frame=frame)
    scene = bpy.context.scene
    scene.frame_set(1)
    bpy.ops.kiriko.solve()
    for frame, expected in ((1, False), (5, True), (1, False)):
        scene.frame_set(frame)
        assert is_stale(watch) == expected
    assert "Traceback" not in "".join(capfd.readouterr())


def test_export_of_what_has_changed_is_refused_until_allowed(watch, rig, tmp_path):
    """A script is told in a sentence, and nothing is written.

    With the argument it gets the old image.
    """
    path = tmp_path / "source.png"
    move(rig["GLASS"])
    with pytest.raises(RuntimeError, match=CHANGED):
        bpy.ops.kiriko.export(filepath=str(path))
    assert not path.exists()
    assert bpy.ops.kiriko.export(filepath=str(path), allow_stale=True) == {"FINISHED"}
    assert path.exists()
    with pytest.raises(RuntimeError, match=CHANGED):  # the answer is not remembered
        bpy.ops.kiriko.export(filepath=str(path), overwrite=True)
    bpy.ops.kiriko.solve()
    assert bpy.ops.kiriko.export(filepath=str(path), overwrite=True) == {"FINISHED"}


def test_the_command_line_never_writes_an_old_image(watch, rig, tmp_path, kiriko):
    """It solves the file as it is, whatever result is in it, and leaves one that is current."""
    move(rig["GLASS"])
    ours().tolerance = 0.3
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    assert watch.has_changed(bpy.context)
    command_line = loaded("operators.cli.command_line")
    assert command_line.run(["solve", "--out", str(tmp_path / "out")]) == 0
    assert json.loads((tmp_path / "out" / "report.json").read_text())["tolerance"] == pytest.approx(
        0.3
    )
    assert not is_stale(watch)


def test_preview_and_simulate_say_so(watch, rig, capfd):
    """They go on, for it is of use to see a bench that is not
    as planned, with a warning that has the sentence.
    """
    for work in ({"preview": {"samples": 1, "percentage": 10}}, {"simulate": {"samples": 2}}):
        ((name, options),) = work.items()
        for expected in (False, True):
            capfd.readouterr()
            assert getattr(bpy.ops.kiriko, name)(**options) == {"FINISHED"}
            warnings = [
                line for line in capfd.readouterr().out.splitlines() if line.startswith("Warning: ")
            ]
            assert any(CHANGED in line for line in warnings) == expected
            move(rig["GLASS"])
        bpy.ops.kiriko.solve()


def test_a_rig_that_cannot_be_read_any_more_has_changed(watch, rig, tmp_path):
    """Without a picture there is nothing to compare with, and no traceback."""
    rig["PICTURE"].data.materials.clear()
    bpy.context.view_layer.update()
    assert is_stale(watch)


def test_live_is_never_behind(watch, rig, kiriko):
    """While it works nothing is said; its result is current, also after it was turned off."""
    live = kiriko.operators.live
    bpy.ops.kiriko.live()
    move(rig["GLASS"])
    bpy.context.view_layer.update()

    for _ in range(2000):
        watch.tick()
        assert not watch.is_reported_changed(bpy.context.scene)
        if live.tick() == live.live_follower.IDLE:
            break

    live.stop()
    assert not is_stale(watch)
    move(rig["GLASS"])
    bpy.context.view_layer.update()

    assert is_stale(watch)


def test_apply_to_scene_keeps_a_current_result_current(watch, rig):
    """It is the same rig, written another way.

    A result of another rig does not become current by it.
    """
    name = f"{rig['GLASS'].name}: shift right"
    ours().calibration.offset = f'[{{"{name}": 0.5}}]'
    bpy.ops.kiriko.solve()
    bpy.ops.kiriko.apply_calibration()
    assert not is_stale(watch)
    move(rig["PLATE"])
    ours().calibration.offset = f'[{{"{name}": 0.5}}]'
    bpy.ops.kiriko.apply_calibration()
    assert is_stale(watch)


def test_handlers_and_timer_go_with_the_extension(blender, watch):
    """They are there while it is enabled, also after a file was loaded, and gone when it is not."""

    def left() -> list[str]:
        found = [
            name for name, handler in watch.HANDLERS if handler in getattr(bpy.app.handlers, name)
        ]
        return found + (["timer"] if bpy.app.timers.is_registered(watch.tick) else [])

    everything = [*(name for name, _ in watch.HANDLERS), "timer"]
    assert left() == everything
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert left() == everything

    module = "bl_ext.user_default.kiriko"
    bpy.ops.preferences.addon_disable(module=module)
    assert left() == []
    bpy.ops.preferences.addon_enable(module=module)
