"""The nouns of the checklist: what was found in a scene, and the entries that come of it."""

from dataclasses import dataclass, field
from typing import NamedTuple

from ...bench.measured_remedies import Help

PROBLEM, ADVICE = "ERROR", "INFO"  # as Blender's icons are called
SOLVE = "kiriko.solve"


class Named(NamedTuple):
    """An object by its name, and the file it is linked from, '' for none."""

    name: str
    library: str = ""


class FaultCounts(NamedTuple):
    """Faults of a mesh.

    n_faces : polygons in all
    n_open : edges of one face, or of more than two of one body
    n_turned : polygons that face the other way than most of those that they share vertices with
    is_turned_smooth : has one of these normals other than its plane's?
    is_inside_out : do the faces look into the body?
    n_inner : polygons within the body that the others make
    n_facets : polygons that look flat where a curve seems meant
    n_loose : vertices in the place of another one
    """

    n_faces: int = 0
    n_open: int = 0
    n_turned: int = 0
    is_turned_smooth: bool = False
    is_inside_out: bool = False
    n_inner: int = 0
    n_facets: int = 0
    n_loose: int = 0


NO_FAULTS = FaultCounts()


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
    """An object with a role, as far as the checklist needs it.

    hidden_by : to follow "is hidden"; '' where it is shown
    width : m, the longest side of its box
    is_mesh : and no curve, surface or text, whose mesh Blender makes
    is_opaque : does no material of glass refract?
    has_place : can it be given a material in this file?
    no_picture : a sentence on why a plane shows none
    faults : of its mesh as it is read; none where not known yet
    own_faults : of its mesh before modifiers, which can be edited
    has_facets : are facets wanted of it, by its setting Surface?
    """

    named: Named
    role: str
    hidden_by: str = ""
    width: float = 0.0
    is_mesh: bool = True
    is_opaque: bool = False
    has_place: bool = True
    has_no_scale: bool = False
    is_flat: bool = False
    no_picture: str = ""
    faults: FaultCounts = NO_FAULTS
    own_faults: FaultCounts = NO_FAULTS
    has_facets: bool = False


@dataclass(frozen=True)
class Inspection:
    """A scene as far as its checklist needs it.

    missing : phrases on the roles that a rig needs and has not, by role
    has_rig : has the scene a rig of Add Rig?
    has_own_camera : is there one that was made for that rig?
    cameras : names of the scene's cameras, those made for the rig first
    no_parts : sentences on objects that have a role and can be no part, and their names
    solids : objects without a role that may be glass, the active one first
    in_glass : objects without a role that refract, and stand within the glass
    enclosed : names of a viewer and of the glass around it
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
    no_parts: tuple[tuple[str, Named], ...] = ()
    solids: tuple[Named, ...] = ()
    in_glass: tuple[Named, ...] = ()
    enclosed: tuple[tuple[str, str], ...] = ()
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
