"""References for maps and images, their test pictures, and the errors against them.

Maps and images are compared with those of a finer solve; images also with a picture of fine detail
in place of the artist's.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Bools, Floats
from ...base.errors import RigError
from ...base.steps import subprogress
from ...bench.placement import lattice
from ...files.encoding import encode
from ...image.picture import of_square, picture_from_view
from ...image.seen_image import lattice_shift
from ...light.compile_plan import compile_plan
from ...light.plan import Plan
from ...light.rays import main_landings
from ...light.trace import trace_all
from ...map.view_map import MapError
from ...rig.rig import Display, PicturePlace, Rig
from ...rig.settings import MOST_TOLERANCE, Settings
from ...rig.viewer import Viewer
from ...solve.channel import Channel
from ...solve.session import Session
from ...solve.solution import Solution

PERCENTILE = 99.9

# between black and white, in the encoded image
STEPS_OF_FORMAT = {"8 bit": 255, "10 bit": 1023, "16 bit": 65535}


@dataclass(frozen=True)
class MapErrors:
    """Errors of one viewer's map: its own estimate, and against traced landings.

    Distances are between landings that both map and trace place on the display.

    estimate : percentile of the map's own error estimate, display px
    facet_limited, unresolved : fractions of the viewer's image that the solve reports as such
    rms, percentile : rms and PERCENTILE of the distance, display px; None without such points
    overlap : of the points that map or trace place on the display, the fraction that both do (IoU)
    """

    estimate: float
    facet_limited: float
    unresolved: float
    rms: float | None
    percentile: float | None
    overlap: float | None


@dataclass(frozen=True)
class SeenErrors:
    """Errors of one viewer's seen image.

    seen_psnr : dB, white is 1, against the reference's seen image, over viewer pixels that show
        only the picture; None if there is no difference
    lattice_shift, lattice_largest : mean and largest displacement of the seen dots against the
        ideal image, viewer px; None if no dot is seen
    lattice_seen : number of seen dots; None if the lattice was not painted
    """

    seen_psnr: float | None
    lattice_shift: float | None
    lattice_largest: float | None
    lattice_seen: int | None


@dataclass(frozen=True)
class ImageErrors:
    """Errors of a source image, and of each viewer's seen image.

    source_rmse : linear values, over display pixels that show only the picture (Reference.is_shown)
    holes : black pixels among them, though the picture is nowhere black; included in source_rmse
    """

    source_rmse: float
    holes: int
    channels: tuple[SeenErrors, ...]


def rms(values: Floats) -> float:
    """Root of the mean square; 0 of an empty array."""
    return float(np.sqrt(np.mean(np.square(values, dtype=float)))) if values.size else 0.0


def psnr(difference: Floats) -> float | None:
    """Peak signal-to-noise ratio, dB, for an error; None for no error."""
    off = rms(difference)
    return float(-20 * np.log10(off)) if off > 0 else None


def quantisation(source: NDArray[np.float32]) -> dict[str, float]:
    """Rms rounding of number formats for an image (..., 3), linear, sRGB-encoded to 0..1.

    Clipping is not counted.
    """
    encoded = encode(source)
    changed = {
        name: np.rint(encoded * top) / top - encoded for name, top in STEPS_OF_FORMAT.items()
    }
    changed["half float"] = encode(np.asarray(source, np.float16)) - encoded
    return {name: float(np.sqrt((change**2).mean())) for name, change in changed.items()}


Image = NDArray[np.float32]  # (h, w, c) linear, row 0 at the top

FINEST = 10.0  # px: shortest period of the zone plate, at the middle of its edges
# px, of the zone plate
LEAST_SIDE = 16
MOST_SIDE = 4096
PROBES = 256  # rays along each side of the viewer's image that look for the picture
HALF_COVER = 0.5  # coverage by the picture from which its scale can be read


def zone_plate(pixels: int) -> Image:
    """Zone plate: rings that get finer outward, with detail in all directions.

    It is nowhere black, so a black pixel is a hole.

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
    """Side of a picture as a viewer sees it straight (root of its area), viewer px; 0 if unseen."""
    place = replace(place, width=1, height=1)
    x, y = ((np.arange(PROBES) + 0.5) / PROBES * size for size in (viewer.width, viewer.height))
    points = picture_from_view(
        place, viewer, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), of_square(1e-3)
    )
    seen = points.footprint[points.cover > HALF_COVER]
    return 1e-3 / float(np.median(seen)) if len(seen) else 0.0


def showing(rig: Rig, image: Image) -> Rig:
    """The rig with another image (h, w, 4) as its picture."""
    return replace(rig, pictures=(rig.picture_place.showing(image),))


def pictures(rig: Rig, image: Image | None = None) -> tuple[Rig, Rig, str]:
    """The rig with a zone plate, the rig with a lattice of dots, and the zone plate's name.

    One pixel of the zone plate equals one of the viewer. Shares are no larger, so all methods read
    the same picture.
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


N_CHECKED = 1 << 16  # points of the viewer's image at which map and trace are compared
HALF = 0.5  # fraction of a display pixel's area from which it counts as covered
# Fraction of a pixel's content that has to be the picture; along the outline methods differ.
WHOLE = 0.99
TIMES_FINER = 4  # each way, of the display pixels for the reference's source image
MOST_FINE = 2048  # px: limit of such a display's side, to save memory


class Mapping(Protocol):
    """The part of a view map that is compared with the trace."""

    @property
    def error(self) -> MapError: ...

    def display_from_view(self, xy: Floats) -> Floats:
        """Display px (n, 2) of viewer px (n, 2); NaN if nothing lands."""
        ...


@dataclass(frozen=True, eq=False)
class ReferenceChannel:
    """References for the landings and the image of one viewer.

    Parameters
    ----------
    plan : for the viewer, of the rig with the zone plate
    points, landed : (n, 2) viewer px and the display px on which their rays land; NaN off the
        display
    seconds_a_ray : of the trace
    is_seen : (h, w) whether a viewer pixel shows only the picture
    solved, dots : channels of both pictures, at a much finer tolerance
    """

    plan: Plan
    points: Floats
    landed: Floats
    seconds_a_ray: float
    is_seen: Bools
    solved: Channel
    dots: Channel

    def map_errors(self, view_map: Mapping) -> MapErrors:
        """Compare a view map with the traced landings."""
        here = _on_display(view_map.display_from_view(self.points), self.plan.rig.display)
        has_landed = np.isfinite(self.landed[:, 0])
        has_here = np.isfinite(here[:, 0])
        both = has_landed & has_here
        either = has_landed | has_here
        distance = np.linalg.norm((here - self.landed)[both], axis=1)

        has_distances = len(distance) > 0
        map_error = view_map.error
        return MapErrors(
            estimate=map_error.percentile,
            facet_limited=map_error.facet_limited,
            unresolved=map_error.unresolved,
            rms=rms(distance) if has_distances else None,
            percentile=float(np.percentile(distance, PERCENTILE)) if has_distances else None,
            overlap=float(both.sum() / either.sum()) if either.any() else None,
        )

    def seen_errors(self, off: Image, dotted: Image | None) -> SeenErrors:
        """Errors from the difference (h, w, 3) of a seen image and from the lattice's source
        image.
        """
        if dotted is None:
            shift = None, None, None
        else:
            found = lattice_shift(self.solved.seen(dotted), self.dots.ideal())
            shift = (found.mean, found.largest, found.n_seen) if found.n_seen else (None, None, 0)
        return SeenErrors(psnr(off[self.is_seen]), *shift)


@dataclass(frozen=True, eq=False)
class Reference:
    """Traced landings and a fine solve of a rig.

    Parameters
    ----------
    dotted : the rig with the lattice of dots as its picture
    solution, dots : solves of both pictures at a much finer tolerance
    source : (H, W, 3) the display's image of the zone plate, from a display of finer pixels
    is_shown : (H, W) whether the viewer sees at least half of a display pixel, showing only the
        picture
    channels : one for each of the solution's
    """

    dotted: Rig
    solution: Solution
    dots: Solution
    source: Image
    is_shown: Bools
    channels: tuple[ReferenceChannel, ...]

    def map_errors(self, view_maps: Sequence[Mapping]) -> tuple[MapErrors, ...]:
        """Compare each viewer's map with its traced landings."""
        return tuple(
            channel.map_errors(view_map)
            for channel, view_map in zip(self.channels, view_maps, strict=True)
        )

    def image_errors(self, detailed: Image, dotted: Image | None = None) -> ImageErrors:
        """Compare source images (H, W, 3) of both pictures, or of the first, with the
        reference's.
        """
        wanted = self.source[self.is_shown]
        found = detailed[self.is_shown]
        return ImageErrors(
            source_rmse=rms(found - wanted),
            holes=int((found == 0).all(axis=1).sum()),
            channels=tuple(
                channel.seen_errors(
                    channel.solved.seen(detailed) - channel.solved.seen(self.source), dotted
                )
                for channel in self.channels
            ),
        )

    def own_errors(self) -> ImageErrors:
        """The remaining errors of the reference itself; its PSNR is against the ideal image."""
        return ImageErrors(
            source_rmse=0.0,
            holes=int((self.source[self.is_shown] == 0).all(axis=1).sum()),
            channels=tuple(
                channel.seen_errors(
                    channel.solved.seen(self.source) - channel.solved.ideal(), self.dots.source
                )
                for channel in self.channels
            ),
        )


def _on_display(xy: Floats, display: Display) -> Floats:
    """Display px (n, 2); NaN off the display's image, since landings next to it are traced as
    well.
    """
    with np.errstate(invalid="ignore"):
        is_on = ((xy >= 0) & (xy <= (display.width, display.height))).all(axis=1)
    return np.where(is_on[:, None], xy, np.nan)


def make_reference(
    detailed: Rig, dotted: Rig, settings: Settings
) -> Generator[float, None, Reference]:
    """Solve and trace the reference; yields progress 0..1.

    Raises
    ------
    RigError, MeshError
        The rig cannot be solved, or no display pixel shows only the picture.
    """
    session = Session()
    solution = yield from subprogress(session.solve(detailed, settings), 0.0, 0.4)
    dots = yield from subprogress(session.solve(dotted, settings), 0.4, 0.45)
    source, white = yield from subprogress(_fine_sources(detailed, settings), 0.45, 0.9)

    is_shown = (solution.display_coverage >= HALF) & (white.max(axis=2) >= WHOLE)
    if not is_shown.any():
        raise RigError(
            "No pixel of the display '{display}' shows only the picture, so there is nothing to"
            " compare. Raise its resolution.",
            display=detailed.display.name,
        )

    plan = compile_plan(detailed, replace(settings, wavelength=solution.first.wavelength))
    channels = tuple(
        _traced(plan.seen_by(viewer), solved, of_dots, white)
        for viewer, solved, of_dots in zip(
            detailed.viewers, solution.channels, dots.channels, strict=True
        )
    )

    yield 1.0
    return Reference(
        dotted=dotted,
        solution=solution,
        dots=dots,
        source=source,
        is_shown=is_shown,
        channels=channels,
    )


def _traced(plan: Plan, solved: Channel, dots: Channel, white: Image) -> ReferenceChannel:
    """Reference of one viewer.

    white : (H, W, 3) source image of a white picture
    """
    viewer = plan.viewer
    points = np.random.default_rng(0).random((N_CHECKED, 2)) * (viewer.width, viewer.height)
    clock = perf_counter()
    landings = main_landings(trace_all(plan, *viewer.rays(points)), len(points))
    seconds = perf_counter() - clock
    arrived = np.where(landings.has_arrived[:, None], landings.xy, np.nan)

    return ReferenceChannel(
        plan=plan,
        points=points,
        landed=_on_display(arrived, plan.rig.display),
        seconds_a_ray=seconds / len(points),
        is_seen=solved.seen(white).max(axis=2) >= WHOLE,
        solved=solved,
        dots=dots,
    )


def times_finer(rig: Rig) -> int:
    """Refinement of the reference's display, each way."""
    return int(np.clip(MOST_FINE // max(rig.display.width, rig.display.height), 1, TIMES_FINER))


def _fine_sources(rig: Rig, settings: Settings) -> Generator[float, None, tuple[Image, Image]]:
    """Source images (H, W, 3) of the rig and of a white picture, from a display of finer pixels.

    A share is read at a few places. Finer pixels have more shares, and each is smaller.
    """
    k = times_finer(rig)
    display = replace(rig.display, width=k * rig.display.width, height=k * rig.display.height)
    fine = replace(rig.joined, displays=(display,))
    place = rig.picture_place
    white = showing(fine, np.ones((place.height, place.width, 4), np.float32))
    session = Session()

    here = replace(settings, tolerance=min(k * settings.tolerance, MOST_TOLERANCE))
    one = yield from subprogress(session.solve(fine, here), 0.0, 0.9)
    other = yield from subprogress(session.solve(white, here), 0.9, 1.0)
    weight = one.weight[..., None]

    def joined(values: Floats) -> Floats:
        width, height = rig.display.image_size
        return values.reshape(height, k, width, k, -1).sum(axis=(1, 3))

    total = joined(weight)
    sources = (
        joined(weight * solution.source) / np.where(total > 0, total, 1)
        for solution in (one, other)
    )

    return tuple(source.astype(np.float32) for source in sources)
