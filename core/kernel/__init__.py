"""The compiled kernel: follows rays to their ends as `trace.py` does, one by one instead of event by event.

It is a small library in C (the sources beside this file), brought as a wheel called `kiriko_kernel` and loaded by
ctypes, which lets go of Python's lock during each call. numpy's way stays the reference, and takes the place of the
kernel where there is none, where the environment has KIRIKO_KERNEL=off, and for plans that the kernel does not know.
"""

import ctypes
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..curved import LOWER, STARTS, TO_BEZIER, CurvedFaces
from ..plate import ArrayFrame
from ..ray_engine import MANY_TRIANGLES, Layer
from ..rig import Floats, Ints
from ..steps import Pauses

if TYPE_CHECKING:
    from ..plan import Plan
    from ..trace import Step, _Rays

MODULE = "kiriko_kernel"
SWITCH = "KIRIKO_KERNEL"  # environment variable; "off" for numpy's way
ENDINGS = {"nt": "dll", "posix": "so"}  # by os.name; macOS takes any
MOST_LAYERS = 256
AT_ONCE = 1 << 13  # rays between two pauses: less than 0.1 s of work
MOST_RECORDED = 1 << 26  # bytes of a batch's ways or courses; beyond, they are recorded event by event by numpy
BEZIER_AT_ONCE = 1 << 14
SLACK = 4e-6  # of its size: so much is the box of a face larger than the face

_threads = 0  # as many as the machine has


def _structure(name: str, **fields: Any) -> type[ctypes.Structure]:
    """A structure of kiriko.h: fields in their order, each an `N` times a C type."""
    return type(name, (ctypes.Structure,), {"_fields_": list(fields.items())})


_P, _I, _D = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double

_Tree = _structure("_Tree", nodes=_P, items=_P)
_Curved = _structure(
    "_Curved",
    corners=_P, row=_P, coefficients=_P, neighbour=_P, neighbour_edge=_P, vertex=_P, vertex_normal=_P, normal_row=_P,
    normal_terms=_P, lower=_P, hull=_P, owner=_P, parts=_P, n_whole=_I, n_parts=_I, over_hull=_Tree,
)  # fmt: skip
_Layer = _structure(
    "_Layer",
    n_triangles=_I, frames=_P, numbers=_P, closed_bits=_P, solid_bits=_P, curved=_P,
    rotation=_P, shift=_D * 3, low=_D * 3, high=_D * 3, centre=_D * 3, radius=_D, tolerance=_D, has_engine=_I,
    n_starts=_I, over_faces=_Tree,
)  # fmt: skip
_Plan = _structure(
    "_Plan",
    normals=_P, corner_normals=_P, is_bent=_P, patch=_P, part=_P, kind=_P, cluster=_P, sheet=_P, is_closed=_P,
    is_clear=_P, bit=_P, index_row=_P, indices=_P, n_triangles=_I, n_open=_I, n_aside=_I, n_layers=_I, open_part=_P,
    open_box=_P, aside_box=_P, layers=_P, order=_P, merge_distance=_D, max_events=_I, only_through_glass=_I,
    brightness=_I, has_plane=_I, display_start=_I, plane_corner=_D * 3, plane_normal=_D * 3, plane_pixels=_D * 6,
    plane_origin=_D * 2, display_uv=_P, display_size=_D * 2,
)  # fmt: skip
_RayState = _structure(
    "_RayState",
    n=_I, positions=_P, directions=_P, mask=_P, cluster=_P, reason=_P, branch=_P, xy=_P, throughput=_P, n_events=_P,
    has_met_glass=_P, has_met_plate=_P, plate_path=_P, last_part=_P, leak=_P, course=_P, width=_I, is_recorded=_I,
    is_imaged=_I, n_words=_P, is_astray=_P, has_ended=_P, n_steps=_I, places=_P, met=_P, left_at=_P, is_reached=_P,
)  # fmt: skip
NODE = np.dtype([("sides", np.float32, (6, 4)), ("first", np.int32, 4), ("count", np.int32, 4)])
STATE = (
    "positions directions mask cluster reason branch xy throughput n_events has_met_glass has_met_plate plate_path"
    " last_part leak n_words is_astray has_ended"
).split()


def use_threads(number: int) -> None:
    """Let the kernel have so many threads from now on; 0: as many as the machine has. Results are the same."""
    global _threads
    _threads = number


def _n_threads() -> int:
    return _threads or os.cpu_count() or 1


def find_library() -> Path | None:
    """The file of the library that the wheel brought; None where there is no such wheel."""
    spec = find_spec(MODULE)
    folders = (spec and spec.submodule_search_locations) or []
    return next((path for folder in folders for path in Path(folder).glob(f"*.{ENDINGS[os.name]}")), None)


@cache
def _load() -> ctypes.CDLL | None:
    path = find_library()
    if path is None:
        return None
    try:
        library = ctypes.CDLL(str(path))
    except OSError:  # made for another processor or system
        return None
    library.kiriko_layout.restype = _I
    structures = (_Tree, _Curved, _Layer, _Plan, _RayState)
    expected = [NODE.itemsize, *map(ctypes.sizeof, structures), MOST_LAYERS]
    if [library.kiriko_layout(_I(i)) for i in range(len(expected))] != expected:
        return None  # of another version
    library.kiriko_make_tree.restype = _I
    library.kiriko_make_tree.argtypes = [_I, _P, _P, _P]
    library.kiriko_follow.restype = None
    library.kiriko_follow.argtypes = [_P, _P, _I, _I, _I]
    return library


_is_off = False


@contextmanager
def off():
    """Within this context numpy's way is taken."""
    global _is_off
    before, _is_off = _is_off, True
    try:
        yield
    finally:
        _is_off = before


def library() -> ctypes.CDLL | None:
    """The library; None where it is not there, fits not, or is switched off."""
    return None if _is_off or os.environ.get(SWITCH) == "off" else _load()


class _Made:
    """A structure with the arrays that it points to."""

    def __init__(self, kind: type[ctypes.Structure]) -> None:
        self.structure = kind()
        self._kept: list[object] = []

    def keep(self, *others: object) -> None:
        self._kept += others

    def point(self, name: str, array: np.ndarray | None, dtype: DTypeLike) -> np.ndarray | None:
        """Let a field point to the values of an array, which stays where it is if it is fit to be pointed to."""
        if array is not None:
            array = np.ascontiguousarray(array, dtype)
            self.keep(array)
            setattr(self.structure, name, array.ctypes.data)
        return array

    def set(self, **values: object) -> None:
        for name, value in values.items():
            if isinstance(value, np.ndarray):
                value = dict(_fields(self.structure))[name](*value.ravel().tolist())
            setattr(self.structure, name, value)


def _fields(structure: ctypes.Structure) -> list[tuple[str, type]]:
    return structure._fields_


class _Boxes:
    """A tree over boxes (n, 2, 3), which are about 1 in size; items (n,) are which of them is at each position."""

    def __init__(self, boxes: Floats) -> None:
        boxes = np.ascontiguousarray(boxes, float)
        n = len(boxes)
        nodes, self.items = np.empty(n, NODE), np.empty(n, np.int32)
        n_nodes = library().kiriko_make_tree(n, boxes.ctypes.data, nodes.ctypes.data, self.items.ctypes.data)
        if not n_nodes:
            raise MemoryError
        self._nodes = nodes[:n_nodes].copy()
        self.structure = _Tree(self._nodes.ctypes.data, self.items.ctypes.data)


def _boxes(corners: NDArray[np.floating]) -> Floats:
    """Boxes (n, 2, 3) of triangles (n, 3, 3) or other sets of points."""
    return np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1)


def _grown(boxes: Floats) -> Floats:
    """Boxes (n, 2, 3) a little larger."""
    more = SLACK * np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1)
    boxes[:, 0] -= more[:, None]
    boxes[:, 1] += more[:, None]
    return boxes


def _face_boxes(layer: Layer) -> Floats:
    """Boxes (t, 2, 3) that hold a layer's faces, in units of its radius, from its centre."""
    boxes = _boxes(layer.corners)
    curved = layer.curved
    if curved is not None:
        triangle = curved.triangle
        for first in range(0, len(triangle), BEZIER_AT_ONCE):
            some = triangle[first : first + BEZIER_AT_ONCE]
            points = np.einsum("bt,tjn->nbj", TO_BEZIER, curved._load(some)) + curved.corners[some, :1]
            boxes[some] = _boxes(points)
    return _grown((boxes - layer.centre) / layer.radius)


_over_faces: WeakKeyDictionary[object, _Boxes] = WeakKeyDictionary()
_over_hull: WeakKeyDictionary[object, _Boxes] = WeakKeyDictionary()
_of_faces: WeakKeyDictionary[CurvedFaces, _Made] = WeakKeyDictionary()
_of_plans: "WeakKeyDictionary[Plan, _Made | None]" = WeakKeyDictionary()


def _kept(cache: WeakKeyDictionary, key: object, make: Callable[[], Any]) -> Any:
    if key not in cache:
        cache[key] = make()
    return cache[key]


def _make_curved(curved: CurvedFaces) -> _Made:
    made = _Made(_Curved)
    for name in ("corners", "coefficients", "vertex_normal"):
        made.point(name, getattr(curved, name), float)
    for name in ("row", "neighbour", "neighbour_edge", "vertex", "normal_row"):
        made.point(name, getattr(curved, name), np.int64)
    if curved.has_given_normals:
        made.point("normal_terms", curved.normal_terms, float)
    if curved.degree != 4:
        made.point("lower", LOWER[curved.degree], float)
    return made


def _make_layer(layer: Layer, numbers: Ints, closed: NDArray[np.uint64], solid: NDArray[np.uint64] | None) -> _Made:
    made = _Made(_Layer)
    frames, curved = layer.frames, layer.curved
    sides = (frames.corner, frames.normal, frames.axis_u, frames.axis_v)
    made.point("frames", np.stack(sides, axis=1), float)
    made.point("numbers", numbers, np.int64)
    made.point("closed_bits", closed, np.uint64)
    made.point("solid_bits", solid, np.uint64)
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
        n_starts=len(STARTS) if layer.n_triangles < MANY_TRIANGLES else 1,
    )
    if layer.has_engine:
        tree = _kept(_over_faces, frames if curved is None else curved, lambda: _Boxes(_face_boxes(layer)))
        made.keep(tree)
        made.structure.over_faces = tree.structure
    if curved is not None:
        asked = layer.asked
        faces = _kept(_of_faces, curved, lambda: _make_curved(curved))
        over_hull = _kept(_over_hull, asked, lambda: _Boxes(_grown(_boxes(asked.corners.astype(float)))))
        of_layer = _Made(_Curved)
        ctypes.pointer(of_layer.structure)[0] = faces.structure
        of_layer.point("hull", asked.corners[over_hull.items], np.float32)
        of_layer.point("owner", asked.owner, np.int64)
        of_layer.point("parts", asked.parts, float)
        of_layer.set(n_whole=asked.n_whole, n_parts=len(asked.parts), over_hull=over_hull.structure)
        made.keep(of_layer, faces, over_hull)
        made.structure.curved = ctypes.addressof(of_layer.structure)
    return made


def left_out(layers: Sequence[Layer], arrays: Mapping[int, ArrayFrame]) -> str | None:
    """Why the kernel does not follow rays in a plan of these layers and mirror arrays; None where it does."""
    if library() is None:
        return "it is not there"
    if arrays:
        return "mirror arrays"
    if len(layers) > MOST_LAYERS:
        return f"more than {MOST_LAYERS} layers"
    if any(type(layer) is not Layer or type(layer.curved) not in (CurvedFaces, type(None)) for layer in layers):
        return "faces of another kind"
    return None


def _make_plan(plan: "Plan") -> _Made | None:
    if left_out(plan.layers, plan.arrays) is not None:
        return None
    made = _Made(_Plan)
    display, settings, plane = plan.rig.display, plan.settings, plan.display_plane
    for name, dtype in (
        *(("normals", float), ("corner_normals", float), ("is_bent", np.uint8), ("patch", np.int64)),
        *(("part", np.int64), ("kind", np.int64), ("cluster", np.int64), ("sheet", np.int64)),
        *(("is_closed", np.uint8), ("is_clear", np.uint8), ("bit", np.uint64)),
    ):
        made.point(name, getattr(plan, name), dtype)
    made.point("index_row", plan.media.row, np.int64)
    made.point("indices", plan.media.indices, float)
    made.point("open_part", np.array([part for part, _ in plan.open_parts]), np.int64)
    made.point("open_box", np.array([box for _, box in plan.open_parts]).reshape(-1, 2, 3), float)
    made.point("aside_box", plan.aside_boxes, float)
    made.point("display_uv", display.mesh.uv, float)
    per_layer = zip(plan.layers, plan.layer_triangles, plan.layer_bits, plan.layer_solids, strict=True)
    layers = [_make_layer(*of_layer) for of_layer in per_layer]
    structures = (_Layer * len(layers))(*(layer.structure for layer in layers))
    made.keep(layers, structures)
    # glass comes first: most of what else there is lies beyond, and then need not be asked
    made.point("order", np.argsort([not layer.has_engine for layer in plan.layers], kind="stable"), np.int64)
    made.set(
        n_triangles=len(plan.part),
        n_open=len(plan.open_parts),
        n_aside=len(plan.aside_boxes),
        n_layers=len(layers),
        layers=ctypes.addressof(structures),
        merge_distance=plan.merge_distance,
        max_events=settings.max_events,
        only_through_glass=settings.only_through_glass,
        brightness=settings.brightness,
        has_plane=plane is not None,
        display_start=plan.display_start,
        display_size=np.array([display.width, display.height], float),
    )
    if plane is not None:
        made.set(
            plane_corner=plane.corner, plane_normal=plane.normal, plane_pixels=plane.pixels, plane_origin=plane.origin
        )
    return made


def can_follow(plan: "Plan", rays: "_Rays", is_wanted: bool) -> bool:
    """Can the kernel follow these rays, and write down their ways if that is wanted?"""
    if library() is None or _kept(_of_plans, plan, lambda: _make_plan(plan)) is None:
        return False
    per_event = 32 * is_wanted + 8 * rays.is_recorded
    return len(rays.live) * per_event * (plan.settings.max_events + 1) <= MOST_RECORDED


def follow(plan: "Plan", rays: "_Rays", is_wanted: bool) -> "Pauses[tuple[Ways | None, set[int]]]":
    """Follow rays to their ends, all of which are under way; pauses now and then.

    Returns their ways, if that is wanted, and numbers of the boxes of what stands aside that they came upon.
    """
    n, n_events = len(rays.live), plan.settings.max_events
    made = _Made(_RayState)
    for name in STATE:
        array = getattr(rays, name)
        made.point(name, array, array.dtype)
    if rays.is_recorded:
        rays.course = np.zeros((n, n_events + 1), np.uint64)
    if rays.course is not None:
        rays.course = made.point("course", rays.course, np.uint64)
        made.set(width=rays.course.shape[1])
    ways = Ways(n, n_events) if is_wanted else None
    if ways is not None:
        made.point("places", ways.places, float)
        made.point("met", ways.met, np.int64)
        made.point("left_at", ways.left_at, np.int64)
    is_reached = made.point("is_reached", np.zeros(len(plan.aside_boxes)), np.uint8)
    made.set(
        n=n, is_recorded=rays.is_recorded, is_imaged=rays.light == "imaged", n_steps=n_events if is_wanted else 0
    )
    of_plan = _of_plans[plan]
    structures = ctypes.addressof(of_plan.structure), ctypes.addressof(made.structure)
    for first in range(0, n, AT_ONCE):
        library().kiriko_follow(*structures, first, min(first + AT_ONCE, n), _n_threads())
        yield 0
    rays.live = rays.live[:0]
    return ways, set(np.flatnonzero(is_reached).tolist())


class Ways:
    """What n rays met: places (n, m, 3) and triangles met (n, m), -1 after the last; left_at (n,), the event at which
    a ray met nothing more, -1 where it ended otherwise.
    """

    def __init__(self, n: int, m: int) -> None:
        self.places = np.empty((n, m, 3))
        self.met = np.full((n, m), -1)
        self.left_at = np.full(n, -1)
