"""The eye or camera that the source image is made for."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Floats
from ..base.errors import RigError
from .roles import Part

PERPENDICULAR = 1e-9  # axes of a frame may miss orthonormality by this much


@dataclass(frozen=True, eq=False)
class Viewer(Part):
    """A pinhole or orthographic camera.

    Viewer pixels (x, y) run right and down from the top left
    corner of the image; pixel centres at + 0.5.

    Parameters
    ----------
    position : (3,) float64, m
    axes : (3, 3) float64, rows right, up, forward; orthonormal, world
    window : left, right, bottom, top of the image on the plane at unit distance along forward
        (perspective: dimensionless tangents) or on the camera's own plane (orthographic: m)
    width, height : pixels
    weight : how much it counts beside other viewers, above 0
    """

    name: str
    projection: Literal["perspective", "orthographic"]
    position: Floats
    axes: Floats
    window: tuple[float, float, float, float]
    width: int
    height: int
    weight: float = 1.0

    def __post_init__(self) -> None:
        if np.abs(self.axes @ self.axes.T - np.eye(3)).max() > PERPENDICULAR:
            raise RigError(
                "The axes of the viewer '{name}' are not orthonormal: remove shear from the"
                " camera.",
                name=self.name,
            )

    def check_numbers(self, owner: str) -> None:
        """Raise RigError when it stands nowhere or sees nothing."""
        left, right, bottom, top = self.window
        if not np.isfinite([*self.position, *self.axes.ravel(), *self.window]).all():
            raise RigError(
                "{owner} has a place, lens or shift that is no finite number: look for a"
                " driver or a keyframe.",
                owner=owner,
            )

        if min(self.width, self.height) < 1:
            raise RigError("{owner} has no pixels: set its resolution.", owner=owner)

        if not (right != left and top != bottom):
            raise RigError(
                "{owner} sees nothing: its lens or orthographic scale has no size.", owner=owner
            )

        if not (np.isfinite(self.weight) and self.weight > 0):
            raise RigError(
                "{owner} has the weight {weight:g}: set one above 0, or take it out of the list.",
                owner=owner,
                weight=self.weight,
            )

    def weighed(self, values: Floats) -> Floats:
        """Values as much as the viewer counts; the array itself at a weight of 1."""
        return values if self.weight == 1 else self.weight * values

    def _on_plane(self, xy: ArrayLike) -> tuple[Floats, Floats]:
        """Window coordinates, both (n,), of viewer pixels (n, 2): numpy is slow where rows are
        short.
        """
        left, right, bottom, top = self.window
        x, y = np.asarray(xy, float).T
        return (
            left + (right - left) * (x / self.width),
            top + (bottom - top) * (y / self.height),
        )

    def rays(self, xy: ArrayLike) -> tuple[Floats, Floats]:
        """Origins and unit directions (n, 3) of the rays through viewer pixels xy (n, 2)."""
        u, v = self._on_plane(xy)
        right, up, forward = self.axes
        across = [u * right[k] + v * up[k] for k in range(3)]

        if self.projection == "orthographic":
            origins = np.stack(across, axis=1) + self.position
            return origins, np.broadcast_to(forward, origins.shape).copy()

        along = [forward[k] + across[k] for k in range(3)]
        length = np.sqrt(sum(a * a for a in along))
        directions = np.stack([a / length for a in along], axis=1)
        return np.broadcast_to(self.position, directions.shape).copy(), directions

    def project(self, points: ArrayLike) -> Floats:
        """Viewer pixels (n, 2) at which points (n, 3) are seen
        straight; NaN behind a perspective viewer.
        """
        across = (np.asarray(points, float) - self.position) @ self.axes.T
        plane = across[:, :2]

        if self.projection == "perspective":
            depth = np.where(across[:, 2:] > 0, across[:, 2:], np.nan)
            plane = plane / depth

        left, right, bottom, top = self.window
        return np.stack(
            [
                (plane[:, 0] - left) / (right - left) * self.width,
                (plane[:, 1] - top) / (bottom - top) * self.height,
            ],
            axis=1,
        )
