"""What each of several viewers sees of a solution, as a result keeps it, and as files."""

from collections.abc import Generator
from dataclasses import asdict
from functools import reduce
from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.base.errors import RigError
from ..core.base.messages import Message, quoted
from ..core.base.steps import at
from ..core.blender.conflict import Conflict
from ..core.blender.viewer import seats_of
from ..core.lab.measure.two_eyes import TIRES_FROM, pair_of, sights_of
from ..core.lab.measure.viewer_errors import conflict_in_light, viewer_reports
from ..core.rig.settings import Settings
from ..core.solve.disagreement import is_sharp
from ..core.solve.solution import Solution
from .folder import names_for

CONFLICT = "conflict"
ALL = "all"  # in place of a viewer's name, or a rig's


class Told(NamedTuple):
    """What is told of several viewers: by the names under which a result keeps it, and an image."""

    numbers: dict[str, Any]
    conflict: Conflict | None = None


def reports_of(solution: Solution, settings: Settings) -> Generator[float, None, Told]:
    """What is told of several viewers; nothing where there is one. Yields progress 0..1.

    viewers : a report for each, the worst first; of a picture that is no flat rectangle only
        coverage is told
    conflict : its unit and the largest; of places where a pixel shows the mean of these, else of
        colours
    two_eyes : as `pair_seen` tells of it, where they are a pair
    no_pair : why two are none
    """
    if len(solution.channels) < 2:
        return Told({})
    if solution.settled is None and not solution.rig.has_own_images:
        told = [
            {
                "viewer": channel.viewer.name,
                "weight": channel.viewer.weight,
                "coverage": min(max(channel.picture_coverage, 0.0), 1.0),
            }
            for channel in solution.channels
        ]
        told = sorted(told, key=lambda one: one["coverage"])
        return Told({"viewers": told, **_of_pair(solution)})

    off, in_light = yield from conflict_in_light(solution)
    found = yield from viewer_reports(solution, off)
    is_asked = reduce(np.logical_or, (one.coverage.weight > 0 for one in solution.channels))
    conflict = (
        Conflict(solution.settled.conflict, is_asked, "px")
        if is_sharp(solution.rig, settings)
        else Conflict(in_light, is_asked, "white")
    )
    numbers = {
        "viewers": [asdict(one) for one in found],
        "conflict": {"largest": conflict.largest, "unit": conflict.unit},
    }
    return Told({**numbers, **_of_pair(solution)}, conflict)


def _of_pair(solution: Solution) -> dict[str, Any]:
    """What is told of two viewers together, by its name; nothing of more."""
    if len(solution.channels) != 2:
        return {}
    try:
        pair_of(solution.rig)
    except RigError as reason:
        return {"no_pair": reason.message}
    pair = pair_seen(solution)
    return {"two_eyes": pair} if pair else {}


def pair_seen(solution: Solution) -> dict[str, Any] | None:
    """At which depth two viewers that are a pair of eyes see the picture, m in front of its plane,
    and vertical disparity; None where they are no pair, or no point is seen by both.

    A depth is None where it is beyond infinity.
    """
    try:
        left, right, sights = sights_of(solution)
    except RigError:
        return None
    if not sights.is_seen.any():
        return None
    return {
        "left": left.name,
        "right": right.name,
        "n_points": int(sights.is_seen.sum()),
        "mean_depth_m": _finite(sights.mean_depth),
        "largest_depth_m": _finite(sights.largest_depth),
        "mean_horizontal_arcmin": sights.mean_horizontal,
        "largest_horizontal_arcmin": sights.largest_horizontal,
        "mean_vertical_arcmin": sights.mean_vertical,
        "largest_vertical_arcmin": sights.largest_vertical,
        "tires_from_arcmin": TIRES_FROM,
    }


def _finite(depth: float) -> float | None:
    return depth if np.isfinite(depth) else None


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
    asked, known = asked_for(scene, names), asked_for(scene, [ALL])
    found = {
        f"{kind} {name}": f"{kind}_{of_name}.png"
        for name, of_name in zip(known, names_for(known), strict=True)
        for kind in ("ideal", "seen")
        if name in asked
    }
    return {**found, CONFLICT: "conflict.exr"} if asked else {}


def images_of(
    solution: Solution, scene: bpy.types.Scene, names: list[str], conflict: Conflict | None
) -> Generator[float, None, dict[str, NDArray[np.float32]]]:
    """What viewers see, by the names of `file_names`: the picture as they would see it straight,
    and what they do see; and the numbers of the conflict that is told of them, where there is one.
    Yields progress 0..1.
    """
    asked = asked_for(scene, names)
    found = {}
    for channel in solution.channels:
        name = channel.viewer.name
        if name in asked:
            yield from channel.look_beside()
            found[f"ideal {name}"] = channel.ideal()
            seeing = channel.seeing(solution.source, beside=True)
            found[f"seen {name}"] = yield from at(1.0, seeing)
    if asked and conflict is not None:
        found[CONFLICT] = conflict.of_pixel.astype(np.float32)
    return found
