"""Core is tested as if there were no Blender on the machine."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from importlib.machinery import ModuleSpec
from types import ModuleType

import pytest

BLENDER_MODULES = {"bpy", "bpy_extras", "bmesh", "mathutils", "gpu", "bl_ext", "addon_utils"}


class NoBlender:
    """Import finder that refuses Blender's modules, also where bpy is installed."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Refuse a module of Blender; leave the others to the finders after this one."""
        if name.partition(".")[0] in BLENDER_MODULES:
            raise ModuleNotFoundError(f"core may not import {name}", name=name)
        return None


sys.meta_path.insert(0, NoBlender())


@pytest.fixture(params=[True, False], ids=["kernel", "numpy"])
def has_kernel(request: pytest.FixtureRequest) -> Iterator[bool]:
    """The test runs twice: with the kernel, and as if none had been built."""
    from kiriko.core.native import loading  # after the finder that refuses Blender's modules

    with nullcontext() if request.param else loading.off():
        yield request.param
