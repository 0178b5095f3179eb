"""How much an atlas will be, as far as it is known before any light is traced: for a dialogue,
which is drawn anew with each move of the mouse.
"""

import bpy

from ..core.atlas.atlas import BYTES_A_PIXEL
from ..core.atlas.heads import HeadBox, HeadGrid
from ..core.atlas.making import CHECKED
from ..core.base.errors import KirikoError
from ..core.base.messages import Message
from ..core.base.numbers import number
from ..core.blender.stored_records import Numbers
from ..core.blender.viewer import seats_of
from . import needed

BYTES = 16  # a display pixel of a map, before its file makes it smaller: st, coverage, path
SECONDS = 9e-6  # a display pixel of a map, through a ball, once the rig is solved


def estimate(scene: bpy.types.Scene, box: HeadBox, most: int, has_images: bool) -> list[Message]:
    """Sentences on the coarsest atlas of a box of heads; nothing where the rig has no display."""
    try:
        box.check()
    except KirikoError as error:
        return [error.message]
    displays = list(needed.parts(scene).get("DISPLAY", ()))
    if not displays:
        return []

    width, height = displays[0].kiriko.resolution
    n_pixels = width * height
    n = len(HeadGrid(box))
    told = [Message("At least {n} places of the head, of {most} at most.", n=n, most=most)]
    size = n_pixels * (BYTES + BYTES_A_PIXEL * has_images) / 1e6
    told.append(
        Message(
            "Each takes up to {mb} MB, {all} MB for these.", mb=number(size), all=number(n * size)
        )
    )
    details = Numbers.read(scene.kiriko.result.details).by_name
    if "tracing" not in details.get("seconds", {}) or "total_seconds" not in details:
        told.append(Message("Solve the rig anew to see here how long each takes."))
        return told

    # an atlas is of one of the viewers
    each = details["total_seconds"] / max(len(seats_of(scene)), 1) + n_pixels * SECONDS
    # the middle, and a place to each side of it along an axis, are traced to plan
    n_made = n + 1 + 2 * len(box.axes) + CHECKED
    told.append(
        Message(
            "Each takes about {seconds} s, by the last solve: {minutes} min for these, with the"
            " plan and the check.",
            seconds=number(each),
            minutes=number(n_made * each / 60),
        )
    )
    return told
