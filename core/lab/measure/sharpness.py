"""How sharp each viewer sees the picture: by slanted edges in its place (ISO 12233).

They stand at N x N places: viewers who look at the picture's middle agree about that one.
"""

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from ...base.arrays import Floats
from ...image.picture import cover_in_view
from ...rig.rig import Rig
from ...rig.settings import Settings
from ...solve.session import Session
from ...solve.solution import Solution
from .viewer_errors import WHOLE, displaced

TILT = np.radians(5.0)  # of the edge, from the picture's height
PARTS = 4  # of a pixel, by which the edge is sampled
PADDED = 1 << 14  # parts, for fine steps of frequency
DARK, BRIGHT = 0.25, 0.75  # linear light beside the edge
SIDE = 1024  # picture px
N = 3  # places each way, of the picture
REACH = 0.12  # of the picture as it is seen, to each side of a place
FEWEST = 8  # viewer px each way, and rows


def mtf50(light: Floats) -> float | None:
    """The lowest frequency, cycles / px, at which the contrast of a slanted edge is 50 %.

    light : (h, w) linear light around an edge that goes from the first row to the last, some
        degrees off upright; NaN where it is not known: such rows are left out

    None where there are too few rows, no edge, or where the contrast is 50 % at no frequency below
    that of the parts, PARTS / 2. The pixels' own blur counts; that of the parts does not.

    Source: ISO 12233, slanted edge: distances from the line through the rows' middles, sampled
    PARTS times a pixel, differentiated, windowed (Hamming), transformed.
    """
    known = np.isfinite(light).all(axis=1)
    y = np.flatnonzero(known)
    light = light[known]
    if min(light.shape) < FEWEST:
        return None
    steps = np.diff(light, axis=1)
    height = steps.sum(axis=1)
    if not (np.abs(height) > 0.1 * (BRIGHT - DARK)).all():
        return None

    middles = (steps * np.arange(1, light.shape[1])).sum(axis=1) / height
    slope, start = np.polyfit(y, middles, 1)
    x = np.arange(light.shape[1]) + 0.5
    away = (x - start - slope * y[:, None]) / np.hypot(1, slope)
    reach = int(PARTS * min(-away.min(axis=1).max(), away.max(axis=1).min()))
    if reach < PARTS * FEWEST / 2:
        return None

    part = np.floor(away * PARTS).astype(int) + reach
    is_near = (part >= 0) & (part < 2 * reach)
    counts = np.bincount(part[is_near], minlength=2 * reach)
    sums = np.bincount(part[is_near], light[is_near], 2 * reach)
    is_met = counts > 0
    at = np.arange(2 * reach)
    spread = np.interp(at, at[is_met], sums[is_met] / counts[is_met])

    line = np.diff(spread) * np.hamming(2 * reach - 1)
    contrast = np.abs(np.fft.rfft(line, PADDED))
    frequencies = np.fft.rfftfreq(PADDED, 1 / PARTS)
    # the mean over a part, and the difference of two parts
    contrast /= contrast[0] * np.sinc(frequencies / PARTS) ** 2
    below = np.flatnonzero(contrast < 0.5)
    if not len(below):
        return None
    k = int(below[0])
    return float(np.interp(0.5, contrast[[k, k - 1]], frequencies[[k, k - 1]]))


def edge_image() -> Floats:
    """A picture (SIDE, SIDE, 4) float32, linear RGBA: N edges that are tilted by TILT, through the
    middles of N columns, dark and bright between them by turns.
    """
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5 - SIDE / 2
    away = x * np.cos(TILT) + y * np.sin(TILT)
    light = np.zeros_like(away)
    for k in range(N):
        start = ((k + 0.5) / N - 0.5) * SIDE * np.cos(TILT)
        light += (-1) ** k * np.clip(away - start + 0.5, 0, 1)
    light = DARK + (BRIGHT - DARK) * light
    return np.stack([light, light, light, np.ones_like(light)], axis=2).astype(np.float32)


def sharpness(
    session: Session, rig: Rig, settings: Settings
) -> Generator[float, None, tuple[float | None, ...]]:
    """For each viewer of a rig the MTF50, cycles / viewer px, of slanted edges in the picture's
    place, the mean over N x N places, seen of a source image that is solved for all viewers;
    yields progress 0..1.

    session : one that has solved the rig knows all rays, and only paints

    None where `mtf50` finds none at any place. Of images that are one viewer's alone it is as if
    all saw the same edges.

    Raises
    ------
    RigError : as `Session.solve`; the picture is no flat rectangle
    """
    of_edges = replace(rig, pictures=(rig.picture_place.showing(edge_image()),))
    solution = yield from session.solve(of_edges, settings)
    return tuple(_of_viewer(solution, k) for k in range(len(rig.viewers)))


def _of_viewer(solution: Solution, number: int) -> float | None:
    """The mean MTF50 of the edges that the viewer of a channel sees."""
    channel = solution.channels[number]
    place, viewer = solution.rig.picture_place, channel.viewer
    middles, straight = displaced(solution, number, N)
    half = REACH * np.ptp(straight, axis=0) * N / (N - 1)
    whole = (cover_in_view(place, viewer) >= WHOLE) & (channel.view_coverage >= WHOLE)
    seen = np.where(whole, channel.seen(solution.source).mean(axis=2, dtype=float), np.nan)

    found = []
    for middle in middles[np.isfinite(middles).all(axis=1)]:
        left, top = np.maximum(np.floor(middle - half), 0).astype(int)
        right, bottom = np.maximum(np.ceil(middle + half), 0).astype(int)
        light = seen[top:bottom, left:right]
        across, down = (np.nansum(np.abs(np.diff(light, axis=axis))) for axis in (1, 0))
        found.append(mtf50(light if across >= down else light.T))
    known = [value for value in found if value is not None]
    return float(np.mean(known)) if known else None
