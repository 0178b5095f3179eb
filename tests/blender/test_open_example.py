from types import ModuleType

import bpy
import pytest

from extension import loaded
from kiriko.core.bench.systems import SYSTEMS
from test_system_objects import assert_same_parts

NAMES = ("BALL", "GOBLET", "CUT_CUBE", "BOTTLE")


@pytest.fixture
def needed(kiriko) -> ModuleType:
    return loaded("operators.needed")


@pytest.mark.parametrize("name", NAMES)
def test_example_is_a_rig_that_can_be_solved(scene, needed, name):
    """It opens in every Blender as a file without a name, lacks
    nothing, and nearly all of the picture arrives.
    """
    assert bpy.ops.kiriko.open_example(example=name) == {"FINISHED"}
    opened = bpy.context.scene
    assert bpy.data.filepath == ""
    assert needed.missing(opened) == []

    # coarse: only the way through is tested here
    opened.kiriko.viewer.kiriko.resolution = (64, 64)
    display = next(iter(needed.parts(opened)["DISPLAY"]))
    display.kiriko.resolution = (96, 54)
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    assert opened.kiriko.result.coverage > 0.95


@pytest.mark.parametrize("name", NAMES)
def test_the_glass_of_an_example_is_active(scene, name):
    """So that the panel Object shows it, as after Add Rig; a new file has nothing to choose."""
    bpy.ops.kiriko.open_example(example=name)
    glass = bpy.context.view_layer.objects.active
    assert glass.kiriko.role == "GLASS"
    assert glass.select_get()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert bpy.context.view_layer.objects.active is None


def test_an_example_is_framed_after_the_question_whether_to_save(scene, tmp_path, monkeypatch):
    """Once its file is there, and no file of the artist's that is opened in its place."""
    module = loaded("operators.open_example")
    framed = []
    monkeypatch.setattr(module, "frame_soon", lambda: framed.append(1))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mine.blend"))

    module._requested[:] = ["BALL"]  # as while Blender asks
    bpy.ops.wm.read_homefile(filepath=str(module.path_of("BALL")), load_ui=False)
    assert framed == [1]
    module._requested[:] = ["BALL"]
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "mine.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert framed == [1]


@pytest.mark.parametrize("name", NAMES)
def test_the_plate_of_an_example_is_missed(scene, needed, name):
    """Deleted by hand, it is told."""
    bpy.ops.kiriko.open_example(example=name)
    opened = bpy.context.scene
    bpy.data.objects.remove(next(iter(needed.parts(opened)["PLATE"])))
    with pytest.raises(RuntimeError, match="plate is missing: make a new one"):
        bpy.ops.kiriko.solve()


@pytest.mark.parametrize("name", NAMES)
def test_what_an_example_tells_can_be_translated(scene, name):
    """The sentence on its display is kept with its values, as by this version's Add Rig."""
    kept = loaded("core.blender.data.stored_records")
    bpy.ops.kiriko.open_example(example=name)
    result = bpy.context.scene.kiriko.result
    message = kept.Sentences.read(result.sentences).message(result.summary)
    assert message.values


def test_examples_are_those_that_are_offered(kiriko):
    """Each entry of the menu has its file, and each file an entry."""
    module = loaded("operators.open_example")
    names = {name for name, *_ in module.EXAMPLES if name}
    offered = {module.path_of(name).name for name in names}
    assert offered == {path.name for path in module.FOLDER.glob("example_*.blend")}
    assert names == {*NAMES, *SYSTEMS}


@pytest.mark.parametrize("kind", SYSTEMS)
def test_the_example_of_a_system_is_up_to_date(core, kind):
    """It holds the system's parts as the table has them, with its display or glass active."""
    bpy.ops.kiriko.open_example(example=kind)
    found = core.blender.read.scene.read(bpy.context).rig
    assert_same_parts(found, loaded("core.bench.systems").SYSTEMS[kind].make())
    role = bpy.context.view_layer.objects.active.kiriko.role
    assert role == ("GLASS" if found.glasses else "DISPLAY" if found.displays else "SCREEN")
