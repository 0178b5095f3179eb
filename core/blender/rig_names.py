"""Names of a rig's results, in the outliner and in sentences: with the number of their rig, or its
name.
"""

import bpy

from ..base.messages import Message
from ..rig.rig import Rig
from .rigs import NUMBER, active_rig
from .translation_context import data_name

RIG = Message("Kiriko Rig")


def name_for(scene: bpy.types.Scene, name: str) -> str:
    """The name of a result of a scene's active rig: with the number of the rig's collection, and
    with its name where the artist gave it one.
    """
    rig = active_rig(scene)
    if rig is None:
        return name
    number = NUMBER.search(rig.name)
    own = rig.name[: number.start()] if number else rig.name
    if own in {RIG, data_name(RIG)}:
        return f"{name}{number.group() if number else ''}"
    return f"{name} {rig.name}"


def name_of_view(scene: bpy.types.Scene, name: str, rig: Rig) -> str:
    """The same for one that shows what a rig's viewer sees: with its name where it has others."""
    own = name_for(scene, name)
    return own if len(rig.viewers) == 1 else f"{own} - {rig.viewers[0].name}"
