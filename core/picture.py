"""What the viewer should see: picture_from_view, and the picture's colours at points of the viewer's image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import Bools, Floats
from .display import uv_area
from .errors import RigError
from .hits import Hits
from .meshes import interpolate
from .products import turn_covariance
from .ray_engine import Layer
from .rig import Mesh, Picture, Viewer

SUBPIXELS = 2  # an ideal pixel is the mean of this many points an axis, each with its own footprint
CHUNK = 1 << 16  # points at once: their arrays stay in the cache
STEP = 1e-3  # viewer px over which a mesh's map is differentiated
EDGE_ON = 1e-3  # of its length: a picture seen so thin is nothing to be seen
BY_MIRROR = " (where it is seen by way of a mirror, set Picture to Image)"
LEAST = 1e-100  # picture px: a footprint that is narrower is a point
ROUND = 0.05  # picture px^2: footprints whose two variances differ by less are read at one place
UPRIGHT = 1e-3  # of the variance along y: less along x is none
WIDE = 0.5  # picture px^2: from half of it on the lesser variance makes it two places each way
BLOCK = 16  # viewer px, sides of blocks of pixels: most are covered by the picture wholly, or not at all
IS_AFFINE = 1e-6  # of a picture's size: how well one affine map has to give its UV for the short way


@dataclass(frozen=True, eq=False)
class PicturePoints:
    """Where points of the viewer's image lie on the picture.

    xy : (n, 2) picture pixels, x right and y down from the top left corner: the middle of what of a footprint lies on
        the picture
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

FlatWay = tuple[Floats, tuple[Floats, Floats]]  # matrix (3, 3) to UV, w > 0 in front of the viewer; bounds in UV


def picture_from_view(picture: Picture, viewer: Viewer, view_xy: Floats, covariance: NDArray = POINT) -> PicturePoints:
    """Follow straight lines from the viewer to the picture, as if there were no glass.

    Parameters
    ----------
    view_xy : (n, 2) viewer pixels, middles of footprints
    covariance : (3, n) or (3, 1) xx, xy and yy of the footprints on the viewer's image, viewer px^2
    """
    height, width = picture.image.shape[:2]
    size = np.array([width, height], float)
    n = len(view_xy)
    covariance = np.broadcast_to(covariance, (3, n))
    short_way = flat_way(picture, viewer)
    if short_way is None:
        return _by_tracing(picture, viewer, view_xy, covariance)
    points = PicturePoints(np.empty((n, 2)), np.empty(n), np.empty((3, n)))
    for first in range(0, n, CHUNK):
        some = slice(first, first + CHUNK)
        _place(points, some, view_xy[some], covariance[:, some], size, *short_way)
    return points


def cover_in_view(picture: Picture, viewer: Viewer) -> Floats:
    """Which part (h, w) of each viewer pixel the picture covers, as if there were no glass, 0..1.

    Beyond the borders of a flat picture it is 0, also beside the horizon of its plane, where no single pixel can tell.
    """
    w, h = viewer.width, viewer.height
    if picture.mesh is None:
        return np.ones((h, w))

    cover, near = np.zeros((h, w)), np.arange(h * w)
    lines = outline_in_view(picture, viewer)
    if lines is not None:
        # a flat picture is convex: blocks of pixels lie within all of its borders, beyond one, or near to one
        (x, y), reach = ((np.arange(0.5, -(-n // BLOCK)) * BLOCK for n in (w, h)), BLOCK / 2**0.5 + 2)
        away = lines[:, 0, None, None] * x + lines[:, 1, None, None] * y[:, None] + lines[:, 2, None, None]
        of_block = np.where((away > reach).all(axis=0), 1.0, np.where((away < -reach).any(axis=0), 0.0, np.nan))
        cover = of_block.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)[:h, :w].copy()
        near = np.flatnonzero(np.isnan(cover))

    for first in range(0, len(near), CHUNK):
        some = near[first : first + CHUNK]
        middles = np.stack([some % w, some // w], axis=1) + 0.5
        cover.flat[some] = picture_from_view(picture, viewer, middles, of_square(1.0)).cover
    return cover


def flat_way(picture: Picture, viewer: Viewer) -> FlatWay | None:
    """The way from viewer pixels to the UV of a flat picture, or of the viewer's own image, which has no borders."""
    if picture.mesh is None:
        own = np.array([[1 / viewer.width, 0, 0], [0, -1 / viewer.height, 1], [0, 0, 1]])
        return own, (np.full(2, -np.inf), np.full(2, np.inf))
    return _homography(picture.mesh, viewer)


def view_of_picture(picture: Picture, viewer: Viewer, uv: Floats) -> Floats:
    """Viewer px (n, 2) at which places uv (n, 2; v upward) of the picture are seen as if there were no glass.

    Raises
    ------
    RigError : the picture is no flat rectangle
    """
    short_way = flat_way(picture, viewer)
    if short_way is None:
        raise RigError(f"The picture '{picture.name}' is no flat rectangle: points of it are told for such only.")
    xyw = np.column_stack([uv, np.ones(len(uv))]) @ np.linalg.inv(short_way[0]).T
    return xyw[:, :2] / xyw[:, 2:]


def outline_in_view(picture: Picture, viewer: Viewer) -> Floats | None:
    """The borders of a flat picture as the viewer sees it, as if there were no glass.

    Returns
    -------
    (4, 3) a, b, c of lines a x + b y + c = 0 in viewer px, which give the distance to the line, above 0 on the side of
    the picture. None where its outline is no rectangle, or that of the viewer's image.
    """
    short_way = None if picture.mesh is None else _homography(picture.mesh, viewer)
    if short_way is None:
        return None
    (u, v, w), (low, high) = short_way
    lines = np.stack([u - low[0] * w, high[0] * w - u, v - low[1] * w, high[1] * w - v])
    return lines / np.maximum(np.linalg.norm(lines[:, :2], axis=1, keepdims=True), LEAST)


def why_unseen(picture: Picture, viewer: Viewer) -> str:
    """Why a viewer sees nothing of a picture on a plane, though nothing hides it, and what to do: two clauses."""
    corners = picture.mesh.corners.reshape(-1, 3)
    if ((corners - viewer.position) @ viewer.axes[2] <= 0).all():
        return f"which is behind the viewer: turn the viewer round, or move the picture before it{BY_MIRROR}"
    seen = viewer.project(corners)
    seen = seen[np.isfinite(seen).all(axis=1)]
    low, high = seen.min(axis=0), seen.max(axis=0)
    if (high <= 0).any() or (low >= (viewer.width, viewer.height)).any():
        return f"which is outside its view: move it into the camera's frame{BY_MIRROR}"
    if np.linalg.svd(seen - seen.mean(axis=0), compute_uv=False)[1] < EDGE_ON * np.linalg.norm(high - low):
        return "which is seen edge-on: turn it to the viewer"
    if (high - low).max() < 1:
        return "which is smaller than a viewer pixel: make it larger, or raise the viewer's resolution"
    return f"which is outside its view: move it into the camera's frame{BY_MIRROR}"


def _place(
    points: PicturePoints,
    some: slice,
    view_xy: Floats,
    covariance: Floats,
    size: Floats,
    matrix: Floats,
    bounds: tuple[Floats, Floats],
) -> None:
    """Set some points, by the matrix from viewer pixels to UV; column by column, rows of two are slow in numpy."""
    x, y = view_xy[:, 0], view_xy[:, 1]
    u, v, w = (a * x + b * y + c for a, b, c in matrix)
    is_seen = w > 0
    inverse = 1.0 / np.where(is_seen, w, 1.0)
    u *= inverse
    v *= inverse
    width, height = size
    (ux, uy, _), (vx, vy, _), (wx, wy, _) = matrix
    x_scale, y_scale = width * inverse, -height * inverse  # v goes up, pixels go down
    spread = turn_covariance(
        covariance, (ux - u * wx) * x_scale, (uy - u * wy) * x_scale, (vx - v * wx) * y_scale, (vy - v * wy) * y_scale
    )
    (low_u, low_v), (high_u, high_v) = bounds
    x, across = _within(u * width, low_u * width, high_u * width, spread[0])
    y, along = _within((1 - v) * height, (1 - high_v) * height, (1 - low_v) * height, spread[2])
    points.xy[some, 0], points.xy[some, 1] = x, y
    points.cover[some] = across * along * is_seen
    points.covariance[:, some] = spread


def _within(x: Floats, low: float, high: float, variance: Floats) -> tuple[Floats, Floats]:
    """Which share (n,) of footprints lies between two lines across x, and its middle: they are as good as boxes."""
    half = np.sqrt(3 * np.maximum(variance, 0))
    before, after = np.maximum(low - (x - half), 0), np.maximum(x + half - high, 0)
    share = np.clip(1 - (before + after) / np.maximum(2 * half, LEAST), 0, 1)
    return np.where(share > 0, x + 0.5 * (before - after), x), share


def _pixels(uv: Floats, size: Floats) -> Floats:
    return np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1) * size


def _homography(mesh: Mesh, viewer: Viewer) -> FlatWay | None:
    """Matrix (3, 3) from viewer pixels to UV of a flat rectangle, w > 0 in front of the viewer, and its UV bounds.

    None when the mesh is not flat, its UV is not one affine map, or it is no rectangle along the UV axes.
    """
    corners, uv = mesh.corners.reshape(-1, 3), mesh.uv.reshape(-1, 2)
    middle = corners.mean(axis=0)
    _, spread, axes = np.linalg.svd(corners - middle, full_matrices=False)
    if spread[1] == 0 or spread[2] > IS_AFFINE * spread[0]:
        return None
    across = (corners - middle) @ axes[:2].T
    system = np.column_stack([across, np.ones(len(across))])
    fit, *_ = np.linalg.lstsq(system, uv, rcond=None)
    low, high = uv.min(axis=0), uv.max(axis=0)
    if np.abs(system @ fit - uv).max() > IS_AFFINE * np.ptp(uv, axis=0).max():
        return None
    covered = uv_area(mesh.uv)
    if abs(covered - np.prod(high - low)) > IS_AFFINE * covered:
        return None
    normal = axes[2]
    left, right, bottom, top = viewer.window
    x, y, forward = viewer.axes
    # the ray through pixel (x, y): from `start @ (x, y, 1)` along `along @ (x, y, 1)`
    plane = np.array([[(right - left) / viewer.width, 0, left], [0, (bottom - top) / viewer.height, top]])
    sideways = np.outer(x, plane[0]) + np.outer(y, plane[1])
    ahead, still = np.outer(forward, [0, 0, 1.0]), np.outer(viewer.position - middle, [0, 0, 1.0])
    is_perspective = viewer.projection == "perspective"
    along, start = (sideways + ahead, still) if is_perspective else (ahead, still + sideways)
    # the point where it meets the plane, times (along . normal); one of the two factors is constant in (x, y)
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


def _by_tracing(picture: Picture, viewer: Viewer, view_xy: Floats, covariance: Floats) -> PicturePoints:
    """The long way, for a picture on any mesh: its outline is not smoothed."""
    layer = Layer(picture.mesh.corners)
    size = np.array(picture.image.shape[1::-1], float)
    origins, directions = viewer.rays(view_xy)

    def accept(i: np.ndarray, hits: Hits) -> tuple[Bools, Bools]:
        return hits.distance > 0, np.zeros(len(i), bool)

    hits = layer.first_hits(origins, directions, np.zeros(len(origins), bool), accept)
    is_seen = hits.triangle >= 0
    seen, k = np.flatnonzero(is_seen), hits.triangle[is_seen]
    xy, spread = np.zeros((len(view_xy), 2)), np.zeros((3, len(view_xy)))

    def xy_at(view_xy: Floats) -> Floats:
        o, d = viewer.rays(view_xy)
        t = layer.frames.distance(k, o, d)
        return _pixels(interpolate(picture.mesh.uv[k], *layer.frames.barycentric(k, o + t[:, None] * d)), size)

    xy[seen] = xy_at(view_xy[seen])
    (by_x, by_y) = (((xy_at(view_xy[seen] + STEP * d) - xy[seen]) / STEP).T for d in np.eye(2))
    spread[:, seen] = turn_covariance(covariance[:, seen], by_x[0], by_y[0], by_x[1], by_y[1])
    return PicturePoints(xy, is_seen.astype(float), spread)


@dataclass(frozen=True, eq=False)
class Taps:
    """Which pixels of a pyramid make up weighted colours of points: a sparse matrix, the same for pictures of one size.

    Each row adds four neighbouring pixels of a level to a point.

    point : (m,) int32
    levels : number and rows of each run of rows on one level
    pixel : (m,) int32, the upper left of the four, row * width + column
    weight : (4, m) float32, of the upper left, upper right, lower left and lower right one
    """

    point: NDArray[np.int32]
    levels: tuple[tuple[int, slice], ...]
    pixel: NDArray[np.int32]
    weight: NDArray[np.float32]


def find_taps(points: PicturePoints, weight: Floats, size: tuple[int, int]) -> Taps:
    """How colours are read, times weight (n,), at points of a picture of a size (width, height).

    A level read between its pixels spreads as far as a box of its pixel and a tent of two: in all, a variance of
    4^k / 4 - 1 / 12 of the picture's pixels. Two levels are mixed so that it is the footprint's. A footprint that is
    longer than wide is read at two places along it, a wide one at two each way, so that both variances are right.
    """
    sizes = _level_sizes(size)
    last = len(sizes) - 1
    found, n_rows = [], 0
    levels: list[tuple[int, slice]] = []
    seen = np.flatnonzero(weight > 0).astype(np.int32)
    for first in range(0, len(seen), CHUNK):
        some, x, y, part, variance = _reads(points, seen[first : first + CHUNK], weight)
        relative = 1 + 4 * variance
        lower = np.minimum((np.frexp(relative)[1] - 1) // 2, last)
        upper_part = np.clip((np.ldexp(relative, -2 * lower) - 1) / 3, 0, 1) * (lower < last)
        of_upper = part * upper_part
        of_lower = part - of_upper
        for k in range(int(lower.min()), int(lower.max()) + 2):
            here = np.where(lower == k, of_lower, np.where(lower == k - 1, of_upper, 0.0))
            rows = np.flatnonzero(here > 0)
            if len(rows):
                scale_x, scale_y = (new / old for new, old in zip(sizes[k], size, strict=True))
                found.append((some[rows], *_bilinear(sizes[k], x[rows] * scale_x, y[rows] * scale_y, here[rows])))
                levels.append((k, slice(n_rows, n_rows + len(rows))))
                n_rows += len(rows)
    if not found:
        return Taps(np.empty(0, np.int32), (), np.empty(0, np.int32), np.empty((4, 0), np.float32))
    point, pixel, weights = (np.concatenate(parts, axis=-1) for parts in zip(*found, strict=True))
    return Taps(point, tuple(levels), pixel, weights)


def _reads(
    points: PicturePoints, some: NDArray[np.int32], weight: Floats
) -> tuple[NDArray[np.int32], Floats, Floats, Floats, Floats]:
    """Where some points are read: number, x, y, weight and variance along each axis of every read.

    On a ball's source image of fine rings one read each errs by 0.0018, two along what is long by 0.0009, and four
    where it is wide by 0.0007; more than that gains nothing. Reads come apart gradually, so that a footprint that
    rounding changes is read at the same places but for rounding.
    """
    x, y, part = points.xy[some, 0], points.xy[some, 1], weight[some]
    xx, xy, yy = points.covariance[:, some]
    mean, slope = 0.5 * (xx + yy), 0.5 * (xx - yy)
    unlike = np.sqrt(slope * slope + xy * xy)
    length = np.clip(2 * unlike / ROUND - 1, 0, 1)
    lesser = np.maximum(mean - length * unlike, 0)
    width = np.clip(2 * lesser / WIDE - 1, 0, 1)
    left = (1 - 0.75 * width) * lesser

    # what the places of the reads have to make up, as a matrix; its triangular root takes them from a square to there
    xx, xy, yy = mean + length * slope - left, length * xy, mean - length * slope - left
    is_upright = xx < UPRIGHT * yy  # where rounding is as large as xx the root begins with y
    xx, yy = np.where(is_upright, yy, xx), np.where(is_upright, xx, yy)
    dx, most = np.sqrt(np.maximum(xx, 0)), np.sqrt(np.maximum(yy, 0))
    along = np.clip(xy / np.maximum(dx, LEAST), -most, most)  # rounding may leave more than there can be
    across = np.sqrt(np.maximum(yy - along * along, 0))
    signs = np.where(width > 0, 4, np.where(length > 0, 2, 1))
    found = []
    for n, shifts in ((1, [(0, 0)]), (2, [(-1, 0), (1, 0)]), (4, [(-1, -1), (-1, 1), (1, -1), (1, 1)])):
        rows = np.flatnonzero(signs == n)
        for i, j in shifts:
            far, near, turned = i * dx[rows], i * along[rows] + j * across[rows], is_upright[rows]
            at = x[rows] + np.where(turned, near, far), y[rows] + np.where(turned, far, near)
            found.append((some[rows], *at, part[rows] / n, left[rows]))
    return tuple(np.concatenate(values) for values in zip(*found, strict=True))


def _level_sizes(size: tuple[int, int]) -> list[tuple[int, int]]:
    """Width and height of a picture's full, half, quarter ... size."""
    sizes = [size]
    while max(sizes[-1]) > 1:
        sizes.append(tuple((n + 1) // 2 for n in sizes[-1]))
    return sizes


def _bilinear(size: tuple[int, int], x: Floats, y: Floats, weight: Floats) -> tuple[NDArray, NDArray]:
    """Upper left pixel (n,) and weights (4, n), times weight, that read an image: centres at + 0.5, edges extended."""
    w, h = size
    x, y = np.clip(x - 0.5, 0, w - 1), np.clip(y - 0.5, 0, h - 1)
    column, row = np.minimum(x.astype(np.int32), max(w - 2, 0)), np.minimum(y.astype(np.int32), max(h - 2, 0))
    x -= column
    lower = weight * (y - row)
    upper = weight - lower
    upper_right, lower_right = upper * x, lower * x
    weights = np.empty((4, len(x)), np.float32)
    weights[0], weights[1], weights[2], weights[3] = upper - upper_right, upper_right, lower - lower_right, lower_right
    return row * np.int32(w) + column, weights


class Pyramid:
    """A picture at full, half, quarter ... size, so that a footprint of any size is read at its own size.

    levels : (3, h, w) float32 each
    """

    def __init__(self, image: NDArray[np.float32]) -> None:
        """Build all levels of an image (h, w, 4), linear, premultiplied."""
        if image.ndim != 3 or min(image.shape[:2]) < 1:
            raise RigError("The picture has no pixels: choose another image.")
        self.levels = [np.array(image[..., :3].transpose(2, 0, 1), np.float32, order="C")]
        while max(self.levels[-1].shape[1:]) > 1:
            self.levels.append(_halved(self.levels[-1]))

    def is_of(self, image: NDArray[np.float32]) -> bool:
        """Was it built from an image like this one?"""
        planes = self.levels[0]
        return planes.shape[1:] == image.shape[:2] and all(
            np.array_equal(plane, image[..., channel]) for channel, plane in enumerate(planes)
        )

    def read(self, taps: Taps) -> NDArray[np.float32]:
        """What each row of taps (m,) adds to its point (3, m), linear, over black."""
        values = np.zeros((3, len(taps.pixel)), np.float32)
        for k, rows in taps.levels:
            h, w = self.levels[k].shape[1:]
            right, below = int(w > 1), w * int(h > 1)
            pixel = taps.pixel[rows].astype(np.intp)
            for plane, value in zip(self.levels[k].reshape(3, -1), values[:, rows], strict=True):
                for step, weight in zip((0, right, below, right + below), taps.weight[:, rows], strict=True):
                    value += plane[step:].take(pixel) * weight
        return values

    def sample(self, points: PicturePoints) -> Floats:
        """Linear colours (n, 3) at points, over black."""
        taps = find_taps(points, points.cover, self.levels[0].shape[:0:-1])
        n = len(points.xy)
        return np.stack([np.bincount(taps.point, value, n) for value in self.read(taps)], axis=1)


def _halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Half the size of an image (c, h, w) by exact area means; odd rows or columns are shared by their neighbours."""
    c, h, w = image.shape
    halved = np.empty((c, (h + 1) // 2, (w + 1) // 2), np.float32)
    for plane, half in zip(image, halved, strict=True):  # one by one: steps between take a third of the memory
        half[:] = _halved_along(1, _halved_along(0, plane))
    return halved


def _halved_along(axis: int, plane: NDArray[np.float32]) -> NDArray[np.float32]:
    """Half as many rows (axis 0) or columns (1) of a plane (h, w)."""
    n = plane.shape[axis]
    if n == 1:
        return plane
    if n % 2 == 0:  # the same, many times as fast
        even, odd = (plane[k::2] if axis == 0 else plane[:, k::2] for k in (0, 1))
        return np.float32(0.5) * (even + odd)
    m = (n + 1) // 2
    edges = np.linspace(0, n, m + 1)
    total = np.insert(np.cumsum(plane, axis=axis, dtype=float), 0, 0, axis=axis)
    whole = np.minimum(edges.astype(int), n - 1)
    part = (edges - whole).reshape([-1, 1] if axis == 0 else [1, -1])
    at = np.take(total, whole, axis=axis) + part * np.take(plane, whole, axis=axis)
    return (np.diff(at, axis=axis) * (m / n)).astype(np.float32)


def ideal_image(picture: Picture, viewer: Viewer) -> NDArray[np.float32]:
    """What the viewer would see of the picture with no glass in the way: (h, w, 3) linear."""
    pyramid = Pyramid(picture.image)
    w, h = viewer.width, viewer.height
    image = np.zeros((h * w, 3), np.float32)
    offsets = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS
    for first in range(0, h * w, CHUNK):
        pixels = np.arange(first, min(first + CHUNK, h * w))
        corner = np.stack([pixels % w, pixels // w], axis=1)
        total = np.zeros((len(pixels), 3))
        for dx in offsets:
            for dy in offsets:
                points = picture_from_view(picture, viewer, corner + np.array([dx, dy]), of_square(1 / SUBPIXELS))
                total += pyramid.sample(points)
        image[pixels] = total / SUBPIXELS**2
    return image.reshape(h, w, 3)
