"""The plan: a rig compiled for tracing, its tables, and the interface of tracers."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, Ints
from ..base.messages import Message
from ..base.steps import Steps
from ..rig.rig import Rig
from ..rig.settings import Settings
from ..rig.viewer import Viewer
from .display import DisplayPlane
from .media import Media
from .near_misses import ThinParts
from .plate import ArrayFrame
from .ray_engine import Layer
from .rays import Rays, Step, Words


@dataclass(frozen=True, eq=False)
class Triangles:
    """All triangles (t) of a plan in one numbering, the display's last.

    normals : (t, 3) unit
    corner_normals : (t, 3, 3), 0 for the face's own normal; None if all are the face's own
    is_bent : (t,) flat with bent normals
    patch, part : (t,)
    """

    normals: Floats
    corner_normals: Floats | None
    is_bent: Bools
    patch: Ints
    part: Ints

    def __len__(self) -> int:
        return len(self.part)


@dataclass(frozen=True, eq=False)
class Parts:
    """All parts (p) of a plan: solids first, then thin surfaces, the display last.

    kind, is_closed : (p,)
    cluster, bit : (p,), uint64, of a solid in the cluster's mask; -1 and 0 for thin surfaces
    sheet : (p,) itself, or the first plate in the same plane
    owner : (p,) number of the part's object among the rig's glasses, then mirrors; -1 for others
    is_clear : (p, 2) light leaving a plate against its normal, and along it, can only meet a flat
        display, so tracing ends there
    elements : (p,) data of each part for its interaction: an ArrayFrame for a plate of mirrors,
        else the rig's part
    """

    kind: Ints
    is_closed: Bools
    cluster: Ints
    bit: NDArray[np.uint64]
    sheet: Ints
    owner: Ints
    is_clear: Bools
    elements: tuple[Any, ...]

    def __len__(self) -> int:
        return len(self.kind)


class OpenPart(NamedTuple):
    """A solid with open edges: its part number, and a box (2, 3), m, around it."""

    number: int
    box: Floats


@dataclass(frozen=True, eq=False)
class PlannedLayer:
    """A layer, and its triangles and solids.

    numbers : (t,) the plan's numbers of its triangles, in the layer's order
    closed_bits : (clusters,) uint64, bits of its closed solids in each cluster's mask; a ray inside
        must leave them
    solid_bits : (clusters,) uint64, bits of all its solids; None if it has thin surfaces
    """

    layer: Layer
    numbers: Ints
    closed_bits: NDArray[np.uint64]
    solid_bits: NDArray[np.uint64] | None

    def places(self, n_triangles: int) -> Ints:
        """Places in the layer of all triangles (n_triangles,) of the plan; -1 for others."""
        places = np.full(n_triangles, -1)
        places[self.numbers] = np.arange(len(self.numbers))
        return places


@dataclass(frozen=True, eq=False)
class PlannedDisplay:
    """The display: the number of its first triangle, and its plane, None if not flat.

    is_by_glass : it is close enough to glass for coincident hits
    absorbing : (t, 3) absorbing axis of its polariser at each triangle, 0 if its light is not
        polarised; None if the plan is not
    """

    start: int
    plane: DisplayPlane | None
    is_by_glass: bool = False
    absorbing: Floats | None = None


@dataclass(frozen=True, eq=False)
class DeferredObjects:
    """Glasses left out of the plan, by number, and their boxes (a, 2, 3) m, which rays may not
    enter.
    """

    glasses: tuple[int, ...]
    boxes: Floats

    @classmethod
    def none(cls) -> "DeferredObjects":
        """No glass is deferred."""
        return cls((), np.empty((0, 2, 3)))


@dataclass(frozen=True)
class Counts:
    """Statistics of each glass of the rig and, except n_open, of each mirror.

    n_open : open edges
    n_contradicted : smooth triangles kept flat because their normals contradict their shape
    n_doubted : smooth triangles kept flat because curved faces would be no closer to the intended
        surface
    n_curved : smooth triangles with a curved face
    """

    n_open: tuple[int, ...]
    n_contradicted: tuple[int, ...]
    n_doubted: tuple[int, ...]
    n_curved: tuple[int, ...]


class Ends(NamedTuple):
    """Ends of the branches of edges (n,), as fractions 0..1 of the edges.

    low, width : the last place found, and the remaining uncertainty beyond it
    xy, throughput : (n, 2), (n,) of the rays there
    n_tried : rays
    """

    low: Floats
    width: Floats
    xy: Floats
    throughput: Floats
    n_tried: Ints


class Halving(NamedTuple):
    """Edges (n,) to be bisected.

    start, way : (n, 2) viewer px, near ends, and vectors to the far ends
    course : (n, m), as from `recording`, of the branch (n,) to follow
    begun : initial values; a width below 1 is tried first as it is
    least : width, as a fraction, at which bisection stops
    """

    start: Floats
    way: Floats
    course: Words
    branch: Words
    begun: Ends
    least: float


class Tracer(Protocol):
    """Follows rays: the kernel, or numpy event by event. A plan uses the first one that supports
    it.

    bisect : bisects edges one by one; yields the number of rays traced since the last yield; raises
        as `follow`; None if the map must bisect all edges together with `follow`
    """

    bisect: Callable[["Plan", Halving], Steps[Ends]] | None

    def left_out(
        self, layers: Sequence[PlannedLayer], kind: Ints, is_polarised: bool
    ) -> Message | None:
        """Why it cannot trace these layers and parts of kinds (p,); None if it can."""

    def rays_at_once(self, plan: "Plan", most: int) -> int:
        """Number of rays, up to `most`, to follow at once when paths or courses are recorded."""

    def follow(self, plan: "Plan", rays: Rays, steps: list[Step] | None = None) -> Steps[None]:
        """Follow rays to their ends; yields the number ended since the last yield. Fills `steps` if
        given.

        Raises
        ------
        DeferredObjectError : a ray comes near deferred glass
        """


@dataclass(frozen=True, eq=False)
class Plan:
    """A rig compiled for tracing.

    It is made for the wavelength of the settings and shared by all viewers.

    viewer : the current viewer; the rig's first unless changed by `seen_by`
    thin_parts : returns all triangles for near-miss tests; made on first use
    merge_distance : m, closer faces are coincident
    used, left_out : names of the features the rig uses, and does not use; a left out kernel and
        deferred glass include the reason
    tracers : fastest first
    n_copies : largest number of copies of a ray; 0 if no part splits rays
    """

    rig: Rig
    settings: Settings
    viewer: Viewer
    triangles: Triangles
    parts: Parts
    open_parts: tuple[OpenPart, ...]
    media: Media
    layers: tuple[PlannedLayer, ...]
    thin_parts: Callable[[], ThinParts]
    display: PlannedDisplay
    deferred: DeferredObjects
    merge_distance: float
    used: tuple[str, ...]
    left_out: tuple[str, ...]
    counts: Counts
    tracers: tuple[Tracer, ...]
    n_copies: int

    def seen_by(self, viewer: Viewer) -> "Plan":
        """The same plan for another viewer of the rig; nothing is recomputed."""
        return self if viewer is self.viewer else replace(self, viewer=viewer)

    @property
    def tracer(self) -> Tracer:
        """The first tracer that supports all layers and parts."""
        what = self.layers, self.parts.kind, self.is_polarised
        return next(one for one in self.tracers if one.left_out(*what) is None)

    def part_of(self, triangle: Ints) -> Iterator[tuple[Any, Ints]]:
        """Each part hit by rays (n,) at these triangles, as its element, with the indices of its
        rays.
        """
        part = self.triangles.part[triangle]
        for number in np.unique(part):
            yield self.parts.elements[number], np.flatnonzero(part == number)

    @property
    def arrays(self) -> tuple[ArrayFrame, ...]:
        """The mirror arrays of its plates, in place."""
        return tuple(one for one in self.parts.elements if isinstance(one, ArrayFrame))

    @property
    def scatters(self) -> bool:
        """Whether simulated light scatters at a retroreflector, which the kernel leaves out."""
        return any(one.spread or one.pitch for one in self.rig.retroreflectors)

    @property
    def is_polarised(self) -> bool:
        """Whether rays carry their polarisation."""
        return self.display.absorbing is not None

    @property
    def has_glass(self) -> bool:
        """Whether the rig has glass, which light can miss."""
        return bool(self.rig.glasses)

    @property
    def needs_plate(self) -> bool:
        """Whether only light that met a plate carries the picture; False in a rig without
        plates.
        """
        return self.settings.only_through_plate and bool(self.rig.plates)

    @property
    def is_flat(self) -> bool:
        """Whether all surfaces are flat, without curved faces or bent normals."""
        are_flat = all(held.layer.curved is None for held in self.layers)
        return are_flat and not self.triangles.is_bent.any()
