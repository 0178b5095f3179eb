"""Optical systems of the field as rigs: what Add Rig > More builds, and the benches judge.

Lengths in metres; z is up, and the viewer looks along +y or down at the origin.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.messages import Message
from ..base.vectors import normalise
from ..light.optics import reflect
from ..rig.rig import (
    ROLES,
    Blocker,
    ConstantIndex,
    Display,
    Glass,
    HalfMirror,
    Lens,
    Mesh,
    Mirror,
    MirrorArray,
    PicturePlace,
    Plate,
    Polariser,
    Projector,
    Retroreflector,
    Rig,
    Screen,
    Viewer,
    WavePlate,
)

X, Y, Z = np.eye(3)
SLOPE = 2**-0.5
WATER, ACRYLIC = 1.333, 1.49
SEGMENTS = 128  # of a round surface
BALL_SEGMENTS = 64  # of a ball, for small files: its faces are curved


@dataclass(frozen=True)
class System:
    """An entry of Add Rig > More.

    make : the rig; its picture is a `PicturePlace` without pixels
    source : publication it is from; '' if common knowledge
    """

    label: str
    tip: str
    make: Callable[[], Rig]
    source: str = ""


def panel(centre: Sequence[float], right: Floats, up: Floats, width: float, height: float) -> Mesh:
    """A rectangle with a UV map; right x up is its front."""
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    right, up = width * normalise(right), height * normalise(up)
    halves = np.array([[0, 1, 2], [0, 2, 3]])
    corners = np.asarray(centre) + (uv - 0.5) @ [right, up]
    return Mesh(corners, halves, uv=uv[halves], polygon=halves_of(1))


def halves_of(n: int) -> NDArray[np.int64]:
    """The polygons (2 n,) of the triangles of n quadrilaterals."""
    return np.repeat(np.arange(n), 2)


def strip(outline: Floats, z: tuple[float, float], normals: Floats | None = None) -> Mesh:
    """A wall over an outline (n, 2) in x and y, with a UV map along its length; its front is on the
    outline's right.

    normals : (n, 2) of a smooth wall; None: each face is flat
    """
    n = len(outline)
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1)))
    vertices = np.concatenate([np.column_stack([outline, np.full(n, height)]) for height in z])
    k = np.arange(n - 1)
    quads = np.stack([k, k + 1, k + n + 1, k + n], axis=1)
    triangles = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    u = np.tile(length / length[-1], 2)
    uv = np.stack([u, np.repeat([0.0, 1.0], n)], axis=1)[triangles]
    wall = Mesh(vertices, triangles, uv=uv, polygon=halves_of(n - 1))
    if normals is None:
        return wall
    corner = np.tile(np.column_stack([normals, np.zeros(n)]), (2, 1))[triangles]
    is_smooth = np.ones(len(triangles), bool)
    return replace(wall, corner_normals=corner, is_smooth=is_smooth, has_mean_normals=True)


def arc(radius: float, half_angle: float, segments: int = SEGMENTS) -> Floats:
    """Directions (n, 2) times a radius, about -y, from left to right."""
    angle = np.linspace(-half_angle, half_angle, segments + 1)
    return radius * np.stack([np.sin(angle), -np.cos(angle)], axis=1)


def block(low: Sequence[float], high: Sequence[float]) -> Mesh:
    """A closed box of flat faces."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [half for a, b, c, d in quads for half in ((a, b, c), (a, c, d))]
    vertices = np.where(corners, high, low).astype(float)
    return Mesh(vertices, np.array(triangles), polygon=halves_of(6))


def shell(radius: float, is_cavity: bool = False) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Vertices, triangles and corner normals of a ball about the origin; a cavity's face inward."""
    half = BALL_SEGMENTS // 2
    polar, around = np.pi * np.arange(1, half) / half, np.pi * np.arange(BALL_SEGMENTS) / half
    ring = np.stack([np.cos(around), np.sin(around)], axis=1)
    unit = np.concatenate([
        np.column_stack([np.sin(a) * ring, np.full(BALL_SEGMENTS, np.cos(a))]) for a in polar
    ])  # fmt: skip
    unit = np.concatenate([unit, [Z, -Z]])
    index = np.arange(len(unit) - 2).reshape(-1, BALL_SEGMENTS)
    after = np.roll(index, -1, axis=1)
    if is_cavity:
        index, after = after, index
    a, b, c, d = index[:-1].ravel(), index[1:].ravel(), after[1:].ravel(), after[:-1].ravel()
    north, south = np.full((2, BALL_SEGMENTS), [[len(unit) - 2], [len(unit) - 1]])
    triangles = np.concatenate([
        np.stack([a, b, c, a, c, d], 1).reshape(-1, 3),
        np.stack([north, index[0], after[0]], 1), np.stack([index[-1], south, after[-1]], 1),
    ])  # fmt: skip
    return radius * unit, triangles, unit[triangles] * (-1 if is_cavity else 1)


def ball(radius: float, inner: float = 0.0) -> Mesh:
    """A ball about the origin, or a hollow one."""
    shells = [shell(radius), *([shell(inner, is_cavity=True)] if inner else [])]
    vertices, triangles, normals = zip(*shells, strict=True)
    starts = np.cumsum([0, *(len(one) for one in vertices)])
    joined = np.concatenate([t + start for t, start in zip(triangles, starts, strict=False)])
    n_quads = len(triangles[0]) // 2 - BALL_SEGMENTS
    caps = np.arange(2 * BALL_SEGMENTS) + n_quads
    polygon = np.concatenate([halves_of(n_quads), caps])
    polygons = [polygon + k * (caps[-1] + 1) for k in range(len(shells))]
    is_smooth = np.ones(len(joined), bool)
    return Mesh(
        np.concatenate(vertices), joined, np.concatenate(normals), is_smooth,
        has_mean_normals=True, polygon=np.concatenate(polygons),
    )  # fmt: skip


def viewer(position: Sequence[float], target: Sequence[float], field: float) -> Viewer:
    """A viewer that sees `field` m across at its target."""
    forward = normalise(np.subtract(target, position))
    right = normalise(np.cross(forward, Z if abs(forward[2]) < 0.999 else Y))
    half = field / 2 / float(np.linalg.norm(np.subtract(target, position)))
    axes = np.stack([right, np.cross(right, forward), forward])
    window = (-half, half, -half, half)
    return Viewer("Viewer", "perspective", np.array(position, float), axes, window, 512, 512)


def display(mesh: Mesh, width: int, height: int, name: str = "Display") -> Display:
    """A display with a resolution."""
    return Display(name, mesh, width, height)


def picture(centre: Sequence[float], width: float, up: Floats = Z) -> PicturePlace:
    """A square picture that faces -y, or the direction across its given up."""
    return PicturePlace("Picture", 1024, 1024, panel(centre, X, up, width, width))


def rig(eye: Viewer, displays: Display | tuple[Display, ...], place: PicturePlace, **parts) -> Rig:
    """A rig of one viewer."""
    displays = displays if isinstance(displays, tuple) else (displays,)
    parts = {"glasses": (), "plates": ()} | parts
    return Rig(viewers=(eye,), displays=displays, pictures=(place,), **parts)


def placed(rig: Rig, size: float, at: Floats) -> Rig:
    """A rig scaled by a factor about its origin, which moves to a place (3,), m."""

    def moved(part: Any) -> Any:
        if isinstance(part, Viewer):
            return replace(part, position=size * part.position + at)
        part = replace(part, mesh=replace(part.mesh, vertices=size * part.mesh.vertices + at))
        if isinstance(part, Lens):
            return replace(part, focal_length=size * part.focal_length)
        if isinstance(part, Retroreflector):
            return replace(part, pitch=size * part.pitch)
        if isinstance(part, Plate) and part.array is not None:
            lengths = {"pitch": size * part.array.pitch, "height": size * part.array.height}
            return replace(part, array=replace(part.array, **lengths))
        return part

    return replace(rig, **{role.field: tuple(map(moved, rig.of(role))) for role in ROLES})


def through_plate(place: PicturePlace, plate: Mesh) -> tuple[Floats, Floats, Floats]:
    """Centre, right and up of the mirror image of a picture in a plane: where its display is."""
    a, b, _, d = place.mesh.vertices
    normal = np.cross(plate.vertices[1] - plate.vertices[0], plate.vertices[2] - plate.vertices[0])
    normal = normalise(normal)
    centre = place.mesh.vertices.mean(axis=0)
    centre = centre - 2 * ((centre - plate.vertices[0]) @ normal) * normal
    return centre, reflect(b - a, normal), reflect(d - a, normal)


EYE = viewer(-0.6 * Y, 0 * Y, 0.12)


def peppers_ghost() -> Rig:
    """A phone under a pane at 45 degrees; the picture floats behind the pane."""
    pane = HalfMirror("Half Mirror", panel(0 * X, X, Y - Z, 0.2, 0.24), 0.3)
    phone = display(panel(-0.08 * Z, X, Y, 0.145, 0.067), 2556, 1179, "Phone")
    return rig(EYE, phone, picture(0.08 * Y, 0.05), half_mirrors=(pane,))


def led_corner() -> Rig:
    """Two walls of one display around a corner; the picture floats in front of it."""
    walls = strip(np.array([[-2.0, 0.0], [0.0, -2.0], [2.0, 0.0]]), (2.0, 4.0))
    eye = viewer([0, -12, 1.7], [0, -2, 3], 5.0)
    return rig(eye, display(walls, 2048, 725), picture([0, -2.5, 3], 1.2))


def curved_wall() -> Rig:
    """A hollow cylinder of displays around the viewer."""
    wall = strip(-arc(4.0, np.radians(60))[::-1], (0.0, 2.5))
    return rig(
        viewer([0, 0, 1.6], [0, 4, 1.4], 4.5), display(wall, 4096, 1222), picture([0, 3, 1.4], 1.4)
    )


def cylinder_anamorphosis() -> Rig:
    """A flat display around a mirror cylinder, in which the picture appears upright."""
    outline = arc(0.04, np.pi, 2 * SEGMENTS)
    outline[-1] = outline[0]
    mirror = strip(outline, (0.0, 0.12), outline / 0.04)
    table = display(panel(-0.1 * Y - 1e-4 * Z, X, Y, 0.5, 0.5), 2048, 2048)
    eye = viewer([0, -0.5, 0.35], [0, 0, 0.04], 0.12)
    return rig(eye, table, picture([0, 0, 0.045], 0.045), mirrors=(Mirror("Mirror", mirror),))


def airr() -> Rig:
    """Aerial imaging by retro-reflection: the picture floats before the half mirror."""
    splitter = HalfMirror("Half Mirror", panel(0 * X, X, Y - Z, 0.3, 0.4), 0.5)
    sheet = Retroreflector("Retroreflector", panel(0.16 * Y, X, Z, 0.3, 0.3))
    top = display(panel(0.12 * Z, -X, Y, 0.12, 0.12), 1024, 1024)
    eye = viewer(-0.8 * Y, 0 * Y, 0.12)
    parts = {"half_mirrors": (splitter,), "retroreflectors": (sheet,)}
    return rig(eye, top, picture(-0.12 * Y, 0.05), **parts)


def airr_polarised() -> Rig:
    """AIRR without the losses of its half mirror."""
    base = airr()
    film = WavePlate("Quarter-Wave Film", panel(0.159 * Y, X, Z, 0.3, 0.3), np.pi / 4)
    splitter = replace(base.half_mirrors[0], polarising=True)
    shown = replace(base.displays[0], polarised=0.0)
    return replace(base, half_mirrors=(splitter,), wave_plates=(film,), displays=(shown,))


def _over(surface: Glass, depth: float, width: float, extra: tuple[Blocker, ...] = ()) -> Rig:
    """A plate behind a glossy table or water at z = 0, which reflects the image upright."""
    plate = panel([0, 0.3, 0.08], X, Z, 0.4, 0.36)
    place = picture([0, 0, depth], width)
    under = replace(place, mesh=panel([0, 0, -depth], X, -Z, width, width))
    centre, right, up = through_plate(under, plate)
    screen = display(panel(centre, -right, up, 1.5 * width, 1.5 * width), 1024, 1024)
    eye = viewer([0, -0.5, 0.4], [0, 0, depth], 2 * width)
    parts = {"plates": (Plate("Plate", plate),), "glasses": (surface,), "blockers": extra}
    return rig(eye, screen, place, **parts)


def enchantable() -> Rig:
    """A mid-air image upright on a glossy table."""
    table = block([-0.2, -0.15, -0.01], [0.2, 0.28, 0.0])
    top = Glass("Table", table, ConstantIndex(1.5), reflects=True, prefers="reflected")
    below = Blocker("Table Top", panel(-0.0099 * Z + 0.065 * Y, X, Y, 0.4, 0.43))
    return _over(top, 0.05, 0.05, (below,))


def koizumi_sano() -> Rig:
    """The same by a mirror under the display; polarisation removes the ground image, which light
    past the mirror forms over the table.
    """
    base, height = enchantable(), 0.09
    shown = panel([0, 0.6, 2 * height + 0.05], X, Z, 0.075, 0.075)
    mirror = Mirror("Mirror", panel([0, 0.46, height], X, Y, 0.4, 0.3))
    # at 45 degrees to the display's polarisation, as the middle ray sees it
    turn = np.arctan2(np.hypot(1, 0.7), 0.7)
    film = WavePlate("Wave Plate", panel([0, 0.46, height + 1e-3], X, Y, 0.4, 0.3), turn)
    sheet = Polariser("Polariser", panel([0, 0.29, 0.08], X, Z, 0.4, 0.36))
    return replace(
        base,
        displays=(replace(base.displays[0], mesh=shown, polarised=np.pi / 2),),
        mirrors=(mirror,),
        wave_plates=(film,),
        polarisers=(sheet,),
    )


def scoopirit_above() -> Rig:
    """A mid-air image upright on water."""
    tank = block([-0.2, -0.15, -0.05], [0.2, 0.28, 0.0])
    water = Glass("Water", tank, ConstantIndex(WATER), reflects=True, prefers="reflected")
    below = Blocker("Tank", panel(-0.0499 * Z + 0.065 * Y, X, Y, 0.4, 0.43))
    return _over(water, 0.05, 0.05, (below,))


def scoopirit_under() -> Rig:
    """A mid-air image in water, above a plate under the tank."""
    water = Glass("Water", block([-0.15, -0.15, -0.1], [0.15, 0.15, 0.0]), ConstantIndex(WATER))
    plate = Plate("Plate", panel(-0.12 * Z, X, Y, 0.4, 0.4))
    place = picture([0, 0, -0.05], 0.05, SLOPE * (Y + Z))
    eye = viewer([0, -0.4, 0.4], [0, 0.02, -0.05], 0.12)
    screen = display(panel([0, -0.004, -0.19], X, SLOPE * (Y - Z), 0.09, 0.09), 1024, 1024)
    return rig(eye, screen, place, plates=(plate,), glasses=(water,))


def i_ball_2() -> Rig:
    """A real image in a hollow ball, by a lens under it; a half mirror feeds a camera."""
    clear = Glass("Ball", ball(0.05, 0.047), ConstantIndex(ACRYLIC))
    focal, below = 0.08, 0.12
    to_display = 1 / (1 / focal - 1 / below)
    lens = Lens("Lens", panel(-below * Z, X, Y, 0.12, 0.12), focal)
    splitter = HalfMirror(
        "Half Mirror", panel(-(below + 0.07) * Z, X, Y - Z, 0.14, 0.2), 0.5, prefers="transmitted"
    )
    fold = Mirror("Mirror", panel(-(below + 0.18) * Z, X, Y + Z, 0.14, 0.2))
    far = to_display - 0.18
    screen = display(panel(-(below + 0.18) * Z - far * Y, -X, Z, 0.12, 0.12), 1024, 1024)
    eye = viewer([0, 0, 0.5], [0, 0, 0], 0.09)
    parts = {
        "glasses": (clear,),
        "lenses": (lens,),
        "half_mirrors": (splitter,),
        "mirrors": (fold,),
    }
    return rig(eye, screen, picture(0 * X, 0.02, Y), **parts)


def air_mounted_eyepiece() -> Rig:
    """A lens before the eye looks at a plate's mid-air image; the picture is far away."""
    focal, distance, relief = 0.05, 1.0, 0.03
    object_at = 1 / (1 / focal + 1 / (distance - relief))
    lens = Lens("Lens", panel(0 * X, X, Z, 0.04, 0.04), focal)
    plate = panel(0.15 * Y, X, SLOPE * (Y + Z), 0.2, 0.2)
    image = picture(object_at * Y, 0.03)
    centre, right, up = through_plate(image, plate)
    screen = display(panel(centre, right, up, 0.05, 0.05), 1024, 1024)
    eye = viewer(-relief * Y, (distance - relief) * Y, 0.7)
    holes = MirrorArray("holes", pitch=0.3e-3, height=0.9e-3)
    parts = {"plates": (Plate("Plate", plate, holes),), "lenses": (lens,)}
    return rig(eye, screen, picture((distance - relief) * Y, 0.4), **parts)


def _with_plate(mesh: Mesh, array: MirrorArray | None = None) -> Rig:
    """The paper's bench around glass at the origin."""
    glass = Glass("Glass", mesh, ConstantIndex(ACRYLIC))
    plate = Plate("Plate", panel(0.15 * Y, X, Y + Z, 0.488, 0.488), array)
    screen = display(panel(0.15 * (Y - Z), X, Y, 0.1, 0.1), 1024, 1024)
    return rig(
        viewer(-1.0 * Y, 0 * Y, 0.06),
        screen,
        picture(0 * X, 0.03),
        glasses=(glass,),
        plates=(plate,),
    )


CUBE = block([-0.025] * 3, [0.025] * 3)


def infloasion() -> Rig:
    """A cube, and its mirror image at the display, which undoes the far half of the bending."""
    base = _with_plate(CUBE)
    normal = SLOPE * (Y - Z)
    at = CUBE.vertices - 0.15 * Y
    inside_out = CUBE.triangles[::-1, [0, 2, 1]]
    copy = Mesh(reflect(at, normal) + 0.15 * Y, inside_out, polygon=CUBE.polygon)
    return replace(base, glasses=(*base.glasses, Glass("Copy", copy, ConstantIndex(ACRYLIC))))


def p_cubee() -> Rig:
    """A box of five displays that shows what is inside it."""
    h = 0.1
    sides = {
        "Front": ([0, -h, 0], X, Z), "Back": ([0, h, 0], -X, Z), "Left": ([-h, 0, 0], -Y, Z),
        "Right": ([h, 0, 0], Y, Z), "Top": ([0, 0, h], X, Y),
    }  # fmt: skip
    faces = tuple(
        display(panel(at, right, up, 2 * h, 2 * h), 1024, 1024, name)
        for name, (at, right, up) in sides.items()
    )
    return rig(viewer([0.3, -0.5, 0.4], 0 * X, 0.34), faces, picture(0 * X, 0.12))


def projector(
    name: str, position: Sequence[float], target: Sequence[float], slope: float
) -> Projector:
    """A projector aimed at a target; `slope` is the tangent of half its field."""
    distance = float(np.linalg.norm(np.subtract(target, position)))
    eye = viewer(position, target, 2 * slope * distance)
    return Projector(name, "perspective", eye.position, eye.axes, eye.window, 1024, 1024)


def globe(radius: float, opening: float) -> Mesh:
    """A sphere about the origin, open up to `opening` rad from its south pole, with a UV map by
    angles; its front is outside.
    """
    polar = np.linspace(0, np.pi - opening, BALL_SEGMENTS // 2 + 1)
    around = np.linspace(0, 2 * np.pi, BALL_SEGMENTS + 1)
    a, b = (x.ravel() for x in np.meshgrid(polar, around, indexing="ij"))
    vertices = radius * np.stack([np.sin(a) * np.sin(b), np.sin(a) * np.cos(b), np.cos(a)], axis=1)
    uv = np.stack([b / (2 * np.pi), 1 - a / polar[-1]], axis=1)
    index = np.arange(len(a)).reshape(len(polar), -1)
    corners = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    one, two, three, four = (corner.ravel() for corner in corners)
    halves = np.stack([one, two, three, one, three, four], axis=1).reshape(-1, 3)
    has_area = np.repeat(np.arange(len(one)) >= BALL_SEGMENTS, 2) | (
        np.arange(len(halves)) % 2 == 1
    )
    triangles, polygon = halves[has_area], halves_of(len(one))[has_area]
    return Mesh(vertices, triangles, uv=uv[triangles], polygon=polygon)


def cake() -> Rig:
    """Two projectors on the round side of a cake."""
    side = strip(arc(0.12, np.radians(89)), (0.0, 0.12))
    lamps = tuple(
        projector(f"Projector {name}", [x, -0.8, 0.35], [0.05 * x, -0.1, 0.06], 0.13)
        for name, x in (("Left", -0.4), ("Right", 0.4))
    )
    eye = viewer([0, -0.9, 0.25], [0, -0.12, 0.06], 0.26)
    place = picture([0, -0.12, 0.06], 0.1)
    return rig(eye, (), place, screens=(Screen("Cake", side, 2048, 651),), projectors=lamps)


def spheree() -> Rig:
    """A translucent ball, lit by two projectors in its opening."""
    lamps = tuple(
        projector(f"Projector {name}", [x, 0.05, -0.2], [2.5 * x, -0.25, 0.05], 0.6)
        for name, x in (("Left", -0.05), ("Right", 0.05))
    )
    surface = Screen("Ball", globe(0.25, np.radians(30)), 2048, 1024)
    place = picture([0, -0.25, 0.02], 0.2)
    eye = viewer([0, -1.5, 0.2], [0, -0.25, 0.02], 0.45)
    return rig(eye, (), place, screens=(surface,), projectors=lamps)


SYSTEMS = {
    "PEPPER": System(
        Message("Pepper's Ghost"),
        Message("A phone below a half mirror; the picture floats behind the mirror"),
        peppers_ghost,
    ),
    "LED_CORNER": System(
        Message("LED Corner"),
        Message("A display around the corner of a building, seen from the street"),
        led_corner,
    ),
    "CURVED_WALL": System(
        Message("Curved Wall"), Message("A cylindrical display around the viewer"), curved_wall
    ),
    "ANAMORPHOSIS": System(
        Message("Cylinder Mirror"),
        Message("A flat display around a mirror cylinder, which shows the picture undistorted"),
        cylinder_anamorphosis,
    ),
    "AIRR": System(
        Message("AIRR"),
        Message("A half mirror and a retroreflector; the picture floats before the mirror"),
        airr,
        "Yamamoto et al. 2014",
    ),
    "AIRR_POLARISED": System(
        Message("AIRR with Polarisation"),
        Message("A reflective polariser and a quarter-wave film; four times as bright as AIRR"),
        airr_polarised,
        "Yamamoto 2017",
    ),
    "INFLOASION": System(
        Message("InFloasion"),
        Message("A cube, and its mirror image at the display"),
        infloasion,
        "Yokose, Okawa, Naemura 2018",
    ),
    "DCRA": System(
        Message("Plate of Square Holes"),
        Message("Glass in the mid-air image of a dihedral corner reflector array"),
        lambda: _with_plate(ball(0.025), MirrorArray("holes", pitch=0.1e-3, height=0.25e-3)),
    ),
    "RADIAL_DCRA": System(
        Message("Plate of Radial Holes"),
        Message("The same with holes that rotate with the azimuth"),
        lambda: _with_plate(ball(0.025), MirrorArray("radial", pitch=0.1e-3, height=0.25e-3)),
        "Yoshimizu, Iwase 2019",
    ),
    "ENCHANTABLE": System(
        Message("Glossy Table"),
        Message("A plate behind a glossy table, which reflects the picture upright"),
        enchantable,
        "Yamamoto et al. 2015",
    ),
    "KOIZUMI_SANO": System(
        Message("Glossy Table with Polarisation"),
        Message("The same by a mirror under the display, without a second image over the table"),
        koizumi_sano,
        "Koizumi, Sano 2020",
    ),
    "SCOOPIRIT_ABOVE": System(
        Message("On Water"),
        Message("A plate behind a tank; the picture is upright on the water"),
        scoopirit_above,
        "Matsuura, Koizumi 2018",
    ),
    "SCOOPIRIT_UNDER": System(
        Message("Under Water"),
        Message("A plate under a tank; the picture floats in the water"),
        scoopirit_under,
        "Matsuura, Koizumi 2018",
    ),
    "I_BALL": System(
        Message("i-ball 2"),
        Message("A lens images a display into a hollow ball; a half mirror serves a camera"),
        i_ball_2,
        "Ushida et al. 2003",
    ),
    "EYEPIECE": System(
        Message("Air Mounted Eyepiece"),
        Message("A lens before the eye shows a plate's mid-air image far away"),
        air_mounted_eyepiece,
        "Otao et al. 2018",
    ),
    "CAKE": System(
        Message("Projection on an Object"),
        Message("Two projectors on the round side of a cake"),
        cake,
    ),
    "SPHEREE": System(
        Message("Lit Ball"),
        Message("A translucent ball with two projectors inside"),
        spheree,
        "Teubl et al. 2014",
    ),
    "P_CUBEE": System(
        Message("Display Box"),
        Message("Five displays around a box that show what is inside it"),
        p_cubee,
        "Stavness et al. 2010",
    ),
}
