"""Before and after: the viewer's image with the plain picture and with the source image."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..base.fingerprint import fingerprint
from ..base.steps import subprogress
from ..image.seen_image import ideal_image
from ..map.view_map import ViewMap
from ..rig.rig import Picture, Rig, Viewer
from ..rig.settings import Settings
from .channel import ChannelMaps
from .session import Session
from .solution import Solution, without_glass

Image = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Comparison:
    """Viewer's images (h, w, 3), linear, row 0 at the top.

    before : through the glass, with the plain picture on the display (right for a rig whose glass
        does not refract)
    after : through the glass, with the source image on the display
    ideal : the picture without any glass
    source_image : (H, W, 3) in display pixels
    source : the source image scaled to the viewer's image, made on first use
    """

    before: Image
    after: Image
    ideal: Image
    source_image: Image
    viewer: Viewer

    @cached_property
    def source(self) -> Image:
        return fitted(self.source_image, self.viewer)


class Artist(Protocol):
    """Draws images with the graphics card, rows and units as in painting: map_drawing.py."""

    def can_draw(self, rig: Rig, settings: Settings) -> bool: ...

    def source_image(self, rig: Rig, settings: Settings, maps: ChannelMaps) -> Image: ...

    def seen_image(self, view_map: ViewMap, light: Image, settings: Settings) -> Image: ...

    def ideal_image(self, picture: Picture, viewer: Viewer) -> Image | None: ...


class Comparer:
    """Compares results; caches the plain picture and the ideal image while only the glass
    changes.
    """

    def __init__(self) -> None:
        self._session = Session()
        self._key = ""
        self._plain: Image | None = None
        self._ideal: Image | None = None

    def compare(
        self, solution: Solution, rig: Rig, settings: Settings, artist: Artist | None = None
    ) -> Generator[float, None, Comparison]:
        """Compare a solution with the uncompensated picture; yields progress 0..1.

        artist : draws the images instead of painting them, if it can

        Raises
        ------
        RigError : the rig shows nothing even without its glass
        """
        bare = without_glass(rig)
        how = replace(settings, only_through_glass=False, suppress_glare=0.0, sharpen=False)
        key = fingerprint(bare, how, artist is None)
        if key != self._key:
            plain = yield from subprogress(self._plain_source(bare, how, artist), 0.0, 0.7)
            first = solution.first
            ideal = artist and artist.ideal_image(rig.picture_of(first.viewer), first.viewer)
            if ideal is None:
                ideal = solution.ideal()
            self._key, self._plain, self._ideal = key, plain, ideal

        yield 0.7
        sources = self._plain, solution.source
        before, after = yield from subprogress(_seen(solution, sources, artist), 0.7, 1.0)
        return Comparison(before, after, self._ideal, solution.source, solution.first.viewer)

    def _plain_source(
        self, bare: Rig, settings: Settings, artist: Artist | None
    ) -> Generator[float, None, Image]:
        """The source image of a rig without glass; yields progress 0..1."""
        if artist is None or not artist.can_draw(bare, settings):
            return (yield from self._session.solve(bare, settings)).source
        maps = yield from self._session.view_maps(bare, settings)
        return artist.source_image(bare, settings, maps)


def _seen(
    solution: Solution, sources: Sequence[Image], artist: Artist | None
) -> Generator[float, None, Sequence[Image]]:
    """The first viewer's images of source images, through its pupil if it has one; yields progress
    0..1.
    """
    if artist is None:
        seen = yield from solution.seeing_with_pupil(np.concatenate(sources, axis=2))
        return np.split(seen, len(sources), axis=2)
    first, light_of = solution.first, solution.rig.display.light_of
    settings = first.plan.settings
    return [artist.seen_image(first.view_map, light_of(one), settings) for one in sources]


def fitted(source: Image, viewer: Viewer) -> Image:
    """A source image (H, W, 3) scaled to fit the viewer's image (h, w, 3), on black."""
    height, width = source.shape[:2]
    scale = min(viewer.width / width, viewer.height / height)
    w, h = max(1, round(scale * width)), max(1, round(scale * height))
    opaque = np.dstack([source, np.ones((height, width), np.float32)])
    small = ideal_image(Picture("source", opaque), replace(viewer, width=w, height=h))
    left, top = (viewer.width - w) // 2, (viewer.height - h) // 2

    image = np.zeros((viewer.height, viewer.width, 3), np.float32)
    image[top : top + h, left : left + w] = small
    return image


def side_by_side(left: Image, right: Image, gap: int) -> Image:
    """Two images (h, w, 3) of one size side by side, `gap` white pixels apart."""
    white = np.ones((left.shape[0], gap, 3), np.float32)
    return np.concatenate([left, white, right], axis=1)
