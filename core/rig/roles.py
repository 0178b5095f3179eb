"""What a rig knows of each kind of its parts, whichever part it is."""

from dataclasses import dataclass

from ..base.messages import as_message


@dataclass(frozen=True)
class Role:
    """One line of the table of roles, which stands in `rig.Rig`, a field for each.

    Parameters
    ----------
    name : as Blender's files keep it
    label : as the artist reads it; in a sentence in lower case
    kind : the number of its law at a meeting of light, as plans and the kernel have it; None for a
        part that light does not meet
    number : its number in Blender's files; None where no object can be given it
    icon : Blender's name of its icon
    tip : its effect, in one line
    remedy : for a rig that has none; '' where a rig can do without
    is_missed : a rig that has some, all of them hidden, is refused: it would be another rig
    is_single : a rig has one at most
    is_curved : smooth shading stands for a curved surface
    is_mapped : its UV map counts
    may_be_off : on a real bench it may stand elsewhere than planned
    field : the field of `Rig` that has such parts
    """

    name: str
    label: str
    kind: int | None = None
    number: int | None = None
    icon: str = ""
    tip: str = ""
    remedy: str = ""
    is_missed: bool = False
    is_single: bool = False
    is_curved: bool = False
    is_mapped: bool = False
    may_be_off: bool = False
    field: str = ""

    @property
    def noun(self) -> str:
        """The word for it within a sentence."""
        return as_message(self.label.lower())


class Part:
    """A part of a rig. Its class says what makes it invalid."""

    name: str

    def check_numbers(self, owner: str) -> None:
        """Raise RigError for a number that cannot be, before any mesh is looked at."""

    def check_shape(self, owner: str) -> None:
        """Raise RigError or MeshError for a shape that its role cannot have."""
