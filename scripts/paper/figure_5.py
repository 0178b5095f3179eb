"""The ball's source image by each plate and each way, and the times: figure 5 of the paper."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time
from typing import TypeVar

import numpy as np

from kiriko.core.base.arrays import Floats
from kiriko.core.base.steps import run_steps
from kiriko.core.files import image_io
from kiriko.core.image.source_image import splat
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.rig.rig import PRESETS, Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.solution import Solution
from known.reference_rigs import finer

from .figures_7_and_8 import solve
from .published import PAPER_SECONDS, SPP, Table

# of a converged solve: viewer pixels each way times as many, tolerance in display px
FINER = 2
FINEST = 1e-3
Result = TypeVar("Result")


def rmse(one: Floats, other: Floats | None = None) -> float:
    """Root of the mean product of two errors: of one error its RMSE, of two with noise of their own
    their common part.
    """
    return float(np.sqrt(max(np.mean(one * (one if other is None else other)), 0.0)))


def holes(source: Floats, best: Solution) -> int:
    """How many display pixels (H, W, 3) are black where the converged image is bright."""
    return int(
        (
            (best.display_coverage > 0.999)
            & (source.max(axis=2) == 0)
            & (best.source.max(axis=2) > 0.5)
        ).sum()
    )


def timed(run: Callable[[], Result]) -> tuple[Result, list[str]]:
    """The result of a run, with its wall and processor seconds, as in a table."""
    started = perf_counter()
    busy = process_time()
    found = run()
    return found, [
        f"{seconds:.2f}" for seconds in (perf_counter() - started, process_time() - busy)
    ]


def by_both_ways(rig: Rig, spp: int, out: Path, stem: str) -> Table:
    """Two rows, of Kiriko and of the splat, for the ball's source image by one plate.

    Pictures into `out`.
    """
    best = solve(finer(rig, FINER), tolerance=FINEST)
    is_judged = best.display_coverage > 0.999
    solution, seconds = timed(lambda: solve(rig))
    error = rmse((solution.source - best.source)[is_judged])
    shown = f"{error:.4f}", "0", f"{error:.4f}", str(holes(solution.source, best))
    rows = [["Kiriko", f"{solution.n_rays:,}", *seconds, *shown]]

    # stray light weighs by its throughput at the mirrors; with the ideal plate there is none
    plan = compile_plan(rig, Settings(brightness=rig.plates[0].array is not None))
    image, seconds = timed(lambda: run_steps(splat(plan, spp, 1, "folded")))
    off, again = (
        (some - best.source)[is_judged]
        for some in (image, run_steps(splat(plan, max(spp // 4, 1), 2, "folded")))
    )
    error = rmse(off)
    shared = rmse(off, again)
    noise = np.sqrt(max(error**2 - shared**2, 0.0))
    n_rays = spp * rig.viewer.width * rig.viewer.height
    shown = f"{error:.4f}", f"{noise:.4f}", f"{shared:.4f}", str(holes(image, best))
    rows.append([f"splat, {spp} spp", f"{n_rays:,}", *seconds, *shown])
    for way, pixels in (("splat", image), ("kiriko", solution.source)):
        image_io.write(out / f"figure_5_{stem}_{way}.png", pixels, "PNG8", overwrite=True)

    return rows


def figure_5(rig: Rig, spp: int, out: Path) -> Table:
    """The ball's source image by each plate and each way: pictures into `out`, and the table."""
    head = "plate|way|rays|seconds|processor s|RMSE|of it noise|shared by all runs|holes"
    table = [head.split("|")]
    for name, array in {"ideal plate": None, "mirror array": PRESETS["ASKA3D-488"]}.items():
        print(
            f"ball, {name}: solving, and {spp} + {max(spp // 4, 1)} samples a pixel by splat ...",
            flush=True,
        )
        this = replace(rig, plates=tuple(replace(plate, array=array) for plate in rig.plates))
        table += [[name, *row] for row in by_both_ways(this, spp, out, name.replace(" ", "_"))]
        paper = [name, f"the paper's, {SPP} spp", "26.2 M paths", f"{PAPER_SECONDS[name]:.1f}"]
        table.append([*paper, *("not given" for _ in range(5))])

    return table
