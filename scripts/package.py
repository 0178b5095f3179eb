"""Builds the extension's zips: fetches and builds the manifest's wheels, builds the manual, and
runs Blender's own tool to build and validate.

Runs in an environment with bpy: `python scripts/dev.py build` calls it there.
"""

import argparse
import hashlib
import importlib.util
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from build_kernel import MODULE, TARGETS, Target, this_target
from environments import (
    MANUAL,
    ToolError,
    as_module,
    clean_environment,
    link_package,
    newest_blender,
    python_path,
    set_up,
)
from wheels import PACKAGES, make_kernels

ROOT = Path(__file__).resolve().parent.parent
DIST = ROOT / "dist"
# folders of the checkout outside of all zips
UNPACKED = (".dev", ".git", "benchmark", "dist", "docs", "out", "scripts", "tests")
DISTRIBUTIONS_PYTHON = "cp314"  # of Arch Linux, Fedora and others, which build Blender themselves
WHEELS_PINS = ROOT / "scripts" / "requirements-wheels.txt"


def run(*command: str | Path) -> None:
    """Run a command with this interpreter; end the script when it fails."""
    done = subprocess.run([sys.executable, *command])
    if done.returncode:
        sys.exit(done.returncode)


def extension_tool(*arguments: str | Path) -> None:
    """Run Blender's command line tool for extensions."""
    # Located, not imported: importing bpy takes a second and reads the user's settings.
    bpy = Path(importlib.util.find_spec("bpy").submodule_search_locations[0])
    (scripts,) = bpy.glob("*/scripts")
    tags = scripts / "modules" / "_bpy_internal" / "extensions" / "tags.py"
    tool = scripts / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    has_tags = arguments[0] in ("build", "validate")
    run(tool, *arguments, *([f"--valid-tags={tags}"] if has_tags else []))


def fetch_wheel(path: Path) -> None:
    """Download one wheel by the parts of its name, unless it is here and is the pinned one."""
    pins = WHEELS_PINS.read_text(encoding="utf-8")
    if path.exists() and hashlib.sha256(path.read_bytes()).hexdigest() in pins:
        return
    path.unlink(missing_ok=True)
    python, abi, platforms = path.stem.split("-")[2:]
    version = re.sub(r"cp(\d)(\d+)", r"\1.\2", python)
    options = "--no-deps --only-binary=:all: --require-hashes --disable-pip-version-check --quiet"
    platform = [option for name in platforms.split(".") for option in ("--platform", name)]
    target = ["--implementation", "cp", "--python-version", version, "--abi", abi, *platform]
    places = "--dest", path.parent, "--requirement", WHEELS_PINS
    run("-m", "pip", "download", *options.split(), *target, *places)

    if not path.exists():
        sys.exit(
            f"The manifest lists {path.name}, and {WHEELS_PINS.name} gives another file: make"
            f" them agree."
        )


def manual_python() -> Path:
    """Interpreter of the environment that builds the manual."""
    try:
        return set_up(MANUAL, newest_blender()[1])
    except ToolError as error:
        sys.exit(f"The zips hold the manual, whose packages could not be installed. {error}")


def make_manual() -> None:
    """Build the manual's site, which the zips hold, in an environment of its own."""
    command = [manual_python(), *as_module("manual.run")]
    code = subprocess.run(command, env=clean_environment(PYTHONPATH=python_path())).returncode
    if code:
        sys.exit(code)


def make_interface(folder: Path) -> None:
    """Build the pages of the Python interface; a reference to nothing ends the build."""
    link_package()
    config = PACKAGES / "optics" / "mkdocs.yml"
    build = ["build", "--strict", "--quiet", "--config-file", config, "--site-dir", folder]
    command = [manual_python(), "-m", "mkdocs", *build]
    code = subprocess.run(command, env=clean_environment(NO_MKDOCS_2_WARNING="1")).returncode
    if code:
        sys.exit(code)


def system(tag: str) -> str:
    """A wheel's platform without the versions of systems: `manylinux_x86_64`."""
    return re.sub(r"(_\d+){2}_", "_", tag.rpartition(".")[2])


@contextmanager
def source_for(target: Target, wheels: Sequence[str]) -> Iterator[Path]:
    """A copy of the checkout with one platform in its manifest, and these wheels."""
    manifest = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    for name, values in (("platforms", [target.platform]), ("wheels", wheels)):
        manifest = re.sub(
            rf"^{name} = \[[^]]*]", f"{name} = {json.dumps(values)}", manifest, flags=re.MULTILINE
        )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name, "kiriko")
        shutil.copytree(ROOT, folder, ignore=lambda f, _: UNPACKED if f == str(ROOT) else ())
        (folder / "blender_manifest.toml").write_text(manifest, encoding="utf-8")
        yield folder


def build(is_manual_kept: bool, is_for_here: bool) -> None:
    """Rebuild dist/: a valid zip for each platform, or only for this machine's; and one for Linux
    distributions.
    """
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    here = this_target()
    targets = [target for target in TARGETS if target == here or not is_for_here]
    systems = {system(target.tag) for target in targets}
    wheels = [w for w in manifest["wheels"] if system(Path(w).stem.rpartition("-")[2]) in systems]
    make_kernels(targets)
    fetch(wheels)

    if not is_manual_kept:
        make_manual()
        make_interface(ROOT / "out" / "python")
    DIST.mkdir(exist_ok=True)
    for old in DIST.glob("kiriko-*.zip"):
        old.unlink()
    with source_for(targets[0], wheels) if is_for_here else nullcontext(ROOT) as source:
        extension_tool("validate", source)
        extension_tool("build", "--source-dir", source, "--output-dir", DIST, "--split-platforms")
    if len(list(DIST.glob("kiriko-*.zip"))) != len(targets):
        sys.exit(
            f"dist/ has not one zip for each of {len(targets)} platforms: see the output above."
        )

    if not is_for_here:
        build_for_distributions(manifest)
    for path in DIST.glob("kiriko-*.zip"):
        extension_tool("validate", path)


def build_for_distributions(manifest: dict[str, Any]) -> None:
    """Build the zip for Linux distributions whose Blender has their own Python."""
    target = next(one for one in TARGETS if one.platform == "linux-x64")
    own = [
        w for w in manifest["wheels"] if system(target.tag) == system(Path(w).stem.split("-")[-1])
    ]
    wheels = [w for w in own if "-py3-" in w] + [
        re.sub("cp313", DISTRIBUTIONS_PYTHON, w) for w in own if "-cp313-" in w
    ]
    fetch(wheels)
    name = f"kiriko-{manifest['version']}-linux_x64-{DISTRIBUTIONS_PYTHON}.zip"
    with source_for(target, wheels) as source:
        extension_tool("build", "--source-dir", source, "--output-filepath", DIST / name)


def fetch(wheels: Sequence[str]) -> None:
    """Download all wheels but the kernel's, which has to be built already."""
    for wheel in wheels:
        name = Path(wheel).name
        if not name.startswith(MODULE):
            fetch_wheel(ROOT / wheel)
        elif not (ROOT / wheel).exists():
            sys.exit(
                f"The manifest lists {name}, and the kernel has another version: write that of"
                " scripts/packages/kernel/pyproject.toml into the manifest."
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--keep-manual",
        action="store_true",
        help="pack manual/ as it is, if it is there, as for pictures that its pages still lack",
    )
    parser.add_argument(
        "--here", action="store_true", help="build the zip for this machine's platform alone"
    )
    options = parser.parse_args()
    try:
        build(options.keep_manual, options.here)
    except ToolError as error:
        sys.exit(str(error))
