"""A work-precision measurement as text: table, CSV, JSON and a diagram; column names carry
units.
"""

import csv
import io
import json
import math
from dataclasses import fields
from typing import Any

import numpy as np

from ...light.plate import PlatePath, light_by_angle
from ...rig.rig import MirrorArray
from ...solve.solution import cost
from ..drawing.svg import Curve, linear, log_log
from .reference import PERCENTILE, ImageErrors, MapErrors, SeenErrors
from .work_precision import Rung, WorkPrecision

NAMES = ("report.csv", "report.json", "report.svg")
PLATE_NAMES = ("plate.csv", "plate.svg")  # additional columns for a plate with mirrors
ANGLES = range(0, 86)  # angle of incidence on the plate, degrees
UNITS_OF_SETTING = {"adaptive": "px", "splat": "spp"}
COLUMNS = {  # of CSV and JSON, by field of Rung, MapErrors, ImageErrors, SeenErrors
    "method": "method",
    "setting": "setting",
    "seconds": "seconds",
    "runs": "runs",
    "predicted_seconds": "predicted_seconds",
    "repaint_seconds": "repaint_seconds",
    "n_rays": "rays",
    "estimate": f"map_{PERCENTILE:g}_percent_estimated_display_px",
    "facet_limited": "facet_limited_share_of_viewer",
    "unresolved": "unresolved_share_of_viewer",
    "rms": "map_rms_display_px",
    "percentile": f"map_{PERCENTILE:g}_percent_display_px",
    "overlap": "map_overlap_iou",
    "source_rmse": "source_rmse_linear",
    "holes": "holes_display_px",
    "seen_psnr": "seen_psnr_db",
    "lattice_shift": "lattice_mean_viewer_px",
    "lattice_largest": "lattice_largest_viewer_px",
    "lattice_seen": "lattice_dots_seen",
}


def row(rung: Rung) -> dict[str, Any]:
    """Numbers of a rung by column name, for the first viewer; None if unknown."""
    first_map = rung.maps[0] if rung.maps else None
    first_seen = rung.image.channels[0] if rung.image else None
    values = {field.name: getattr(rung, field.name) for field in fields(Rung)}

    for part, kind in (
        (first_map, MapErrors),
        (rung.image, ImageErrors),
        (first_seen, SeenErrors),
    ):
        values |= {field.name: getattr(part, field.name, None) for field in fields(kind)}

    named = {name: _known(values[field]) for field, name in COLUMNS.items()}
    return named | {
        f"{part.replace(' ', '_')}_seconds": _known(seconds) for part, seconds in rung.parts
    }


def _known(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def as_csv(found: WorkPrecision) -> str:
    """A line for each rung, the reference first; empty cells for unknown numbers."""
    rows = [row(found.reference) | {"method": "reference"}, *(row(rung) for rung in found.rungs)]
    names = list(dict.fromkeys(name for one in rows for name in one))
    text = io.StringIO()
    writer = csv.DictWriter(text, names, restval=None, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def as_json(
    found: WorkPrecision, about: dict[str, Any] | None = None, beside: dict[str, Any] | None = None
) -> str:
    """All numbers, and the references of the errors.

    beside : additional facts about the rig, by name
    """
    own = found.own
    tolerance = found.tolerance
    seconds = dict(own.parts)
    whole = {
        "about": about or {},
        "statement": list(statement(found)),
        "viewer_px": found.view_sizes[0],
        "display_px": found.display_size,
        "threads": 1,
        "tolerance_display_px": tolerance,
        "reference": row(found.reference),
        "rungs": [row(rung) for rung in found.rungs],
        "tessellation_rms_display_px": found.tessellation_error,
        "quantisation_rms_encoded": found.quantisation,
        "seconds_by_part": {
            "reading the scene": found.read_seconds,
            **seconds,
            "writing": found.write_seconds,
        },
        "seconds_at_half_the_tolerance": cost(seconds, tolerance, tolerance / 2, found.ladder),
        "seconds_at_twice_the_tolerance": cost(seconds, tolerance, tolerance * 2, found.ladder),
        "splat_seconds_at_same_source_rmse": found.splat_seconds(own.image.source_rmse),
        "peak_memory_bytes": found.peak_memory,
        "choices": [
            {
                "ghosts": c.ghosts,
                "suppress_glare": c.suppress_glare,
                "seen_psnr_db": _known(c.seen_psnr),
            }
            for c in found.choices
        ],
        **(beside or {}),
    }

    return json.dumps(whole, indent=2, allow_nan=False) + "\n"


def statement(found: WorkPrecision) -> tuple[str, ...]:
    """Subjects and references of the numbers, one sentence a line."""
    finer = found.ladder[-1][0] / found.reference.setting
    view_width, view_height = found.view_sizes[0]
    shown = f"{found.n_shown} display pixels that show nothing else"
    return (
        f"Viewer {view_width} x {view_height} px, display {found.display_size[0]}"
        f" x {found.display_size[1]} px, one thread (numpy's own aside), medians of"
        f" {found.own.runs} runs (a long splat: 1 or 2).",
        f"Map: distance from {found.n_checked} rays traced in float64 at random points of the"
        f" viewer's image.",
        f"Source: RMSE of linear values of {found.picture}, over {shown}; those left black are"
        f" holes.",
        f"Reference: a solve at {found.reference.setting:g} px, {finer:.3g} times finer than the"
        f" finest rung, with {found.times_finer} times finer display pixels each way, averaged.",
        "Seen: PSNR of the seen image against the reference's seen image (for the reference:"
        " against the ideal image). Dots: positions of the lattice's dots against the ideal image.",
        "Seconds: from the plan (ray engine built) to the source image; the splat makes no"
        " estimate of its error.",
    )


TABLE = (  # heading, column, format
    ("seconds", "seconds", "{:.3f}"),
    ("repaint s", "repaint_seconds", "{:.3f}"),
    ("rays", "rays", "{:d}"),
    ("map rms px", COLUMNS["rms"], "{:.2g}"),
    (f"map {PERCENTILE:g}% px", COLUMNS["percentile"], "{:.2g}"),
    ("overlap", COLUMNS["overlap"], "{:.4f}"),
    ("source RMSE", COLUMNS["source_rmse"], "{:.2e}"),
    ("holes", COLUMNS["holes"], "{:d}"),
    ("seen dB", COLUMNS["seen_psnr"], "{:.1f}"),
    ("dots px", COLUMNS["lattice_shift"], "{:.4f}"),
)


def table(found: WorkPrecision) -> str:
    """Lines for a terminal: the rungs, then times by stage and the other errors."""
    lines = [
        *statement(found),
        "",
        f"{'':<18}" + "".join(f" {heading:>11}" for heading, *_ in TABLE),
    ]
    for name, rung in [
        ("reference", found.reference),
        *((rung.method, rung) for rung in found.rungs),
    ]:
        head = f"{name} {rung.setting:g} {UNITS_OF_SETTING[rung.method]}"
        if rung.predicted_seconds is not None:
            lines.append(f"{head:<18} not run: would take about {rung.predicted_seconds:.0f} s")
            continue

        numbers = row(rung)
        cells = (
            "-" if numbers[column] is None else form.format(numbers[column])
            for _, column, form in TABLE
        )
        lines.append(f"{head:<18}" + "".join(f" {cell:>11}" for cell in cells))

    own = found.own
    splat = found.splat_seconds(found.own.image.source_rmse)
    at_same_error = "not known: it was not run that far" if splat is None else (
        f"about {splat:.2g} s, {splat / own.seconds:.1f} times as long"
    )  # fmt: skip

    lines += [
        "",
        f"Time of the splat at the source RMSE of the scene's tolerance: {at_same_error}.",
    ]

    times = [
        ("reading the scene", found.read_seconds),
        *found.own.parts,
        ("writing", found.write_seconds),
    ]
    lines += ["", f"At the scene's tolerance of {found.tolerance:g} px, seconds by part:"]
    lines += [f"  {part:<20} {'not measured' if s is None else f'{s:.4f}'}" for part, s in times]
    lines += [
        "",
        "Ghosts and Suppress Glare: PSNR of the full view, with light past the glass, against the"
        " ideal image:",
    ]

    for ghosts, glare, seen in found.choices:
        lines.append(f"  {ghosts:<10} {glare:<5g} {'exact' if seen is None else f'{seen:.1f} dB'}")

    lines.append(f"Tessellation: about {found.tessellation_error:.2g} display px rms.")
    rounding = ", ".join(f"{name} {rms:.1e}" for name, rms in found.quantisation.items())
    lines.append(f"Quantisation of the encoded image, rms of 0..1: {rounding}.")
    memory = "not known" if found.peak_memory is None else f"{found.peak_memory / 1e6:.0f} MB"
    lines.append(f"Peak memory, of the whole process up to its first solve: {memory}.")

    return "\n".join(lines)


def as_svg(found: WorkPrecision, title: str = "Kiriko: error against run time") -> str:
    """Error of the source image against seconds, one curve for each method.

    Points without an error are left out.
    """
    curves = []
    n_exact = 0

    for method, name, unit in (
        ("adaptive", "Kiriko, by tolerance", "px"),
        ("splat", "splat, by samples", "spp"),
    ):
        run = [
            rung for rung in found.rungs if rung.method == method and rung.seconds and rung.image
        ]
        drawn = [rung for rung in run if rung.image.source_rmse > 0]
        n_exact += len(run) - len(drawn)
        points = tuple((rung.seconds, rung.image.source_rmse) for rung in drawn)
        curves.append(Curve(name, points, tuple(f"{rung.setting:g} {unit}" for rung in drawn)))

    size = "{} x {}".format(*found.display_size)
    notes = [f"Display {size} px, one thread; reference: {found.reference.setting:g} px,"
    f" {found.times_finer}"
             " times finer display pixels"]  # fmt: skip
    if n_exact:
        notes.append(f"Not drawn: {n_exact} without any difference from the reference")

    return log_log(
        title, "time (s)", "error of the source image (RMSE, linear 0..1)", curves, notes
    )


def plate_csv(array: MirrorArray) -> str:
    """Fraction of light by its angle to the plate's normal, between the mirrors, a column for each
    path.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    light = light_by_angle(array, np.radians(ANGLES))
    writer.writerow(["incidence_degrees", *(path.name.lower() for path in light)])
    writer.writerows(
        [angle, *(f"{light[path][k]:.6g}" for path in light)] for k, angle in enumerate(ANGLES)
    )
    return text.getvalue()


def plate_svg(array: MirrorArray, name: str) -> str:
    """The same as a diagram, with the stray light of both layers joined."""
    light = light_by_angle(array, np.radians(ANGLES))
    shares = {
        "mid-air image": light[PlatePath.IMAGED],
        "stray light, one layer alone": light[PlatePath.STRAY_1] + light[PlatePath.STRAY_2],
        "straight through": light[PlatePath.THROUGH],
        "reflected by the glass": light[PlatePath.REFLECTED],
    }

    curves = [
        Curve(name, tuple(zip(ANGLES, share.tolist(), strict=True)))
        for name, share in shares.items()
    ]

    note = (
        f"{array.layout}, {1e3 * array.pitch:g} mm from mirror to mirror, {1e3 * array.height:g}"
        f" mm high, index {array.ior:g}, reflectance {array.reflectance:g}"
    )
    title = f"Light that leaves the plate '{name}', of that which comes to it"

    return linear(
        title, "angle to the plate's normal (degrees)", "share of the light", curves, [note]
    )
