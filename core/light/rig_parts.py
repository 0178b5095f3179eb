"""All parts of a rig that are in a plan, with their surfaces, in one numbering."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.fingerprint import fingerprint
from ..base.steps import Pauses
from ..glass.motion import Motion
from ..glass.surfaces import Surface
from ..rig.kinds import Kind
from ..rig.rig import Rig
from .checks import check_viewer_outside
from .media import Media, Solid
from .mesh_cache import Kept
from .plan import Counts, Parts, Triangles
from .thin_surfaces import Sheet, find_sheets


@dataclass(frozen=True, eq=False)
class RigParts:
    """All parts (p) of a rig that are in the plan: solids first, then sheets, the display last."""

    solids: list[Solid]
    sheets: list[Sheet]

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
        """The first triangle (p + 1,) of each, and the number of all."""
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

    def joined(self, name: str) -> np.ndarray:
        """A column of the surfaces, of all triangles."""
        return np.concatenate([getattr(surface, name) for surface in self.surfaces])

    def of_glass(self, name: str, rig: Rig) -> tuple[int, ...]:
        """Sums of a number of the solids, for each glass of a rig."""
        return tuple(
            sum(getattr(s.surface, name) for s in self.solids if s.glass is glass)
            for glass in rig.glasses
        )

    def of_curved(self, name: str, rig: Rig) -> tuple[int, ...]:
        """The same, then of each mirror: of all parts that may be curved."""
        surface_of = {id(sheet.part): sheet.surface for sheet in self.sheets}
        sheets = rig.curved_parts()[len(rig.glasses) :]
        return *self.of_glass(name, rig), *(getattr(surface_of[id(p)], name) for p in sheets)

    def owner(self, rig: Rig) -> Ints:
        """The number of each part's object among those that may be curved; -1 for all others."""
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
            sheet=find_sheets(self.surfaces, self.kind),
            owner=self.owner(rig),
            is_clear=is_clear,
        )

    def counts(self, rig: Rig) -> Counts:
        """Numbers that are told of each glass and mirror."""
        return Counts(
            n_open=self.of_glass("n_open", rig),
            n_contradicted=self.of_curved("n_contradicted", rig),
            n_doubted=self.of_curved("n_doubted", rig),
            n_coarse=self.of_curved("n_coarse", rig),
            n_curved=self.of_curved("n_curved", rig),
        )


def _corner_normals(surfaces: list[Surface]) -> Floats | None:
    """Normals (t, 3, 3) at the corners of all triangles, 0 where
    they are those of the face; None where all are.
    """
    if all(surface.corner_normals is None for surface in surfaces):
        return None
    return np.concatenate([
        np.zeros_like(surface.corners) if surface.corner_normals is None else surface.corner_normals
        for surface in surfaces
    ])  # fmt: skip


def _moved(key: str, made: list[Surface], motion: Motion, kept: Kept) -> list[Surface]:
    """Solids elsewhere, the same as long as they stay there: a viewer alone may move."""
    return kept.get(
        f"{key} moved by {fingerprint(motion)}", lambda: [one.moved(motion) for one in made]
    )


def read_solids(rig: Rig, kept: Kept, aside: tuple[int, ...]) -> Pauses[list[Solid]]:
    """All solids of a rig but those of glasses with these numbers."""
    solids = []
    for number, glass in enumerate(rig.glasses):
        if number in aside:
            continue

        key, made, motion = yield from kept.get_solids(glass.mesh)
        here = made if motion is None else _moved(key, made, motion, kept)
        for surface in here:
            for viewer in rig.viewers:
                check_viewer_outside(viewer, glass, surface)

        solids += [
            Solid(here[i], f"{key}/{i}", number, glass, made[i], motion) for i in range(len(made))
        ]

    return solids
