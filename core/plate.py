"""The mirror array plate in closed form: what becomes of a ray that crosses it.

Between two neighbouring mirrors a ray goes to and fro. Unfolded, it goes straight on: the mirrors it would cross are
the reflections, and folding the place where it comes out back into its own slit gives where it does come out. So a
layer of any number of mirrors is one fold, exact to rounding (docs/closed_forms.md).
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from .errors import RigError
from .optics import dot, normalise, transmittance
from .rig import Bools, Floats, Ints, MirrorArray, Plate

GRAZING = 1e-12  # sine of the angle to the plate below which light runs in its plane and meets nothing


class PlatePath(IntEnum):
    """What a plate did to light. The first mirror array that did something else than image it decides."""

    NONE = 0
    IMAGED = 1
    STRAY_1 = 2
    STRAY_2 = 3
    THROUGH = 4
    REFLECTED = 5


STRAY_PATHS = (PlatePath.STRAY_1, PlatePath.STRAY_2, PlatePath.THROUGH, PlatePath.REFLECTED)
PLATE_PATH_WORDS = {
    PlatePath.NONE: "beside the plate",
    PlatePath.IMAGED: "mid-air image",
    PlatePath.STRAY_1: "stray light of the first layer",
    PlatePath.STRAY_2: "stray light of the second layer",
    PlatePath.THROUGH: "straight through",
    PlatePath.REFLECTED: "reflected by the glass",
}


class Crossing(NamedTuple):
    """Light that has left the plate.

    positions (n, 3) m, on the plate's middle plane, where the light that leaves seems to come from; directions (n, 3)
    unit; throughput (n,); path (n,) of PlatePath
    """

    positions: Floats
    directions: Floats
    throughput: Floats
    path: np.ndarray


def fold(q: Floats, travel: Floats) -> tuple[Floats, Ints]:
    """One layer of mirrors at the whole numbers: where light comes out, and how often it was reflected.

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
    n_reflections = np.abs(into - slit)
    inside = unfolded - into
    is_odd = n_reflections % 2 == 1
    return slit + np.where(is_odd, 1.0 - inside, inside), n_reflections.astype(np.int64)


def odd_share(r: Floats) -> Floats:
    """Share P (n,) of light with an odd number of reflections, over all phases, that would cross r (n,) pitches."""
    return 1.0 - np.abs(np.abs(r) % 2 - 1.0)


def odd_number(r: Floats) -> Floats:
    """That odd number of reflections: of the two that are possible, |r| rounded up and down, one is odd."""
    return 2.0 * np.floor(np.abs(r) / 2) + 1.0


class _Light(NamedTuple):
    """Light at the face it comes to, in the plate's frame.

    place (n, 2) m, from the centre; along (n, 2) and cosine (n,): its direction in air, along the plate and across;
    side (n,) +1 on its way along the normal, else -1; depth (n,) cosine of the direction in the glass
    """

    place: Floats
    along: Floats
    side: Floats
    cosine: Floats
    depth: Floats


@dataclass(frozen=True, eq=False)
class ArrayFrame:
    """A mirror array where it stands: centre (3,) m; axes (3, 3), rows along a side, along the other, normal."""

    array: MirrorArray
    centre: Floats
    axes: Floats

    def imaged(self, positions: Floats, directions: Floats) -> Crossing:
        """The mid-air image's light (odd, odd), as the mean over all phases of the mirrors.

        It comes out where it would if each layer were one plane mirror, and its throughput is the share of light that
        goes this way. Both change smoothly: the view map is made of such light.
        """
        return self._cross(positions, directions, self._as_one_mirror)

    def crossed(self, positions: Floats, directions: Floats) -> Crossing:
        """What becomes of light that meets the mirrors where they stand."""
        return self._cross(positions, directions, self._as_mirrors)

    def reflected(self, positions: Floats, directions: Floats) -> Crossing:
        """The light that the face it comes to reflects."""
        light = self._entering(positions, directions)
        # seen from the middle plane, where light seems to come from, the face is half the thickness nearer
        place = light.place - 0.5 * self.array.thickness / light.cosine[:, None] * light.along
        throughput = 1.0 - self._transmittance(light)
        path = np.full(len(positions), PlatePath.REFLECTED, np.uint8)
        return self._leaving(place, light.along, -light.cosine * light.side, throughput, path)

    def _entering(self, positions: Floats, directions: Floats) -> _Light:
        local = directions @ self.axes.T
        along, cosine = local[:, :2], np.maximum(np.abs(local[:, 2]), GRAZING)
        place = (positions - self.centre) @ self.axes[:2].T - 0.5 * self.array.thickness / cosine[:, None] * along
        depth = np.sqrt(np.maximum(1.0 - dot(along, along) / self.array.ior**2, GRAZING**2))
        return _Light(place, along, np.where(local[:, 2] < 0, -1.0, 1.0), cosine, depth)

    def _leaving(self, place: Floats, along: Floats, across: Floats, throughput: Floats, path: np.ndarray) -> Crossing:
        directions = normalise(along @ self.axes[:2] + across[:, None] * self.axes[2])
        return Crossing(self.centre + place @ self.axes[:2], directions, throughput, path)

    def _transmittance(self, light: _Light) -> Floats:
        """Of one face (n,)."""
        if not self.array.has_fresnel:
            return np.ones(len(light.cosine))
        return transmittance(light.cosine, light.depth, 1.0 / self.array.ior)

    def _mirrors(self, place: Floats) -> tuple[Floats, Floats]:
        """Unit normals (2, n, 2) of the two directions of mirrors that light meets at places (n, 2).

        And (2, n), m: added to a place's component along such a normal it is the distance from a mirror without phase.
        """
        angle = np.pi / 4 * np.array([1.0, 3.0]) + np.array([0.0, self.array.crossing_error])
        if self.array.layout != "radial":
            normals = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            return np.broadcast_to(normals[:, None], (2, *place.shape)), np.zeros((2, len(place)))
        # rings, as wide as the holes' diagonal; in each of them the holes stand side by side, their diagonals radial
        azimuth, radius = np.arctan2(place[:, 1], place[:, 0]), np.hypot(place[:, 0], place[:, 1])
        turned = azimuth + angle[:, None]
        normals = np.stack([np.cos(turned), np.sin(turned)], axis=2)
        ring = np.sqrt(2.0) * self.array.pitch * np.rint(radius / (np.sqrt(2.0) * self.array.pitch))
        along_ring = np.sin(angle)[:, None] * ring * azimuth
        return normals, along_ring

    def _cross(self, positions: Floats, directions: Floats, layer: "_Layer") -> Crossing:
        array = self.array
        light = self._entering(positions, directions)
        throughput = self._transmittance(light) ** 2
        normals, offset = self._mirrors(light.place)
        place, along = light.place, light.along.copy()
        way = array.height / (array.ior * light.depth)  # through a layer, for each unit of `along`
        is_odd = np.empty((2, len(place)), bool)
        rays = np.arange(len(place))
        for turn in (0, 1):
            k = np.where(light.side > 0, turn, 1 - turn)  # light against the normal comes to the second layer first
            normal = normals[k, rays]
            speed = dot(along, normal)
            q = (dot(place, normal) + offset[k, rays]) / array.pitch - np.asarray(array.phase)[k]
            moved, is_turned, part = layer(q, speed * way / array.pitch)
            throughput = throughput * part
            is_odd[k, rays] = is_turned
            place = place + array.pitch * moved[:, None] * normal
            if array.layout == "crossed":  # along its mirrors a layer of slits lets light drift, holes do not
                place = place + way[:, None] * (along - speed[:, None] * normal)
            along = along - np.where(is_turned, 2.0 * speed, 0.0)[:, None] * normal
        place = place - 0.5 * array.thickness / light.cosine[:, None] * along
        path = np.select(
            [is_odd.all(axis=0), is_odd[0], is_odd[1]],
            [PlatePath.IMAGED, PlatePath.STRAY_1, PlatePath.STRAY_2],
            PlatePath.THROUGH,
        )
        return self._leaving(place, along, light.side * light.cosine, throughput, path.astype(np.uint8))

    def _as_mirrors(self, q: Floats, travel: Floats) -> "_Turned":
        out, n_reflections = fold(q, travel)
        return out - q, n_reflections % 2 == 1, self.array.reflectance**n_reflections

    def _as_one_mirror(self, q: Floats, travel: Floats) -> "_Turned":
        return np.zeros(len(q)), np.ones(len(q), bool), _part(self.array, travel, True)


_Turned = tuple[Floats, Bools, Floats]  # of a layer: how far light moved, pitches; is it turned round; its throughput
_Layer = Callable[[Floats, Floats], _Turned]


def light_by_angle(array: MirrorArray, incidence: Floats, azimuth: float = 0.0) -> dict[PlatePath, Floats]:
    """Share (n,) of light that takes each path, in the mean over all phases of the mirrors.

    Parameters
    ----------
    incidence : (n,) rad, angle in air between the light and the plate's normal
    azimuth : rad, of the light's way along the plate, from one of its sides, to which mirrors stand at 45 degrees
    """
    sine, cosine = np.sin(incidence), np.maximum(np.cos(incidence), GRAZING)
    depth = np.sqrt(np.maximum(1.0 - (sine / array.ior) ** 2, GRAZING**2))
    face = transmittance(cosine, depth, 1.0 / array.ior) if array.has_fresnel else np.ones(len(incidence))
    pitches = sine * array.height / (array.ior * depth * array.pitch)
    first, second = np.pi / 4, 3 * np.pi / 4 + array.crossing_error
    found = {PlatePath.REFLECTED: 1.0 - face}
    for is_odd in (True, False):
        before = _part(array, pitches * np.cos(azimuth - first), is_odd)
        turned = 2 * first + np.pi - azimuth if is_odd else azimuth  # by a mirror
        for is_next_odd in (True, False):
            after = _part(array, pitches * np.cos(turned - second), is_next_odd)
            found[_PATHS[is_odd, is_next_odd]] = face**2 * before * after
    return found


_PATHS = {
    (True, True): PlatePath.IMAGED,
    (True, False): PlatePath.STRAY_1,
    (False, True): PlatePath.STRAY_2,
    (False, False): PlatePath.THROUGH,
}


def _part(array: MirrorArray, travel: Floats, is_odd: bool) -> Floats:
    """Share (n,) of light that is reflected an odd, or an even, number of times by one layer, and comes out."""
    share, number = odd_share(travel), odd_number(travel)
    if is_odd:
        return share * array.reflectance**number
    return (1.0 - share) * array.reflectance ** (number + np.where(np.abs(travel) < number, -1.0, 1.0))


def array_frame(plate: Plate, normal: Floats) -> ArrayFrame:
    """Where the mirror array of a plate with a unit normal (3,) stands.

    Raises
    ------
    RigError : the plate is smaller than a pitch
    """
    corners = plate.mesh.corners
    side = corners[0, 1] - corners[0, 0] if plate.side is None else plate.side
    side = normalise(side - (side @ normal) * normal)
    axes = np.stack([side, np.cross(normal, side), normal])
    low, high = (f(corners.reshape(-1, 3) @ axes.T, axis=0) for f in (np.min, np.max))
    if (high - low)[:2].min() < plate.array.pitch:
        raise RigError(
            f"The plate '{plate.name}' is {1e3 * (high - low)[:2].min():g} mm wide, less than the"
            f" {1e3 * plate.array.pitch:g} mm from mirror to mirror: scale it up or lower its pitch."
        )
    middle = 0.5 * (low + high)
    if plate.centre is not None:
        middle[:2] = axes[:2] @ plate.centre
    return ArrayFrame(plate.array, middle @ axes, axes)
