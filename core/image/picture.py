"""The picture in its place: its pixels behind points of the viewer's image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, in_blocks
from ..base.messages import Message
from ..glass.meshes import interpolate
from ..light.hits import Hits
from ..light.layer_hits import first_hits
from ..light.ray_engine import Layer
from ..rig.rig import PicturePlace, Viewer
from .flat_picture import LEAST, FlatMapping, flat_mapping, outline_in_view

POINTS_AT_ONCE = 1 << 16  # so their arrays stay in the cache
MESH_STEP_PX = 1e-3  # viewer px, step of finite differences on a mesh
EDGE_ON = 1e-3  # width relative to length below which a picture is edge-on
BY_MIRROR = Message(" (if it is seen in a mirror, set Picture to Image)")
# viewer px, side of pixel blocks; the picture covers most of them fully or not at all
BLOCK_PX = 16
UPRIGHT = 1e-3  # of the variance along y: less along x is treated as 0, as rounding may be as large


@dataclass(frozen=True, eq=False)
class PicturePoints:
    """Footprints of points of the viewer's image on the picture.

    xy : (n, 2) picture pixels, x right and y down from the top left corner: the centre of the
        footprint's part on the picture
    cover : (n,) 0..1, fraction of the footprint on the picture
    axes : (4, n) picture px, x and y of two sides of the footprint, each the standard deviation
        along it; a parallelogram with these sides has the footprint's covariance
    """

    xy: Floats
    cover: Floats
    axes: Floats

    @property
    def covariance(self) -> Floats:
        """Covariance (3, n) of the footprint, picture px^2: xx, xy and yy."""
        first_x, first_y, second_x, second_y = self.axes
        return np.stack([
            first_x * first_x + second_x * second_x,
            first_x * first_y + second_x * second_y,
            first_y * first_y + second_y * second_y,
        ])  # fmt: skip

    @property
    def footprint(self) -> Floats:
        """Side (n,) in picture pixels of a square of the footprint's area."""
        first_x, first_y, second_x, second_y = self.axes
        return np.sqrt(12 * np.abs(first_x * second_y - first_y * second_x))


def of_square(side: float) -> Floats:
    """Covariance (3, 1) of the points of a square."""
    return np.array([[1.0], [0.0], [1.0]]) * side * side / 12


POINT = of_square(0.0)


def picture_from_view(
    place: PicturePlace, viewer: Viewer, view_xy: Floats, covariance: NDArray = POINT
) -> PicturePoints:
    """Follow straight lines from the viewer to the picture, without glass.

    Parameters
    ----------
    view_xy : (n, 2) viewer pixels, centres of footprints
    covariance : (3, n) or (3, 1) xx, xy and yy of the footprints on the viewer's image, viewer px^2
    """
    n = len(view_xy)
    covariance = np.broadcast_to(covariance, (3, n))
    mapping = flat_mapping(place, viewer)
    if mapping is None:
        return _by_tracing(place, viewer, view_xy, covariance)

    size = np.array([place.width, place.height], float)
    points = PicturePoints(np.empty((n, 2)), np.empty(n), np.empty((4, n)))
    for first in range(0, n, POINTS_AT_ONCE):
        some = slice(first, first + POINTS_AT_ONCE)
        _set_flat(points, some, view_xy[some], covariance[:, some], size, mapping)
    return points


def cover_in_view(place: PicturePlace, viewer: Viewer) -> Floats:
    """Fraction (h, w) of each viewer pixel covered by the picture, without glass, 0..1.

    It is 0 outside a flat picture, even near the horizon of its plane, where a single pixel is
    ambiguous.
    """
    w, h = viewer.width, viewer.height
    if place.mesh is None:
        return np.ones((h, w)) if place.mask is None else place.mask

    cover = np.zeros((h, w))
    near = np.arange(h * w)
    lines = outline_in_view(place, viewer)
    if lines is not None:
        cover = _cover_of_blocks(lines, w, h)
        near = np.flatnonzero(np.isnan(cover))

    for first in range(0, len(near), POINTS_AT_ONCE):
        some = near[first : first + POINTS_AT_ONCE]
        middles = np.stack([some % w, some // w], axis=1) + 0.5
        cover.flat[some] = picture_from_view(place, viewer, middles, of_square(1.0)).cover
    return cover


def _cover_of_blocks(lines: Floats, width: int, height: int) -> Floats:
    """Cover (h, w) of viewer pixels in blocks fully inside lines (4, 3) or fully outside one; NaN
    in other blocks.

    A flat picture is convex, so fully inside or outside is exact.
    """
    x, y = (np.arange(0.5, -(-n // BLOCK_PX)) * BLOCK_PX for n in (width, height))
    reach = BLOCK_PX / 2**0.5 + 2
    away = (
        lines[:, 0, None, None] * x + lines[:, 1, None, None] * y[:, None] + lines[:, 2, None, None]
    )
    is_within = (away > reach).all(axis=0)
    is_beyond = (away < -reach).any(axis=0)
    of_block = np.where(is_within, 1.0, np.where(is_beyond, 0.0, np.nan))
    return np.ascontiguousarray(in_blocks(of_block, BLOCK_PX)[:height, :width])


def why_unseen(place: PicturePlace, viewer: Viewer) -> str:
    """Why an unobstructed picture on a plane is not seen, and the remedy: two clauses."""
    corners = place.mesh.corners.reshape(-1, 3)
    if ((corners - viewer.position) @ viewer.axes[2] <= 0).all():
        return Message("which is behind the viewer: turn the viewer to it{hint}", hint=BY_MIRROR)

    outside = Message(
        "which is outside its view: move it into the camera's frame{hint}", hint=BY_MIRROR
    )
    seen = viewer.project(corners)
    seen = seen[np.isfinite(seen).all(axis=1)]
    low = seen.min(axis=0)
    high = seen.max(axis=0)
    if (high <= 0).any() or (low >= (viewer.width, viewer.height)).any():
        return outside

    _, across = np.linalg.svd(seen - seen.mean(axis=0), compute_uv=False)
    if across < EDGE_ON * np.linalg.norm(high - low):
        return Message("which is seen edge-on: turn it towards the viewer")
    if (high - low).max() < 1:
        return Message(
            "which is smaller than a viewer pixel: make it larger, or raise the viewer's resolution"
        )
    return outside


def _set_flat(
    points: PicturePoints,
    some: slice,
    view_xy: Floats,
    covariance: Floats,
    size: Floats,
    mapping: FlatMapping,
) -> None:
    """Set some points of a flat picture of a size (2,), px.

    Computed by columns, because numpy is slow on rows of two.
    """
    x, y = view_xy.T
    u, v, w = (a * x + b * y + c for a, b, c in mapping.matrix)
    is_seen = w > 0
    inverse = 1.0 / np.where(is_seen, w, 1.0)
    u *= inverse
    v *= inverse

    # derivatives of the picture's pixels; v points up, pixel rows down
    width, height = size
    (ux, uy, _), (vx, vy, _), (wx, wy, _) = mapping.matrix
    x_scale = width * inverse
    y_scale = -height * inverse
    by_x = (ux - u * wx) * x_scale, (vx - v * wx) * y_scale
    by_y = (uy - u * wy) * x_scale, (vy - v * wy) * y_scale
    axes = _axes(covariance, by_x, by_y)

    low_u, low_v = mapping.low
    high_u, high_v = mapping.high
    x, across = _within(u * width, low_u * width, high_u * width, axes[0] ** 2 + axes[2] ** 2)
    low, high = (1 - high_v) * height, (1 - low_v) * height
    y, along = _within((1 - v) * height, low, high, axes[1] ** 2 + axes[3] ** 2)
    points.xy[some, 0] = x
    points.xy[some, 1] = y
    points.cover[some] = across * along * is_seen
    points.axes[:, some] = axes


def _axes(
    covariance: Floats, by_x: tuple[Floats, Floats], by_y: tuple[Floats, Floats]
) -> NDArray[np.float64]:
    """Sides (4, n) of footprints on the picture, from their covariance (3, n) on the viewer's image
    and the derivatives (2, n) of picture pixels by viewer pixels.

    Map cells are aligned with the viewer's image, so the triangular root of the covariance gives
    the sides of full quads, however the picture is rotated.
    """
    xx, xy, yy = np.asarray(covariance, float)
    is_upright = xx < UPRIGHT * yy  # the root starts with y
    near, far = np.where(is_upright, yy, xx), np.where(is_upright, xx, yy)
    reach = np.sqrt(np.maximum(near, 0))
    most = np.sqrt(np.maximum(far, 0))
    # clipped to remove rounding errors
    along = np.clip(xy / np.maximum(reach, LEAST), -most, most)
    across = np.sqrt(np.maximum(far - along * along, 0))

    by_first, by_other = (
        [np.where(is_upright, b, a) for a, b in zip(*order, strict=True)]
        for order in ((by_x, by_y), (by_y, by_x))
    )
    return np.stack([
        *(reach * a + along * b for a, b in zip(by_first, by_other, strict=True)),
        *(across * b for b in by_other),
    ])  # fmt: skip


def _within(x: Floats, low: float, high: float, variance: Floats) -> tuple[Floats, Floats]:
    """Fraction (n,) of box-shaped footprints between two lines across x, and its centre."""
    half = np.sqrt(3 * np.maximum(variance, 0))
    before = np.maximum(low - (x - half), 0)
    after = np.maximum(x + half - high, 0)
    share = np.clip(1 - (before + after) / np.maximum(2 * half, LEAST), 0, 1)
    return np.where(share > 0, x + 0.5 * (before - after), x), share


def _by_tracing(
    place: PicturePlace, viewer: Viewer, view_xy: Floats, covariance: Floats
) -> PicturePoints:
    """Points on a picture of any mesh, by tracing; the outline is not antialiased."""
    layer = Layer(place.mesh.corners)
    size = np.array([place.width, place.height], float)
    origins, directions = viewer.rays(view_xy)

    def accept(i: np.ndarray, hits: Hits) -> tuple[Bools, Bools]:
        return hits.distance > 0, np.zeros(len(i), bool)

    hits = first_hits(layer, origins, directions, np.zeros(len(origins), bool), accept)
    is_seen = hits.triangle >= 0
    seen = np.flatnonzero(is_seen)
    k = hits.triangle[is_seen]

    def xy_at(view_xy: Floats) -> Floats:
        """Picture pixels on the plane of the triangle hit."""
        o, d = viewer.rays(view_xy)
        t = layer.frames.distance(k, o, d)
        at = layer.frames.barycentric(k, o + t[:, None] * d)
        uv = interpolate(place.mesh.uv[k], *at)
        return np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1) * size

    xy = np.zeros((len(view_xy), 2))
    xy[seen] = xy_at(view_xy[seen])

    axes = np.zeros((4, len(view_xy)))
    by_x, by_y = (
        ((xy_at(view_xy[seen] + MESH_STEP_PX * d) - xy[seen]) / MESH_STEP_PX).T for d in np.eye(2)
    )
    axes[:, seen] = _axes(covariance[:, seen], by_x, by_y)
    return PicturePoints(xy, is_seen.astype(float), axes)
