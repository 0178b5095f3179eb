"""Where the parts of a new rig with a plate stand, and how large they are. Lengths in m.

The viewer looks along f; the picture stands in the glass's centre c and faces the viewer; the plate
stands at c + D f. The display stands where the plate images the picture: at its mirror image in the
plate, turned as a mirror turns it.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Floats
from ..base.vectors import dot
from ..light.optics import reflect
from ..rig.rig import Display, Mesh, PicturePlace, Plate, Rig, Viewer


@dataclass(frozen=True)
class ReferenceBench:
    """The bench of Kiriko's reference, for a glass up to `large_m` wide; a larger one scales all.

    distance_m : from the glass's centre to the plate's
    viewer_distance_m : from the glass's centre to the viewer
    plate_m : side of the plate
    picture_share : of the glass's smaller side: the plate takes all light
        of it from balls of index up to 1.6
    most_display : times the picture, of a display's shorter side, where nobody says how wide it may
        be
    """

    large_m: float = 0.1
    distance_m: float = 0.15
    viewer_distance_m: float = 1.0
    plate_m: float = 0.488
    picture_share: float = 0.5
    most_display: float = 10


REFERENCE_BENCH = ReferenceBench()


@dataclass(frozen=True, eq=False)
class Placement:
    """Frames (4, 4) of the parts: columns right, up, front, position.

    Right-handed. The viewer looks along -front. plate: None where there is none.
    """

    viewer: Floats
    picture: Floats
    plate: Floats | None
    display: Floats


def frame(right: Floats, up: Floats, position: Floats) -> Floats:
    """Right-handed frame (4, 4) with the given axes (3,) and origin (3,)."""
    matrix = np.eye(4)
    matrix[:3, :4] = np.stack([right, up, np.cross(right, up), position], axis=1)
    return matrix


def place(
    centre: Floats, distance: float, tilt: float, viewer_distance: float, azimuth: float = 0.0
) -> Placement:
    """Stand the parts of a rig around a glass, z up.

    Parameters
    ----------
    centre : (3,) of the glass
    distance : from there to the plate's centre along the view axis
    tilt : rad, of the plate about the horizontal; 0 faces the
        viewer, pi/4 has the display straight below the plate
    viewer_distance : from the centre to the viewer
    azimuth : rad, by which the viewer goes round the glass about z; at 0 it looks along +y
    """
    # the viewer's axes
    centre = np.asarray(centre, float)
    forward = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    right = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    up = np.array([0.0, 0.0, 1.0])

    # the plate, and the mirror image of the picture in it
    normal = np.cos(tilt) * forward - np.sin(tilt) * up
    plate_centre = centre + distance * forward
    mirrored = centre + 2 * dot(plate_centre - centre, normal) * normal

    return Placement(
        frame(right, up, centre - viewer_distance * forward),
        frame(right, up, centre),
        frame(right, np.cross(normal, right), plate_centre),
        frame(reflect(right, normal), reflect(up, normal), mirrored),
    )


@dataclass(frozen=True)
class Wishes:
    """The request for a new rig: lengths in m, 0 where the glass decides; angles in rad.

    `field` is the width that the viewer sees at the glass; `distance` the way from the glass's
    centre to the plate's, or from its back to the display where there is no plate; `look_down` the
    angle by which a viewer of such a rig looks down; `max_display` the most that a display may have
    by itself; `aspect` the display's width by its height.
    """

    distance: float = 0.0
    tilt: float = np.pi / 4
    azimuth: float = 0.0
    picture: float = 0.0
    viewer_distance: float = 0.0
    field: float = 0.0
    plate: float = 0.0
    display: float = 0.0
    max_display: float = 0.0
    aspect: float = 1.0
    look_down: float = 0.0


@dataclass(frozen=True, eq=False)
class Proposal:
    """A new rig: where its parts stand; sides of picture and plate, width of display and field, m.

    The display is as wide as it may be, until the light of the picture has been traced to it.
    """

    placement: Placement
    viewer_distance: float
    field: float
    plate: float
    picture: float
    display: float


def propose(bounds: Floats, wishes: Wishes) -> Proposal:
    """A rig around glass within these bounds (2, 3), world, m."""
    # the size of the glass, as the viewer sees it
    low, high = bounds
    corners = np.stack(np.meshgrid(*bounds.T), axis=-1).reshape(-1, 3)
    width = np.ptp(corners @ np.array([np.cos(wishes.azimuth), np.sin(wishes.azimuth), 0.0]))
    height = high[2] - low[2]
    wide = float(max(width, height))
    grow = max(1.0, wide / REFERENCE_BENCH.large_m)

    picture = wishes.picture or REFERENCE_BENCH.picture_share * float(min(width, height) or wide)
    distance = wishes.distance or REFERENCE_BENCH.distance_m * grow
    away = wishes.viewer_distance or REFERENCE_BENCH.viewer_distance_m * grow
    most = REFERENCE_BENCH.most_display * picture * max(wishes.aspect, 1.0)
    return Proposal(
        placement=place((low + high) / 2, distance, wishes.tilt, away, wishes.azimuth),
        viewer_distance=away,
        field=wishes.field or wide,
        plate=wishes.plate or REFERENCE_BENCH.plate_m * grow,
        picture=picture,
        display=wishes.display or wishes.max_display or most,
    )


def rectangle(at: Floats, width: float, height: float) -> Mesh:
    """A plane in the frame `at` (4, 4), whose front is the
    third axis, with UV from its lower left corner.
    """
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    across = (uv - 0.5) * (width, height)
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(across @ at[:3, :2].T + at[:3, 3], triangles, uv=uv[triangles])


def viewer_of(proposal: Proposal, pixels: tuple[int, int], aspect: float = 1.0) -> Viewer:
    """The viewer, whose longer side is the field.

    Pixels (width, height), each `aspect` times as wide as high.
    """
    right, up, front = proposal.placement.viewer[:3, :3].T
    sides = np.array([pixels[0] * aspect, pixels[1]])
    x, y = 0.5 * proposal.field / proposal.viewer_distance * sides / sides.max()
    at = proposal.placement.viewer[:3, 3]
    return Viewer(
        "Kiriko Viewer", "perspective", at, np.stack([right, up, -front]), (-x, x, -y, y), *pixels
    )


def rig_of(proposal: Proposal, bench: Rig, viewer: Viewer, pixels: tuple[int, int]) -> Rig:
    """The parts on the bench already, and the proposal's.

    Parameters
    ----------
    bench : glass, and the plates, mirrors and blockers that are there
    pixels : width and height of the display
    """
    where = proposal.placement
    columns, rows = pixels
    plates = bench.plates
    if where.plate is not None:
        plate = rectangle(where.plate, proposal.plate, proposal.plate)
        plates = (*plates, Plate("Kiriko Plate", plate))

    picture = rectangle(where.picture, proposal.picture, proposal.picture)
    display = rectangle(where.display, proposal.display, proposal.display * rows / columns)

    return replace(
        bench,
        viewers=(viewer,),
        plates=plates,
        displays=(Display("Kiriko Display", display, columns, rows),),
        pictures=(PicturePlace("Kiriko Picture", 1, 1, picture),),
    )


def lattice(pixels: int = 1024, n: int = 7) -> np.ndarray:
    """The default picture: n x n dots on black whose colour says which is which.

    Dot (i, j), column i from the left and row j from the top, has linear red 1, green (i + 1) / (n
    + 1) and blue (j + 1) / (n + 1); its centre is at ((i + 1/2) / n, (j + 1/2) / n) of the picture,
    its radius a fifth of the pitch.

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
    picture = np.empty((pixels, pixels, 3), np.float32)
    for k, colour in enumerate((1.0, weight[None, :], weight[:, None])):
        picture[..., k] = disc * colour
    return picture
