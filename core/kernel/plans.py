"""Plans as the kernel reads them: the arrays of numpy's way,
where they are, and trees over what rays meet.
"""

import ctypes
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats, taken
from ..glass.curved import CurvedFaces
from ..glass.meshes import Frames
from ..glass.quartics import LOWER, N_TERMS, TO_BEZIER
from ..light.asked import Asked
from ..light.engines import Found
from ..light.plate import ArrayFrame
from ..light.ray_engine import Layer
from ..light.rescue import count_starts
from ..products import combine
from .loading import MOST_LAYERS, library, loaded, n_threads
from .structures import (
    NODE,
    ArrayStructure,
    CurvedStructure,
    HullStructure,
    LayerStructure,
    Made,
    PlanStructure,
    TreeStructure,
)

if TYPE_CHECKING:
    from ..light.plan import Plan, PlannedLayer

BEZIER_AT_ONCE = 1 << 12  # faces
MOST_EVENTS = 1 << 31  # more is for ever
LAST_KIND = 4  # of those in kiriko.h: numpy follows rays that may meet others
LAYOUTS = "crossed", "holes", "radial"
SLACK = 4e-6  # of its size: so much is the box of a face larger than the face
# (14,) bound of the way that Bezier points of a face go when it is lowered, per coefficient
BY_LOWERING = np.abs([TO_BEZIER @ (np.eye(N_TERMS) - lower) for lower in LOWER.values()]).max(
    axis=(0, 1)
)


def _make_tree(boxes: Floats) -> tuple[Made, NDArray[np.int32]]:
    """A tree over boxes (n, 2, 3), which are about 1 in size.

    And the box (n,) that stands at each position.
    """
    boxes = np.ascontiguousarray(boxes, float)
    nodes = np.empty(len(boxes), NODE)
    items = np.empty(len(boxes), np.int32)
    n_nodes = loaded().kiriko_make_tree(len(boxes), *(a.ctypes.data for a in (boxes, nodes, items)))
    if not n_nodes:
        raise MemoryError

    tree = Made(TreeStructure)
    tree.point("nodes", nodes[:n_nodes].copy(), NODE)
    tree.point("items", items, np.int32)
    return tree, items


def _boxes(corners: NDArray[np.floating]) -> Floats:
    """Boxes (n, 2, 3) of triangles (n, 3, 3)."""
    a, b, c = corners.swapaxes(0, 1)
    return np.stack([np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)], axis=1)


def _grown(boxes: Floats) -> Floats:
    """Boxes (n, 2, 3) a little larger."""
    more = SLACK * np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1)
    boxes[:, 0] -= more[:, None]
    boxes[:, 1] += more[:, None]
    return boxes


def _face_boxes(layer: Layer, curved: CurvedFaces | None) -> Floats:
    """Boxes (t, 2, 3) that hold a layer's faces, curved ones of
    lower degrees too, in its radii from its centre.
    """
    boxes = _boxes(layer.corners)
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
    return _grown((boxes - layer.centre) / layer.radius)


def _make_face_tree(layer: Layer, curved: CurvedFaces | None) -> tuple[Made, Floats]:
    """A tree over a layer's faces.

    And the frames (t, 4, 3) of the facets, in the order of its positions.
    """
    tree, items = _make_tree(_face_boxes(layer, curved))
    return tree, taken(stack_frames(layer.frames), items)


# made once of each, however many plans there are
_frames: WeakKeyDictionary[Frames, Floats] = WeakKeyDictionary()
_trees: WeakKeyDictionary[Frames | CurvedFaces, tuple[Made, Floats]] = WeakKeyDictionary()
_hulls: WeakKeyDictionary[Asked, Made] = WeakKeyDictionary()
_faces: WeakKeyDictionary[CurvedFaces, Made] = WeakKeyDictionary()
_plans: "WeakKeyDictionary[Plan, Made | None]" = WeakKeyDictionary()


def _kept(cache: WeakKeyDictionary, key: object, make: Callable[[], Any]) -> Any:
    if key not in cache:
        cache[key] = make()
    return cache[key]


def stack_frames(frames: Frames) -> Floats:
    """Corner, normal and both axes (t, 4, 3) of each triangle, side by side."""
    return np.stack([frames.corner, frames.normal, frames.axis_u, frames.axis_v], axis=1)


def _make_hull(asked: Asked) -> Made:
    tree, items = _make_tree(_grown(_boxes(asked.corners.astype(float))))
    made = Made(HullStructure)
    made.point("corners", asked.corners[items], np.float32)
    made.point("owner", asked.owner, np.int64)
    made.point("parts", asked.parts, float)
    made.set(n_whole=asked.n_whole, n_parts=len(asked.parts), tree=tree.structure)
    made.keep(tree)
    return made


class HullEngine:
    """The kernel's tree over triangles that are asked for hits, as a ray engine of numpy's way."""

    name = "the kernel's tree"

    def __init__(self, asked: Asked) -> None:
        self._made = _kept(_hulls, asked, lambda: _make_hull(asked))

    def shoot(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Found:
        origins, directions = (
            np.ascontiguousarray(rays, np.float32) for rays in (origins, directions)
        )
        triangle = np.empty(len(origins), np.int64)
        found = np.empty((len(origins), 6))
        arrays = (values.ctypes.data for values in (origins, directions))
        results = triangle.ctypes.data, found.ctypes.data
        loaded().kiriko_shoot(
            ctypes.addressof(self._made.structure), *arrays, len(origins), *results, n_threads()
        )
        return Found(triangle, *found[:, :3].T, found[:, 3:])


def _make_whole(curved: CurvedFaces) -> Made:
    made = Made(CurvedStructure)
    for name in ("corners", "coefficients", "vertex_normal"):
        made.point(name, getattr(curved, name), float)
    for name in ("row", "neighbour", "neighbour_edge", "vertex", "normal_row"):
        made.point(name, getattr(curved, name), np.int64)
    if curved.has_given_normals:
        made.point("normal_terms", curved.normal_terms, float)
    return made


def _make_curved(curved: CurvedFaces) -> Made:
    whole = _kept(_faces, curved.whole, lambda: _make_whole(curved.whole))
    if curved is curved.whole:
        return whole
    made = Made(CurvedStructure)
    made.structure = CurvedStructure.from_buffer_copy(whole.structure)
    made.keep(whole)
    made.point("normal_row", curved.normal_row, np.int64)
    made.point("lower", LOWER[curved.degree], float)
    return made


def _make_layer(held: "PlannedLayer") -> Made:
    made = Made(LayerStructure)
    layer = held.layer
    frames = layer.frames
    curved = layer.curved
    made.point("frames", _kept(_frames, frames, lambda: stack_frames(frames)), float)
    made.point("numbers", held.numbers, np.int64)
    made.point("closed_bits", held.closed_bits, np.uint64)
    made.point("solid_bits", held.solid_bits, np.uint64)
    if layer.motion is not None:
        made.point("rotation", layer.motion.rotation, float)
        made.set(shift=layer.motion.shift)
    made.set(
        n_triangles=layer.n_triangles,
        low=layer.bounds[0],
        high=layer.bounds[1],
        centre=layer.centre,
        radius=layer.radius,
        tolerance=layer.tolerance,
        has_engine=layer.has_engine,
        n_starts=count_starts(layer.n_triangles),
    )
    if layer.has_engine:
        whole = None if curved is None else curved.whole
        tree, facets = _kept(_trees, whole or frames, lambda: _make_face_tree(layer, whole))
        made.set(over_faces=tree.structure)
        made.point("facets", facets, float)
        made.keep(tree)
    if curved is not None:
        faces = _make_curved(curved)
        hull = _kept(_hulls, layer.asked, lambda: _make_hull(layer.asked))
        made.set(curved=ctypes.addressof(faces.structure), hull=ctypes.addressof(hull.structure))
        made.keep(faces, hull)
    return made


def _make_array(frame: ArrayFrame) -> Made:
    made = Made(ArrayStructure)
    array = frame.array
    made.set(
        centre=frame.centre,
        axes=frame.axes,
        phase=np.array(array.phase, float),
        layout=LAYOUTS.index(array.layout),
        **{
            name: getattr(array, name)
            for name in ("pitch", "height", "thickness", "ior", "reflectance")
        },
        **{name: getattr(array, name) for name in ("crossing_error", "has_fresnel")},
    )
    return made


def left_out(layers: Sequence["PlannedLayer"]) -> str | None:
    """Why the kernel does not follow rays in a plan of these layers; None where it does."""
    return "it is not there" if library() is None else _unknown(layers)


def _unknown(layers: Sequence["PlannedLayer"]) -> str | None:
    if len(layers) > MOST_LAYERS:
        return f"more than {MOST_LAYERS} layers"
    if any(
        type(held.layer) is not Layer or type(held.layer.curved) not in (CurvedFaces, type(None))
        for held in layers
    ):
        return "faces of another kind"
    return None


def _make_plan(plan: "Plan") -> Made | None:
    if _unknown(plan.layers) is not None or plan.parts.kind.max() > LAST_KIND:
        return None

    made = Made(PlanStructure)
    _point_to_tables(made, plan)
    _point_to_arrays(made, plan)
    _point_to_layers(made, plan)
    settings = plan.settings
    display = plan.rig.display
    plane = plan.display.plane
    made.set(
        n_triangles=len(plan.triangles),
        merge_distance=plan.merge_distance,
        max_events=min(settings.max_events, MOST_EVENTS),
        only_through_glass=bool(settings.only_through_glass),
        looks_beside=bool(settings.looks_beside),
        brightness=bool(settings.brightness),
        has_plane=plane is not None,
        display_start=plan.display.start,
        display_size=np.array([display.width, display.height], float),
    )
    if plane is not None:
        made.set(
            plane_corner=plane.corner,
            plane_normal=plane.normal,
            plane_pixels=plane.pixels,
            plane_origin=plane.origin,
        )
    return made


# columns of a plan's tables, and the kernel's types of them
OF_TRIANGLES = {
    "normals": float,
    "corner_normals": float,
    "is_bent": np.uint8,
    "patch": np.int64,
    "part": np.int64,
}
OF_PARTS = {
    "kind": np.int64,
    "cluster": np.int64,
    "sheet": np.int64,
    "is_closed": np.uint8,
    "is_clear": np.uint8,
    "bit": np.uint64,
}


def _point_to_tables(made: Made, plan: "Plan") -> None:
    """Let a plan point to its tables of triangles and parts, media and boxes."""
    for table, columns in ((plan.triangles, OF_TRIANGLES), (plan.parts, OF_PARTS)):
        for name, dtype in columns.items():
            made.point(name, getattr(table, name), dtype)

    made.point("index_row", plan.media.row, np.int64)
    made.point("indices", plan.media.indices, float)
    made.point("open_part", np.array([part.number for part in plan.open_parts]), np.int64)
    open_boxes = np.array([part.box for part in plan.open_parts]).reshape(-1, 2, 3)
    made.point("open_box", open_boxes, float)
    made.point("aside_box", plan.aside.boxes, float)
    made.point("display_uv", plan.rig.display.mesh.uv, float)
    made.set(n_open=len(plan.open_parts), n_aside=len(plan.aside.boxes))


def _point_to_arrays(made: Made, plan: "Plan") -> None:
    """Let a plan point to its mirror arrays, and each part to its own."""
    array = np.full(len(plan.parts), -1)
    array[list(plan.arrays)] = np.arange(len(plan.arrays))
    made.point("array", array, np.int64)
    arrays = (ArrayStructure * len(plan.arrays))(
        *(_make_array(frame).structure for frame in plan.arrays.values())
    )
    made.keep(arrays)
    made.set(arrays=ctypes.addressof(arrays))


def _point_to_layers(made: Made, plan: "Plan") -> None:
    """Let a plan point to its layers, and to the order in which they are asked."""
    layers = [_make_layer(held) for held in plan.layers]
    structures = (LayerStructure * len(layers))(*(layer.structure for layer in layers))
    made.keep(layers, structures)
    made.set(n_layers=len(layers), layers=ctypes.addressof(structures))
    # glass comes first: most of what else there is lies beyond, and then need not be asked
    order = np.argsort([not held.layer.has_engine for held in plan.layers], kind="stable")
    made.point("order", order, np.int64)


def made_of(plan: "Plan") -> Made | None:
    """A plan as the kernel reads it, made once; None where it does not know it."""
    return _kept(_plans, plan, lambda: _make_plan(plan))
