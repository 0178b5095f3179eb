"""The checkout as an enabled extension of a Blender with an empty profile."""

import importlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

# Before anything named bl_ext, and after tests/conftest.py has set the profile.
import bpy
import pytest

from extension import EXTENSION, loaded
from long_work import live, rig, window  # noqa: F401, fixtures of tests of long work
from panel_layout import Layout

# Blender has Python keep nothing of what it compiles, so that each run would compile all anew.
sys.dont_write_bytecode = bool(os.environ.get("PYTHONDONTWRITEBYTECODE"))

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.fixture(scope="session")
def blender() -> Iterator[ModuleType]:
    """Module bpy, with Kiriko enabled."""
    link = Path(os.environ["BLENDER_USER_RESOURCES"]) / "extensions" / "user_default" / "kiriko"
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to(ROOT, target_is_directory=True)
    bpy.ops.preferences.addon_enable(module=EXTENSION)
    assert EXTENSION in bpy.context.preferences.addons, (
        "Blender refused the extension, for the reason above"
    )
    yield bpy
    bpy.ops.preferences.addon_disable(module=EXTENSION)


@pytest.fixture
def scene(blender) -> bpy.types.Scene:
    """An empty scene in a new file with factory settings."""
    # A file opened without its interface makes Blender keep the windows for all files after it.
    blender.context.preferences.filepaths.use_load_ui = True
    blender.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return blender.context.scene


KINDS = {"OBJECT": "objects", "MESH": "meshes", "MATERIAL": "materials"}


@pytest.fixture
def linked(tmp_path) -> Callable[..., bpy.types.ID]:
    """Writes a datablock to another file, and links it from there: of the same name."""

    def link(block: bpy.types.ID) -> bpy.types.ID:
        path = str(tmp_path / f"{block.name}.blend")
        bpy.data.libraries.write(path, {block})
        kind = KINDS[block.id_type]
        with bpy.data.libraries.load(path, link=True) as (_, wanted):
            setattr(wanted, kind, [block.name])
        (theirs,) = getattr(wanted, kind)
        assert theirs.library is not None
        return theirs

    return link


@pytest.fixture
def kiriko(blender) -> ModuleType:
    """The package as Blender has it, not the one tests of core import."""
    return importlib.import_module(EXTENSION)


@pytest.fixture
def read(scene) -> Callable[[], Any]:
    """Reads the scene as Solve does."""
    module = loaded("core.blender.read.scene")
    return lambda: module.read(bpy.context, bpy.context.scene)


@pytest.fixture
def errors(kiriko) -> ModuleType:
    """Module core.base.errors, whose classes Blender's package raises."""
    return loaded("core.base.errors")


@pytest.fixture
def look(scene) -> Callable[[], list]:
    """The entries of a whole look for the checklist, with all meshes."""
    look_over = loaded("operators.look_over")
    return lambda: look_over.look_now(bpy.context)


@pytest.fixture
def no_remedies(kiriko, monkeypatch):
    """What would bring lost light back is not looked for, as where there is no time left: for tests
    that do not read it, half of whose time it takes.
    """
    module = loaded("operators.remedies")
    monkeypatch.setattr(module, "SECONDS", 0.0)


@pytest.fixture
def run(scene) -> Callable[..., int]:
    """The function that Blender calls for `--command kiriko`; returns the exit code."""
    module = loaded("operators.cli.command_line")
    return lambda *argv: module.run([str(word) for word in argv])


@pytest.fixture
def core(scene) -> ModuleType:
    """Its core, with the files that read, trace and render; and an empty scene."""
    of_blender = (
        "read.nested_glass",
        "materials.plate_material",
        "preview.cycles_preview",
        "read.scene",
    )
    of_light = ("compile_plan", "plate", "trace")
    for name in (
        "rig.rig",
        "rig.settings",
        *(f"blender.{n}" for n in of_blender),
        *(f"light.{n}" for n in of_light),
    ):
        loaded(f"core.{name}")
    return loaded("core")


@pytest.fixture
def drawn(scene) -> Callable[..., Layout]:
    """Draws a panel by its module and name; returns the drawn layout."""

    def draw(
        module: str,
        name: str,
        active: bpy.types.Object | None = None,
        of: bpy.types.Scene | None = None,
        width: int = 300,
    ) -> Layout:
        panel = getattr(loaded(f"panels.{module}"), name)
        functions = {
            name: thing for name, thing in vars(panel).items() if isinstance(thing, FunctionType)
        }
        stand_in = type("Panel", (), functions)()
        stand_in.layout = Layout()

        # without a window there is neither a region nor a scale
        wide = SimpleNamespace(width=width)
        system = SimpleNamespace(ui_scale=1.0)
        preferences = SimpleNamespace(system=system, ui_styles=())
        stand_in.draw(
            SimpleNamespace(
                scene=of or scene,
                active_object=active,
                object=active,
                preferences=preferences,
                window_manager=bpy.context.window_manager,
                region=wide,
                evaluated_depsgraph_get=bpy.context.evaluated_depsgraph_get,
            )
        )

        return stand_in.layout

    return draw
