"""Figures of a solution, as stored in a scene."""

from dataclasses import asdict
from functools import partial
from typing import Any

import bpy

from ...base.errors import one_line
from ...base.messages import Message, joined
from ...solve.solution import Solution, cost
from ..data.stored_records import Ladder, StoredNumbers
from ..data.units import length_text
from ..read.scene import Reading


def numbers_of(
    scene: bpy.types.Scene, reading: Reading, solution: Solution
) -> tuple[dict[str, Any], list[str]]:
    """Figures of a solution, and notes for the user; writes nothing."""
    tolerance = scene.kiriko.tolerance
    in_units = partial(length_text, scene)
    notes = [
        *reading.notes,
        *(
            Message(
                "Kiriko ignores settings of the material '{material}' of '{name}': {ignored}.",
                material=read.material_name,
                name=read.object_name,
                ignored=joined(read.ignored, ", "),
            )
            for read in reading.materials
            if read.ignored
        ),
        *(remark.sentence(in_units) for remark in solution.remarks),
    ]
    details = {
        "warnings": [
            one_line(remark.sentence(in_units)) for remark in solution.remarks if remark.is_warning
        ],
        "materials": [asdict(material) for material in reading.materials],
        "picture_coverage": float(min(max(solution.picture_coverage, 0.0), 1.0)),
        "misses": solution.misses,
        "misses_of_others": {one.viewer.name: one.misses for one in solution.channels[1:]},
        "view_coverage": float(solution.first.view_coverage.mean()),
        "display_coverage": float(solution.display_coverage.mean()),
        "seconds": solution.seconds,
        "rays": solution.n_rays,
        "tessellation_error": solution.first.tessellation_error,
        "plate": None if solution.first.plate is None else asdict(solution.first.plate),
        "glare": None if solution.first.glare is None else solution.first.glare._asdict(),
        "split": None if solution.first.split is None else solution.first.split._asdict(),
        "sharpened": solution.sharpened and solution.sharpened.figures,
        "tolerance": tolerance,
        "map_error": asdict(solution.first.map_error),
        "total_seconds": sum(solution.seconds.values()),
        "cost": costs(scene, solution.seconds, tolerance),
        "colour": None if solution.colour is None else asdict(solution.colour),
        "used": list(solution.used),
        "left_out": list(solution.left_out),
        "display_size_m": None if reading.display_size is None else list(reading.display_size),
        "resolution": [reading.rig.display.width, reading.rig.display.height],
    }

    return details, notes


def costs(scene: bpy.types.Scene, seconds: dict[str, float], tolerance: float) -> dict[str, Any]:
    """The cost of a solve at half and twice the tolerance (display px), from the seconds of its
    parts.

    A solve without tracing keeps the costs of the previous one, whose cells it used.
    """
    before = StoredNumbers.read(scene.kiriko.result.details).by_name
    if "tracing" not in seconds:
        return before.get("cost", {})

    ladder = Ladder.read(scene.kiriko.result.ladder).rungs
    others = {
        name: {"tolerance": other, "seconds": cost(seconds, tolerance, other, ladder)}
        for name, other in (("half", tolerance / 2), ("twice", tolerance * 2))
    }
    return {
        "is_measured": bool(ladder),
        **{k: v for k, v in others.items() if v["seconds"] is not None},
    }


def write_ladder(scene: bpy.types.Scene, ladder: list[tuple[float, float]]) -> None:
    """Store a report's tolerances (display px) and seconds, and update the last result's costs."""
    result = scene.kiriko.result
    result.ladder = Ladder(ladder).text()
    details = StoredNumbers.read(result.details).by_name
    if "seconds" in details:  # Add Rig stores the legibility alone
        details["cost"] = costs(scene, details["seconds"], details["tolerance"])
        result.details = StoredNumbers(details).text()
