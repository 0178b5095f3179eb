"""The parts of a rig that have a mesh, each with the reasons why it cannot be one."""

from dataclasses import dataclass, field, is_dataclass

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.errors import MeshError, RigError
from .mesh import Mesh
from .mirror_array import MirrorArray
from .roles import Part

WAVELENGTH = 587.6e-9  # m, the helium d line, at which indices of refraction are given


class Index:
    """An index of refraction as data: a frozen dataclass with the numbers of a formula.

    A function has no content to compare, so that nothing tells whether it is still the same.
    """

    def at(self, wavelength: float) -> float:
        """Index of refraction at a wavelength in metres."""
        raise NotImplementedError

    def __call__(self, wavelength: float) -> float:
        """The same, as scripts of 0.1 ask for it."""
        return self.at(wavelength)


@dataclass(frozen=True)
class ConstantIndex(Index):
    """An index of refraction that does not depend on the wavelength."""

    value: float

    def at(self, wavelength: float) -> float:
        """Index of refraction at any wavelength."""
        return self.value


@dataclass(frozen=True, eq=False)
class Glass(Part):
    """A glass object as drawn: one or more closed shells. Shells inside shells are cavities (air).

    `priority` decides where solids overlap: higher wins; among equals the smaller solid does.
    """

    name: str
    mesh: Mesh
    ior: Index = field(default_factory=lambda: ConstantIndex(1.49))
    priority: int = 0

    def check_numbers(self, owner: str) -> None:
        """Raise RigError when its index of refraction is no data, or no number above 0."""
        if not (isinstance(self.ior, Index) and is_dataclass(self.ior)):
            raise RigError(
                "{owner} has an index of refraction that is no Index: give it one such as"
                " ConstantIndex(1.49).",
                owner=owner,
            )

        n = self.ior.at(WAVELENGTH)
        if not (np.isfinite(n) and n > 0):
            raise RigError(
                "{owner} has an index of refraction that is no number above 0: set one.",
                owner=owner,
            )

    def check_shape(self, owner: str) -> None:
        """Raise MeshError when it encloses nothing."""
        if self.mesh.is_flat:
            raise MeshError(
                "{owner} is no closed body, but flat: give it a thickness, as by a Solidify"
                " modifier, or set its role to None.",
                owner=owner,
            )


@dataclass(frozen=True, eq=False)
class Plate(Part):
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

    def check_shape(self, owner: str) -> None:
        """Raise RigError when it has mirrors that cannot be made."""
        if self.array is not None:
            self.array.check(owner)


@dataclass(frozen=True, eq=False)
class Mirror(Part):
    """A surface that reflects on both sides."""

    name: str
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class Blocker(Part):
    """A surface that stops light."""

    name: str
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class Display(Part):
    """A surface with a UV map that shows the source image on its front; (width, height)
    in pixels.

    black_level : share of white's light that a black pixel shines all the same, 0 up to below 1
    """

    name: str
    mesh: Mesh
    width: int
    height: int
    black_level: float = 0.0

    def check_numbers(self, owner: str) -> None:
        """Raise RigError when its black is no darker than its white."""
        if not 0 <= self.black_level < 1:
            raise RigError(
                "{owner} has a black level of {black_level:g}: set one from 0 to below 1.",
                owner=owner,
                black_level=self.black_level,
            )

    def place(self, uv: Floats) -> Floats:
        """Places (n, 2) of its image, px right and down from the top left corner, at UV (n, 2)."""
        u, v = uv.T
        return np.stack([u * self.width, (1 - v) * self.height], axis=1)

    def pixel(self, place: Floats, directions: Floats) -> Floats:
        """Where rays land: the px (n, 2) of the source image that light shows which leaves places
        (n, 2) px against directions of rays (n, 3). Each place looks the same from everywhere.
        """
        return place

    def light_of(self, source: NDArray[np.float32]) -> NDArray[np.float32]:
        """The light of its pixels, white being 1, where it shows a source image, linear."""
        if self.black_level == 0:
            return source
        return self.black_level + (1 - self.black_level) * source

    def nearest(self, light: NDArray[np.float32]) -> NDArray[np.float32]:
        """The light that its pixels can have nearest to what is wanted, white being 1 or more."""
        return light if self.black_level == 0 else np.maximum(light, self.black_level)

    def source_for(self, light: NDArray[np.float32]) -> NDArray[np.float32]:
        """The source image, linear, whose pixels shine as is wanted, or the least they can.

        What is wanted of a pixel is least squares, so that the nearest that it can show is best.
        """
        if self.black_level == 0:
            return light
        return (self.nearest(light) - self.black_level) / (1 - self.black_level)

    def check_shape(self, owner: str) -> None:
        """Raise MeshError or RigError when no image can be put on it."""
        self.mesh.check_uv(owner)
        if min(self.width, self.height) < 1:
            raise RigError("{owner} has no pixels: set its resolution.", owner=owner)


@dataclass(frozen=True, eq=False)
class PicturePlace(Part):
    """Where the image stands that the viewer should see, and how many pixels it has.

    Outline, cover, shares and strokes need no more of a picture: its colours may follow later, and
    change from frame to frame.

    Parameters
    ----------
    width, height : of the image, pixels
    mesh : the textured plane (with UV), or None when the image is in the viewer's own pixels
    """

    name: str
    width: int
    height: int
    mesh: Mesh | None = None

    @property
    def place(self) -> "PicturePlace":
        """Itself, as a picture has it."""
        return self

    @property
    def n_pixels(self) -> int:
        """Of its image."""
        return self.width * self.height

    def seen_by(self, viewer: str) -> "PicturePlace":
        """Itself, whoever looks at it."""
        return self

    def showing(self, image: NDArray[np.float32]) -> "Picture":
        """The picture of an image (h, w, 4) in this place."""
        return Picture(self.name, image, self.mesh)

    def check_still(self) -> None:
        """Raise RigError where it goes with the viewer, who is to look at it from elsewhere."""
        if self.mesh is None:
            raise RigError(
                "The picture is in the viewer's own pixels and moves with it: choose a picture"
                " plane."
            )

    def check_shape(self, owner: str) -> None:
        """Raise MeshError when its plane has no place for an image."""
        _check_plane(self.mesh, owner)


@dataclass(frozen=True, eq=False)
class OwnImage:
    """The image that one of several viewers should see, in that viewer's own pixels.

    name : of the viewer
    image : (h, w, 4) float32, as that of a picture
    """

    name: str
    image: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Picture(Part):
    """The image that the viewer should see, in its place.

    Parameters
    ----------
    image : (h, w, 4) float32, linear, premultiplied by alpha, row 0 at the top
    mesh : the textured plane (with UV), or None when the image is in the viewer's own pixels
    own : in place of the image one for each viewer, where they are in the viewers' own pixels
    """

    name: str
    image: NDArray[np.float32]
    mesh: Mesh | None = None
    own: tuple[OwnImage, ...] = ()

    @property
    def place(self) -> PicturePlace:
        """All but the colours."""
        height, width = self.image.shape[:2]
        return PicturePlace(self.name, width, height, self.mesh)

    @property
    def images(self) -> tuple[NDArray[np.float32], ...]:
        """All that viewers should see."""
        return tuple(one.image for one in self.own) or (self.image,)

    @property
    def n_pixels(self) -> int:
        """Of all its images; one that several viewers see counts once."""
        different = {id(image): image for image in self.images}.values()
        return sum(image.shape[0] * image.shape[1] for image in different)

    def seen_by(self, viewer: str) -> "Picture":
        """The picture as the viewer of a name should see it."""
        if not self.own:
            return self
        by_viewer = {one.name: one.image for one in self.own}
        return Picture(self.name, by_viewer.get(viewer, self.image))

    def check_shape(self, owner: str) -> None:
        """Raise MeshError when its plane has no place for an image."""
        _check_plane(self.mesh, owner)


def _check_plane(mesh: Mesh | None, owner: str) -> None:
    """Raise MeshError when a picture's plane, if it has one, has no place for an image."""
    if mesh is not None:
        mesh.check(owner)
        mesh.check_uv(owner)
