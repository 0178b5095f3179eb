"""A work-precision measurement: rungs of a ladder, each with its time and its error."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from .choices import Choice
from .image_errors import ImageErrors, MapErrors

Size = tuple[int, int]  # (width, height), px


@dataclass(frozen=True)
class Rung:
    """One way to make a source image, its time and its error. None: not known, or not run.

    Parameters
    ----------
    setting : tolerance in display px, or samples a pixel
    seconds : median of `runs` runs, from the plan to the
        source image with its own estimate of errors
    predicted_seconds : of a splat that was not run
    repaint_seconds : median, for another picture with nothing else changed
    parts : (name, median seconds) of the solve's parts, the plan included
    n_rays : rays traced
    maps : the error of each viewer's map; the splat has none
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
    rungs : the ladder of tolerances, coarse to fine, then the splat's
    reference : of all rungs. Its map is compared with the trace, and the
        seen image of its source image with the ideal image
    tessellation_error : rms display px, the same for all rungs; of the viewer that has most
    quantisation : rms of the changes by rounding in the
        encoded source image (0..1), by number format
    tolerance : display px, of the scene itself; one of the rungs
    read_seconds, write_seconds : medians, for reading the scene and
        writing the source image; None: not measured
    peak_memory : bytes, the most that the whole process has
        held up to the first solve; None: not known
    n_shown : display pixels that are compared: those that show the picture
    n_checked : points at which each map was compared with the trace
    times_finer : each way, the display's pixels from which the reference's source image is made
    picture : which picture the image errors are of
    choices : the cost or gain of Ghosts and Suppress Glare, with the rig's own picture
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
    choices: tuple[Choice, ...]
    view_sizes: tuple[Size, ...]
    display_size: Size

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
