"""Runs Kiriko's command line in a Blender with factory settings, as workers of a farm have it.

    blender --background FILE --factory-startup --python-exit-code 1
            --python kiriko_bootstrap.py -- [--version VERSION] VERB ...

Kiriko comes from its zip beside this file, the one of this machine's platform where there are
several. It is installed into a temporary folder, which is gone at the end: neither preferences nor
the user's extensions are read or written. When anything fails one sentence is on stderr, and the
exit code is not 0.
"""

import importlib
import os
import platform
import re
import shutil
import signal
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import NamedTuple
from zipfile import ZipFile

import bpy

REPOSITORY = "kiriko_farm"
MANIFEST = "blender_manifest.toml"
LARGEST = 1_000_000  # bytes of a manifest that are read
PACKAGE = f"bl_ext.{REPOSITORY}.kiriko"
SYSTEMS = {"Linux": "linux", "Windows": "windows", "Darwin": "macos"}
MACHINES = {"x86_64": "x64", "amd64": "x64", "arm64": "arm64", "aarch64": "arm64"}


class FarmError(Exception):
    """The reason why nothing was run, as a sentence."""


def this_platform() -> str:
    """The running platform, as manifests of extensions call it."""
    system, machine = platform.system(), platform.machine()
    return f"{SYSTEMS.get(system, system.lower())}-{MACHINES.get(machine.lower(), machine.lower())}"


class About(NamedTuple):
    """A zip of Kiriko: its file and version, the oldest Blender, and the platforms and Pythons it
    is for (none: any).
    """

    path: Path
    version: str
    blender: tuple[int, ...]
    platforms: list[str]
    pythons: set[str]


def numbers(version: str) -> tuple[int, ...]:
    """A version as numbers, which can be compared."""
    return tuple(int(part) for part in version.split("."))


def about(path: Path) -> About | None:
    """What the manifest in a zip says; None for a zip of something else."""
    try:
        with ZipFile(path) as archive:
            if MANIFEST not in archive.namelist():
                return None
            with archive.open(MANIFEST) as file:
                manifest = tomllib.loads(file.read(LARGEST).decode())
        if manifest.get("id") != "kiriko":
            return None
        generated = manifest.get("build", {}).get("generated", {})
        platforms = generated.get("platforms", manifest.get("platforms", []))
        wheels = generated.get("wheels", manifest.get("wheels", []))
        pythons = {tag for name in wheels for tag in re.findall(r"-cp(3\d+)-", name)}
        oldest, version = manifest["blender_version_min"], str(manifest["version"])
        numbers(version)
        return About(path, version, numbers(oldest), list(map(str, platforms)), pythons)
    except Exception as reason:  # a zip can be broken in a dozen ways, each with its own error
        why = " ".join(str(reason).split()).rstrip(".") or type(reason).__name__
        raise FarmError(f"The zip '{path}' cannot be read ({why}): copy it again.") from None


def fitting_zip(folder: Path, version: str | None) -> Path:
    """Kiriko's zip in a folder that is for this machine, and of a version where one is wanted."""
    here = this_platform()
    found: list[About] = []
    broken = None
    for path in sorted(folder.glob("*.zip")):
        try:
            found += filter(None, [about(path)])
        except FarmError as problem:
            broken = problem
    if not found:
        raise broken or FarmError(
            f"There is no zip of Kiriko in '{folder}': put the one for {here} there,"
            f" beside {Path(__file__).name}."
        )

    fit = [one for one in found if here in (one.platforms or [here])]
    if not fit:
        raise FarmError(
            f"The zip '{found[0].path}' is for {', '.join(found[0].platforms)}, and this machine is"
            f" {here}: put the zip for that beside it."
        )

    python = "{}{}".format(*sys.version_info)
    taken = [one for one in fit if python in (one.pythons or [python])]
    if not taken:
        raise FarmError(
            f"The zip '{fit[0].path}' is for another Python than {platform.python_version()}, which"
            " this Blender has: put the zip for that beside it."
        )

    same = [one for one in taken if version in (None, one.version)]
    if not same:
        raise FarmError(
            f"The zip '{taken[0].path}' has Kiriko {taken[0].version}, and the job was made with"
            f" {version}: put the zip of that version beside it, or make the job anew."
        )

    usable = [one for one in same if one.blender <= bpy.app.version]
    if not usable:
        raise FarmError(
            f"Kiriko needs Blender {'.'.join(map(str, same[-1].blender))} or newer, and this is"
            f" {bpy.app.version_string}: have the farm use a newer one."
        )
    return max(usable, key=lambda one: numbers(one.version)).path


def enable(path: Path, home: Path) -> None:
    """Install Kiriko's zip into a repository in a folder, and enable it for this process."""
    for name in ("EXTENSIONS", "CONFIG"):  # where Blender unpacks wheels, and keeps preferences
        place = home / name.lower()
        place.mkdir()
        os.environ[f"BLENDER_USER_{name}"] = str(place)

    repositories = bpy.context.preferences.extensions.repos
    repositories.new(name="Kiriko", module=REPOSITORY, custom_directory=str(home / "repository"))
    try:
        bpy.ops.extensions.package_install_files(
            filepath=str(path), repo=REPOSITORY, enable_on_install=True, overwrite=True
        )
    except RuntimeError as reason:
        why = " ".join(str(reason).split()).removeprefix("Error: ").rstrip(".")
        raise FarmError(f"Blender cannot install '{path}' ({why}): copy it again.") from None

    if PACKAGE not in bpy.context.preferences.addons:  # it says FINISHED all the same
        raise FarmError(f"Blender refused '{path}', for the reason above: use another zip.")


def run(arguments: list[str]) -> int:
    """Enable Kiriko and run its command line; the exit code."""
    version = None
    if arguments[:1] == ["--version"]:
        if len(arguments) == 1:
            raise FarmError("No version follows --version: write the one of the zip, or neither.")
        version, arguments = arguments[1], arguments[2:]

    home = Path(tempfile.mkdtemp(prefix="kiriko-farm-"))
    try:
        enable(fitting_zip(Path(__file__).resolve().parent, version), home)
        command_line = importlib.import_module(f"{PACKAGE}.operators.cli.command_line")
        return command_line.run(arguments)
    finally:
        if PACKAGE in bpy.context.preferences.addons:
            bpy.ops.preferences.addon_disable(module=PACKAGE)
        shutil.rmtree(home, ignore_errors=True)


def main() -> None:
    """Run, and leave with an exit code that is not 0 where it failed."""
    # a farm ends a task so: the temporary folder goes as after an error
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    try:
        code = run(arguments)
    except FarmError as problem:
        sys.stderr.write(f"kiriko: {problem}\n")
        code = 1
    except OSError as reason:
        sys.stderr.write(
            f"kiriko: The bootstrap could not read or write a file ({reason}): check the disk.\n"
        )
        code = 1

    sys.stdout.flush()
    sys.stderr.flush()
    if code:
        sys.exit(code)


if __name__ == "__main__":
    main()
