"""Layers as the kernel reads them: their triangles, curved faces and trees."""

import ctypes
from weakref import WeakKeyDictionary

import numpy as np

from ...base.arrays import Ints
from ...base.steps import Pauses, finish
from ...glass.curved import CurvedFaces
from ...glass.quartics import LOWER, TO_BEZIER
from ...native.structures import (
    CurvedStructure,
    LayerStructure,
    Made,
)
from ..layer_hits import count_starts
from ..plan import PlannedLayer
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
