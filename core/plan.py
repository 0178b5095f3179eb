"""What this rig needs, what it leaves out, and fingerprints of its parts."""

import hashlib
from dataclasses import dataclass, fields, is_dataclass
from enum import IntEnum

import numpy as np

from .errors import RigError
from .meshes import FLOAT32, Layer, Surface, contains, make_surface, solids_from_mesh
from .optics import dot, normalise
from .rig import Display, Floats, Glass, Ints, Mesh, Rig

MOST_OVERLAPPING = 52  # solids in one cluster: their bit mask has to be exact as a float64
FLAT = 1e-6  # a plane's vertices may leave it by this much of its size


@dataclass(frozen=True)
class Settings:
    """How to solve.

    Parameters
    ----------
    max_events : surfaces a ray may meet before it counts as lost
    only_through_glass : only rays that went through glass carry the picture
    brightness : weigh paths by their throughput (Fresnel) instead of by 1
    margin : display pixels by which the covered area is grown in the source image
    wavelength : m
    """

    max_events: int = 32
    only_through_glass: bool = True
    brightness: bool = False
    margin: int = 0
    wavelength: float = 587.6e-9


class Kind(IntEnum):
    """What a surface does to a ray."""

    GLASS = 0
    PLATE = 1
    MIRROR = 2
    BLOCKER = 3
    DISPLAY = 4


@dataclass(frozen=True, eq=False)
class DisplayPlane:
    """A display that is one flat rectangle under its whole image: pixels are one affine map of its plane.

    corner (3,) m; normal (3,) unit, to the front; pixels (2, 3) px / m and origin (2,) px, so that a point p of the
    plane is at pixel xy = pixels (p - corner) + origin; patch: the label its landings have
    """

    corner: Floats
    normal: Floats
    pixels: Floats
    origin: Floats
    patch: int


@dataclass(frozen=True, eq=False)
class Plan:
    """A rig made ready to be traced: all triangles in one numbering, in layers.

    Triangles t: normals (t, 3), corner_normals (t, 3, 3) or None, is_smooth (t,), patch (t,), part (t,).
    Parts p: kind (p,), is_closed (p,), bit (p,) uint64 of a solid in its cluster's mask (0 for no solid),
    index_row (p,) start of its cluster in `indices`, which holds 1.0 (air) and then the indices of the cluster's
    solids by rising priority.
    Layers: layer_triangles, the triangles of each, in its own order; layer_bits, those of its closed solids, which
    what is inside has to leave.
    """

    rig: Rig
    settings: Settings
    normals: Floats
    corner_normals: Floats | None
    is_smooth: np.ndarray
    patch: Ints
    part: Ints
    kind: Ints
    is_closed: np.ndarray
    bit: np.ndarray
    index_row: Ints
    indices: Floats
    layers: tuple[Layer, ...]
    layer_triangles: tuple[Ints, ...]
    layer_bits: tuple[np.uint64, ...]
    display_uv: Floats
    display_start: int
    display_plane: DisplayPlane | None
    merge_distance: float
    used: tuple[str, ...]
    left_out: tuple[str, ...]
    notes: tuple[str, ...]


def fingerprint(*things: object) -> str:
    """Hash of the content of dataclasses, arrays, tuples and plain values: equal content, equal fingerprint."""
    digest = hashlib.blake2b(digest_size=16)

    def add(thing: object) -> None:
        if is_dataclass(thing):
            digest.update(type(thing).__name__.encode())
            for f in fields(thing):
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


def boxes_touch(boxes: Floats, slack: float) -> np.ndarray:
    """Do axis-aligned boxes (n, 2, 3) overlap or come closer than `slack`? (n, n) bool."""
    low, high = boxes[:, 0], boxes[:, 1] + slack
    return ((low[:, None] <= high[None]) & (low[None] <= high[:, None])).all(axis=2)


def colour(touch: np.ndarray) -> Ints:
    """Greedy colours (n,) such that parts that touch differ."""
    colours = np.full(len(touch), -1)
    for i in range(len(touch)):
        taken = set(colours[touch[i] & (np.arange(len(touch)) != i)].tolist())
        colours[i] = next(c for c in range(len(touch) + 1) if c not in taken)
    return colours


def clusters_of(touch: np.ndarray) -> list[list[int]]:
    """Groups of solids whose boxes hang together."""
    groups, seen = [], set()
    for i in range(len(touch)):
        if i in seen:
            continue
        group, todo = [], [i]
        seen.add(i)
        while todo:
            j = todo.pop()
            group.append(j)
            new = [int(k) for k in np.flatnonzero(touch[j]) if k not in seen]
            seen.update(new)
            todo.extend(new)
        groups.append(sorted(group))
    return groups


def plane_of(name: str, mesh: Mesh) -> tuple[Floats, Floats]:
    """Point and unit normal of a flat mesh; RigError when it is not flat."""
    surface = make_surface(mesh)
    normal = np.cross(surface.corners[:, 1] - surface.corners[:, 0], surface.corners[:, 2] - surface.corners[:, 0])
    normal *= np.sign(dot(normal, normal[np.argmax(dot(normal, normal))]))[:, None]
    normal = normal.sum(axis=0)
    length = np.linalg.norm(normal)
    if length == 0:
        raise RigError(f"The plate '{name}' has no area: scale it up.")
    normal /= length
    used = surface.corners.reshape(-1, 3)
    centre = used.mean(axis=0)
    if np.abs((used - centre) @ normal).max() > FLAT * np.ptp(used, axis=0).max():
        raise RigError(f"The plate '{name}' is not flat: a plate has to be a plane.")
    return centre, normal


def check_viewer_outside(rig: Rig, glass: Glass, solid: Surface) -> None:
    """Raise RigError when the viewer stands inside a solid."""
    viewer = rig.viewer
    at, _ = viewer.rays(np.array([[0, 0], [viewer.width, 0], [0, viewer.height], [viewer.width, viewer.height]]))
    at = at[:1] if viewer.projection == "perspective" else at
    low, high = solid.bounds
    at = at[((at >= low) & (at <= high)).all(axis=1)]
    if len(at) and solid.n_open == 0 and contains(solid.corners, at).any():
        raise RigError(f"The viewer '{viewer.name}' is inside the glass '{glass.name}': move it out.")


def make_plan(rig: Rig, settings: Settings, engines: dict[str, Layer] | None = None) -> Plan:
    """Make a rig ready to be traced.

    Parameters
    ----------
    engines : layers built before, by fingerprint of their triangles; those used now are kept in it, others dropped

    Raises
    ------
    RigError, MeshError
        One sentence on what makes the rig unsolvable.
    """
    rig.check()
    notes: list[str] = []
    surfaces: list[Surface] = []
    kinds: list[Kind] = []
    glass_of: list[Glass] = []
    for glass in rig.glasses:
        for solid in solids_from_mesh(glass.mesh):
            check_viewer_outside(rig, glass, solid)
            if solid.n_open:
                notes.append(f"The glass '{glass.name}' is not closed ({solid.n_open} open edges): close it.")
            surfaces.append(solid)
            kinds.append(Kind.GLASS)
            glass_of.append(glass)
    n_solids = len(surfaces)
    others = (
        (Kind.PLATE, rig.plates),
        (Kind.MIRROR, rig.mirrors),
        (Kind.BLOCKER, rig.blockers),
        (Kind.DISPLAY, rig.displays),
    )
    for kind, group in others:
        for part in group:
            surface = make_surface(part.mesh)
            if kind == Kind.PLATE:
                _, normal = plane_of(part.name, part.mesh)
                surface = Surface(
                    surface.corners, np.broadcast_to(normal, surface.normals.shape).copy(), None,
                    np.zeros(len(surface.corners), bool), np.zeros(len(surface.corners), np.int64), 0,
                )  # fmt: skip
            elif kind == Kind.DISPLAY:
                surface = Surface(
                    surface.corners, surface.normals, None, np.zeros(len(surface.corners), bool),
                    uv_islands(part), surface.n_open,
                )  # fmt: skip
            surfaces.append(surface)
            kinds.append(kind)

    boxes = np.stack([s.bounds for s in surfaces])
    size = float(np.abs(boxes - boxes.mean(axis=(0, 1))).max())
    merge_distance = 2 * FLOAT32 * float(np.abs(boxes[:n_solids]).max())
    bit, index_row, indices, n_masks = _media(rig, settings, surfaces[:n_solids], glass_of, boxes, merge_distance)
    n_sheets = len(surfaces) - n_solids

    starts = np.cumsum([0] + [len(s.corners) for s in surfaces])
    known, kept = engines or {}, {}
    layers, layer_triangles, layer_bits = [], [], []
    group_of = _layer_groups(surfaces, boxes, merge_distance)
    for group in group_of:
        chosen = np.concatenate([np.arange(starts[i], starts[i + 1]) for i in group])
        corners = np.concatenate([surfaces[i].corners for i in group])
        key = fingerprint(corners)
        layers.append(known.get(key) or Layer(corners))
        layer_triangles.append(chosen)
        closed = [i for i in group if i < n_solids and surfaces[i].n_open == 0]
        layer_bits.append(np.bitwise_or.reduce(bit[closed], initial=np.uint64(0)))
        kept[key] = layers[-1]
    if engines is not None:
        engines.clear()
        engines.update(kept)

    smooth = [s.corner_normals is not None for s in surfaces]
    corner_normals = None
    if any(smooth):
        corner_normals = np.concatenate(
            [np.zeros_like(s.corners) if s.corner_normals is None else s.corner_normals for s in surfaces]
        )
    patch_starts = np.cumsum([0] + [len(s.corners) for s in surfaces[:-1]])
    n_engines = sum(layer.has_engine for layer in layers)
    used, left_out = ["ideal plate"], []
    (used if n_engines else left_out).append("ray engine" if n_engines else "ray engine (few flat faces)")
    (used if any(smooth) else left_out).append("smooth normals")
    (used if n_masks else left_out).append(
        "overlapping media" if n_masks else "overlapping media (solids are disjoint)"
    )
    (used if settings.brightness else left_out).append("Fresnel")
    return Plan(
        rig,
        settings,
        np.concatenate([s.normals for s in surfaces]),
        corner_normals,
        np.concatenate([s.is_smooth for s in surfaces]),
        np.concatenate([s.patch + k for s, k in zip(surfaces, patch_starts, strict=True)]),
        np.repeat(np.arange(len(surfaces)), [len(s.corners) for s in surfaces]),
        np.array(kinds),
        np.array([s.n_open == 0 for s in surfaces]),
        np.r_[bit, np.zeros(n_sheets, np.uint64)],
        np.r_[index_row, np.zeros(n_sheets, np.int64)],
        indices,
        tuple(layers),
        tuple(layer_triangles),
        tuple(layer_bits),
        rig.display.mesh.uv,
        int(starts[-2]),
        _display_plane(rig.display, surfaces[-1], int(patch_starts[-1])),
        max(merge_distance, 1e-12 * size),
        tuple(used),
        tuple(left_out),
        tuple(notes),
    )


def uv_islands(display: Display) -> Ints:
    """Label (t,) of the UV island of each of a display's triangles: joined where they share an edge in UV too."""
    from .meshes import components, find_edges  # the same joins as patches, with UV in place of normals

    mesh = display.mesh
    edges = find_edges(mesh.triangles)
    i, j = edges.corner_first, edges.corner_second
    end_i, end_j = (i + 1) % 3, (j + 1) % 3
    start_j, stop_j = np.where(edges.is_same_way, j, end_j), np.where(edges.is_same_way, end_j, j)
    uv = mesh.uv
    joined = (uv[edges.first, i] == uv[edges.second, start_j]).all(axis=1)
    joined &= (uv[edges.first, end_i] == uv[edges.second, stop_j]).all(axis=1)
    return components(len(mesh.triangles), edges.first[joined], edges.second[joined])


def _display_plane(display: Display, surface: Surface, first_patch: int) -> DisplayPlane | None:
    """The plane of a flat rectangular display; None for any other."""
    corners, uv = surface.corners.reshape(-1, 3), display.mesh.uv.reshape(-1, 2)
    corner, normal = corners[0], surface.normals[0]
    if (surface.patch != surface.patch[0]).any() or np.abs(surface.normals - normal).max() > FLAT:
        return None
    size = np.ptp(corners, axis=0).max()
    right = normalise(corners[1] - corner)
    axes = np.stack([right, np.cross(normal, right)])
    across = (corners - corner) @ axes.T
    fit, *_ = np.linalg.lstsq(np.column_stack([across, np.ones(len(across))]), uv, rcond=None)
    a, b, c = np.moveaxis(display.mesh.uv, 1, 0)
    covered = 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).sum()
    is_affine = (
        np.abs(across @ fit[:2] + fit[2] - uv).max() < FLAT and np.abs((corners - corner) @ normal).max() < FLAT * size
    )
    is_whole = (
        np.abs(uv.min(axis=0)).max() < FLAT and np.abs(uv.max(axis=0) - 1).max() < FLAT and abs(covered - 1) < FLAT
    )
    if not (is_affine and is_whole):
        return None
    scale = np.array([display.width, -display.height])
    origin = np.array([0, display.height]) + scale * fit[2]
    return DisplayPlane(
        corner, normal, scale[:, None] * (fit[:2].T @ axes), origin, first_patch + int(surface.patch[0])
    )


def _media(
    rig: Rig, settings: Settings, solids: list[Surface], glass_of: list[Glass], boxes: Floats, slack: float
) -> tuple[np.ndarray, Ints, Floats, int]:
    """Bit and index row of each solid, the table of indices, and the number of clusters of more than one solid."""
    n = len(solids)
    bit, index_row, indices = np.zeros(n, np.uint64), np.zeros(n, np.int64), []
    volumes = [abs(s.volume) for s in solids]
    n_masks = 0
    for group in clusters_of(boxes_touch(boxes[:n], slack)):
        if len(group) > MOST_OVERLAPPING:
            name = glass_of[group[0]].name
            raise RigError(
                f"{len(group)} glass solids around '{name}' overlap or nest:"
                f" join them or keep at most {MOST_OVERLAPPING}."
            )
        n_masks += len(group) > 1
        by_priority = sorted(group, key=lambda i: (glass_of[i].priority, -volumes[i]))
        for rank, i in enumerate(by_priority):
            bit[i] = np.uint64(1) << np.uint64(rank)
            index_row[i] = len(indices)
        indices += [1.0] + [float(glass_of[i].ior(settings.wavelength)) for i in by_priority]
    return bit, index_row, np.array(indices), n_masks


def _layer_groups(surfaces: list[Surface], boxes: Floats, slack: float) -> list[list[int]]:
    """Which parts share a layer: each small one is its own, the others by colour so that none touch."""
    from .meshes import FEW_TRIANGLES

    small = [i for i, s in enumerate(surfaces) if len(s.corners) <= FEW_TRIANGLES]
    if len(small) > FEW_TRIANGLES:  # many boxes and panels: an engine beats asking each of them
        small = []
    rest = [i for i in range(len(surfaces)) if i not in set(small)]
    groups = [[i] for i in small]
    if rest:
        colours = colour(boxes_touch(boxes[rest], slack))
        groups += [[rest[k] for k in np.flatnonzero(colours == c)] for c in range(colours.max() + 1)]
    return groups
