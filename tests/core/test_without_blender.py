import ast
import functools
import importlib
import importlib.util
import sys
from pathlib import Path

import pytest

import kiriko.core

CORE = Path(kiriko.core.__file__).parent
PATHS = {
    ".".join(path.relative_to(CORE).with_suffix("").parts): path for path in CORE.rglob("*.py")
}
MODULES = sorted(
    name for name in PATHS if not name.startswith("blender.") and not name.endswith("__init__")
)
# from the bottom to the top
ROOMS = (
    "base",
    "native",
    "rig",
    "files",
    "glass",
    "light",
    "map",
    "image",
    "solve",
    "bench",
    "lab.warp",
    "lab.atlas",
    "lab.farm",
    "lab.calibrate",
    "lab.drawing",
    "lab.measure",
    *(
        f"blender.{room}"
        for room in (
            "data",
            "materials",
            "read",
            "properties",
            "result",
            "preview",
            "view",
            "lifecycle",
            "checks",
        )
    ),
)


def imported(path: Path) -> set[str]:
    """Top-level packages that a file imports anywhere, by absolute imports."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    from_ = {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.level == 0}
    return {name.partition(".")[0] for name in plain | from_}


def test_blender_is_out_of_reach() -> None:
    """These tests see no Blender, even in an environment that has it."""
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("bpy")


@pytest.mark.parametrize("name", MODULES)
def test_core_loads_without_blender(name: str) -> None:
    """Every file of core can be imported where there is no Blender, but those in core/blender."""
    importlib.import_module(f"kiriko.core.{name}")
    assert "bpy" not in sys.modules


@pytest.mark.parametrize("name", MODULES)
def test_core_keeps_to_its_imports(name: str) -> None:
    """Blender, OpenImageIO and ray engines are imported in
    core/blender, image_io.py and light/engines.py alone.
    """
    packages = imported(PATHS[name])
    assert not packages & {"bpy", "bmesh", "gpu"}
    assert name == "files.image_io" or "OpenImageIO" not in packages
    assert name == "light.engines" or not packages & {"embreex", "mathutils"}


@functools.cache
def asked(name: str) -> set[str]:
    """Files of core that a file imports from, in its functions, too."""
    found = set()
    package = name.split(".")[:-1]
    tree = ast.parse(PATHS[name].read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = ".".join(
                [*package[: len(package) - node.level + 1], *filter(None, [node.module])]
            )
            found |= {base} & PATHS.keys() or {
                f"{base}.{alias.name}".lstrip(".") for alias in node.names
            } & PATHS.keys()
    return found


@pytest.mark.parametrize("name", sorted(PATHS))
def test_rooms_are_in_order(name: str) -> None:
    """A file imports from its own room or a lower one, in its functions, too."""

    def floor(name: str) -> int:
        return ROOMS.index(name.rpartition(".")[0])

    assert [other for other in sorted(asked(name)) if floor(other) > floor(name)] == []


@pytest.mark.parametrize("name", sorted(PATHS))
def test_no_file_asks_for_itself(name: str) -> None:
    """Imports do not go round in circles, those in functions and for types alone among them."""
    found = set()
    todo = {name}
    while todo:
        todo = {other for one in todo for other in asked(one)} - found
        found |= todo
    assert name not in found
