"""What this rig needs, and what it leaves out."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from .. import kernel
from ..arrays import Bools, Floats, Ints
from ..fingerprint import fingerprint
from ..glass.motion import Motion
from ..glass.surfaces import Surface
from ..kinds import Kind
from ..rig import Glass, Rig
from ..settings import Settings
from ..steps import Pauses, finish
from .checks import check_viewer_outside
from .display import DisplayPlane, display_plane
from .engines import engine_kind
from .kept import Kept
from .layers import group_parts, grown, make_layer, triangles_of_boxes
from .media import Media, make_media
from .plate import ArrayFrame, array_frame
from .ray_engine import FLOAT32, Layer
from .sheets import find_clear, find_sheets, mirrors_among, read_sheets
from .thin_parts import ThinParts


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


def make_plan(rig: Rig, settings: Settings, kept: Kept | None = None, aside: tuple[int, ...] = ()) -> Plan:
    """Make a rig ready to be traced, as by `planning`."""
    return finish(planning(rig, settings, kept, aside))


def planning(rig: Rig, settings: Settings, kept: Kept | None = None, aside: tuple[int, ...] = ()) -> Pauses[Plan]:
    """Make a rig ready to be traced.

    Parameters
    ----------
    kept : solids and layers of an earlier plan, to be used again where nothing has changed
    aside : numbers of glasses to leave out until a ray comes near them: tracing such a ray raises rays.ReachedError

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
