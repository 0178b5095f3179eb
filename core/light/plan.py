"""A rig made ready to be traced: the things it needs, and those it leaves out."""

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

    normals (t, 3) unit; corner_normals (t, 3, 3), 0 where they are those of the face, or None where
    all are; is_bent (t,) flat with bent normals; patch (t,); part (t,)
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
    """All parts (p) of a plan: solids first, then sheets, the display last.

    kind (p,); is_closed (p,); cluster (p,) and bit (p,) uint64 of a solid in the cluster's mask, -1
    and 0 for no solid; sheet (p,), itself, or the first plate in whose plane it lies; owner (p,):
    the number of the part's object among the rig's glasses, then mirrors, -1 for all others;
    is_clear (p, 2): beyond a plate, for light that leaves it against its normal and along it, is
    nothing but a flat display: such light is not traced any further; elements (p,): each part as
    its interaction knows it, an ArrayFrame for a plate of mirrors, else the rig's part
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
    """A solid with open edges: its number among the parts, and a box (2, 3), m, that holds it."""

    number: int
    box: Floats


@dataclass(frozen=True, eq=False)
class PlannedLayer:
    """A layer, and the triangles and solids in it.

    numbers : (t,) the plan's numbers of its triangles, in its own order
    closed_bits : (clusters,) uint64, those of its closed solids in
        each cluster's mask: a ray inside has to leave them
    solid_bits : (clusters,) uint64, those of all its solids; None with sheets
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
    """The display: its triangles from `start` on, and its plane, None where it is not flat.

    is_by_glass : does it come so near glass that the two may be met at one place?
    """

    start: int
    plane: DisplayPlane | None
    is_by_glass: bool = False


@dataclass(frozen=True, eq=False)
class DeferredObjects:
    """Glasses that are not in the plan, by number, and their boxes (a, 2, 3) m, which rays may not
    enter.
    """

    glasses: tuple[int, ...]
    boxes: Floats

    @classmethod
    def none(cls) -> "DeferredObjects":
        """Nothing stands aside."""
        return cls((), np.empty((0, 2, 3)))


@dataclass(frozen=True)
class Counts:
    """Numbers that are told of each glass of the rig, and, but for n_open, of each mirror after it.

    n_open : open edges
    n_contradicted : smooth triangles that stay flat because their normals contradict their shape
    n_doubted : the same because curved faces would be no nearer to the one meant
    n_curved : smooth triangles that are curved
    """

    n_open: tuple[int, ...]
    n_contradicted: tuple[int, ...]
    n_doubted: tuple[int, ...]
    n_curved: tuple[int, ...]


class Ends(NamedTuple):
    """Where the branches of edges (n,) end, 0..1 of their ways.

    low, width : the last places, and how far beyond them there may be others; xy (n, 2), throughput
        of the rays there; n_tried : rays
    """

    low: Floats
    width: Floats
    xy: Floats
    throughput: Floats
    n_tried: Ints


class Halving(NamedTuple):
    """Edges (n,) to be bisected.

    start, way : (n, 2) viewer px, the near ends, and the ways from there to the far ones
    course : (n, m), as `recording` gives it, of the branch (n,) that is looked for
    begun : what is known; a width below 1 is tried as it is, first of all
    least : part of the way; one that is no longer is bisected no more
    """

    start: Floats
    way: Floats
    course: Words
    branch: Words
    begun: Ends
    least: float


class Tracer(Protocol):
    """Follows rays: the kernel, or numpy event by event. A plan takes the first that knows it.

    bisect : bisects edges, one by one; yields how many rays were traced since; raises as `follow`;
        None if the map has to bisect all edges together, by `follow`
    """

    bisect: Callable[["Plan", Halving], Steps[Ends]] | None

    def left_out(self, layers: Sequence[PlannedLayer], kind: Ints) -> Message | None:
        """Why it traces no rays among these layers and parts of kinds (p,); None if it does."""

    def rays_at_once(self, plan: "Plan", most: int) -> int:
        """How many rays, up to `most`, are followed at once when their ways or courses are
        recorded.
        """

    def follow(self, plan: "Plan", rays: Rays, steps: list[Step] | None = None) -> Steps[None]:
        """Follow rays to their ends; yields how many ended since. `steps` is filled if given.

        Raises
        ------
        DeferredObjectError : a ray comes near glass that stands aside
        """


@dataclass(frozen=True, eq=False)
class Plan:
    """A rig made ready to be traced.

    All is made for one wavelength, that of the settings, and serves every viewer: the viewer is
    the one whose image is asked about, the rig's first unless `seen_by` says another.

    thin_parts: gives all triangles, to be asked which of them rays passed by; made when first asked
    for. merge_distance: m, faces nearer to each other than this are in the same place. used,
    left_out: needs that the rig has, or has not, and why. tracers: the fastest first. n_copies:
    how many copies of a ray there may be where it splits, 0 where no part splits rays.
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
    aside: DeferredObjects
    merge_distance: float
    used: tuple[str, ...]
    left_out: tuple[str, ...]
    counts: Counts
    tracers: tuple[Tracer, ...]
    n_copies: int

    def seen_by(self, viewer: Viewer) -> "Plan":
        """The same plan for another viewer of the rig: nothing of it is made again."""
        return self if viewer is self.viewer else replace(self, viewer=viewer)

    @property
    def tracer(self) -> Tracer:
        """What traces its rays: the first that knows all of its layers and parts."""
        kind = self.parts.kind
        return next(one for one in self.tracers if one.left_out(self.layers, kind) is None)

    def part_of(self, triangle: Ints) -> Iterator[tuple[Any, Ints]]:
        """Each part that rays (n,) meet by these triangles, as its interaction knows it, and the
        numbers of those rays.
        """
        part = self.triangles.part[triangle]
        for number in np.unique(part):
            yield self.parts.elements[number], np.flatnonzero(part == number)

    @property
    def arrays(self) -> tuple[ArrayFrame, ...]:
        """The mirror arrays of its plates, where they stand."""
        return tuple(one for one in self.parts.elements if isinstance(one, ArrayFrame))

    @property
    def needs_plate(self) -> bool:
        """Does only light that met a plate carry the picture? Not so in a rig that has none."""
        return self.settings.only_through_plate and bool(self.rig.plates)

    @property
    def is_flat(self) -> bool:
        """Are all surfaces flat, to light too?"""
        are_flat = all(held.layer.curved is None for held in self.layers)
        return are_flat and not self.triangles.is_bent.any()
