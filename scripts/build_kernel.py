"""Builds the compiled kernel from core/native/*.c for this machine, where tests and scripts import
it.

It is built anew whenever its sources have changed. The flags are those of the package
`kiriko-kernel` (packages/kernel/compile_kernel.py), which wheels.py builds.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from environments import DEV, KERNEL, ROOT, ToolError, find_python, run, set_up
from packages.kernel import compile_kernel
from packages.kernel.compile_kernel import TARGETS, Target, this_target

SOURCES = ROOT / "core" / "native"
MODULE = "kiriko_kernel"
HERE = DEV / "link" / MODULE  # imported by tests and scripts


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
    package = Path(compile_kernel.__file__).parent / MODULE
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(package / "__init__.py", folder)
    compile_library(target, folder / f"kernel.{target.ending}")


def compile_library(target: Target, path: Path) -> None:
    """Build the library for a platform; it is there as a whole or not at all."""
    compile_kernel.compile_library(target, path, SOURCES, compile_for)


def provide() -> None:
    """Build the library for this machine, where tests and scripts import it from, unless it is
    there.
    """
    target = this_target()
    stamp = HERE / "kiriko.stamp"
    wanted = compile_kernel.fingerprint(SOURCES)
    if target is None or (stamp.exists() and stamp.read_text(encoding="utf-8") == wanted):
        return
    stamp.unlink(missing_ok=True)
    make_package(target, HERE)
    stamp.write_text(wanted, encoding="utf-8")


__all__ = ["MODULE", "TARGETS", "Target", "this_target"]

if __name__ == "__main__":
    try:
        provide()
    except ToolError as error:
        sys.exit(str(error))
