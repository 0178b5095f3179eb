"""A channel of a solve: one viewer at one wavelength, with its view map, shares and accuracy.

Several channels share one display.
"""

from collections.abc import Callable, Generator, Iterator, Sequence
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
from ..image.glare import Glare, Split, StrayLight, trace_stray_light, with_stray_light
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
from ..rig.settings import WHITE, Settings
from ..rig.viewer import Viewer
from .accuracy import Accuracy, measure
from .memory import check_memory


@dataclass(frozen=True, eq=False)
class Measured:
    """Measurements of one viewer's light.

    picture : key of the picture's place; accuracy depends on it in part
    plate : brightness and blur of a plate's mirrors; None for an ideal plate
    stray : sample of all light; None if all of it carries the picture
    """

    picture: str
    accuracy: Accuracy
    plate: PlateView | None
    stray: StrayLight | None


def measuring(
    plan: Plan, view_map: ViewMap, lap: Callable[[str], None], elsewhere: Measured | None
) -> Generator[float, None, Measured]:
    """Measure a view map of a plan; yields progress 0..1.

    elsewhere : measurements with the picture elsewhere, if any
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

    stray = (
        (yield from hold_progress(1.0, trace_stray_light(plan)))
        if plan.settings.only_through_glass or plan.n_copies
        else None
    )
    lap("glare")
    return Measured(picture, accuracy, plate, stray)


COLOURS = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


class ChannelKey(NamedTuple):
    """Identity of a channel: viewer, wavelength (m), and its weights in the painted red, green,
    blue.
    """

    viewer: Viewer
    wavelength: float
    colours: tuple[float, float, float]

    def of(self, settings: Settings) -> Settings:
        """Settings with the channel's light."""
        return replace(settings, wavelength=self.wavelength, colours=self.colours)

    def weighed(self, values: Floats, colour: int) -> Floats:
        """Values times the channel's weight in a colour; the array itself at a weight of 1."""
        values, weight = self.viewer.weighed(values), self.colours[colour]
        return values if weight == 1 else weight * values


ChannelMaps = Sequence[tuple[ChannelKey, ViewMap]]


def channel_keys(rig: Rig, settings: Settings) -> tuple[ChannelKey, ...]:
    """Channels of a rig: for each viewer one that represents all colours, or one for each of red,
    green and blue if the glass disperses their light, or absorbs them differently.
    """
    of_viewer = ((settings.wavelength, WHITE),)
    if rig.disperses or (settings.brightness and rig.is_tinted):
        waves = rig.display.primaries if rig.disperses else (settings.wavelength,) * 3
        of_viewer = tuple(zip(waves, COLOURS, strict=True))
    return tuple(ChannelKey(viewer, *one) for viewer in rig.viewers for one in of_viewer)


@dataclass(eq=False)
class Traced:
    """The part of a channel that does not depend on the picture.

    plan : the rig as traced for this viewer and wavelength
    weight_past_glass : (H, W) viewer px^2, sum of area * throughput^2 over shares of light past the
        glass; None unless glare is suppressed
    measured : for the picture's last place; None before the first picture is painted
    """

    plan: Plan
    view_map: ViewMap
    weight_past_glass: Floats | None
    measured: Measured | None = None


@dataclass(frozen=True, eq=False)
class Channel:
    """One viewer at one wavelength, solved.

    plan : the rig as traced for this viewer and wavelength
    plate : brightness and blur of a plate's mirrors; None for an ideal plate
    glare : light past the glass; None if it carries the picture too
    split : brightness and stray light, if parts split light
    shares : of all cells, in batches
    shown : selects the shares that display pixels show
    coverage : sums over the shares, by display pixel
    view_coverage : (h, w) fraction of each viewer pixel connected to the display, 0..1
    picture_coverage : fraction of the picture, as seen, that the display can show; light through
        gaps in the glass is painted but not counted
    misses : fraction of the picture as seen, by the reason why it has no landing; sums to 1 with
        picture_coverage
    colours : channels of the viewer's red, green and blue, if it has several; this one is the green
        one, whose map and figures represent all
    """

    plan: Plan
    view_map: ViewMap
    accuracy: Accuracy
    plate: PlateView | None
    glare: Glare | None
    split: Split | None
    shares: ShareBatches
    shown: Callable[[Shares], Shares]
    coverage: Coverage
    view_coverage: Floats
    picture_coverage: float
    misses: dict[str, float]
    colours: tuple["Channel", ...] = ()

    @classmethod
    def joined(cls, channels: Sequence["Channel"]) -> tuple["Channel", ...]:
        """One channel for each viewer, in order, from those of its colours."""
        n = len(channels) // len(channels[0].plan.rig.viewers)
        if n == 1:
            return tuple(channels)
        own = (tuple(channels[k : k + n]) for k in range(0, len(channels), n))
        return tuple(replace(one[n // 2], colours=one) for one in own)

    @property
    def viewer(self) -> Viewer:
        """The channel's viewer."""
        return self.plan.viewer

    @property
    def wavelength(self) -> float:
        """Wavelength of the traced light, m."""
        return self.plan.settings.wavelength

    @property
    def map_error(self) -> MapError:
        """Measured error of the view map."""
        return self.view_map.error

    @property
    def tessellation_error(self) -> float:
        """Rms distance, display px, from the landings of the intended smooth surface,
        approximate.
        """
        return self.accuracy.tessellation.error

    def ideal(self) -> NDArray[np.float32]:
        """The picture as seen without any glass: (h, w, 3) linear."""
        return ideal_image(self.plan.rig.picture_of(self.viewer), self.viewer)

    def seen(self, source: NDArray[np.float32], past_glass: bool = False) -> NDArray[np.float32]:
        """A source image (H, W, 3) as the viewer sees it through the glass: (h, w, 3) linear.

        past_glass : add light that passes the glass by way of the plate; it is traced on first use,
            see `trace_stray_light`
        """
        return run_steps(self.seeing(source, past_glass))

    def seeing(
        self, source: NDArray[np.float32], past_glass: bool = False
    ) -> Steps[NDArray[np.float32]]:
        """`seen` in steps, since the first pass over a large image takes seconds."""
        if self.colours:
            n = len(self.colours)
            seen = np.empty((self.viewer.height, self.viewer.width, source.shape[2]), np.float32)
            for k, one in enumerate(self.colours):
                seen[..., k::n] = yield from one.seeing(source[..., k::n], past_glass)
            return seen

        shown = self.plan.rig.display.light_of(source)
        seen = yield from seeing(self._seen_shares, shown)
        if not past_glass or self._seen_past_glass is None:
            return seen
        return seen + (yield from seeing(self._seen_past_glass, shown))

    @cached_property
    def _seen_shares(self) -> ShareBatches:
        """Shares that lie in one viewer pixel each; the painted ones may be larger."""
        return shares_of(
            self.view_map, self.shares.has_throughput, partial(self.view_map.pieces, at_pixels=True)
        )

    def trace_stray_light(self) -> Generator[float, None, None]:
        """Trace light past the glass, unless it is cached or part of the map; yields progress
        0..1.
        """
        settings = self.plan.settings
        for k, one in enumerate(self.colours):
            steps = one.trace_stray_light()
            yield from subprogress(steps, k / len(self.colours), (k + 1) / len(self.colours))
        if (
            not self.colours
            and settings.only_through_glass
            and not settings.looks_past_glass
            and "_map_past_glass" not in vars(self)
        ):
            check_memory(replace(self.plan.rig, viewers=(self.viewer,)), settings)
            vars(self)["_map_past_glass"] = yield from sample(with_stray_light(self.plan))

    @cached_property
    def _map_past_glass(self) -> ViewMap:
        return (
            self.view_map
            if self.plan.settings.looks_past_glass
            else run_steps(sample(with_stray_light(self.plan)))
        )

    @cached_property
    def _seen_past_glass(self) -> ShareBatches | None:
        """Shares of light past the glass, one viewer pixel each; None if they are part of the
        map.
        """
        if not self.plan.settings.only_through_glass:
            return None
        pieces = partial(self._map_past_glass.pieces, at_pixels=True, past_glass=True)
        return shares_of(self._map_past_glass, self.shares.has_throughput, pieces)


def shares_of(
    view_map: ViewMap,
    has_throughput: bool,
    pieces: Callable[[], Iterator[Piece]],
    has_path: bool = False,
) -> ShareBatches:
    """Shares of a map's pieces, with their light paths if requested."""

    def cells() -> Iterator[tuple[NDArray | None, ...]]:
        for piece in pieces():
            path = paths_of(piece) if has_path else None
            yield piece.view, piece.display, piece.throughput, path, piece.beam

    sizes = view_map.display_size, view_map.view_size
    return ShareBatches(*sizes, has_throughput, cells, has_path, view_map.views)


def weight_past_glass(view_map: ViewMap, settings: Settings) -> Steps[Floats | None]:
    """Sum (H, W) of area * throughput^2, viewer px^2, over light past the glass; None if not
    needed.
    """
    if not settings.looks_past_glass:
        return None

    batches = shares_of(view_map, settings.brightness, partial(view_map.pieces, past_glass=True))
    width, height = batches.display_size
    weight = np.zeros((height, width))

    for shares in batches.pausing():
        if shares is not None:
            add_at(weight, shares.display_index, shares.weight)
        yield 0

    return weight


UNTRACED = Message("tracing (the optics are unchanged)")
NOT_KEPT = Message("a faster next picture (too little memory)")

MOST_STARTS = 3  # the last one includes all glasses


def out_of_sight(rig: Rig, viewer: Viewer) -> tuple[int, ...]:
    """Numbers of the glasses outside a viewer's frame: light reaches them by other parts only."""
    if len(rig.glasses) < 2:
        return ()

    deferred = []
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
            deferred.append(number)
        elif is_before.all():
            left, top = xy.min(axis=0)
            right, bottom = xy.max(axis=0)
            if right < 0 or bottom < 0 or left > viewer.width or top > viewer.height:
                deferred.append(number)

    return tuple(deferred) if len(deferred) < len(rig.glasses) else ()


def sample_reached(
    rig: Rig,
    viewer: Viewer,
    settings: Settings,
    cache: MeshCache,
    lap: Callable[[str], None],
    is_coarse: bool = False,
) -> Generator[float, None, tuple[Plan, ViewMap]]:
    """Plan and view map of a viewer, without glass that its light never reaches; yields 0..1.

    Tracing restarts with a deferred glass as soon as a ray or a bundle of rays comes near it.

    Parameters
    ----------
    lap : called with the name of the work just done
    is_coarse : for a first picture, see `Sampling`

    Raises
    ------
    RigError, MeshError : from compile_plan
    """
    deferred = out_of_sight(rig, viewer)
    _, of_map = spans(("plan",), MAP)
    progress = 0.0

    for start in range(MOST_STARTS):
        plan = yield from hold_progress(
            progress,
            compile_plan_steps(rig, settings, cache, deferred if start < MOST_STARTS - 1 else ()),
        )
        plan = plan.seen_by(viewer)
        lap("plan")

        # Rays that check the map also find out whether light comes near a deferred glass.
        sampling = Sampling(plan, is_coarse, is_checked=bool(plan.deferred.glasses))
        steps = subprogress(sampling.sample(), *of_map)

        try:
            while True:
                # Progress never falls back, even after a restart.
                progress = max(progress, next(steps))
                yield progress
        except StopIteration as end:
            return replace(plan, deferred=DeferredObjects.none()), end.value
        except DeferredObjectError as found:
            deferred = tuple(
                number for k, number in enumerate(plan.deferred.glasses) if k not in found.boxes
            )
            lap("tracing")

    raise AssertionError("with everything in the plan nothing else can be reached")
