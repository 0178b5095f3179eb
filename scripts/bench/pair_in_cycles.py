"""At which depth two eyes see the dots of the lattice, and how high, by Cycles' renders of both and
as core's `two_eyes` has it. Runs inside Blender.

Of the renders all is by Blender's cameras and `known/sights.py`: dots are measured in either, and
give two lines of sight. They can be as right as the dots are measured. What is allowed is a mark in
px of a render, by which what the two eyes see of a dot may differ from core's prediction: on the
mean over the dots as far as each dot of one eye may (eyes_in_cycles.py), and four standard
deviations of a normal distribution of that mean for single ones. With z from the eyes to the
picture, b between the eyes and p a pixel's size on the picture, that is p z / b of depth across,
and the angle p / z up.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import bpy
import numpy as np

from kiriko.core.base.steps import finish
from kiriko.core.blender.scene import Reading, read
from kiriko.core.lab.measure.two_eyes import two_eyes
from kiriko.core.lab.measure.viewer_errors import ARCMIN
from kiriko.core.rig.rig import Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import without_glass
from known.sights import in_front_of, line_of_sight, raised, seen_as_one
from paper import lattice

WAYS = ("uncompensated", "for_left", "for_right", "for_both")
MOST_MEAN = 0.05  # px
MOST_SINGLE = 0.25  # px


@dataclass(frozen=True, eq=False)
class Pair:
    """What two eyes see of the lattice, by one way to show it.

    depth, vertical : m in front of the picture's plane, and arcmin by which the left eye sees a dot
        higher: (2, n, n) each, in Cycles' renders and by core; NaN where not both eyes see a dot
    pixel : m of depth, and arcmin up, that a px of the renders is
    """

    way: str
    depth: np.ndarray
    vertical: np.ndarray
    pixel: tuple[float, float]

    @property
    def is_known(self) -> np.ndarray:
        """Which dots (n, n) both eyes see, in the renders and by core."""
        return np.isfinite(self.vertical).all(axis=0)

    @property
    def off(self) -> np.ndarray:
        """How far apart depths, m, and disparities, arcmin, of these dots are: (2, k)."""
        return np.stack([np.abs(a - b)[self.is_known] for a, b in (self.depth, self.vertical)])

    @property
    def is_as_predicted(self) -> bool:
        """Are renders and prediction apart by no more than the marks?"""
        px = self.off / np.array(self.pixel)[:, None]
        return px.size > 0 and bool((px.mean(axis=1) < MOST_MEAN).all() and px.max() < MOST_SINGLE)


def pairs(
    scene: bpy.types.Scene, ways: tuple[str, ...] = WAYS, samples: int = lattice.SAMPLES
) -> Iterator[Pair]:
    """What the scene's two viewers that are on see, the left one before the right."""
    settings = Settings(disagreement="sharp")
    session = Session()
    eyes = [number for number, one in enumerate(scene.kiriko.viewers) if one.is_on]
    rig = _reading(scene, eyes[0]).rig
    predicted = finish(two_eyes(rig, settings))
    counted = {"for_left": rig.viewers[:1], "for_right": rig.viewers[1:]}

    for way in ways:
        if way == "uncompensated":
            plain = replace(settings, only_through_glass=False)
            source = finish(Session().solve(without_glass(rig), plain)).source
        else:
            solved_for = replace(rig, viewers=counted.get(way, rig.viewers))
            source = finish(session.solve(solved_for, settings)).source

        sights = []
        for number in eyes:
            reading = _reading(scene, number)
            solution = finish(session.solve(reading.rig, settings))
            ideal, seen = solution.ideal(), solution.seen(source)
            dots = lattice.dots_in_cycles(scene, reading, source, ideal, seen, samples)
            camera = scene.kiriko.viewers[number].camera
            sights.append(line_of_sight(camera, dots.size, dots.shown.reshape(-1, 2)))
        depth, vertical = _judged(scene, sights)
        one = getattr(predicted, way)
        shape = one.depth.shape
        yield Pair(
            way,
            np.stack([depth.reshape(shape), one.depth]),
            np.stack([vertical.reshape(shape), one.vertical]),
            _pixel(rig),
        )


def _reading(scene: bpy.types.Scene, number: int) -> Reading:
    """The scene with an entry of its viewers as the first, which Cycles looks from."""
    scene.kiriko.viewer_shown = number
    bpy.context.view_layer.update()
    return read(bpy.context.evaluated_depsgraph_get(), scene)


def _judged(
    scene: bpy.types.Scene, sights: list[tuple[np.ndarray, np.ndarray]]
) -> tuple[np.ndarray, np.ndarray]:
    """Depth, m, and vertical disparity, arcmin, (n,) of lines of sight of two eyes."""
    (one, along), (other, along_other) = sights
    lines = one, other, along, along_other
    picture = next(thing for thing in scene.objects if thing.kiriko.role == "PICTURE")
    metres = scene.unit_settings.scale_length
    return metres * in_front_of(picture, seen_as_one(*lines), one), raised(*lines)


def _pixel(rig: Rig) -> tuple[float, float]:
    """Depth, m, and angle, arcmin, that a px of the renders is in the middle of the picture."""
    left, right = (eye.position for eye in rig.viewers)
    corners = rig.picture_place.mesh.corners.reshape(-1, 3)
    away = np.linalg.norm((left + right) / 2 - corners.mean(axis=0))
    # from the first of the dots to the last are six of seven parts
    size = np.ptp(corners, axis=0).max() * 6 / 7 / lattice.ACROSS
    return size * away / np.linalg.norm(right - left), ARCMIN * size / away
