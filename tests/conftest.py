"""For all tests: the checkout as package `kiriko`, no Blender profile but an empty one, the same numbers each time."""

import importlib
import os
import shutil
import tempfile

import hypothesis
import pytest

from environments import link_package

# The folder is in sys.path by pyproject.toml; Python may have noted that it did not exist yet.
link_package()
importlib.invalidate_caches()

# Read by bpy when it is imported: the user's own extensions and settings must not get in.
PROFILE = tempfile.mkdtemp(prefix="kiriko-profile-")
os.environ["BLENDER_USER_RESOURCES"] = PROFILE

# The machine's speed is no property of the code.
hypothesis.settings.register_profile("kiriko", deadline=None, derandomize=True, database=None)
hypothesis.settings.load_profile("kiriko")


def pytest_unconfigure(config: pytest.Config) -> None:
    shutil.rmtree(PROFILE, ignore_errors=True)
