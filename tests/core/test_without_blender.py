import ast
import importlib
import importlib.util
import sys
from pathlib import Path

import pytest

import kiriko.core

CORE = Path(kiriko.core.__file__).parent
MODULES = sorted(path.stem for path in CORE.glob("*.py") if not path.stem.startswith(("blender_", "__")))


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
    """Every file of core but blender_*.py can be imported where there is no Blender."""
    importlib.import_module(f"kiriko.core.{name}")
    assert "bpy" not in sys.modules


@pytest.mark.parametrize("name", MODULES)
def test_core_keeps_to_its_imports(name: str) -> None:
    """Blender, OpenImageIO and ray engines are imported by blender_*.py, image_io.py and engines.py alone."""
    packages = imported(CORE / f"{name}.py")
    assert not packages & {"bpy", "bmesh", "gpu"}
    assert name == "image_io" or "OpenImageIO" not in packages
    assert name == "engines" or not packages & {"embreex", "mathutils"}
