"""Why Cycles shows the glass of a scene otherwise than Kiriko follows it.

A preview has copies of the glass in materials that obey Kiriko's laws; *Look Through Viewer* shows
the artist's own objects. Cycles takes a material's index for a ratio to air and a face's normal for
the way out, and knows no priorities.
"""

from ..base.messages import Message
from ..rig.rig import WAVELENGTH
from .nested_glass import interfaces
from .scene import Reading

MOST_TRIANGLES = 300_000  # with more of them nobody is to wait for an answer
SAME = 1e-4  # indices that differ by less are the same


def reasons(reading: Reading) -> list[Message]:
    """A clause for each, without a full stop."""
    glasses = reading.rig.glasses
    if sum(len(glass.mesh.triangles) for glass in glasses) > MOST_TRIANGLES:
        return []

    found, notes = interfaces(glasses)
    told = [note.values["why"] for note in notes]
    for glass, shown in zip(glasses, found, strict=True):
        is_nested = shown.index is None or abs(shown.index - glass.ior.at(WAVELENGTH)) > SAME
        if is_nested and not notes:
            told.append(Message("'{name}' lies in other glass", name=glass.name))
        if shown.is_inside_out:
            told.append(Message("the faces of '{name}' look inward", name=glass.name))

    for one in reading.materials:
        if one.own_ior is not None and abs(one.own_ior - one.ior) > SAME:
            told.append(
                Message(
                    "the Override IOR of '{name}' is not that of its material",
                    name=one.object_name,
                )
            )
    return list(dict.fromkeys(told))
