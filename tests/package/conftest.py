"""The built zip, installed in a Blender with an empty profile."""

import importlib.machinery
import importlib.util
import os
import platform
import sys
from collections.abc import Callable, Iterator, Sequence
from importlib.machinery import ModuleSpec
from io import BytesIO
from pathlib import Path
from types import ModuleType
from zipfile import ZipFile

# Before anything named bl_ext, and after tests/conftest.py has set the profile.
import bpy
import pytest

import build_kernel

EXTENSION = "bl_ext.user_default.kiriko"
ROOT = Path(__file__).resolve().parent.parent.parent
PLATFORMS = {
    ("Linux", "x86_64"): "linux_x64",
    ("Linux", "aarch64"): "linux_arm64",
    ("Windows", "AMD64"): "windows_x64",
    ("Darwin", "x86_64"): "macos_x64",
    ("Darwin", "arm64"): "macos_arm64",
}

Command = Callable[[list[str]], int]


class BundledOnly:
    """Import finder that takes embreex and the kernel from the
    profile, where Blender has unpacked the wheels.

    The environment of the tests has both, too, which would hide that a bundled one is missing.
    """

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find the bundled modules in the profile.

        Leave other modules to the finders after this one.
        """
        if name not in ("embreex", "kiriko_kernel"):
            return None
        wheels = Path(os.environ["BLENDER_USER_RESOURCES"], "extensions", ".local").glob(
            "lib/*/site-packages"
        )
        spec = importlib.machinery.PathFinder.find_spec(name, [str(folder) for folder in wheels])
        if spec is None:
            raise ModuleNotFoundError(f"the extension brought no {name}", name=name)
        return spec


@pytest.fixture(scope="session")
def zips() -> dict[str, Path]:
    """Built zips by platform, for Blender's own Pythons."""
    every = ROOT.glob("dist/kiriko-*.zip")
    found = {path.stem.split("-")[-1]: path for path in every if path.stem[-5:] != "cp314"}
    assert found, "there are no zips in dist/: run 'python3 scripts/dev.py build' first"
    return found


@pytest.fixture(scope="session")
def own_zip(zips: dict[str, Path]) -> Path:
    """The zip for this machine."""
    return zips[PLATFORMS[platform.system(), platform.machine()]]


@pytest.fixture(scope="session")
def contents(zips: dict[str, Path]) -> dict[str, list[str]]:
    """Names of the files in the zips, by platform."""
    return {name: ZipFile(path).namelist() for name, path in zips.items()}


@pytest.fixture(scope="session")
def kernels(zips: dict[str, Path]) -> dict[str, bytes]:
    """The libraries in the kernel's wheels in the zips, by platform."""
    endings = {t.platform.replace("-", "_"): t.ending for t in build_kernel.TARGETS}
    return {name: kernel_in(path, endings[name]) for name, path in zips.items()}


def kernel_in(path: Path, ending: str) -> bytes:
    """The library in the kernel's wheel in a zip."""
    with ZipFile(path) as archive:
        (name,) = (
            name for name in archive.namelist() if Path(name).name.startswith(build_kernel.MODULE)
        )
        wheel = archive.read(name)
    with ZipFile(BytesIO(wheel)) as archive:
        return archive.read(f"{build_kernel.MODULE}/kernel.{ending}")


@pytest.fixture(scope="session")
def commands() -> dict[str, Command]:
    """Functions behind `blender --command NAME`, by name.

    Filled when the extension registers them.
    """
    return {}


@pytest.fixture(scope="session")
def installed(zips: dict[str, Path], commands: dict[str, Command]) -> Iterator[str]:
    """Name of the installed and enabled extension."""
    register = bpy.utils.register_cli_command

    def remember(name: str, function: Command) -> object:
        commands[name] = function
        return register(name, function)

    # A wheel of bpy has no command line: the function behind the command is called instead.
    bpy.utils.register_cli_command = remember
    sys.meta_path.insert(0, BundledOnly())
    path = zips[PLATFORMS[platform.system(), platform.machine()]]
    bpy.ops.extensions.package_install_files(
        filepath=str(path), repo="user_default", enable_on_install=True, overwrite=True
    )

    # The operator says FINISHED even when Blender refuses the extension.
    assert EXTENSION in bpy.context.preferences.addons, (
        "Blender refused the extension, for the reason above"
    )

    yield EXTENSION
    bpy.ops.preferences.addon_disable(module=EXTENSION)
    bpy.utils.register_cli_command = register
