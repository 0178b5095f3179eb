"""Kiriko beside Mitsuba on glass as artists bring it, in one run on one machine: `dev.py marks`.

For each glass the same mesh, viewer and display for both: facets with interpolated normals, 512 x
512 pixels, but for `--display`. Mitsuba's splat takes 100 samples a pixel on all threads, or as
many as `--samples` says (mitsuba_splat.py). Kiriko solves at its default settings: the mesh *as
drawn*, as Mitsuba shows it, and by *Automatic*, which follows the curved surface and has no judge
here. `s` are seconds that passed; an error is that of the source image, as in side_by_side.py,
against a splat of many samples, over all display pixels alike, and *as seen*: weighed by how much
the viewer sees of each. `apart` is the share of the rays that Mitsuba's loop takes elsewhere: it
goes astray where a mesh overlaps itself or has two faces in one place, and is no judge there.
`--finer` gives Kiriko more viewer pixels, for the same display: it
takes longer, and errs less where borders run.

With `--effort 1 4 16`, instead: what *Effort* costs and gains, of the mesh as drawn, and with
`--samples 25 100` after it what more samples a pixel do for the splat: processor seconds of one
thread, rays, the shares of the view that are sampled and unresolved, and the errors; each `power`
is that of time by which the error before it falls from the line above: -0.5 halves it in four times
the seconds.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time, thread_time

import numpy as np

from environments import machine, run_in_newest_blender
from kiriko.core.base.steps import finish
from kiriko.core.glass.meshes import geometric_normals
from kiriko.core.native import loading
from kiriko.core.rig.rig import Mesh, Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import Solution
from known.reference_rigs import finer, glass_rig, zone_plate

from . import mitsuba_splat
from .mitsuba_splat import Floats, MitsubaSplat, image_from_sums
from .side_by_side import SPP, Judge, share_apart


def meshes(folder: Path, names: list[str]) -> dict[str, tuple[Mesh, float]]:
    """Glasses and their indices by name, made by Blender, which is not in this process."""
    if run_in_newest_blender("bench.brought_glass", folder, *names):
        sys.exit("The glasses were not made, for the reason above.")
    return {
        path.stem: _loaded(path)
        for path in sorted(folder.glob("*.npz"), key=lambda p: p.stat().st_mtime_ns)
    }


def _loaded(path: Path) -> tuple[Mesh, float]:
    with np.load(path) as found:
        parts = {name: found[name][()] for name in found.files}  # single numbers, not arrays of one
    index = parts.pop("index")
    return Mesh(**parts), index


def smooth_all_over(mesh: Mesh) -> Mesh:
    """The same mesh as Mitsuba reads it: flat faces have their own normals at their corners.

    So have faces with a normal that looks to the other side, which Kiriko takes for flat.
    """
    normals = np.repeat(geometric_normals(mesh.corners)[:, None], 3, axis=1)
    if mesh.is_smooth is not None:
        is_usable = mesh.is_smooth & ((mesh.corner_normals * normals).sum(axis=2) > 0).all(axis=1)
        normals = np.where(is_usable[:, None, None], mesh.corner_normals, normals)
    return replace(
        mesh, corner_normals=normals, is_smooth=np.ones(len(mesh.triangles), bool), surface="facets"
    )


def timed(work: Callable[[], object], rounds: int) -> tuple[float, object]:
    """Median of the seconds that some runs take, and the result of the last."""
    seconds = []
    for _ in range(rounds):
        started = perf_counter()
        found = work()
        seconds.append(perf_counter() - started)
    return statistics.median(seconds), found


def solved(a_rig: Rig, surface: str) -> Solution:
    """A whole solve from scratch."""
    glass = a_rig.glasses[0]
    glass = replace(glass, mesh=replace(glass.mesh, surface=surface))
    return finish(Session().solve(replace(a_rig, glasses=(glass,)), Settings()))


def print_glass(name: str, mesh: Mesh, index: float, arguments: argparse.Namespace) -> None:
    """Print the line of a glass."""
    a_rig = glass_rig(mesh, ior=index, image=zone_plate(), display_pixels=arguments.display)
    splat = MitsubaSplat(
        replace(a_rig, glasses=(replace(a_rig.glasses[0], mesh=smooth_all_over(mesh)),))
    )
    judge = Judge(splat.rig, arguments.reference, is_sphere=False)
    samples = arguments.samples[0]
    splat.sums(samples)  # compiled by now
    theirs, sums = timed(lambda: splat.sums(samples), arguments.rounds)

    with loading.off() if arguments.numpy else nullcontext():
        our_rig = finer(a_rig, arguments.finer)
        drawn_seconds, drawn = timed(lambda: solved(our_rig, "facets"), arguments.rounds)
        seconds, _ = timed(lambda: solved(our_rig, "automatic"), arguments.rounds)

    of_theirs, of_drawn = (
        f"{judge.error(image):9.4f}{judge.seen_error(image):9.4f}"
        for image in (image_from_sums(sums), drawn.source)
    )
    apart = 100 * share_apart(splat.rig, splat)
    print(
        f"{name:<16}{len(mesh.triangles):10d}{theirs:9.2f}{of_theirs}{drawn_seconds:9.2f}{of_drawn}"
        f"{seconds:9.2f}{drawn_seconds / theirs:9.2f}{seconds / theirs:9.2f}{apart:8.1f}%",
        flush=True,
    )


def print_efforts(name: str, mesh: Mesh, index: float, arguments: argparse.Namespace) -> None:
    """Print a line for each Effort, and for each number of samples of the splat."""
    a_rig = glass_rig(mesh, ior=index, image=zone_plate())
    glass = a_rig.glasses[0]
    drawn = replace(a_rig, glasses=(replace(glass, mesh=replace(mesh, surface="facets")),))
    splat = MitsubaSplat(replace(a_rig, glasses=(replace(glass, mesh=smooth_all_over(mesh)),)))
    judge = Judge(splat.rig, arguments.reference, is_sphere=False)

    loading.use_threads(1)
    before = None
    for effort in arguments.effort:
        started = thread_time()
        solution = finish(Session().solve(drawn, Settings(effort=effort)))
        seconds = thread_time() - started
        error = solution.first.map_error
        print(
            f"{name:<16}{effort:8d}{seconds:9.2f}{solution.n_rays:10d}"
            f"{100 * error.sampled:11.2f}{100 * error.unresolved:13.2f}",
            end="",
        )
        before = print_errors(judge, solution.source, seconds, before)

    n_threads = mitsuba_splat.threads()
    mitsuba_splat.use_threads(1)
    splat.sums(1)  # compiled by now
    before = None
    for samples in arguments.samples:
        started = process_time()
        sums = splat.sums(samples)
        seconds = process_time() - started
        n_rays = samples * a_rig.viewer.width * a_rig.viewer.height
        print(f"{name:<16}{f'{samples} spp':>8}{seconds:9.2f}{n_rays:10d}{'':24}", end="")
        before = print_errors(judge, image_from_sums(sums), seconds, before)

    mitsuba_splat.use_threads(n_threads)


def print_errors(
    judge: Judge, image: Floats, seconds: float, before: Sequence[float] | None
) -> tuple[float, float, float]:
    """Print the errors of an image and the powers of time by which
    they fall from those before. Return time and errors.
    """
    found = seconds, judge.error(image), judge.seen_error(image)
    powers = [f"{'':7}"] * 2
    if before:
        later, *falls = np.log(found) - np.log(before)
        powers = [f"{fall / later:7.2f}" for fall in falls]

    print(f"{found[1]:9.4f}{powers[0]}{found[2]:9.4f}{powers[1]}", flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--glass", nargs="+", metavar="NAME", default=[], help="only these")
    parser.add_argument(
        "--reference", type=int, default=1024, metavar="SPP", help="samples of the judge"
    )
    parser.add_argument("--rounds", type=int, default=1, help="runs of each; medians are shown")
    parser.add_argument(
        "--finer",
        type=float,
        default=1.0,
        metavar="N",
        help="times finer a viewer for Kiriko, each way",
    )
    parser.add_argument(
        "--samples", nargs="+", type=int, default=[SPP], metavar="SPP", help="of Mitsuba's splat"
    )
    parser.add_argument(
        "--display", type=int, default=512, metavar="PIXELS", help="of the display, each way"
    )
    parser.add_argument("--numpy", action="store_true", help="without the compiled kernel")
    parser.add_argument(
        "--effort", nargs="+", type=int, metavar="N", help="what these cost and gain, instead"
    )
    arguments = parser.parse_args()
    if arguments.effort:
        print(
            f"{'glass':<16}{'effort':>8}{'CPU s':>9}{'rays':>10}{'sampled %':>11}"
            f"{'unresolved %':>13}{'error':>9}{'power':>7}{'as seen':>9}{'power':>7}"
        )
        print_all(print_efforts, arguments)
        return

    print(f"{machine()}. Kiriko and Mitsuba on all threads; x: times Mitsuba's seconds.")
    heads = (
        "Mitsuba",
        "error",
        "as seen",
        "drawn s",
        "error",
        "as seen",
        "auto s",
        "drawn x",
        "auto x",
        "apart",
    )
    print(f"{'glass':<16}{'triangles':>10}" + "".join(f"{head:>9}" for head in heads))
    print_all(print_glass, arguments)


def print_all(print_one: Callable[..., None], arguments: argparse.Namespace) -> None:
    """Print what there is to tell of each glass."""
    with tempfile.TemporaryDirectory() as folder:
        for name, (mesh, index) in meshes(Path(folder), arguments.glass).items():
            print_one(name, mesh, index, arguments)


if __name__ == "__main__":
    main()
