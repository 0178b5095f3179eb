"""A plate: sends light to the mirror image of its origin, ideally or by many mirrors."""

from dataclasses import replace

import numpy as np

from ..base.arrays import Ints
from ..base.errors import RigError
from ..base.vectors import dot
from ..glass.surfaces import Surface, make_surface
from ..rig.rig import Plate
from .hits import Hits
from .interaction_display import end_beyond_plate
from .meetings import Interaction, key_of_facets
from .mesh_cache import MeshCache
from .optics import plane_symmetry
from .plan import Plan
from .plate import ArrayFrame, PlatePath, array_frame
from .rays import PLATE, Rays

# largest distance of a plate's vertices from its plane, relative to its size
PLATE_FLATNESS = 1e-6


def surface(plate: Plate, mesh_cache: MeshCache) -> tuple[Surface, str]:
    """A plate's triangles as one patch of one plane; RigError if they are not coplanar."""
    key = key_of_facets(plate.mesh)
    return mesh_cache.get(f"plate {key}", lambda: _plane(plate)), key


def _plane(plate: Plate) -> Surface:
    facets = make_surface(plate.mesh.flat())
    corners = facets.corners.reshape(-1, 3)
    centre = corners.mean(axis=0)

    # area-weighted sum of face normals, flipped to agree with the largest face
    areas = np.cross(
        facets.corners[:, 1] - facets.corners[:, 0], facets.corners[:, 2] - facets.corners[:, 0]
    )
    largest = areas[np.argmax(dot(areas, areas))]
    normal = (areas * np.sign(areas @ largest)[:, None]).sum(axis=0)  # for any winding

    length = np.linalg.norm(normal)
    if length == 0:
        raise RigError("The plate '{plate}' has no area: scale it up.", plate=plate.name)

    normal /= length
    if np.abs((corners - centre) @ normal).max() > PLATE_FLATNESS * np.ptp(corners, axis=0).max():
        raise RigError("The plate '{plate}' is not a flat plane: replace it.", plate=plate.name)

    n = len(facets.corners)
    return replace(facets, normals=np.tile(normal, (n, 1)), patch=np.zeros(n, np.int64))


def element(plate: Plate, surface: Surface) -> Plate | ArrayFrame:
    """The array frame of a plate of mirrors, or the ideal plate itself."""
    return plate if plate.array is None else array_frame(plate, surface.normals[0])


def interact(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """Redirect light by the plate's mirrors or as an ideal plate; land if only the display lies
    beyond.
    """
    normals = plan.triangles.normals[hits.triangle]
    for plate, some in plan.part_of(hits.triangle):
        these = i[some]
        if isinstance(plate, ArrayFrame):
            _cross_array(plan, plate, rays, these)
        else:
            rays.directions[these] = plane_symmetry(rays.directions[these], normals[some])
            rays.plate_path[these] = np.maximum(rays.plate_path[these], PlatePath.IMAGED)

    rays.has_met_plate[i] = True
    rays.add_to_branch(i, plan.triangles.patch[hits.triangle], PLATE)

    goes_along = (dot(rays.directions[i], normals) > 0).astype(int)
    clear = plan.parts.is_clear[plan.triangles.part[hits.triangle], goes_along]
    if clear.any():
        end_beyond_plate(plan, rays, i[clear])


def _cross_array(plan: Plan, array: ArrayFrame, rays: Rays, i: Ints) -> None:
    is_again = rays.has_met_plate[i]
    again = "folded" if rays.light == "reflected" else rays.light
    for light, some in ((rays.light, i[~is_again]), (again, i[is_again])):
        if not len(some):
            continue

        crossing = getattr(array, light)(rays.positions[some], rays.directions[some])
        rays.positions[some] = crossing.positions
        rays.directions[some] = crossing.directions

        before = rays.plate_path[some]
        rays.plate_path[some] = np.where(before > PlatePath.IMAGED, before, crossing.path)
        if plan.settings.brightness:
            rays.throughput[some] *= crossing.throughput


INTERACTION = Interaction(interact, surface, element=element)
