"""Compiles the kernel for one platform with zig's clang: platforms, flags, and the hash of all
inputs.

The checkout uses this file, and so does the source distribution of `kiriko-kernel`.
"""

from __future__ import annotations

import hashlib
import platform
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

HERE = Path(__file__).resolve().parent
# No fast arithmetic: sums are as they are written, and the same on all platforms.
FLAGS = (
    *("-std=c17", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fvisibility=hidden"),
    *("-Wall", "-Wextra", "-Werror", "-shared", "-s"),
)


class Target(NamedTuple):
    """A platform: its name for Blender, its name for zig, the tag of its wheels, the suffix of its
    library, and what the linker adds.
    """

    platform: str
    triple: str
    tag: str
    ending: str
    libraries: tuple[str, ...] = ()


LINUX = "-pthread", "-lm"
MACOS = *LINUX, "-Wl,-install_name,@rpath/kernel.so"  # or the folder it was built in would be in it
TARGETS = (
    Target("linux-x64", "x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64", "so", LINUX),
    Target("linux-arm64", "aarch64-linux-gnu.2.17", "manylinux_2_17_aarch64", "so", LINUX),
    Target("windows-x64", "x86_64-windows-gnu", "win_amd64", "dll"),
    Target("windows-arm64", "aarch64-windows-gnu", "win_arm64", "dll"),
    Target("macos-x64", "x86_64-macos.11.0", "macosx_11_0_x86_64", "so", MACOS),
    Target("macos-arm64", "aarch64-macos.11.0", "macosx_11_0_arm64", "so", MACOS),
)
MACHINES = {"x86_64": "x64", "AMD64": "x64", "aarch64": "arm64", "arm64": "arm64", "ARM64": "arm64"}
SYSTEMS = {"Linux": "linux", "Windows": "windows", "Darwin": "macos"}

# compiles sources for a platform to a path, with options for the compiler
Compiler = Callable[..., None]


def this_target() -> Target | None:
    """The current platform; None if the kernel has none for it."""
    name = f"{SYSTEMS.get(platform.system())}-{MACHINES.get(platform.machine())}"
    return next((target for target in TARGETS if target.platform == name), None)


def with_zig(target: Target, path: Path, *sources: str | Path) -> None:
    """Compile C for a platform with zig of the running Python."""
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", target.triple]
    subprocess.run([*zig, "-o", str(path), *map(str, sources)], check=True)


def compile_library(
    target: Target, path: Path, sources: Path, compiler: Compiler = with_zig
) -> None:
    """Build the library for a platform from a folder of sources; it is there as a whole or not at
    all.
    """
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        made = Path(folder) / path.name
        compiler(target, made, *FLAGS, *sorted(sources.glob("*.c")), *target.libraries)
        made.replace(path)


def configuration() -> dict[str, Any]:
    """The package's pyproject.toml."""
    return tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))


def version() -> str:
    """Version of the package."""
    return configuration()["project"]["version"]


def fingerprint(sources: Path) -> str:
    """Hash of all inputs of the package: sources, flags, platforms and compiler."""
    compiler = next(one for one in configuration()["build-system"]["requires"] if "zig" in one)
    digest = hashlib.sha256(repr((FLAGS, *map(tuple, TARGETS), compiler)).encode())
    for path in (*sorted(sources.glob("*.[ch]")), HERE / "kiriko_kernel" / "__init__.py"):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


def check_version(sources: Path) -> None:
    """Raise SystemExit if the sources are not those recorded for the version."""
    found = fingerprint(sources)[:16]
    if configuration()["tool"]["kiriko"]["sources"].get(version()) != found:
        raise SystemExit(
            f"The kernel's sources are not those of version {version()}: raise the version in"
            f' scripts/packages/kernel/pyproject.toml, and add the line "<version>" = "{found}" to'
            " its table of sources."
        )
