"""Properties of each kind of part in a rig."""

from dataclasses import dataclass

from ..base.messages import as_message


@dataclass(frozen=True)
class Role:
    """One row of the table of roles, defined by the fields of `rig.Rig`.

    Parameters
    ----------
    name : its name in Blender's files
    label : its name in the interface; lower case within a sentence
    kind : number of its interaction in plans and the kernel; None if light does not meet it
    number : its number in Blender's files; None if it cannot be assigned to an object
    icon : name of its Blender icon
    tip : its effect, in one line
    remedy : for a rig without one; '' if optional
    is_missed : refuse a rig with all of them hidden, which would be a different rig
    is_single : a rig has one at most
    is_made : Add Rig makes one
    is_curved : smooth shading means a curved surface
    is_mapped : its UV map is used
    may_be_off : may be misplaced on a real bench
    field : the field of `Rig` with its parts
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
    is_made: bool = False
    is_curved: bool = False
    is_mapped: bool = False
    may_be_off: bool = False
    field: str = ""

    @property
    def noun(self) -> str:
        """The label within a sentence."""
        return as_message(self.label.lower())


class Part:
    """A part of a rig. Its class defines its checks."""

    name: str
    splits = False  # whether light continues on two paths
    polarises = False  # whether it polarises light, or depends on its polarisation

    def check_numbers(self, owner: str) -> None:
        """Raise RigError for an invalid number, before any mesh is read."""

    def check_shape(self, owner: str) -> None:
        """Raise RigError or MeshError for a shape invalid for its role."""
