"""Modules of the extension, as Blender has them."""

import importlib
from types import ModuleType

EXTENSION = "bl_ext.user_default.kiriko"


def loaded(name: str) -> ModuleType:
    """A module by its name within the package: not the one that tests of core import."""
    return importlib.import_module(f"{EXTENSION}.{name}")
