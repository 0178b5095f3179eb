"""Kiriko and Mitsuba 3 in turns on one machine: `dev.py marks`.

Both have the same mesh, viewer and display: facets with interpolated normals, 512 x 512 pixels.
Mitsuba's splat (mitsuba_splat.py) takes `--samples` per pixel. Kiriko solves at its default
settings, *as drawn* (the mesh that Mitsuba shows) and by *Automatic*, which follows the curved
surface and has no judge here. `s`: median processor seconds. An error is the RMSE of the source
image, linear, over the display pixels seen by the judge, holes as black; *as seen* weights each by
how much the viewer sees of it. The judge is a splat of `--reference` samples in two independent
halves A and B: the mean of (image - A)(image - B) is the squared error without the judge's own
noise. `x`: times Mitsuba's seconds. `apart`: fraction of the rays that Mitsuba takes elsewhere.
Mitsuba loses rays if a mesh overlaps itself or has two coincident faces, and is no judge there.
`equal x`: drawn seconds over those that Mitsuba needs for the same error, which falls with the root
of its time; `equal seen x`: as seen. The bench ends with 1 where `drawn x` is above MOST_X, for the
ball MOST_BALL, or `equal seen x` above 1.

`--effort`: cost and gain of *Effort*, and of more samples for the splat, in processor seconds of
one thread. A `power` is the exponent of time by which the error falls from the row above.

`--ball`: the reference ball, judged by a splat of the exact sphere (Mitsuba's own splat: of its
triangles), with several tolerances and samples, again after the viewer has moved, with another
picture, and by the splat over embreex. Use `--threads 1` on one core.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from time import process_time, thread_time

import numpy as np

from environments import run_in_newest_blender
from kiriko.core.base.steps import run_steps
from kiriko.core.glass.meshes import geometric_normals
from kiriko.core.image.source_image import splat
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.native import loading
from kiriko.core.rig.rig import Mesh, Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import Solution
from known.reference_rigs import ball_rig, glass_rig, zone_plate

from . import mitsuba_splat
from .mitsuba_splat import Judge, MitsubaSplat, image_from_sums, share_apart
from .runner import MISSED, Bench, Row, in_turns, option, run

GLASSES = (
    "ball", "cube", "ellipsoid", "bottle", "wine glass", "vase", "Suzanne", "text, bevelled",
    "text, remeshed", "gem", "cut cylinder", "displaced ball", "scan", "large scan", "bauble",
    "nine balls",
)  # fmt: skip
SPP = 100
MOST_X, MOST_BALL = 1.5, 0.3
EFFORTS = 1, 4, 16, 64
SAMPLES = 25, 50, 100, 200
TOLERANCES = 1.0, 0.1, 0.01
EMBREEX_SPP = 4
ASIDE = np.array([1e-3, 0.0, 0.0])  # m


@cache
def made(name: str) -> tuple[Mesh, float]:
    """The mesh of a glass and its index, made by Blender, which is not in this process."""
    with tempfile.TemporaryDirectory() as folder:
        if run_in_newest_blender("bench.brought_glass", folder, name):
            sys.exit("The glass was not made, for the reason above.")
        with np.load(Path(folder, f"{name}.npz")) as found:
            parts = {part: found[part][()] for part in found.files}  # numbers, not arrays of one
    index = parts.pop("index")
    return Mesh(**parts), index


def smooth_all_over(mesh: Mesh) -> Mesh:
    """The same mesh for Mitsuba: flat faces have their own normals at their corners.

    Faces with a normal on the other side, which Kiriko treats as flat, have their own normals, too.
    """
    normals = np.repeat(geometric_normals(mesh.corners)[:, None], 3, axis=1)
    if mesh.is_smooth is not None:
        is_usable = mesh.is_smooth & ((mesh.corner_normals * normals).sum(axis=2) > 0).all(axis=1)
        normals = np.where(is_usable[:, None, None], mesh.corner_normals, normals)
    return replace(
        mesh, corner_normals=normals, is_smooth=np.ones(len(mesh.triangles), bool), surface="facets"
    )


def with_mesh(a_rig: Rig, mesh: Mesh) -> Rig:
    """The rig with another mesh for its glass."""
    return replace(a_rig, glasses=(replace(a_rig.glasses[0], mesh=mesh),))


def of_surface(a_rig: Rig, surface: str) -> Rig:
    """The rig with a choice of *Surface*."""
    return with_mesh(a_rig, replace(a_rig.glasses[0].mesh, surface=surface))


def solved(a_rig: Rig, session: Session | None = None, **settings: float) -> Solution:
    """A whole solve, from scratch without a session."""
    return run_steps((session or Session()).solve(a_rig, Settings(**settings)))


def prepared(name: str, arguments: argparse.Namespace) -> tuple[Rig, MitsubaSplat, Judge]:
    """A glass's rig, Mitsuba's splat of it, and the judge."""
    mesh, index = made(name)
    a_rig = glass_rig(mesh, ior=index, image=zone_plate(), display_pixels=arguments.display)
    loop = MitsubaSplat(with_mesh(a_rig, smooth_all_over(mesh)))
    loop.sums(1)  # compiled by now
    return a_rig, loop, Judge(loop.rig, arguments.reference, is_sphere=False)


def measure(name: str, _: None, arguments: argparse.Namespace) -> Iterator[Row]:
    """Mitsuba, and Kiriko by two choices of surface."""
    a_rig, loop, judge = prepared(name, arguments)
    seconds, found = in_turns(
        {
            "Mitsuba": lambda: loop.sums(arguments.samples),
            "drawn": lambda: solved(of_surface(a_rig, "facets")),
            "auto": lambda: solved(of_surface(a_rig, "automatic")),
        },
        arguments.rounds,
        process_time,
    )
    theirs, drawn = image_from_sums(found["Mitsuba"]), found["drawn"].source
    row = {
        "triangles": len(a_rig.glasses[0].mesh.triangles),
        **{f"{way} s": one for way, one in seconds.items()},
        "its error": judge.error(theirs),
        "as seen": judge.seen_error(theirs),
        "error": judge.error(drawn),
        "as seen ": judge.seen_error(drawn),
        "drawn x": seconds["drawn"] / seconds["Mitsuba"],
        "auto x": seconds["auto"] / seconds["Mitsuba"],
        "apart %": 100 * share_apart(loop.rig, loop),
    }
    row["equal x"] = row["drawn x"] * (row["error"] / row["its error"]) ** 2
    row["equal seen x"] = row["drawn x"] * (row["as seen "] / row["as seen"]) ** 2
    most = MOST_BALL if name == "ball" else MOST_X
    is_kept = row["drawn x"] <= most and row["equal seen x"] <= 1
    yield row | {"mark": "kept" if is_kept else MISSED}


def measure_efforts(name: str, _: None, arguments: argparse.Namespace) -> Iterator[Row]:
    """A row for each Effort, and for each number of samples of the splat."""
    a_rig, loop, judge = prepared(name, arguments)
    loading.use_threads(1)
    mitsuba_splat.use_threads(1)
    drawn = of_surface(a_rig, "facets")
    n_pixels = a_rig.viewer.width * a_rig.viewer.height
    before: Row = {}
    for effort in EFFORTS:
        started = thread_time()
        solution = solved(drawn, effort=effort)
        row = {"way": f"Effort {effort}", "CPU s": thread_time() - started}
        error = solution.first.map_error
        row |= {"rays": solution.n_rays, "sampled %": 100 * error.sampled}
        row |= {"unresolved %": 100 * error.unresolved}
        before = row | fallen(judge, solution.source, row["CPU s"], before)
        yield before
    before = {}
    for samples in SAMPLES:
        started = process_time()
        image = image_from_sums(loop.sums(samples))
        row = {"way": f"{samples} spp", "CPU s": process_time() - started}
        row |= {"rays": samples * n_pixels}
        before = row | fallen(judge, image, row["CPU s"], before)
        yield before


def fallen(judge: Judge, image: np.ndarray, seconds: float, before: Row) -> Row:
    """The errors of an image, and the exponents of time by which they fall from the previous
    row.
    """
    row: Row = {"error": judge.error(image), "as seen": judge.seen_error(image)}
    for head, power in (("error", "power"), ("as seen", "power ")) if before else ():
        row[power] = np.log(row[head] / before[head]) / np.log(seconds / before["CPU s"])
    return row


def measure_ball(name: str, _: None, arguments: argparse.Namespace) -> Iterator[Row]:
    """All methods in turns, each judged by its image."""
    a_rig = ball_rig(5, ior=1.49, image=zone_plate(1024))
    if arguments.threads:
        mitsuba_splat.use_threads(arguments.threads)
    loop = MitsubaSplat(a_rig)
    loop.sums(1)
    by_triangles, by_sphere = (Judge(a_rig, arguments.reference, way) for way in (False, True))
    session, plan = Session(), compile_plan(of_surface(a_rig, "facets"), Settings())
    viewer = a_rig.viewer
    aside = replace(a_rig, viewers=(replace(viewer, position=viewer.position + ASIDE),))
    other = replace(a_rig.picture, image=1 - a_rig.picture.image)
    shown = replace(a_rig, pictures=(other,))
    solved(a_rig, session)
    works: Mapping[str, Callable[[], object]] = {
        **{f"Kiriko, {t:g} px": lambda t=t: solved(a_rig, tolerance=t) for t in TOLERANCES},
        "Kiriko, another picture": lambda: solved(shown, session),
        "Kiriko, the first picture again": lambda: solved(a_rig, session),
        "Kiriko, viewer moved": lambda: solved(aside, session),
        **{f"Mitsuba, {spp} spp": lambda spp=spp: loop.sums(spp) for spp in (1, 10, SPP)},
        f"splat over embreex, {EMBREEX_SPP} spp": lambda: run_steps(splat(plan, EMBREEX_SPP)),
    }
    seconds, found = in_turns(works, arguments.rounds)
    fastest = seconds["Kiriko, 0.1 px"]
    for way, one in found.items():
        row = {"way": way, "s": seconds[way], "x": seconds[way] / fastest}
        if isinstance(one, Solution):
            if way.endswith(("px", "again")):
                row |= {"error": by_sphere.error(one.source), "rays": one.n_rays}
                row["holes"] = by_sphere.holes(one.display_coverage > 0)
        elif way.startswith("Mitsuba"):
            row |= {"error": by_triangles.error(image_from_sums(one))}
            row["holes"] = by_triangles.holes(one[..., 3] > 0)
        else:
            row["error"] = by_triangles.error(one)
        yield row


COLUMNS = {
    "triangles": "d", "Mitsuba s": ".2f", "its error": ".4f", "as seen": ".4f", "drawn s": ".2f",
    "error": ".4f", "as seen ": ".4f", "auto s": ".2f", "drawn x": ".2f", "auto x": ".2f",
    "apart %": ".1f", "equal x": ".2f", "equal seen x": ".2f", "mark": "s",
}  # fmt: skip
EFFORT_COLUMNS = {
    "way": "", "CPU s": ".2f", "rays": "d", "sampled %": ".2f", "unresolved %": ".2f",
    "error": ".4f", "power": ".2f", "as seen": ".4f", "power ": ".2f",
}  # fmt: skip

if __name__ == "__main__":
    cases = dict.fromkeys(GLASSES)
    run(
        __doc__,
        "bench.marks",
        Bench(cases, COLUMNS, measure),
        option("--reference", type=int, default=1024, metavar="SPP", help="samples of the judge"),
        option("--samples", type=int, default=SPP, metavar="SPP", help="of Mitsuba's splat"),
        option("--display", type=int, default=512, metavar="PIXELS", help="of the display"),
        effort=Bench(cases, EFFORT_COLUMNS, measure_efforts),
        ball=Bench(
            {"reference ball": None},
            {"way": "", "s": ".3f", "x": ".1f", "error": ".5f", "holes": "d", "rays": "d"},
            measure_ball,
        ),
    )
