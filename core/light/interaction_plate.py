"""A plate: sends light to the mirror image of its origin, ideally or by many mirrors."""

from dataclasses import replace

import numpy as np

from ..base.arrays import Floats, Ints
from ..base.errors import RigError
from ..base.vectors import dot
from ..glass.surfaces import Surface, make_surface
from ..rig.rig import Lens, Plate
from .hits import Hits
from .interaction_display import end_beyond_plate
from .meetings import Interaction, key_of_facets
from .mesh_cache import MeshCache
from .optics import plane_symmetry
from .plan import Plan
from .plate import ArrayFrame, Crossing, PlatePath, array_frame
from .rays import PLATE, Rays

# largest distance of a flat part's vertices from its plane, relative to its size
PLATE_FLATNESS = 1e-6


def flat_surface(part: Plate | Lens, mesh_cache: MeshCache) -> tuple[Surface, str]:
    """A flat part's triangles as one patch of one plane; RigError if they are not coplanar."""
    key = key_of_facets(part.mesh)
    return mesh_cache.get(f"plane {key}", lambda: _plane(part)), key


def _plane(part: Plate | Lens) -> Surface:
    facets = make_surface(part.mesh.flat())
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
        raise RigError("'{name}' has no area: scale it up.", name=part.name)

    normal /= length
    if np.abs((corners - centre) @ normal).max() > PLATE_FLATNESS * np.ptp(corners, axis=0).max():
        raise RigError("'{name}' is not a flat plane: replace it.", name=part.name)

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
            _cross_array(plan, plate, rays, these, normals[some])
        else:
            if plan.is_polarised:
                rays.reference[these] = plane_symmetry(rays.reference[these], normals[some])
            rays.directions[these] = plane_symmetry(rays.directions[these], normals[some])
            rays.plate_path[these] = np.maximum(rays.plate_path[these], PlatePath.IMAGED)

    rays.has_met_plate[i] = True
    rays.add_to_branch(i, plan.triangles.patch[hits.triangle], PLATE)

    goes_along = (dot(rays.directions[i], normals) > 0).astype(int)
    clear = plan.parts.is_clear[plan.triangles.part[hits.triangle], goes_along]
    if clear.any():
        end_beyond_plate(plan, rays, i[clear])


def _cross_array(plan: Plan, array: ArrayFrame, rays: Rays, i: Ints, normals: Floats) -> None:
    is_again = rays.has_met_plate[i]
    again = "folded" if rays.light == "reflected" else rays.light
    for light, of_light in ((rays.light, ~is_again), (again, is_again)):
        some = i[of_light]
        if not len(some):
            continue

        crossing = getattr(array, light)(rays.positions[some], rays.directions[some])
        if plan.is_polarised:
            _polarise(rays, some, normals[of_light], crossing)
        rays.positions[some] = crossing.positions
        rays.directions[some] = crossing.directions

        before = rays.plate_path[some]
        rays.plate_path[some] = np.where(before > PlatePath.IMAGED, before, crossing.path)
        if plan.settings.brightness:
            rays.throughput[some] *= crossing.throughput


def _polarise(rays: Rays, i: Ints, normals: Floats, crossing: Crossing) -> None:
    """Two mirrors turn polarised light about the normals (n, 3); one reflects it; through light is
    unchanged.
    """
    is_imaged = crossing.path == PlatePath.IMAGED
    two, others = i[is_imaged], i[~is_imaged]
    rays.reference[two] = plane_symmetry(rays.reference[two], normals[is_imaged])
    sign = np.where(crossing.path[~is_imaged] == PlatePath.THROUGH, 1.0, -1.0)
    rays.pass_on(others, rays.passed(others, crossing.directions[~is_imaged], sign, 1.0))


INTERACTION = Interaction(interact, flat_surface, element=element)
