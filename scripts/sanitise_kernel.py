"""Runs Python with a kernel that stops at an invalid access or undefined behaviour: `-m pytest
...`.

Needs gcc with its libasan, and Linux; otherwise it prints so and succeeds.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from pathlib import Path

from build_kernel import SOURCES
from environments import DEV, ROOT, ToolError, ask, clean_environment, run

CHECKS = "-fsanitize=address,undefined,float-cast-overflow"
FLAGS = ["-std=c17", "-O2", "-g", "-ffp-contract=off", CHECKS, "-fno-sanitize-recover=all"]
NOT_HERE = "Not run: this takes Linux and gcc with libasan."
# Python itself frees little at its end, and numpy's own memory is none of ours.
OPTIONS = {"ASAN_OPTIONS": "detect_leaks=0", "UBSAN_OPTIONS": "print_stacktrace=1"}


def runtime() -> str | None:
    """Libraries to preload: the sanitiser's, and the C++ library, because the sanitiser intercepts
    Blender's exceptions.
    """
    if platform.system() != "Linux" or not shutil.which("gcc"):
        return None
    names = ("libasan.so", "libstdc++.so")
    found = [Path(line) for name in names for line in ask(["gcc", f"-print-file-name={name}"])]
    is_there = all(path.is_absolute() and path.exists() for path in found)
    return " ".join(str(path.resolve()) for path in found) if is_there else None


def sanitised() -> dict[str, str] | None:
    """Build the sanitised kernel; returns the environment variables for Python to use it, None if
    it is impossible.
    """
    libraries = runtime()
    if libraries is None:
        return None

    built = DEV / "kernel-sanitised.so"
    shared = "-fvisibility=hidden", "-shared", "-fPIC", "-pthread", "-o", built
    run(["gcc", *FLAGS, *shared, *sorted(SOURCES.glob("*.c")), "-lm"])
    return {"LD_PRELOAD": libraries, "KIRIKO_KERNEL": str(built), **OPTIONS}


def main() -> None:
    variables = sanitised()
    if variables is None:
        print(NOT_HERE)
        return

    command = [sys.executable, *sys.argv[1:]]
    sys.exit(subprocess.run(command, cwd=ROOT, env=clean_environment(**variables)).returncode)


if __name__ == "__main__":
    try:
        main()
    except ToolError as error:
        sys.exit(str(error))
