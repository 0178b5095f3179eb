"""The structures of kiriko.h, field by field, and the arrays they point to."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import DTypeLike


def _structure(name: str, **fields: Any) -> type[ctypes.Structure]:
    """A structure of kiriko.h: fields in order, each a C type or an array type."""
    return type(name, (ctypes.Structure,), {"_fields_": list(fields.items())})


_P = ctypes.c_void_p
_I = ctypes.c_int64
_D = ctypes.c_double

TreeStructure = _structure("TreeStructure", nodes=_P, items=_P)
CurvedStructure = _structure(
    "CurvedStructure",
    corners=_P, row=_P, coefficients=_P, neighbour=_P, neighbour_edge=_P, vertex=_P,
    vertex_normal=_P, normal_row=_P, normal_terms=_P, lower=_P, to_bezier=_P,
    n_quartics=_I, corner_normals=_P,
)  # fmt: skip
EngineTrianglesStructure = _structure(
    "HullStructure", corners=_P, owner=_P, places=_P, n_whole=_I, tree=TreeStructure
)
LayerStructure = _structure(
    "LayerStructure",
    n_triangles=_I, frames=_P, numbers=_P, only_part=_I, closed_bits=_P, solid_bits=_P, curved=_P,
    engine_triangles=_P, rotation=_P, shift=_D * 3, low=_D * 3, high=_D * 3, centre=_D * 3,
    radius=_D, tolerance=_D, has_engine=_I, n_starts=_I, over_faces=TreeStructure, facets=_P,
)  # fmt: skip
ArrayStructure = _structure(
    "ArrayStructure",
    centre=_D * 3, axes=_D * 9, pitch=_D, height=_D, thickness=_D, ior=_D, reflectance=_D,
    crossing_error=_D, phase=_D * 2, layout=_I, has_fresnel=_I,
)  # fmt: skip
SplitStructure = _structure("SplitStructure", reflectance=_D, transmittance=_D, prefers=_I)
LensStructure = _structure("LensStructure", centre=_D * 3, focal_length=_D)
PlanStructure = _structure(
    "PlanStructure",
    normals=_P, corner_normals=_P, is_bent=_P, patch=_P, part=_P, kind=_P, cluster=_P, sheet=_P,
    is_closed=_P, is_clear=_P, bit=_P, elements=_P, indices=_P, absorptions=_P,
    n_triangles=_I, n_open=_I, n_deferred=_I, n_layers=_I, open_part=_P, open_box=_P,
    deferred_box=_P, layers=_P, order=_P, merge_distance=_D, max_events=_I, has_glass=_I,
    only_through_glass=_I, needs_plate=_I, looks_beside=_I, brightness=_I, has_plane=_I,
    is_by_glass=_I, display_start=_I,
    plane_corner=_D * 3, plane_normal=_D * 3, plane_pixels=_D * 6, plane_origin=_D * 2,
    display_uv=_P, display_size=_D * 2,
)  # fmt: skip
RayStateStructure = _structure(
    "RayStateStructure",
    positions=_P, directions=_P, mask=_P, cluster=_P, reason=_P, branch=_P, xy=_P, throughput=_P,
    absorption=_P, n_events=_P, rank=_P, n_splits=_P, has_met_glass=_P, has_met_plate=_P,
    plate_path=_P, last_part=_P, leak=_P, course=_P, width=_I, is_recorded=_I, light=_I,
    n_words=_P, is_astray=_P, has_ended=_P, is_begun=_P, n_asked=_I, n_copies=_I, n_rays=_I,
    n_steps=_I, places=_P, met=_P, left_at=_P, is_reached=_P, is_unready=_P,
)  # fmt: skip
DivisionStructure = _structure(
    "DivisionStructure",
    view=_P, display=_P, n_cells=_I, n_corners=_I, width=_I, height=_I, cell=_I, part=_I,
    row=_I, column=_I, n=_I, room=_I, pixel=_P, wide_pixel=_P, view_xy=_P, covariance=_P,
    area=_P, display_area=_P, number=_P,
)  # fmt: skip
FlatTapsStructure = _structure(
    "StrokesStructure",
    pixel=_P, wide_pixel=_P, view_xy=_P, covariance=_P, apart=_I, area=_P, throughput=_P, n=_I,
    matrix=_D * 9, low=_D * 2, high=_D * 2, size=_D * 2,
)  # fmt: skip
LevelStructure = _structure("LevelStructure", pixels=_P, width=_I, height=_I, stride=_I)
N_STRIPES = 16
KeptTapsStructure = _structure(
    "KeptTapsStructure", taps=_P * N_STRIPES, n=_I * N_STRIPES, room=_I * N_STRIPES
)
FitStructure = _structure(
    "FitStructure",
    at=_P, normal=_P, axis_x=_P, axis_y=_P, size=_P, is_known=_P, is_rim=_P, first=_P, end=_P,
    wanted=_P, n_wanted=_I, ridge=_D * 14,
)  # fmt: skip
N_LEVELS = 5
ThinPartsStructure = _structure(
    "ThinPartsStructure",
    boxes=_P * N_LEVELS, children=_P * N_LEVELS, frames=_P, unit_of_patch=_P, n_patches=_I,
    n_units=_I,
)  # fmt: skip
PathsStructure = _structure(
    "PathsStructure",
    places=_P, met=_P, rays=_P, n=_I, n_rays=_I, n_events=_I, widest=_D, touched=_P,
)  # fmt: skip
HalvingStructure = _structure(
    "HalvingStructure",
    start=_P, way=_P, branch=_P, low=_P, width=_P, xy=_P, throughput=_P, n_tried=_P, least=_D,
    position=_D * 3, axes=_D * 9, window=_D * 4, size=_D * 2, is_orthographic=_I,
)  # fmt: skip
SumStructure = _structure(
    "SumStructure",
    pixel=_P, wide_pixel=_P, places=_P, weights=_P, n=_I, image=_P, width=_I, height=_I,
)  # fmt: skip
TreeTaskStructure = _structure(
    "GrowthStructure",
    boxes=_P, n=_I, nodes=_P, items=_P, n_nodes=_I, n_blocks=_I, is_cancelled=_I,
)  # fmt: skip
BYTES_OF_TAP = 32
NODE = np.dtype([("sides", np.float32, (6, 4)), ("children", np.int32, 4), ("unused", np.int32, 4)])

STRUCTURES = (
    *(TreeStructure, CurvedStructure, EngineTrianglesStructure, LayerStructure),
    *(ArrayStructure, SplitStructure, PlanStructure, RayStateStructure),
    *(DivisionStructure, FlatTapsStructure, LevelStructure, KeptTapsStructure),
    *(FitStructure, ThinPartsStructure, PathsStructure, HalvingStructure, SumStructure),
    TreeTaskStructure,
)


class Made:
    """A structure with the arrays it points to, to keep them alive."""

    def __init__(self, kind: type[ctypes.Structure]) -> None:
        self.structure = kind()
        self.references: list[object] = []
        self.layers: list[Made] = []  # of a plan

    def keep(self, *others: object) -> None:
        self.references += others

    def hold(self, array: np.ndarray, dtype: DTypeLike) -> np.ndarray:
        """Keep an array alive: the same one if of this type and contiguous, else a copy."""
        array = np.ascontiguousarray(array, dtype)
        self.keep(array)
        return array

    def point(self, name: str, array: np.ndarray | None, dtype: DTypeLike) -> np.ndarray | None:
        """Point a field to an array, or to NULL without one; returns the array held."""
        if array is not None:
            array = self.hold(array, dtype)
            setattr(self.structure, name, array.ctypes.data)
        return array

    def set(self, **values: object) -> None:
        for name, value in values.items():
            if isinstance(value, np.ndarray):
                value = getattr(self.structure, name).__class__(*value.ravel().tolist())
            setattr(self.structure, name, value)
