"""Seconds and rays of solves through glass as artists bring it, by each choice of *Surface*.

`python3 scripts/dev.py glasses [--glass NAME ...] [--surface CHOICE ...] [--effort RAYS] [--numpy]
[--threads N] [--display PIXELS]`. Seconds, and processor seconds of all threads, of whole solves at
default settings, viewer and display of 512 x 512 pixels. `step` is the longest step, in which no
Esc is heard. `MB` is the memory taken, on Linux, and `told` how many times that differs from the
estimate. Each solve is the first of a process of its own. `curved` is the share of the triangles
with a curved face, `beyond` the share that is seen off by more than the tolerance, `sampled` where
light is chaotic.

With `--stages`, instead: percent of the time that each stage of a solve takes, and their means,
from which the shares in core/base/stages.py are rounded.

With `--rays`, instead: how many rays a viewer pixel takes, of those that take more than one, each
to the pixel that it starts in: on average, 99 and 99.9 % of them at the most, and the most of all.

With `--light`, instead: the cost and the gain of Ghosts and Suppress Glare, *Surface* at Automatic.
`glare` is the share of the light that comes beside the glass; `contested` that of the view whose
display pixel has a stronger path. Then the PSNR in dB of all that is seen against the ideal image:
by the mean and by the strongest path with the glare as it is, and by the mean with Suppress Glare
at 0.5 and 1.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import subprocess
import sys
from collections.abc import Generator
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

from environments import as_module
from kiriko.core.base.stages import SHARES, spans
from kiriko.core.base.steps import finish
from kiriko.core.image.ghosts import Paths
from kiriko.core.lab.measure.choices import measure_choices
from kiriko.core.light.compile_plan import make_plan
from kiriko.core.native import loading
from kiriko.core.rig.rig import Mesh, Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.memory import estimated
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import Solution
from known.counted_rays import counted_rays
from known.reference_rigs import glass_rig

from .brought_glass import add_glass_option, filled, made
from .irregular import CHOICES


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_glass_option(parser)
    parser.add_argument(
        "--surface", nargs="+", choices=CHOICES, default=list(CHOICES), help="only these choices"
    )
    parser.add_argument(
        "--effort",
        type=int,
        default=Settings().effort,
        metavar="RAYS",
        help="where light is chaotic",
    )
    parser.add_argument(
        "--light", action="store_true", help="what Ghosts and Suppress Glare cost or gain, instead"
    )
    parser.add_argument("--numpy", action="store_true", help="without the compiled kernel")
    parser.add_argument(
        "--threads", type=int, default=0, metavar="N", help="of the kernel; as many as there are"
    )
    parser.add_argument(
        "--display", type=int, default=512, metavar="PIXELS", help="of the display, each way"
    )
    parser.add_argument(
        "--rays", action="store_true", help="how many rays a viewer pixel takes, instead"
    )
    parser.add_argument("--stages", action="store_true", help="how long each stage takes, instead")
    parser.add_argument(
        "--here", action="store_true", help="measure the first glass here and print its line"
    )
    arguments = parser.parse_args()
    loading.use_threads(arguments.threads)

    with loading.off() if arguments.numpy else nullcontext():
        if arguments.here:
            print(line_of(arguments))
        elif arguments.light:
            print_light(arguments)
        elif arguments.stages:
            print_stages(arguments)
        elif arguments.rays:
            print_rays(arguments)
        else:
            print_table(arguments)


@dataclass
class Steps:
    """Where a solve stood, 0..1 as it told, and after how many seconds."""

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
        """(n,) part of the time, 0..1, that each stage takes."""
        ends = [end for _, end in spans(*((stage,) for stage in SHARES))]
        after = np.searchsorted(self.told, np.array(ends) - 1e-9)
        return np.diff(np.array(self.seconds)[after], prepend=0.0) / self.seconds[-1]


class Memory:
    """Bytes that are taken from now on, at the most; 0 where that is not known."""

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


def rig_of(name: str, mesh: Mesh, display_pixels: int) -> Rig:
    """A glass on the bench, with its filling."""
    return glass_rig(filled(name, mesh), display_pixels=display_pixels)


def print_light(arguments: argparse.Namespace) -> None:
    """Print a line for each glass on glare and ghosts."""
    print(
        f"{'glass':<16}{'glare %':>8}{'contested %':>12}{'mean':>7}{'strongest':>10}"
        f"{'0.5':>7}{'1':>7}  where"
    )
    settings = Settings(effort=arguments.effort)

    for name in arguments.glass:
        mesh = replace(made(name), surface="automatic")
        a_rig = rig_of(name, mesh, arguments.display)
        seen = {choice[:2]: choice.seen_psnr for choice in finish(measure_choices(a_rig, settings))}
        solution = finish(Session().solve(a_rig, replace(settings, ghosts="strongest")))
        paths = Paths(solution.first.shares.display_size)
        for shares in solution.first.shares:
            paths.add(shares)
        weight, contested = paths.weights()
        share = 100 * float((weight * contested).sum() / weight.sum())
        told = "".join(
            f"{seen[choice]:{width}.1f}"
            for choice, width in (
                (("mean", 0), 7),
                (("strongest", 0), 10),
                (("mean", 0.5), 7),
                (("mean", 1), 7),
            )
        )
        glare = solution.first.glare
        print(f"{name:<16}{100 * glare.share:8.1f}{share:12.1f}{told}  {glare.where}", flush=True)


def print_stages(arguments: argparse.Namespace) -> None:
    """Print a line for each glass, and the means, on the stages of a solve."""
    print(f"{'glass':<16}{'s':>7}" + "".join(f"{stage:>10}" for stage in SHARES))
    found = []
    for name in arguments.glass:
        mesh = replace(made(name), surface="automatic")
        steps = Steps()
        steps.watch(Session().solve(rig_of(name, mesh, arguments.display)))
        found.append(steps.of_stages)
        print_line(name, steps.seconds[-1], steps.of_stages)
    print_line("mean", float("nan"), np.mean(found, axis=0))


def print_line(name: str, seconds: float, of_stages: np.ndarray) -> None:
    """Print the parts of the time that stages take."""
    print(f"{name:<16}{seconds:7.2f}" + "".join(f"{100 * part:10.1f}" for part in of_stages))


def print_rays(arguments: argparse.Namespace) -> None:
    """Print a line for each glass and choice on the rays of a viewer pixel."""
    print(
        f"{'glass':<16}{'surface':>10}{'rays':>9}{'pixels':>8}"
        f"{'mean':>7}{'99 %':>6}{'99.9 %':>8}{'most':>6}"
    )

    for name in arguments.glass:
        mesh = made(name)
        for choice in arguments.surface:
            a_rig = rig_of(name, replace(mesh, surface=choice), arguments.display)
            with counted_rays(a_rig.viewer) as counts:
                finish(Session().solve(a_rig, Settings(effort=arguments.effort)))
            several = counts[counts > 1]
            most = "".join(
                f"{np.quantile(several, part):{width}.0f}"
                for part, width in ((0.99, 6), (0.999, 8), (1, 6))
            )
            print(
                f"{name:<16}{choice:>10}{counts.sum():9d}{len(several):8d}{several.mean():7.1f}{most}",
                flush=True,
            )


def print_table(arguments: argparse.Namespace) -> None:
    """Print a line for each glass and choice."""
    numbers = (
        f"{'s':>7}{'CPU s':>7}{'step s':>7}"
        f"{'MB':>6}{'told x':>7}"
        f"{'rays':>9}{'curved':>7}{'beyond %':>9}"
    )
    print(f"{'glass':<16}{'triangles':>10}{'surface':>10}{numbers}{'sampled %':>10}", flush=True)
    for name in arguments.glass:
        for choice in arguments.surface:
            # memory that another solve let go would be taken again
            options = [*sys.argv[1:], "--here", "--glass", name, "--surface", choice]
            subprocess.run([sys.executable, *as_module("bench.glasses"), *options], check=True)


def line_of(arguments: argparse.Namespace) -> str:
    """The line of the table for the first glass and choice, solved here and now."""
    name, choice = arguments.glass[0], arguments.surface[0]
    mesh = made(name)
    a_rig = rig_of(name, replace(mesh, surface=choice), arguments.display)
    settings = Settings(effort=arguments.effort)
    n_triangles = sum(len(glass.mesh.triangles) for glass in a_rig.glasses)
    share = sum(make_plan(a_rig, settings).counts.n_curved) / n_triangles

    memory = Memory()
    steps = Steps()
    started = perf_counter()
    of_processor = process_time()
    solution = steps.watch(Session().solve(a_rig, settings))
    seconds = perf_counter() - started
    of_processor = process_time() - of_processor

    taken = memory.taken
    error = solution.first.map_error
    estimate = sum(estimated(a_rig, settings, solution.first.view_map).values())
    off = max(estimate / taken, taken / estimate) if taken else float("nan")
    beyond = 100 * (error.facet_limited + error.unresolved)

    told = f"{seconds:7.1f}{of_processor:7.1f}{steps.longest:7.2f}"
    told += f"{taken / 1e6:6.0f}{off:7.2f}{solution.n_rays:9d}"
    told += f"{share:7.2f}{beyond:9.2f}{100 * error.sampled:10.2f}"
    return f"{name:<16}{n_triangles:10d}{choice:>10}{told}"


if __name__ == "__main__":
    main()
