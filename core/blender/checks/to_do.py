"""Records of the checklist: findings in a scene, and the entries made from them."""

from dataclasses import dataclass, field
from typing import NamedTuple

from ...bench.measured_remedies import Help

PROBLEM, ADVICE = "ERROR", "INFO"  # Blender's names of the icons
SOLVE = "kiriko.solve"


class Named(NamedTuple):
    """An object's name, and the file it is linked from, '' for none."""

    name: str
    library: str = ""


class FaultCounts(NamedTuple):
    """Faults of a mesh.

    n_faces : all polygons
    n_open : edges of one face, or of more than two of one body
    n_turned : polygons flipped against most of their neighbours
    is_turned_smooth : one of them has a normal other than its plane's
    is_inside_out : the faces point into the body
    n_inner : polygons inside the body
    n_facets : flat polygons on a curved surface
    n_loose : vertices coincident with another one
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
    """An operator, its button's label, and the values of its properties."""

    operator: str
    label: str
    properties: tuple[tuple[str, object], ...] = ()
    icon: str = "NONE"


@dataclass(frozen=True)
class Entry:
    """One step of the checklist.

    icon : PROBLEM if light is lost or nothing can be solved, else ADVICE
    can_wait : found by inspecting a mesh or in a result, and also useful after Solve
    """

    text: str
    icon: str = PROBLEM
    buttons: tuple[Button, ...] = ()
    can_wait: bool = False

    @property
    def asks_to_solve(self) -> bool:
        """Whether the entry's remedy is Solve."""
        return any(button.operator == SOLVE for button in self.buttons)


def is_first(entry: Entry) -> bool:
    """Whether an entry belongs before Solve."""
    return not (entry.can_wait or entry.asks_to_solve)


@dataclass(frozen=True)
class Thing:
    """An object with a role, as far as the checklist needs it.

    hidden_by : words after "is hidden"; '' if visible
    width : m, the longest side of its box
    is_mesh : not a curve, surface or text
    is_opaque : none of its materials is glass
    has_place : this file can give it a material
    no_picture : why a plane shows no picture
    faults : of its mesh as read; none if not inspected yet
    own_faults : of its editable mesh, before modifiers
    has_facets : its setting Surface asks for facets
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

    missing : phrases on missing roles, by role
    has_rig : Add Rig made a rig
    has_own_camera : a camera was made for that rig
    cameras : names of the scene's cameras, those of the rig first
    no_parts : sentences on objects with a role but unfit as parts, and their names
    solids : possible glass without a role, the active one first
    in_glass : refractive objects without a role inside the glass
    lost : sentences on data missing from a library, and the library's name
    misses : lost shares of the picture in the last result, by reason
    misses_of_others : the same by name for each viewer but the visible one
    helps : measured remedies, the most effective first; None if none were measured
    legibility : of the picture, 0..1, by the last result; None if not computed
    legible_by : measured remedies for it, the most effective first
    is_missing_numbers : the source image is final, but has no figures yet
    is_doubled : the rig has copies of its display and picture
    for_most : m, the longest side of a new rig's display for most of its light; 0 if not computed
    is_followed : Live follows the scene, so the final image comes by itself
    """

    things: tuple[Thing, ...] = ()
    missing: tuple[tuple[str, str], ...] = ()
    has_rig: bool = False
    has_own_camera: bool = False
    cameras: tuple[str, ...] = ()
    no_parts: tuple[tuple[str, Named], ...] = ()
    solids: tuple[Named, ...] = ()
    in_glass: tuple[Named, ...] = ()
    lost: tuple[tuple[str, str], ...] = ()
    misses: dict[str, float] = field(default_factory=dict)
    misses_of_others: dict[str, dict[str, float]] = field(default_factory=dict)
    helps: tuple[Help, ...] | None = None
    legibility: float | None = None
    legible_by: tuple[Help, ...] = ()
    is_doubled: bool = False
    is_coarse: bool = False
    is_missing_numbers: bool = False
    is_stale: bool = False
    is_solved: bool = False
    for_most: float = 0.0
    is_followed: bool = False
