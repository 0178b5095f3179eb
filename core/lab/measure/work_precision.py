"""Error against run time and memory: solves at several tolerances, and the brute-force splat.

core/lab/measure/reference.py makes the reference.
"""

import sys
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from math import isclose
from statistics import median
from time import perf_counter
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...base.steps import run_steps, subprogress
from ...image.source_image import splat
from ...rig.rig import Rig
from ...rig.settings import LEAST_TOLERANCE, MOST_EFFORT, Settings
from ...solve.session import Session
from ...solve.solution import BUILD, Solution
from .reference import (
    N_CHECKED,
    ImageErrors,
    MapErrors,
    Reference,
    make_reference,
    pictures,
    psnr,
    quantisation,
    times_finer,
)

GLARES = (0.0, 0.5, 1.0)


class MeasuredChoice(NamedTuple):
    """One way to choose the colour of display pixels that are seen several times, or past the
    glass.

    seen_psnr : dB, white is 1: all of the viewer's image, light past the glass included, against
        the ideal image; None if they are equal
    """

    ghosts: str
    suppress_glare: float
    seen_psnr: float | None


def measure_choices(
    rig: Rig, settings: Settings
) -> Generator[float, None, tuple[MeasuredChoice, ...]]:
    """Solve a rig with both Ghosts modes and several values of Suppress Glare; yields progress
    0..1.

    Glare is left out if light past the glass carries the picture too.
    """
    glares = GLARES if settings.only_through_glass else ()
    options = dict.fromkeys([
        *((ghosts, settings.suppress_glare if glares else 0.0) for ghosts in ("mean", "strongest")),
        *((settings.ghosts, glare) for glare in glares),
    ])  # fmt: skip
    options = sorted(options, key=lambda option: -option[1])

    session = Session()
    found = []
    first = None

    for n, (ghosts, glare) in enumerate(options):
        here = replace(settings, ghosts=ghosts, suppress_glare=glare)
        solution = yield from subprogress(
            session.solve(rig, here), n / len(options), (n + 0.9) / len(options)
        )
        first = first or solution  # its map includes light past the glass, for all choices
        seen = first.seen(solution.source, past_glass=True)
        found.append(MeasuredChoice(ghosts, glare, psnr(seen - first.ideal())))

    return tuple(sorted(found))


Size = tuple[int, int]  # (width, height), px


@dataclass(frozen=True)
class Rung:
    """One way to make a source image, its time and its error; None for unknown or not run.

    Parameters
    ----------
    setting : tolerance in display px, or samples a pixel
    seconds : median of `runs` runs, from the plan to the source image with its own error estimate
    predicted_seconds : of a splat that was not run
    repaint_seconds : median, for another picture with nothing else changed
    parts : (name, median seconds) of the stages, the plan included
    n_rays : rays traced
    maps : error of each viewer's map; none for the splat
    """

    method: Literal["adaptive", "splat"]
    setting: float
    seconds: float | None = None
    runs: int = 0
    predicted_seconds: float | None = None
    repaint_seconds: float | None = None
    parts: tuple[tuple[str, float], ...] = ()
    n_rays: int | None = None
    maps: tuple[MapErrors, ...] = ()
    image: ImageErrors | None = None


@dataclass(frozen=True)
class WorkPrecision:
    """Error against run time of one rig on this machine.

    Parameters
    ----------
    rungs : tolerances, coarse to fine, then the splat's samples
    reference : of all rungs. Its map is compared with the trace, and its seen image with the ideal
        image
    tessellation_error : rms display px, equal for all rungs; of the viewer with the largest one
    quantisation : rms rounding of the encoded source image (0..1), by number format
    tolerance : display px, of the scene; one of the rungs
    read_seconds, write_seconds : medians, for reading the scene and writing the source image; None:
        not measured
    peak_memory : bytes, peak of the whole process up to the first solve; None: unknown
    n_shown : compared display pixels, which show the picture
    n_checked : points at which each map was compared with the trace
    times_finer : each way, of the display pixels for the reference's source image
    picture : name of the picture behind the image errors
    choices : effect of Ghosts and Suppress Glare, with the rig's own picture
    view_sizes : of the viewers' images
    """

    rungs: tuple[Rung, ...]
    reference: Rung
    tessellation_error: float
    quantisation: dict[str, float]
    tolerance: float
    read_seconds: float | None
    write_seconds: float | None
    peak_memory: int | None
    n_shown: int
    n_checked: int
    times_finer: int
    picture: str
    choices: tuple[MeasuredChoice, ...]
    view_sizes: tuple[Size, ...]
    display_size: Size

    @property
    def own(self) -> Rung:
        """The rung at the scene's tolerance."""
        return next(
            rung
            for rung in self.rungs
            if rung.method == "adaptive" and rung.setting == self.tolerance
        )

    @property
    def ladder(self) -> list[tuple[float, float]]:
        """Tolerance (display px) and seconds of the adaptive rungs."""
        return [(rung.setting, rung.seconds) for rung in self.rungs if rung.method == "adaptive"]

    def splat_seconds(self, source_rmse: float) -> float | None:
        """Time of the splat to a given error (linear values) of the source image, approximate; or
        None.

        Between rungs it is linear in logarithms. Beyond the last rung, error follows samples to the
        power -1/2 if no holes are left; with holes it falls faster, and the time is unknown.
        """
        done = [rung for rung in self.rungs if rung.method == "splat" and rung.image]
        if not done or source_rmse <= 0 or done[-1].image.source_rmse <= 0:
            return None

        run = [(rung.image.source_rmse, rung.seconds) for rung in done]
        least, longest = run[-1]
        if source_rmse < least:
            return None if done[-1].image.holes else longest * (least / source_rmse) ** 2

        errors, seconds = np.log(sorted(run)).T
        return float(np.exp(np.interp(np.log(source_rmse), errors, seconds)))


Result = TypeVar("Result")


def timed(work: Callable[[], Result]) -> tuple[float, Result]:
    """Seconds of a call, and its result."""
    clock = perf_counter()
    result = work()
    return perf_counter() - clock, result


def median_seconds(work: Callable[[], object], runs: int) -> float:
    """Median of several calls."""
    return median(timed(work)[0] for _ in range(runs))


def clocked(
    work: Generator[float, None, Result], spent: float, budget: float
) -> Generator[float, None, tuple[float, Result]]:
    """Seconds of long work, and its result; yields the spent fraction of the budget (s), 0..1."""
    seconds = 0.0
    while True:
        clock = perf_counter()
        try:
            next(work)
        except StopIteration as done:
            return seconds + perf_counter() - clock, done.value
        seconds += perf_counter() - clock
        yield min((spent + seconds) / budget, 1.0)


def peak_memory() -> int | None:
    """Peak memory of this process, bytes; None on Windows, which does not report it."""
    try:
        import resource  # Unix only
    except ImportError:
        return None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (
        1 if sys.platform == "darwin" else 1024
    )


BUDGET = 60.0  # s for the splat
REFERENCE_FINER = 10.0  # ratio of the finest rung's tolerance to the reference's
REFERENCE_EFFORT = 16  # ratio of the reference's Effort to the rungs', for chaotic light
LONG_SPLAT_S = 0.5  # s: a longer splat runs once for each of the two pictures


@dataclass(frozen=True)
class Ladders:
    """Rungs to measure, and the number of runs.

    tolerances : display px; the settings' own is added
    spps : samples a pixel of the splat, rising
    runs : of each rung, for the median; fewer for a long splat
    budget : s for all runs of the splat; rungs beyond it are listed as not run
    """

    tolerances: tuple[float, ...] = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
    spps: tuple[int, ...] = (1, 4, 16, 64, 256, 1024)
    runs: int = 5
    budget: float = BUDGET

    def with_tolerance(self, own: float) -> tuple["Ladders", float]:
        """Tolerances including the scene's own, coarse to fine, and the scene's own.

        Blender stores it in single precision, so an almost equal one is taken as the same.
        """
        own = next((t for t in self.tolerances if isclose(t, own, rel_tol=1e-6)), own)
        tolerances = tuple(sorted({*self.tolerances, own}, reverse=True))
        return replace(self, tolerances=tolerances), own


def measure(
    rig: Rig,
    settings: Settings | None = None,
    picture: NDArray[np.float32] | None = None,
    ladders: Ladders | None = None,
    read: Callable[[], object] | None = None,
    write: Callable[[NDArray[np.float32]], object] | None = None,
) -> Generator[float, None, WorkPrecision]:
    """Measure error against run time on a rig; yields progress 0..1.

    Parameters
    ----------
    picture : (h, w, 4) linear, nowhere black; replaces the rig's own. None: a zone plate
    read, write : read the scene, write a source image (H, W, 3); timed if given

    Raises
    ------
    RigError, MeshError
        One sentence on the fault of the rig.
    """
    own_settings = settings or Settings()
    own_settings.check()
    rig.check()

    # A margin would fill holes. The splat has neither glare nor paths; `choices` covers those.
    settings = replace(own_settings, margin=0, suppress_glare=0.0, ghosts="mean")
    ladders, own = (ladders or Ladders()).with_tolerance(settings.tolerance)
    detailed, dotted, about = pictures(rig, picture)

    yield from subprogress(Session().solve(rig, settings), 0.0, 0.03)
    memory = peak_memory()  # before the reference, which needs more than any solve
    finest = _finest(settings, ladders)
    reference = yield from subprogress(make_reference(detailed, dotted, finest), 0.03, 0.15)

    adaptive = _adaptive(detailed, dotted, settings, reference, ladders)
    rungs = yield from subprogress(adaptive, 0.15, 0.55)
    rungs += yield from subprogress(_splats(reference, ladders), 0.55, 0.9)
    choices = yield from subprogress(
        measure_choices(rig, replace(own_settings, margin=0)), 0.9, 0.98
    )

    source = reference.source
    read_seconds = median_seconds(read, ladders.runs) if read else None
    write_seconds = median_seconds(lambda: write(source), ladders.runs) if write else None
    yield 1.0

    channels = reference.solution.channels
    own_rung = _unmeasured(finest.tolerance, reference.solution, reference)
    return WorkPrecision(
        rungs=tuple(rungs),
        reference=replace(own_rung, image=reference.own_errors()),
        tessellation_error=max(channel.tessellation_error for channel in channels),
        quantisation=quantisation(source[reference.is_shown]),
        tolerance=own,
        read_seconds=read_seconds,
        write_seconds=write_seconds,
        peak_memory=memory,
        n_shown=int(reference.is_shown.sum()),
        n_checked=N_CHECKED,
        times_finer=times_finer(rig),
        picture=about,
        choices=choices,
        view_sizes=tuple(channel.view_map.view_size for channel in channels),
        display_size=(rig.display.width, rig.display.height),
    )


def _finest(settings: Settings, ladders: Ladders) -> Settings:
    """Settings of the reference."""
    return replace(
        settings,
        tolerance=max(ladders.tolerances[-1] / REFERENCE_FINER, LEAST_TOLERANCE),
        # Samples have the same places in each solve of the same effort, so their noise would
        # cancel.
        effort=min(REFERENCE_EFFORT * settings.effort, MOST_EFFORT),
    )


def _adaptive(
    detailed: Rig, dotted: Rig, settings: Settings, reference: Reference, ladders: Ladders
) -> Generator[float, None, list[Rung]]:
    """Rungs of the tolerances. Each solve runs in one step, so that pauses are not measured."""
    tolerances, runs = ladders.tolerances, ladders.runs
    rungs: list[Rung] = []
    times: list[list[dict[str, float]]] = [[] for _ in tolerances]
    repaints: list[list[float]] = [[] for _ in tolerances]

    for run in range(runs):  # all tolerances in turn, so that other load affects them alike
        for k, tolerance in enumerate(tolerances):
            session = Session()
            here = replace(settings, tolerance=tolerance)
            solution = run_steps(session.solve(detailed, here))
            seconds, dots = timed(
                lambda session=session, here=here: run_steps(session.solve(dotted, here))
            )
            times[k].append(solution.seconds)
            repaints[k].append(seconds)

            if run == 0:
                image = reference.image_errors(solution.source, dots.source)
                rungs.append(replace(_unmeasured(tolerance, solution, reference), image=image))

            yield (run * len(tolerances) + k + 1) / (runs * len(tolerances))

    return [
        replace(rung, repaint_seconds=median(again), **_medians(of_rung))
        for rung, of_rung, again in zip(rungs, times, repaints, strict=True)
    ]


def _unmeasured(tolerance: float, solution: Solution, reference: Reference) -> Rung:
    """A rung of the tolerances without its times."""
    maps = reference.map_errors([channel.view_map for channel in solution.channels])
    return Rung("adaptive", tolerance, n_rays=solution.n_rays, maps=maps)


def _medians(times: list[dict[str, float]]) -> dict[str, Any]:
    """Times of a rung, from the seconds by stage of its runs."""
    return {
        "seconds": median(
            sum(seconds for part, seconds in run.items() if part not in BUILD) for run in times
        ),
        "runs": len(times),
        "parts": tuple((part, median(run[part] for run in times)) for part in times[0]),
    }


def _splats(reference: Reference, ladders: Ladders) -> Generator[float, None, list[Rung]]:
    """Rungs of the brute-force splat for the first viewer, within the budget.

    Each run paints one of the two pictures; a single run paints the zone plate.
    """
    first = reference.channels[0]
    plans = (
        first.plan,
        replace(first.plan, rig=reference.dotted),
    )  # both pictures trace the same rays
    n_rays = first.plan.viewer.width * first.plan.viewer.height
    budget = ladders.budget
    seconds_a_sample = first.seconds_a_ray * n_rays
    spent = 0.0

    rungs: list[Rung] = []
    for spp in ladders.spps:
        predicted = seconds_a_sample * spp
        if spent + predicted > budget:
            rungs.append(Rung("splat", float(spp), predicted_seconds=predicted))
            continue

        n_runs = _n_runs(spent, predicted, ladders)
        seconds: list[float] = []
        images: list[NDArray[np.float32]] = []

        for run in range(n_runs):
            taken, image = yield from clocked(splat(plans[run % 2], spp, seed=spp), spent, budget)
            seconds.append(taken)
            images.append(image)
            spent += taken

        seconds_a_sample = median(seconds) / spp
        errors = reference.image_errors(*images[:2])
        rungs.append(
            Rung("splat", float(spp), median(seconds), n_runs, n_rays=spp * n_rays, image=errors)
        )

    return rungs


def _n_runs(spent: float, predicted: float, ladders: Ladders) -> int:
    """Number of runs of a splat rung, given its seconds and those already spent."""
    if spent + 2 * predicted > ladders.budget:
        return 1
    return 2 if predicted > LONG_SPLAT_S else max(ladders.runs, 2)
