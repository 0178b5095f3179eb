"""Trees over faces and bounding shells, for the compiled kernel."""

import ctypes
from collections.abc import Callable
from time import sleep
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, take
from ..base.products import combine
from ..base.steps import Steps
from ..base.vectors import length_of
from ..glass.curved import CurvedFaces
from ..glass.meshes import Frames, boxes_of
from ..glass.paraboloids import Paraboloids
from ..glass.quartics import LOWER, N_TERMS, TO_BEZIER
from ..native.loading import loaded
from ..native.structures import (
    NODE,
    EngineTrianglesStructure,
    Made,
    TreeStructure,
    TreeTaskStructure,
)
from .ray_engine import EngineTriangles, Layer

LARGE = 1 << 17  # boxes: a larger tree takes over 0.06 s and is built in its own thread
PAUSE_S = 0.005
LINE = 64  # bytes of a cache line; a node fills two
BEZIER_AT_ONCE = 1 << 12  # faces
BOXES_AT_ONCE = 1 << 16  # of triangles
BOX_SLACK = 4e-6  # margin of a face's box, relative to its size
# (14,) bound of the displacement of a face's Bezier points by degree reduction, per coefficient
BY_LOWERING = np.abs([TO_BEZIER @ (np.eye(N_TERMS) - lower) for lower in LOWER.values()]).max(
    axis=(0, 1)
)

# shared by all plans
_frames: WeakKeyDictionary[Frames, Floats] = WeakKeyDictionary()
_trees: WeakKeyDictionary[Frames | CurvedFaces, tuple[Made, Floats]] = WeakKeyDictionary()
_shell_trees: WeakKeyDictionary[EngineTriangles, Made] = WeakKeyDictionary()


def cached(cache: WeakKeyDictionary, key: object, make: Callable[[], Any]) -> Any:
    """The cached value of a key, made once."""
    if key not in cache:
        cache[key] = make()
    return cache[key]


def cached_steps(
    cache: WeakKeyDictionary, key: object, make_steps: Callable[[], Steps[Any]]
) -> Steps[Any]:
    """The cached value of a key, made once, with pauses."""
    if key not in cache:
        made = yield from make_steps()
        cache[key] = made
    return cache[key]


def tree_steps(boxes: Floats) -> Steps[tuple[Made, NDArray[np.int32]]]:
    """Make a tree over boxes (n, 2, 3) of about unit size, with pauses.

    Also returns the boxes (b, 4) of its blocks, the last one of a block repeated.
    """
    boxes = np.ascontiguousarray(boxes, float)
    nodes, items = np.empty(len(boxes), NODE), np.empty((len(boxes), 4), np.int32)
    addresses = {"boxes": boxes.ctypes.data, "nodes": nodes.ctypes.data}
    task = TreeTaskStructure(n=len(boxes), items=items.ctypes.data, **addresses)

    kernel, is_large = loaded(), len(boxes) > LARGE
    work = kernel.kiriko_begin_tree(ctypes.addressof(task), 1 + is_large)
    try:
        while is_large and work and not kernel.kiriko_is_done(work):
            yield 0
            sleep(PAUSE_S)
    except BaseException:
        task.is_cancelled = 1
        raise
    finally:
        kernel.kiriko_end(work, 1)

    if not task.n_nodes:
        raise MemoryError
    made = Made(TreeStructure)
    made.point("nodes", in_lines(nodes[: task.n_nodes]), NODE)
    items = made.point("items", items[: task.n_blocks].copy(), np.int32)
    return made, items


def in_lines(nodes: NDArray[np.void]) -> NDArray[np.void]:
    """Copy nodes (n,) to memory aligned to a cache line."""
    buffer = np.empty(nodes.nbytes + LINE, np.uint8)
    begin = -buffer.ctypes.data % LINE
    placed = buffer[begin : begin + nodes.nbytes].view(NODE)
    placed[:] = nodes
    return placed


def stack_frames(frames: Frames) -> Floats:
    """Corner, normal and both axes (t, 4, 3) of each triangle, contiguous."""
    return np.stack([frames.corner, frames.normal, frames.axis_u, frames.axis_v], axis=1)


def _grown(boxes: Floats) -> Floats:
    """Boxes (n, 2, 3) with a small margin, in place."""
    more = BOX_SLACK * length_of(boxes[:, 1] - boxes[:, 0])
    boxes[:, 0] -= more[:, None]
    boxes[:, 1] += more[:, None]
    return boxes


def _face_boxes(layer: Layer, curved: CurvedFaces | None) -> Steps[Floats]:
    """Boxes (t, 2, 3) of a layer's faces, for all degrees of curved ones, in radii from its
    centre.
    """
    boxes = boxes_of(layer.corners)

    # a curved face lies within its Bezier points
    if curved is not None:
        triangle = curved.triangle
        for first in range(0, len(triangle), BEZIER_AT_ONCE):
            some = triangle[first : first + BEZIER_AT_ONCE]
            terms = curved.terms(some).reshape(N_TERMS, -1)
            points = combine(TO_BEZIER, terms)
            reach = combine(BY_LOWERING[None], np.abs(terms))[0]
            bounds = np.stack([points.min(axis=0) - reach, points.max(axis=0) + reach]).reshape(
                2, 3, -1
            )
            boxes[some] = bounds.transpose(2, 0, 1) + curved.corners[some, :1]
            yield 0

    return _grown((boxes - layer.centre) / layer.radius)


def _build_face_tree(layer: Layer, curved: CurvedFaces | None) -> Steps[tuple[Made, Floats]]:
    """Make a tree over a layer's faces; also returns the frames (4 b, 4, 3) of its blocks."""
    tree, items = yield from tree_steps((yield from _face_boxes(layer, curved)))
    return tree, take(stack_frames(layer.frames), items.ravel())


def _build_shell_tree(triangles: EngineTriangles) -> Steps[Made]:
    boxes = np.empty((len(triangles.corners), 2, 3))
    for first in range(0, len(boxes), BOXES_AT_ONCE):
        some = slice(first, first + BOXES_AT_ONCE)
        boxes[some] = _grown(boxes_of(triangles.corners[some].astype(float)))
        yield 0

    tree, items = yield from tree_steps(boxes)
    made = Made(EngineTrianglesStructure)
    corners = triangles.corners.reshape(-1, 9)[items].transpose(0, 2, 1)
    made.point("corners", corners, np.float32)
    made.point("owner", triangles.owner[items], np.int64)
    made.point("places", triangles.places, np.float32)
    made.set(n_whole=triangles.n_whole, tree=tree.structure)
    made.keep(tree)
    return made


def frames_of(frames: Frames) -> Floats:
    """Frames (t, 4, 3) of triangles, contiguous and cached."""
    return cached(_frames, frames, lambda: stack_frames(frames))


def face_tree_steps(layer: Layer) -> Steps[tuple[Made, Floats]]:
    """Make a tree over a layer's faces, cached; also returns the facets' frames in its order."""
    faces = _treed(layer)
    return cached_steps(_trees, faces or layer.frames, lambda: _build_face_tree(layer, faces))


def _treed(layer: Layer) -> CurvedFaces | None:
    """The curved faces in the tree over a layer's faces. Paraboloids are in it as facets: a ray
    that slips through between them is not compared.
    """
    whole = None if layer.curved is None else layer.curved.whole
    return whole.others if isinstance(whole, Paraboloids) else whole


def has_face_tree(layer: Layer) -> bool:
    """Whether the tree over a layer's faces exists, or is needed by every ray.

    Behind a bounding shell only lost rays need it, which most glass never has.
    """
    faces = _treed(layer)
    return faces is None or faces in _trees


def shell_tree_steps(triangles: EngineTriangles) -> Steps[Made]:
    """Make the kernel's form of engine triangles, with a tree over them, cached."""
    return cached_steps(_shell_trees, triangles, lambda: _build_shell_tree(triangles))
