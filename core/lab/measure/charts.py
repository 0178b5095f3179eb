"""Pictures that show errors: rings of fine detail, and a lattice of dots."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...bench.placement import lattice
from ...image.picture import of_square, picture_from_view
from ...rig.rig import PicturePlace, Rig
from ...rig.viewer import Viewer

Image = NDArray[np.float32]  # (h, w, c) linear, row 0 at the top

FINEST = 10.0  # px: the zone plate's shortest period, at the middle of its edges
# px, of the zone plate
LEAST_SIDE = 16
MOST_SIDE = 4096
PROBES = 256  # rays along each side of the viewer's image that look for the picture
HALF_COVER = 0.5  # share of a place that the picture has to cover for its scale to be read there


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
    seen = points.footprint[points.cover > HALF_COVER]
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
