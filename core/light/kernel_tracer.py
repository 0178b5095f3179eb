"""The compiled kernel as a tracer: follows rays to their ends and bisects edges, one by one.

It accesses plans, layers and rays through pointers to numpy's arrays.
"""

import ctypes
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import get_args
from weakref import WeakKeyDictionary

import numpy as np

from ..base.arrays import Floats, Ints, take
from ..base.messages import Message
from ..base.steps import Steps, run_steps
from ..glass.curved import CurvedFaces
from ..glass.paraboloids import Paraboloids
from ..glass.quartics import LOWER, TO_BEZIER
from ..native.loading import MOST_LAYERS, library, loaded, n_threads
from ..native.structures import (
    ArrayStructure,
    CurvedStructure,
    HalvingStructure,
    LayerStructure,
    LensStructure,
    Made,
    PlanStructure,
    RayStateStructure,
    SplitStructure,
)
from ..rig.rig import Glass, HalfMirror, Preference, Viewer
from .interaction_lens import LensFrame
from .kernel_trees import cached, face_tree_steps, frames_of, has_face_tree, shell_tree_steps
from .layer_hits import count_starts
from .plan import Ends, Halving, Plan, PlannedLayer
from .plate import ArrayFrame
from .ray_engine import Layer
from .rays import DeferredObjectError, Rays, Step
from .trace import by_events

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
    made.set(n_quartics=len(curved.coefficients))
    if isinstance(curved, Paraboloids):
        made.point("corner_normals", curved.corner_normals, float)
    return made


def _make_curved(curved: CurvedFaces) -> Made:
    whole = cached(_faces, curved.whole, lambda: _make_whole(curved.whole))
    if curved is curved.whole:
        return whole

    made = Made(CurvedStructure)
    made.structure = CurvedStructure.from_buffer_copy(whole.structure)
    made.keep(whole)
    made.point("normal_row", curved.normal_row, np.int64)
    made.point("lower", LOWER[curved.degree], float)

    return made


def tree_steps(layer: Layer) -> Steps[None]:
    """Make the trees that every ray needs in a layer."""
    if layer.has_engine and has_face_tree(layer):
        yield from face_tree_steps(layer)
        yield 0
    if layer.curved is not None:
        yield from shell_tree_steps(layer.engine_triangles)
        yield 0


def point_to_face_tree(layer: Layer, made: Made) -> Steps[None]:
    """Point a layer to the tree over its faces, made if necessary."""
    tree, facets = yield from face_tree_steps(layer)
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
        low=layer.bounds[0] - layer.tolerance,
        high=layer.bounds[1] + layer.tolerance,
        centre=layer.centre,
        radius=layer.radius,
        tolerance=layer.tolerance,
        has_engine=layer.has_engine,
        n_starts=count_starts(layer.n_triangles),
    )

    if layer.has_engine and has_face_tree(layer):
        run_steps(point_to_face_tree(layer, made))

    if curved is not None:
        faces = _make_curved(curved)
        triangles = run_steps(shell_tree_steps(layer.engine_triangles))
        made.set(
            curved=ctypes.addressof(faces.structure),
            engine_triangles=ctypes.addressof(triangles.structure),
        )
        made.keep(faces, triangles)

    return made


FOR_EVER = 1 << 31  # events
# as in kiriko.h; plans with other kinds are left to numpy
KINDS = range(8)
LAYOUTS = "crossed", "holes", "radial"
UNSUPPORTED = Message("unsupported parts")
_plans: "WeakKeyDictionary[Plan, Made | None]" = WeakKeyDictionary()
_layers: "WeakKeyDictionary[PlannedLayer, Made]" = WeakKeyDictionary()


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


def left_out(layers: Sequence[PlannedLayer], kind: Ints, is_polarised: bool = False) -> str | None:
    """Why the kernel cannot trace a plan of these layers and parts of kinds (p,); None if it
    can.
    """
    if library() is None:
        return Message("not available")
    return _unsupported(layers, kind, is_polarised)


def _unsupported(layers: Sequence[PlannedLayer], kind: Ints, is_polarised: bool) -> str | None:
    if is_polarised:
        return Message("polarisation")
    if len(layers) > MOST_LAYERS:
        return UNSUPPORTED
    return None if set(KINDS).issuperset(kind.tolist()) else UNSUPPORTED


def _make_plan(plan: Plan) -> Made | None:
    if _unsupported(plan.layers, plan.parts.kind, plan.is_polarised) is not None:
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
        has_glass=plan.has_glass,
        only_through_glass=bool(settings.only_through_glass and plan.has_glass),
        needs_plate=plan.needs_plate,
        looks_beside=bool(settings.looks_past_glass),
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


# columns of a plan's tables, and their types in the kernel
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
    """Point a plan to its tables of triangles, parts, media and boxes."""
    for table, columns in ((plan.triangles, OF_TRIANGLES), (plan.parts, OF_PARTS)):
        for name, dtype in columns.items():
            made.point(name, getattr(table, name), dtype)

    made.point("indices", plan.media.indices, float)
    made.point("absorptions", plan.media.absorptions, float)
    made.point("open_part", np.array([part.number for part in plan.open_parts]), np.int64)
    open_boxes = np.array([part.box for part in plan.open_parts]).reshape(-1, 2, 3)
    made.point("open_box", open_boxes, float)
    made.point("deferred_box", plan.deferred.boxes, float)
    made.point("display_uv", plan.rig.display.mesh.uv, float)
    made.set(n_open=len(plan.open_parts), n_deferred=len(plan.deferred.boxes))


def _make_split(element: HalfMirror | Glass) -> Made | None:
    if not element.splits:
        return None
    made = Made(SplitStructure)
    made.set(prefers=get_args(Preference).index(element.prefers))
    if isinstance(element, HalfMirror):
        made.set(reflectance=element.reflectance, transmittance=element.transmittance)
    return made


def _make_lens(frame: LensFrame) -> Made:
    made = Made(LensStructure)
    made.set(centre=frame.centre, focal_length=frame.focal_length)
    return made


# element types read by the kernel; NULL for others
ELEMENTS = {
    ArrayFrame: _make_array,
    Glass: _make_split,
    HalfMirror: _make_split,
    LensFrame: _make_lens,
}


def _point_to_elements(made: Made, plan: Plan) -> None:
    """Point a plan to the data of each part."""
    addresses = np.zeros(len(plan.parts), np.uintp)
    for number, element in enumerate(plan.parts.elements):
        if type(element) in ELEMENTS:
            one = ELEMENTS[type(element)](element)
            if one is not None:
                made.keep(one)
                addresses[number] = ctypes.addressof(one.structure)
    made.point("elements", addresses, np.uintp)


def _point_to_layers(made: Made, plan: Plan) -> None:
    """Point a plan to its layers, and to the order in which they are searched."""
    part = plan.triangles.part
    layers = [cached(_layers, held, partial(make_layer, held, part)) for held in plan.layers]
    structures = (LayerStructure * len(layers))(*(layer.structure for layer in layers))
    made.keep(layers, structures)
    made.layers = layers
    made.set(n_layers=len(layers), layers=ctypes.addressof(structures))
    # glass first: most other parts lie beyond it and can then be skipped
    order = np.argsort([not held.layer.has_engine for held in plan.layers], kind="stable")
    made.point("order", order, np.int64)


def prepare_steps(plan: Plan) -> Steps[None]:
    """Make a plan's trees as `made_of` does, with pauses."""
    what = plan.layers, plan.parts.kind, plan.is_polarised
    if plan not in _plans and left_out(*what) is None:
        for held in plan.layers:
            yield from tree_steps(held.layer)


def plan_steps(plan: Plan) -> Steps[None]:
    """Make the trees needed only by lost rays, and point an existing kernel plan to them."""
    made = made_of(plan)
    structures = (LayerStructure * len(made.layers)).from_address(made.structure.layers)
    for number, (held, layer) in enumerate(zip(plan.layers, made.layers, strict=True)):
        if held.layer.has_engine and not layer.structure.over_faces.nodes:
            yield from point_to_face_tree(held.layer, layer)
            structures[number] = layer.structure


def is_whole(made: Made) -> bool:
    """Whether a plan has every tree a ray may need."""
    return all(
        layer.structure.over_faces.nodes or not layer.structure.has_engine for layer in made.layers
    )


def made_of(plan: Plan) -> Made | None:
    """A plan in the kernel's form, cached; None if the kernel cannot trace it."""
    return cached(_plans, plan, lambda: _make_plan(plan))


# events, rays and edges between two pauses: less than 0.1 s of work
EVENTS_AT_ONCE = 1 << 16
LEAST_AT_ONCE = 64
LEAST_EDGES_AT_ONCE = 8
# bytes of a batch's paths or courses; larger batches are recorded by numpy
MOST_RECORDED = 1 << 26
PLACE, WORD = 32, 8  # bytes of an event of a ray, in its path and in its course

LIGHTS = "imaged", "folded", "reflected"
STATE = {  # arrays of rays.py's Rays, which the kernel reads and writes in place
    **dict.fromkeys(("positions", "directions", "xy", "throughput", "absorption"), np.float64),
    **dict.fromkeys(("mask", "branch"), np.uint64),
    **dict.fromkeys(
        ("cluster", "n_events", "rank", "n_splits", "last_part", "leak", "n_words"), np.int64
    ),
    **dict.fromkeys(("reason", "plate_path"), np.uint8),
    **dict.fromkeys(("has_met_glass", "has_met_plate", "is_astray", "has_ended"), np.bool_),
    "is_begun": np.bool_,
}


@dataclass(frozen=True, eq=False)
class RecordedPaths:
    """Recorded paths of n rays, m events at most.

    places : (m, n, 3) m
    met : (m, n) triangle numbers + 1, 0 after the last
    left_at : (n,) the event at which a ray left without a hit, -1 if it ended otherwise
    """

    places: Floats
    met: Ints
    left_at: Ints

    @classmethod
    def none(cls, n: int, m: int) -> "RecordedPaths":
        """Empty paths."""
        # most rays have few events, so most of the zeros are never touched
        return cls(np.empty((m, n, 3)), np.zeros((m, n), np.int64), np.full(n, -1, np.int64))

    def begin_again(self, some: Ints) -> None:
        """Reset the paths of some rows."""
        self.met[:, some] = 0
        self.left_at[some] = -1


def state_of(
    rays: Rays, paths: RecordedPaths | None = None, is_reached: np.ndarray | None = None
) -> Made:
    """The state of rays as the kernel reads and writes it."""
    made = Made(RayStateStructure)
    for name, dtype in STATE.items():
        given = getattr(rays, name)
        if given.dtype != dtype or not given.flags.c_contiguous:
            raise TypeError(f"{name} is no array of {np.dtype(dtype)} in one piece")
        made.point(name, given, dtype)

    if rays.course is not None:
        rays.course = made.point("course", rays.course, np.uint64)
        made.set(width=rays.course.shape[1])

    if paths is not None:
        made.point("places", paths.places, float)
        made.point("met", paths.met, np.int64)
        made.point("left_at", paths.left_at, np.int64)
        made.set(n_rays=paths.met.shape[1], n_steps=len(paths.met))

    made.point("is_reached", is_reached, np.uint8)
    made.set(n_asked=rays.n_originals, n_copies=rays.n_copies)
    made.set(is_recorded=rays.is_recorded, light=LIGHTS.index(rays.light))
    return made


class Kernel:
    """Follows rays with the compiled kernel, and bisects edges."""

    left_out = staticmethod(left_out)

    def rays_at_once(self, plan: Plan, most: int) -> int:
        """Number of rays, up to `most`, to follow at once when paths or courses are recorded."""
        bytes_of_ray = PLACE * (plan.settings.max_events + 1) * (1 + plan.n_copies)
        return min(most, max(1, MOST_RECORDED // bytes_of_ray))

    def follow(self, plan: Plan, rays: Rays, steps: list[Step] | None = None) -> Steps[None]:
        """Follow live rays to their ends."""
        yield from prepare_steps(plan)
        has_paths = steps is not None
        per_event = PLACE * has_paths + WORD * rays.is_recorded
        n_bytes = len(rays.mask) * per_event * (plan.settings.max_events + 1)
        if n_bytes > MOST_RECORDED or (plan.scatters and rays.light != "imaged"):
            yield from by_events(plan, rays, steps)
            return

        n = len(rays.live)
        n_events = plan.settings.max_events
        if rays.is_recorded:
            rays.course = np.zeros((len(rays.mask), n_events + 1), np.uint64)

        paths = RecordedPaths.none(len(rays.mask), n_events) if has_paths else None

        is_reached = np.zeros(len(plan.deferred.boxes), np.uint8)
        made = state_of(rays, paths, is_reached)
        is_unready = made.point("is_unready", np.zeros(1, np.uint8), np.uint8)
        of_plan = made_of(plan)
        structures = ctypes.addressof(of_plan.structure), ctypes.addressof(made.structure)

        kernel = loaded()
        at_once = max(LEAST_AT_ONCE, EVENTS_AT_ONCE // n_events)
        for first in range(0, n, at_once):
            last = min(first + at_once, n)
            some = slice(first, last)
            if not is_whole(of_plan):
                begun = rays.positions[some].copy(), rays.directions[some].copy()
                reached = is_reached.copy()
            kernel.kiriko_follow(*structures, first, last, n_threads())
            if is_unready[0]:
                # a ray was lost behind a bounding shell: repeat the batch with the tree over all
                # faces
                yield from plan_steps(plan)
                rays.begin_again(some, *begun)
                if paths is not None:
                    paths.begin_again(rays.rows_of(some))
                is_reached[:], is_unready[0] = reached, 0
                kernel.kiriko_follow(*structures, first, last, n_threads())
            yield last - first

        rays.live = rays.live[:0]
        if is_reached.any():
            raise DeferredObjectError(set(np.flatnonzero(is_reached).tolist()))
        if has_paths:
            steps += _steps_of(plan, rays, paths)

    def bisect(self, plan: Plan, edges: Halving) -> Steps[Ends]:
        """Bisect edges; yields the number of rays traced since the last yield.

        Raises
        ------
        DeferredObjectError : a ray comes near deferred glass
        """
        yield from prepare_steps(plan)
        n = len(edges.start)
        rays = Rays(np.zeros((n, 3)), np.zeros((n, 3)), edges.course, is_recorded=False)
        is_reached = np.zeros(len(plan.deferred.boxes), np.uint8)
        state = state_of(rays, None, is_reached)
        is_unready = state.point("is_unready", np.zeros(1, np.uint8), np.uint8)

        ends = Ends(*(np.array(values, order="C") for values in edges.begun))
        made = _made_of(plan.viewer, edges, ends)
        structures = [ctypes.addressof(one.structure) for one in (made_of(plan), state, made)]
        n_digits = max(1, int(np.ceil(-np.log2(edges.least))))
        at_once = max(LEAST_EDGES_AT_ONCE, EVENTS_AT_ONCE // (plan.settings.max_events * n_digits))

        for first in range(0, n, at_once):
            some = slice(first, min(first + at_once, n))
            loaded().kiriko_bisect(*structures, some.start, some.stop, n_threads())
            if is_unready[0]:
                # as in `follow`
                yield from plan_steps(plan)
                for values, before in zip(ends, edges.begun, strict=True):
                    values[some] = before[some]
                is_unready[0] = 0
                loaded().kiriko_bisect(*structures, some.start, some.stop, n_threads())
            yield int(ends.n_tried[some].sum())

        if is_reached.any():
            raise DeferredObjectError(set(np.flatnonzero(is_reached).tolist()))
        return ends


def _steps_of(plan: Plan, rays: Rays, paths: RecordedPaths) -> Iterator[Step]:
    """The rays at each event, from their recorded paths."""
    for event, (places, met) in enumerate(zip(paths.places, paths.met, strict=True)):
        some = np.flatnonzero(met)
        left = np.flatnonzero(paths.left_at == event)
        if not len(some) + len(left):
            return

        triangle = met[some] - 1
        yield Step(
            rays=some,
            place=take(places, some),
            patch=plan.triangles.patch[triangle],
            triangle=triangle,
            left=left,
            start=take(rays.positions, left),
            direction=take(rays.directions, left),
        )


def _made_of(viewer: Viewer, edges: Halving, ends: Ends) -> Made:
    """Edges as the kernel reads them, and their ends, which it writes in place."""
    made = Made(HalvingStructure)
    made.point("start", edges.start, float)
    made.point("way", edges.way, float)
    made.point("branch", edges.branch, np.uint64)
    for name, values in zip(Ends._fields, ends, strict=True):
        made.point(name, values, values.dtype)

    made.set(
        least=edges.least,
        position=viewer.position,
        axes=viewer.axes,
        window=np.array(viewer.window, float),
        size=np.array([viewer.width, viewer.height], float),
        is_orthographic=viewer.projection == "orthographic",
    )
    return made
