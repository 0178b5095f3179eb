"""What each of several viewers sees of a solution, as a result keeps it, and as files."""

from collections.abc import Generator
from dataclasses import asdict
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.blender.viewer import seats_of
from ..core.errors import RigError
from ..core.measure.viewers import viewer_reports
from ..core.messages import Message, quoted
from ..core.solve.solution import Solution
from .farm_verbs import ALL
from .folder import names_for

CONFLICT = "conflict"


def reports_of(solution: Solution) -> Generator[float, None, list[dict[str, Any]]]:
    """A report for each viewer, the worst first; none where there is one viewer. Of a picture that
    is no flat rectangle only coverage is told. Yields progress 0..1.
    """
    if len(solution.channels) < 2:
        return []
    if solution.settled is None:
        told = [
            {
                "viewer": channel.viewer.name,
                "weight": channel.viewer.weight,
                "coverage": min(max(channel.picture_coverage, 0.0), 1.0),
            }
            for channel in solution.channels
        ]
        return sorted(told, key=lambda one: one["coverage"])

    found = yield from viewer_reports(solution)
    return [asdict(one) for one in found]


def asked_for(scene: bpy.types.Scene, names: list[str]) -> list[str]:
    """Names of the viewers that a command asks for, `all` of them, or some; RigError where there is
    none of a name.
    """
    known = [seat.camera.name for seat in seats_of(scene) if seat.camera is not None]
    if names == [ALL]:
        return known
    for name in names:
        if name not in known:
            raise RigError(
                "The rig has no viewer '{name}': there are {names}.",
                name=name,
                names=quoted(known) or Message("none"),
            )
    return list(dict.fromkeys(names))


def file_names(scene: bpy.types.Scene, names: list[str]) -> dict[str, str]:
    """The files of viewers that a command asks for, by the image in them."""
    asked = asked_for(scene, names)
    found = {
        f"{kind} {name}": f"{kind}_{of_name}.png"
        for name, of_name in zip(asked, names_for(asked), strict=True)
        for kind in ("ideal", "seen")
    }
    return {**found, CONFLICT: "conflict.exr"} if asked else {}


def images_of(
    solution: Solution, scene: bpy.types.Scene, names: list[str]
) -> Generator[float, None, dict[str, NDArray[np.float32]]]:
    """What viewers see, by the names of `file_names`: the picture as they would see it straight,
    and what they do see; and by how many pixels of the picture they disagree at each display pixel.
    Yields progress 0..1.
    """
    asked = asked_for(scene, names)
    found = {}
    for channel in solution.channels:
        name = channel.viewer.name
        if name in asked:
            yield from channel.look_beside()
            found[f"ideal {name}"] = channel.ideal()
            found[f"seen {name}"] = channel.seen(solution.source, beside=True)
    if asked and solution.settled is not None:
        found[CONFLICT] = solution.settled.conflict.astype(np.float32)
    return found
