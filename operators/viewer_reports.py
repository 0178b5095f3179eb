"""Figures of each of several viewers, also in words, and the viewers chosen on the command line."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import reduce
from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.base.errors import KirikoError, RigError
from ..core.base.messages import Message, as_message, joined, quoted
from ..core.base.numbers import number
from ..core.base.steps import hold_progress
from ..core.base.words import percent
from ..core.blender.data.camera_viewer import camera_at, seats_of
from ..core.blender.data.units import length_text
from ..core.blender.result.conflict import Conflict
from ..core.lab.measure.two_eyes import TIRES_FROM, pair_of, sights_of
from ..core.lab.measure.viewer_errors import N_POINTS, conflict_in_light, viewer_reports
from ..core.rig.settings import Settings
from ..core.solve.disagreement import is_sharp
from ..core.solve.solution import Solution
from .folder import names_for

IN_PLANE = 1e-6  # m, smallest depth that is reported
N_ALL = N_POINTS**2  # points of the picture


def lines(scene: bpy.types.Scene, numbers: dict[str, Any]) -> Iterator[Message]:
    """Lines on each viewer, the worst first, their conflict, and two eyes; none for a single
    viewer.

    If two viewers are not a pair of eyes, the reason is given.
    """
    yield from (of_viewer(one) for one in numbers.get("viewers", ()))
    if "conflict" in numbers:
        yield of_conflict(numbers["conflict"])
    pair = numbers.get("two_eyes")
    if pair:
        yield from of_pair(scene, pair)
        if is_tiring(pair):
            yield tiring(pair)
    if "no_pair" in numbers:
        yield as_message(numbers["no_pair"])


def of_viewer(one: dict[str, Any]) -> Message:
    """A line on a viewer: what it sees of the picture, and its error."""
    share = percent(one["coverage"])
    parts = [Message("'{viewer}' sees {share} of the picture", viewer=one["viewer"], share=share)]
    is_displaced = one.get("largest_px") is not None
    n_points = one.get("n_points", N_ALL)
    if n_points < N_ALL and (is_displaced or not n_points):
        parts.append(Message("{n} of {all} points", n=n_points, all=N_ALL))
    if is_displaced:
        text = Message(
            "displaced {mean} px, {largest} at most",
            mean=number(one["mean_px"]),
            largest=number(one["largest_px"]),
        )
        angle = one["largest_arcmin"]
        parts.append(
            text
            if angle is None
            else Message("{text} ({angle} arcmin)", text=text, angle=number(angle))
        )
    if one.get("psnr") is not None:
        parts.append(Message("{psnr:.1f} dB", psnr=one["psnr"]))
    if "unremovable" in one:
        text = Message("remaining error {error} of white", error=percent(one["unremovable"]))
        parts.append(text)
    return joined(parts, ", ")


def of_conflict(conflict: dict[str, Any]) -> Message:
    """Conflict of the viewers at the worst pixel."""
    if conflict["unit"] == "px":
        return Message(
            "Conflict at most {largest} px of the picture", largest=number(conflict["largest"])
        )
    return Message("Conflict at most {share} of white", share=percent(conflict["largest"]))


def of_pair(scene: bpy.types.Scene, pair: dict[str, Any]) -> list[Message]:
    """Depth of the picture for two eyes, in the scene's unit, and vertical disparity.

    The number of points is given if it is not all.
    """
    mean, largest = (
        Message("beyond infinity")
        if depth is None
        else Message("in its plane")
        if abs(depth) < IN_PLANE
        else Message("{length} in front of its plane", length=length_text(scene, depth))
        if depth > 0
        else Message("{length} behind its plane", length=length_text(scene, -depth))
        for depth in (pair["mean_depth_m"], pair["largest_depth_m"])
    )
    found = [
        Message(
            "Both eyes see the picture {mean} on average, {largest} at most",
            mean=mean,
            largest=largest,
        )
    ]
    if pair["n_points"] < N_ALL:
        found.append(Message("Both see {n} of {all} points", n=pair["n_points"], all=N_ALL))
    return [
        *found,
        Message(
            "Vertical disparity {mean} arcmin on average, {largest} at most",
            mean=number(pair["mean_vertical_arcmin"]),
            largest=number(pair["largest_vertical_arcmin"]),
        ),
    ]


def is_tiring(pair: dict[str, Any]) -> bool:
    """Whether vertical disparity is large enough to tire eyes."""
    limit = pair.get("tires_from_arcmin")  # missing in older results
    return bool(limit) and pair["largest_vertical_arcmin"] >= limit


def tiring(pair: dict[str, Any]) -> Message:
    """The limit of vertical disparity."""
    return Message("Eyes tire above {limit} arcmin", limit=number(pair["tires_from_arcmin"]))


CONFLICT = "conflict"
ALL = "all"  # placeholder for a viewer's or a rig's name


class ViewerReports(NamedTuple):
    """Figures of several viewers by their keys in a result, and an image."""

    numbers: dict[str, Any]
    conflict: Conflict | None = None


def reports_of(solution: Solution, settings: Settings) -> Generator[float, None, ViewerReports]:
    """Figures of several viewers; empty for a single one. Yields progress 0..1.

    viewers : a report for each, the worst first; only coverage unless the picture is a flat
        rectangle
    conflict : its unit and largest value, of places if pixels show a mean place, otherwise of
        colours
    two_eyes : from `pair_seen`, for a pair
    no_pair : reason why two viewers are not a pair
    """
    if len(solution.channels) < 2:
        return ViewerReports({})
    if solution.settled is None and not solution.rig.has_own_images:
        reports = [
            {
                "viewer": channel.viewer.name,
                "weight": channel.viewer.weight,
                "coverage": min(max(channel.picture_coverage, 0.0), 1.0),
            }
            for channel in solution.channels
        ]
        reports = sorted(reports, key=lambda one: one["coverage"])
        return ViewerReports({"viewers": reports, **_of_pair(solution)})

    off, in_light = yield from conflict_in_light(solution)
    found = yield from viewer_reports(solution, off)
    is_requested = reduce(np.logical_or, (one.coverage.weight > 0 for one in solution.channels))
    conflict = (
        Conflict(solution.settled.conflict, is_requested, "px")
        if is_sharp(solution.rig, settings)
        else Conflict(in_light, is_requested, "white")
    )
    numbers = {
        "viewers": [asdict(one) for one in found],
        "conflict": {"largest": conflict.largest, "unit": conflict.unit},
    }
    return ViewerReports({**numbers, **_of_pair(solution)}, conflict)


def _of_pair(solution: Solution) -> dict[str, Any]:
    """Figures of two viewers together, by key; empty for more."""
    if len(solution.channels) != 2:
        return {}
    try:
        pair_of(solution.rig)
    except RigError as reason:
        return {"no_pair": reason.message}
    pair = pair_seen(solution)
    return {"two_eyes": pair} if pair else {}


def pair_seen(solution: Solution) -> dict[str, Any] | None:
    """Depth, m in front of the picture's plane, and vertical disparity for a pair of eyes.

    None if the viewers are not a pair, or no point is seen by both. A depth beyond infinity is
    None.
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


def viewers_requested(scene: bpy.types.Scene, names: list[str]) -> list[str]:
    """Viewers requested by name, or `all`; RigError for an unknown name."""
    known = [seat.camera.name for seat in seats_of(scene) if seat.camera is not None]
    if names == [ALL]:
        return known
    for name in names:
        if name not in known:
            raise RigError(
                "The rig has no viewer '{name}', only {names}.",
                name=name,
                names=quoted(known) or Message("none"),
            )
    return list(dict.fromkeys(names))


def file_names(scene: bpy.types.Scene, names: list[str]) -> dict[str, str]:
    """Files of the requested viewers, by image."""
    requested, known = viewers_requested(scene, names), viewers_requested(scene, [ALL])
    found = {
        f"{kind} {name}": f"{kind}_{of_name}.png"
        for name, of_name in zip(known, names_for(known), strict=True)
        for kind in ("ideal", "seen")
        if name in requested
    }
    return {**found, CONFLICT: "conflict.exr"} if requested else {}


def images_of(
    solution: Solution, scene: bpy.types.Scene, names: list[str], conflict: Conflict | None
) -> Generator[float, None, dict[str, NDArray[np.float32]]]:
    """Ideal and seen images of viewers, by the keys of `file_names`, and figures of their conflict.

    Yields progress 0..1.
    """
    requested = viewers_requested(scene, names)
    found = {}
    for channel in solution.channels:
        name = channel.viewer.name
        if name in requested:
            yield from channel.trace_stray_light()
            found[f"ideal {name}"] = channel.ideal()
            seeing = channel.seeing(solution.source, past_glass=True)
            found[f"seen {name}"] = yield from hold_progress(1.0, seeing)
    if requested and conflict is not None:
        found[CONFLICT] = conflict.of_pixel.astype(np.float32)
    return found


def choose_alone(scene: bpy.types.Scene, name: str) -> None:
    """Turn all other viewers off; RigError if none of this name is on."""
    viewers_requested(scene, [name])
    listed = scene.kiriko.viewers
    for n, one in enumerate(listed):
        camera = camera_at(scene, n)
        one.is_on = one.is_on and camera is not None and camera.name == name
    for n, one in enumerate(listed):
        if one.is_on:
            scene.kiriko.viewer_shown = n


@contextmanager
def naming_rig(name: str | None) -> Iterator[None]:
    """Prefix errors with the name of a rig, if there is one."""
    try:
        yield
    except KirikoError as error:
        if name is None:
            raise
        raise RigError("Rig '{rig}': {error}", rig=name, error=error.message) from None


@contextmanager
def naming_viewer(name: str | None) -> Iterator[None]:
    """Prefix errors with the name of a viewer."""
    try:
        yield
    except KirikoError as error:
        if name is None:
            raise
        raise RigError("Viewer '{viewer}': {error}", viewer=name, error=error.message) from None
