"""Kiriko's checkout, registered in the Blender that runs a script."""

import atexit
import importlib
from functools import cache
from types import ModuleType


@cache
def registered() -> ModuleType:
    """The package, registered until Python ends.

    What is left in a Blender that is a module is freed after
    Python has ended, and that ends the process by a signal.
    """
    kiriko = importlib.import_module("kiriko")
    kiriko.register()
    atexit.register(kiriko.unregister)
    return kiriko
