"""The parts of a rig with a mesh, and their validity checks."""

from dataclasses import dataclass, is_dataclass
from functools import partial
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, convert
from ..base.errors import MeshError, RigError, check_choice, not_finite, out_of_range
from .dispersion import (
    SRGB_PRIMARIES,
    VISIBLE,
    WAVELENGTH,
    ConstantIndex,
    Index,
    Primaries,
)
from .mesh import Mesh
from .mirror_array import MirrorArray
from .roles import Part
from .views import Size, Views

MOST_BLACK_LEVEL = 0.99  # of the interface


CLEAR = 0.0, 0.0, 0.0
MOST_SPREAD = np.radians(10.0)  # of the interface
SHARE_ROUNDING = 1e-6  # Blender stores float32

# the path of the picture, if both paths of split light reach the display
Preference = Literal["brighter", "reflected", "transmitted"]


@dataclass(frozen=True, eq=False)
class Glass(Part):
    """A glass object: one or more closed shells. Shells inside shells are cavities (air).

    Parameters
    ----------
    name : in messages
    mesh : its shells
    ior : index of refraction: a number, 1.49, or a formula of the wavelength
    priority : decides between overlapping solids: higher wins; among equals the smaller solid does
    reflects : its faces split light by Fresnel's equations, so a reflection may carry the picture
    prefers : path of the picture if light arrives by both
    absorption : 1/m, of red, green and blue light, by Beer and Lambert's law, 0 for each; it
        counts with `brightness`
    """

    name: str
    mesh: Mesh
    ior: Index | float = 1.49
    priority: int = 0
    reflects: bool = False
    prefers: Preference = "brighter"
    absorption: tuple[float, float, float] = CLEAR

    def __post_init__(self) -> None:
        if isinstance(self.ior, Real):
            object.__setattr__(self, "ior", ConstantIndex(float(self.ior)))

    @property
    def splits(self) -> bool:
        """Whether light continues on two paths."""
        return self.reflects

    def check_numbers(self, owner: str) -> None:
        """Raise RigError unless its index of refraction is data, and a number above 0."""
        if not (isinstance(self.ior, Index) and is_dataclass(self.ior)):
            raise RigError(
                "{owner} has an index of refraction of the wrong type: use a number, such as 1.49.",
                owner=owner,
            )

        self.ior.check(owner)
        for value in self.absorption:
            if not (np.isfinite(value) and value >= 0):
                raise RigError(
                    "{owner} has Absorption {value:g} per m: set it to 0 or more.",
                    owner=owner,
                    value=value,
                )
        n = self.ior.at(WAVELENGTH)
        if not (np.isfinite(n) and n > 0):
            raise out_of_range(owner, "IOR", n, 0)
        check_choice(owner, "prefers", self.prefers, Preference)

    def check_shape(self, owner: str) -> None:
        """Raise MeshError if it encloses nothing."""
        if self.mesh.is_flat:
            raise MeshError(
                "{owner} is flat: add a Solidify modifier.",
                owner=owner,
            )


@dataclass(frozen=True, eq=False)
class Plate(Part):
    """A flat plane-symmetric imaging element; its triangles give plane and outline.

    Parameters
    ----------
    name : in messages
    mesh : its plane and outline
    array : its mirrors; None for the ideal plate
    side : (3,) world, along a side, at 45 degrees to the mirrors; None: its first face's first edge
    centre : (3,) m, world, origin of the mirrors' phase; None: the middle of its extent
    """

    name: str
    mesh: Mesh
    array: MirrorArray | None = None
    side: Floats | None = None
    centre: Floats | None = None

    def check_shape(self, owner: str) -> None:
        """Raise RigError if its mirrors are impossible."""
        if self.array is not None:
            self.array.check(owner)


@dataclass(frozen=True, eq=False)
class Mirror(Part):
    """A surface that reflects on both sides."""

    name: str
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class HalfMirror(Part):
    """A thin surface that reflects some of the light and lets the rest through, on both sides.

    reflectance, absorption : 0..1, with a sum of at most 1; the rest of the light is transmitted
    prefers : path of the picture if light arrives by both
    polarising : reflects s-polarised light and transmits p-polarised light, regardless of its
        reflectance
    """

    name: str
    mesh: Mesh
    reflectance: float = 0.5
    absorption: float = 0.0
    prefers: Preference = "brighter"
    polarising: bool = False

    splits = True

    @property
    def polarises(self) -> bool:
        """Whether it treats polarisations differently."""
        return self.polarising

    @property
    def amplitudes(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Amplitudes of reflected light, s and p, and of transmitted light."""
        r, t = np.sqrt((self.reflectance, self.transmittance))
        most = np.sqrt(1 - self.absorption)
        return ((-most, 0.0), (0.0, most)) if self.polarising else ((-r, r), (t, t))

    @property
    def transmittance(self) -> float:
        """Share of the light that passes straight."""
        return max(1 - self.reflectance - self.absorption, 0.0)

    def check_numbers(self, owner: str) -> None:
        """Raise RigError for impossible shares of light."""
        for label, value in ("Reflectance", self.reflectance), ("Absorption", self.absorption):
            if not 0 <= value <= 1:
                raise out_of_range(owner, label, value, 0, 1)
        if self.reflectance + self.absorption > 1 + SHARE_ROUNDING:
            raise RigError(
                "{owner} reflects and absorbs more light than it gets: lower its Reflectance or its"
                " Absorption.",
                owner=owner,
            )
        check_choice(owner, "prefers", self.prefers, Preference)


@dataclass(frozen=True, eq=False)
class Retroreflector(Part):
    """A surface that returns light along its path, on both sides, ideally; spread and pitch only
    count where light is simulated.

    spread : rad, standard deviation of the returned directions
    pitch : m, side of its corner cubes, each of which turns places by 180 degrees about its middle;
        0 for none
    """

    name: str
    mesh: Mesh
    spread: float = 0.0
    pitch: float = 0.0

    def check_numbers(self, owner: str) -> None:
        """Raise RigError for an impossible spread or pitch."""
        if not 0 <= self.spread <= MOST_SPREAD:
            degrees = np.degrees([self.spread, MOST_SPREAD])
            raise out_of_range(owner, "Spread", float(degrees[0]), 0, float(degrees[1]))
        if not (np.isfinite(self.pitch) and self.pitch >= 0):
            raise out_of_range(owner, "Pitch", f"{1e3 * self.pitch:g} mm", 0)


@dataclass(frozen=True, eq=False)
class Lens(Part):
    """A flat thin lens, or Fresnel lens: paraxial at every angle.

    Its axis is the normal through the centroid of its outline.

    focal_length : m; below 0 for a diverging lens
    """

    name: str
    mesh: Mesh
    focal_length: float

    def check_numbers(self, owner: str) -> None:
        """Raise RigError for a focal length of 0 or none."""
        if not (np.isfinite(self.focal_length) and self.focal_length):
            raise RigError(
                "{owner} has a focal length of {value}: set another one.",
                owner=owner,
                value=f"{self.focal_length:g}",
            )


@dataclass(frozen=True, eq=False)
class Film(Part):
    """A flat thin part that polarises light.

    angle : rad, of its axis, counterclockwise from the u axis of its UV map, or else from the first
        edge of its mesh, seen from the front
    """

    name: str
    mesh: Mesh
    angle: float = 0.0

    polarises = True
    crossed = 0.0  # rad, from this axis to the extraordinary one

    @property
    def amplitudes(self) -> tuple[complex, complex]:
        """Amplitudes of light perpendicular to the extraordinary axis, and along it."""
        raise NotImplementedError

    def check_numbers(self, owner: str) -> None:
        """Raise RigError for a number that is not finite."""
        if not np.isfinite([self.angle, *self.amplitudes]).all():
            raise not_finite(owner)


@dataclass(frozen=True, eq=False)
class Polariser(Film):
    """A sheet that transmits light polarised along its axis.

    extinction : share of the other polarisation that passes, 0..1
    """

    extinction: float = 0.0

    crossed = np.pi / 2

    @property
    def amplitudes(self) -> tuple[complex, complex]:
        return 1.0, self.extinction**0.5

    def check_numbers(self, owner: str) -> None:
        """Raise RigError for a number out of bounds."""
        super().check_numbers(owner)
        if not 0 <= self.extinction <= 1:
            raise out_of_range(owner, "Extinction", self.extinction, 0, 1)


@dataclass(frozen=True, eq=False)
class WavePlate(Film):
    """A film that delays light polarised across its fast axis, the same at every incidence.

    retardance : in waves; 0.25 turns linear light at 45 degrees to the axis into circular light
    """

    retardance: float = 0.25

    @property
    def amplitudes(self) -> tuple[complex, complex]:
        return np.exp(2j * np.pi * self.retardance), 1.0


@dataclass(frozen=True, eq=False)
class Blocker(Part):
    """A surface that stops light."""

    name: str
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class Display(Part):
    """A surface with a UV map that shows the source image on its front.

    Parameters
    ----------
    name : in messages
    mesh : its surface, with UV; counterclockwise triangles face the glass
    width, height : pixels
    black_level : light of a black pixel relative to white, 0 up to below 1
    polarised : rad, angle of its light's linear polarisation, as for a polariser; None if it is
        not polarised
    primaries : m, dominant wavelengths of its red, green and blue; those of sRGB
    views : images by direction, each of width x height pixels; None for one in all directions
    """

    name: str
    mesh: Mesh
    width: int
    height: int
    black_level: float = 0.0
    polarised: float | None = None
    primaries: Primaries = SRGB_PRIMARIES
    views: Views | None = None

    def __post_init__(self) -> None:
        convert(self, int, "width", "height")

    @property
    def size(self) -> Size:
        """Width and height of a view, px."""
        return self.width, self.height

    @property
    def image_size(self) -> Size:
        """Width and height of its source image, px: of the quilt if it has views."""
        return self.size if self.views is None else self.views.quilt_size(self.size)

    @property
    def polarises(self) -> bool:
        """Whether the light of any of its displays is polarised."""
        return any(one.polarised is not None for one in self.parts)

    def check_numbers(self, owner: str) -> None:
        """Raise RigError if its black is not darker than its white."""
        if not 0 <= self.black_level < 1:
            raise out_of_range(owner, "Black Level", self.black_level, 0, MOST_BLACK_LEVEL)
        if self.polarised is not None and not np.isfinite(self.polarised):
            raise not_finite(owner)
        for wavelength in self.primaries:
            if not VISIBLE[0] <= wavelength <= VISIBLE[1]:
                least, most = (1e9 * end for end in VISIBLE)
                raise out_of_range(owner, "Primaries", 1e9 * wavelength, least, most)
        if self.views is not None:
            self.views.check(owner)

    def place(self, uv: Floats) -> Floats:
        """Places (n, 2) of its image, px right and down from the top left corner, at UV (n, 2)."""
        u, v = uv.T
        return np.stack([u * self.width, (1 - v) * self.height], axis=1)

    @property
    def parts(self) -> tuple["Display", ...]:
        """Its displays: only itself."""
        return (self,)

    def black_in(self, image: Floats) -> float | Floats:
        """Black level of the pixels of an image, which broadcasts to it."""
        return self.black_level

    def light_of(self, source: NDArray[np.float32]) -> NDArray[np.float32]:
        """The light of its pixels for a linear source image, relative to white."""
        if self.black_level == 0:
            return source
        black = self.black_in(source)
        return black + (1 - black) * source

    def nearest(self, light: NDArray[np.float32]) -> NDArray[np.float32]:
        """The achievable light closest to the wanted light, relative to white."""
        return light if self.black_level == 0 else np.maximum(light, self.black_in(light))

    def source_for(self, light: NDArray[np.float32]) -> NDArray[np.float32]:
        """The linear source image for the wanted light, limited by the black level.

        Wanted light is a least-squares solution, so the closest achievable light is optimal.
        """
        if self.black_level == 0:
            return light
        black = self.black_in(light)
        return (self.nearest(light) - black) / (1 - black)

    def check_shape(self, owner: str) -> None:
        """Raise MeshError or RigError if it cannot show an image."""
        self.mesh.check_uv(owner)
        if min(self.width, self.height) < 1:
            raise RigError("{owner} has no pixels: set its resolution.", owner=owner)


@dataclass(frozen=True, eq=False)
class Screen(Display):
    """A surface with a UV map that projectors shine on, from either side; its front shows their
    light.

    width, height : of its image, which no file shows: the resolution of the projected light
    """


@dataclass(frozen=True, eq=False)
class PicturePlace(Part):
    """The place of the image the viewer should see, and its resolution.

    Outline, cover, shares and filter taps need only this. The colours can follow later, and change
    from frame to frame.

    Parameters
    ----------
    width, height : of the image, pixels
    mesh : the textured plane (with UV), or None for an image in the viewer's own pixels
    mask : (height, width) fraction of each viewer pixel that belongs to the picture, 0..1; None for
        the whole image
    """

    name: str
    width: int
    height: int
    mesh: Mesh | None = None
    mask: Floats | None = None

    @property
    def place(self) -> "PicturePlace":
        """Itself, for the interface of `Picture`."""
        return self

    @property
    def n_pixels(self) -> int:
        """Pixels of its image."""
        return self.width * self.height

    def seen_by(self, viewer: str) -> "PicturePlace":
        """Itself for every viewer."""
        return self

    def showing(self, image: NDArray[np.float32]) -> "Picture":
        """The picture of an image (h, w, 4) in this place."""
        return Picture(self.name, image, self.mesh)

    def check_still(self) -> None:
        """Raise RigError if it moves with the viewer, who has to see it from elsewhere."""
        if self.mesh is None:
            raise RigError("The picture is an image in the viewer's pixels: use a picture plane.")

    def check_shape(self, owner: str) -> None:
        """Raise MeshError if its plane cannot hold an image."""
        _check_plane(self.mesh, owner)


@dataclass(frozen=True, eq=False)
class OwnImage:
    """The image that one of several viewers should see, in its own pixels.

    name : of the viewer
    image : (h, w, 4) float32, as for a picture
    mask : (h, w), as for a place
    """

    name: str
    image: NDArray[np.float32]
    mask: Floats | None = None


@dataclass(frozen=True, eq=False)
class Picture(Part):
    """The image that the viewer should see, in its place.

    Parameters
    ----------
    name : in messages
    image : (h, w, 4) float32, linear, premultiplied by alpha, row 0 at the top
    mesh : the textured plane (with UV), or None for an image in the viewer's own pixels
    own : instead of the image, one for each viewer, in their own pixels
    mask : (h, w) fraction of each viewer pixel that belongs to the picture, 0..1; None for the
        whole image
    """

    name: str
    image: NDArray[Any]
    mesh: Mesh | None = None
    own: tuple[OwnImage, ...] = ()
    mask: NDArray[Any] | None = None

    def __post_init__(self) -> None:
        kind = np.asarray(self.image).dtype
        if kind.kind in "iu":
            raise RigError(
                "The picture '{name}' has pixels of type {kind}: give it linear light as floats,"
                " with white as 1.",
                name=self.name,
                kind=kind,
            )
        convert(self, partial(np.asarray, dtype=np.float32), "image")

    @property
    def place(self) -> PicturePlace:
        """Everything except the colours."""
        height, width = self.image.shape[:2]
        return PicturePlace(self.name, width, height, self.mesh, self.mask)

    @property
    def images(self) -> tuple[NDArray[np.float32], ...]:
        """All images of the viewers."""
        return tuple(one.image for one in self.own) or (self.image,)

    @property
    def n_pixels(self) -> int:
        """Pixels of all its images; an image shared by several viewers counts once."""
        different = {id(image): image for image in self.images}.values()
        return sum(image.shape[0] * image.shape[1] for image in different)

    def seen_by(self, viewer: str) -> "Picture":
        """The picture for the viewer of a name."""
        if not self.own:
            return self
        own = next((one for one in self.own if one.name == viewer), OwnImage("", self.image))
        return Picture(self.name, own.image, mask=own.mask)

    def check_shape(self, owner: str) -> None:
        """Raise an error for an array unlike an image, or a plane that cannot hold one."""
        for image in self.images:
            if image.ndim != 3:
                raise RigError(
                    "{owner} has {name} of shape {found}: give it the shape {shape}.",
                    owner=owner,
                    name="image",
                    found=image.shape,
                    shape="(h, w, 4)",
                )
        _check_plane(self.mesh, owner)


def _check_plane(mesh: Mesh | None, owner: str) -> None:
    """Raise MeshError if a picture has a plane that cannot hold an image."""
    if mesh is not None:
        mesh.check(owner)
        mesh.check_uv(owner)
