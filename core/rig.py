"""The rig: viewers, elements, display and picture, as plain frozen data in metres and float64."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import Bools, Floats, Ints
from .errors import MeshError, RigError

SurfaceChoice = Literal["automatic", "smooth", "facets"]

WAVELENGTH = 587.6e-9  # m, the helium d line, at which indices of refraction are given
FLAT = 1e-9  # of its size: glass no thicker than that, and than rounding makes it, encloses nothing
PERPENDICULAR = 1e-9  # axes of a frame may miss orthonormality by this much
MOST_CROSSING_ERROR = np.radians(10.0)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in world coordinates.

    Parameters
    ----------
    vertices : (v, 3) float64, m
    triangles : (t, 3) int, indices into vertices, counterclockwise
        seen from the front (outside of a solid)
    corner_normals : (t, 3, 3) float64 or None, unit, world. Used on smooth triangles only.
    is_smooth : (t,) bool or None (all flat). A flat triangle refracts by its own plane.
    uv : (t, 3, 2) float64 or None, Blender's UV: origin bottom left
    surface : that of smooth triangles: the curved one that was meant ("smooth"), or the facets as
        drawn, on which only the normal is interpolated ("facets"), or whichever the mesh shows to
        be nearer to the one meant, face by face ("automatic")
    has_mean_normals : corner normals are means over the faces around, as Blender makes them where
        the artist gave none; they only say where the surface is smooth, and its own normals are
        found from the vertices
    rounding : m, by which vertices may be off because they were rounded
    """

    vertices: Floats
    triangles: Ints
    corner_normals: Floats | None = None
    is_smooth: Bools | None = None
    uv: Floats | None = None
    surface: SurfaceChoice = "smooth"
    has_mean_normals: bool = False
    rounding: float = 0.0

    def flat(self) -> "Mesh":
        """The same triangles, each flat whatever its shading."""
        return replace(self, corner_normals=None, is_smooth=None)

    @property
    def corners(self) -> Floats:
        """Corner positions (t, 3, 3), m."""
        return self.vertices[self.triangles]

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner of the axis-aligned box (2, 3), m."""
        used = self._used_vertices()
        return np.stack([used.min(axis=0), used.max(axis=0)])

    def _used_vertices(self) -> Floats:
        """Vertices (n, 3) at which a triangle has a corner, m."""
        is_used = np.zeros(len(self.vertices), bool)
        is_used[self.triangles] = True
        return self.vertices[is_used]

    @cached_property
    def is_flat(self) -> bool:
        """Do all corners lie in one plane, but for rounding?"""
        points = self._used_vertices()
        points = points - points.mean(axis=0)

        # without the threads of BLAS (core/products.py); the first
        # axis is the one along which they spread least
        _, axes = np.linalg.eigh(np.einsum("ni,nj->ij", points, points))
        thick, _, wide = np.ptp(np.einsum("ni,ij->nj", points, axes), axis=0)

        return bool(thick <= FLAT * wide + 4 * self.rounding)

    def check(self, owner: str) -> None:
        """Raise MeshError when there is nothing to trace or a coordinate is not finite."""
        if len(self.triangles) == 0:
            raise MeshError(
                f"{owner} has no faces with an area: give it some, or set its role to None."
            )
        if self.triangles.min() < 0 or self.triangles.max() >= len(self.vertices):
            raise MeshError(
                f"{owner} has faces with corners that it has no vertices for: number them from 0."
            )
        if not np.isfinite(self.vertices).all():
            raise MeshError(
                f"{owner} has vertices that are not finite numbers: repair or remove them."
            )

    def check_uv(self, owner: str) -> None:
        """Raise MeshError when there is no UV map that an image can be put on."""
        if self.uv is None:
            raise MeshError(f"{owner} has no UV map: unwrap it, so that pixels have a place.")
        if not np.isfinite(self.uv).all():
            raise MeshError(
                f"{owner} has a UV map with numbers that are not finite: unwrap it again."
            )
        if not np.ptp(self.uv.reshape(-1, 2), axis=0).all():
            raise MeshError(f"{owner} has a UV map without area: unwrap it again.")


@dataclass(frozen=True)
class ConstantIndex:
    """An index of refraction that does not depend on the wavelength."""

    value: float

    def __call__(self, wavelength: float) -> float:
        """Index of refraction at a wavelength in metres."""
        return self.value


@dataclass(frozen=True, eq=False)
class Glass:
    """A glass object as drawn: one or more closed shells. Shells inside shells are cavities (air).

    `priority` decides where solids overlap: higher wins; among equals the smaller solid does. `ior`
    gives the index of refraction at a wavelength, m; it is data, such as a dataclass with the
    numbers of a formula, no plain function.
    """

    name: str
    mesh: Mesh
    ior: Callable[[float], float] = field(default_factory=lambda: ConstantIndex(1.49))
    priority: int = 0


@dataclass(frozen=True)
class MirrorArray:
    """A plate of upright micro mirrors in glass, of which those
    in two directions at right angles make a corner.

    Parameters
    ----------
    layout : how the two directions are made: two crossed layers of slits, one above the other
        (MMAP); square holes, both directions in one layer (DCRA); or such holes, turned with the
        azimuth about the plate's centre
    pitch : m, from mirror to mirror
    height : m, of the mirrors, that of one layer
    ior : index of refraction of the glass between the mirrors
    reflectance : of a mirror, above 0, up to 1
    crossing_error : rad, by which the second layer is turned further than 90 degrees from the first
    has_fresnel : the plate's two faces reflect as glass does
    phase : in pitches, by which the mirrors of the two directions stand beside the plate's centre
    """

    layout: Literal["crossed", "holes", "radial"] = "crossed"
    pitch: float = 0.5e-3
    height: float = 1.25e-3
    ior: float = 1.52
    reflectance: float = 0.87
    crossing_error: float = 0.0
    has_fresnel: bool = True
    phase: tuple[float, float] = (0.0, 0.0)

    @property
    def n_layers(self) -> int:
        return 2 if self.layout == "crossed" else 1

    @property
    def thickness(self) -> float:
        """From face to face, m."""
        return self.n_layers * self.height

    def check(self, owner: str) -> None:
        """Raise RigError when no such plate can be made."""
        for name, value in (("pitch", self.pitch), ("mirror height", self.height)):
            if not (np.isfinite(value) and value > 0):
                raise RigError(f"{owner} has a {name} of {1e3 * value:g} mm: set one above 0.")
        if not 0 < self.reflectance <= 1:
            raise RigError(
                f"{owner} has mirrors with a reflectance of {self.reflectance:g}: set"
                f" one above 0, up to 1."
            )
        if not (np.isfinite(self.ior) and self.ior >= 1):
            raise RigError(
                f"{owner} has an index of refraction of {self.ior:g}: set one of 1 or more."
            )
        if not abs(self.crossing_error) <= MOST_CROSSING_ERROR:
            raise RigError(
                f"{owner} has layers crossed {np.degrees(self.crossing_error):g} degrees wrong:"
                f" set at most {np.degrees(MOST_CROSSING_ERROR):g}."
            )
        if self.crossing_error and self.layout != "crossed":
            raise RigError(
                f"{owner} has one layer only, which cannot be crossed wrong: set the"
                f" crossing error to 0."
            )
        if not np.isfinite(self.phase).all():
            raise RigError(f"{owner} has a phase that is no number: set one in pitches.")


# the published model of the ASKA3D-488 (Kiuchi & Koizumi 2021, doi
# 10.1016/j.cag.2021.02.007), and one of finer pitch
PRESETS = {"ASKA3D-488": MirrorArray(), "ASKA3D-200": MirrorArray(pitch=0.3e-3, height=0.75e-3)}
PRESET_SIDES = {"ASKA3D-488": 0.488, "ASKA3D-200": 0.2}  # m


@dataclass(frozen=True, eq=False)
class Plate:
    """A flat plane-symmetric imaging element; its triangles give plane and outline.

    array : the mirrors it is made of; None for the ideal plate
    side : (3,) world, along one of its sides, to which mirrors stand
        at 45 degrees; None: its first face's first edge
    centre : (3,) m, world, from which the mirrors are counted; None: the middle of its extent
    """

    name: str
    mesh: Mesh
    array: MirrorArray | None = None
    side: Floats | None = None
    centre: Floats | None = None


@dataclass(frozen=True, eq=False)
class Mirror:
    """A surface that reflects on both sides."""

    name: str
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class Blocker:
    """A surface that stops light."""

    name: str
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class Display:
    """A surface with a UV map that shows the source image on its front; (width, height)
    in pixels.
    """

    name: str
    mesh: Mesh
    width: int
    height: int


@dataclass(frozen=True, eq=False)
class Picture:
    """The image that the viewer should see.

    Parameters
    ----------
    image : (h, w, 4) float32, linear, premultiplied by alpha, row 0 at the top
    mesh : the textured plane (with UV), or None when the image is in the viewer's own pixels
    """

    name: str
    image: NDArray[np.float32]
    mesh: Mesh | None = None


@dataclass(frozen=True, eq=False)
class Viewer:
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
    """

    name: str
    projection: Literal["perspective", "orthographic"]
    position: Floats
    axes: Floats
    window: tuple[float, float, float, float]
    width: int
    height: int

    def __post_init__(self) -> None:
        if np.abs(self.axes @ self.axes.T - np.eye(3)).max() > PERPENDICULAR:
            raise RigError(
                f"The axes of the viewer '{self.name}' are not orthonormal: remove"
                f" shear from the camera."
            )

    def check(self) -> None:
        """Raise RigError when it stands nowhere or sees nothing."""
        left, right, bottom, top = self.window
        if not np.isfinite([*self.position, *self.axes.ravel(), *self.window]).all():
            raise RigError(
                f"The viewer '{self.name}' has a place, lens or shift that is no finite number:"
                " look for a driver or a keyframe."
            )
        if min(self.width, self.height) < 1:
            raise RigError(f"The viewer '{self.name}' has no pixels: set its resolution.")
        if not (right != left and top != bottom):
            raise RigError(
                f"The viewer '{self.name}' sees nothing: its lens or orthographic scale"
                f" has no size."
            )

    def plane_from_pixels(self, xy: ArrayLike) -> Floats:
        """Window coordinates (n, 2) of viewer pixels (n, 2)."""
        left, right, bottom, top = self.window
        xy = np.asarray(xy, float)
        return np.stack(
            [
                left + (right - left) * (xy[:, 0] / self.width),
                top + (bottom - top) * (xy[:, 1] / self.height),
            ],
            axis=1,
        )

    def rays(self, xy: ArrayLike) -> tuple[Floats, Floats]:
        """Origins and unit directions (n, 3) of the rays through viewer pixels xy (n, 2)."""
        # column by column: numpy is slow where rows are three numbers long
        u, v = self.plane_from_pixels(xy).T
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


@dataclass(frozen=True, eq=False)
class Rig:
    """Everything on the bench. `check` tells the reason why it cannot be solved."""

    viewers: tuple[Viewer, ...]
    glasses: tuple[Glass, ...]
    plates: tuple[Plate, ...]
    displays: tuple[Display, ...]
    pictures: tuple[Picture, ...] = ()
    mirrors: tuple[Mirror, ...] = ()
    blockers: tuple[Blocker, ...] = ()

    @property
    def viewer(self) -> Viewer:
        return self.viewers[0]

    @property
    def display(self) -> Display:
        return self.displays[0]

    @property
    def picture(self) -> Picture:
        return self.pictures[0]

    def check(self) -> None:
        """Raise RigError or MeshError, in one sentence, when the rig cannot be solved."""
        parts = {
            "glass": (self.glasses, "set an object's role to Glass"),
            "plate": (self.plates, "set a plane's role to Plate"),
            "display": (self.displays, "set a plane's role to Display"),
            "picture": (self.pictures, "set a textured plane's role to Picture or choose an image"),
            "viewer": (self.viewers, "add a camera and make it the viewer"),
        }
        for word, (found, remedy) in parts.items():
            if not found:
                raise RigError(f"The rig has no {word}: {remedy}.")
        for word, single in (
            ("displays", self.displays),
            ("pictures", self.pictures),
            ("viewers", self.viewers),
        ):
            if len(single) > 1:
                names = ", ".join(f"'{part.name}'" for part in single)
                raise RigError(
                    f"The rig has {len(single)} {word} ({names}): keep one and set the"
                    f" others to None."
                )
        self.viewer.check()
        for glass in self.glasses:
            n = glass.ior(WAVELENGTH)
            if not (np.isfinite(n) and n > 0):
                raise RigError(
                    f"The glass '{glass.name}' has an index of refraction that is no number above"
                    f" 0: set one."
                )
        kinds = (
            ("glass", self.glasses),
            ("plate", self.plates),
            ("mirror", self.mirrors),
            ("blocker", self.blockers),
        )
        for kind, group in (*kinds, ("display", self.displays)):
            for part in group:
                part.mesh.check(f"The {kind} '{part.name}'")
        for glass in self.glasses:
            if glass.mesh.is_flat:
                raise MeshError(
                    f"The glass '{glass.name}' is no closed body, but flat: give it a thickness,"
                    " as by a Solidify modifier, or set its role to None."
                )
        for plate in self.plates:
            if plate.array is not None:
                plate.array.check(f"The plate '{plate.name}'")
        for part in (*self.displays, *self.pictures):
            kind = "display" if isinstance(part, Display) else "picture"
            if part.mesh is not None:
                part.mesh.check(f"The {kind} '{part.name}'")
                part.mesh.check_uv(f"The {kind} '{part.name}'")
        if min(self.display.width, self.display.height) < 1:
            raise RigError(f"The display '{self.display.name}' has no pixels: set its resolution.")
