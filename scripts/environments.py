"""Finds Python interpreters and keeps one virtual environment for each set of pins under .dev/."""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DEV = ROOT / ".dev"
WINDOWS = os.name == "nt"

# Environment -> Python. Each has its pins in
# requirements-<name>.txt. The ones with Blender: newest first.
BLENDERS = {"bpy-5.2.3": "3.13", "bpy-4.5.15": "3.11", "bpy-4.2.23": "3.11"}
PYTHONS = {**BLENDERS, "core": "3.11"}
# Environments without Blender, for any Python with one; set up only by
# `dev.py marks` and `dev.py manual`.
BENCH = "bench"
MANUAL = "manual"
# The readers of warp maps, only for `dev.py farm`.
FARM = "farm"
# The C compiler of scripts/build_kernel.py.
KERNEL = "kernel"
# Reader of compiled libraries, only for tests/package/test_libraries.py.
FORMATS = "formats"

# Libraries that Blender needs but a bare Debian or Ubuntu does not have;
# without the last two, EEVEE aborts the process.
LIBRARIES = (
    "libx11-6 libxrender1 libxfixes3 libxi6 libxkbcommon0 libsm6 libgl1 libgomp1 libegl1"
    " libgl1-mesa-dri"
)

# numpy's linear algebra, for processes in parallel:
# threads that wait for each other would delay all of them
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "VECLIB_MAXIMUM_THREADS": "1"}

LEAST_LLVM = 17  # Dr.Jit takes 15 and 16 too, and with them aborts the process on some processors
MISSING_LLVM = (
    "Mitsuba finds no LLVM that it can use: install libLLVM 19 ('apt install libllvm19' on"
    " Debian 12), or set DRJIT_LIBLLVM_PATH to the file of that library, and run this again."
)

# A Python without ensurepip makes no virtual environment, and a
# free-threaded one ("3.13t") has no bpy.
PROBE = """
import ensurepip, sys, sysconfig, venv
print("%d.%d" % sys.version_info[:2] + ("t" if sysconfig.get_config_var("Py_GIL_DISABLED") else ""))
print(sys.executable)
"""


# system packages missing for an environment; empty if complete
Missing = Callable[[Path], str | None]


class ToolError(Exception):
    """The reason why the work stops, in one sentence for whoever develops Kiriko."""


def clean_environment(**extra: str) -> dict[str, str]:
    """Environment variables, except those that would add other packages."""
    foreign = ("PYTHONPATH", "PYTHONHOME", "PYTHONSTARTUP", "VIRTUAL_ENV", "__PYVENV_LAUNCHER__")
    kept = {name: value for name, value in os.environ.items() if name not in foreign}
    return {**kept, "PYTHONNOUSERSITE": "1", **extra}


def run(command: Sequence[str | Path], **variables: str) -> None:
    """Run a command, or raise ToolError when it fails."""
    if subprocess.run(command, env=clean_environment(**variables)).returncode:
        raise ToolError(f"This failed, for the reason above: {' '.join(map(str, command))}")


def ask(command: Sequence[str | Path], **variables: str) -> list[str]:
    """Output lines of a command; none if it fails or cannot be started."""
    try:
        answer = subprocess.run(
            command, env=clean_environment(**variables), capture_output=True, text=True, timeout=60
        )
    except (OSError, subprocess.TimeoutExpired):
        return []
    return answer.stdout.splitlines() if answer.returncode == 0 else []


# Python interpreters


@cache
def find_python(version: str, *, only_running: bool = False) -> Path | None:
    """Interpreter of this version with support for virtual environments, or None."""
    for command in [[sys.executable]] if only_running else candidates(version):
        found = ask([*command, "-c", PROBE])
        if found and found[0] == version:
            return Path(found[1])
    return None


def candidates(version: str) -> Iterator[list[str]]:
    """Candidate commands for a Python of this version: the running one, on the PATH, in pyenv, from
    uv.
    """
    yield [sys.executable]
    for name in (f"python{version}", "python3", "python"):
        if path := shutil.which(name):
            yield [path]

    if launcher := shutil.which("py"):
        yield [launcher, f"-{version}"]
    versions = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    newest_first = sorted(
        versions.glob(f"{version}.*"),
        key=lambda p: [int(n) for n in re.findall(r"\d+", p.name)],
        reverse=True,
    )
    for folder in newest_first:
        yield [str(folder / ("python.exe" if WINDOWS else "bin/python"))]

    if uv := shutil.which("uv"):
        # only uv's own Pythons: the system's have been tried, and may not have ensurepip
        ask([uv, "python", "install", version])
        for path in ask([uv, "python", "find", version], UV_PYTHON_PREFERENCE="only-managed"):
            yield [path]


def newest_blender() -> tuple[str, Path]:
    """Environment with the newest Blender for the running Python, else for any available one; and
    its Python.
    """
    for only_running in (True, False):
        for name, version in BLENDERS.items():
            if python := find_python(version, only_running=only_running):
                return name, python
    raise ToolError(
        "No Python 3.13 or 3.11 with its venv module was found: install one, for instance with"
        " 'apt install python3-venv' on Debian 12, 'pyenv install 3.13' or 'uv python install"
        " 3.13', and run this again."
    )


# Virtual environments


def pins(path: Path) -> str:
    """Text of a requirements file with its includes."""
    text = path.read_text(encoding="utf-8")
    included = re.findall(r"^-r (\S+)", text, re.MULTILINE)
    return text + "".join(pins(path.parent / name) for name in included)


def set_up(name: str, python: Path) -> Path:
    """Make or update the environment `name`; returns its interpreter.

    The stamp is written last, so an environment without one is incomplete and is made again.
    """
    folder = DEV / name
    interpreter = folder / ("Scripts/python.exe" if WINDOWS else "bin/python")
    requirements = ROOT / "scripts" / f"requirements-{name}.txt"
    stamp = folder / "kiriko.stamp"
    wanted = hashlib.sha256(pins(requirements).encode()).hexdigest()

    if stamp.exists() and interpreter.exists():
        if stamp.read_text(encoding="utf-8") == wanted:
            return interpreter
        stamp.unlink()
    else:
        run([python, "-m", "venv", "--clear", folder])

    print(f"Installing the packages of {folder} ...", flush=True)
    silent = [] if sys.stdout.isatty() else ["--quiet"]
    pip = [interpreter, "-m", "pip", "install", "--disable-pip-version-check"]
    run([*pip, *silent, "-r", requirements])
    if name in BLENDERS:
        remedy = f"Blender cannot find {{}}: install the packages {LIBRARIES} and run this again."
        provide(interpreter, missing_library, LIBRARIES.split(), remedy)
    if name == BENCH:
        provide(interpreter, missing_llvm, ["libllvm19"], MISSING_LLVM)
    stamp.write_text(wanted, encoding="utf-8")

    return interpreter


def link_package() -> Path:
    """Folder with the checkout as the package `kiriko`, whatever its own name is, and with
    `kiriko_optics` as pip installs it.
    """
    folder = DEV / "link"
    optics = folder / "kiriko_optics"
    optics.mkdir(parents=True, exist_ok=True)
    sources = ROOT / "scripts" / "packages" / "optics" / "kiriko_optics"
    links = {folder / "kiriko": ROOT, optics / "_core": ROOT / "core"}
    for link, place in (
        links | {optics / path.name: path for path in sources.glob("*.py*")}
    ).items():
        if not link.is_symlink():
            link.symlink_to(place, target_is_directory=place.is_dir())
    return folder


# System libraries


def can_install() -> bool:
    """Whether this is Debian or Ubuntu, and we may install packages."""
    return bool(shutil.which("apt-get")) and hasattr(os, "geteuid") and os.geteuid() == 0


def install(packages: Sequence[str]) -> None:
    """Install packages of Debian or Ubuntu."""
    run(["apt-get", "-qq", "update"])
    command = ["apt-get", "-qq", "install", "--yes", "--no-install-recommends", *packages]
    run(command, DEBIAN_FRONTEND="noninteractive")


# Those of Blender


@contextmanager
def empty_profile() -> Iterator[str]:
    """Folder for BLENDER_USER_RESOURCES: a Blender without the user's own settings and
    extensions.
    """
    with tempfile.TemporaryDirectory(prefix="kiriko-profile-") as folder:
        yield folder


def python_path() -> str:
    """PYTHONPATH of scripts: the package, the modules of scripts/, and tests/known."""
    return os.pathsep.join(map(str, (link_package(), ROOT / "scripts", ROOT / "tests")))


def as_module(script: str) -> tuple[str, ...]:
    """Python's arguments to run a module of scripts/, isolated from the working folder."""
    return "-P", "-m", script


def run_in_newest_blender(script: str, *options: str | Path, **variables: str) -> int:
    """Run a module of scripts/ in the newest Blender; its exit code."""
    interpreter = set_up(*newest_blender())
    with empty_profile() as profile:
        own = {"BLENDER_USER_RESOURCES": profile, "PYTHONPATH": python_path(), **variables}
        command = [interpreter, *as_module(script), *options]
        return subprocess.run(command, env=clean_environment(**own)).returncode


@contextmanager
def quiet() -> Iterator[None]:
    """Keep Blender's own lines, one for each sample, out of the terminal."""
    sys.stdout.flush()
    stdout = os.dup(1)
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        try:
            yield
        finally:
            sys.stdout.flush()
            os.dup2(stdout, 1)
            os.close(stdout)


def missing_library(interpreter: Path) -> str | None:
    """Name of the first shared library missing for `import bpy`, or None."""
    with empty_profile() as profile:
        tried = subprocess.run(
            [interpreter, "-c", "import bpy, embreex, OpenImageIO"],
            env=clean_environment(BLENDER_USER_RESOURCES=profile),
            capture_output=True,
            text=True,
        )

    if tried.returncode == 0:
        return None
    found = re.search(r"(\S+): cannot open shared object file", tried.stderr)
    if found is None:
        last = (tried.stderr.strip().splitlines() or [f"exit code {tried.returncode}"])[-1]
        raise ToolError(
            f"bpy is installed in {interpreter.parent.parent} and cannot be imported: {last}"
        )

    return found[1]


def provide(interpreter: Path, missing: Missing, packages: Sequence[str], remedy: str) -> None:
    """Install missing system packages of an environment if possible, else raise with their
    names.
    """
    lacks = missing(interpreter)
    if lacks and can_install():
        print(f"{lacks} is missing: installing system packages with apt-get ...", flush=True)
        install(packages)
        lacks = missing(interpreter)
    if lacks:
        raise ToolError(remedy.format(lacks))


# That of Mitsuba


def missing_llvm(interpreter: Path) -> str:
    """The LLVM for Mitsuba, unless it finds a recent one. A separate process tests it, because an
    unsuitable library may abort.
    """
    probe = (
        "import drjit, mitsuba; mitsuba.set_variant('llvm_ad_rgb');"
        " print(drjit.detail.llvm_version()[0])"
    )
    found = ask([interpreter, "-c", probe])
    return "" if found and int(found[-1]) >= LEAST_LLVM else "LLVM"


def machine() -> str:
    """The processor, as far as the system says, and how many of it."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{(names or [platform.processor() or platform.machine()])[0]}, {os.cpu_count()} CPUs"
