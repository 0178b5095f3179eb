"""The mirror array plate in closed form: the outgoing ray of each incoming one.

A ray is reflected back and forth between two neighbouring mirrors. Unfolded, its path is straight:
each mirror it crosses is a reflection, and folding its end back into its own slit gives the exit.
Each of the two layers is therefore one fold, exact to rounding for any number of mirrors
(docs/theory.md).
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
    """One layer of mirrors at the integers: where light exits, and its number of reflections.

    Parameters
    ----------
    q : (n,) entry along the mirrors' normal, in pitches
    travel : (n,) signed displacement without mirrors, in pitches

    Returns
    -------
    q' (n,) in the same slit as q, and n_reflections (n,); each reflection reverses the slope
    """
    slit = np.floor(q)
    unfolded = q + travel
    into = np.floor(unfolded)
    n_reflections = np.abs(into - slit).astype(np.int64)
    inside = unfolded - into
    return slit + np.where(is_odd(n_reflections), 1.0 - inside, inside), n_reflections


def is_odd(n: Ints) -> Bools:
    """Whether integers (n,) are odd, by their lowest bit; the remainder would take as long as the
    rest of the fold.
    """
    return (n & 1).astype(bool)


def odd_share(r: Floats) -> Floats:
    """Share (n,) of light with an odd number of reflections, over all phases, for a displacement of
    r (n,) pitches.
    """
    return 1.0 - np.abs(np.abs(r) % 2 - 1.0)


def odd_number(r: Floats) -> Floats:
    """The odd number of reflections: of the two possible numbers, |r| rounded up and down, one is
    odd.
    """
    return 2.0 * np.floor(np.abs(r) / 2) + 1.0


def reflected_share(array: MirrorArray, travel: Floats, is_reversed: bool) -> Floats:
    """Share (n,) of light transmitted by one layer after an odd (is_turned) or even number of
    reflections.
    """
    share = odd_share(travel)
    number = odd_number(travel)
    if is_reversed:
        return share * array.reflectance**number
    return (1.0 - share) * array.reflectance ** (
        number + np.where(np.abs(travel) < number, -1.0, 1.0)
    )


# sine of the angle to the plate below which light runs in its plane and meets nothing
GRAZING = 1e-12


class PlatePath(IntEnum):
    """The effect of plates on light; set by the first mirror array that does not image it."""

    NONE = 0
    IMAGED = 1
    STRAY_1 = 2
    STRAY_2 = 3
    THROUGH = 4
    REFLECTED = 5


STRAY_PATHS = (PlatePath.STRAY_1, PlatePath.STRAY_2, PlatePath.THROUGH, PlatePath.REFLECTED)


class Crossing(NamedTuple):
    """Light that has left the plate.

    positions : (n, 3) m, apparent origins on the plate's middle plane
    directions : (n, 3) unit
    throughput : (n,)
    path : (n,) of PlatePath
    """

    positions: Floats
    directions: Floats
    throughput: Floats
    path: np.ndarray


def _dot(a: Floats, b: Floats) -> Floats:
    """Scalar products (n,) of columns (2, n) and (2, n or 1)."""
    return a[0] * b[0] + a[1] * b[1]


def _depth(array: MirrorArray, cosine: Floats) -> Floats:
    """Cosine (n,) in the plate's glass of light with cosine (n,) in air, both to the normal."""
    n = array.ior
    # sqrt(1 - sine^2 / n^2), without cancellation for grazing light at n = 1
    return np.sqrt((n - 1.0) * (n + 1.0) + cosine**2) / n


def _transmittance(array: MirrorArray, cosine: Floats, depth: Floats) -> Floats:
    """Transmittance (n,) of one face, for light with these cosines in air and glass."""
    return (
        transmittance(cosine, depth, 1.0 / array.ior) if array.has_fresnel else np.ones(len(cosine))
    )


class _Light(NamedTuple):
    """Light at the face it enters by, in the plate's frame.

    place : (2, n) m, from the centre
    along, cosine : (2, n) and (n,), direction in air, along the plate and across
    side : (n,) +1 if it travels along the normal, else -1
    depth : (n,) cosine of the direction in the glass

    Two rows of n, because broadcasts over n pairs take several times as long.
    """

    place: Floats
    along: Floats
    side: Floats
    cosine: Floats
    depth: Floats


@dataclass(frozen=True, eq=False)
class ArrayFrame:
    """A mirror array in place.

    centre : (3,) m
    axes : (3, 3), rows along a side, along the other, normal
    """

    array: MirrorArray
    centre: Floats
    axes: Floats

    def imaged(self, positions: Floats, directions: Floats) -> Crossing:
        """Light of the mid-air image (odd, odd), averaged over all phases of the mirrors.

        It exits as if each layer were one plane mirror, and its throughput is the share of light on
        this path. Both change smoothly, so the view map uses this light.
        """
        return self._cross(positions, directions, self._as_one_mirror)

    def folded(self, positions: Floats, directions: Floats) -> Crossing:
        """Light reflected by the mirrors at their actual positions."""
        return self._cross(positions, directions, self._as_mirrors)

    def reflected(self, positions: Floats, directions: Floats) -> Crossing:
        """Light reflected by the face it meets first."""
        light = self._entering(positions, directions)
        # the face is half the thickness nearer than the middle plane, the apparent origin
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
        """Unit normals (2, 2, n or 1), xy, of the two directions of mirrors at places (2, n).

        And offsets (2, n or 1), m: added to a place's component along such a normal, they give the
        distance from a mirror without phase.
        """
        angle = np.pi / 4 * np.array([1.0, 3.0]) + np.array([0.0, self.array.crossing_error])
        if self.array.layout != "radial":
            return np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, :, None], np.zeros((2, 1))
        # rings as wide as the holes' diagonal, each with holes side by side and their diagonals
        # radial
        azimuth = np.arctan2(place[1], place[0])
        radius = np.hypot(*place)
        turned = azimuth + angle[:, None]
        normals = np.stack([np.cos(turned), np.sin(turned)], axis=1)
        ring = np.sqrt(2.0) * self.array.pitch * np.rint(radius / (np.sqrt(2.0) * self.array.pitch))
        along_ring = np.sin(angle)[:, None] * ring * azimuth
        return normals, along_ring

    def mirror_normals(self, positions: Floats) -> Floats:
        """Unit normals (n, 2, 3) of both directions of mirrors at places (n, 3) of the plate."""
        normals, _ = self._mirrors(turn(self.axes[:2], positions - self.centre).T)
        normals = np.broadcast_to(normals, (2, 2, len(positions)))
        return np.einsum("kin,ij->nkj", normals, self.axes[:2])

    def _cross(self, positions: Floats, directions: Floats, layer: "_Layer") -> Crossing:
        array = self.array
        light = self._entering(positions, directions)
        throughput = _transmittance(array, light.cosine, light.depth) ** 2
        normals, offset = self._mirrors(light.place)
        place = light.place
        along = light.along
        drift = array.height / (array.ior * light.depth)  # through a layer, per unit of `along`
        phase = np.fmod(array.phase, 1.0)  # whole pitches have no effect
        is_first = light.side > 0  # light against the normal meets the second layer first
        reversals = []

        for first, then in ((0, 1), (1, 0)):
            normal = np.where(is_first, normals[first], normals[then])
            shift = np.where(
                is_first,
                offset[first] - array.pitch * phase[first],
                offset[then] - array.pitch * phase[then],
            )

            # where the light meets the layer, and the effect of the layer
            speed = _dot(along, normal)
            q = (_dot(place, normal) + shift) / array.pitch
            moved, is_reversed, part = layer(q, speed * drift / array.pitch)
            throughput = throughput * part
            reversals.append(is_reversed)

            step = array.pitch * moved
            # light drifts along the mirrors of slits, but not of holes
            if array.layout == "crossed":
                place = place + drift * along
                step = step - drift * speed
            place = place + step * normal
            along = along - np.where(is_reversed, 2.0 * speed, 0.0) * normal

        # relative to the middle plane
        place = place - 0.5 * array.thickness / light.cosine * along
        before, after = reversals
        path = np.where(is_first, _PATHS[before + 2 * after], _PATHS[after + 2 * before])
        return self._leaving(place, along, light.side * light.cosine, throughput, path)

    def _as_mirrors(self, q: Floats, travel: Floats) -> "_LayerEffect":
        out, n_reflections = fold(q, travel)
        return out - q, is_odd(n_reflections), self.array.reflectance**n_reflections

    def _as_one_mirror(self, q: Floats, travel: Floats) -> "_LayerEffect":
        return np.zeros(len(q)), np.ones(len(q), bool), reflected_share(self.array, travel, True)


# index: 1 if reversed by the first layer, plus 2 if by the second
_PATHS = np.array(
    [PlatePath.THROUGH, PlatePath.STRAY_1, PlatePath.STRAY_2, PlatePath.IMAGED], np.uint8
)
# of a layer: displacement in pitches; whether the light is reversed; its throughput
_LayerEffect = tuple[Floats, Bools, Floats]
_Layer = Callable[[Floats, Floats], _LayerEffect]


def light_by_angle(
    array: MirrorArray, incidence: Floats, azimuth: float = 0.0
) -> dict[PlatePath, Floats]:
    """Share (n,) of light on each path, averaged over all phases of the mirrors.

    Parameters
    ----------
    incidence : (n,) rad, angle in air between the light and the plate's normal
    azimuth : rad, of the light's direction along the plate, from a side at 45 degrees to the
        mirrors
    """
    sine = np.sin(incidence)
    cosine = np.maximum(np.cos(incidence), GRAZING)
    depth = _depth(array, cosine)
    face = _transmittance(array, cosine, depth)
    pitches = sine * array.height / (array.ior * depth * array.pitch)

    # an even or odd number of reflections in each layer
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
    """The mirror array of a plate with a unit normal (3,), in place.

    Raises
    ------
    RigError : the plate is smaller than a pitch, or the orientation of its mirrors is undefined
    """
    # axes: along a side, along the other, normal
    corners = plate.mesh.corners
    side = corners[0, 1] - corners[0, 0] if plate.side is None else plate.side
    side = normalise(side - (side @ normal) * normal)
    if not (side @ side > 0.5 and np.isfinite(0.0 if plate.centre is None else plate.centre).all()):
        raise RigError(
            "The plate '{plate}' needs its X axis in its plane, as a direction for its mirrors:"
            " rotate its mesh, and apply its scale.",
            plate=plate.name,
        )
    axes = np.stack([side, np.cross(normal, side), normal])

    # a strip at an angle is narrower than its extent along either axis
    low, high = (f(corners.reshape(-1, 3) @ axes.T, axis=0) for f in (np.min, np.max))
    area = areas_of(corners).sum()
    width = min((high - low)[:2].min(), np.sqrt(2.0) * area / np.linalg.norm((high - low)[:2]))
    if width < plate.array.pitch:
        raise RigError(
            "The plate '{plate}' is {width:g} mm wide, less than its pitch of {pitch:g} mm: scale"
            " it up or lower its pitch.",
            plate=plate.name,
            width=1e3 * width,
            pitch=1e3 * plate.array.pitch,
        )

    middle = 0.5 * (low + high)
    if plate.centre is not None:
        middle[:2] = axes[:2] @ plate.centre
    return ArrayFrame(plate.array, middle @ axes, axes)
