"""What is told of several viewers in words: in the panel, and on the command line.

Numbers are those that a result keeps: of `viewer_reports.reports_of`.
"""

from collections.abc import Iterator
from typing import Any

import bpy

from ..core.base.messages import Message, as_message, joined
from ..core.base.numbers import number
from ..core.base.words import percent
from ..core.blender.units import length_text
from ..core.lab.measure.viewer_errors import N_POINTS

IN_PLANE = 1e-6  # m, from which a depth is told
N_ALL = N_POINTS**2  # points of the picture


def lines(scene: bpy.types.Scene, numbers: dict[str, Any]) -> Iterator[Message]:
    """All that is told: each viewer, the worst first, their conflict, two eyes or why two are no
    pair; nothing where there is one viewer.
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
    """One line on a viewer: what it sees of the picture, and how far off."""
    share = percent(one["coverage"])
    parts = [Message("'{viewer}' sees {share} of the picture", viewer=one["viewer"], share=share)]
    is_displaced = one.get("largest_px") is not None
    n_points = one.get("n_points", N_ALL)
    if n_points < N_ALL and (is_displaced or not n_points):
        parts.append(Message("{n} of {all} points", n=n_points, all=N_ALL))
    if is_displaced:
        text = Message(
            "displaced {mean} px, at most {largest}",
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
        text = Message("{error} of white stay off", error=percent(one["unremovable"]))
        parts.append(text)
    return joined(parts, ", ")


def of_conflict(conflict: dict[str, Any]) -> Message:
    """By how much viewers disagree about the pixel that they disagree about most."""
    if conflict["unit"] == "px":
        return Message(
            "Conflict at most {largest} px of the picture", largest=number(conflict["largest"])
        )
    return Message("Conflict at most {share} of white", share=percent(conflict["largest"]))


def of_pair(scene: bpy.types.Scene, pair: dict[str, Any]) -> list[Message]:
    """At which depth two eyes see the picture, in the scene's unit, how many points of it where it
    is not all, and vertical disparity.
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
            "Both eyes see the picture {mean} on the mean, at most {largest}",
            mean=mean,
            largest=largest,
        )
    ]
    if pair["n_points"] < N_ALL:
        found.append(Message("Both see {n} of {all} points", n=pair["n_points"], all=N_ALL))
    return [
        *found,
        Message(
            "Vertical disparity {mean} arcmin on the mean, at most {largest}",
            mean=number(pair["mean_vertical_arcmin"]),
            largest=number(pair["largest_vertical_arcmin"]),
        ),
    ]


def is_tiring(pair: dict[str, Any]) -> bool:
    """Do two eyes see so much vertical disparity that people tire?"""
    limit = pair.get("tires_from_arcmin")  # results of before do not have it
    return bool(limit) and pair["largest_vertical_arcmin"] >= limit


def tiring(pair: dict[str, Any]) -> Message:
    """From which vertical disparity on they do."""
    return Message("Eyes tire from {limit} arcmin on", limit=number(pair["tires_from_arcmin"]))
