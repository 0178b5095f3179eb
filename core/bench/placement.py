"""Places and sizes, in m, of the parts of a new rig, with or without a plate, or of a new part.

With a plate: the viewer looks along f; the picture is in the glass's centre c and faces the viewer;
the plate is at c + D f. The display is at the picture's mirror image in the plate, turned as a
mirror turns it.

Without a plate: the viewer looks through the glass's centre at the display, which is upright
behind the glass, or lies under it if the viewer looks down steeply. The picture is at the display.

Each of picture, plate and display follows from the other two, so a deleted part can be made again.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Floats
from ..base.errors import RigError
from ..base.vectors import dot, normalise
from ..glass.meshes import box_of
from ..light.display import affine_fit
from ..light.optics import reflect
from ..rig.rig import Display, Mesh, PicturePlace, Plate, Rig, Viewer
from .part_sizes import plate_outline


@dataclass(frozen=True)
class ReferenceBench:
    """Kiriko's reference bench, for glass up to `large_m` wide; larger glass scales it.

    distance_m : from the glass's centre to the plate's
    viewer_distance_m : from the glass's centre to the viewer
    plate_m : side of the plate
    picture_share : of the glass's smaller side; the plate receives all light of a ball of index up
        to 1.6
    most_display : default limit of a display's shorter side, times the picture
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

    Right-handed; the viewer looks along -front. plate : None for none
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
    """Place the parts of a rig around a glass, z up.

    Parameters
    ----------
    centre : (3,) of the glass
    distance : from there to the plate's centre along the view axis
    tilt : rad, of the plate about the horizontal; at 0 it faces the viewer, at pi/4 the display is
        straight below it
    viewer_distance : from the centre to the viewer
    azimuth : rad, of the viewer about z; at 0 it looks along +y
    """
    # viewer's axes
    centre = np.asarray(centre, float)
    forward = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    right = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    up = np.array([0.0, 0.0, 1.0])

    # plate, and the picture's mirror image in it
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
    """Request for a new rig: lengths in m, 0 for automatic; angles in rad.

    `field` is the width the viewer sees at the glass. `distance` leads from the glass's centre to
    the plate's, or without a plate from its back to the display. `look_down` is the angle at which
    the viewer of a rig without a plate looks down. `max_display` limits an automatic display.
    `aspect` is the display's width by its height.
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
    """A new rig: frames of its parts; sides of picture and plate, width of display and field, m.

    The display has its largest width until the picture's light has been traced to it.
    """

    placement: Placement
    viewer_distance: float
    field: float
    plate: float
    picture: float
    display: float


def propose(bounds: Floats, wishes: Wishes) -> Proposal:
    """A rig around glass within bounds (2, 3), world, m."""
    # size of the glass, as the viewer sees it
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
    """A square in the frame `at` (4, 4), its front along the third axis, with UV from the lower
    left.
    """
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    across = (uv - 0.5) * (width, height)
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(across @ at[:3, :2].T + at[:3, 3], triangles, uv=uv[triangles])


def viewer_of(proposal: Proposal, pixels: tuple[int, int], aspect: float = 1.0) -> Viewer:
    """The viewer, with the field as its longer side.

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
    """The rig of a proposal, with the parts already on the bench.

    Parameters
    ----------
    bench : glass, and existing plates, mirrors and blockers
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
    """Default picture: n x n dots on black, each with its own colour.

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


@dataclass(frozen=True)
class StraightBench:
    """The bench without a plate, for glass of any size.

    lies_from : rad; from this view angle on the display lies under the glass
    gap_share : distance from the glass's back to an upright display, relative to its depth: light
        through the centre of a ball of index 1.5 then lands as far from the axis as it entered.
        Glass rests on a lying display
    lift_share : distance of the picture before the display, relative to the picture, so that both
        can be seen and selected
    """

    lies_from: float = np.pi / 4
    gap_share: float = 1.0
    lift_share: float = 0.01


STRAIGHT_BENCH = StraightBench()


def propose_behind(bounds: Floats, wishes: Wishes, aim: Floats | None = None) -> Proposal:
    """A rig without a plate, around glass within bounds (2, 3), world, m.

    aim : bounds (2, 3) of the glass whose centre the viewer looks at, if not all glass: between two
        glasses there is nothing to look at. The display is behind all glass
    """
    bench = STRAIGHT_BENCH
    aim = bounds if aim is None else aim
    centre = (aim[0] + aim[1]) / 2
    corners, of_aim = (
        np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3) - centre for box in (bounds, aim)
    )

    # viewer's axes
    level = np.array([-np.sin(wishes.azimuth), np.cos(wishes.azimuth), 0.0])
    right = np.array([np.cos(wishes.azimuth), np.sin(wishes.azimuth), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    down, along = np.sin(wishes.look_down), np.cos(wishes.look_down)
    forward = along * level - down * up
    upward = down * level + along * up

    # sizes of the glass, as the viewer sees it, and its reach towards the display
    lies = wishes.look_down >= bench.lies_from - 1e-6
    away = -up if lies else level
    width, height, depth = (float(np.ptp(of_aim @ axis)) for axis in (right, upward, away))
    # field for all glass
    wide = 2 * max(float(np.abs(corners @ axis).max()) for axis in (right, upward))
    grow = max(1.0, wide / REFERENCE_BENCH.large_m)
    gap = wishes.distance or (0.0 if lies else bench.gap_share * depth)
    way = (float((corners @ away).max()) + gap) / float(away @ forward)

    # The picture is behind the glass, so it is larger by perspective.
    distance = wishes.viewer_distance or REFERENCE_BENCH.viewer_distance_m * grow
    seen = REFERENCE_BENCH.picture_share * (min(width, height) or wide)
    picture = wishes.picture or seen * (distance + way) / distance
    at = centre + way * forward
    upright = level if lies else up
    most = REFERENCE_BENCH.most_display * picture * max(wishes.aspect, 1.0)

    return Proposal(
        placement=Placement(
            viewer=frame(right, upward, centre - distance * forward),
            picture=frame(right, upright, at - bench.lift_share * picture * away),
            plate=None,
            display=frame(right, upright, at),
        ),
        viewer_distance=distance,
        field=wishes.field or wide,
        plate=0.0,
        picture=picture,
        display=wishes.display or wishes.max_display or most,
    )


LEAST = 1e-6  # of a frame's place: closer ones coincide


@dataclass(frozen=True, eq=False)
class Stand:
    """Pose and size of a part.

    frame : (4, 4) columns right, up, front, position, world
    side : m, of a picture or a plate, of a display's shorter side, or the width a viewer sees
    distance : m, of a viewer from what it sees
    """

    frame: Floats
    side: float
    distance: float = 0.0


def stand_of(role: str, rig: Rig) -> Stand:
    """Pose and size for a missing part of a role.

    Raises
    ------
    RigError : too little is left of the rig
    """
    makers = {"DISPLAY": _display, "PICTURE": _picture, "PLATE": _plate, "VIEWER": _viewer}
    if not rig.glasses:
        raise _too_little()
    return makers[role](rig)


def _too_little() -> RigError:
    return RigError(
        "Too few parts are left to place this one: press Undo, or remove the rig and add it again."
    )


def _display(rig: Rig) -> Stand:
    picture = _picture_left(rig) or _in_glass(rig)
    if rig.plates:
        return Stand(_mirrored(picture.frame, rig), picture.side)
    lift = STRAIGHT_BENCH.lift_share * picture.side
    return Stand(_shifted(picture.frame, -lift), picture.side)


def _picture(rig: Rig) -> Stand:
    in_glass = _in_glass(rig)
    if not rig.displays:
        return in_glass
    shown = _frame_of(rig.display.mesh)
    if rig.plates:
        return Stand(_mirrored(shown, rig), in_glass.side)
    return Stand(_shifted(shown, STRAIGHT_BENCH.lift_share * in_glass.side), in_glass.side)


def _plate(rig: Rig) -> Stand:
    """Half way between picture and display, in the viewer's line of sight."""
    picture = (_picture_left(rig) or _in_glass(rig)).frame
    if not rig.displays:
        raise _too_little()
    way = _frame_of(rig.display.mesh)[:3, 3] - picture[:3, 3]
    if np.linalg.norm(way) <= LEAST * _wide(rig):
        raise _too_little()

    normal = normalise(way)
    middle = picture[:3, 3] + way / 2
    if rig.viewers:
        sight = normalise(picture[:3, 3] - rig.viewers[0].position)
        steep = sight @ normal
        if steep > LEAST:
            middle = picture[:3, 3] + sight * (np.linalg.norm(way) / 2 / steep)
    right = picture[:3, 0]
    right = normalise(right - (right @ normal) * normal)
    side = REFERENCE_BENCH.plate_m * _grow(rig)
    return Stand(frame(right, np.cross(normal, right), middle), side)


def _viewer(rig: Rig) -> Stand:
    """In front of the picture, as far from the glass's centre as in a new rig."""
    picture = (_picture_left(rig) or _in_glass(rig)).frame
    distance = REFERENCE_BENCH.viewer_distance_m * _grow(rig)
    to_glass = (_bounds(rig).mean(axis=0) - picture[:3, 3]) @ picture[:3, 2]
    return Stand(_shifted(picture, distance + to_glass), _wide(rig), distance)


def _picture_left(rig: Rig) -> Stand | None:
    """The existing picture; None if it has no plane."""
    mesh = rig.picture_place.mesh if rig.pictures else None
    if mesh is None:
        return None
    fit, _ = affine_fit(mesh.uv.reshape(-1, 2), mesh.corners.reshape(-1, 3))
    return Stand(_frame_of(mesh), float(np.linalg.norm(fit[:2], axis=1).min()))


def _in_glass(rig: Rig) -> Stand:
    """A picture in the centre of the glass, facing the viewer (or -y without one)."""
    right, up = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    if rig.viewers:
        right, up, _ = rig.viewers[0].axes
    low, high = _bounds(rig)
    corners = np.stack(np.meshgrid(*_bounds(rig).T), axis=-1).reshape(-1, 3)
    width, height = (float(np.ptp(corners @ np.asarray(axis))) for axis in (right, up))
    side = REFERENCE_BENCH.picture_share * (min(width, height) or max(width, height))
    return Stand(frame(np.asarray(right), np.asarray(up), (low + high) / 2), side)


def _bounds(rig: Rig) -> Floats:
    return box_of(np.concatenate([glass.mesh.bounds for glass in rig.glasses]))


def _wide(rig: Rig) -> float:
    return float(np.ptp(_bounds(rig), axis=0).max())


def _grow(rig: Rig) -> float:
    return max(1.0, _wide(rig) / REFERENCE_BENCH.large_m)


def _frame_of(mesh: Mesh) -> Floats:
    """Frame of a flat rectangle from its UV: right along u, up along v."""
    uv = mesh.uv.reshape(-1, 2)
    fit, _ = affine_fit(uv, mesh.corners.reshape(-1, 3))
    right = normalise(fit[0])
    up = normalise(fit[1] - (fit[1] @ right) * right)
    return frame(right, up, (uv.min(axis=0) + uv.max(axis=0)) / 2 @ fit[:2] + fit[2])


def _mirrored(of: Floats, rig: Rig) -> Floats:
    """A frame's mirror image in the rig's first plate."""
    plate = plate_outline(rig.plates[0])
    normal = np.cross(*plate.axes)
    right, up, _, at = of[:3].T
    at = at + 2 * ((plate.middle - at) @ normal) * normal
    return frame(reflect(right, normal), reflect(up, normal), at)


def _shifted(of: Floats, along: float) -> Floats:
    """A frame moved along its front."""
    moved = of.copy()
    moved[:3, 3] += along * of[:3, 2]
    return moved
