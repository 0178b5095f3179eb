"""A mesh as it is traced: its surface, the shells it falls into, the solids they enclose."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..base.arrays import Bools, Floats, Ints, greatest, taken
from ..base.steps import Pauses, finish
from ..base.vectors import normalise
from ..rig.mesh import SAME_NORMAL
from ..rig.rig import Mesh
from .curved import CurvedFaces
from .meshes import (
    Edges,
    box_of,
    components,
    find_edges,
    find_joined,
    geometric_normals,
    patches_around,
    volume_of,
)
from .motion import Motion
from .surface_fit import Drawn, make_curved
from .trust import Doubts

# a surface that turns by less over each triangle is as good as curved: 1e-3 display px
LEAST_TURN = np.radians(0.25)
GOLDEN = (5**0.5 - 1) / 2


@dataclass(frozen=True)
class SampleKnobs:
    """When Automatic leaves a large mesh as drawn without a fit to all of it.

    n_patches : spread evenly over the smooth triangles; the one in the middle of each is judged
    n_rings : of triangles around it: with fewer, the edge of a patch spoils its middle
    few : patches that may be curved. Meshes followed as drawn have 2 of 64 and fewer, those curved
        in part 17 and more
    large : smooth triangles from which on patches are judged: four times as many as all have
    """

    n_patches: int = 64
    n_rings: int = 6
    few: int = 4
    large: int = 60_000


SAMPLE = SampleKnobs()


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles ready to be traced.

    corners (t, 3, 3) m; normals (t, 3) geometric, unit, to the front; curved faces over some
    triangles, or None; corner_normals (t, 3, 3) or None, used on the triangles that are flat with
    bent normals, is_bent (t,); patch (t,) label within this surface; n_open edges without a
    neighbour; n_contradicted smooth triangles that stay flat because their normals contradict their
    shape; n_doubted because their curved faces would be no nearer to the surface meant, n_coarse
    of these because they are coarse, not uneven. The last three are estimates where a sample told
    to leave all as drawn
    """

    corners: Floats
    normals: Floats
    curved: CurvedFaces | None
    corner_normals: Floats | None
    is_bent: Bools
    patch: Ints
    n_open: int
    n_contradicted: int
    n_doubted: int
    n_coarse: int

    def moved(self, motion: Motion) -> "Surface":
        """The same surface elsewhere."""
        return replace(
            self,
            corners=motion.points(self.corners),
            normals=motion.directions(self.normals),
            curved=None if self.curved is None else self.curved.moved(motion),
            corner_normals=None
            if self.corner_normals is None
            else motion.directions(self.corner_normals),
        )

    @property
    def n_curved(self) -> int:
        """Triangles with a curved face."""
        return 0 if self.curved is None else len(self.curved.coefficients)

    @cached_property
    def bounds(self) -> Floats:
        return box_of(self.corners)

    @cached_property
    def reach(self) -> float:
        """How far curved faces stand out of their facets, m, at the most."""
        return 0.0 if self.curved is None else self.curved.reach

    @cached_property
    def volume(self) -> float:
        """Enclosed volume of the facets, m^3, positive for a solid."""
        return volume_of(self.corners)


def make_surface(mesh: Mesh) -> Surface:
    """Surface of a mesh."""
    return finish(making_surface(mesh))


def _bent_normals(
    mesh: Mesh, chosen: Ints, corner_normals: Floats | None, normals: Floats
) -> tuple[Floats, Bools, int]:
    """Normals (t, 3, 3) at the corners of chosen triangles, those of the face where it is flat;
    which (t,) are bent; and how many smooth ones contradict their shape.
    """
    by_corner = np.broadcast_to(normals[:, None], (len(chosen), 3, 3))
    is_smooth = None if mesh.is_smooth is None else mesh.is_smooth[chosen]
    if corner_normals is None or is_smooth is None or not is_smooth.any():
        return by_corner, np.zeros(len(chosen), bool), 0

    with np.errstate(invalid="ignore", over="ignore"):
        corner_normals = normalise(corner_normals)
        # not so where one is NaN
        is_usable = (np.einsum("tij,tj->ti", corner_normals, normals) > 0).all(axis=1)

    # a smooth-shaded face whose normals are its own is flat,
    # and its own normal is the more exact one
    is_own = greatest(np.abs(corner_normals - by_corner)) <= SAME_NORMAL
    is_bent = is_smooth & is_usable & ~is_own
    by_corner = np.where(is_bent[:, None, None], corner_normals, by_corner)
    return by_corner, is_bent, int((is_smooth & ~is_usable).sum())


def _fitting(drawn: Drawn, wanted: Bools, mesh: Mesh) -> Pauses[tuple[CurvedFaces | None, Doubts]]:
    """Curved faces over wanted triangles (t,), as by `make_curved`; none where Automatic leaves
    nearly all of a sample flat.
    """
    is_automatic = mesh.surface == "automatic"
    if is_automatic and np.count_nonzero(wanted) >= SAMPLE.large:
        doubts = yield from _doubting_sample(drawn, wanted, mesh.has_mean_normals)
        if doubts is not None:
            return None, doubts
    return (yield from make_curved(drawn, wanted, mesh.has_mean_normals, is_automatic))


def _doubting_sample(drawn: Drawn, wanted: Bools, has_mean_normals: bool) -> Pauses[Doubts | None]:
    """About how many of the wanted triangles (t,) are doubted, by patches of them; None where more
    than a few patches are curved in the middle.
    """
    asked = np.flatnonzero(wanted)
    # by the golden section, so that steps do not fall into step with the rows of a grid
    middles = asked[(len(asked) * (np.arange(SAMPLE.n_patches) * GOLDEN % 1)).astype(int)]
    some = patches_around(drawn.triangles, middles, SAMPLE.n_rings)
    yield 0
    edges = find_edges(drawn.triangles[some])
    normals = drawn.corner_normals[some]
    sample = replace(
        drawn,
        triangles=drawn.triangles[some],
        corner_normals=normals,
        facets=drawn.facets[some],
        edges=edges,
        is_joined=find_joined(normals, edges),
        polygon=None,
        is_sample=True,
    )
    yield 0
    curved, doubts = yield from make_curved(sample, wanted[some], has_mean_normals, True)
    n_flat = doubts.n
    if curved is not None:
        if (curved.row[np.searchsorted(some, middles)] >= 0).sum() > SAMPLE.few:
            return None
        n_flat += len(curved.coefficients)
    times = len(asked) / np.count_nonzero(wanted[some])
    return Doubts(round(times * n_flat), round(times * doubts.n_coarse))


def making_surface(
    mesh: Mesh,
    triangles: Ints | None = None,
    is_flipped: Bools | None = None,
    edges: Edges | None = None,
) -> Pauses[Surface]:
    """Surface of a mesh, or of some of its triangles
    (indices), some of them with the winding turned.

    edges : of the triangles as they are turned, where they are known
    """
    chosen = np.arange(len(mesh.triangles)) if triangles is None else triangles
    index = mesh.triangles[chosen]
    corner_normals = None if mesh.corner_normals is None else mesh.corner_normals[chosen]

    if is_flipped is not None and is_flipped.any():
        index = np.where(is_flipped[:, None], index[:, ::-1], index)
        if corner_normals is not None:
            corner_normals = np.where(
                is_flipped[:, None, None], -corner_normals[:, ::-1], corner_normals
            )

    corners = taken(mesh.vertices, index)
    normals = geometric_normals(corners)
    if edges is None:
        edges = find_edges(index)
    yield 0

    by_corner, is_bent, n_contradicted = _bent_normals(mesh, chosen, corner_normals, normals)
    curved = None
    doubts = Doubts()

    # curved faces over them, where they turn far enough
    is_joined = find_joined(by_corner, edges)
    yield 0
    if is_bent.any() and mesh.surface != "facets":
        turn = np.abs(by_corner - np.roll(by_corner, -1, axis=1)).max()
        # the effect of rounding on the slopes of faces through the
        # vertices, against the error of bent normals
        slope = mesh.rounding / np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1))
        if turn > max(LEAST_TURN, np.sqrt(8 * slope)):
            drawn = Drawn(
                vertices=mesh.vertices,
                triangles=index,
                corner_normals=by_corner,
                facets=normals,
                edges=edges,
                is_joined=is_joined,
                polygon=None if mesh.polygon is None else mesh.polygon[chosen],
            )
            curved, doubts = yield from _fitting(drawn, is_bent, mesh)
            if curved is not None:
                is_bent &= curved.row < 0

            n_contradicted += int(is_bent.sum()) - doubts.n

    return Surface(
        corners=corners,
        normals=normals,
        curved=curved,
        corner_normals=by_corner if is_bent.any() else None,
        is_bent=is_bent,
        patch=components(len(index), edges.first[is_joined], edges.second[is_joined]),
        n_open=edges.n_open,
        n_contradicted=n_contradicted,
        n_doubted=doubts.n,
        n_coarse=doubts.n_coarse,
    )
