"""Kernel calls for the fit of curved faces: the same results as numpy's in `surface_fit.py`."""

import ctypes
from collections.abc import Sequence

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.steps import Steps
from ..native.loading import loaded, n_threads
from ..native.structures import FitStructure, Made
from .vertices import Vertices

FITTED_AT_ONCE = 256  # vertices, as in fit.c
SWEPT_AT_ONCE = 1 << 14  # vertices between two pauses


class Fit:
    """Vertices in local frames, over which the surface is a height field.

    Parameters
    ----------
    axes : x and y (f, 3) of each vertex's frame; z is its normal
    size : (f,) m, unit of each frame
    is_rim : (f,) as in `fitted_faces.Fields`
    """

    def __init__(
        self, v: Vertices, axes: tuple[Floats, Floats], size: Floats, is_rim: Bools
    ) -> None:
        self._made = made = Made(FitStructure)
        for name, values in (
            ("at", v.at),
            ("normal", v.normal),
            ("axis_x", axes[0]),
            ("axis_y", axes[1]),
        ):
            made.point(name, values, float)

        made.point("size", size, float)
        made.point("is_known", v.is_known, np.uint8)
        made.point("is_rim", is_rim, np.uint8)
        made.point("first", v.first, np.int64)
        made.point("end", v.end, np.int64)

        self._n_pairs = len(v.end)
        self._address = ctypes.addressof(made.structure)

    def fit_fields(self, wanted: Bools, ridge: Floats, coefficients: Floats) -> None:
        """Write the coefficients (f, 14), except the first two, of the wanted vertices' (f,)
        fields.

        ridge : (14,) added to the terms' squares
        """
        self._want(wanted, ridge)
        loaded().kiriko_fit_fields(self._address, coefficients.ctypes.data, n_threads())

    def settle_normal_steps(
        self, wanted: Bools, ridge: Floats, normals: Floats, n_sweeps: int, settled: float
    ) -> Steps[Floats]:
        """Make the wanted (f,) of normals (f, 3) agree with their neighbours', with pauses, in
        n_sweeps at most. Returns the change (f, 3) by the last one.
        """
        n = self._want(wanted, ridge)
        parts = [(first, min(SWEPT_AT_ONCE, n - first)) for first in range(0, n, SWEPT_AT_ONCE)]
        slopes = np.empty((n, 2)), np.empty((self._n_pairs, 4))
        places = [values.ctypes.data for values in slopes]
        for part in parts:
            loaded().kiriko_make_slopes(self._address, *places, *part, n_threads())
            yield 0

        before, after = normals.copy(), normals.copy()
        for _ in range(n_sweeps):
            change = 0.0
            for part in parts:
                changes = np.zeros(part[1] // FITTED_AT_ONCE + 1)
                to_and_fro = before.ctypes.data, after.ctypes.data, *places, changes.ctypes.data
                loaded().kiriko_sweep_normals(self._address, *to_and_fro, *part, n_threads())
                change = max(change, float(changes.max()))
                yield 0
            before, after = after, before
            if change < settled:
                break

        normals[:] = before
        return before - after

    def find_offsets(
        self, coefficients: Floats, nodes: Floats, weights: Floats, corner: Ints
    ) -> Floats:
        """Offsets (12, 3, n) of the nodes of triangles with corners (n, 3), from the fields'
        coefficients (f, 14).
        """
        corner = np.ascontiguousarray(corner, np.int64)
        offsets = np.zeros((len(nodes), 3, len(corner)))
        places = (values.ctypes.data for values in (coefficients, nodes, weights, corner))
        loaded().kiriko_find_offsets(
            self._address, *places, len(corner), offsets.ctypes.data, n_threads()
        )
        return offsets

    def _want(self, wanted: Bools, ridge: Floats) -> int:
        """Pass the wanted vertices to the kernel; returns their number."""
        numbers = self._made.point("wanted", np.flatnonzero(wanted), np.int64)
        self._made.set(n_wanted=len(numbers), ridge=ridge)
        return len(numbers)


def make_faces(
    offsets: Floats,
    over: Sequence[Floats],
    matrices: Floats,
    limits: Floats,
    into: Sequence[Floats | Bools],
) -> None:
    """Write the results of `fitted_faces.fit_faces` for n faces, from the offsets (12, 3, n) of
    their nodes.

    over : the facets' corners (n, 3, 3), normals (n, 3, 3) there, and their own (n, 3)
    matrices : (44, 12) from offsets to slopes at nodes and corners by u, by v, and to terms
    limits : (4,) MOST_OFFSET, and of FACE least_cosine, swollen and extra_bulge
    into : coefficients (n, 14, 3), normals (n, 15, 3) at nodes and corners, is_whole (n,) and
        is_swollen (n,); each contiguous
    """
    n = offsets.shape[2]
    given = [np.ascontiguousarray(a, float) for a in (offsets, *over, matrices, limits)]
    addresses = (array.ctypes.data for array in given)
    results = (array.ctypes.data for array in into)
    loaded().kiriko_make_faces(*addresses, n, *results, n_threads())


def agree(
    faces: Sequence[Floats],
    neighbours: tuple[Ints, Ints, Ints, Bools],
    weights: Sequence[Floats],
    least: float,
    some: slice,
    into: Sequence[Floats],
) -> None:
    """Write the agreed normals (p, 12, 3) of some of p faces, and their jumps (p, 9), as
    `agreement.agreement_steps`.

    faces : their normals (p, 15, 3), normals of their vertices (p, 3, 3), and areas (p,)
    neighbours : row (t,), triangle (p, 3), edge (p, 3) and is_drawn (p, 3) of
        `agreement.FaceNeighbours`
    weights : (9, 3) from corners to normals at nodes on edges; (3, 15) from changes at nodes and
        corners to changes inside
    least : smaller changes leave the nodes inside unchanged
    """
    first, last, _ = some.indices(len(faces[0]))
    given = [np.ascontiguousarray(a, float) for a in faces]
    given += [
        np.ascontiguousarray(values, dtype)
        for values, dtype in zip(neighbours, (np.int32, np.int32, np.int8, bool), strict=True)
    ]
    given += [np.ascontiguousarray(a, float) for a in weights]
    addresses = (array.ctypes.data for array in given)
    results = (array.ctypes.data for array in into)
    loaded().kiriko_agree(*addresses, least, first, last - first, *results, n_threads())
