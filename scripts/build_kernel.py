"""Builds the compiled kernel from core/native/*.c: the library for this machine, and a wheel for
each platform.

One compiler, zig's clang, builds all of them on any machine. `python3 scripts/dev.py build` makes
the wheels; the library for the tests here is built anew whenever the sources have changed.
"""

from __future__ import annotations

import hashlib
import platform
import sys
import tempfile
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from environments import DEV, KERNEL, ROOT, ToolError, find_python, run, set_up

SOURCES = ROOT / "core" / "native"
MODULE = "kiriko_kernel"
HERE = DEV / "link" / MODULE  # imported by tests and scripts
WHEELS = ROOT / "wheels"
# No fast arithmetic: sums are as they are written, and the same on all platforms.
FLAGS = (
    *("-std=c17", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fvisibility=hidden"),
    *("-Wall", "-Wextra", "-Werror", "-shared", "-s"),
)
# 1980, the earliest date in a wheel: wheels of the same sources are identical
EPOCH = "315532800"


class Target(NamedTuple):
    """A platform: its name in the manifest, its name for zig, the tag of its wheels, how its
    libraries end.
    """

    platform: str
    triple: str
    tag: str
    ending: str


TARGETS = (
    Target("linux-x64", "x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64", "so"),
    Target("linux-arm64", "aarch64-linux-gnu.2.17", "manylinux_2_17_aarch64", "so"),
    Target("windows-x64", "x86_64-windows-gnu", "win_amd64", "dll"),
    Target("windows-arm64", "aarch64-windows-gnu", "win_arm64", "dll"),
    Target("macos-x64", "x86_64-macos.11.0", "macosx_11_0_x86_64", "so"),
    Target("macos-arm64", "aarch64-macos.11.0", "macosx_11_0_arm64", "so"),
)
MACHINES = {"x86_64": "x64", "AMD64": "x64", "aarch64": "arm64", "arm64": "arm64", "ARM64": "arm64"}
SYSTEMS = {"Linux": "linux", "Windows": "windows", "Darwin": "macos"}


def this_target() -> Target | None:
    """The current platform; None if it has no wheel."""
    name = f"{SYSTEMS.get(platform.system())}-{MACHINES.get(platform.machine())}"
    return next((target for target in TARGETS if target.platform == name), None)


def compiler() -> Path:
    """Interpreter of the environment with the compiler."""
    for version in ("3.13", "3.11"):
        if python := find_python(version):
            return set_up(KERNEL, python)
    raise ToolError(
        "No Python 3.13 or 3.11 was found for the kernel's compiler: install one and"
        " run this again."
    )


def compile_for(target: Target, path: Path, *sources: str | Path) -> None:
    """Compile C for a platform, by sources, flags and libraries in the compiler's order."""
    caches = {name: str(DEV / "zig") for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR")}
    zig = [compiler(), "-m", "ziglang", "cc", "-target", target.triple]
    run([*zig, "-o", path, *sources], **caches)


def make_package(target: Target, folder: Path) -> None:
    """Make the Python package with the library for a platform."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "__init__.py").write_text(f'"""{SUMMARY}"""\n', encoding="utf-8")
    compile_library(target, folder / f"kernel.{target.ending}")


def compile_library(target: Target, path: Path) -> None:
    """Build the library for a platform; it is there as a whole or not at all."""
    libraries = [] if target.ending == "dll" else ["-pthread", "-lm"]
    if target.platform.startswith("macos"):
        # or the folder it was built in would be in it
        libraries.append("-Wl,-install_name,@rpath/kernel.so")

    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        made = Path(folder) / path.name
        compile_for(target, made, *FLAGS, *sorted(SOURCES.glob("*.c")), *libraries)
        made.replace(path)


def fingerprint() -> str:
    """Hash of all inputs of the library."""
    digest = hashlib.sha256(" ".join(FLAGS).encode())
    compiler_named = ROOT / "scripts" / f"requirements-{KERNEL}.txt"
    for path in [*sorted(SOURCES.glob("*.[ch]")), compiler_named]:
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


def provide() -> None:
    """Build the library for this machine, where tests and scripts import it from, unless it is
    there.
    """
    target = this_target()
    stamp = HERE / "kiriko.stamp"
    wanted = fingerprint()
    if target is None or (stamp.exists() and stamp.read_text(encoding="utf-8") == wanted):
        return
    stamp.unlink(missing_ok=True)
    make_package(target, HERE)
    stamp.write_text(wanted, encoding="utf-8")


SUMMARY = "The compiled kernel of Kiriko, an extension of Blender."
METADATA = """\
Metadata-Version: 2.1
Name: {name}
Version: {version}
Summary: {summary}
License: GPL-3.0-or-later
"""
WHEEL = """\
Wheel-Version: 1.0
Generator: kiriko
Root-Is-Purelib: false
Tag: py3-none-{tag}
"""


def wheel_name(target: Target) -> str:
    """File name of the wheel for a platform."""
    return f"{MODULE}-{version()}-py3-none-{target.tag}.whl"


def version() -> str:
    """The extension's version and the fingerprint of the kernel's sources. Blender does not replace
    an installed wheel of the same version.
    """
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    return f"{manifest['version']}+{fingerprint()[:8]}"


def make_wheels(targets: Iterable[Target]) -> None:
    """Build a wheel for each of some platforms into wheels/."""
    WHEELS.mkdir(exist_ok=True)
    for old in WHEELS.glob(f"{MODULE}-*.whl"):
        old.unlink()
    for target in targets:
        with tempfile.TemporaryDirectory() as folder:
            make_package(target, Path(folder, MODULE))
            info = Path(folder, f"{MODULE}-{version()}.dist-info")
            info.mkdir()
            told = {"name": MODULE, "version": version(), "summary": SUMMARY, "tag": target.tag}
            (info / "METADATA").write_text(METADATA.format(**told), encoding="utf-8")
            (info / "WHEEL").write_text(WHEEL.format(**told), encoding="utf-8")
            pack = [compiler(), "-m", "wheel", "pack", folder, "--dest-dir", WHEELS]
            run(pack, SOURCE_DATE_EPOCH=EPOCH)


if __name__ == "__main__":
    try:
        provide()
    except ToolError as error:
        sys.exit(str(error))
