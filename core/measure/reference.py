"""References for view maps and source images: traced landings, and a much finer solve.

The map is compared with rays traced exactly, in float64, at random points of the viewer's image.
Images are compared with those of the finer solve, for a picture of fine detail in the place of the
rig's own: where a picture is smooth, a wrong place has the right colour. The seen image of a source
image is simulated through the finer solve's shares.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Floats
from ..bench.placement import lattice
from ..errors import RigError
from ..image.picture import of_square, picture_from_view
from ..image.seen_image import lattice_shift
from ..light.plan import Plan
from ..light.planning import make_plan
from ..light.trace import trace_all
from ..rig import PicturePlace, Rig
from ..settings import MOST_TOLERANCE, Settings
from ..solve.session import Session
from ..solve.solution import Solution
from ..steps import within
from ..viewer import Viewer

Image = NDArray[np.float32]  # (h, w, c) linear, row 0 at the top

N_CHECKED = 1 << 16  # points of the viewer's image at which the map is compared with the trace
PERCENTILE = 99.9
HALF = 0.5  # a display pixel counts as covered from this share of its area on
# a pixel is the picture's when this share of what it shows
# is: where the outline runs, methods differ
WHOLE = 0.99
FINEST = 10.0  # px: the zone plate's shortest period, at the middle of its edges
# px, of the zone plate
LEAST_SIDE = 16
MOST_SIDE = 4096
TIMES_FINER = 4  # each way, the display's pixels from which the reference's source image is made
MOST_FINE = 2048  # px: side of the largest such display, for the sake of memory
PROBES = 256  # rays along each side of the viewer's image that look for the picture


class Mapping(Protocol):
    """The part of a view map that is compared with the trace."""

    def display_from_view(self, xy: Floats) -> Floats:
        """Display px (n, 2) of viewer px (n, 2), NaN where nothing lands."""
        ...


@dataclass(frozen=True)
class MapErrors:
    """Distance of a view map from traced landings, over the points that both take to the display.

    rms, percentile : rms and PERCENTILE of the distance,
        display px; None where there are no such points
    overlap : of the points that the map or the trace takes to
        the display, the share that both do (IoU)
    """

    rms: float | None
    percentile: float | None
    overlap: float | None


@dataclass(frozen=True)
class ImageErrors:
    """How far off a source image is, and its seen image.

    source_rmse : linear values, over the display pixels that show
        the picture and no more (Reference.is_shown)
    holes : those of them that stay black, where the picture is
        nowhere black; they count in source_rmse
    seen_psnr : dB, white is 1, over the viewer's pixels that show the picture and no more: what is
        seen of this source image, against what is seen of the reference's; None when there is no
        difference
    lattice_shift, lattice_largest : mean and largest displacement of the dots of the
        lattice as seen, against the ideal image, viewer px; None where no dot is seen
    lattice_seen : dots that are seen; None where the lattice was not painted
    """

    source_rmse: float
    holes: int
    seen_psnr: float | None
    lattice_shift: float | None
    lattice_largest: float | None
    lattice_seen: int | None


@dataclass(frozen=True, eq=False)
class Reference:
    """Traced landings and a fine solve of a rig.

    Parameters
    ----------
    plan : of the rig, with the picture of fine detail
    dotted : the same rig with the lattice of dots as picture
    solution, dots : solves of both at a much finer tolerance
    source : (H, W, 3), the display's image for the picture of
        fine detail: from a display of finer pixels
    points, landed : (n, 2) viewer px and where their rays land,
        display px, NaN where not on the display
    is_shown : (H, W), display pixels that the viewer sees by half
        or more, and that show nothing but the picture
    is_seen : (h, w), viewer pixels in which nothing but the picture is seen
    seconds_a_ray : of the trace
    """

    plan: Plan
    dotted: Rig
    solution: Solution
    dots: Solution
    source: Image
    points: Floats
    landed: Floats
    is_shown: Bools
    is_seen: Bools
    seconds_a_ray: float

    def map_errors(self, view_map: Mapping) -> MapErrors:
        """Compare a view map with the traced landings."""
        here = _on_display(view_map.display_from_view(self.points), self.plan.rig)
        has_landed = np.isfinite(self.landed[:, 0])
        has_here = np.isfinite(here[:, 0])
        both = has_landed & has_here
        either = has_landed | has_here
        overlap = float(both.sum() / either.sum()) if either.any() else None
        if not both.any():
            return MapErrors(None, None, overlap)
        distance = np.linalg.norm((here - self.landed)[both], axis=1)
        return MapErrors(_rms(distance), float(np.percentile(distance, PERCENTILE)), overlap)

    def image_errors(self, detailed: Image, dotted: Image | None = None) -> ImageErrors:
        """Compare source images (H, W, 3) of the two
        pictures, or of the first, with the reference's.
        """
        wanted = self.source[self.is_shown]
        found = detailed[self.is_shown]
        seen = (self.solution.seen(detailed) - self.solution.seen(self.source))[self.is_seen]
        return ImageErrors(
            _rms(found - wanted),
            int((found == 0).all(axis=1).sum()),
            psnr(seen),
            *self._shift(dotted),
        )

    def own_errors(self) -> ImageErrors:
        """The rest, when only the reference's own errors are
        left: the PSNR is against the ideal image.
        """
        seen = (self.solution.seen(self.source) - self.solution.ideal())[self.is_seen]
        holes = int((self.source[self.is_shown] == 0).all(axis=1).sum())
        return ImageErrors(0.0, holes, psnr(seen), *self._shift(self.dots.source))

    def _shift(self, dotted: Image | None) -> tuple[float | None, float | None, int | None]:
        if dotted is None:
            return None, None, None
        shift = lattice_shift(self.solution.seen(dotted), self.dots.ideal())
        return (shift.mean, shift.largest, shift.n_seen) if shift.n_seen else (None, None, 0)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values, dtype=float)))) if values.size else 0.0


def psnr(difference: Floats) -> float | None:
    """Peak signal-to-noise ratio, dB, of an image that is off by this; None where it is not."""
    rms = _rms(difference)
    return float(-20 * np.log10(rms)) if rms > 0 else None


def _on_display(xy: Floats, rig: Rig) -> Floats:
    """Display px (n, 2), NaN where they are not on the display's
    image: landings just beside it are traced too.
    """
    with np.errstate(invalid="ignore"):
        is_on = ((xy >= 0) & (xy <= (rig.display.width, rig.display.height))).all(axis=1)
    return np.where(is_on[:, None], xy, np.nan)


def zone_plate(pixels: int) -> Image:
    """Rings that grow finer outward: detail in all directions, and
    nowhere black, so that a black pixel is a hole.

    Returns
    -------
    (pixels, pixels, 4) float32, linear 0.1..0.9, alpha 1; the
    period is FINEST px at the middle of the edges
    """
    across = (np.arange(pixels) + 0.5) / pixels - 0.5
    phase = 2 * np.pi * pixels / FINEST * (across[:, None] ** 2 + across**2)
    rings = [0.5 + 0.4 * np.cos(phase + 2 * np.pi * channel / 3) for channel in range(3)]
    return np.stack([*rings, np.ones_like(phase)], axis=2).astype(np.float32)


def picture_extent(place: PicturePlace, viewer: Viewer) -> float:
    """Side of a picture as a viewer sees it straight, the root
    of its area, in viewer px; 0 where it is unseen.
    """
    place = replace(place, width=1, height=1)
    x, y = ((np.arange(PROBES) + 0.5) / PROBES * size for size in (viewer.width, viewer.height))
    points = picture_from_view(
        place, viewer, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), of_square(1e-3)
    )
    seen = points.footprint[points.cover > HALF]
    return 1e-3 / float(np.median(seen)) if len(seen) else 0.0


def showing(rig: Rig, image: Image) -> Rig:
    """The same rig with another image (h, w, 4) where its picture is."""
    return replace(rig, pictures=(rig.picture_place.showing(image),))


def pictures(rig: Rig, image: Image | None = None) -> tuple[Rig, Rig, str]:
    """The rig with a picture of fine detail and with the
    lattice of dots, and the name of the first.

    One pixel of the zone plate is one of the viewer's: shares are no larger,
    so that all methods read the same picture.
    """
    extent = max(picture_extent(rig.picture_place, viewer) for viewer in rig.viewers)
    side = int(np.clip(np.ceil(extent), LEAST_SIDE, MOST_SIDE))
    about = "the picture that was given" if image is not None else (
        f"a zone plate of {side} x {side} px in the picture's place, period down to {FINEST:g}"
        f" viewer px"
    )  # fmt: skip
    image = zone_plate(side) if image is None else image
    dots = lattice(side)
    return showing(rig, image), showing(rig, np.dstack([dots, np.ones_like(dots[..., 0])])), about


def make_reference(
    detailed: Rig, dotted: Rig, settings: Settings
) -> Generator[float, None, Reference]:
    """Solve and trace the reference; yields progress 0..1.

    Raises
    ------
    RigError, MeshError
        The rig cannot be solved, or no display pixel shows the picture alone.
    """
    session = Session()
    solution = yield from within(session.solve(detailed, settings), 0.0, 0.4)
    dots = yield from within(session.solve(dotted, settings), 0.4, 0.45)
    source, white = yield from within(_fine_sources(detailed, settings), 0.45, 0.9)
    is_shown = (solution.display_coverage >= HALF) & (white.max(axis=2) >= WHOLE)
    if not is_shown.any():
        raise RigError(
            "No pixel of the display '{display}' shows the picture alone, there is nothing"
            " to compare: raise its resolution.",
            display=detailed.display.name,
        )
    plan = make_plan(detailed, settings)
    viewer = plan.viewer
    points = np.random.default_rng(0).random((N_CHECKED, 2)) * (viewer.width, viewer.height)
    clock = perf_counter()
    landings = trace_all(plan, *viewer.rays(points))
    seconds = perf_counter() - clock
    yield 1.0
    return Reference(
        plan=plan,
        dotted=dotted,
        solution=solution,
        dots=dots,
        source=source,
        points=points,
        landed=_on_display(np.where(landings.has_arrived[:, None], landings.xy, np.nan), detailed),
        is_shown=is_shown,
        is_seen=solution.seen(white).max(axis=2) >= WHOLE,
        seconds_a_ray=seconds / len(points),
    )


def times_finer(rig: Rig) -> int:
    """How many times finer, each way, the display of the reference is."""
    return int(np.clip(MOST_FINE // max(rig.display.width, rig.display.height), 1, TIMES_FINER))


def _fine_sources(rig: Rig, settings: Settings) -> Generator[float, None, tuple[Image, Image]]:
    """Source images (H, W, 3) of the rig and of white in its
    picture's place, from a display of finer pixels.

    Each share is read at a few places; on finer pixels there are more shares, and each is smaller.
    """
    k = times_finer(rig)
    display = replace(rig.display, width=k * rig.display.width, height=k * rig.display.height)
    fine = replace(rig, displays=(display,))
    place = rig.picture_place
    white = showing(fine, np.ones((place.height, place.width, 4), np.float32))
    session = Session()
    here = replace(settings, tolerance=min(k * settings.tolerance, MOST_TOLERANCE))
    one = yield from within(session.solve(fine, here), 0.0, 0.9)
    other = yield from within(session.solve(white, here), 0.9, 1.0)
    weight = one.weight[..., None]

    def joined(values: Floats) -> Floats:
        return values.reshape(rig.display.height, k, rig.display.width, k, -1).sum(axis=(1, 3))

    total = joined(weight)
    sources = (
        joined(weight * solution.source) / np.where(total > 0, total, 1)
        for solution in (one, other)
    )
    return tuple(source.astype(np.float32) for source in sources)
