"""Kiriko beside brute force, in one run on one machine: `dev.py compare`.

The same ball, viewer and display for all: Mitsuba's splat (mitsuba_splat.py), the splat over
embreex (core.image.source_image.splat) and Kiriko. They take turns in each round. `seconds` are
those that passed. `alone` is processor time by the threads allowed: on an idle machine about the
same, on a busy one the time with its cores to itself. Other processes slow down work on
several threads most, so ratios are of `alone`.

An error is the RMSE of the source image, in linear values, over the display pixels that the viewer
sees; pixels left as holes are black and count in full. It is judged by two independent halves A and
B of a Mitsuba splat of many samples: the mean of (image - A)(image - B) is the squared error
without the judges' own noise, which has mean 0. Mitsuba splats the triangles, and is judged by a
splat of the triangles; Kiriko by one of the sphere that the triangles stand for. The distance
of the triangles from the sphere is given, too, and is not held against the splats.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from numpy.typing import NDArray

from environments import machine
from kiriko.core.base.steps import finish
from kiriko.core.image.source_image import splat
from kiriko.core.light.compile_plan import make_plan
from kiriko.core.light.landings import Landings
from kiriko.core.light.trace import trace_all
from kiriko.core.native import loading
from kiriko.core.rig.rig import Picture, Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known.reference_rigs import ball_rig, finer, zone_plate

from . import mitsuba_splat
from .mitsuba_splat import MitsubaSplat, image_from_sums

Floats = NDArray[np.float64]
Painted = tuple[Floats, NDArray[np.bool_]]  # source image (H, W, 3), and where it is not a hole

LEVELS = 5  # 20 480 triangles
PICTURE = 1024
IOR = 1.49
SPP = 100
LADDER = (1, 4, 16, SPP, 256)
TOLERANCES = (1.0, 0.3, 0.1, 0.03, 0.01, 0.001)
DEFAULT = Settings().tolerance
FINER = 2  # times as many viewer pixels each way for Kiriko's own reference
AT_ONCE = 128  # spp of a judge in one launch: sums of single precision stay exact to 1e-6
STEP_ASIDE = 1e-3  # m
CHECKED = 100_000  # rays whose landings are compared


def as_drawn(rig: Rig) -> Rig:
    """The rig with the triangles as they are and normals interpolated, as Mitsuba has them."""
    return replace(
        rig, glasses=tuple(replace(g, mesh=replace(g.mesh, surface="facets")) for g in rig.glasses)
    )


# Errors


class Judge:
    """Two independent splats of many samples, and which display pixels they can judge."""

    def __init__(self, rig: Rig, spp: int, is_sphere: bool) -> None:
        loop = MitsubaSplat(rig, is_sphere)
        halves = [_many(loop, spp // 2, first_seed) for first_seed in (1 << 20, 1 << 21)]
        self.images = [image_from_sums(sums) for sums in halves]
        self.is_judged = np.logical_and.reduce([sums[..., 3] > 0 for sums in halves])
        self.counts = halves[0][..., 3] + halves[1][..., 3]
        self.n_left_out = int(np.logical_xor(*(sums[..., 3] > 0 for sums in halves)).sum())

    def error(self, image: Floats) -> float:
        """RMSE of an image whose noise, if it has any, is independent of the judges'."""
        one, other = ((image - half)[self.is_judged] for half in self.images)
        return float(np.sqrt(max(np.mean(one * other), 0.0)))

    def seen_error(self, image: Floats) -> float:
        """The same, each display pixel weighed by how much the viewer sees of it."""
        one, other = ((image - half)[self.is_judged] for half in self.images)
        mean = np.average((one * other).mean(axis=1), weights=self.counts[self.is_judged])
        return float(np.sqrt(max(mean, 0.0)))

    def distance(self, other: Judge) -> float:
        """RMSE between the images that two judges converge to."""
        both = self.is_judged & other.is_judged
        one, another = (
            (mine - its)[both] for mine, its in zip(self.images, other.images, strict=True)
        )
        return float(np.sqrt(max(np.mean(one * another), 0.0)))

    def holes(self, is_painted: NDArray[np.bool_]) -> int:
        return int((self.is_judged & ~is_painted).sum())


def _many(loop: MitsubaSplat, spp: int, first_seed: int) -> Floats:
    """Sums over many samples, in double precision."""
    starts = range(0, spp, AT_ONCE)
    return sum(
        loop.sums(min(AT_ONCE, spp - first), first_seed + first).astype(float) for first in starts
    )


def _landings(rig: Rig, loop: MitsubaSplat) -> tuple[Landings, Floats]:
    """Kiriko's landings and Mitsuba's, of the same rays."""
    size = np.array([rig.viewer.width, rig.viewer.height])
    # single precision, or the two would not get the same rays
    xy = (np.random.default_rng(0).random((CHECKED, 2)) * size).astype(np.float32).astype(float)
    return trace_all(make_plan(rig, Settings()), *rig.viewer.rays(xy)), loop.landings(xy)


def compare_landings(rig: Rig, loop: MitsubaSplat) -> str:
    """How far Mitsuba's landings are from those of core.light.trace on the same rays, in words."""
    ours, theirs = _landings(rig, loop)
    has_arrived = np.isfinite(theirs[:, 0])
    both = ours.has_arrived & has_arrived
    off = np.linalg.norm(ours.xy[both] - theirs[both], axis=1)
    half, most = np.percentile(off, [50, 99])
    n_one = int((ours.has_arrived != has_arrived).sum())
    return (
        f"median {half:.2g} px, 99 % {most:.2g} px, largest {off.max():.2g} px of {len(off)} rays;"
        f" {n_one} of {CHECKED} arrive for one only"
    )


def share_apart(rig: Rig, loop: MitsubaSplat) -> float:
    """Share, 0..1, of the rays that see the display by either,
    which Mitsuba takes more than a pixel elsewhere.
    """
    ours, theirs = _landings(rig, loop)
    size = rig.display.width, rig.display.height
    seen = [
        ((xy >= 0) & (xy < size)).all(axis=1)
        for xy in (np.where(ours.has_arrived[:, None], ours.xy, -1), theirs)
    ]
    with np.errstate(invalid="ignore"):
        is_alike = np.linalg.norm(ours.xy - theirs, axis=1) <= 1
    either = seen[0] | seen[1]
    return float((either & ~(seen[0] & seen[1] & is_alike)).sum() / max(either.sum(), 1))


# The ways to an image


@dataclass(frozen=True)
class Way:
    """One way to a source image: threads allowed, who judges it,
    the work, and the preparation before the clock starts.
    """

    name: str
    threads: int
    judge: Judge
    run: Callable[[], Painted]
    prepare: Callable[[], object] = lambda: None


@dataclass(frozen=True)
class Rung:
    """The result of a way: seconds that passed and seconds with
    the allowed cores to itself, error and holes.
    """

    name: str
    threads: int
    seconds: float
    alone: float
    error: float
    holes: int


def take_turns(ways: Sequence[Way], rounds: int) -> list[Rung]:
    """Median times over rounds in which each way has its turn.

    A first round, to get warm, is not counted.
    """
    seconds, processor = np.empty((2, rounds + 1, len(ways)))
    painted: list[Painted] = []
    for count in range(rounds + 1):
        painted.clear()
        for k, way in enumerate(ways):
            way.prepare()
            started = perf_counter()
            busy = process_time()
            painted.append(way.run())
            seconds[count, k] = perf_counter() - started
            processor[count, k] = process_time() - busy

    passed = np.median(seconds[1:], axis=0)
    busy = np.median(processor[1:], axis=0)
    return [
        Rung(
            way.name,
            way.threads,
            passed[k],
            busy[k] / way.threads,
            way.judge.error(image),
            way.judge.holes(has_colour),
        )
        for k, (way, (image, has_colour)) in enumerate(zip(ways, painted, strict=True))
    ]


def mitsuba_ways(rig: Rig, judge: Judge) -> list[Way]:
    """Mitsuba's splat at a ladder of samples on all threads, and at SPP on one."""
    loop = MitsubaSplat(rig)
    n_threads = mitsuba_splat.threads()

    def run(spp: int, threads: int) -> Painted:
        mitsuba_splat.use_threads(threads)
        sums = loop.sums(spp)
        return image_from_sums(sums), sums[..., 3] > 0

    ladder = [
        Way(f"{spp} spp", n_threads, judge, lambda spp=spp: run(spp, n_threads)) for spp in LADDER
    ]
    return [*ladder, Way(f"{SPP} spp on one thread", 1, judge, lambda: run(SPP, 1))]


def embreex_way(rig: Rig, judge: Judge, spp: int) -> Way:
    """The splat over embreex."""
    plan = make_plan(rig, Settings())
    # black may be a colour of the picture: samples of a
    # white one, the same, tell where there are holes
    white = replace(
        plan, rig=replace(rig, pictures=(Picture("white", np.ones((1, 1, 4), np.float32)),))
    )
    has_sample = finish(splat(white, spp)).max(axis=2) > 0
    return Way(f"{spp} spp", 1, judge, lambda: (finish(splat(plan, spp)), has_sample))


def kiriko_ways(rig: Rig, by_sphere: Judge, by_triangles: Judge) -> list[Way]:
    """Whole solves at a ladder of tolerances, one of the
    triangles as drawn, and a new picture in a solved rig.
    """

    def run(a_rig: Rig, tolerance: float, session: Session | None = None) -> Painted:
        solution = finish((session or Session()).solve(a_rig, Settings(tolerance=tolerance)))
        return solution.source, solution.display_coverage > 0

    ladder = [Way(f"{t:g} px", 1, by_sphere, lambda t=t: run(rig, t)) for t in TOLERANCES]
    drawn = as_drawn(rig)
    kept = Session()
    other = replace(rig.picture, image=rig.picture.image.copy())

    def paint_other() -> None:
        other.image[:] = 1 - other.image  # one that this session has not just painted
        run(replace(rig, pictures=(other,)), DEFAULT, kept)

    return [
        *ladder,
        Way(f"{DEFAULT:g} px, triangles as drawn", 1, by_triangles, lambda: run(drawn, DEFAULT)),
        Way(
            "a new picture, all else the same",
            1,
            by_sphere,
            lambda: run(rig, DEFAULT, kept),
            paint_other,
        ),
    ]


def spp_for(error: float, ladder: Sequence[Rung]) -> float:
    """Samples a pixel for an error: log-log between the rungs of a splat.

    Finer than the last, with slope -1/2.
    """
    log_error = np.log([rung.error for rung in ladder])[::-1]
    log_spp = np.log(LADDER)[::-1]
    beyond = max(log_error[0] - np.log(error), 0.0)
    return float(np.exp(np.interp(np.log(error), log_error, log_spp) + 2 * beyond))


# Printed tables


def print_rungs(title: str, rungs: Sequence[Rung]) -> None:
    print(f"\n{title:<48} {'seconds':>8} {'alone':>8} {'threads':>7} {'error':>8} {'holes':>6}")
    for r in rungs:
        print(
            f"  {r.name:<46} {r.seconds:8.3f} {r.alone:8.3f} {r.threads:7d} {r.error:8.5f}"
            f" {r.holes:6d}"
        )


def print_ratio(name: str, seconds: float, ours: float) -> None:
    print(f"  {name:<46} {seconds:8.2f} s, {seconds / ours:8.1f} times Kiriko's")


def draw(path: Path, curves: dict[str, Sequence[Rung]]) -> None:
    """Error against seconds, log-log."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 5))
    for name, rungs in curves.items():
        seconds, errors = zip(*((rung.alone, rung.error) for rung in rungs), strict=True)
        axes.loglog(seconds, errors, "o-" if len(rungs) > 1 else "s", label=name)
        for rung in rungs:
            axes.annotate(
                rung.name,
                (rung.alone, rung.error),
                fontsize=7,
                xytext=(4, 4),
                textcoords="offset points",
            )

    axes.set(
        xlabel="seconds, alone on the machine",
        ylabel="RMSE of the source image, linear",
        title=machine(),
    )
    axes.grid(True, which="both", alpha=0.3)
    axes.legend()
    figure.tight_layout()
    figure.savefig(path)


def compare(rounds: int, judge_spp: int, embreex_spp: int) -> dict[str, Sequence[Rung]]:
    """Measure all, print the tables, and return the curves."""
    rig = ball_rig(LEVELS, ior=IOR, image=zone_plate(PICTURE))
    drawn = as_drawn(rig)
    describe(rig)
    print("\nLandings of Mitsuba against core.light.trace on the same rays:")
    print(f"  triangles  {compare_landings(drawn, MitsubaSplat(drawn))}")
    print(f"  sphere     {compare_landings(rig, MitsubaSplat(rig, is_sphere=True))}", flush=True)
    by_triangles = Judge(rig, judge_spp, is_sphere=False)
    by_sphere = Judge(rig, judge_spp, is_sphere=True)
    print_judges(rig, judge_spp, by_triangles, by_sphere)

    splats = mitsuba_ways(rig, by_triangles)
    ways = [
        *splats,
        embreex_way(drawn, by_triangles, embreex_spp),
        *kiriko_ways(rig, by_sphere, by_triangles),
    ]
    rungs = take_turns(ways, rounds)
    mitsuba = rungs[: len(splats)]
    embreex = rungs[len(splats)]
    kiriko = rungs[len(splats) + 1 :]
    print_rungs("Mitsuba's splat", mitsuba)
    print_rungs("The splat over embreex", [embreex])
    print_rungs("Kiriko, whole solves by tolerance", kiriko)
    print_parts(rig)
    mitsuba = mitsuba[: len(LADDER)]
    kiriko = kiriko[: len(TOLERANCES)]
    print_speed_up(mitsuba, embreex.alone * SPP / embreex_spp, kiriko)

    return {"Mitsuba's splat": mitsuba, "splat over embreex": [embreex], "Kiriko": kiriko}


def describe(rig: Rig) -> None:
    n = len(rig.glasses[0].mesh.triangles)
    viewer = rig.viewer
    display = rig.display
    print(f"{machine()}. Ball of {n} triangles, n = {IOR}.")
    print(
        f"Pixels: viewer {viewer.width} x {viewer.height}, display {display.width} x"
        f" {display.height},",
        end=" ",
    )
    print(f"picture {PICTURE} x {PICTURE}.")
    print(
        f"Allowed: Mitsuba {mitsuba_splat.threads()} threads, embreex and Kiriko one (numpy's"
        f" own: one, by dev.py)."
    )


def print_judges(rig: Rig, spp: int, by_triangles: Judge, by_sphere: Judge) -> None:
    fine = finish(Session().solve(finer(rig, FINER), Settings(tolerance=min(TOLERANCES)))).source
    print(f"\nWhat the judges, {spp} spp each, converge to:")
    print(f"  triangles and sphere are apart by {by_triangles.distance(by_sphere):.5f}")
    print(
        f"  Kiriko with {FINER} x {FINER} times the viewer pixels, {min(TOLERANCES):g} px, is off"
        f" by {by_sphere.error(fine):.5f}"
    )
    print(f"  not judged, for one half has no sample: {by_sphere.n_left_out} pixels", flush=True)


def print_parts(rig: Rig) -> None:
    session = Session()
    for name, other in (
        ("one more solve", rig),
        ("a solve after the viewer has moved", step_aside(rig)),
    ):
        started = process_time()
        solution = finish(session.solve(other))
        parts = ", ".join(f"{part} {seconds:.3f}" for part, seconds in solution.seconds.items())
        print(
            f"  seconds of {name} at {DEFAULT:g} px: {process_time() - started:.3f},"
            f" {solution.n_rays} rays; {parts}"
        )


def step_aside(rig: Rig) -> Rig:
    """The rig seen from a little further to the right."""
    viewer = rig.viewer
    return replace(
        rig, viewers=(replace(viewer, position=viewer.position + STEP_ASIDE * viewer.axes[0]),)
    )


def print_speed_up(mitsuba: Sequence[Rung], embreex_alone: float, kiriko: Sequence[Rung]) -> None:
    """Times to the same error; `embreex_alone` and what is
    called scaled follow linearly from what was run.
    """
    at_spp = mitsuba[LADDER.index(SPP)]
    default = kiriko[TOLERANCES.index(DEFAULT)]
    print(f"\nAt the error of {SPP} spp, {at_spp.error:.5f}, each alone on the machine:")
    good = [rung for rung in kiriko if rung.error <= at_spp.error]

    if good:
        fastest = min(good, key=lambda rung: rung.alone)
        print(
            f"  {'Kiriko, ' + fastest.name:<46} {fastest.alone:8.2f} s, error {fastest.error:.5f}"
        )
        print_ratio(f"Mitsuba on {at_spp.threads} threads", at_spp.alone, fastest.alone)
        print_ratio("the splat over embreex (scaled)", embreex_alone, fastest.alone)
    else:
        print(
            f"  Kiriko reaches it at no tolerance; its least error is"
            f" {min(rung.error for rung in kiriko):.5f}."
        )

    spp = spp_for(default.error, mitsuba)
    print(
        f"\nAt Kiriko's error at {default.name}, {default.error:.5f}, for which a splat needs"
        f" {spp:.0f} spp:"
    )
    print(f"  {'Kiriko':<46} {default.alone:8.2f} s")
    print_ratio(
        f"Mitsuba on {at_spp.threads} threads (scaled)", at_spp.alone * spp / SPP, default.alone
    )
    print_ratio("the splat over embreex (scaled)", embreex_alone * spp / SPP, default.alone)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5, help="runs of each; medians are shown")
    parser.add_argument(
        "--reference", type=int, default=4096, metavar="SPP", help="samples of each judge"
    )
    parser.add_argument(
        "--embreex", type=int, default=4, metavar="SPP", help="samples of the splat over embreex"
    )
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="error against seconds, as SVG or PNG"
    )
    arguments = parser.parse_args()
    loading.use_threads(1)
    curves = compare(arguments.rounds, arguments.reference, arguments.embreex)
    if arguments.plot:
        draw(arguments.plot, curves)


if __name__ == "__main__":
    main()
