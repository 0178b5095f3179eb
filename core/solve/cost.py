"""The time that a solve would take at another tolerance."""

from collections.abc import Sequence

import numpy as np

from ..rig.settings import LEAST_TOLERANCE, MOST_TOLERANCE

# parts of a solve that the splat needs as well, once for all samples
BUILD = ("fingerprint", "plan")
REFINED = ("tracing", "shares")  # parts of a solve that depend on the tolerance
# of interpolation within a cell, in the cell's side; cells
# cover an area: their number goes by 2 / ORDER
ORDER = 4


def cost(
    seconds: dict[str, float],
    tolerance: float,
    wanted: float,
    ladder: Sequence[tuple[float, float]] = (),
) -> float | None:
    """About how many seconds the last solve would have taken at another tolerance.

    Parameters
    ----------
    seconds : of the last solve by part
    tolerance, wanted : display px, the last solve's and the other
    ladder : tolerances (display px) and seconds that a report measured. Without, a cell's error is
        taken to go with its side to the power ORDER, so that the number of cells goes with the
        tolerance to the power -2 / ORDER: too much where cells are as small as they get already.

    Returns
    -------
    None when the last solve traced nothing, or the wanted tolerance cannot be kept
    """
    if REFINED[0] not in seconds or not LEAST_TOLERANCE <= wanted <= MOST_TOLERANCE:
        return None

    fixed = sum(taken for part, taken in seconds.items() if part in BUILD)
    total = sum(seconds.values())

    if len(ladder) > 1:
        at, measured = np.log(np.array(sorted(ladder))).T
        here, there = np.interp(np.log([tolerance, wanted]), at, measured)
        return float(fixed + (total - fixed) * np.exp(there - here))

    refined = sum(seconds.get(part, 0.0) for part in REFINED)
    return float(total - refined + refined * (tolerance / wanted) ** (2 / ORDER))
