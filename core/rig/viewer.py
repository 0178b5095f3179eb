"""The eye or camera that the source image is made for."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arrays import Floats, convert
from ..base.errors import RigError, check_choice, not_finite, out_of_range
from ..base.vectors import dot
from .mesh import Mesh
from .parts import Picture, Plate
from .roles import Part

ARCMIN = np.degrees(1.0) * 60
ProjectionKind = Literal["perspective", "orthographic"]
PERPENDICULAR = 1e-9  # largest deviation of a frame's axes from orthonormality


@dataclass(frozen=True, eq=False)
class Viewer(Part):
    """A pinhole or orthographic camera.

    Viewer pixels (x, y) run right and down from the top left corner of the image; pixel centres at
    + 0.5.

    Parameters
    ----------
    name : in messages; unique
    projection : "perspective" or "orthographic"
    position : (3,) float64, m, world
    axes : (3, 3) float64, rows right, up, forward; orthonormal, world
    window : left, right, bottom, top of the image on the plane at unit distance along forward
        (perspective: dimensionless tangents) or on the camera's own plane (orthographic: m)
    width, height : pixels
    weight : relative to other viewers, above 0
    pupil : m, diameter of the disc around the position that light enters; 0 for a pinhole
    focus : m along forward to the plane that a pupil sees sharp; None for the picture's centre
    """

    name: str
    projection: ProjectionKind
    position: NDArray[Any]
    axes: NDArray[Any]
    window: tuple[float, float, float, float]
    width: int
    height: int
    weight: float = 1.0
    pupil: float = 0.0
    focus: float | None = None

    def __post_init__(self) -> None:
        convert(self, partial(np.asarray, dtype=np.float64), "position", "axes")
        convert(self, lambda sides: tuple(map(float, sides)), "window")
        convert(self, int, "width", "height")
        if np.abs(self.axes @ self.axes.T - np.eye(3)).max() > PERPENDICULAR:
            raise RigError(
                "The axes of the viewer '{name}' are not orthonormal: remove shear from the"
                " camera.",
                name=self.name,
            )

    def check_numbers(self, owner: str) -> None:
        """Raise RigError if its numbers are not finite, or it sees nothing."""
        left, right, bottom, top = self.window
        check_choice(owner, "projection", self.projection, ProjectionKind)
        if not np.isfinite([*self.position, *self.axes.ravel(), *self.window]).all():
            raise not_finite(owner)

        if min(self.width, self.height) < 1:
            raise RigError("{owner} has no pixels: set its resolution.", owner=owner)

        if not (right != left and top != bottom):
            raise RigError(
                "{owner} sees nothing: set its focal length or orthographic scale above 0.",
                owner=owner,
            )

        if not (np.isfinite(self.weight) and self.weight > 0):
            raise out_of_range(owner, "Weight", self.weight, 0)

        if not (np.isfinite(self.pupil) and self.pupil >= 0):
            raise out_of_range(owner, "Diameter", self.pupil, 0)

        if self.focus is not None and not (np.isfinite(self.focus) and self.focus > 0):
            raise out_of_range(owner, "Focus Distance", self.focus, 0)

        if self.pupil and self.projection != "perspective":
            raise RigError(
                "{owner} is orthographic and has no pupil: set Diameter to 0, or make the camera"
                " perspective.",
                owner=owner,
            )

    @property
    def pinhole(self) -> "Viewer":
        """The viewer with a pupil of one point, as view maps are traced for."""
        return self if not self.pupil else replace(self, pupil=0.0, focus=None)

    def weighed(self, values: Floats) -> Floats:
        """Values times the viewer's weight; the same array at a weight of 1."""
        return values if self.weight == 1 else self.weight * values

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of its image, px."""
        return self.width, self.height

    def _on_plane(self, xy: ArrayLike) -> tuple[Floats, Floats]:
        """Window coordinates, both (n,), of viewer pixels (n, 2), by columns for speed."""
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

    def arcmin_between(self, one: Floats, other: Floats) -> Floats:
        """Angles (n,), arcmin, between the rays through places (n, 2) viewer px; NaN at NaN."""
        along, other_rays = (self.rays(xy)[1] for xy in (one, other))
        across = np.linalg.norm(np.cross(along, other_rays), axis=1)
        return ARCMIN * np.arctan2(across, dot(along, other_rays))

    def project(self, points: ArrayLike) -> Floats:
        """Viewer pixels (n, 2) of points (n, 3), without refraction; NaN behind a perspective
        viewer.
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


@dataclass(frozen=True, eq=False)
class Projector(Viewer):
    """A projector: light leaves its pixels along the rays that would enter a camera's."""


def check_together(viewers: Sequence[Viewer], plates: Sequence[Plate], has_mirrors: bool) -> None:
    """Raise RigError for a repeated viewer, a repeated name, or a plate between two viewers.

    With mirrors, light of viewers on both sides of a plate may reach the same side, so plates are
    not checked.
    """
    if len(viewers) < 2:
        return

    name, n = Counter(viewer.name for viewer in viewers).most_common(1)[0]
    if n > 1:
        raise RigError(
            "{n} viewers are named '{viewer}': rename or remove all but one.", n=n, viewer=name
        )

    for plate in () if has_mirrors else plates:
        sides = [_side(viewer, plate.mesh) for viewer in viewers]
        if min(sides) < 0 < max(sides):
            one, other = (viewers[int(pick(sides))].name for pick in (np.argmax, np.argmin))
            raise RigError(
                "The plate '{plate}' is between the viewers '{one}' and '{other}': move both to"
                " one side.",
                plate=plate.name,
                one=one,
                other=other,
            )


def check_own_images(viewers: Sequence[Viewer], picture: Picture) -> None:
    """Raise RigError if only some viewers have their own image, or the picture also has a plane."""
    if picture.mesh is not None:
        raise RigError(
            "The picture '{picture}' has both a plane and viewers' own images: remove one of them.",
            picture=picture.name,
        )

    with_image = {one.name for one in picture.own}
    for viewer in viewers:
        if viewer.name not in with_image:
            raise RigError(
                "The viewer '{viewer}' has no image of its own, but others do: choose one in the"
                " list of viewers, or remove theirs.",
                viewer=viewer.name,
            )


def _side(viewer: Viewer, mesh: Mesh) -> float:
    """The side of a flat mesh a viewer is on: positive in front."""
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    normals = np.cross(b - a, c - a)
    largest = np.argmax(np.linalg.norm(normals, axis=1))
    normal = normals[largest]
    if viewer.projection == "orthographic":
        return float(-viewer.axes[2] @ normal)
    return float((viewer.position - a[largest]) @ normal)
