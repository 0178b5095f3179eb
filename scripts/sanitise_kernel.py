"""Runs Python with the kernel built to stop at a wrong access or an
undefined step: `sanitise_kernel.py -m pytest ...`.

Needs gcc with its libasan, and Linux; says so and ends well where they are not.
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
# Python itself frees little at its end, and numpy's own memory is none of ours.
OPTIONS = {"ASAN_OPTIONS": "detect_leaks=0", "UBSAN_OPTIONS": "print_stacktrace=1"}


def runtime() -> Path | None:
    """The sanitiser's library, which has to be loaded before Python's own."""
    if platform.system() != "Linux" or not shutil.which("gcc"):
        return None
    found = [Path(line) for line in ask(["gcc", "-print-file-name=libasan.so"])]
    return next((path for path in found if path.is_absolute() and path.exists()), None)


def main() -> None:
    library = runtime()
    if library is None:
        print("Not run: this takes Linux and gcc with libasan.")
        return

    built = DEV / "kernel-sanitised.so"
    sources = sorted(SOURCES.glob("*.c"))
    run(
        [
            "gcc",
            *FLAGS,
            "-fvisibility=hidden",
            "-shared",
            "-fPIC",
            "-pthread",
            "-o",
            built,
            *sources,
            "-lm",
        ]
    )
    variables = clean_environment(
        LD_PRELOAD=str(library.resolve()), KIRIKO_KERNEL=str(built), **OPTIONS
    )
    sys.exit(subprocess.run([sys.executable, *sys.argv[1:]], cwd=ROOT, env=variables).returncode)


if __name__ == "__main__":
    try:
        main()
    except ToolError as error:
        sys.exit(str(error))
