"""Compiles a rig into a plan: numbers its parts and groups solids into layers for hit tests.

Only the data its parts require is built.
"""

from collections.abc import Callable
from functools import cache, partial

import numpy as np

from ..base.arrays import FLOAT32, Bools, Floats, Ints
from ..base.errors import RigError
from ..base.fingerprint import fingerprint
from ..base.messages import Message
from ..base.steps import Steps, run_steps
from ..glass.bounding_shell import bounding_shell_steps
from ..glass.curved import CurvedFaces
from ..glass.surfaces import Surface
from ..rig.rig import Display, Kind, Rig
from ..rig.settings import Settings
from .display import DisplayPlane, absorbing_axes, display_plane
from .engines import engine_kind
from .interaction_display import NEAR
from .kernel_tracer import Kernel
from .media import Media, boxes_touch, find_touching, grown, make_media
from .mesh_cache import MeshCache
from .near_misses import Packing, ThinParts
from .plan import DeferredObjects, OpenPart, Plan, PlannedDisplay, PlannedLayer
from .plate import ArrayFrame
from .ray_engine import FEW_TRIANGLES, Layer
from .rig_parts import (
    RigParts,
    find_clear,
    read_solids,
    read_thin_surfaces,
)
from .trace import EventByEvent

TRACERS = Kernel(), EventByEvent()  # fastest first; the last traces any plan
MOST_COPIES = 7  # of a ray, if parts split rays: 2^3 paths in all, each by up to three splits
MOST_UNLIKE = 1e4  # ratio of a layer's extent to the size of its smallest part


def colour(touch: np.ndarray) -> Ints:
    """Greedy colours (n,) such that parts that touch differ."""
    colours = np.full(len(touch), -1)
    for i in range(len(touch)):
        taken = set(colours[touch[i] & (np.arange(len(touch)) != i)].tolist())
        colours[i] = next(c for c in range(len(touch) + 1) if c not in taken)
    return colours


def are_unlike(boxes: Floats) -> Bools:
    """Pairs of boxes (n, 2, 3) whose common extent is too large for float32 to resolve the smaller
    one: (n, n).
    """
    together = np.maximum(boxes[:, None, 1], boxes[None, :, 1]) - np.minimum(
        boxes[:, None, 0], boxes[None, :, 0]
    )
    size = np.ptp(boxes, axis=1).max(axis=1)
    return together.max(axis=2) > MOST_UNLIKE * np.minimum(size[:, None], size[None])


def group_parts(surfaces: list[Surface], touch: Bools) -> list[list[int]]:
    """Group parts into layers: one for each part with few faces, the others by colour, so that
    parts in a layer do not touch (p, p).
    """
    small = [i for i, surface in enumerate(surfaces) if len(surface.corners) <= FEW_TRIANGLES]
    if len(small) > FEW_TRIANGLES:  # an engine is faster for many boxes and panels
        small = []

    rest = [i for i in range(len(surfaces)) if i not in small]
    groups = [[i] for i in small]

    if rest:
        boxes = np.stack([surfaces[i].bounds for i in rest])
        colours = colour(touch[np.ix_(rest, rest)] | are_unlike(boxes))
        groups += [
            [rest[k] for k in np.flatnonzero(colours == c)] for c in range(colours.max() + 1)
        ]

    return groups


def layer_steps(surfaces: list[Surface]) -> Steps[Layer]:
    """Make the layer of several surfaces, with pauses."""
    corners, curved = surfaces[0].corners, surfaces[0].curved
    if len(surfaces) > 1:
        of_each = [surface.corners for surface in surfaces]
        corners = np.concatenate(of_each)
        curved = CurvedFaces.join([surface.curved for surface in surfaces], of_each)

    shell = None if curved is None else (yield from bounding_shell_steps(curved))
    yield 0
    return Layer(corners, curved, shell)


def triangles_of_boxes(boxes: Floats) -> Floats:
    """Triangles (12 b, 3, 3) of boxes (b, 2, 3)."""
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([half for a, b, c, d in quads for half in ((a, b, c), (a, c, d))])
    corners = np.where(corner[None], boxes[:, 1:], boxes[:, :1])
    return corners[:, triangles].reshape(-1, 3, 3)


def compile_plan(
    rig: Rig,
    settings: Settings,
    mesh_cache: MeshCache | None = None,
    deferred: tuple[int, ...] = (),
) -> Plan:
    """Check a rig and compile it, as `compile_plan_steps`."""
    rig.check()
    return run_steps(compile_plan_steps(rig, settings, mesh_cache, deferred))


def compile_plan_steps(
    rig: Rig,
    settings: Settings,
    mesh_cache: MeshCache | None = None,
    deferred: tuple[int, ...] = (),
) -> Steps[Plan]:
    """Compile a checked rig into a plan.

    Parameters
    ----------
    mesh_cache : solids and layers of an earlier plan, reused if unchanged
    deferred : numbers of glasses to leave out until a ray comes near; tracing such a ray raises
        rays.DeferredObjectError

    Raises
    ------
    RigError, MeshError
        One sentence on the fault of the rig.
    """
    is_polarised, rig = rig.is_polarised, rig.joined
    mesh_cache = mesh_cache or MeshCache()
    settings = settings.for_rig(rig)
    deferred_boxes = grown(
        np.array([rig.glasses[i].mesh.bounds for i in deferred]).reshape(-1, 2, 3)
    )
    parts = RigParts(
        (yield from read_solids(rig, mesh_cache, deferred)), read_thin_surfaces(rig, mesh_cache)
    )
    solids = [solid.surface for solid in parts.solids]

    # positions are float32: glass faces closer than the rounding error touch
    boxes = np.stack([surface.bounds for surface in parts.surfaces])
    touching = 2 * FLOAT32 * float(np.abs(boxes[: len(solids)]).max(initial=0.0))
    touch = find_touching(parts.solids, parts.surfaces, parts.is_closed, touching)
    yield 0
    colours = settings.colours if settings.brightness else None
    media = make_media(parts.solids, touch, settings.wavelength, colours)
    layers = yield from _make_layers(parts, media, touch, mesh_cache)
    thin_parts = _thin_parts_getter(parts, deferred_boxes, mesh_cache)
    key = f"plane of {parts.sheets[-1].key}, {rig.display.width} x {rig.display.height}"
    plane = mesh_cache.get(key, lambda: display_plane(rig.display, parts.surfaces[-1]))
    _check_views(rig.display, plane)
    mesh_cache.forget()
    yield 0

    is_clear = find_clear(parts.surfaces, parts.kind, deferred_boxes) & (plane is not None)
    absorbing = absorbing_axes(rig.display, parts.surfaces[-1]) if is_polarised else None
    features = _features(parts, layers, media, is_clear, settings, is_polarised)
    merge_distance = max(touching, 1e-12 * float(np.ptp(boxes.reshape(-1, 3), axis=0).max()))
    by_display = boxes_touch(boxes, NEAR * merge_distance)[-1, : len(solids)]
    _check_reflecting(parts, by_display, plane, merge_distance)

    return Plan(
        rig=rig,
        settings=settings,
        viewer=rig.viewers[0],
        triangles=parts.triangles,
        parts=parts.table(rig, media, is_clear),
        open_parts=tuple(
            OpenPart(i, grown(solid.bounds)) for i, solid in enumerate(solids) if solid.n_open
        ),
        media=media,
        layers=layers,
        thin_parts=thin_parts,
        display=PlannedDisplay(int(parts.starts[-2]), plane, bool(by_display.any()), absorbing),
        deferred=DeferredObjects(deferred, deferred_boxes),
        merge_distance=merge_distance,
        used=tuple(name for name, is_used in features.items() if is_used),
        left_out=(
            *(name for name, is_used in features.items() if not is_used),
            *(
                Message("'{glass}' (no light comes near it)", glass=rig.glasses[i].name)
                for i in deferred
            ),
        ),
        counts=parts.counts(rig),
        tracers=TRACERS,
        n_copies=MOST_COPIES * any(part.splits for _, part in rig.parts()),
    )


def _check_views(display: Display, plane: DisplayPlane | None) -> None:
    """Raise RigError for a display with views that is not flat: directions need one frame."""
    if display.views is not None and plane is None:
        raise RigError(
            "The display '{display}' has views but is not one flat rectangle under its image: use"
            " a plane with a UV map that fills the image, or turn its Views off.",
            display=display.name,
        )


def _check_reflecting(
    parts: RigParts, by_display: Bools, plane: DisplayPlane | None, merge_distance: float
) -> None:
    """Raise RigError for reflecting glass that touches the display, among solids (s,) near it."""
    for solid, is_near in zip(parts.solids, by_display, strict=True):
        if is_near and solid.glass.reflects and _lies_on(solid.surface, plane, merge_distance):
            raise RigError(
                "The glass '{glass}' touches the display, where its reflection has no path: leave a"
                " gap, or turn off Use Reflection.",
                glass=solid.glass.name,
            )


def _lies_on(solid: Surface, plane: DisplayPlane | None, merge_distance: float) -> bool:
    """Whether a face of a solid is in the plane of a flat display; True for a bent display."""
    if plane is None:
        return True
    height = np.abs((solid.corners - plane.corner) @ plane.normal)
    return bool((height <= NEAR * merge_distance).all(axis=1).any())


def _make_layers(
    parts: RigParts, media: Media, touch: Bools, mesh_cache: MeshCache
) -> Steps[tuple[PlannedLayer, ...]]:
    """Make the layers and their contents; solids moved by one motion are moved together."""
    layers = []
    n_solids = len(parts.solids)

    for group in group_parts(parts.surfaces, touch):
        # its triangles, in place or before the motion
        motions = [parts.solids[i].motion if i < n_solids else None for i in group]
        motion = motions[0] if all(other is motions[0] for other in motions) else None
        if motion is not None:
            members = [parts.solids[i].made for i in group]
            names = [parts.solids[i].key for i in group]
        else:
            members = [parts.surfaces[i] for i in group]
            names = [parts.keys[i] for i in group]

        layer = yield from mesh_cache.get_steps("+".join(names), partial(layer_steps, members))
        yield 0

        # bits of its solids in the masks of their clusters
        solid = [i for i in group if i < n_solids]
        closed, every = np.zeros((2, media.cluster.max(initial=0) + 1), np.uint64)
        np.bitwise_or.at(closed, media.cluster[solid], media.bit[solid] * parts.is_closed[solid])
        np.bitwise_or.at(every, media.cluster[solid], media.bit[solid])
        layers.append(
            PlannedLayer(
                layer=layer if motion is None else layer.moved(motion),
                numbers=np.concatenate([np.arange(*parts.starts[i : i + 2]) for i in group]),
                closed_bits=closed,
                solid_bits=every if len(solid) == len(group) else None,
            )
        )

    return tuple(layers)


def _thin_parts_getter(
    parts: RigParts, deferred_boxes: Floats, mesh_cache: MeshCache
) -> Callable[[], ThinParts]:
    """A function that returns the triangles and the boxes (a, 2, 3) of deferred glass, for
    near-miss tests.
    """
    walls = triangles_of_boxes(deferred_boxes)
    number = np.repeat(np.arange(len(deferred_boxes)), 12)  # each box is a patch and a part
    deferred = fingerprint(walls)
    made = "+".join([*(solid.key for solid in parts.solids), *(one.key for one in parts.sheets)])
    packing = mesh_cache.get(f"packing of {made}+{deferred}", Packing)

    def find() -> ThinParts:
        corners = parts.joined("corners")
        return ThinParts(
            np.concatenate([corners, walls]),
            np.concatenate([parts.patch, number + len(corners)]),
            np.concatenate([parts.part, number + len(parts.surfaces)]),
            packing,
        )

    return mesh_cache.get("boxes of " + "+".join([*parts.keys, deferred]), lambda: cache(find))


def _features(
    parts: RigParts,
    layers: tuple[PlannedLayer, ...],
    media: Media,
    is_clear: Bools,
    settings: Settings,
    is_polarised: bool,
) -> dict[str, bool]:
    """Features a plan may use, by name, and whether this one does.

    The compiled kernel's name includes the reason if it is not used, the ray engine's its kind if
    it is.

    is_clear : (p, 2) light beyond a plate can only meet the display
    """
    is_plate = parts.kind == Kind.PLATE
    no_kernel = TRACERS[0].left_out(layers, parts.kind, is_polarised)
    has_engine = any(planned.layer.has_engine for planned in layers) and no_kernel is not None
    kernel, engine = Message("compiled kernel"), Message("ray engine")
    if no_kernel:
        kernel = Message("{name} ({reason})", name=kernel, reason=no_kernel)
    if has_engine:
        engine = Message("{name} ({reason})", name=engine, reason=engine_kind().name)
    return {
        kernel: no_kernel is None,
        engine: has_engine,
        Message("curved faces"): any(s.curved is not None for s in parts.surfaces),
        Message("bent normals"): any(s.corner_normals is not None for s in parts.surfaces),
        Message("overlapping media"): media.n_overlapping > 0,
        Message("mirror array"): any(isinstance(one, ArrayFrame) for one in parts.elements),
        Message("light beyond the plate"): not is_clear[is_plate].any(axis=1).all(),
        Message("Fresnel"): settings.brightness,
        Message("absorption"): media.absorptions is not None,
        Message("polarisation"): is_polarised,
        Message("views of the display"): parts.sheets[-1].part.views is not None,
    }
