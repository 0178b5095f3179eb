"""A channel of a solve: one viewer at one wavelength, and all that was found of it.

Every number about a viewer's light (its view map, its shares, what of the picture it
sees, how far off that is) lives in its channel. The display is one for all of them.
"""

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.fingerprint import fingerprint
from ..base.messages import Message
from ..base.stages import MAP, spans
from ..base.steps import Steps, hold_progress, run_steps, subprogress
from ..image.ghosts import paths_of
from ..image.glare import Glare, StrayLight, looking_beside, trace_stray_light
from ..image.seen_image import ideal_image, seeing
from ..image.simulation import PlateView, plate_view
from ..light.compile_plan import compile_plan_steps
from ..light.mesh_cache import MeshCache
from ..light.plan import DeferredObjects, Plan
from ..light.rays import DeferredObjectError, Reason
from ..map.pieces import Piece
from ..map.sampling import Sampling, sample
from ..map.shares import Coverage, ShareBatches, Shares, add_at
from ..map.view_map import MapError, ViewMap
from ..rig.rig import Rig
from ..rig.settings import Settings
from ..rig.viewer import Viewer
from .accuracy import Accuracy, measure
from .memory import check_memory


@dataclass(frozen=True, eq=False)
class Measured:
    """Numbers about the light of one viewer.

    picture : key of the place of the picture, whose light the accuracy is in part about
    plate : brightness and blur by a plate's mirrors, None where it is ideal
    beside : a sample of light beside the glass; None where that carries the picture, too
    """

    picture: str
    accuracy: Accuracy
    plate: PlateView | None
    beside: StrayLight | None


def measuring(
    plan: Plan, view_map: ViewMap, lap: Callable[[str], None], elsewhere: Measured | None
) -> Generator[float, None, Measured]:
    """Measure a view map of a plan; yields progress 0..1.

    elsewhere : the same with the picture elsewhere, if that was measured
    lap : called with the name of the work just done
    """
    is_cut_off = bool((view_map.points.reason == Reason.CUT_OFF).any())
    picture = fingerprint(plan.rig.picture_place)
    accuracy = yield from measure(plan, is_cut_off, elsewhere and elsewhere.accuracy)
    lap("tessellation error")
    if elsewhere is not None:
        return replace(elsewhere, picture=picture, accuracy=accuracy)

    plate = yield from hold_progress(1.0, plate_view(plan))
    if plate is not None:
        lap("brightness and blur")

    beside = (
        (yield from hold_progress(1.0, trace_stray_light(plan)))
        if plan.settings.only_through_glass
        else None
    )
    lap("glare")
    return Measured(picture, accuracy, plate, beside)


WHITE = 1.0, 1.0, 1.0


class ChannelKey(NamedTuple):
    """What makes a channel: a viewer and a wavelength, m, with the weights of its light in red,
    green and blue of the painting.
    """

    viewer: Viewer
    wavelength: float
    colours: tuple[float, float, float]

    def of(self, settings: Settings) -> Settings:
        """Settings by which its light is traced."""
        return replace(settings, wavelength=self.wavelength)

    def weighed(self, values: Floats, colour: int) -> Floats:
        """Values as much as its light counts in a colour; the array itself at a weight of 1."""
        values, weight = self.viewer.weighed(values), self.colours[colour]
        return values if weight == 1 else weight * values


def channel_keys(rig: Rig, settings: Settings) -> tuple[ChannelKey, ...]:
    """The channels of a rig: all colours of a viewer go the way of one wavelength."""
    return tuple(ChannelKey(viewer, settings.wavelength, WHITE) for viewer in rig.viewers)


@dataclass(eq=False)
class Traced:
    """The part of a channel that does not depend on the picture.

    plan : the rig as it is traced for this viewer, at this wavelength
    weight_beside : (H, W) viewer px^2, sum of area * throughput^2 over the shares of
        light beside the glass, where it counts
    measured : None until a picture was painted of it; of the last place of the picture
    """

    plan: Plan
    view_map: ViewMap
    weight_beside: Floats | None
    measured: Measured | None = None


@dataclass(frozen=True, eq=False)
class Channel:
    """One viewer at one wavelength, as a solve found it.

    plan : the rig as it is traced for this viewer, at this wavelength
    plate : brightness and blur by a plate's mirrors, None where it is ideal
    glare : the light that comes beside the glass; None where that carries the picture, too
    shares : of all cells, some at a time
    shown : those of some shares that display pixels show
    coverage : sums over the shares, by display pixel
    view_coverage : (h, w) part of each viewer pixel that is connected to the display, 0..1
    picture_coverage : share of the picture, as the viewer sees it, that the display can show; light
        by way of gaps in the glass is painted and not counted
    misses : share of the picture as seen, by reason why it has
        no landing; with picture_coverage they make 1
    """

    plan: Plan
    view_map: ViewMap
    accuracy: Accuracy
    plate: PlateView | None
    glare: Glare | None
    shares: ShareBatches
    shown: Callable[[Shares], Shares]
    coverage: Coverage
    view_coverage: Floats
    picture_coverage: float
    misses: dict[str, float]

    @property
    def viewer(self) -> Viewer:
        """The one whose image all of this is about."""
        return self.plan.viewer

    @property
    def wavelength(self) -> float:
        """Of the light that is followed, m."""
        return self.plan.settings.wavelength

    @property
    def map_error(self) -> MapError:
        """By how much the view map may be off, as it tells itself."""
        return self.view_map.error

    @property
    def tessellation_error(self) -> float:
        """About how far landings are from those of the surface that was meant, rms display px."""
        return self.accuracy.tessellation.error

    def ideal(self) -> NDArray[np.float32]:
        """The picture as the viewer would see it with no glass in the way: (h, w, 3) linear."""
        return ideal_image(self.plan.rig.picture_of(self.viewer), self.viewer)

    def seen(self, source: NDArray[np.float32], beside: bool = False) -> NDArray[np.float32]:
        """The viewer's image, through the glass, of a source image (H, W, 3): (h, w, 3) linear.

        beside : and by way of the plate alone, beside the glass; that
            is traced when first asked for, see `trace_stray_light`
        """
        return run_steps(self.seeing(source, beside))

    def seeing(
        self, source: NDArray[np.float32], beside: bool = False
    ) -> Steps[NDArray[np.float32]]:
        """The same, with pauses: the first pass over large images takes seconds."""
        shown = self.plan.rig.display.light_of(source)
        seen = yield from seeing(self._seen_shares, shown)
        if not beside or self._seen_beside is None:
            return seen
        return seen + (yield from seeing(self._seen_beside, shown))

    @cached_property
    def _seen_shares(self) -> ShareBatches:
        """Shares each of which lies in one viewer pixel: those that paint may be larger."""
        return shares_of(
            self.view_map, self.shares.has_throughput, partial(self.view_map.pieces, at_pixels=True)
        )

    def trace_stray_light(self) -> Generator[float, None, None]:
        """Trace light beside the glass, unless it is known or is part of the map anyway.

        Yields progress 0..1.
        """
        settings = self.plan.settings
        if (
            settings.only_through_glass
            and not settings.looks_beside
            and "_map_beside" not in vars(self)
        ):
            check_memory(replace(self.plan.rig, viewers=(self.viewer,)), settings)
            vars(self)["_map_beside"] = yield from sample(looking_beside(self.plan))

    @cached_property
    def _map_beside(self) -> ViewMap:
        return (
            self.view_map
            if self.plan.settings.looks_beside
            else run_steps(sample(looking_beside(self.plan)))
        )

    @cached_property
    def _seen_beside(self) -> ShareBatches | None:
        """The shares of light beside the glass, each in one viewer
        pixel; None where it is part of the map anyway.
        """
        if not self.plan.settings.only_through_glass:
            return None
        pieces = partial(self._map_beside.pieces, at_pixels=True, beside=True)
        return shares_of(self._map_beside, self.shares.has_throughput, pieces)


def shares_of(
    view_map: ViewMap,
    has_throughput: bool,
    pieces: Callable[[], Iterator[Piece]],
    has_path: bool = False,
) -> ShareBatches:
    """The shares of pieces of a map, with their paths if asked for."""

    def cells() -> Iterator[tuple[NDArray | None, ...]]:
        for piece in pieces():
            yield piece.view, piece.display, piece.throughput, paths_of(piece) if has_path else None

    sizes = view_map.display_size, view_map.view_size
    return ShareBatches(*sizes, has_throughput, cells, has_path)


def weight_beside(view_map: ViewMap, settings: Settings) -> Steps[Floats | None]:
    """Sum (H, W) of area * throughput^2, viewer px^2, over the
    shares of light beside the glass, if asked for.
    """
    if not settings.looks_beside:
        return None

    width, height = view_map.display_size
    weight = np.zeros((height, width))

    batches = shares_of(view_map, settings.brightness, partial(view_map.pieces, beside=True))
    for shares in batches.pausing():
        if shares is not None:
            add_at(weight, shares.display_index, shares.weight)
        yield 0

    return weight


UNTRACED = Message("tracing (the optics have not changed)")

MOST_STARTS = 3  # the last of them with everything


def out_of_sight(rig: Rig, viewer: Viewer) -> tuple[int, ...]:
    """Glasses, by their number, that a viewer does not look at:
    light may come to them by way of the others only.
    """
    if len(rig.glasses) == 1:
        return ()

    aside = []
    for number, glass in enumerate(rig.glasses):
        low, high = glass.mesh.bounds
        corners = np.array(
            [
                [x, y, z]
                for x in (low[0], high[0])
                for y in (low[1], high[1])
                for z in (low[2], high[2])
            ]
        )

        xy = viewer.project(corners)
        is_before = np.isfinite(xy).all(axis=1)
        if not is_before.any():
            aside.append(number)
        elif is_before.all():
            left, top = xy.min(axis=0)
            right, bottom = xy.max(axis=0)
            if right < 0 or bottom < 0 or left > viewer.width or top > viewer.height:
                aside.append(number)

    return tuple(aside) if len(aside) < len(rig.glasses) else ()


def sample_reached(
    rig: Rig,
    viewer: Viewer,
    settings: Settings,
    kept: MeshCache,
    lap: Callable[[str], None],
    is_coarse: bool = False,
) -> Generator[float, None, tuple[Plan, ViewMap]]:
    """Plan and view map of a viewer, without the glass that none of its light
    comes near; yields progress 0..1.

    If a ray or a bundle of rays comes near such a glass after all, it begins again with that glass.

    Parameters
    ----------
    lap : called with the name of the work just done
    is_coarse : for a first picture, as Sampling has it

    Raises
    ------
    RigError, MeshError : as by compile_plan
    """
    aside = out_of_sight(rig, viewer)
    _, of_map = spans(("plan",), MAP)
    told = 0.0

    for start in range(MOST_STARTS):
        plan = yield from hold_progress(
            told, compile_plan_steps(rig, settings, kept, aside if start < MOST_STARTS - 1 else ())
        )
        plan = plan.seen_by(viewer)
        lap("plan")

        # rays that check a map tell, too, whether light comes near to what stands aside
        sampling = Sampling(plan, is_coarse, is_checked=bool(plan.aside.glasses))
        steps = subprogress(sampling.sample(), *of_map)

        try:
            while True:
                # a solve that begins again has come no further
                told = max(told, next(steps))
                yield told
        except StopIteration as end:
            return replace(plan, aside=DeferredObjects.none()), end.value
        except DeferredObjectError as found:
            aside = tuple(
                number for k, number in enumerate(plan.aside.glasses) if k not in found.boxes
            )
            lap("tracing")

    raise AssertionError("with everything in the plan nothing else can be reached")
