"""Error against run time: a rig solved at a ladder of tolerances,
beside the brute-force splat at a ladder of samples.

core/measure/reference.py makes the reference.
"""

import sys
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from math import isclose
from statistics import median
from time import perf_counter
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..image.source_image import splat
from ..image_io import encode
from ..rig import Rig
from ..settings import LEAST_TOLERANCE, MOST_EFFORT, Settings
from ..solve.cost import BUILD
from ..solve.session import Session
from ..solve.solution import Solution
from ..steps import finish, within
from .choices import Choice, measure_choices
from .reference import ImageErrors, MapErrors, Reference, make_reference, pictures, times_finer

Result = TypeVar("Result")

TOLERANCES = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)  # display px
SPPS = (1, 4, 16, 64, 256, 1024)
RUNS = 5
BUDGET = 60.0  # s for the splat
FINER = 10.0  # than the finest rung is the reference
MORE_EFFORT = 16  # times that of the rungs has the reference, where light is chaotic
LONG = 0.5  # s: a splat that takes longer is run once for each of the two pictures
# between black and white, in the encoded image
STEPS = {"8 bit": 255, "10 bit": 1023, "16 bit": 65535}


@dataclass(frozen=True)
class Rung:
    """One way to make a source image, its time and its error. None: not known, or not run.

    Parameters
    ----------
    method : adaptive or splat
    setting : tolerance in display px, or samples a pixel
    seconds : median of `runs` runs, from the plan to the
        source image with its own estimate of errors
    predicted_seconds : of a splat that was not run
    repaint_seconds : median, for another picture with nothing else changed
    parts : (name, median seconds) of the solve's parts, the plan included
    n_rays : rays traced
    estimate : percentile of the map's error as the solve itself estimates it, display px
    facet_limited, unresolved : shares of the viewer's image that the solve itself says are so
    """

    method: str
    setting: float
    seconds: float | None = None
    runs: int = 0
    predicted_seconds: float | None = None
    repaint_seconds: float | None = None
    parts: tuple[tuple[str, float], ...] = ()
    n_rays: int | None = None
    estimate: float | None = None
    facet_limited: float | None = None
    unresolved: float | None = None
    map: MapErrors | None = None
    image: ImageErrors | None = None


@dataclass(frozen=True)
class WorkPrecision:
    """Error against run time of one rig on this machine.

    Parameters
    ----------
    rungs : the ladder of tolerances, coarse to fine, then the splat's
    reference : of all rungs. Its map is compared with the trace, and the
        seen image of its source image with the ideal image
    tessellation_error : rms display px, the same for all rungs
    quantisation : rms of the changes by rounding in the
        encoded source image (0..1), by number format
    tolerance : display px, of the scene itself; one of the rungs
    read_seconds, write_seconds : medians, for reading the scene and
        writing the source image; None: not measured
    peak_memory : bytes, the most that the whole process has
        held up to the first solve; None: not known
    n_shown : display pixels that are compared: those that show the picture
    n_checked : points at which the map was compared with the trace
    times_finer : each way, the display's pixels from which the reference's source image is made
    picture : which picture the image errors are of
    choices : the cost or gain of Ghosts and Suppress Glare, with the rig's own picture
    view_size, display_size : (width, height), px
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
    choices: tuple[Choice, ...]
    view_size: tuple[int, int]
    display_size: tuple[int, int]

    @property
    def own(self) -> Rung:
        """The rung at the scene's own tolerance."""
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
        """About the time of the splat to an error (linear
        values) of the source image; None: not known.

        Between its rungs a straight line in logarithms. Beyond the last, error goes as samples to
        the power -1/2, if no holes are left: as long as there are some it falls faster, and the
        time is not known.
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


def measure(
    rig: Rig,
    settings: Settings | None = None,
    picture: NDArray[np.float32] | None = None,
    tolerances: Sequence[float] = TOLERANCES,
    spps: Sequence[int] = SPPS,
    runs: int = RUNS,
    budget: float = BUDGET,
    read: Callable[[], object] | None = None,
    write: Callable[[NDArray[np.float32]], object] | None = None,
) -> Generator[float, None, WorkPrecision]:
    """Measure error against run time on a rig; yields progress 0..1.

    Parameters
    ----------
    picture : (h, w, 4) linear, nowhere black; shown in the
        place of the rig's own. None: a zone plate
    tolerances : display px; the settings' own is added
    spps : samples a pixel of the splat, rising
    runs : runs of each rung, of which the median counts; of a long splat two or one
    budget : s for all runs of the splat; rungs that would exceed it are listed as not run
    read, write : read the scene; write a source image (H, W, 3): timed if given

    Raises
    ------
    RigError, MeshError
        One sentence on the fault of the rig.
    """
    own_settings = settings or Settings()
    own_settings.check()
    # a margin would fill holes; the splat knows neither glare nor paths, of which `choices` tells
    settings = replace(own_settings, margin=0, suppress_glare=0.0, ghosts="mean")
    rig.check()
    own = next(
        (t for t in tolerances if isclose(t, settings.tolerance, rel_tol=1e-6)), settings.tolerance
    )
    # Blender has the settings' own in single precision
    ladder = sorted({*tolerances, own}, reverse=True)
    detailed, dotted, about = pictures(rig, picture)
    # samples are at the same places in each solve of the same effort: their noise would not be seen
    effort = min(MORE_EFFORT * settings.effort, MOST_EFFORT)
    finest = replace(settings, tolerance=max(ladder[-1] / FINER, LEAST_TOLERANCE), effort=effort)
    yield from within(Session().solve(rig, settings), 0.0, 0.03)
    memory = peak_memory()  # before the reference, which takes more than any solve
    reference = yield from within(make_reference(detailed, dotted, finest), 0.03, 0.15)
    rungs = yield from within(
        _adaptive(detailed, dotted, settings, reference, ladder, runs), 0.15, 0.55
    )
    rungs += yield from within(_splats(reference, spps, runs, budget), 0.55, 0.9)
    choices = yield from within(measure_choices(rig, replace(own_settings, margin=0)), 0.9, 0.98)
    source = reference.source
    read_seconds = _median_seconds(read, runs) if read else None
    write_seconds = _median_seconds(lambda: write(source), runs) if write else None
    yield 1.0
    return WorkPrecision(
        rungs=tuple(rungs),
        reference=replace(
            _unmeasured(finest.tolerance, reference.solution, reference),
            image=reference.own_errors(),
        ),
        tessellation_error=reference.solution.first.tessellation_error,
        quantisation=quantisation(source[reference.is_shown]),
        tolerance=own,
        read_seconds=read_seconds,
        write_seconds=write_seconds,
        peak_memory=memory,
        n_shown=int(reference.is_shown.sum()),
        n_checked=len(reference.points),
        times_finer=times_finer(rig),
        picture=about,
        choices=choices,
        view_size=reference.solution.first.view_map.view_size,
        display_size=(rig.display.width, rig.display.height),
    )


def _adaptive(
    detailed: Rig,
    dotted: Rig,
    settings: Settings,
    reference: Reference,
    ladder: Sequence[float],
    runs: int,
) -> Generator[float, None, list[Rung]]:
    """Rungs of the ladder of tolerances. A solve runs to its end
    in one step: time between steps is not its own.
    """
    rungs: list[Rung] = []
    times: list[list[dict[str, float]]] = [[] for _ in ladder]
    repaints: list[list[float]] = [[] for _ in ladder]
    for run in range(runs):  # all tolerances in turn: other work of the machine meets them alike
        for k, tolerance in enumerate(ladder):
            session = Session()
            here = replace(settings, tolerance=tolerance)
            solution = finish(session.solve(detailed, here))
            seconds, dots = _timed(
                lambda session=session, here=here: finish(session.solve(dotted, here))
            )
            times[k].append(solution.seconds)
            repaints[k].append(seconds)
            if run == 0:
                image = reference.image_errors(solution.source, dots.source)
                rungs.append(replace(_unmeasured(tolerance, solution, reference), image=image))
            yield (run * len(ladder) + k + 1) / (runs * len(ladder))
    return [
        replace(rung, repaint_seconds=median(again), **_medians(of_rung))
        for rung, of_rung, again in zip(rungs, times, repaints, strict=True)
    ]


def _unmeasured(tolerance: float, solution: Solution, reference: Reference) -> Rung:
    """A rung of the ladder of tolerances without its times."""
    told = solution.first.map_error
    return Rung(
        "adaptive",
        tolerance,
        n_rays=solution.n_rays,
        estimate=told.percentile,
        facet_limited=told.facet_limited,
        unresolved=told.unresolved,
        map=reference.map_errors(solution.first.view_map),
    )


def _medians(times: list[dict[str, float]]) -> dict[str, Any]:
    """Times of a rung, from the seconds by part of its runs."""
    return {
        "seconds": median(
            sum(seconds for part, seconds in run.items() if part not in BUILD) for run in times
        ),
        "runs": len(times),
        "parts": tuple((part, median(run[part] for run in times)) for part in times[0]),
    }


def _splats(
    reference: Reference, spps: Sequence[int], runs: int, budget: float
) -> Generator[float, None, list[Rung]]:
    """Rungs of the brute-force splat, as far as the budget (s)
    goes; each run is of one of the two pictures.

    Where it goes to one run only, that is of the picture of fine detail.
    """
    plan = reference.plan
    viewer = plan.viewer
    plans = plan, replace(plan, rig=reference.dotted)  # the same is traced
    n_rays = viewer.width * viewer.height
    a_sample = reference.seconds_a_ray * n_rays
    spent = 0.0
    rungs: list[Rung] = []
    for spp in spps:
        predicted = a_sample * spp
        if spent + predicted > budget:
            rungs.append(Rung("splat", float(spp), predicted_seconds=predicted))
            continue
        n_runs = 1 if spent + 2 * predicted > budget else 2 if predicted > LONG else max(runs, 2)
        seconds: list[float] = []
        images: list[NDArray[np.float32]] = []
        for run in range(n_runs):
            taken, image = yield from _clocked(splat(plans[run % 2], spp, seed=spp), spent, budget)
            seconds.append(taken)
            images.append(image)
            spent += taken
        a_sample = median(seconds) / spp
        errors = reference.image_errors(*images[:2])
        rungs.append(
            Rung("splat", float(spp), median(seconds), n_runs, n_rays=spp * n_rays, image=errors)
        )
    return rungs


def _clocked(
    work: Generator[float, None, Result], spent: float, budget: float
) -> Generator[float, None, tuple[float, Result]]:
    """Seconds of the steps of long work, and its result.

    Yields how much of the budget (s) is spent, 0..1.
    """
    seconds = 0.0
    while True:
        clock = perf_counter()
        try:
            next(work)
        except StopIteration as done:
            return seconds + perf_counter() - clock, done.value
        seconds += perf_counter() - clock
        yield min((spent + seconds) / budget, 1.0)


def quantisation(source: NDArray[np.float32]) -> dict[str, float]:
    """Rms changes by number formats in an image (..., 3), linear, sRGB-encoded to 0..1.

    Clipping is not counted.
    """
    encoded = encode(source)
    changed = {name: np.rint(encoded * top) / top - encoded for name, top in STEPS.items()}
    changed["half float"] = encode(np.asarray(source, np.float16)) - encoded
    return {name: float(np.sqrt((change**2).mean())) for name, change in changed.items()}


def peak_memory() -> int | None:
    """Bytes that this process has held at most so far; None
    where the system does not tell (Windows).
    """
    try:
        import resource  # Unix only
    except ImportError:
        return None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (
        1 if sys.platform == "darwin" else 1024
    )


def _timed(work: Callable[[], Result]) -> tuple[float, Result]:
    """Seconds that a call takes, and its result."""
    clock = perf_counter()
    result = work()
    return perf_counter() - clock, result


def _median_seconds(work: Callable[[], object], runs: int) -> float:
    return median(_timed(work)[0] for _ in range(runs))
