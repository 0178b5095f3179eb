"""Runs the kernel's libraries for other platforms: Windows x64 under Wine, Linux arm64 under QEMU.

Each traces the same rays through a ball, a cube and an open torus, and must return the same bits as
the library of this machine. Without Wine, QEMU or the platform's C library, the library is skipped
with a message.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import platform
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from build_kernel import TARGETS, Target, compile_for, compile_library, provide
from environments import ROOT, clean_environment
from kiriko.core.base.steps import run_steps
from kiriko.core.light import kernel_tracer
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.kernel_tracer import made_of, plan_steps
from kiriko.core.light.rays import Rays
from kiriko.core.native import loading
from kiriko.core.native.structures import Made
from kiriko.core.rig.rig import Mesh, Rig
from kiriko.core.rig.settings import Settings
from known.reference_rigs import ball_rig, cube_rig, rig, torus

DRIVER = ROOT / "tests" / "kernel" / "follow.c"
N_RAYS = 20_000


class Runner(NamedTuple):
    """Support for running a platform's programs: command, Debian packages, and their files."""

    command: Sequence[str]
    packages: str
    needs: Sequence[str]


ARM = "/usr/aarch64-linux-gnu"
RUNNERS = {
    "windows-x64": Runner(["/usr/lib/wine/wine64"], "wine64", ["/usr/lib/wine/wine64"]),
    "linux-arm64": Runner(
        ["qemu-aarch64", "-L", ARM],
        "qemu-user and libc6-arm64-cross",
        ["/usr/bin/qemu-aarch64", f"{ARM}/lib/ld-linux-aarch64.so.1"],
    ),
}


def rigs() -> dict[str, Rig]:
    """Rigs that exercise nearly all of the kernel's code."""
    ring = torus(0.018, 0.007, 48, 24)
    keep = np.arange(len(ring.triangles)) % 19 > 0
    gaps = Mesh(
        ring.vertices, ring.triangles[keep], ring.corner_normals[keep], ring.is_smooth[keep]
    )
    return {"ball": ball_rig(3), "cube": cube_rig(), "open torus": rig(gaps)}


class Memory:
    """Blocks of memory, and where they point to each other."""

    def __init__(self) -> None:
        self.blocks: list[tuple[int, bytes]] = []
        self._pointers: list[tuple[int, int, int]] = []

    def add(self, thing: object) -> None:
        """Collect arrays and structures with all their contents."""
        if isinstance(thing, Made):
            self.add(thing.structure)
            for other in thing.references:
                self.add(other)
        elif isinstance(thing, np.ndarray):
            self.blocks.append((thing.ctypes.data, thing.tobytes()))
        elif isinstance(thing, ctypes.Structure | ctypes.Array):
            address = ctypes.addressof(thing)
            block = len(self.blocks)
            self.blocks.append((address, ctypes.string_at(address, ctypes.sizeof(thing))))
            self._pointers += [
                (block, place, value) for place, value in pointers_of(thing, address)
            ]
        elif isinstance(thing, list | tuple):
            for other in thing:
                self.add(other)

    def find(self, address: int) -> tuple[int, int]:
        """Number of the block with an address, and the offset in it."""
        for number, (start, content) in enumerate(self.blocks):
            if start <= address < start + max(len(content), 1):
                return number, address - start
        raise LookupError(f"no block holds {address:#x}")

    def pointers(self) -> list[tuple[int, int, int, int]]:
        """Block and offset of each pointer and of its target."""
        return [(block, place, *self.find(value)) for block, place, value in self._pointers]


def pointers_of(thing: ctypes.Structure | ctypes.Array, start: int) -> Iterator[tuple[int, int]]:
    """Offset from `start`, and value, of each non-null pointer in a structure."""
    if isinstance(thing, ctypes.Array):
        for part in thing:
            if isinstance(part, ctypes.Structure):
                yield from pointers_of(part, start)
        return
    for name, kind in thing._fields_:
        value = getattr(thing, name)
        if kind is ctypes.c_void_p and value:
            yield ctypes.addressof(thing) + getattr(type(thing), name).offset - start, value
        elif isinstance(value, ctypes.Structure):
            yield from pointers_of(value, start)


def write_case(a_rig: Rig, path: Path) -> bytes:
    """Write a case for the driver, and the outputs of this machine's library."""
    plan = compile_plan(a_rig, Settings())
    viewer = a_rig.viewer
    xy = np.random.default_rng(0).random((N_RAYS, 2)) * [viewer.width, viewer.height]
    rays = Rays(*viewer.rays(xy), None, False)
    made = kernel_tracer.state_of(rays)
    run_steps(plan_steps(plan))
    of_plan = made_of(plan)
    memory = Memory()
    memory.add(of_plan)
    memory.add(made)
    unread = "n_words", "is_astray", "has_ended"
    names = [name for name in kernel_tracer.STATE if name not in unread]
    outputs = [memory.find(getattr(rays, name).ctypes.data)[0] for name in names]
    pointers = memory.pointers()
    numbers = [
        *(len(memory.blocks), len(pointers), len(outputs)),
        *(memory.find(ctypes.addressof(of.structure))[0] for of in (of_plan, made)),
        N_RAYS,
    ]

    with path.open("wb") as file:
        file.write(struct.pack(f"<{len(numbers)}q", *numbers))
        for _, content in memory.blocks:
            file.write(struct.pack("<q", len(content)) + content)
        for pointer in pointers:
            file.write(struct.pack("<4q", *pointer))
        file.write(struct.pack(f"<{len(outputs)}q", *outputs))

    loading.library().kiriko_follow(
        ctypes.addressof(of_plan.structure), ctypes.addressof(made.structure), 0, N_RAYS, 2
    )
    assert (rays.reason == 0).mean() > 0.1

    return b"".join(getattr(rays, name).tobytes() for name in names)


def check(target: Target, runner: Runner, folder: Path) -> bool:
    """Run all cases with a platform's library; returns whether all bits are equal to this
    machine's.
    """
    library = folder / f"kernel.{target.ending}"
    driver = folder / "follow.exe"
    compile_library(target, library)
    compile_for(target, driver, "-O1", DRIVER)

    is_same = True
    for name, a_rig in rigs().items():
        case = folder / "case"
        out = folder / "out"
        expected = write_case(a_rig, case)
        variables = clean_environment(WINEPREFIX=str(folder / "wine"), WINEDEBUG="-all")
        command = [*runner.command, driver, f"./{library.name}", case.name, out.name]
        done = subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True)
        found = out.read_bytes() if done.returncode == 0 else b""
        is_same &= found == expected
        n_other = sum(a != b for a, b in zip(found, expected, strict=False))
        verdict = (
            f"{n_other} bytes differ" if found else f"ended with {done.returncode}: {done.stderr}"
        )
        print(
            f"{target.platform:<14} {name:<12} {N_RAYS} rays:"
            f" {'the same bits' if found == expected else verdict}"
        )

    return is_same


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--platform", nargs="+", choices=RUNNERS, default=list(RUNNERS), help="only these"
    )
    arguments = parser.parse_args()
    provide()
    if loading.library() is None or platform.machine() not in ("x86_64", "AMD64"):
        print("Not run: this takes a kernel on x64.")
        return

    is_same = True
    for target in TARGETS:
        if target.platform not in arguments.platform:
            continue
        runner = RUNNERS[target.platform]
        if not all(Path(path).exists() for path in runner.needs):
            print(f"{target.platform:<14} not run: {runner.packages} are missing")
            continue
        with tempfile.TemporaryDirectory() as folder:
            is_same &= check(target, runner, Path(folder))

    sys.exit(not is_same)


if __name__ == "__main__":
    os.environ.pop("KIRIKO_KERNEL", None)
    main()
