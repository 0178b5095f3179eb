"""The mirror array plate in closed form: the outgoing ray of each incoming one.

Between two neighbouring mirrors a ray goes to and fro. Unfolded, it goes straight on: the mirrors
it would cross are the reflections, and folding its end back into its own slit gives the place where
it leaves. So each of the two layers, of any number of mirrors, is one fold, exact to rounding
(docs/closed_forms.md).
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.errors import RigError
from ..base.products import turn
from ..base.vectors import normalise
from ..glass.meshes import areas_of
from ..rig.rig import MirrorArray, Plate
from .optics import transmittance


def fold(q: Floats, travel: Floats) -> tuple[Floats, Ints]:
    """One layer of mirrors at the whole numbers: where light
    comes out, and how often it was reflected.

    Parameters
    ----------
    q : (n,) where it enters, in pitches, along the mirrors' normal
    travel : (n,) how far it would go along there without mirrors, in pitches, signed

    Returns
    -------
    q' (n,) in the same slit as q, and n_reflections (n,); its slope is turned round as many times
    """
    slit = np.floor(q)
    unfolded = q + travel
    into = np.floor(unfolded)
    n_reflections = np.abs(into - slit).astype(np.int64)
    inside = unfolded - into
    return slit + np.where(is_odd(n_reflections), 1.0 - inside, inside), n_reflections


def is_odd(n: Ints) -> Bools:
    """Of whole numbers (n,). A bit, as their remainder would take as long as the rest of
    the fold.
    """
    return (n & 1).astype(bool)


def odd_share(r: Floats) -> Floats:
    """Share P (n,) of light with an odd number of reflections, over
    all phases, that would cross r (n,) pitches.
    """
    return 1.0 - np.abs(np.abs(r) % 2 - 1.0)


def odd_number(r: Floats) -> Floats:
    """That odd number of reflections: of the two that are
    possible, |r| rounded up and down, one is odd.
    """
    return 2.0 * np.floor(np.abs(r) / 2) + 1.0


def reflected_share(array: MirrorArray, travel: Floats, is_turned: bool) -> Floats:
    """Share (n,) of light that is reflected an odd, or an
    even, number of times by one layer, and comes out.
    """
    share = odd_share(travel)
    number = odd_number(travel)
    if is_turned:
        return share * array.reflectance**number
    return (1.0 - share) * array.reflectance ** (
        number + np.where(np.abs(travel) < number, -1.0, 1.0)
    )


# sine of the angle to the plate below which light runs in its plane and meets nothing
GRAZING = 1e-12


class PlatePath(IntEnum):
    """A plate's effect on light. The first mirror array that
    did something else than image it decides.
    """

    NONE = 0
    IMAGED = 1
    STRAY_1 = 2
    STRAY_2 = 3
    THROUGH = 4
    REFLECTED = 5


STRAY_PATHS = (PlatePath.STRAY_1, PlatePath.STRAY_2, PlatePath.THROUGH, PlatePath.REFLECTED)


class Crossing(NamedTuple):
    """Light that has left the plate.

    positions (n, 3) m, on the plate's middle plane, where the light that leaves seems to
    come from; directions (n, 3) unit; throughput (n,); path (n,) of PlatePath
    """

    positions: Floats
    directions: Floats
    throughput: Floats
    path: np.ndarray


def _dot(a: Floats, b: Floats) -> Floats:
    """Of columns: (n,) of (2, n) and (2, n or 1)."""
    return a[0] * b[0] + a[1] * b[1]


def _depth(array: MirrorArray, cosine: Floats) -> Floats:
    """Cosine (n,) in the plate's glass of light that has cosines (n,) in air, both to
    the normal.
    """
    n = array.ior
    # sqrt(1 - sine^2 / n^2), without the difference of near-equal
    # numbers that grazing light makes of it at n = 1
    return np.sqrt((n - 1.0) * (n + 1.0) + cosine**2) / n


def _transmittance(array: MirrorArray, cosine: Floats, depth: Floats) -> Floats:
    """Of one face (n,), for light with these cosines in air and glass."""
    return (
        transmittance(cosine, depth, 1.0 / array.ior) if array.has_fresnel else np.ones(len(cosine))
    )


class _Light(NamedTuple):
    """Light at the face it comes to, in the plate's frame.

    place (2, n) m, from the centre; along (2, n) and cosine (n,): its direction in air, along the
    plate and across; side (n,) +1 on its way along the normal, else -1; depth (n,) cosine of the
    direction in the glass. Rows of n and not n pairs: broadcasts over pairs take several times as
    long.
    """

    place: Floats
    along: Floats
    side: Floats
    cosine: Floats
    depth: Floats


@dataclass(frozen=True, eq=False)
class ArrayFrame:
    """A mirror array where it stands: centre (3,) m.

    Axes (3, 3), rows along a side, along the other, normal.
    """

    array: MirrorArray
    centre: Floats
    axes: Floats

    def imaged(self, positions: Floats, directions: Floats) -> Crossing:
        """The mid-air image's light (odd, odd), as the mean over all phases of the mirrors.

        It comes out where it would if each layer were one plane mirror, and its throughput is the
        share of light that goes this way. Both change smoothly: the view map is made of such light.
        """
        return self._cross(positions, directions, self._as_one_mirror)

    def folded(self, positions: Floats, directions: Floats) -> Crossing:
        """Light that has met the mirrors where they stand."""
        return self._cross(positions, directions, self._as_mirrors)

    def reflected(self, positions: Floats, directions: Floats) -> Crossing:
        """The light that the face it comes to reflects."""
        light = self._entering(positions, directions)
        # seen from the middle plane, where light seems to come
        # from, the face is half the thickness nearer
        place = light.place - 0.5 * self.array.thickness / light.cosine * light.along
        throughput = 1.0 - _transmittance(self.array, light.cosine, light.depth)
        path = np.full(len(positions), PlatePath.REFLECTED, np.uint8)
        return self._leaving(place, light.along, -light.cosine * light.side, throughput, path)

    def _entering(self, positions: Floats, directions: Floats) -> _Light:
        local = turn(self.axes, directions).T
        along = local[:2]
        cosine = np.maximum(np.abs(local[2]), GRAZING)
        place = (
            turn(self.axes[:2], positions - self.centre).T
            - 0.5 * self.array.thickness / cosine * along
        )
        return _Light(
            place, along, np.where(local[2] < 0, -1.0, 1.0), cosine, _depth(self.array, cosine)
        )

    def _leaving(
        self, place: Floats, along: Floats, across: Floats, throughput: Floats, path: np.ndarray
    ) -> Crossing:
        directions = np.vstack([along, across])
        directions /= np.sqrt((directions * directions).sum(axis=0))
        to_world = self.axes.T
        return Crossing(
            self.centre + turn(to_world[:, :2], place.T),
            turn(to_world, directions.T),
            throughput,
            path,
        )

    def _mirrors(self, place: Floats) -> tuple[Floats, Floats]:
        """Unit normals (2, 2, n or 1) of the two directions of
        mirrors, xy, that light meets at places (2, n).

        And (2, n or 1), m: added to a place's component along such a
        normal it is the way from a mirror without phase.
        """
        angle = np.pi / 4 * np.array([1.0, 3.0]) + np.array([0.0, self.array.crossing_error])
        if self.array.layout != "radial":
            return np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, :, None], np.zeros((2, 1))
        # rings, as wide as the holes' diagonal; in each of them the
        # holes stand side by side, their diagonals radial
        azimuth = np.arctan2(place[1], place[0])
        radius = np.hypot(*place)
        turned = azimuth + angle[:, None]
        normals = np.stack([np.cos(turned), np.sin(turned)], axis=1)
        ring = np.sqrt(2.0) * self.array.pitch * np.rint(radius / (np.sqrt(2.0) * self.array.pitch))
        along_ring = np.sin(angle)[:, None] * ring * azimuth
        return normals, along_ring

    def _cross(self, positions: Floats, directions: Floats, layer: "_Layer") -> Crossing:
        array = self.array
        light = self._entering(positions, directions)
        throughput = _transmittance(array, light.cosine, light.depth) ** 2
        normals, offset = self._mirrors(light.place)
        place = light.place
        along = light.along
        way = array.height / (array.ior * light.depth)  # through a layer, for each unit of `along`
        phase = np.fmod(array.phase, 1.0)  # whole pitches make no difference
        is_first = light.side > 0  # light against the normal comes to the second layer first
        turned_round = []

        for first, then in ((0, 1), (1, 0)):
            normal = np.where(is_first, normals[first], normals[then])
            beside = np.where(
                is_first,
                offset[first] - array.pitch * phase[first],
                offset[then] - array.pitch * phase[then],
            )

            # where the light meets the layer, and what that does to it
            speed = _dot(along, normal)
            q = (_dot(place, normal) + beside) / array.pitch
            moved, is_turned, part = layer(q, speed * way / array.pitch)
            throughput = throughput * part
            turned_round.append(is_turned)

            step = array.pitch * moved
            # along its mirrors a layer of slits lets light drift, holes do not
            if array.layout == "crossed":
                place = place + way * along
                step = step - way * speed
            place = place + step * normal
            along = along - np.where(is_turned, 2.0 * speed, 0.0) * normal

        # seen from the middle plane
        place = place - 0.5 * array.thickness / light.cosine * along
        before, after = turned_round
        path = np.where(is_first, _PATHS[before + 2 * after], _PATHS[after + 2 * before])
        return self._leaving(place, along, light.side * light.cosine, throughput, path)

    def _as_mirrors(self, q: Floats, travel: Floats) -> "_Turned":
        out, n_reflections = fold(q, travel)
        return out - q, is_odd(n_reflections), self.array.reflectance**n_reflections

    def _as_one_mirror(self, q: Floats, travel: Floats) -> "_Turned":
        return np.zeros(len(q)), np.ones(len(q), bool), reflected_share(self.array, travel, True)


# by: is it turned round by the first layer, 1, and by the second, 2
_PATHS = np.array(
    [PlatePath.THROUGH, PlatePath.STRAY_1, PlatePath.STRAY_2, PlatePath.IMAGED], np.uint8
)
# of a layer: how far light moved, pitches; is it turned round; its throughput
_Turned = tuple[Floats, Bools, Floats]
_Layer = Callable[[Floats, Floats], _Turned]


def light_by_angle(
    array: MirrorArray, incidence: Floats, azimuth: float = 0.0
) -> dict[PlatePath, Floats]:
    """Share (n,) of light that takes each path, in the mean over all phases of the mirrors.

    Parameters
    ----------
    incidence : (n,) rad, angle in air between the light and the plate's normal
    azimuth : rad, of the light's way along the plate, from one of
        its sides, to which mirrors stand at 45 degrees
    """
    sine = np.sin(incidence)
    cosine = np.maximum(np.cos(incidence), GRAZING)
    depth = _depth(array, cosine)
    face = _transmittance(array, cosine, depth)
    pitches = sine * array.height / (array.ior * depth * array.pitch)

    # by each layer an even number of times or an odd one
    first = np.pi / 4
    second = 3 * np.pi / 4 + array.crossing_error
    found = {PlatePath.REFLECTED: 1.0 - face}
    for by_first in (True, False):
        before = reflected_share(array, pitches * np.cos(azimuth - first), by_first)
        turned = 2 * first + np.pi - azimuth if by_first else azimuth
        for by_second in (True, False):
            after = reflected_share(array, pitches * np.cos(turned - second), by_second)
            found[PlatePath(_PATHS[by_first + 2 * by_second])] = face**2 * before * after
    return found


def array_frame(plate: Plate, normal: Floats) -> ArrayFrame:
    """Where the mirror array of a plate with a unit normal (3,) stands.

    Raises
    ------
    RigError : the plate is smaller than a pitch, or it is not known how its mirrors stand
    """
    # its axes: along a side, along the other, normal
    corners = plate.mesh.corners
    side = corners[0, 1] - corners[0, 0] if plate.side is None else plate.side
    side = normalise(side - (side @ normal) * normal)
    if not (side @ side > 0.5 and np.isfinite(0.0 if plate.centre is None else plate.centre).all()):
        raise RigError(
            "The x axis of the plate '{plate}' does not lie in the plate, but its mirrors"
            " stand at 45 degrees to that axis: turn its mesh, and apply its scale.",
            plate=plate.name,
        )
    axes = np.stack([side, np.cross(normal, side), normal])

    # its width: a strip that lies askew is narrower than it reaches along either side
    low, high = (f(corners.reshape(-1, 3) @ axes.T, axis=0) for f in (np.min, np.max))
    area = areas_of(corners).sum()
    width = min((high - low)[:2].min(), np.sqrt(2.0) * area / np.linalg.norm((high - low)[:2]))
    if width < plate.array.pitch:
        raise RigError(
            "The plate '{plate}' is {width:g} mm wide, less than the {pitch:g} mm from"
            " mirror to mirror: scale it up or lower its pitch.",
            plate=plate.name,
            width=1e3 * width,
            pitch=1e3 * plate.array.pitch,
        )

    middle = 0.5 * (low + high)
    if plate.centre is not None:
        middle[:2] = axes[:2] @ plate.centre
    return ArrayFrame(plate.array, middle @ axes, axes)
