"""Starts the real Blender with a window, and has it play."""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from environments import ROOT, ToolError, clean_environment, newest_blender, run, set_up

SIZE = 1280, 800  # px of the window: large enough for all parts of Blender's own layout
VARIABLE = "KIRIKO_BLENDER"
FREE = range(90, 100)  # display numbers for Xvfb
MINUTES = 40.0
NO_BLENDER = (
    "No Blender program was found: install Blender 5.2, and name it by --blender PATH or by the"
    f" environment variable {VARIABLE}, or put it on the PATH."
)
NO_DISPLAY = (
    "There is no screen for Blender's window: run this where DISPLAY names one, or install Xvfb"
    " ('apt install xvfb' on Debian 12)."
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add options for Blender and for Kiriko's zip to a script."""
    where = f"the Blender program; else that of {VARIABLE}, else that of the PATH"
    parser.add_argument("--blender", metavar="PROGRAM", help=where)
    zipped = "Kiriko's zip for this machine; built by default"
    parser.add_argument("--extension", type=Path, metavar="ZIP", help=zipped)


def blender_program(named: str | None) -> str:
    """Blender's path: as given, else from the environment variable, else on the PATH."""
    wanted = named or os.environ.get(VARIABLE) or "blender"
    found = shutil.which(wanted)
    if found is None:
        raise ToolError(NO_BLENDER)
    return found


@contextmanager
def screen(size: tuple[int, int] = SIZE) -> Iterator[dict[str, str]]:
    """Environment variables of a screen: the existing one, else a virtual one of this size."""
    if not sys.platform.startswith("linux") or os.environ.get("DISPLAY"):
        yield {}
        return
    if not shutil.which("Xvfb"):
        raise ToolError(NO_DISPLAY)

    number = next((n for n in FREE if not Path(f"/tmp/.X11-unix/X{n}").exists()), None)
    if number is None:
        raise ToolError(f"Displays {FREE[0]} to {FREE[-1]} are all taken: end what uses them.")
    width, height = size
    options = ["-screen", "0", f"{width}x{height}x24", "-dpi", "96", "+extension", "GLX"]
    server = subprocess.Popen(["Xvfb", f":{number}", *options], stderr=subprocess.DEVNULL)
    try:
        while not Path(f"/tmp/.X11-unix/X{number}").exists() and server.poll() is None:
            time.sleep(0.1)
        if server.poll() is not None:
            raise ToolError(f"Xvfb ended with {server.returncode}: start a screen of your own.")
        yield {"DISPLAY": f":{number}", "LIBGL_ALWAYS_SOFTWARE": "1"}
    finally:
        server.terminate()
        server.wait()


def built_extension() -> Path:
    """A new zip for this machine."""
    run([set_up(*newest_blender()), ROOT / "scripts" / "package.py", "--keep-manual"])
    arm = platform.machine().lower() in {"arm64", "aarch64"}
    system = {"linux": "linux", "darwin": "macos", "win32": "windows"}[sys.platform]
    (found,) = (ROOT / "dist").glob(f"kiriko-*-{system}_{'arm64' if arm else 'x64'}.zip")
    return found


def play(
    names: Sequence[str],
    blender: str | None,
    extension: Path | None,
    language: str = "en_US",
    inside: str = "manual/inside.py",
    size: tuple[int, int] = SIZE,
) -> Path:
    """Play in a new Blender with an empty profile; returns the folder with pictures and accounts.

    language : of Blender's interface
    inside : script of scripts/ for Blender to run
    size : of the window, px
    """
    program = blender_program(blender)
    zipped = extension or built_extension()
    folder = ROOT / "out" / "plays" / language
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    command = [
        program, "--factory-startup", "--offline-mode", "--enable-event-simulate",
        "--python-use-system-env", "--window-geometry", "0", "0", *map(str, size),
        "--python", str(ROOT / "scripts" / inside),
        "--", str(zipped.resolve()), str(folder), language, *names,
    ]  # fmt: skip

    with (
        screen(size) as variables,
        tempfile.TemporaryDirectory(prefix="profile-", dir=folder) as home,
    ):
        # a home of its own, or an existing file could pass for the exported one
        extra = {
            "BLENDER_USER_RESOURCES": home,
            "HOME": home,
            "PYTHONPATH": str(ROOT / "scripts"),
        }
        environment = clean_environment(**extra, **variables)
        try:
            code = subprocess.run(command, env=environment, timeout=60 * MINUTES).returncode
        except subprocess.TimeoutExpired:
            raise ToolError(
                f"Blender was stopped: it took more than {MINUTES:g} minutes."
            ) from None

    told = folder / "error.txt"
    if told.exists():
        raise ToolError(told.read_text(encoding="utf-8"))
    if code:
        raise ToolError(f"Blender ended with {code}: its last lines are above.")
    return folder


def account(folder: Path, name: str) -> dict:
    """Clicks, keys and scrolls of a play."""
    path = folder / f"{name}.account.json"
    if not path.exists():
        raise ToolError(f"Blender ended before '{name}' was played: its last lines are above.")
    return json.loads(path.read_text(encoding="utf-8"))
