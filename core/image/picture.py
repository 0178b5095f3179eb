"""The picture's place: picture_from_view, and the
picture's colours at points of the viewer's image.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Floats
from ..errors import RigError
from ..glass.meshes import interpolate
from ..light.display import uv_area
from ..light.hits import Hits
from ..light.ray_engine import Layer
from ..messages import Message
from ..products import turn_covariance
from ..rig import Mesh, PicturePlace, Viewer

CHUNK = 1 << 16  # points at once: their arrays stay in the cache
STEP = 1e-3  # viewer px over which a mesh's map is differentiated
EDGE_ON = 1e-3  # of its length: a picture seen so thin is nothing to be seen
BY_MIRROR = " (where it is seen by way of a mirror, set Picture to Image)"
# viewer px, sides of blocks of pixels: most are covered by the picture wholly, or not at all
BLOCK = 16
# of a picture's size: how well one affine map has to give its UV for the short way
IS_AFFINE = 1e-6

LEAST = 1e-100  # picture px: a footprint that is narrower is a point


@dataclass(frozen=True, eq=False)
class PicturePoints:
    """Where points of the viewer's image lie on the picture.

    xy : (n, 2) picture pixels, x right and y down from the top left
        corner: the middle of what of a footprint lies on the picture
    cover : (n,) 0..1, how much of the footprint lies on the picture
    covariance : (3, n) picture px^2, xx, xy and yy of the footprint
    """

    xy: Floats
    cover: Floats
    covariance: Floats

    @property
    def footprint(self) -> Floats:
        """Side (n,) in picture pixels of a square as large as the footprint."""
        xx, xy, yy = self.covariance
        return np.sqrt(12 * np.sqrt(np.maximum(xx * yy - xy * xy, 0)))


def of_square(side: float) -> Floats:
    """Covariance (3, 1) of the points of a square."""
    return np.array([[1.0], [0.0], [1.0]]) * side * side / 12


POINT = of_square(0.0)

# matrix (3, 3) to UV, w > 0 in front of the viewer; bounds in UV
FlatWay = tuple[Floats, tuple[Floats, Floats]]


def picture_from_view(
    place: PicturePlace, viewer: Viewer, view_xy: Floats, covariance: NDArray = POINT
) -> PicturePoints:
    """Follow straight lines from the viewer to the picture, as if there were no glass.

    Parameters
    ----------
    view_xy : (n, 2) viewer pixels, middles of footprints
    covariance : (3, n) or (3, 1) xx, xy and yy of the footprints on the viewer's image, viewer px^2
    """
    size = np.array([place.width, place.height], float)
    n = len(view_xy)
    covariance = np.broadcast_to(covariance, (3, n))
    short_way = flat_way(place, viewer)
    if short_way is None:
        return _by_tracing(place, viewer, view_xy, covariance)
    points = PicturePoints(np.empty((n, 2)), np.empty(n), np.empty((3, n)))
    for first in range(0, n, CHUNK):
        some = slice(first, first + CHUNK)
        _place(points, some, view_xy[some], covariance[:, some], size, *short_way)
    return points


def cover_in_view(place: PicturePlace, viewer: Viewer) -> Floats:
    """Which part (h, w) of each viewer pixel the picture covers, as if there were no glass, 0..1.

    Beyond the borders of a flat picture it is 0, also beside the
    horizon of its plane, where no single pixel can tell.
    """
    w, h = viewer.width, viewer.height
    if place.mesh is None:
        return np.ones((h, w))

    cover = np.zeros((h, w))
    near = np.arange(h * w)
    lines = outline_in_view(place, viewer)
    if lines is not None:
        # a flat picture is convex: blocks of pixels lie within all
        # of its borders, beyond one, or near to one
        (x, y) = (np.arange(0.5, -(-n // BLOCK)) * BLOCK for n in (w, h))
        reach = BLOCK / 2**0.5 + 2
        away = (
            lines[:, 0, None, None] * x
            + lines[:, 1, None, None] * y[:, None]
            + lines[:, 2, None, None]
        )
        of_block = np.where(
            (away > reach).all(axis=0), 1.0, np.where((away < -reach).any(axis=0), 0.0, np.nan)
        )
        cover = of_block.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)[:h, :w].copy()
        near = np.flatnonzero(np.isnan(cover))

    for first in range(0, len(near), CHUNK):
        some = near[first : first + CHUNK]
        middles = np.stack([some % w, some // w], axis=1) + 0.5
        cover.flat[some] = picture_from_view(place, viewer, middles, of_square(1.0)).cover
    return cover


def flat_way(place: PicturePlace, viewer: Viewer) -> FlatWay | None:
    """The way from viewer pixels to the UV of a flat picture, or of
    the viewer's own image, which has no borders.
    """
    if place.mesh is None:
        own = np.array([[1 / viewer.width, 0, 0], [0, -1 / viewer.height, 1], [0, 0, 1]])
        return own, (np.full(2, -np.inf), np.full(2, np.inf))
    return _homography(place.mesh, viewer)


def view_of_picture(place: PicturePlace, viewer: Viewer, uv: Floats) -> Floats:
    """Viewer px (n, 2) at which places uv (n, 2; v upward) of
    the picture are seen as if there were no glass.

    Raises
    ------
    RigError : the picture is no flat rectangle
    """
    short_way = flat_way(place, viewer)
    if short_way is None:
        raise RigError(
            "The picture '{picture}' is no flat rectangle: points of it are told for such only.",
            picture=place.name,
        )
    xyw = np.column_stack([uv, np.ones(len(uv))]) @ np.linalg.inv(short_way[0]).T
    return xyw[:, :2] / xyw[:, 2:]


def outline_in_view(place: PicturePlace, viewer: Viewer) -> Floats | None:
    """The borders of a flat picture as the viewer sees it, as if there were no glass.

    Returns
    -------
    (4, 3) a, b, c of lines a x + b y + c = 0 in viewer px, which give the distance to the line,
    above 0 on the side of the picture. None where its outline is no rectangle, or that of the
    viewer's image.
    """
    short_way = None if place.mesh is None else _homography(place.mesh, viewer)
    if short_way is None:
        return None
    (u, v, w), (low, high) = short_way
    lines = np.stack([u - low[0] * w, high[0] * w - u, v - low[1] * w, high[1] * w - v])
    return lines / np.maximum(np.linalg.norm(lines[:, :2], axis=1, keepdims=True), LEAST)


def why_unseen(place: PicturePlace, viewer: Viewer) -> str:
    """Why a viewer sees nothing of a picture on a plane,
    though nothing hides it, and the remedy: two clauses.
    """
    corners = place.mesh.corners.reshape(-1, 3)
    if ((corners - viewer.position) @ viewer.axes[2] <= 0).all():
        return Message(
            "which is behind the viewer: turn the viewer round, or move the picture before"
            " it{hint}",
            hint=BY_MIRROR,
        )
    seen = viewer.project(corners)
    seen = seen[np.isfinite(seen).all(axis=1)]
    low = seen.min(axis=0)
    high = seen.max(axis=0)
    if (high <= 0).any() or (low >= (viewer.width, viewer.height)).any():
        return Message(
            "which is outside its view: move it into the camera's frame{hint}", hint=BY_MIRROR
        )
    if np.linalg.svd(seen - seen.mean(axis=0), compute_uv=False)[1] < EDGE_ON * np.linalg.norm(
        high - low
    ):
        return "which is seen edge-on: turn it to the viewer"
    if (high - low).max() < 1:
        return (
            "which is smaller than a viewer pixel: make it larger, or raise the viewer's resolution"
        )
    return Message(
        "which is outside its view: move it into the camera's frame{hint}", hint=BY_MIRROR
    )


def _place(
    points: PicturePoints,
    some: slice,
    view_xy: Floats,
    covariance: Floats,
    size: Floats,
    matrix: Floats,
    bounds: tuple[Floats, Floats],
) -> None:
    """Set some points, by the matrix from viewer pixels to UV.

    Column by column, rows of two are slow in numpy.
    """
    x = view_xy[:, 0]
    y = view_xy[:, 1]
    u, v, w = (a * x + b * y + c for a, b, c in matrix)
    is_seen = w > 0
    inverse = 1.0 / np.where(is_seen, w, 1.0)
    u *= inverse
    v *= inverse
    width, height = size
    (ux, uy, _), (vx, vy, _), (wx, wy, _) = matrix
    # v goes up, pixels go down
    x_scale = width * inverse
    y_scale = -height * inverse
    spread = turn_covariance(
        covariance,
        (ux - u * wx) * x_scale,
        (uy - u * wy) * x_scale,
        (vx - v * wx) * y_scale,
        (vy - v * wy) * y_scale,
    )
    (low_u, low_v), (high_u, high_v) = bounds
    x, across = _within(u * width, low_u * width, high_u * width, spread[0])
    y, along = _within((1 - v) * height, (1 - high_v) * height, (1 - low_v) * height, spread[2])
    points.xy[some, 0], points.xy[some, 1] = x, y
    points.cover[some] = across * along * is_seen
    points.covariance[:, some] = spread


def _within(x: Floats, low: float, high: float, variance: Floats) -> tuple[Floats, Floats]:
    """Which share (n,) of footprints lies between two lines
    across x, and its middle: they are as good as boxes.
    """
    half = np.sqrt(3 * np.maximum(variance, 0))
    before = np.maximum(low - (x - half), 0)
    after = np.maximum(x + half - high, 0)
    share = np.clip(1 - (before + after) / np.maximum(2 * half, LEAST), 0, 1)
    return np.where(share > 0, x + 0.5 * (before - after), x), share


def _pixels(uv: Floats, size: Floats) -> Floats:
    return np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1) * size


def _homography(mesh: Mesh, viewer: Viewer) -> FlatWay | None:
    """Matrix (3, 3) from viewer pixels to UV of a flat rectangle, w
    > 0 in front of the viewer, and its UV bounds.

    None when the mesh is not flat, its UV is not one affine
    map, or it is no rectangle along the UV axes.
    """
    corners = mesh.corners.reshape(-1, 3)
    uv = mesh.uv.reshape(-1, 2)
    middle = corners.mean(axis=0)
    _, spread, axes = np.linalg.svd(corners - middle, full_matrices=False)
    if spread[1] == 0 or spread[2] > IS_AFFINE * spread[0]:
        return None
    across = (corners - middle) @ axes[:2].T
    system = np.column_stack([across, np.ones(len(across))])
    fit, *_ = np.linalg.lstsq(system, uv, rcond=None)
    low = uv.min(axis=0)
    high = uv.max(axis=0)
    if np.abs(system @ fit - uv).max() > IS_AFFINE * np.ptp(uv, axis=0).max():
        return None
    covered = uv_area(mesh.uv)
    if abs(covered - np.prod(high - low)) > IS_AFFINE * covered:
        return None
    normal = axes[2]
    left, right, bottom, top = viewer.window
    x, y, forward = viewer.axes
    # the ray through pixel (x, y): from `start @ (x, y, 1)` along `along @ (x, y, 1)`
    plane = np.array(
        [[(right - left) / viewer.width, 0, left], [0, (bottom - top) / viewer.height, top]]
    )
    sideways = np.outer(x, plane[0]) + np.outer(y, plane[1])
    ahead = np.outer(forward, [0, 0, 1.0])
    still = np.outer(viewer.position - middle, [0, 0, 1.0])
    is_perspective = viewer.projection == "perspective"
    along, start = (sideways + ahead, still) if is_perspective else (ahead, still + sideways)
    # the point where it meets the plane, times (along . normal);
    # one of the two factors is constant in (x, y)
    if is_perspective:
        depth = -(still[:, 2] @ normal)
        point = np.outer(still[:, 2], normal @ along) + depth * along
        w = normal @ along
        sign = np.sign(depth)
    else:
        speed = forward @ normal
        if speed == 0:
            return None
        point = speed * start - np.outer(forward, normal @ start)
        w = np.array([0, 0, speed])
        sign = np.sign(speed)
    matrix = np.vstack([fit[:2].T @ (axes[:2] @ point) + np.outer(fit[2], w), w])
    return (sign or 1.0) * matrix, (low, high)


def _by_tracing(
    place: PicturePlace, viewer: Viewer, view_xy: Floats, covariance: Floats
) -> PicturePoints:
    """The long way, for a picture on any mesh: its outline is not smoothed."""
    layer = Layer(place.mesh.corners)
    size = np.array([place.width, place.height], float)
    origins, directions = viewer.rays(view_xy)

    def accept(i: np.ndarray, hits: Hits) -> tuple[Bools, Bools]:
        return hits.distance > 0, np.zeros(len(i), bool)

    hits = layer.first_hits(origins, directions, np.zeros(len(origins), bool), accept)
    is_seen = hits.triangle >= 0
    seen = np.flatnonzero(is_seen)
    k = hits.triangle[is_seen]
    xy = np.zeros((len(view_xy), 2))
    spread = np.zeros((3, len(view_xy)))

    def xy_at(view_xy: Floats) -> Floats:
        o, d = viewer.rays(view_xy)
        t = layer.frames.distance(k, o, d)
        return _pixels(
            interpolate(place.mesh.uv[k], *layer.frames.barycentric(k, o + t[:, None] * d)), size
        )

    xy[seen] = xy_at(view_xy[seen])
    (by_x, by_y) = (((xy_at(view_xy[seen] + STEP * d) - xy[seen]) / STEP).T for d in np.eye(2))
    spread[:, seen] = turn_covariance(covariance[:, seen], by_x[0], by_y[0], by_x[1], by_y[1])
    return PicturePoints(xy, is_seen.astype(float), spread)
