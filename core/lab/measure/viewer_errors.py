"""What each of several viewers sees of one source image: coverage, displacement, PSNR, conflict."""

from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from ...base.arrays import Floats
from ...base.steps import Steps, hold_progress
from ...image.flat_picture import not_flat, view_of_picture
from ...image.inverse_lookup import mapped, plane_mapping
from ...image.picture import cover_in_view
from ...image.pyramid import Pyramid, pyramids_of
from ...image.source_image import Painting, find_filter_taps
from ...light.beams import quilt_places
from ...light.rays import main_landings
from ...light.trace import trace_all
from ...rig.rig import Rig
from ...rig.settings import Settings
from ...solve.channel import Channel
from ...solve.session import Session
from ...solve.solution import Solution
from .places_seen import grid_of
from .reference import psnr

N_POINTS = 7  # points of the picture, each way
MOST_ROUNDS = 20
SETTLED_PX = 1e-9  # viewer px
WHOLE = 0.99  # of a viewer pixel: below this it does not show only the picture


@dataclass(frozen=True)
class ViewerReport:
    """One viewer's view of a source image.

    viewer : its name
    weight : its weight
    coverage : fraction of the picture, as seen, that the display can show
    n_points : seen points among the N_POINTS^2 points of the picture
    mean_px, largest_px : displacement, viewer px; None if none is seen, and if each viewer has its
        own image
    mean_arcmin, largest_arcmin : the same as an angle; None for an orthographic viewer too
    psnr : dB, white is 1, of the seen image against the ideal one over pixels that show only the
        picture; None if there is no difference or nothing to compare
    unremovable : rms of linear light, white is 1, over the seen display pixels, between the colours
        this viewer needs and the weighted mean of all viewers; no source image has a smaller error
        for all
    """

    viewer: str
    weight: float
    coverage: float
    n_points: int
    mean_px: float | None
    largest_px: float | None
    mean_arcmin: float | None
    largest_arcmin: float | None
    psnr: float | None
    unremovable: float


def viewer_reports(
    solution: Solution, off: tuple[float, ...] | None = None
) -> Generator[float, None, tuple[ViewerReport, ...]]:
    """A report for each viewer, the worst first; yields progress 0..1.

    The order is by what is unseen, then by the largest displacement, or by PSNR if nothing is
    displaced.

    off : for each viewer, from `conflict_in_light`; None to compute it here

    Raises
    ------
    RigError : the picture is not a flat rectangle
    """
    has_own = solution.rig.has_own_images
    if solution.settled is None and len(solution.channels) > 1 and not has_own:
        raise not_flat(solution.rig.picture_place)

    if off is None:
        off, _ = yield from conflict_in_light(solution)
    reports = []
    for number, unremovable in enumerate(off):
        reports.append(_report(solution, number, unremovable))
        yield 1.0

    return tuple(sorted(reports, key=_how_good))


def _how_good(report: ViewerReport) -> tuple[bool, float, float]:
    like = np.inf if report.psnr is None else report.psnr
    return report.coverage > 0 and report.n_points > 0, -(report.largest_px or 0.0), like


def _report(solution: Solution, number: int, unremovable: float) -> ViewerReport:
    """Report for the viewer of one channel."""
    channel = solution.channels[number]
    viewer = channel.viewer
    seen, straight = displaced(solution, number)
    length = np.linalg.norm(seen - straight, axis=1)
    n_points = int(np.isfinite(length).sum())

    is_eye = viewer.projection == "perspective"
    angle = viewer.arcmin_between(seen, straight) if is_eye else np.full(len(length), np.nan)
    if solution.rig.has_own_images:  # a single viewer's picture is not moved towards others
        length, angle = np.full((2, len(length)), np.nan)

    whole = (cover_in_view(solution.rig.picture_place, viewer) >= WHOLE) & (
        channel.view_coverage >= WHOLE
    )
    difference = channel.seen(solution.source)[whole] - channel.ideal()[whole]
    mean_px, largest_px = _mean_and_largest(length)
    mean_arcmin, largest_arcmin = _mean_and_largest(angle)
    return ViewerReport(
        viewer=viewer.name,
        weight=viewer.weight,
        coverage=float(np.clip(channel.picture_coverage, 0, 1)),
        n_points=n_points,
        mean_px=mean_px,
        largest_px=largest_px,
        mean_arcmin=mean_arcmin,
        largest_arcmin=largest_arcmin,
        psnr=psnr(difference),
        unremovable=unremovable,
    )


def _mean_and_largest(values: Floats) -> tuple[float | None, float | None]:
    """Mean and largest of the finite values; None if there are none."""
    known = values[np.isfinite(values)]
    return (float(known.mean()), float(known.max())) if len(known) else (None, None)


def displaced(solution: Solution, number: int, n: int = N_POINTS) -> tuple[Floats, Floats]:
    """Places (n * n, 2), viewer px, of n x n points of the picture as a channel's viewer sees them.

    Also their places without glass; NaN if a point is not seen. A place x of the viewer's image
    shows the place of the picture straight behind it, plus the step of the display pixel on which
    its ray lands. Iteration by the remaining difference finds the wanted point; its rays are
    traced.

    Raises
    ------
    RigError : the picture is not a flat rectangle, or is seen edge-on
    """
    channel = solution.channels[number]
    place, viewer = solution.rig.picture_place, channel.viewer
    straight = view_of_picture(place, viewer, grid_of(n))
    if solution.settled is None:
        return _on_display(channel, straight), straight

    mapping = plane_mapping(place, viewer)
    wanted, _ = mapped(mapping.there, straight)
    steps = solution.settled.steps[number]
    at = straight.copy()

    for _ in range(MOST_ROUNDS):
        landed = _landed(channel, at)
        shown = mapped(mapping.there, at)[0] + _between(steps, landed)
        missing = (wanted - shown).T
        # the picture's step in viewer px
        move = mapped(mapping.back, (mapped(mapping.there, at)[0].T + missing))[0].T - at
        if not (np.abs(move) > SETTLED_PX).any():
            break
        at = np.where(np.isfinite(move), at + move, np.nan)

    return np.where(np.isfinite(move), at, np.nan), straight


def _on_display(channel: Channel, xy: Floats) -> Floats:
    """Viewer px (n, 2); NaN if their rays do not land on the display."""
    return np.where(np.isfinite(_landed(channel, xy)).all(axis=1)[:, None], xy, np.nan)


def _landed(channel: Channel, xy: Floats) -> Floats:
    """Source image px (n, 2) on which rays through viewer px (n, 2) land; NaN for none."""
    landed = np.full(xy.shape, np.nan)
    known = np.flatnonzero(np.isfinite(xy).all(axis=1))
    if len(known):
        landings = trace_all(channel.plan, *channel.viewer.rays(xy[known]))
        landings = main_landings(landings, len(known))
        xy = quilt_places(channel.plan, landings)
        landed[known] = np.where(landings.has_arrived[:, None], xy, np.nan)
    return landed


def _between(values: Floats, at: Floats) -> Floats:
    """Bilinear samples (2, n) of an image (2, H, W) at places (n, 2) px.

    NaN next to a NaN pixel or outside the image.
    """
    height, width = values.shape[1:]
    is_on = ((at >= 0) & (at <= [width, height])).all(axis=1)
    x, y = np.clip(np.where(is_on[:, None], at, 0.5) - 0.5, 0, [width - 1, height - 1]).T
    column = np.minimum(x.astype(int), max(width - 2, 0))
    row = np.minimum(y.astype(int), max(height - 2, 0))
    right, below = np.minimum(column + 1, width - 1), np.minimum(row + 1, height - 1)
    s, t = x - column, y - row
    upper = (1 - s) * values[:, row, column] + s * values[:, row, right]
    lower = (1 - s) * values[:, below, column] + s * values[:, below, right]
    return np.where(is_on, (1 - t) * upper + t * lower, np.nan)


def conflict_in_light(
    solution: Solution,
) -> Generator[float, None, tuple[tuple[float, ...], Floats]]:
    """Error that remains at the weighted mean of the colours that viewers need; linear light.

    Rms for each viewer over the display pixels it sees, and for each display pixel (H, W) over the
    viewers. No source image has a smaller error for all. Yields progress 0..1.
    """
    rig, channels = solution.rig, solution.channels
    pyramids = pyramids_of([rig.picture_of(channel.viewer).image for channel in channels])
    total = np.zeros_like(solution.source, dtype=float)
    for k, (channel, pyramid) in enumerate(zip(channels, pyramids, strict=True)):
        colours = yield from hold_progress(0.5 * k / len(channels), _asked_for(channel, pyramid))
        total += _weight(channel)[..., None] * colours
        yield 0.5 * (k + 1) / len(channels)

    weight = reduce(np.add, map(_weight, channels))
    mean = total / np.where(weight > 0, weight, 1.0)[..., None]
    square = np.zeros_like(weight)
    off = []
    for k, (channel, pyramid) in enumerate(zip(channels, pyramids, strict=True)):
        colours = yield from hold_progress(
            0.5 + 0.5 * k / len(channels), _asked_for(channel, pyramid)
        )
        of_pixel = _weight(channel) * ((colours - mean) ** 2).mean(axis=2)
        seen = _weight(channel).sum()
        off.append(float(np.sqrt(of_pixel.sum() / seen)) if seen > 0 else 0.0)
        square += of_pixel
        yield 0.5 + 0.5 * (k + 1) / len(channels)

    return tuple(off), np.sqrt(square / np.where(weight > 0, weight, 1.0))


def _weight(channel: Channel) -> Floats:
    """Weight (H, W) of each display pixel for a viewer."""
    return channel.viewer.weighed(channel.coverage.weight)


def _asked_for(channel: Channel, pyramid: Pyramid) -> Steps[Floats]:
    """Colours (H, W, 3) that one viewer alone needs, linear."""
    painting = Painting(channel.shares.display_size)
    place = channel.plan.rig.place_of(channel.viewer)
    for shares in channel.shares.pausing():
        if shares is not None:
            shown = channel.shown(shares)
            painting.add(pyramid, find_filter_taps(place, channel.viewer, shown))
        yield 0
    return painting.finished(channel.coverage.weight).astype(float)


TILT = np.radians(5.0)  # of the edge, from the picture's height
PARTS = 4  # of a pixel, sampling of the edge
PADDED = 1 << 14  # samples, for a fine frequency scale
DARK, BRIGHT = 0.25, 0.75  # linear light on either side of the edge
SIDE = 1024  # picture px
N = 3  # places each way, of the picture
REACH = 0.12  # of the picture as seen, to each side of a place
FEWEST = 8  # viewer px each way, and rows


def mtf50(light: Floats) -> float | None:
    """Lowest frequency, cycles / px, at which the contrast of a slanted edge falls to 50 % (MTF50).

    light : (h, w) linear light around an edge from the first row to the last, some degrees off
        upright; rows with NaN are left out

    None if there are too few rows, no edge, or no such frequency below PARTS / 2. The blur of the
    pixels counts, the blur of the sampling does not.

    Source: ISO 12233, slanted edge: distances from the line through the rows' centres, sampled
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
    # blur of a sample, and of the difference of two samples
    contrast /= contrast[0] * np.sinc(frequencies / PARTS) ** 2
    below = np.flatnonzero(contrast < 0.5)
    if not len(below):
        return None
    k = int(below[0])
    return float(np.interp(0.5, contrast[[k, k - 1]], frequencies[[k, k - 1]]))


def edge_image() -> Floats:
    """A picture (SIDE, SIDE, 4) float32, linear RGBA: N dark and bright columns with edges tilted
    by TILT.
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
    """MTF50, cycles / viewer px, of slanted edges in the picture's place, for each viewer.

    It is the mean over N x N places, seen of a source image solved for all viewers; None if `mtf50`
    finds none. Viewers with images of their own are measured with the same edges. Yields progress
    0..1.

    session : one that has solved the rig only paints

    Raises
    ------
    RigError : from `Session.solve`, or the picture is not a flat rectangle
    """
    of_edges = replace(rig, pictures=(rig.picture_place.showing(edge_image()),))
    solution = yield from session.solve(of_edges, settings)
    return tuple(_of_viewer(solution, k) for k in range(len(rig.viewers)))


def _of_viewer(solution: Solution, number: int) -> float | None:
    """Mean MTF50 of the edges that a channel's viewer sees."""
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
