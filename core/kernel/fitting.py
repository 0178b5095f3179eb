"""Fits curved faces vertex by vertex and face by face, as
`surface_fit.py` and the files that it asks do at once.
"""

import ctypes
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Bools, Floats, Ints
from .loading import loaded, n_threads
from .structures import FitStructure, Made

if TYPE_CHECKING:
    from ..glass.vertex_fields import Fields
    from ..glass.vertices import Vertices

FITTED_AT_ONCE = 256  # vertices, as in fit.c


class Fit:
    """Vertices with frames of their own, over which the surface is a height field."""

    def __init__(self, v: "Vertices", fields: "Fields") -> None:
        self._made = made = Made(FitStructure)
        for name, values in (
            ("at", v.at),
            ("normal", v.normal),
            ("axis_x", fields.axis_x),
            ("axis_y", fields.axis_y),
        ):
            made.point(name, values, float)

        made.point("size", fields.size, float)
        made.point("is_known", v.is_known, np.uint8)
        made.point("first", v.first, np.int64)
        made.point("end", v.end, np.int64)

        self._n_pairs = len(v.end)
        self._address = ctypes.addressof(made.structure)

    def fit_fields(self, wanted: Bools, ridge: Floats, coefficients: Floats) -> None:
        """Write the coefficients (f, 14) of the wanted
        vertices' (f,) fields, but for the first two.

        ridge : (14,) added to the terms' squares
        """
        self._want(wanted, ridge)
        loaded().kiriko_fit_fields(self._address, coefficients.ctypes.data, n_threads())

    def settle_normals(
        self, wanted: Bools, ridge: Floats, normals: Floats, n_sweeps: int, settled: float
    ) -> Floats:
        """Let the wanted (f,) of normals (f, 3) agree with those of their neighbours, by so many
        sweeps at the most, an even number. Returns by how much the last one changed each (f, 3).
        """
        n = self._want(wanted, ridge)
        # sweeps write to one and the other in turn: of all, the last is in `normals`
        others = normals.copy()
        room = (
            others,
            np.empty((n, 2)),
            np.empty((self._n_pairs, 4)),
            np.empty(n // FITTED_AT_ONCE + 1),
        )
        places = (values.ctypes.data for values in (normals, *room))
        loaded().kiriko_settle_normals(self._address, *places, n_sweeps, settled, n_threads())
        return normals - others

    def find_offsets(
        self, coefficients: Floats, nodes: Floats, weights: Floats, corner: Ints
    ) -> Floats:
        """Offsets (12, 3, n) of the nodes of triangles with
        corners (n, 3), by fields' coefficients (f, 14).
        """
        corner = np.ascontiguousarray(corner, np.int64)
        offsets = np.zeros((len(nodes), 3, len(corner)))
        places = (values.ctypes.data for values in (coefficients, nodes, weights, corner))
        loaded().kiriko_find_offsets(
            self._address, *places, len(corner), offsets.ctypes.data, n_threads()
        )
        return offsets

    def _want(self, wanted: Bools, ridge: Floats) -> int:
        """Say which vertices are wanted; how many these are."""
        numbers = self._made.point("wanted", np.flatnonzero(wanted), np.int64)
        self._made.set(n_wanted=len(numbers), ridge=ridge)
        return len(numbers)
