"""For all tests: the checkout as package `kiriko`, no Blender
profile but an empty one, the same numbers each time.
"""

import importlib
import os
import shutil
import sys
import tempfile

import hypothesis
import pytest

import build_kernel
from environments import link_package

# The folder is in sys.path by pyproject.toml; Python may have noted that it did not exist yet.
link_package()
build_kernel.provide()
importlib.invalidate_caches()

# Read by bpy when it is imported: the user's own extensions and settings must not get in.
PROFILE = tempfile.mkdtemp(prefix="kiriko-profile-")
os.environ["BLENDER_USER_RESOURCES"] = PROFILE

# The machine's speed is no property of the code.
hypothesis.settings.register_profile("kiriko", deadline=None, derandomize=True, database=None)
hypothesis.settings.load_profile("kiriko")


EXIT_STATUS = pytest.StashKey[int]()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        for mark in item.iter_markers("long"):
            if not mark.kwargs.get("reason"):
                raise pytest.UsageError(f"{item.nodeid} is left out of the gate: give a reason=")


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    session.config.stash[EXIT_STATUS] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    shutil.rmtree(PROFILE, ignore_errors=True)
    bpy = sys.modules.get("bpy")
    if bpy and bpy.app.version < (4, 5) and EXIT_STATUS in config.stash:
        # As a module, Blender 4.2 crashes when Python ends, once a class has been registered with a
        # property that has a callback (a poll will do), unregistered or not: this leaves with
        # pytest's own exit code before that.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(config.stash[EXIT_STATUS])
