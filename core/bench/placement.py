"""Places and sizes, in m, of the parts of a new rig with or without a plate, or of one made anew.

With a plate: the viewer looks along f; the picture stands in the glass's centre c and faces the
viewer; the plate stands at c + D f. The display stands at the mirror image of the picture in the
plate, turned as a mirror turns it.

Without one: the viewer looks through the glass's centre at the display, which stands upright behind
the glass, or lies under it for a viewer who looks down steeply. The picture is where the display
is.

So each of picture, plate and display follows from the other two: a part that was deleted is made
anew there.
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


@dataclass(frozen=True)
class StraightBench:
    """The bench without a plate, for a glass of any size.

    lies_from : rad, of the viewer's look down: from there on the display lies under the glass
    gap_share : of the glass's depth, the way from its back to an upright display: light through the
        middle of a ball of index 1.5 then lands as far from the axis as it came. Glass lies on a
        display that lies
    lift_share : of the picture, by which it stands before the display, so
        that both can be seen and selected
    """

    lies_from: float = np.pi / 4
    gap_share: float = 1.0
    lift_share: float = 0.01


STRAIGHT_BENCH = StraightBench()


def propose_behind(bounds: Floats, wishes: Wishes, aim: Floats | None = None) -> Proposal:
    """A rig without a plate, around glass within these bounds (2, 3), world, m.

    aim : bounds (2, 3) of the glass of which the viewer looks at the middle, where it is not
        all of it: between two glasses there is none. The display is behind all of it
    """
    bench = STRAIGHT_BENCH
    aim = bounds if aim is None else aim
    centre = (aim[0] + aim[1]) / 2
    corners, of_aim = (
        np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3) - centre for box in (bounds, aim)
    )

    # the viewer's axes
    level = np.array([-np.sin(wishes.azimuth), np.cos(wishes.azimuth), 0.0])
    right = np.array([np.cos(wishes.azimuth), np.sin(wishes.azimuth), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    down, along = np.sin(wishes.look_down), np.cos(wishes.look_down)
    forward = along * level - down * up
    upward = down * level + along * up

    # sizes of the glass, as the viewer sees it, and how far it reaches to the display
    lies = wishes.look_down >= bench.lies_from - 1e-6
    away = -up if lies else level
    width, height, depth = (float(np.ptp(of_aim @ axis)) for axis in (right, upward, away))
    # all of it is in sight
    wide = 2 * max(float(np.abs(corners @ axis).max()) for axis in (right, upward))
    grow = max(1.0, wide / REFERENCE_BENCH.large_m)
    gap = wishes.distance or (0.0 if lies else bench.gap_share * depth)
    way = (float((corners @ away).max()) + gap) / float(away @ forward)

    # what is seen at the glass is seen larger further away
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


LEAST = 1e-6  # of a frame's place: nearer ones are in the same


@dataclass(frozen=True, eq=False)
class Stand:
    """Where a part stands, and how large it is.

    frame : (4, 4) columns right, up, front, position, world
    side : m, of a picture or a plate; the shorter one of a display; the width that a viewer sees
    distance : m, of a viewer from what it sees
    """

    frame: Floats
    side: float
    distance: float = 0.0


def stand_of(role: str, rig: Rig) -> Stand:
    """Where a part of a role is to be made, in a rig that has none of it.

    Raises
    ------
    RigError : too little is left of the rig to tell
    """
    makers = {"DISPLAY": _display, "PICTURE": _picture, "PLATE": _plate, "VIEWER": _viewer}
    if not rig.glasses:
        raise _too_little()
    return makers[role](rig)


def _too_little() -> RigError:
    return RigError(
        "Too little is left of the rig to tell where the part stands: press Undo, or remove the rig"
        " and add it again."
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
    """Half way between picture and display, before the viewer's eyes."""
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
    """In front of the picture, as far from the glass's middle as Add Rig has it."""
    picture = (_picture_left(rig) or _in_glass(rig)).frame
    distance = REFERENCE_BENCH.viewer_distance_m * _grow(rig)
    to_glass = (_bounds(rig).mean(axis=0) - picture[:3, 3]) @ picture[:3, 2]
    return Stand(_shifted(picture, distance + to_glass), _wide(rig), distance)


def _picture_left(rig: Rig) -> Stand | None:
    """The picture that is there; None for one in the viewer's own pixels, too."""
    mesh = rig.picture_place.mesh if rig.pictures else None
    if mesh is None:
        return None
    fit, _ = affine_fit(mesh.uv.reshape(-1, 2), mesh.corners.reshape(-1, 3))
    return Stand(_frame_of(mesh), float(np.linalg.norm(fit[:2], axis=1).min()))


def _in_glass(rig: Rig) -> Stand:
    """A picture in the middle of the glass, which faces the viewer, or whoever looks along +y."""
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
    """The frame of a flat rectangle, by its UV: right along u, up along v."""
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
    """A frame that is moved along its front."""
    moved = of.copy()
    moved[:3, 3] += along * of[:3, 2]
    return moved
