"""Whole solves of the reference rigs, and of glass from artists: `dev.py bench`.

Viewer and display have 512 x 512 pixels, *Surface* is Automatic. Each case has a process of its
own. `solve`: wall and processor seconds from scratch; `step`: its longest step, which delays Esc;
`repaint`: another picture; `moved`: the viewer moved by a tenth of a millimetre; then seconds of
the solve's parts. `curved`: fraction of the triangles with a curved face; `beyond`: fraction of the
view with an error above the tolerance; `sampled`: fraction in chaotic light. `MB`: memory used, on
Linux, and `told x`: its ratio to the estimate.

`--stages`: per cent of the time of each stage; their means, rounded, are the shares in
core/base/stages.py. `--light`: share of the light past the glass, share of the view whose display
pixel has a stronger path, and the PSNR, dB, of the whole view against the ideal image: by the mean,
by the strongest path, and by the mean with Suppress Glare at 0.5 and 1.

`--defaults`: rigs of Add Rig at their default sizes, see bench/defaults.py.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import statistics
import sys
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

from kiriko.core.base.stages import SHARES, spans
from kiriko.core.base.steps import run_steps
from kiriko.core.image.ghosts import SeenPaths
from kiriko.core.lab.measure.work_precision import measure_choices
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.rig.rig import Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.memory import estimated
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import Solution
from known.reference_rigs import ball_rig, box, cube_rig, glass_rig, lattice_image, rig

from . import defaults
from .brought_glass import GLASSES, OTHERS, filled, made
from .runner import Bench, Row, option, run

MOVED = np.array([1e-4, 0.0, 0.0])  # m, the viewer between two solves
PICTURE = 1024  # px
TOLERANCES = {"ball, 5 k, 1e-4 px": 1e-4}  # display px, of cases with a display of their own


def reference(make: Callable[..., Rig], *sizes: int, **more: int) -> Callable[[], Rig]:
    """A reference rig with the lattice as its picture."""
    return lambda **options: make(*sizes, image=lattice_image(PICTURE), **more | options)


def brought(name: str, **options: int) -> Rig:
    """A glass on the bench, with its filling."""
    return glass_rig(filled(name, replace(made(name), surface="automatic")), **options)


REFERENCES = {
    "ball, 20 k": reference(ball_rig, 5),
    "ball, 1 k": reference(ball_rig, 3),
    "ball, 5 k, 1e-4 px": reference(ball_rig, 4),
    "ball, 1.3 M": reference(ball_rig, 8),
    "cube, reference": reference(cube_rig),
    "slab": reference(partial(rig, box([0.3, 0.03, 0.3]))),
    "ball, display 4096": reference(ball_rig, 5, display_pixels=4096),
    "ball, viewer 4096": reference(ball_rig, 5, pixels=4096),
    "ball, display 8192": reference(ball_rig, 5, display_pixels=8192),
}
BROUGHT = {name: partial(brought, name) for name in [*GLASSES, *OTHERS]}


@dataclass
class Watched:
    """Reported progress of a solve, 0..1, and the elapsed seconds."""

    told: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def watch(self, work: Generator[float, None, Solution]) -> Solution:
        """Run a solve to its end."""
        started = perf_counter()
        while True:
            try:
                self.told.append(next(work))
            except StopIteration as end:
                return end.value
            finally:
                self.seconds.append(perf_counter() - started)

    @property
    def longest(self) -> float:
        """Seconds of the longest step."""
        return float(np.diff(self.seconds, prepend=0.0).max())

    @property
    def of_stages(self) -> np.ndarray:
        """Fractions (n,) of the time, 0..1, by stage."""
        ends = [end for _, end in spans(*((stage,) for stage in SHARES))]
        after = np.searchsorted(self.told, np.array(ends) - 1e-9)
        return np.diff(np.array(self.seconds)[after], prepend=0.0) / self.seconds[-1]


class Memory:
    """Peak of additional memory from now on, bytes; 0 if unknown."""

    def __init__(self) -> None:
        self._before = 0
        if sys.platform == "linux":
            gc.collect()
            ctypes.CDLL(None).malloc_trim(0)
            Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
            self._before = self._read("VmRSS")

    @property
    def taken(self) -> int:
        return self._read("VmHWM") - self._before if self._before else 0

    def _read(self, name: str) -> int:
        lines = Path("/proc/self/status").read_text().splitlines()
        return 1024 * int(dict(line.split(":", 1) for line in lines)[name].split()[0])


def rig_of(make: Callable[..., Rig], arguments: argparse.Namespace) -> Rig:
    """The rig of a case, with a display of another size if requested."""
    return make(display_pixels=arguments.display) if arguments.display else make()


def measure(name: str, make: Callable[..., Rig], arguments: argparse.Namespace) -> Iterator[Row]:
    """Solve, paint another picture and move the viewer, in turns."""
    a_rig = rig_of(make, arguments)
    if arguments.surface:
        parts = (replace(g, mesh=replace(g.mesh, surface=arguments.surface)) for g in a_rig.glasses)
        a_rig = replace(a_rig, glasses=tuple(parts))
    tolerance = TOLERANCES.get(name, Settings().tolerance)
    settings = Settings(tolerance=tolerance, effort=arguments.effort)
    n_triangles = sum(len(glass.mesh.triangles) for glass in a_rig.glasses)
    curved = sum(compile_plan(a_rig, settings).counts.n_curved) / n_triangles
    image = a_rig.picture.image
    memory = Memory()
    rows = []
    for k in range(arguments.rounds):
        session, watched = Session(), Watched()
        of_processor = process_time()
        solution = watched.watch(session.solve(a_rig, settings))
        of_processor = process_time() - of_processor
        row = {"solve s": watched.seconds[-1], "CPU s": of_processor, "step s": watched.longest}
        row |= {f"{part} s": solution.seconds[part] for part in ("plan", "tracing", "shares")}
        if not k:
            taken = memory.taken or np.nan
            told = sum(estimated(a_rig, settings, solution.first.view_map).values())

        turned = replace(a_rig.picture, image=np.flip(image, k % 2).copy())
        viewer = replace(a_rig.viewer, position=a_rig.viewer.position + MOVED)
        other = replace(a_rig, pictures=(turned,))
        for column, again in (("repaint", other), ("moved", replace(a_rig, viewers=(viewer,)))):
            started = perf_counter()
            run_steps(session.solve(again, settings))
            row[f"{column} s"] = perf_counter() - started
        rows.append(row)

    error = solution.first.map_error
    yield {
        **{column: statistics.median(row[column] for row in rows) for column in rows[0]},
        "triangles": n_triangles,
        "rays": solution.n_rays,
        "curved": curved,
        "beyond %": 100 * (error.facet_limited + error.unresolved),
        "sampled %": 100 * error.sampled,
        "MB": taken / 1e6,
        "told x": max(told / taken, taken / told),
    }


def measure_stages(
    name: str, make: Callable[..., Rig], arguments: argparse.Namespace
) -> Iterator[Row]:
    """Percent of the time of each stage."""
    watched = Watched()
    watched.watch(Session().solve(rig_of(make, arguments)))
    parts = (100 * float(part) for part in watched.of_stages)
    yield {"solve s": watched.seconds[-1], **dict(zip(SHARES, parts, strict=True))}


def measure_light(
    name: str, make: Callable[..., Rig], arguments: argparse.Namespace
) -> Iterator[Row]:
    """Cost and gain of Ghosts and Suppress Glare."""
    a_rig, settings = rig_of(make, arguments), Settings(effort=arguments.effort)
    seen = {choice[:2]: choice.seen_psnr for choice in run_steps(measure_choices(a_rig, settings))}
    first = run_steps(Session().solve(a_rig, replace(settings, ghosts="strongest"))).first
    paths = SeenPaths(first.shares.display_size)
    for shares in first.shares:
        paths.add(shares)
    weight, contested = paths.weights()
    yield {
        "glare %": 100 * first.glare.share,
        "contested %": 100 * float((weight * contested).sum() / weight.sum()),
        "mean": seen["mean", 0],
        "strongest": seen["strongest", 0],
        "0.5": seen["mean", 0.5],
        "1": seen["mean", 1],
    }


COLUMNS = {
    "triangles": "d", "solve s": ".2f", "CPU s": ".2f", "step s": ".2f", "repaint s": ".3f",
    "moved s": ".2f", "plan s": ".2f", "tracing s": ".2f", "shares s": ".2f", "rays": "d",
    "curved": ".2f", "beyond %": ".2f", "sampled %": ".2f", "MB": ".0f", "told x": ".2f",
}  # fmt: skip
LIGHT = dict.fromkeys(("glare %", "contested %", "mean", "strongest", "0.5", "1"), ".1f")
TABLED = {name: BROUGHT[name] for name in GLASSES}

if __name__ == "__main__":
    run(
        __doc__,
        "bench.solve",
        Bench(REFERENCES | BROUGHT, COLUMNS, measure, is_apart=True),
        option("--surface", choices=("facets", "smooth", "automatic"), help="instead of Automatic"),
        option("--effort", type=int, default=Settings().effort, help="where light is chaotic"),
        option("--display", type=int, metavar="PIXELS", help="of the display, each way"),
        stages=Bench(
            TABLED, {"solve s": ".2f", **dict.fromkeys(SHARES, ".1f")}, measure_stages, mean="mean"
        ),
        light=Bench(TABLED, LIGHT, measure_light),
        defaults=Bench(defaults.DEFAULTS, defaults.COLUMNS, defaults.measure, is_apart=True),
    )
