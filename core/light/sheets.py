"""All parts of a rig that are no solids: plates, mirrors, blockers and the display."""

from dataclasses import replace

import numpy as np

from ..arrays import FLOAT32, Bools, Floats, Ints
from ..errors import RigError
from ..fingerprint import fingerprint
from ..glass.surfaces import Surface, make_surface
from ..kinds import Kind
from ..rig import Mesh, Plate, Rig
from ..vectors import dot
from .display import uv_islands
from .kept import Kept
from .layers import BULGE

FLAT = 1e-6  # a plate's vertices may leave its plane by this much of its size


def plate_surface(plate: Plate) -> Surface:
    """A plate's triangles as one patch of one plane; RigError when they do not lie in one."""
    surface = make_surface(plate.mesh.flat())
    corners = surface.corners.reshape(-1, 3)
    centre = corners.mean(axis=0)
    areas = np.cross(
        surface.corners[:, 1] - surface.corners[:, 0], surface.corners[:, 2] - surface.corners[:, 0]
    )
    largest = areas[np.argmax(dot(areas, areas))]
    normal = (areas * np.sign(areas @ largest)[:, None]).sum(axis=0)  # whichever way its faces look
    length = np.linalg.norm(normal)
    if length == 0:
        raise RigError("The plate '{plate}' has no area: scale it up.", plate=plate.name)
    normal /= length
    if np.abs((corners - centre) @ normal).max() > FLAT * np.ptp(corners, axis=0).max():
        raise RigError(
            "The plate '{plate}' is not flat: a plate has to be a plane.", plate=plate.name
        )
    n = len(surface.corners)
    return replace(surface, normals=np.tile(normal, (n, 1)), patch=np.zeros(n, np.int64))


def find_sheets(surfaces: list[Surface], kind: Ints) -> Ints:
    """For each part (p,) the first one in whose plane it lies if both are plates, else itself.

    Light that has met one plate is beyond all of its plane: where plates overlap they act as one.
    """
    sheet = np.arange(len(surfaces))
    plates = np.flatnonzero(kind == Kind.PLATE)
    for n, i in enumerate(plates):
        for j in plates[:n]:
            one = surfaces[j]
            other = surfaces[i].corners
            far = 2 * FLOAT32 * max(np.abs(other).max(), np.abs(one.corners).max())
            if np.abs((other - one.corners[0, 0]) @ one.normals[0]).max() <= far:
                sheet[i] = sheet[j]
                break
    return sheet


def find_clear(surfaces: list[Surface], kind: Ints, aside: Floats) -> Bools:
    """Is all of the rig but the display on one side of each
    plate: (p, 2) none before its normal, none behind it?

    Boxes (a, 2, 3) of glass that stands aside are parts of the rig, too.
    """
    is_clear = np.zeros((len(surfaces), 2), bool)
    for i in np.flatnonzero(kind == Kind.PLATE):
        normal = surfaces[i].normals[0]
        others = [s.bounds for k, s in enumerate(surfaces) if k != i and kind[k] != Kind.DISPLAY]
        boxes = np.concatenate([np.stack(others), aside])
        # how far boxes reach along the normal; a face that bulges out
        # of its facet stays well within half their size
        middle = boxes.mean(axis=1)
        half = (0.5 + BULGE) * (boxes[:, 1] - boxes[:, 0])
        height = (middle - surfaces[i].corners[0, 0]) @ normal
        reach = half @ np.abs(normal)
        is_clear[i] = (height - reach > 0).all(), (height + reach < 0).all()
    return is_clear


def read_sheets(rig: Rig, kept: Kept) -> list[tuple[Kind, Surface, str]]:
    """Everything that is no solid, the display last, with a key for each."""

    def mirror(mesh: Mesh) -> tuple[Kind, Surface, str]:
        key = fingerprint(mesh)
        return Kind.MIRROR, kept.get(key, lambda: make_surface(mesh)), f"{key}/0"

    def flat(kind: Kind, mesh: Mesh, surface: Surface) -> tuple[Kind, Surface, str]:
        return kind, surface, f"{fingerprint(mesh.flat())}/0"

    display = replace(make_surface(rig.display.mesh.flat()), patch=uv_islands(rig.display.mesh))
    return [
        *(flat(Kind.PLATE, plate.mesh, plate_surface(plate)) for plate in rig.plates),
        *(mirror(part.mesh) for part in rig.mirrors),
        *(flat(Kind.BLOCKER, part.mesh, make_surface(part.mesh.flat())) for part in rig.blockers),
        flat(Kind.DISPLAY, rig.display.mesh, display),
    ]


def mirrors_among(rig: Rig, sheets: list[tuple[Kind, Surface, str]]) -> list[int]:
    """For each sheet its number among the rig's glasses and mirrors, -1 where it is no mirror."""
    numbers = iter(range(len(rig.glasses), len(rig.glasses) + len(rig.mirrors)))
    return [next(numbers) if kind == Kind.MIRROR else -1 for kind, *_ in sheets]
