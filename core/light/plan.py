"""A rig made ready to be traced: the things it needs, and those it leaves out."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Floats, Ints
from ..rig import Rig
from ..settings import Settings
from .display import DisplayPlane
from .media import Media
from .plate import ArrayFrame
from .ray_engine import Layer
from .thin_parts import ThinParts


class LayerParts(NamedTuple):
    """The triangles and solids in a layer.

    numbers : (t,) the plan's numbers of its triangles, in its own order
    closed_bits : (clusters,) uint64, those of its closed solids in
        each cluster's mask: a ray inside has to leave them
    solid_bits : (clusters,) uint64, those of all its solids; None with sheets
    """

    numbers: Ints
    closed_bits: NDArray[np.uint64]
    solid_bits: NDArray[np.uint64] | None


@dataclass(frozen=True, eq=False)
class Plan:
    """A rig made ready to be traced: all triangles in one numbering, in layers.

    Triangles t: normals (t, 3), corner_normals (t, 3, 3) or None, is_bent (t,) flat with bent
    normals, patch (t,), part (t,). Parts p, solids first: kind (p,), is_closed (p,), cluster (p,)
    and bit (p,) uint64 of a solid in the cluster's mask; -1 and 0 for no solid; sheet (p,), itself,
    or the first plate in whose plane it lies. The display's triangles are the last, from
    display_start on. open_parts: solids with open edges, and boxes (2, 3) m that they stay within.
    owner (p,): the number of the part's object among the rig's glasses, then mirrors; -1 for all
    others. n_open: open edges of each glass of the rig. n_contradicted, n_doubted: smooth triangles
    of each glass, then of each mirror, that stay flat because their normals contradict their shape,
    or because curved faces would be no nearer to the one meant; n_curved: those that do not.
    layers, and layer_parts: the contents of each. thin_parts: gives all triangles, to be asked
    which of them rays passed by; made when first asked for aside: glasses, by number, that are not
    in the plan; aside_boxes (a, 2, 3) m, which rays may not enter. arrays: where mirror arrays
    stand, by the number of their part. is_clear (p, 2): beyond a plate, for light that leaves it
    against its normal and along it, is nothing but a flat
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
    layer_parts: tuple[LayerParts, ...]
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
