"""Parameters of a bench that may be off, their expected errors, and the rig with such errors."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base.arrays import Floats
from ..base.messages import Message
from ..base.products import turn
from ..glass.motion import Motion, find_motion
from ..rig.dispersion import WAVELENGTH, ConstantIndex, ShiftedIndex
from ..rig.rig import ROLES, Glass, Mesh, Plate, Rig, Role, Viewer

# Expected standard deviations of a bench set up with rulers and squares, in the parameters' units.
TOLERANCES = {
    "shift": 0.5,
    "turn": 0.1,
    "index": 0.002,
    "crossing": 0.02,
    "mirror": 0.01,
    "focal": 0.1,
}
# Axes of shifts and turns are those of the planned rig's viewer.
SHIFTS = Message("shift right"), Message("shift up"), Message("shift in depth")
TURNS = (
    Message("turn about the horizontal axis"),
    Message("turn about the vertical axis"),
    Message("turn about the depth axis"),
)
INDEX = Message("index")
HEIGHT = Message("mirror height")
CROSSING = Message("crossing angle")
FOCAL = Message("focal length")


@dataclass(frozen=True)
class Parameter:
    """A quantity of a bench that may be off.

    name : part and parameter; unit : of amounts; step : amount for derivatives
    applied : function of a rig and an amount that returns the changed rig
    part : field of the rig and number of the only part it changes; None for any
    """

    name: str
    unit: str
    step: float
    applied: Callable[[Rig, float], Rig]
    part: tuple[str, int] | None = None

    @property
    def kind(self) -> str:
        """Key of TOLERANCES: kind of parameter, for any part and axis."""
        return self.name.rsplit(": ", 1)[-1].split()[0]


def parameters(rig: Rig) -> list[Parameter]:
    """All parameters: pose of each part, indices of the glass, the plate's make, the camera's
    zoom.
    """
    roles = _off_roles()
    found = []
    axes = rig.viewers[0].axes

    for role in roles:
        for number, part in enumerate(rig.of(role)):
            found += _poses(part, axes, role.field, number)

    for role in roles:
        for number, part in enumerate(rig.of(role)):
            found += OWN.get(role.name, _nothing)(part, role.field, number)

    return found


def _off_roles() -> list[Role]:
    """Roles of parts that may be off, the viewer last."""
    return sorted(
        (role for role in ROLES if role.may_be_off), key=lambda role: role.name == "VIEWER"
    )


def _nothing(part: Any, kind: str, number: int) -> list[Parameter]:
    return []


def _of_glass(glass: Glass, kind: str, number: int) -> list[Parameter]:
    return [_parameter(f"{glass.name}: {INDEX}", "", 1e-4, _other_index, kind, number)]


def _of_plate(plate: Plate, kind: str, number: int) -> list[Parameter]:
    if plate.array is None:
        return []
    found = [_parameter(f"{plate.name}: {HEIGHT}", "mm", 1e-3, _higher, kind, number)]
    if plate.array.layout == "crossed":
        name = f"{plate.name}: {CROSSING}"
        found.insert(0, _parameter(name, "deg", 1e-2, _crossed_wrong, kind, number))
    return found


def _of_viewer(viewer: Viewer, kind: str, number: int) -> list[Parameter]:
    return [_parameter(f"{viewer.name}: {FOCAL}", "%", 1e-2, _zoomed, kind, number)]


# Parameters of a part besides its pose, by role.
OWN = {"GLASS": _of_glass, "PLATE": _of_plate, "VIEWER": _of_viewer}


def with_amounts(rig: Rig, amounts: Mapping[str, float]) -> tuple[Rig, tuple[str, ...]]:
    """The rig with amounts by parameter name, and the names it does not have.

    The picture moves with the first viewer, since everything wanted and measured is in the viewer's
    image.
    """
    planned = rig
    left = {name: amount for name, amount in amounts.items() if amount}

    for parameter in parameters(rig):
        amount = left.pop(parameter.name, 0.0)
        if amount:
            rig = parameter.applied(rig, amount)

    before, after = planned.viewers[0], rig.viewers[0]
    if after is not before:
        linear, shift = along_with(before, after)
        pictures = tuple(
            p
            if p.mesh is None
            else replace(p, mesh=replace(p.mesh, vertices=turn(linear, p.mesh.vertices) + shift))
            for p in rig.pictures
        )
        rig = replace(rig, pictures=pictures)

    return rig, tuple(left)


def with_offset(rig: Rig, offset: Iterable[Mapping[str, float]]) -> tuple[Rig, tuple[str, ...]]:
    """The rig with several sets of amounts applied in turn, and the names it does not have."""
    unknown: list[str] = []
    for amounts in offset:
        rig, names = with_amounts(rig, amounts)
        unknown += names
    return rig, tuple(unknown)


def along_with(before: Viewer, after: Viewer) -> tuple[Floats, Floats]:
    """Map p -> linear (3, 3) @ p + shift (3,) that keeps each point's pixel and depth for the
    viewer.
    """
    zoom = np.diag(
        [*(np.ptp(after.window[k : k + 2]) / np.ptp(before.window[k : k + 2]) for k in (0, 2)), 1.0]
    )
    linear = after.axes.T @ zoom @ before.axes
    return linear, after.position - linear @ before.position


def part_motions(before: Rig, after: Rig) -> dict[str, Motion]:
    """Motion of each part, by name, from one rig to another with other amounts."""
    found = {}
    for role in (role for role in _off_roles() if role.kind is not None):
        for a, b in zip(before.of(role), after.of(role), strict=True):
            if a.mesh is not b.mesh:
                found[a.name] = find_motion(a.mesh, b.mesh)

    for a, b in zip(before.viewers, after.viewers, strict=True):
        if a.position is not b.position:
            rotation = b.axes.T @ a.axes
            found[a.name] = Motion(rotation, b.position - rotation @ a.position)

    return found


def _poses(part: Any, axes: Floats, kind: str, number: int) -> Iterator[Parameter]:
    """Shifts, mm, along axes (3, 3), and turns, degrees, about them through the part's centre."""
    middle = part.position if kind == "viewers" else part.mesh.bounds.mean(axis=0)

    for words, axis in zip(SHIFTS, axes, strict=True):
        yield _parameter(
            f"{part.name}: {words}",
            "mm",
            1e-2,
            lambda part, mm, axis=axis: moved(part, Motion(np.eye(3), 1e-3 * mm * axis)),
            kind,
            number,
        )

    for words, axis in zip(TURNS, axes, strict=True):
        yield _parameter(
            f"{part.name}: {words}",
            "deg",
            1e-2,
            lambda part, degrees, axis=axis: moved(part, turned(axis, degrees, middle)),
            kind,
            number,
        )


def turned(axis: Floats, degrees: float, about: Floats) -> Motion:
    """Rotation about a unit axis (3,) through a point (3,), by Rodrigues' formula."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    a = np.radians(degrees)
    rotation = np.eye(3) + np.sin(a) * k + (1 - np.cos(a)) * (k @ k)
    return Motion(rotation, about - rotation @ about)


def moved(part, motion: Motion):
    """A glass, plate, display or viewer, moved."""
    if isinstance(part, Viewer):
        return replace(
            part, position=motion.points(part.position), axes=motion.directions(part.axes)
        )

    mesh = _moved_mesh(part.mesh, motion)
    if not isinstance(part, Plate):
        return replace(part, mesh=mesh)

    # The mirrors move with the plate.
    side, centre = part.side, part.centre
    return replace(
        part,
        mesh=mesh,
        side=None if side is None else motion.directions(side),
        centre=None if centre is None else motion.points(centre),
    )


def _moved_mesh(mesh: Mesh, motion: Motion) -> Mesh:
    normals = None if mesh.corner_normals is None else motion.directions(mesh.corner_normals)
    return replace(mesh, vertices=motion.points(mesh.vertices), corner_normals=normals)


def _parameter(
    name: str, unit: str, step: float, change: Callable[[Any, float], Any], kind: str, number: int
) -> Parameter:
    """A parameter that changes one part."""

    def applied(rig: Rig, amount: float) -> Rig:
        return with_part(rig, (kind, number), change(getattr(rig, kind)[number], amount))

    return Parameter(name, unit, step, applied, (kind, number))


def with_part(rig: Rig, place: tuple[str, int], part: Any) -> Rig:
    """The rig with one part replaced, given by field and number."""
    kind, number = place
    parts = list(getattr(rig, kind))
    parts[number] = part
    return replace(rig, **{kind: tuple(parts)})


def _other_index(glass, amount: float):
    n = glass.ior.at(WAVELENGTH) + amount
    is_constant = isinstance(glass.ior, ConstantIndex)
    return replace(glass, ior=ConstantIndex(n) if is_constant else ShiftedIndex(glass.ior, n))


def _crossed_wrong(plate: Plate, degrees: float) -> Plate:
    return replace(
        plate,
        array=replace(plate.array, crossing_error=plate.array.crossing_error + np.radians(degrees)),
    )


def _higher(plate: Plate, mm: float) -> Plate:
    return replace(plate, array=replace(plate.array, height=plate.array.height + 1e-3 * mm))


def _zoomed(viewer: Viewer, percent: float) -> Viewer:
    return replace(viewer, window=tuple(x / (1 + percent / 100) for x in viewer.window))
