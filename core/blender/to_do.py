"""The nouns of the checklist: a look at a scene, and the entries that come of it."""

from dataclasses import dataclass, field
from typing import NamedTuple

from ..bench.measured_remedies import Help

PROBLEM, ADVICE = "ERROR", "INFO"  # as Blender's icons are called
SOLVE = "kiriko.solve"


class Named(NamedTuple):
    """An object by its name, and the file it is linked from, '' for none."""

    name: str
    library: str = ""


class Counts(NamedTuple):
    """How many faults a mesh has, and whether its faces look inwards.

    n_cut : polygons that others cut, so that nothing tells the inside
    n_facets : polygons that look flat where a curve seems meant
    is_vessel : is a hole of it as wide as the mouth of a vessel?
    is_cut_curved : are any of the polygons that others cut shaded smooth?
    n_double : polygons that lie on others
    is_one_sided : has a closed part of it one side only?
    n_turned : polygons that look the other way than those beside them
    is_turned_smooth : has one of these normals other than its plane's?
    n_inner : polygons within the body that the others make
    n_loose : vertices that another one in the same place stands for
    """

    n_open: int = 0
    n_flat: int = 0
    is_inside_out: bool = False
    n_cut: int = 0
    n_facets: int = 0
    is_vessel: bool = False
    is_cut_curved: bool = False
    n_double: int = 0
    is_one_sided: bool = False
    n_turned: int = 0
    is_turned_smooth: bool = False
    n_inner: int = 0
    n_loose: int = 0


@dataclass(frozen=True)
class Button:
    """An operator, the words on its button, and the values of its properties."""

    operator: str
    label: str
    properties: tuple[tuple[str, object], ...] = ()
    icon: str = "NONE"


@dataclass(frozen=True)
class Entry:
    """One thing to do.

    icon : PROBLEM where light is lost or nothing can be solved, ADVICE else
    can_wait : is it known only by a look at a mesh, or by a result, and of use after Solve, too?
    """

    text: str
    icon: str = PROBLEM
    buttons: tuple[Button, ...] = ()
    can_wait: bool = False

    @property
    def asks_to_solve(self) -> bool:
        """Is Solve what it asks for?"""
        return any(button.operator == SOLVE for button in self.buttons)


def is_first(entry: Entry) -> bool:
    """Does an entry stand above Solve?"""
    return not (entry.can_wait or entry.asks_to_solve)


@dataclass(frozen=True)
class Thing:
    """An object with a role, as far as a list of faults needs it.

    hidden_by : to follow "is hidden"; '' where it is shown
    width : m, the longest side of its box
    is_mesh : and no curve, surface or text, whose mesh Blender makes
    thin_walls : sentences on materials of opaque glass that let light straight through
    faults : of its mesh as it is read; None where not known yet, or of no interest
    own_faults : of its mesh before modifiers, which can be edited
    n_indices : indices of refraction of the materials of glass; 0 where not known yet
    has_no_place : are numbers of its matrix none, or too large?
    is_empty : is it known to have no face?
    has_facets : are facets wanted of it, by its setting Surface?
    has_ends : is it a bevelled curve whose ends are open?
    has_place : can it be given a material in this file?
    shows_opaque : does it show a collection, none of whose objects refracts?
    """

    named: Named
    role: str
    hidden_by: str = ""
    width: float = 0.0
    is_mesh: bool = True
    is_opaque: bool = False
    thin_walls: tuple[str, ...] = ()
    has_place: bool = True
    n_indices: int = 0
    has_no_scale: bool = False
    has_no_place: bool = False
    is_empty: bool = False
    is_flat: bool = False
    is_pictureless: str = ""
    faults: Counts | None = None
    own_faults: Counts | None = None
    has_facets: bool = False
    has_ends: bool = False
    shows_opaque: bool = False


@dataclass(frozen=True)
class Look:
    """A scene as far as its checklist needs it.

    missing : phrases on the roles that a rig needs and has not, by role
    has_rig : has the scene a rig of Add Rig?
    has_own_camera : is there one that was made for that rig?
    cameras : names of the scene's cameras, those made for the rig first
    free_cameras : those that are no viewers
    empty_seats : numbers of entries of the list of viewers that are on and whose camera is gone,
        with its name, '' where there was none
    are_viewers_off : all of the list?
    refused : sentences on viewers where none can be, as within the glass, and their names
    no_parts : sentences on objects that have a role and can be no part, and their names
    solids : objects without a role that may be glass, the active one first
    in_glass : objects without a role that refract, and stand within the glass
    images : names of images that may be the picture
    tiled : names of images of several tiles that are the picture
    lost : sentences on data that is missing from a library, and that library's name
    misses : shares of the picture by the reason why they are lost, of the last result
    misses_of_others : the same for each viewer but the one that is shown, by name
    helps : remedies that were found for them, the most helpful first; None where none were sought
    legibility : of the picture, 0..1, by the last result; None if it is not known
    legible_by : remedies that were found to raise it, the most helpful first
    lacks_numbers : is the source image final, without its numbers?
    is_doubled : are there copies of a rig's display and picture beside them?
    for_most : m, the longest side of a new rig's display for most of its light; 0: not known
    is_followed : does Live follow the scene, so that the final image comes by itself?
    """

    things: tuple[Thing, ...] = ()
    missing: tuple[tuple[str, str], ...] = ()
    has_rig: bool = False
    has_own_camera: bool = False
    cameras: tuple[str, ...] = ()
    free_cameras: tuple[str, ...] = ()
    empty_seats: tuple[tuple[int, str], ...] = ()
    are_viewers_off: bool = False
    refused: tuple[tuple[str, Named], ...] = ()
    no_parts: tuple[tuple[str, Named], ...] = ()
    solids: tuple[Named, ...] = ()
    in_glass: tuple[Named, ...] = ()
    images: tuple[str, ...] = ()
    tiled: tuple[str, ...] = ()
    lost: tuple[tuple[str, str], ...] = ()
    misses: dict[str, float] = field(default_factory=dict)
    misses_of_others: dict[str, dict[str, float]] = field(default_factory=dict)
    helps: tuple[Help, ...] | None = None
    legibility: float | None = None
    legible_by: tuple[Help, ...] = ()
    is_doubled: bool = False
    is_coarse: bool = False
    lacks_numbers: bool = False
    is_stale: bool = False
    is_solved: bool = False
    for_most: float = 0.0
    is_followed: bool = False
