"""The parts of a rig in a plan: solids of glass, and thin surfaces (all others)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import FLOAT32, Bools, Floats, Ints
from ..base.errors import RigError
from ..base.fingerprint import fingerprint
from ..base.steps import Steps
from ..glass.motion import Motion
from ..glass.solids import contains
from ..glass.surfaces import Surface
from ..rig.rig import MET_ROLES, Glass, Kind, Rig, Role, Viewer
from .hits import slab
from .interactions import INTERACTIONS
from .media import BULGE, Media, Solid
from .mesh_cache import MeshCache
from .plan import Counts, Parts, Triangles


class ThinSurface(NamedTuple):
    """A part that is not a solid, with its surface and the surface's cache key."""

    role: Role
    part: Any
    surface: Surface
    key: str


def find_thin_surfaces(surfaces: list[Surface], kind: Ints) -> Ints:
    """For each part (p,), itself, or the first plate in the same plane if it is a plate.

    Light through one plate is beyond its whole plane, so overlapping plates act as one.
    """
    sheet = np.arange(len(surfaces))
    plates = np.flatnonzero(kind == Kind.PLATE)
    for n, i in enumerate(plates):
        for j in plates[:n]:
            one = surfaces[j]
            other = surfaces[i].corners
            far = 2 * FLOAT32 * max(np.abs(other).max(), np.abs(one.corners).max())
            if np.abs((other - one.corners[0, 0]) @ one.normals[0]).max() <= far:
                sheet[i] = sheet[j]
                break

    return sheet


def find_clear(surfaces: list[Surface], kind: Ints, deferred: Floats) -> Bools:
    """Whether the rig, except the display, lies on one side of each plate: (p, 2) none in front of
    its normal, none behind.

    Boxes (a, 2, 3) of deferred glass count as parts of the rig.
    """
    is_clear = np.zeros((len(surfaces), 2), bool)
    for i in np.flatnonzero(kind == Kind.PLATE):
        normal = surfaces[i].normals[0]
        others = [s.bounds for k, s in enumerate(surfaces) if k != i and kind[k] != Kind.DISPLAY]
        boxes = np.concatenate([np.array(others).reshape(-1, 2, 3), deferred])

        # extent of the boxes along the normal; a curved face stays well within half its facet's
        # size
        middle = boxes.mean(axis=1)
        half = (0.5 + BULGE) * (boxes[:, 1] - boxes[:, 0])
        height = (middle - surfaces[i].corners[0, 0]) @ normal
        reach = half @ np.abs(normal)
        is_clear[i] = (height - reach > 0).all(), (height + reach < 0).all()

    return is_clear


def read_thin_surfaces(rig: Rig, mesh_cache: MeshCache) -> list[ThinSurface]:
    """All parts except solids, the display last."""
    interactions = [(role, INTERACTIONS[role.kind].surface) for role in MET_ROLES]
    interactions.sort(key=lambda pair: pair[0].kind == Kind.DISPLAY)
    return [
        ThinSurface(role, part, *surface(part, mesh_cache))
        for role, surface in interactions
        if surface is not None
        for part in rig.of(role)
    ]


@dataclass(frozen=True, eq=False)
class RigParts:
    """All parts (p) of a rig in the plan: solids first, then thin surfaces, the display last."""

    solids: list[Solid]
    sheets: list[ThinSurface]

    @cached_property
    def surfaces(self) -> list[Surface]:
        return [part.surface for part in (*self.solids, *self.sheets)]

    @cached_property
    def keys(self) -> list[str]:
        return [*(solid.key_here for solid in self.solids), *(sheet.key for sheet in self.sheets)]

    @cached_property
    def kind(self) -> Ints:
        return np.array([Kind.GLASS] * len(self.solids) + [s.role.kind for s in self.sheets])

    @cached_property
    def starts(self) -> Ints:
        """First triangle (p + 1,) of each part, and the total."""
        return np.cumsum([0] + [len(surface.corners) for surface in self.surfaces])

    @cached_property
    def patch(self) -> Ints:
        """The patch of each triangle, in one numbering."""
        return np.concatenate(
            [s.patch + start for s, start in zip(self.surfaces, self.starts, strict=False)]
        )

    @cached_property
    def part(self) -> Ints:
        """The part of each triangle."""
        return np.repeat(np.arange(len(self.surfaces)), np.diff(self.starts))

    @cached_property
    def is_closed(self) -> Bools:
        return np.array([surface.n_open == 0 for surface in self.surfaces])

    @property
    def triangles(self) -> Triangles:
        """The plan's table of all triangles."""
        return Triangles(
            normals=self.joined("normals"),
            corner_normals=_corner_normals(self.surfaces),
            is_bent=self.joined("is_bent"),
            patch=self.patch,
            part=self.part,
        )

    @cached_property
    def elements(self) -> tuple[Any, ...]:
        """Data of each part (p,) for its interaction."""
        interactions = (INTERACTIONS[sheet.role.kind] for sheet in self.sheets)
        return (
            *(solid.glass for solid in self.solids),
            *(
                interaction.element(s.part, s.surface)
                for interaction, s in zip(interactions, self.sheets, strict=True)
            ),
        )

    def joined(self, name: str) -> np.ndarray:
        """A column of all surfaces, concatenated."""
        return np.concatenate([getattr(surface, name) for surface in self.surfaces])

    def of_glass(self, name: str, rig: Rig) -> tuple[int, ...]:
        """Totals of a statistic of the solids, for each glass of a rig."""
        return tuple(
            sum(getattr(s.surface, name) for s in self.solids if s.glass is glass)
            for glass in rig.glasses
        )

    def of_curved(self, name: str, rig: Rig) -> tuple[int, ...]:
        """A statistic of each glass, then of each mirror: all parts that may be curved."""
        surface_of = {id(sheet.part): sheet.surface for sheet in self.sheets}
        sheets = rig.curved_parts()[len(rig.glasses) :]
        return *self.of_glass(name, rig), *(getattr(surface_of[id(p)], name) for p in sheets)

    def owner(self, rig: Rig) -> Ints:
        """The number of each part's object among parts that may be curved; -1 for all others."""
        number_of = {id(part): number for number, part in enumerate(rig.curved_parts())}
        numbers = (number_of.get(id(sheet.part), -1) for sheet in self.sheets)
        return np.array([*(solid.number for solid in self.solids), *numbers])

    def table(self, rig: Rig, media: Media, is_clear: Bools) -> Parts:
        """The plan's table of all parts."""
        n_sheets = len(self.sheets)
        return Parts(
            kind=self.kind,
            is_closed=self.is_closed,
            cluster=np.concatenate([media.cluster, np.full(n_sheets, -1)]),
            bit=np.concatenate([media.bit, np.zeros(n_sheets, np.uint64)]),
            sheet=find_thin_surfaces(self.surfaces, self.kind),
            owner=self.owner(rig),
            is_clear=is_clear,
            elements=self.elements,
        )

    def counts(self, rig: Rig) -> Counts:
        """Statistics of each glass and mirror."""
        return Counts(
            n_open=self.of_glass("n_open", rig),
            n_contradicted=self.of_curved("n_contradicted", rig),
            n_doubted=self.of_curved("n_doubted", rig),
            n_curved=self.of_curved("n_curved", rig),
        )


def _corner_normals(surfaces: list[Surface]) -> Floats | None:
    """Normals (t, 3, 3) at the corners of all triangles, 0 for the face's own; None if all are."""
    if all(surface.corner_normals is None for surface in surfaces):
        return None
    return np.concatenate([
        np.zeros_like(surface.corners) if surface.corner_normals is None else surface.corner_normals
        for surface in surfaces
    ])  # fmt: skip


def _moved(key: str, made: list[Surface], motion: Motion, mesh_cache: MeshCache) -> list[Surface]:
    """Moved solids, cached while they stay: perhaps only a viewer moves."""
    return mesh_cache.get(
        f"{key} moved by {fingerprint(motion)}", lambda: [one.moved(motion) for one in made]
    )


def read_solids(rig: Rig, mesh_cache: MeshCache, deferred: tuple[int, ...]) -> Steps[list[Solid]]:
    """All solids of a rig, except glasses with numbers in `deferred`."""
    solids = []
    for number, glass in enumerate(rig.glasses):
        if number in deferred:
            continue

        key, made, motion = yield from mesh_cache.get_solids(glass.mesh)
        here = made if motion is None else _moved(key, made, motion, mesh_cache)
        for surface in here:
            for viewer in rig.viewers:
                check_viewer_outside(viewer, glass, surface)

        solids += [
            Solid(here[i], f"{key}/{i}", number, glass, made[i], motion) for i in range(len(made))
        ]

    return solids


class InsideGlassError(RigError):
    """A viewer is inside a solid."""


def check_viewer_outside(viewer: Viewer, glass: Glass, solid: Surface) -> None:
    """Raise RigError if a viewer is inside a solid, or a solid cuts an orthographic viewer's
    plane.
    """
    if solid.n_open:
        return  # an open solid has no inside

    if viewer.projection == "orthographic" and cuts_image(viewer, solid):
        raise RigError(
            "The glass '{glass}' cuts the plane of the orthographic viewer '{viewer}': move"
            " it away.",
            glass=glass.name,
            viewer=viewer.name,
        )

    at, _ = viewer.rays(np.zeros((1, 2)))
    low, high = solid.bounds
    if ((at >= low) & (at <= high)).all() and contains(solid.corners, at).any():
        raise InsideGlassError(
            "The viewer '{viewer}' is inside the glass '{glass}': move it out.",
            viewer=viewer.name,
            glass=glass.name,
        )


def cuts_image(viewer: Viewer, solid: Surface) -> bool:
    """Whether a surface cuts the image rectangle on an orthographic viewer's own plane."""
    left, right, bottom, top = viewer.window
    low, high = solid.bounds
    middle = ((low + high) / 2 - viewer.position) @ viewer.axes.T
    reach = (high - low) / 2 @ np.abs(viewer.axes.T)
    if abs(middle[2]) > reach[2]:
        return False

    # triangles with corners on both sides of the plane
    corners = (solid.corners - viewer.position) @ viewer.axes.T
    is_before = corners[..., 2] > 0
    corners, is_before = (
        x[is_before.any(axis=1) & ~is_before.all(axis=1)] for x in (corners, is_before)
    )

    # two edges of each triangle cross the plane, from the corner alone on its side
    alone = np.argmax(is_before == (is_before.sum(axis=1) == 1)[:, None], axis=1)
    apex, *others = (corners[np.arange(len(corners)), (alone + k) % 3] for k in range(3))
    start, end = (apex + (apex[:, 2:] / (apex - other)[:, 2:]) * (other - apex) for other in others)
    start[:, 2] = end[:, 2] = 0.0

    enter, leave = slab(np.array([[left, bottom, -1.0], [right, top, 1.0]]), start, end - start)
    return bool(((enter <= leave) & (enter <= 1) & (leave >= 0)).any())
