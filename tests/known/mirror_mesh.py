"""Every mirror of a plate as two triangles, traced by Embree: a judge of the closed form."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from kiriko.core.base.vectors import dot
from kiriko.core.light.optics import transmittance
from kiriko.core.light.plate import ArrayFrame, Crossing, PlatePath, array_frame
from kiriko.core.rig.rig import PRESETS, MirrorArray, Plate
from known.reference_rigs import rectangle

Floats = NDArray[np.float64]

MM = 1e3  # the mesh is in mm
# so that there are 1380 mirrors a layer, as published
ARRAY = replace(PRESETS["ASKA3D-488"], phase=(0.5, 0.5))
# m, of the plate; rays enter so far from its border that all of them leave behind it
SIDE = 0.488
MARGIN = 0.005
STEEPEST = 70.0  # degrees of incidence
PATHS = np.array(
    [PlatePath.THROUGH, PlatePath.STRAY_1, PlatePath.STRAY_2, PlatePath.IMAGED], np.uint8
)
SAME_PLACE = 1e-3  # mm, of comings out
# of a ray with mirrors: the steepest has 6, a ray with more is caught in a mirror
MOST_MEETINGS = 30
BATCH = 1 << 14  # rays at once: of 2^11 to 2^16 the fastest for the mesh and for the closed form


def plate_frame(array: MirrorArray = ARRAY, side: float = SIDE, is_own: bool = False) -> ArrayFrame:
    """A square plate as it stands in the ball rig, at 45 degrees; or in its own frame.

    That has its origin in the plate's middle, and its x and
    y axes along the two directions' normals.
    """
    c = 0.5**0.5
    if is_own:
        centre = np.zeros(3)
        axes = np.array([[c, -c, 0], [c, c, 0], [0, 0, 1]])
    else:
        centre = np.array([0.0, 0.15, 0.0])
        axes = np.array([[1, 0, 0], [0, c, c], [0, -c, c]])
    return array_frame(
        Plate("plate", rectangle(centre, axes[0], axes[1], side, side), array), axes[2]
    )


def random_light(
    frame: ArrayFrame, n: int, side: float = SIDE, seed: int = 0
) -> tuple[Floats, Floats]:
    """Positions on the middle plane and unit directions (n, 3):
    both ways, all azimuths, uniform in solid angle.
    """
    rng = np.random.default_rng(seed)
    cosine = rng.uniform(np.cos(np.radians(STEEPEST)), 1, n)
    azimuth = rng.uniform(0, 2 * np.pi, n)
    sine = np.sqrt(1 - cosine**2)
    local = np.stack(
        [sine * np.cos(azimuth), sine * np.sin(azimuth), cosine * rng.choice([-1, 1], n)], axis=1
    )
    place = rng.uniform(MARGIN - side / 2, side / 2 - MARGIN, (n, 2))
    return frame.centre + place @ frame.axes[:2], local @ frame.axes


class MirrorMesh:
    """Every mirror of a plate of two crossed layers as two triangles, in an Embree scene."""

    def __init__(self, frame: ArrayFrame, side: float = SIDE) -> None:
        self.frame = frame
        array = frame.array
        normal = frame.axes[2]
        corners = []
        self.n_mirrors = []
        self.normals = np.empty((2, 3))

        for layer, angle in enumerate((np.pi / 4, 3 * np.pi / 4 + array.crossing_error)):
            c = np.cos(angle)
            s = np.sin(angle)
            self.normals[layer] = c * frame.axes[0] + s * frame.axes[1]
            along = c * frame.axes[1] - s * frame.axes[0]
            most = int(side / array.pitch) + 1
            at = array.pitch * (np.arange(-most, most + 1) + array.phase[layer])
            # a mirror runs within the square from where it passes the
            # one pair of sides to where it passes the other
            ways = np.sort(
                [[(c * at + k * side / 2) / s, (s * at + k * side / 2) / -c] for k in (-1, 1)],
                axis=0,
            )
            start = ways[0].max(axis=0)
            end = ways[1].min(axis=0)
            is_there = start < end
            at = at[is_there]
            start = start[is_there]
            end = end[is_there]
            low = (layer - 1) * array.height
            high = layer * array.height
            ends = [(start, low), (end, low), (end, high), (start, high)]
            corners.append(
                [
                    at[:, None] * self.normals[layer] + e[:, None] * along + z * normal
                    for e, z in ends
                ]
            )
            self.n_mirrors.append(len(at))

        quads = np.concatenate([np.stack(quad, axis=1) for quad in corners]) + frame.centre
        triangles = (MM * quads)[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
        self.layer = np.repeat([0, 1], 2 * np.array(self.n_mirrors))
        self.scene = EmbreeScene()

        # kept: the scene does not own it
        self.mesh = TriangleMesh(self.scene, triangles.astype(np.float32))

    def folded(self, positions: Floats, directions: Floats, offset: float) -> Crossing:
        """The same as ArrayFrame.folded, from mirror to mirror.

        Off each light goes on from `offset` mm beside it.
        """
        array = self.frame.array
        normal = self.frame.axes[2]
        centre = MM * self.frame.centre
        slope = directions @ normal
        half = MM * array.thickness / 2
        d = (directions - slope[:, None] * normal) / array.ior
        depth = np.sqrt(1 - dot(d, d))
        d += np.copysign(depth, slope)[:, None] * normal
        places = MM * positions - (half / np.abs(slope))[:, None] * directions
        n_reflections = np.zeros((2, len(places)), np.int64)
        live = np.arange(len(places))

        for _ in range(MOST_MEETINGS):
            hits = self.scene.run(
                places[live].astype(np.float32), d[live].astype(np.float32), output=True
            )
            hit = hits["primID"] >= 0
            live = live[hit]
            triangle = hits["primID"][hit]
            way = hits["tfar"][hit]
            if not len(live):
                break
            layer = self.layer[triangle]
            mirror = self.normals[layer]
            towards = dot(d[live], mirror)[:, None]
            places[live] += way[:, None] * d[live] - offset * np.sign(towards) * mirror
            d[live] -= 2 * towards * mirror
            n_reflections[layer, live] += 1

        across = d @ normal
        left = half - np.sign(slope) * ((places - centre) @ normal)
        places += (left / depth)[:, None] * d
        d = array.ior * (d - across[:, None] * normal) + slope[:, None] * normal
        places -= (half / np.abs(slope))[:, None] * d  # light seems to come from the middle plane
        throughput = transmittance(np.abs(slope), depth, 1 / array.ior) ** 2
        is_odd = n_reflections % 2 == 1
        path = PATHS[is_odd[0] + 2 * is_odd[1]]

        return Crossing(
            places / MM, d, throughput * array.reflectance ** n_reflections.sum(axis=0), path
        )


class Agreement(NamedTuple):
    """Shares of rays with the same path, and with place (to SAME_PLACE), too.

    Median distance of those places, mm.
    """

    path: float
    place: float
    apart: float


def agreement(mesh: MirrorMesh, light: tuple[Floats, Floats], offset: float) -> Agreement:
    """How well mesh and closed form agree on the fate of light."""
    same_path = []
    apart = []
    for some in chunks(light):
        found = mesh.folded(*some, offset)
        crossing = mesh.frame.folded(*some)
        same_path.append(found.path == crossing.path)
        apart.append(MM * np.linalg.norm(found.positions - crossing.positions, axis=1))
    same = np.concatenate(same_path)
    apart = np.concatenate(apart)
    return Agreement(
        same.mean(), (same & (apart < SAME_PLACE)).mean(), float(np.median(apart[same]))
    )


def chunks(light: tuple[Floats, Floats]) -> Iterator[tuple[Floats, ...]]:
    """Light, BATCH rays at a time."""
    for first in range(0, len(light[0]), BATCH):
        yield tuple(part[first : first + BATCH] for part in light)
