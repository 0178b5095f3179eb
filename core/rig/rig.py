"""The rig: viewers, elements, display and picture, as plain frozen data in metres and float64."""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from functools import cached_property
from itertools import combinations, product
from typing import Any

import numpy as np

from ..base.arrays import Bools, Floats, Ints, convert
from ..base.errors import RigError
from ..base.fingerprint import fingerprint
from ..base.messages import Message, as_message, quoted
from .catalogue import PLATES
from .dispersion import SRGB_PRIMARIES, WAVELENGTH, ConstantIndex, Index
from .joined_display import Section, check_displays, join, sections_of
from .mesh import FLAT_THICKNESS as FLAT
from .mesh import Mesh, SurfaceChoice
from .mirror_array import MOST_CROSSING_ERROR, MirrorArray
from .parts import (
    Blocker,
    Display,
    Film,
    Glass,
    HalfMirror,
    Lens,
    Mirror,
    Picture,
    PicturePlace,
    Plate,
    Polariser,
    Preference,
    Retroreflector,
    Screen,
    WavePlate,
)
from .pupil import check_pupil
from .roles import Part, Role
from .viewer import PERPENDICULAR, Projector, Viewer, check_own_images, check_together

__all__ = [
    "FLAT",
    "MOST_CROSSING_ERROR",
    "PERPENDICULAR",
    "PRESETS",
    "PRESET_SIDES",
    "ROLES",
    "WAVELENGTH",
    "Blocker",
    "Bools",
    "ConstantIndex",
    "Display",
    "Floats",
    "Glass",
    "HalfMirror",
    "Index",
    "Ints",
    "Lens",
    "Mesh",
    "Mirror",
    "MirrorArray",
    "Part",
    "Picture",
    "PicturePlace",
    "Plate",
    "Polariser",
    "Preference",
    "Projector",
    "Retroreflector",
    "Rig",
    "Role",
    "Screen",
    "SurfaceChoice",
    "Viewer",
    "WavePlate",
]


# names in scripts written for 0.1
PRESETS = {name: product.array for name, product in PLATES.items()}
PRESET_SIDES = {name: product.side for name, product in PLATES.items()}  # m


def _parts_of(role: Role) -> Any:
    """A field of the rig for parts of a role."""
    return field(default=(), metadata={"role": role})


def _set_role(label: str) -> Message:
    """The remedy for a rig without a part of a role."""
    return Message("set the role of an object to {role}", role=as_message(label))


@dataclass(frozen=True, eq=False)
class Rig:
    """All parts on the bench; its fields form the table of roles.

    `check` reports why it cannot be solved. The fields without a name here hold mirrors, lenses,
    films, screens and projectors, whose classes may change between versions.

    Attributes
    ----------
    viewers : one or more; with several, errors and the seen image are those of the first
    glasses : none or more
    plates : none or more
    displays : one or more, whose source images lie in one array
    pictures : one; a bare `PicturePlace` if nothing is painted
    """

    # fmt: off
    viewers: tuple[Viewer, ...] = _parts_of(Role(
        "VIEWER", Message("Viewer"), remedy=Message("add a camera and make it the viewer"),
        may_be_off=True,
    ))
    glasses: tuple[Glass, ...] = _parts_of(Role(
        "GLASS", Message("Glass"), kind=0, number=1, icon="MATSPHERE",
        tip="Closed surfaces that refract light; an inner one is a cavity",
        is_missed=True, is_curved=True, may_be_off=True,
    ))
    plates: tuple[Plate, ...] = _parts_of(Role(
        "PLATE", Message("Plate"), kind=1, number=2, icon="MESH_GRID",
        tip="Flat imaging plate: sends light to the mirror image of its origin",
        is_missed=True, may_be_off=True,
    ))
    displays: tuple[Display, ...] = _parts_of(Role(
        "DISPLAY", Message("Display"), kind=4, number=4, icon="RESTRICT_VIEW_OFF",
        tip="Shows the source image on its front, by its UV map",
        remedy=_set_role("Display"),
        is_made=True, is_mapped=True, may_be_off=True,
    ))
    pictures: tuple[Picture | PicturePlace, ...] = _parts_of(Role(
        "PICTURE", Message("Picture"), number=5, icon="IMAGE_DATA",
        tip="Textured plane to be seen undistorted by the viewer",
        remedy=Message("choose an image, or set the role of a textured plane to Picture"),
        is_single=True, is_made=True, is_mapped=True,
    ))
    mirrors: tuple[Mirror, ...] = _parts_of(Role(
        "MIRROR", Message("Mirror"), kind=2, number=3, icon="MOD_MIRROR",
        tip="Reflects light on both sides", is_curved=True,
    ))
    blockers: tuple[Blocker, ...] = _parts_of(Role(
        "BLOCKER", Message("Blocker"), kind=3, number=6, icon="CANCEL", tip="Stops light",
    ))
    screens: tuple[Screen, ...] = _parts_of(Role(
        "SCREEN", Message("Screen"), number=10, icon="MOD_UVPROJECT",
        tip="Shows the light of projectors on its front, from either side; needs a UV map",
        is_mapped=True,
    ))
    projectors: tuple[Projector, ...] = _parts_of(Role(
        "PROJECTOR", Message("Projector"), number=11, icon="LIGHT_SPOT",
        tip="A camera whose image is projected on the screens",
    ))
    half_mirrors: tuple[HalfMirror, ...] = _parts_of(Role(
        "HALF_MIRROR", Message("Half Mirror"), kind=5, number=7, icon="MOD_MASK",
        tip="Thin surface that reflects some of the light and lets the rest through",
        is_curved=True,
    ))
    retroreflectors: tuple[Retroreflector, ...] = _parts_of(Role(
        "RETROREFLECTOR", Message("Retroreflector"), kind=6, number=8, icon="LOOP_BACK",
        tip="Returns light to where it came from",
    ))
    lenses: tuple[Lens, ...] = _parts_of(Role(
        "LENS", Message("Lens"), kind=7, number=9, icon="PROP_CON",
        tip="Flat thin lens or Fresnel lens with a focal length",
    ))
    polarisers: tuple[Polariser, ...] = _parts_of(Role(
        "POLARISER", Message("Polariser"), kind=8, number=12, icon="ALIGN_JUSTIFY",
        tip="Flat sheet that lets linearly polarised light through", is_mapped=True,
    ))
    wave_plates: tuple[WavePlate, ...] = _parts_of(Role(
        "WAVE_PLATE", Message("Wave Plate"), kind=9, number=13, icon="FORCE_HARMONIC",
        tip="Flat film that changes the polarisation of light, such as a quarter-wave film",
        is_mapped=True,
    ))
    # fmt: on

    def __post_init__(self) -> None:
        convert(self, tuple, *(f.name for f in fields(self)))

    @property
    def viewer(self) -> Viewer:
        """The first viewer, for scripts with one; core passes viewers explicitly."""
        return self.viewers[0]

    @cached_property
    def display(self) -> Display:
        """The display; several, and screens, count as one."""
        return join(self.lit)

    @property
    def lit(self) -> tuple[Display, ...]:
        """All displays, then all screens: light of the viewers ends on them."""
        return (*self.displays, *self.screens)

    @property
    def outputs(self) -> tuple[Display | Projector, ...]:
        """All parts with an image in a solution: displays, screens and projectors."""
        return (*self.lit, *self.projectors)

    @property
    def files(self) -> tuple[Section, ...]:
        """The sections of a solution's image that become files: all except those of screens.

        A single one has no name.
        """
        if len(self.outputs) == 1:
            return sections_of([replace(self.display, name="")])
        sections = zip(sections_of(self.outputs), self.outputs, strict=True)
        return tuple(section for section, part in sections if not isinstance(part, Screen))

    @cached_property
    def joined(self) -> "Rig":
        """The rig as traced: with one display, and no screens or projectors."""
        if self.displays == (self.display,) and not self.projectors:
            return self
        return replace(self, displays=(self.display,), screens=(), projectors=())

    @property
    def picture(self) -> Picture:
        picture = self.pictures[0]
        if isinstance(picture, PicturePlace):
            raise RigError("The picture has no pixels: choose an image.")
        return picture

    @property
    def picture_place(self) -> PicturePlace:
        return self.pictures[0].place

    @property
    def has_own_images(self) -> bool:
        """Whether each viewer sees its own image."""
        return any(isinstance(picture, Picture) and picture.own for picture in self.pictures)

    def picture_of(self, viewer: Viewer) -> Picture:
        """The picture for a viewer; raises as `picture` does."""
        return self.picture.seen_by(viewer.name)

    def place_of(self, viewer: Viewer) -> PicturePlace:
        """The place of the picture for a viewer."""
        return self.pictures[0].seen_by(viewer.name).place

    def of(self, role: Role) -> tuple[Any, ...]:
        """The parts of a role."""
        return getattr(self, role.field)

    def parts(self) -> Iterator[tuple[Role, Any]]:
        """All parts, each with its role, in the order of the table."""
        for role in ROLES:
            for part in self.of(role):
                yield role, part

    @cached_property
    def light_keys(self) -> tuple[str, ...]:
        """For each viewer, a cached key of everything its light meets.

        The key ignores other viewers, projectors, weights, pupils and the picture.
        """
        # meshes are large, and their hashes cached
        met = {
            role.field: tuple(replace(part, mesh=part.mesh.fingerprint) for part in self.of(role))
            for role in ROLES
            if role.kind is not None or role.name == "SCREEN"
        }
        # landings do not depend on the black level, nor at one wavelength on the primaries
        for name in ("displays", "screens"):
            met[name] = tuple(
                replace(one, black_level=0.0, primaries=SRGB_PRIMARIES) for one in met[name]
            )
        of_all = fingerprint(replace(self, viewers=(), pictures=(), projectors=(), **met))
        return tuple(fingerprint(of_all, replace(one.pinhole, weight=1.0)) for one in self.viewers)

    @property
    def disperses(self) -> bool:
        """Whether an index of refraction differs between the primaries of the display."""
        primaries = self.display.primaries
        return any(len({glass.ior.at(one) for one in primaries}) > 1 for glass in self.glasses)

    @property
    def is_tinted(self) -> bool:
        """Whether a glass absorbs colours differently."""
        return any(len(set(glass.absorption)) > 1 for glass in self.glasses)

    def in_one_colour(self, wavelength: float) -> "Rig":
        """The rig with light of one wavelength, m, on all displays and screens."""
        lit = {
            name: tuple(replace(one, primaries=(wavelength,) * 3) for one in getattr(self, name))
            for name in ("displays", "screens")
        }
        return replace(self, **lit)

    def curved_parts(self) -> tuple[Any, ...]:
        """The parts that may be curved: all glasses, then all mirrors."""
        return tuple(part for role, part in self.parts() if role.is_curved)

    def check(self) -> None:
        """Raise RigError or MeshError, in one sentence, if the rig cannot be solved."""
        self._check_number_of_parts()

        for role, part in self.parts():
            part.check_numbers(owner(role, part))

        for role in MET_ROLES:
            for part in self.of(role):
                part.mesh.check(owner(role, part))

        for role, part in self.parts():
            part.check_shape(owner(role, part))

        check_displays(self.lit)
        self._check_half_mirrors()
        self._check_edge_on()
        check_together(self.viewers, self.plates, bool(self.mirrors))
        if self.has_own_images:
            check_own_images(self.viewers, self.picture)
        for viewer in (one for one in self.viewers if one.pupil):
            meshes = [part.mesh for role in MET_ROLES for part in self.of(role)]
            check_pupil(viewer, self.place_of(viewer), meshes)

    def _check_half_mirrors(self) -> None:
        """Raise RigError for two flat half mirrors face to face: light between them has no end."""
        flat = [one for one in self.half_mirrors if one.mesh.is_flat]
        for one, other in combinations(flat, 2):
            if _face_each_other(one.mesh, other.mesh):
                raise RigError(
                    "The half mirrors '{one}' and '{other}' face each other: tilt one of them.",
                    one=one.name,
                    other=other.name,
                )

    @cached_property
    def is_polarised(self) -> bool:
        """Whether light depends on its polarisation."""
        return any(part.polarises for _, part in self.parts())

    def _check_edge_on(self) -> None:
        """Raise RigError for a viewer in the plane of a polariser or a wave plate, whose axis it
        cannot see.
        """
        films = ((role, one) for role, one in self.parts() if isinstance(one, Film))
        for (role, one), viewer in product(films, self.viewers):
            corners = one.mesh.corners[0]
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            sight = viewer.axes[2]
            if viewer.projection == "perspective":
                sight = one.mesh.bounds.mean(axis=0) - viewer.position
            if abs(sight @ normal) < EDGE_ON_SINE * np.linalg.norm(sight) * np.linalg.norm(normal):
                raise RigError(
                    "{owner} is edge-on to the viewer '{viewer}': turn one of them.",
                    owner=owner(role, one),
                    viewer=viewer.name,
                )

    def _check_number_of_parts(self) -> None:
        """Raise RigError for a role with no part, or with too many."""
        viewer, *others = ROLES
        in_order = (*others, viewer)

        for role in in_order:
            found = self.lit if role.name == "DISPLAY" else self.of(role)
            if role.remedy and not found:
                raise RigError(
                    "The rig has no {noun}: {remedy}.", noun=role.noun, remedy=role.remedy
                )

        for role in in_order:
            found = self.of(role)
            if role.is_single and len(found) > 1:
                names = quoted(part.name for part in found)
                raise RigError(
                    "The rig has {n} {field} ({names}): keep one and set the others to None.",
                    n=len(found),
                    field=as_message(role.field),
                    names=names,
                )

        if self.screens and not self.projectors:
            raise RigError("The rig has screens but no projector: make a camera a projector.")
        if self.projectors and not self.screens:
            raise RigError(
                "The rig has projectors but no screen: set the role of a surface to Screen."
            )


# in the order of the rig's fields
ROLES = tuple(replace(f.metadata["role"], field=f.name) for f in fields(Rig))

# roles of parts that light meets, by the number of their interaction
MET_ROLES = tuple(
    sorted((role for role in ROLES if role.kind is not None), key=lambda role: role.kind)
)

# numbers of the interactions
Kind = IntEnum("Kind", [(role.name, role.kind) for role in MET_ROLES])


MOST_PARALLEL = np.cos(np.radians(1.0))
EDGE_ON_SINE = np.sin(np.radians(0.1))


def _face_each_other(one: Mesh, other: Mesh) -> bool:
    """Whether two flat meshes are parallel, and overlap along their normal."""
    shifted = [m.vertices - m.vertices.mean(axis=0) for m in (one, other)]
    frames = [np.linalg.svd(places, full_matrices=False)[2] for places in shifted]
    if abs(frames[0][2] @ frames[1][2]) < MOST_PARALLEL:
        return False
    a, b = (m.vertices @ frames[0][:2].T for m in (one, other))
    return bool(((a.min(axis=0) < b.max(axis=0)) & (b.min(axis=0) < a.max(axis=0))).all())


def owner(role: Role, part: Part) -> Message:
    """A part as the subject of a sentence."""
    return Message("The {role} '{name}'", role=role.noun, name=part.name)
