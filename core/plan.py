"""What this rig needs, what it leaves out, and fingerprints of its parts."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import IntEnum
from functools import cache
from math import isqrt
from typing import Any, Literal, TypeVar, get_args

import numpy as np

from . import kernel
from .arrays import Bools, Floats, Ints
from .curved import CurvedFaces
from .display import DisplayPlane, display_plane, uv_islands
from .engines import engine_kind
from .errors import RigError
from .media import Media, boxes_touch, make_media
from .motion import Motion, find_motion
from .optics import dot
from .plate import ArrayFrame, array_frame
from .ray_engine import FEW_TRIANGLES, FLOAT32, Layer, slab
from .rig import WAVELENGTH, Glass, Mesh, Plate, Rig, Viewer
from .steps import Pauses, finish
from .surfaces import Surface, contains, make_surface, making_solids
from .thin_parts import ThinParts

Thing = TypeVar("Thing")
Ghosts = Literal["mean", "strongest"]

LEAST_TOLERANCE, MOST_TOLERANCE = 1e-6, 100.0  # px; landings are right to about 1e-7 px where the glass is curved
MOST_EFFORT = 4096  # rays for a viewer pixel
BULGE = 0.25  # of its size: so far a curved surface stays, with room to spare, within the box of its facets
MOST_UNLIKE = 1e4  # times the size of a part: the extent of the layer that it shares
FLAT = 1e-6  # a plate's vertices may leave its plane by this much of its size


@dataclass(frozen=True)
class Settings:
    """How to solve.

    Parameters
    ----------
    tolerance : display pixels by which landings may be off; LEAST_TOLERANCE to MOST_TOLERANCE
    max_events : surfaces a ray may meet before it counts as lost
    only_through_glass : only rays that went through glass carry the picture
    brightness : weigh paths by their throughput (Fresnel) instead of by 1
    effort : most rays for a viewer pixel where light is chaotic, rounded down to a square; 1 to MOST_EFFORT
    margin : display pixels by which the covered area is grown in the source image
    wavelength : m
    suppress_glare : weight, 0 to 1, of light beside the glass, which shall be dark; where only what went through glass
        carries the picture
    ghosts : what a display pixel shows that is seen by several paths: the "mean" of what they ask for, or what the
        "strongest" of them asks for
    """

    tolerance: float = 0.1
    max_events: int = 32
    only_through_glass: bool = True
    brightness: bool = False
    effort: int = 16
    margin: int = 0
    wavelength: float = WAVELENGTH
    suppress_glare: float = 0.0
    ghosts: Ghosts = "mean"

    @property
    def looks_beside(self) -> bool:
        """Is light beside the glass followed to the display, though it carries no picture?"""
        return self.only_through_glass and self.suppress_glare > 0

    @property
    def of_optics(self) -> "Settings":
        """What counts of these settings before anything is painted; what does not is as it is in others."""
        return replace(self, margin=0, ghosts="mean", suppress_glare=float(self.looks_beside))

    @property
    def samples_along(self) -> int:
        """Samples along a viewer pixel's side where light is chaotic; each quarter of a pixel has one at least."""
        return isqrt(self.effort)

    def check(self) -> None:
        """Raise RigError when the tolerance is none that can be kept, or no surface may be met."""
        if not LEAST_TOLERANCE <= round(self.tolerance, 12) <= MOST_TOLERANCE:  # Blender keeps it as float32
            raise RigError(
                f"The tolerance is {self.tolerance:g} display pixels: set one from {LEAST_TOLERANCE:g}"
                f" to {MOST_TOLERANCE:g}."
            )
        if self.max_events < 1:
            raise RigError(f"A ray may meet {self.max_events} surfaces: allow it 1 or more.")
        if not 1 <= self.effort <= MOST_EFFORT:
            raise RigError(f"Effort is {self.effort} rays for a viewer pixel: allow it 1 to {MOST_EFFORT}.")
        if not 0 <= self.suppress_glare <= 1:
            raise RigError(f"Suppress Glare is {self.suppress_glare:g}: set it from 0 to 1.")
        if self.ghosts not in get_args(Ghosts):
            raise RigError(f"Ghosts is '{self.ghosts}': set it to 'mean' or 'strongest'.")


class Kind(IntEnum):
    """What a surface does to a ray."""

    GLASS = 0
    PLATE = 1
    MIRROR = 2
    BLOCKER = 3
    DISPLAY = 4


@dataclass(frozen=True, eq=False)
class Plan:
    """A rig made ready to be traced: all triangles in one numbering, in layers.

    Triangles t: normals (t, 3), corner_normals (t, 3, 3) or None, is_bent (t,) flat with bent normals, patch (t,),
    part (t,).
    Parts p, solids first: kind (p,), is_closed (p,), cluster (p,) and bit (p,) uint64 of a solid in the cluster's mask;
    -1 and 0 for no solid; sheet (p,), itself, or the first plate in whose plane it lies. The display's triangles are
    the last, from display_start on. open_parts: solids with open edges, and boxes (2, 3) m that they stay within.
    owner (p,): the number of the part's object among the rig's glasses, then mirrors; -1 for all others.
    n_open: open edges of each glass of the rig.
    n_contradicted, n_doubted: smooth triangles of each glass, then of each mirror, that stay flat because their normals
    contradict their shape, or because curved faces would be no nearer to what was meant; n_curved: those that do not.
    Layers: layer_triangles, the triangles of each, in its own order; layer_bits (clusters,), those of its closed
    solids, which what is inside has to leave; layer_solids (clusters,), those of all its solids, None with sheets.
    thin_parts: gives all triangles, to be asked what rays passed by; made when first asked for
    aside: glasses, by number, that are not in the plan; aside_boxes (a, 2, 3) m, which rays may not enter.
    arrays: where mirror arrays stand, by the number of their part.
    is_clear (p, 2): beyond a plate, for light that leaves it against its normal and along it, is nothing but a flat
        display: such light is not traced any further.
    """

    rig: Rig
    settings: Settings
    normals: Floats
    corner_normals: Floats | None
    is_bent: Bools
    patch: Ints
    part: Ints
    kind: Ints
    is_closed: Bools
    cluster: Ints
    bit: np.ndarray
    sheet: Ints
    open_parts: tuple[tuple[int, Floats], ...]
    owner: Ints
    media: Media
    layers: tuple[Layer, ...]
    layer_triangles: tuple[Ints, ...]
    layer_bits: tuple[np.ndarray, ...]
    layer_solids: tuple[np.ndarray | None, ...]
    thin_parts: Callable[[], ThinParts]
    display_start: int
    display_plane: DisplayPlane | None
    aside: tuple[int, ...]
    aside_boxes: Floats
    arrays: dict[int, ArrayFrame]
    is_clear: Bools
    merge_distance: float
    used: tuple[str, ...]
    left_out: tuple[str, ...]
    n_open: tuple[int, ...]
    n_contradicted: tuple[int, ...]
    n_doubted: tuple[int, ...]
    n_curved: tuple[int, ...]

    @property
    def is_flat(self) -> bool:
        """Are all surfaces flat, to light too?"""
        return not self.is_bent.any() and all(layer.curved is None for layer in self.layers)


def fingerprint(*things: object) -> str:
    """Hash of the content of dataclasses, arrays, tuples and plain values: equal content, equal fingerprint.

    Names do not count: an object may be called otherwise after undo or a file load.
    """
    digest = hashlib.sha1(usedforsecurity=False)  # many processors have instructions for it

    def add(thing: object) -> None:
        if is_dataclass(thing):
            digest.update(type(thing).__name__.encode())
            for f in fields(thing):
                if f.name != "name":
                    add(getattr(thing, f.name))
        elif isinstance(thing, np.ndarray):
            digest.update(f"{thing.dtype}{thing.shape}".encode())
            digest.update(np.ascontiguousarray(thing).data)
        elif isinstance(thing, tuple):
            digest.update(f"({len(thing)}".encode())
            for item in thing:
                add(item)
        else:
            digest.update(repr(thing).encode())
        digest.update(b";")

    for thing in things:
        add(thing)
    return digest.hexdigest()


def check_viewer_outside(rig: Rig, glass: Glass, solid: Surface) -> None:
    """Raise RigError when the viewer is inside a solid, or a solid cuts an orthographic viewer's plane."""
    viewer = rig.viewer
    if solid.n_open:
        return  # has no inside
    if viewer.projection == "orthographic" and cuts_image(viewer, solid):
        raise RigError(
            f"The glass '{glass.name}' cuts the plane of the orthographic viewer '{viewer.name}': move it out."
        )
    at, _ = viewer.rays(np.zeros((1, 2)))
    low, high = solid.bounds
    if ((at >= low) & (at <= high)).all() and contains(solid.corners, at).any():
        raise RigError(f"The viewer '{viewer.name}' is inside the glass '{glass.name}': move it out.")


def cuts_image(viewer: Viewer, solid: Surface) -> bool:
    """Does a surface cut the rectangle on its own plane through which an orthographic viewer looks?"""
    left, right, bottom, top = viewer.window
    low, high = solid.bounds
    middle, reach = ((low + high) / 2 - viewer.position) @ viewer.axes.T, (high - low) / 2 @ np.abs(viewer.axes.T)
    if abs(middle[2]) > reach[2]:
        return False
    corners = (solid.corners - viewer.position) @ viewer.axes.T
    is_before = corners[..., 2] > 0
    corners, is_before = (x[is_before.any(axis=1) & ~is_before.all(axis=1)] for x in (corners, is_before))
    # two of each triangle's edges cross the plane, those at the corner that is on the other side than the others
    alone = np.argmax(is_before == (is_before.sum(axis=1) == 1)[:, None], axis=1)
    apex, *others = (corners[np.arange(len(corners)), (alone + k) % 3] for k in range(3))
    start, end = (apex + (apex[:, 2:] / (apex - other)[:, 2:]) * (other - apex) for other in others)
    start[:, 2] = end[:, 2] = 0.0
    enter, leave = slab(np.array([[left, bottom, -1.0], [right, top, 1.0]]), start, end - start)
    return bool(((enter <= leave) & (enter <= 1) & (leave >= 0)).any())


def plate_surface(plate: Plate) -> Surface:
    """A plate's triangles as one patch of one plane; RigError when they do not lie in one."""
    surface = make_surface(plate.mesh.flat())
    corners = surface.corners.reshape(-1, 3)
    centre = corners.mean(axis=0)
    areas = np.cross(surface.corners[:, 1] - surface.corners[:, 0], surface.corners[:, 2] - surface.corners[:, 0])
    largest = areas[np.argmax(dot(areas, areas))]
    normal = (areas * np.sign(areas @ largest)[:, None]).sum(axis=0)  # whichever way its faces look
    length = np.linalg.norm(normal)
    if length == 0:
        raise RigError(f"The plate '{plate.name}' has no area: scale it up.")
    normal /= length
    if np.abs((corners - centre) @ normal).max() > FLAT * np.ptp(corners, axis=0).max():
        raise RigError(f"The plate '{plate.name}' is not flat: a plate has to be a plane.")
    n = len(surface.corners)
    return replace(surface, normals=np.tile(normal, (n, 1)), patch=np.zeros(n, np.int64))


def find_sheets(surfaces: list[Surface], kind: Ints) -> Ints:
    """For each part (p,) the first one in whose plane it lies if both are plates, else itself.

    Light that has met one plate is beyond all of its plane: where plates overlap they act as one.
    """
    sheet = np.arange(len(surfaces))
    plates = np.flatnonzero(kind == Kind.PLATE)
    for n, i in enumerate(plates):
        for j in plates[:n]:
            one, other = surfaces[j], surfaces[i].corners
            far = 2 * FLOAT32 * max(np.abs(other).max(), np.abs(one.corners).max())
            if np.abs((other - one.corners[0, 0]) @ one.normals[0]).max() <= far:
                sheet[i] = sheet[j]
                break
    return sheet


def find_clear(surfaces: list[Surface], kind: Ints, aside: Floats) -> Bools:
    """Is all of the rig but the display on one side of each plate: (p, 2) none before its normal, none behind it?

    Boxes (a, 2, 3) of what stands aside are parts of the rig, too.
    """
    is_clear = np.zeros((len(surfaces), 2), bool)
    for i in np.flatnonzero(kind == Kind.PLATE):
        normal = surfaces[i].normals[0]
        others = [s.bounds for k, s in enumerate(surfaces) if k != i and kind[k] != Kind.DISPLAY]
        boxes = np.concatenate([np.stack(others), aside])
        # how far boxes reach along the normal; what bulges out of its facets stays well within half their size
        middle, half = boxes.mean(axis=1), (0.5 + BULGE) * (boxes[:, 1] - boxes[:, 0])
        height, reach = (middle - surfaces[i].corners[0, 0]) @ normal, half @ np.abs(normal)
        is_clear[i] = (height - reach > 0).all(), (height + reach < 0).all()
    return is_clear


class Kept:
    """What can be used again from one plan to the next, by fingerprint of what it was made from.

    What is asked for between two calls of `forget` stays; the rest is dropped.
    """

    def __init__(self) -> None:
        self._old: dict[str, Any] = {}
        self._now: dict[str, Any] = {}

    def get(self, key: str, make: Callable[[], Thing]) -> Thing:
        """What was made before under this key, else what is made now."""
        if key not in self._now:
            self._now[key] = self._old[key] if key in self._old else make()
        return self._now[key]

    def get_solids(self, mesh: Mesh) -> Pauses[tuple[str, list[Surface], Motion | None]]:
        """Key and solids of a mesh, or those of an earlier one, and the motion that takes them to this one's place."""
        key = fingerprint(mesh)
        if key not in self._old and key not in self._now:
            for other, made in self._old.items():
                motion = find_motion(made[0], mesh) if isinstance(made, tuple) else None
                if motion is not None:
                    self._now[other] = made
                    return other, made[1], motion
            self._now[key] = mesh, (yield from making_solids(mesh))
        _, solids = self._now.setdefault(key, self._old.get(key))
        return key, solids, None

    def forget(self) -> None:
        """Drop what was not asked for since the last call."""
        self._old, self._now = self._now, {}


@dataclass(frozen=True, eq=False)
class _Solid:
    """A solid of a glass of that number, where it is; where it was made, under its key; how it came from there."""

    surface: Surface
    key: str
    number: int
    glass: Glass
    made: Surface
    motion: Motion | None

    @property
    def key_here(self) -> str:
        return self.key if self.motion is None else f"{self.key}@{fingerprint(self.motion)}"


def read_solids(rig: Rig, kept: Kept, aside: tuple[int, ...]) -> Pauses[list[_Solid]]:
    """All solids of a rig but those of glasses with these numbers."""
    solids = []
    for number, glass in enumerate(rig.glasses):
        if number in aside:
            continue
        key, made, motion = yield from kept.get_solids(glass.mesh)
        here = made if motion is None else [surface.moved(motion) for surface in made]
        for surface in here:
            check_viewer_outside(rig, glass, surface)
        solids += [_Solid(here[i], f"{key}/{i}", number, glass, made[i], motion) for i in range(len(made))]
    return solids


def read_sheets(rig: Rig, kept: Kept) -> list[tuple[Kind, Surface, str]]:
    """Everything that is no solid, the display last, with a key for each."""

    def mirror(mesh: Mesh) -> tuple[Kind, Surface, str]:
        key = fingerprint(mesh)
        return Kind.MIRROR, kept.get(key, lambda: make_surface(mesh)), f"{key}/0"

    def flat(kind: Kind, mesh: Mesh, surface: Surface) -> tuple[Kind, Surface, str]:
        return kind, surface, f"{fingerprint(mesh.flat())}/0"

    display = replace(make_surface(rig.display.mesh.flat()), patch=uv_islands(rig.display.mesh))
    return [
        *(flat(Kind.PLATE, plate.mesh, plate_surface(plate)) for plate in rig.plates),
        *(mirror(part.mesh) for part in rig.mirrors),
        *(flat(Kind.BLOCKER, part.mesh, make_surface(part.mesh.flat())) for part in rig.blockers),
        flat(Kind.DISPLAY, rig.display.mesh, display),
    ]


def mirrors_among(rig: Rig, sheets: list[tuple[Kind, Surface, str]]) -> list[int]:
    """For each sheet its number among the rig's glasses and mirrors, -1 where it is no mirror."""
    numbers = iter(range(len(rig.glasses), len(rig.glasses) + len(rig.mirrors)))
    return [next(numbers) if kind == Kind.MIRROR else -1 for kind, *_ in sheets]


def colour(touch: np.ndarray) -> Ints:
    """Greedy colours (n,) such that parts that touch differ."""
    colours = np.full(len(touch), -1)
    for i in range(len(touch)):
        taken = set(colours[touch[i] & (np.arange(len(touch)) != i)].tolist())
        colours[i] = next(c for c in range(len(touch) + 1) if c not in taken)
    return colours


def are_unlike(boxes: Floats) -> Bools:
    """Which of boxes (n, 2, 3) are too large together for float32 to resolve the smaller one? (n, n)."""
    together = np.maximum(boxes[:, None, 1], boxes[None, :, 1]) - np.minimum(boxes[:, None, 0], boxes[None, :, 0])
    size = np.ptp(boxes, axis=1).max(axis=1)
    return together.max(axis=2) > MOST_UNLIKE * np.minimum(size[:, None], size[None])


def group_parts(surfaces: list[Surface], slack: float) -> list[list[int]]:
    """Which parts share a layer: each of few faces is its own, the others by colour so that none touch."""
    small = [i for i, surface in enumerate(surfaces) if len(surface.corners) <= FEW_TRIANGLES]
    if len(small) > FEW_TRIANGLES:  # many boxes and panels: an engine beats asking each of them
        small = []
    rest = [i for i in range(len(surfaces)) if i not in small]
    groups = [[i] for i in small]
    if rest:
        boxes = np.stack([surfaces[i].bounds for i in rest])
        colours = colour(boxes_touch(boxes, slack) | are_unlike(boxes))
        groups += [[rest[k] for k in np.flatnonzero(colours == c)] for c in range(colours.max() + 1)]
    return groups


def make_layer(surfaces: list[Surface]) -> Layer:
    """The layer of several surfaces."""
    if len(surfaces) == 1:
        return Layer(surfaces[0].corners, surfaces[0].curved)
    corners = [surface.corners for surface in surfaces]
    return Layer(np.concatenate(corners), CurvedFaces.join([surface.curved for surface in surfaces], corners))


def grown(boxes: Floats) -> Floats:
    """Boxes (..., 2, 3) that curved surfaces stay within, however far they bulge out of the boxes of their facets."""
    return boxes + BULGE * (boxes[..., 1:, :] - boxes[..., :1, :]) * np.array([[-1.0], [1.0]])


def triangles_of_boxes(boxes: Floats) -> Floats:
    """Triangles (12 b, 3, 3) of boxes (b, 2, 3)."""
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([half for a, b, c, d in quads for half in ((a, b, c), (a, c, d))])
    corners = np.where(corner[None], boxes[:, 1:], boxes[:, :1])
    return corners[:, triangles].reshape(-1, 3, 3)


def make_plan(rig: Rig, settings: Settings, kept: Kept | None = None, aside: tuple[int, ...] = ()) -> Plan:
    """Make a rig ready to be traced, as by `planning`."""
    return finish(planning(rig, settings, kept, aside))


def planning(rig: Rig, settings: Settings, kept: Kept | None = None, aside: tuple[int, ...] = ()) -> Pauses[Plan]:
    """Make a rig ready to be traced.

    Parameters
    ----------
    kept : solids and layers of an earlier plan, to be used again where nothing has changed
    aside : numbers of glasses to leave out until a ray comes near them: tracing such a ray raises trace.ReachedError

    Raises
    ------
    RigError, MeshError
        One sentence on what makes the rig unsolvable.
    """
    rig.check()
    kept = kept or Kept()
    boxes_aside = grown(np.array([rig.glasses[i].mesh.bounds for i in aside]).reshape(-1, 2, 3))
    read = yield from read_solids(rig, kept, aside)
    solids, glass_of = [solid.surface for solid in read], [solid.glass for solid in read]
    sheets = read_sheets(rig, kept)
    surfaces = solids + [surface for _, surface, _ in sheets]
    keys = [solid.key_here for solid in read] + [key for *_, key in sheets]
    boxes = np.stack([surface.bounds for surface in surfaces])
    # vertices and places are float32: faces of glass that are closer than their rounding touch
    touching = 2 * FLOAT32 * float(np.abs(boxes[: len(solids)]).max())
    media = make_media(solids, glass_of, touching, settings.wavelength)
    bit = np.concatenate([media.bit, np.zeros(len(sheets), np.uint64)])
    cluster = np.concatenate([media.cluster, np.full(len(sheets), -1)])
    is_closed = np.array([surface.n_open == 0 for surface in surfaces])

    starts = np.cumsum([0] + [len(surface.corners) for surface in surfaces])
    layers, layer_triangles, layer_bits, layer_solids = [], [], [], []
    for group in group_parts(surfaces, touching):
        motions = [read[i].motion if i < len(read) else None for i in group]
        if motions[0] is not None and all(motion is motions[0] for motion in motions):
            members, names = [read[i].made for i in group], [read[i].key for i in group]
        else:
            members, names, motions[0] = [surfaces[i] for i in group], [keys[i] for i in group], None
        layer = kept.get("+".join(names), lambda members=members: make_layer(members))
        layers.append(layer if motions[0] is None else layer.moved(motions[0]))
        yield 0
        layer_triangles.append(np.concatenate([np.arange(starts[i], starts[i + 1]) for i in group]))
        solid = [i for i in group if i < len(solids)]
        closed, every = np.zeros((2, media.cluster.max() + 1), np.uint64)
        np.bitwise_or.at(closed, cluster[solid], bit[solid] * is_closed[solid])
        np.bitwise_or.at(every, cluster[solid], bit[solid])
        layer_bits.append(closed)
        layer_solids.append(every if len(solid) == len(group) else None)
    patch = np.concatenate([surface.patch + start for surface, start in zip(surfaces, starts, strict=False)])
    part = np.repeat(np.arange(len(surfaces)), np.diff(starts))
    corners = np.concatenate([surface.corners for surface in surfaces])
    walls = triangles_of_boxes(boxes_aside)
    number = np.repeat(np.arange(len(aside)), 12)  # each box is a patch and a part, for what may pass near it

    def find_thin_parts() -> ThinParts:
        return ThinParts(
            np.concatenate([corners, walls]),
            np.concatenate([patch, number + len(corners)]),
            np.concatenate([part, number + len(surfaces)]),
        )

    thin_parts = kept.get("boxes of " + "+".join([*keys, fingerprint(walls)]), lambda: cache(find_thin_parts))
    kept.forget()
    yield 0

    plane = display_plane(rig.display, surfaces[-1])
    kind = np.array([Kind.GLASS] * len(solids) + [kind for kind, *_ in sheets])
    is_clear = find_clear(surfaces, kind, boxes_aside) & (plane is not None)
    arrays = {
        len(solids) + i: array_frame(plate, sheets[i][1].normals[0])
        for i, plate in enumerate(rig.plates)
        if plate.array is not None
    }
    has_bent = any(surface.corner_normals is not None for surface in surfaces)

    def of_glass(name: str) -> list[int]:
        owned = [(g, s) for g, s in zip(glass_of, solids, strict=True)]
        return [sum(getattr(s, name) for g, s in owned if g is glass) for glass in rig.glasses]

    def of_curved(name: str) -> tuple[int, ...]:
        return *of_glass(name), *(getattr(surface, name) for kind, surface, _ in sheets if kind == Kind.MIRROR)

    has_engine = any(layer.has_engine for layer in layers)
    no_kernel = kernel.left_out(layers)
    no_engine = "few flat faces" if not has_engine else "the kernel has its own trees" if no_kernel is None else None
    engine = "ray engine" if no_engine else f"ray engine ({engine_kind().name})"
    rules = {
        "compiled kernel": (no_kernel is None, no_kernel),
        engine: (no_engine is None, no_engine),
        "curved faces": (
            any(surface.curved is not None for surface in surfaces),
            "no face that may be curved turns far",
        ),
        "bent normals": (has_bent, "no flat face has any"),
        "overlapping media": (media.n_overlapping > 0, "the solids are disjoint"),
        "mirror array": (len(arrays) > 0, "the plate is ideal"),
        "rays beyond the plate": (
            not is_clear[kind == Kind.PLATE].any(axis=1).all(),
            "a flat display is all there is",
        ),
        "Fresnel": (settings.brightness, "brightness is not asked for"),
    }
    return Plan(
        rig=rig,
        settings=settings,
        normals=np.concatenate([surface.normals for surface in surfaces]),
        corner_normals=np.concatenate([
            np.zeros_like(s.corners) if s.corner_normals is None else s.corner_normals for s in surfaces
        ]) if has_bent else None,
        is_bent=np.concatenate([surface.is_bent for surface in surfaces]),
        patch=patch,
        part=part,
        kind=kind,
        is_closed=is_closed,
        cluster=cluster,
        bit=bit,
        sheet=find_sheets(surfaces, kind),
        open_parts=tuple((i, grown(solid.bounds)) for i, solid in enumerate(solids) if solid.n_open),
        owner=np.array([*(solid.number for solid in read), *mirrors_among(rig, sheets)]),
        media=media,
        layers=tuple(layers),
        layer_triangles=tuple(layer_triangles),
        layer_bits=tuple(layer_bits),
        layer_solids=tuple(layer_solids),
        thin_parts=thin_parts,
        display_start=int(starts[-2]),
        display_plane=plane,
        aside=aside,
        aside_boxes=boxes_aside,
        arrays=arrays,
        is_clear=is_clear,
        merge_distance=max(touching, 1e-12 * float(np.ptp(boxes.reshape(-1, 3), axis=0).max())),
        used=tuple(name for name, (is_used, _) in rules.items() if is_used),
        left_out=(
            *(f"{name} ({reason})" for name, (is_used, reason) in rules.items() if not is_used),
            *(f"'{rig.glasses[i].name}' (no light comes near it)" for i in aside),
        ),
        n_open=tuple(of_glass("n_open")),
        n_contradicted=of_curved("n_contradicted"),
        n_doubted=of_curved("n_doubted"),
        n_curved=of_curved("n_curved"),
    )  # fmt: skip
