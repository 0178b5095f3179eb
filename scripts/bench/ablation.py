"""Effect of each heuristic and option, switched off one at a time, on the sixteen glasses.

`python3 scripts/dev.py ablation [--only NAME ...] [--glass NAME ...] [--rounds N] [--fresh]`, and
with `--table` the table alone. Viewer and display have 512 x 512 pixels, the picture is a zone
plate, *Surface* is Automatic, the kernel has one thread. Each glass has a process of its own, and
each solve a session of its own. The unchanged solver runs before and after every few rows, so both
sides of a ratio are from one run. Results are added to `docs/ablation.json` one by one, and
`docs/ablation.md` is generated from them.

With `--off NAME --run BENCH ...` another bench runs without one row, for instance
`--off "Faces trusted in part" --run irregular`. This shows whether a protected bench needs the row.

`error` is the RMSE of the source image over the display pixels with at least half coverage, `as
seen` the RMSE with each pixel weighted by its light. The reference has four times the viewer
pixels, a fifth of the tolerance and four times the Effort. `meant` is the same error against a
mesh of the intended surface, sixteen times finer; for the scan it is a ball. Rows of the room
`glass` are judged by it, if it exists. References are cached in `out/ablation`; delete this folder
after a change of the optics.
"""

from __future__ import annotations

import argparse
import json
import runpy
import subprocess
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from time import process_time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from environments import ROOT, as_module, machine, run_in_newest_blender
from kiriko.core.base.fingerprint import fingerprint
from kiriko.core.base.steps import run_steps
from kiriko.core.glass.solids import solids_from_mesh
from kiriko.core.lab.measure.reference import HALF
from kiriko.core.native import loading
from kiriko.core.rig.rig import Mesh, Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import Solution
from known.reference_rigs import finer, glass_rig, zone_plate

from .ablation_rows import ROWS, Row, import_all
from .ablation_table import GAIN, table, without_row

CACHE = ROOT / "out" / "ablation"
RESULTS = ROOT / "docs" / "ablation.json"
TABLE = ROOT / "docs" / "ablation.md"

TIMES_FINER = 2  # viewer pixels of a reference, each way
TOLERANCE = 0.02  # display px, of a reference
EFFORT = 64  # of a reference, for each of its viewer pixels
EVERY = 6  # rows between two solves without a change

# A measurement: error, as seen, rays, CPU seconds; error and as seen against the surface meant
# (None where it is not known)
Numbers = tuple[float, float, int, float, float | None, float | None]


class Measured(NamedTuple):
    """The source image (H, W, 3) of a solve, its rays, and its CPU seconds."""

    source: NDArray[np.float32]
    n_rays: int
    seconds: float


@dataclass(frozen=True, eq=False)
class Wanted:
    """A source image (H, W, 3), the pixels (H, W) with at least half coverage, and their light (H,
    W).
    """

    source: NDArray[np.float32]
    is_seen: NDArray[np.bool_]
    light: NDArray[np.float64]

    def errors(self, source: NDArray[np.float32]) -> tuple[float, float]:
        """RMSE over the seen pixels, and over all pixels by their light."""
        squared = ((source - self.source).astype(float) ** 2).mean(axis=2)
        return (
            float(np.sqrt(squared[self.is_seen].mean())),
            float(np.sqrt(np.average(squared, weights=self.light))),
        )


# The glasses


def provide_meshes() -> list[str]:
    """Make missing meshes in Blender; returns the names of the glasses, in order."""
    for folder, options in ((CACHE / "drawn", ()), (CACHE / "meant", ("--meant",))):
        if not folder.exists():
            folder.mkdir(parents=True)
            if run_in_newest_blender("bench.brought_glass", folder, *options):
                sys.exit("The glasses were not made, for the reason above.")
    files = sorted((CACHE / "drawn").glob("*.npz"), key=lambda path: path.stat().st_mtime_ns)
    return [path.stem for path in files]


def rig_of(path: Path, surface: str) -> Rig:
    """The bench with a glass of a file, followed by a choice of *Surface*."""
    with np.load(path) as found:
        parts = {name: found[name][()] for name in found.files}
    index = parts.pop("index")
    mesh = replace(Mesh(**parts), surface=surface)
    return glass_rig(mesh, ior=index, image=zone_plate(), display_pixels=512)


def wanted(name: str, kind: str) -> Wanted | None:
    """The reference of a glass, `drawn` or `meant`, from the cache; None if it is unknown."""
    mesh, cached = CACHE / kind / f"{name}.npz", CACHE / "references" / f"{name}, {kind}.npz"
    if not mesh.exists():
        return None
    if not cached.exists():
        surface = "automatic" if kind == "drawn" else "facets"
        solution = solved(
            finer(rig_of(mesh, surface), TIMES_FINER), Settings(tolerance=TOLERANCE, effort=EFFORT)
        )
        cached.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(
            cached,
            source=solution.source,
            is_seen=solution.display_coverage >= HALF,
            light=solution.weight,
        )
    with np.load(cached) as found:
        return Wanted(**{part: found[part] for part in found.files})


def solved(rig: Rig, settings: Settings | None = None) -> Solution:
    """A whole solve in a session of its own."""
    return run_steps(Session().solve(rig, settings or Settings()))


# Measurements


class Glass:
    """A glass on the bench, with its references."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.rig = rig_of(CACHE / "drawn" / f"{name}.npz", "automatic")

    @cached_property
    def as_drawn(self) -> Wanted:
        return wanted(self.name, "drawn")

    @cached_property
    def as_meant(self) -> Wanted | None:
        return wanted(self.name, "meant")

    def measured(self, row: Row | None, rounds: int, by_numpy: bool = False) -> Measured:
        """Some solves with a row switched off, or with nothing switched off."""
        with row.off() if row else nullcontext(), loading.off() if by_numpy else nullcontext():
            seconds = []
            for _ in range(rounds):
                started = process_time()
                solution = solved(self.rig)
                seconds.append(process_time() - started)
        return Measured(solution.source, solution.n_rays, min(seconds))

    @cache  # noqa: B019, a glass lives as long as its process
    def base(self, rounds: int) -> Measured:
        """The solver as it is, measured once."""
        return self.measured(None, rounds)

    def fitted(self, row: Row | None) -> tuple[str, float]:
        """Fingerprint of the traced surfaces, and CPU seconds to make them."""
        with row.off() if row else nullcontext():
            started = process_time()
            meshes = [glass.mesh for glass in self.rig.glasses]
            surfaces = tuple(made for mesh in meshes for made in solids_from_mesh(mesh))
            seconds = process_time() - started
        return fingerprint(surfaces), seconds

    def numbers(self, row: Row, found: Measured) -> Numbers:
        """The numbers of a measurement, as far as a row needs them."""
        error, seen = self.as_drawn.errors(found.source)
        is_meant = row.is_fit and self.as_meant is not None
        meant = self.as_meant.errors(found.source) if is_meant else (None, None)
        return error, seen, found.n_rays, found.seconds, *meant


def measure_glass(name: str, rows: Sequence[Row], rounds: int) -> None:
    """Measure rows on a glass, and add each to the results."""
    loading.use_threads(1)
    import_all()
    glass = Glass(name)
    solved(glass.rig)  # all is imported and read from disk by now
    glass.fitted(None)
    rows = [row for row in rows if not (row.is_fit and _fits_alike(glass, row, rounds))]

    for by_numpy in (False, True):
        some = [row for row in rows if row.by_numpy == by_numpy]
        groups = [some[k : k + EVERY] for k in range(0, len(some), EVERY)]
        before = glass.measured(None, rounds, by_numpy) if groups else None
        for group in groups:
            found = [_tried(glass, row, rounds) for row in group]
            after = glass.measured(None, rounds, by_numpy)
            mean = after._replace(seconds=(before.seconds + after.seconds) / 2)
            for row, one in zip(group, found, strict=True):
                off, base = _confirmed(glass, row, rounds, one, mean)
                off = off if isinstance(off, str) else glass.numbers(row, off)
                save(row.name, name, off, glass.numbers(row, base))
            before = after


def _confirmed(
    glass: Glass, row: Row, rounds: int, off: Measured | str, on: Measured
) -> tuple[Measured | str, Measured]:
    """Measurements without a row and with it, once more where it seems to gain CPU seconds: other
    work on the machine may have taken them.
    """
    if isinstance(off, str) or off.seconds < (1 + GAIN) * on.seconds:
        return off, on
    seconds = [glass.measured(one, rounds, row.by_numpy).seconds for one in (row, None, row, None)]
    return (
        off._replace(seconds=min(off.seconds, *seconds[::2])),
        on._replace(seconds=min(on.seconds, *seconds[1::2])),
    )


def _fits_alike(glass: Glass, row: Row, rounds: int) -> bool:
    """Whether a row leaves the surfaces of a glass unchanged. Then no solve is needed: the row
    costs or saves only the seconds of fitting.
    """
    on, seconds_on = glass.fitted(None)
    try:
        off, seconds_off = glass.fitted(row)
    except Exception:  # the solve shows the same
        return False
    if off != on:
        return False
    base = glass.base(rounds)
    same = base._replace(seconds=base.seconds + seconds_off - seconds_on)
    error, seen = glass.as_drawn.errors(base.source)
    save(
        row.name,
        glass.name,
        *((error, seen, one.n_rays, one.seconds, None, None) for one in (same, base)),
    )
    return True


def _tried(glass: Glass, row: Row, rounds: int) -> Measured | str:
    """A row's measurement, or the failure caused by its change."""
    try:
        return glass.measured(row, rounds, row.by_numpy)
    except Exception as error:  # whatever stops the solve is the result
        return f"{type(error).__name__}: {error}"


def save(row: str, glass: str, off: Numbers | str, on: Numbers) -> None:
    """Add a measurement to the results, in the place of the one before."""
    results = load()
    if isinstance(off, str):
        found = off  # a fault
        print(f"{glass:<16}{row:<48}{off}", flush=True)
    else:
        found = [[_short(value) for value in numbers] for numbers in (off, on)]
        shown = "".join(f"{a / b:9.3f}" if b else f"{'':9}" for a, b in zip(off, on, strict=True))
        print(f"{glass:<16}{row:<48}{shown}", flush=True)
    results.setdefault(row, {})[glass] = found
    lines = (
        f"{json.dumps(name)}: {json.dumps(results[name], sort_keys=True)}"
        for name in sorted(results)
    )
    RESULTS.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def _short(value: float | None) -> float | None:
    return value if value is None or isinstance(value, int) else float(f"{value:.4g}")


def load() -> dict[str, dict[str, list]]:
    """The results by row and glass: the numbers without the row's heuristic, and with it."""
    return json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}


def write_table() -> None:
    """Make `docs/ablation.md` of the results."""
    TABLE.write_text(table(ROWS, load(), machine()), encoding="utf-8")


def run_without(arguments: argparse.Namespace) -> None:
    """Run another bench without a row, in Blender; ends with its exit code."""
    row = next((row for row in ROWS if row.name == arguments.off), None)
    if row is None:
        sys.exit(f"No row is named '{arguments.off}': docs/ablation.md lists them.")
    if not arguments.here:
        options = ("--here", "--off", arguments.off, "--run", *arguments.run)
        sys.exit(run_in_newest_blender("bench.ablation", *options))
    bench, *sys.argv[1:] = arguments.run
    with row.off():
        runpy.run_module(f"bench.{bench}", run_name="__main__")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", nargs="+", default=[""], metavar="NAME", help="rooms and rows with this in a name"
    )
    parser.add_argument("--glass", nargs="+", metavar="NAME", help="only these glasses")
    parser.add_argument("--rounds", type=int, default=1, help="solves of each; the fastest counts")
    parser.add_argument("--fresh", action="store_true", help="only rows that are not measured yet")
    parser.add_argument(
        "--table",
        action="store_true",
        help="make the table alone; prints the options without a row",
    )
    parser.add_argument("--numpy", action="store_true", help="rows of the path without kernel, too")
    parser.add_argument("--here", action="store_true", help="measure the first glass here")
    parser.add_argument("--off", metavar="NAME", help="the row without which another bench runs")
    parser.add_argument(
        "--run", nargs=argparse.REMAINDER, metavar="BENCH", help="that bench, and its options"
    )
    arguments = parser.parse_args()
    if arguments.run:
        run_without(arguments)
        return

    if not arguments.table:
        results = load()
        rows = [
            row
            for row in ROWS
            if any(word.lower() in f"{row.room}: {row.name}".lower() for word in arguments.only)
            and (arguments.numpy or not row.by_numpy)
        ]
        if arguments.here:
            name = arguments.glass[0]
            some = [
                row for row in rows if not arguments.fresh or name not in results.get(row.name, {})
            ]
            measure_glass(name, some, arguments.rounds)
            return
        for name in [one for one in provide_meshes() if one in (arguments.glass or [one])]:
            options = [*sys.argv[1:], "--here", "--glass", name]
            subprocess.run([sys.executable, *as_module("bench.ablation"), *options], check=True)

    write_table()
    if arguments.table:
        print(*without_row(ROWS), sep="\n")


if __name__ == "__main__":
    main()
