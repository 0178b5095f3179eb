"""Where the parts of a new rig stand, and how large its display has to be. Lengths in m, or all in another unit.

The viewer looks along f; the picture stands in the glass's centre c and faces the viewer; the plate stands at c + D f.
The display stands where the plate images the picture: at its mirror image in the plate, turned as a mirror turns it.
"""

from dataclasses import dataclass

import numpy as np

from .optics import dot, reflect
from .plan import Plan
from .rig import Floats, Picture
from .trace import REASON_WORDS, trace_all

GRID = 256  # points along each edge of a triangle of the picture whose rays are followed


@dataclass(frozen=True, eq=False)
class Placement:
    """Frames (4, 4) of the parts: columns right, up, front, position; right-handed. The viewer looks along -front."""

    viewer: Floats
    picture: Floats
    plate: Floats
    display: Floats


def frame(right: Floats, up: Floats, position: Floats) -> Floats:
    """Right-handed frame (4, 4) with the given axes (3,) and origin (3,)."""
    matrix = np.eye(4)
    matrix[:3, :4] = np.stack([right, up, np.cross(right, up), position], axis=1)
    return matrix


def place(centre: Floats, distance: float, tilt: float, viewer_distance: float, azimuth: float = 0.0) -> Placement:
    """Stand the parts of a rig around a glass, z up.

    Parameters
    ----------
    centre : (3,) of the glass
    distance : from there to the plate's centre along the view axis
    tilt : rad, of the plate about the horizontal; 0 faces the viewer, pi/4 has the display straight below the plate
    viewer_distance : from the centre to the viewer
    azimuth : rad, by which the viewer goes round the glass about z; at 0 it looks along +y
    """
    centre = np.asarray(centre, float)
    forward = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    right, up = np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), np.array([0.0, 0.0, 1.0])
    normal = np.cos(tilt) * forward - np.sin(tilt) * up
    plate_centre = centre + distance * forward
    mirrored = centre + 2 * dot(plate_centre - centre, normal) * normal
    return Placement(
        frame(right, up, centre - viewer_distance * forward),
        frame(right, up, centre),
        frame(right, np.cross(normal, right), plate_centre),
        frame(reflect(right, normal), reflect(up, normal), mirrored),
    )


def points_of(picture: Picture) -> Floats:
    """Points (n, 3) spread evenly over the triangles of a picture, their edges included."""
    a, b = (x.ravel() / GRID for x in np.meshgrid(np.arange(GRID + 1.0), np.arange(GRID + 1.0)))
    keep = a + b <= 1 + 0.5 / GRID
    weights = np.stack([a, b, 1 - a - b], axis=1)[keep]
    return np.einsum("pk,tkc->tpc", weights, picture.mesh.corners).reshape(-1, 3)


def reach_of_picture(plan: Plan, display_frame: Floats) -> tuple[Floats, dict[str, float]]:
    """How far from the display's centre the light that carries the picture lands, by tracing it.

    Parameters
    ----------
    plan : of a rig whose display is as large as allowed
    display_frame : (4, 4) of the display, m

    Returns
    -------
    reach : (2,) m, half of the width and height the display needs
    lost : share of the picture's rays that do not arrive, by reason; points out of the viewer's sight do not count
    """
    viewer = plan.rig.viewer
    xy = viewer.project(points_of(plan.rig.picture))
    is_seen = ((xy >= 0) & (xy <= (viewer.width, viewer.height))).all(axis=1)  # false for NaN too
    landings = trace_all(plan, *viewer.rays(xy[is_seen]))
    arrived = landings.has_arrived
    across = (landings.positions[arrived] - display_frame[:3, 3]) @ display_frame[:3, :2]
    reach = np.abs(across).max(axis=0) if arrived.any() else np.zeros(2)
    counts = {word: int((landings.reason == reason).sum()) for reason, word in REASON_WORDS.items()}
    return reach, {word: count / len(arrived) for word, count in counts.items() if count}


def lattice(pixels: int = 1024, n: int = 7) -> np.ndarray:
    """The default picture: n x n dots on black whose colour says which is which.

    Dot (i, j), column i from the left and row j from the top, has linear red 1, green (i + 1) / (n + 1) and blue
    (j + 1) / (n + 1); its centre is at ((i + 1/2) / n, (j + 1/2) / n) of the picture, its radius a fifth of the pitch.

    Returns
    -------
    (pixels, pixels, 3) float32, linear, row 0 at the top; edges antialiased over one pixel
    """
    pitch = pixels / n
    at = np.arange(pixels) + 0.5
    index = np.minimum((at / pitch).astype(int), n - 1)
    offset = at - (index + 0.5) * pitch
    disc = np.clip(0.2 * pitch + 0.5 - np.hypot(offset[:, None], offset[None, :]), 0.0, 1.0)
    weight = (index + 1) / (n + 1)
    colour = np.stack(np.broadcast_arrays(1.0, weight[None, :], weight[:, None]), axis=2)
    return (disc[..., None] * colour).astype(np.float32)
