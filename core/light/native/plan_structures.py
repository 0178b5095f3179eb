"""Plans and their layers as the kernel reads them: pointers to numpy's own arrays."""

import ctypes
from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np

from ...base.arrays import Ints
from ...base.messages import Message
from ...base.steps import Pauses, finish
from ...glass.curved import CurvedFaces
from ...glass.quartics import LOWER, TO_BEZIER
from ...native.loading import MOST_LAYERS, library
from ...native.structures import (
    ArrayStructure,
    CurvedStructure,
    LayerStructure,
    Made,
    PlanStructure,
)
from ..layer_hits import count_starts
from ..plan import Plan, PlannedLayer
from ..plate import ArrayFrame
from ..ray_engine import Layer
from .trees import frames_of, has_face_tree, kept, making_face_tree, making_hull

_faces: WeakKeyDictionary[CurvedFaces, Made] = WeakKeyDictionary()


def _make_whole(curved: CurvedFaces) -> Made:
    made = Made(CurvedStructure)
    for name in ("corners", "coefficients", "vertex_normal"):
        made.point(name, getattr(curved, name), float)
    for name in ("row", "neighbour", "neighbour_edge", "vertex", "normal_row"):
        made.point(name, getattr(curved, name), np.int64)
    if curved.has_given_normals:
        made.point("normal_terms", curved.normal_terms, float)
    made.point("to_bezier", TO_BEZIER, float)
    return made


def _make_curved(curved: CurvedFaces) -> Made:
    whole = kept(_faces, curved.whole, lambda: _make_whole(curved.whole))
    if curved is curved.whole:
        return whole

    made = Made(CurvedStructure)
    made.structure = CurvedStructure.from_buffer_copy(whole.structure)
    made.keep(whole)
    made.point("normal_row", curved.normal_row, np.int64)
    made.point("lower", LOWER[curved.degree], float)

    return made


def growing_trees(layer: Layer) -> Pauses[None]:
    """Make the trees that every ray asks for in a layer."""
    if layer.has_engine and has_face_tree(layer):
        yield from making_face_tree(layer)
        yield 0
    if layer.curved is not None:
        yield from making_hull(layer.asked)
        yield 0


def growing_faces(layer: Layer, made: Made) -> Pauses[None]:
    """Let a layer point to the tree over its faces, which is made if need be."""
    tree, facets = yield from making_face_tree(layer)
    made.set(over_faces=tree.structure)
    made.point("facets", facets, float)
    made.keep(tree)


def make_layer(held: PlannedLayer, part: Ints) -> Made:
    """A layer with its triangles' numbers in the plan, and the bits of its solids.

    part : (t,) of all triangles of the plan
    """
    made = Made(LayerStructure)
    layer = held.layer
    frames = layer.frames
    curved = layer.curved
    made.point("frames", frames_of(frames), float)
    made.point("numbers", held.numbers, np.int64)
    made.point("closed_bits", held.closed_bits, np.uint64)
    made.point("solid_bits", held.solid_bits, np.uint64)

    if layer.motion is not None:
        made.point("rotation", layer.motion.rotation, float)
        made.set(shift=layer.motion.shift)

    own = part[held.numbers]
    made.set(
        n_triangles=layer.n_triangles,
        only_part=own[0] if (own == own[0]).all() else -1,
        low=layer.bounds[0],
        high=layer.bounds[1],
        centre=layer.centre,
        radius=layer.radius,
        tolerance=layer.tolerance,
        has_engine=layer.has_engine,
        n_starts=count_starts(layer.n_triangles),
    )

    if layer.has_engine and has_face_tree(layer):
        finish(growing_faces(layer, made))

    if curved is not None:
        faces = _make_curved(curved)
        hull = finish(making_hull(layer.asked))
        made.set(curved=ctypes.addressof(faces.structure), hull=ctypes.addressof(hull.structure))
        made.keep(faces, hull)

    return made


FOR_EVER = 1 << 31  # events
LAST_KIND = 5  # of those in kiriko.h: numpy follows rays that may meet others
LAYOUTS = "crossed", "holes", "radial"
_plans: "WeakKeyDictionary[Plan, Made | None]" = WeakKeyDictionary()


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


def left_out(layers: Sequence[PlannedLayer], kind: Ints) -> str | None:
    """Why the kernel does not follow rays in a plan of these layers and parts of kinds (p,); None
    where it does.
    """
    return Message("it is not there") if library() is None else _unknown(layers, kind)


def _unknown(layers: Sequence[PlannedLayer], kind: Ints) -> str | None:
    if len(layers) > MOST_LAYERS:
        return Message("more than {n} layers", n=MOST_LAYERS)
    if kind.max() > LAST_KIND or any(
        type(held.layer) is not Layer or type(held.layer.curved) not in (CurvedFaces, type(None))
        for held in layers
    ):
        return Message("faces of another kind")
    return None


def _make_plan(plan: Plan) -> Made | None:
    if _unknown(plan.layers, plan.parts.kind) is not None:
        return None

    made = Made(PlanStructure)
    _point_to_tables(made, plan)
    _point_to_elements(made, plan)
    _point_to_layers(made, plan)
    settings = plan.settings
    display = plan.rig.display
    plane = plan.display.plane
    made.set(
        n_triangles=len(plan.triangles),
        merge_distance=plan.merge_distance,
        max_events=min(settings.max_events, FOR_EVER),
        only_through_glass=bool(settings.only_through_glass),
        needs_plate=plan.needs_plate,
        looks_beside=bool(settings.looks_beside),
        brightness=bool(settings.brightness),
        has_plane=plane is not None,
        is_by_glass=plan.display.is_by_glass,
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


def _point_to_tables(made: Made, plan: Plan) -> None:
    """Let a plan point to its tables of triangles and parts, media and boxes."""
    for table, columns in ((plan.triangles, OF_TRIANGLES), (plan.parts, OF_PARTS)):
        for name, dtype in columns.items():
            made.point(name, getattr(table, name), dtype)

    made.point("indices", plan.media.indices, float)
    made.point("open_part", np.array([part.number for part in plan.open_parts]), np.int64)
    open_boxes = np.array([part.box for part in plan.open_parts]).reshape(-1, 2, 3)
    made.point("open_box", open_boxes, float)
    made.point("aside_box", plan.aside.boxes, float)
    made.point("display_uv", plan.rig.display.mesh.uv, float)
    made.set(n_open=len(plan.open_parts), n_aside=len(plan.aside.boxes))


# of elements that an interaction of the kernel reads; the others are NULL to it
ELEMENTS = {ArrayFrame: _make_array}


def _point_to_elements(made: Made, plan: Plan) -> None:
    """Let a plan point to the numbers of each part."""
    addresses = np.zeros(len(plan.parts), np.uintp)
    for number, element in enumerate(plan.parts.elements):
        if type(element) in ELEMENTS:
            one = ELEMENTS[type(element)](element)
            made.keep(one)
            addresses[number] = ctypes.addressof(one.structure)
    made.point("elements", addresses, np.uintp)


def _point_to_layers(made: Made, plan: Plan) -> None:
    """Let a plan point to its layers, and to the order in which they are asked."""
    layers = [make_layer(held, plan.triangles.part) for held in plan.layers]
    structures = (LayerStructure * len(layers))(*(layer.structure for layer in layers))
    made.keep(layers, structures)
    made.layers = layers
    made.set(n_layers=len(layers), layers=ctypes.addressof(structures))
    # glass comes first: most of what else there is lies beyond, and then need not be asked
    order = np.argsort([not held.layer.has_engine for held in plan.layers], kind="stable")
    made.point("order", order, np.int64)


def making(plan: Plan) -> Pauses[None]:
    """Make a plan ready as `made_of` does, but with pauses."""
    if plan not in _plans and left_out(plan.layers, plan.parts.kind) is None:
        for held in plan.layers:
            yield from growing_trees(held.layer)


def making_whole(plan: Plan) -> Pauses[None]:
    """Make the trees that only lost rays ask for, and let a plan that is made point to them."""
    made = made_of(plan)
    structures = (LayerStructure * len(made.layers)).from_address(made.structure.layers)
    for number, (held, layer) in enumerate(zip(plan.layers, made.layers, strict=True)):
        if held.layer.has_engine and not layer.structure.over_faces.nodes:
            yield from growing_faces(held.layer, layer)
            structures[number] = layer.structure


def is_whole(made: Made) -> bool:
    """Has a plan all trees that any ray may ask for?"""
    return all(
        layer.structure.over_faces.nodes or not layer.structure.has_engine for layer in made.layers
    )


def made_of(plan: Plan) -> Made | None:
    """A plan as the kernel reads it, made once; None where it does not know it."""
    return kept(_plans, plan, lambda: _make_plan(plan))
