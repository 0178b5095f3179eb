"""The result of a solve."""

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats
from ..image.ghosts import paths_of
from ..image.glare import Glare, looking_beside
from ..image.ideal_image import ideal_image
from ..image.seen_image import seen_image
from ..image.simulation import PlateView
from ..light.plan import Plan
from ..map.sampling import sample
from ..map.share_batches import ShareBatches
from ..map.view_map import MapError, Piece, ViewMap
from ..rig import ConstantIndex, Rig
from ..steps import finish
from .memory import check_memory
from .remarks import Remark


@dataclass(frozen=True, eq=False)
class Solution:
    """The source image, and the fate of the viewer's rays.

    source : (H, W, 3) float32 linear, row 0 at the top
    shares : of all cells, some at a time
    weight : (H, W) viewer px^2, sum of area * throughput^2 over
        the shares of each display pixel that it shows
    display_coverage, view_coverage : (H, W), (h, w), 0..1
    picture_coverage : share of the picture, as the viewer sees it, that the display can show
    misses : share of the picture as seen, by reason why it has
        no landing; with picture_coverage they make 1
    seconds : time by part of the work; n_rays : rays traced for this solve
    tessellation_error : about how far landings are from those of
        the surface that was meant, rms display px
    plate : brightness and blur by a plate's mirrors, None where it is ideal
    glare : the light that comes beside the glass; None where that carries the picture, too
    used, left_out : what this rig needed and what it did not; remarks : sentences for the user
    """

    rig: Rig
    source: NDArray[np.float32]
    shares: ShareBatches
    weight: Floats
    view_map: ViewMap
    display_coverage: Floats
    view_coverage: Floats
    picture_coverage: float
    misses: dict[str, float]
    seconds: dict[str, float]
    n_rays: int
    tessellation_error: float
    plate: PlateView | None
    glare: Glare | None
    plan: Plan
    used: tuple[str, ...]
    left_out: tuple[str, ...]
    remarks: tuple[Remark, ...]

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user, one or two sentences each."""
        return tuple(remark.told() for remark in self.remarks)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Those of the notes that tell of light that is lost or goes another way."""
        return tuple(remark.told() for remark in self.remarks if remark.is_warning)

    @property
    def map_error(self) -> MapError:
        return self.view_map.error

    def ideal(self) -> NDArray[np.float32]:
        """The picture as the viewer would see it with no glass in the way: (h, w, 3) linear."""
        return ideal_image(self.rig.picture, self.rig.viewer)

    def seen(
        self, source: NDArray[np.float32] | None = None, beside: bool = False
    ) -> NDArray[np.float32]:
        """The viewer's image, through the glass, of the source
        image or of another one: (h, w, 3) linear.

        beside : and by way of the plate alone, beside the glass; that
            is traced when first asked for, see `look_beside`
        """
        source = self.source if source is None else source
        seen = seen_image(self._seen_shares, source)
        if not beside or self._seen_beside is None:
            return seen
        return seen + seen_image(self._seen_beside, source)

    @cached_property
    def _seen_shares(self) -> ShareBatches:
        """Shares each of which lies in one viewer pixel: those that paint may be larger."""
        return shares_of(
            self.view_map, self.shares.has_throughput, partial(self.view_map.pieces, at_pixels=True)
        )

    def look_beside(self) -> Generator[float, None, None]:
        """Trace light beside the glass, unless it is known or is part of the map anyway.

        Yields progress 0..1.
        """
        settings = self.plan.settings
        if (
            settings.only_through_glass
            and not settings.looks_beside
            and "_map_beside" not in vars(self)
        ):
            check_memory(self.rig, settings)
            vars(self)["_map_beside"] = yield from sample(looking_beside(self.plan))

    @cached_property
    def _map_beside(self) -> ViewMap:
        return (
            self.view_map
            if self.plan.settings.looks_beside
            else finish(sample(looking_beside(self.plan)))
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


def without_glass(rig: Rig) -> Rig:
    """The same rig with glass that does not refract: it paints the plain, uncompensated picture."""
    return replace(
        rig, glasses=tuple(replace(glass, ior=ConstantIndex(1.0)) for glass in rig.glasses)
    )


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

    return ShareBatches(view_map.display_size, view_map.view_size, has_throughput, cells, has_path)
