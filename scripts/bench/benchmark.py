"""Makes and solves kiriko-bench, the rigs of benchmark/: `dev.py benchmark`.

`--make` writes the rigs anew: the sixteen glasses of `dev.py marks`, and the ball and the cube of
the paper. Blender makes the glasses; places and normals are rounded to single precision, and the
landings are those of the rounded files. They are traced by numpy in double precision, event by
event, with flat triangles and interpolated normals; the ball's are those of the exact sphere. Where
light passes a gap, or a normal contradicts its triangle, there is none.

Without it, the table has the scores and processor seconds of Kiriko, of Mitsuba's splat and of the
splat over embreex, each of whose source images benchmark/score.py judges.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

import kiriko_optics
from environments import ROOT
from kiriko.core.base.arrays import Bools, Floats
from kiriko.core.rig.rig import Mesh, Rig
from kiriko_optics._core.base.steps import run_steps
from kiriko_optics._core.base.vectors import dot, length_of, normalise
from kiriko_optics._core.glass.meshes import interpolate
from kiriko_optics._core.image.source_image import splat
from kiriko_optics._core.light.compile_plan import compile_plan
from kiriko_optics._core.light.optics import refract
from kiriko_optics._core.light.plan import Plan
from kiriko_optics._core.light.rays import Step, main_landings
from kiriko_optics._core.light.trace import tracing
from kiriko_optics._core.native import loading
from kiriko_optics._core.rig.settings import Settings
from known.closed_forms import landing, through_ball
from known.reference_rigs import ball_rig, cube_rig, glass_rig, zone_plate

from .marks import GLASSES, SPP, made, smooth_all_over
from .mitsuba_splat import MitsubaSplat, image_from_sums
from .runner import Bench, Row, option, run

FOLDER = ROOT / "benchmark"
sys.path.insert(0, str(FOLDER))  # noqa: TID251 - the benchmark's own programs stand alone
import score  # noqa: E402
import solve  # noqa: E402

RADIUS = 0.025  # m, of the ball
EMBREEX_SPP = 4
NAMES = [
    "reference_ball",
    "reference_cube",
    *(name.replace(", ", "_").replace(" ", "_") for name in GLASSES),
]


def drawn(name: str) -> Rig:
    """The rig of a name, made anew."""
    if name == "reference_ball":
        return ball_rig(5, image=zone_plate(rings=score.RINGS))
    if name == "reference_cube":
        return cube_rig(image=zone_plate(rings=score.RINGS))
    mesh, index = made(GLASSES[NAMES.index(name) - 2])
    return glass_rig(mesh, ior=index, image=zone_plate(rings=score.RINGS))


def numbers_of(a_rig: Rig) -> dict[str, Any]:
    """The rig without its glass's mesh, as plain numbers."""
    viewer, display = a_rig.viewer, a_rig.display

    def corners(mesh: Mesh) -> list[list[float]]:
        uv, places = mesh.uv.reshape(-1, 2), mesh.corners.reshape(-1, 3)
        order = ((0, 0), (1, 0), (1, 1), (0, 1))
        return [places[np.abs(uv - at).sum(axis=1).argmin()].tolist() for at in order]

    return {
        "unit": "m",
        "viewer": {
            "position": viewer.position.tolist(),
            "axes": viewer.axes.tolist(),
            "window": list(viewer.window),
            "pixels": [viewer.width, viewer.height],
        },
        "glass": {"index": a_rig.glasses[0].ior.at(0.0)},
        "plate": {"corners": a_rig.plates[0].mesh.vertices.tolist()},
        "display": {"corners": corners(display.mesh), "pixels": [display.width, display.height]},
        "picture": {"corners": corners(a_rig.picture.mesh)},
    }


def write_ply(path: Path, mesh: Mesh) -> None:
    """Write triangles with a normal at each corner, in single precision."""
    points = np.concatenate([mesh.corners, mesh.corner_normals], axis=2).astype("<f4")
    vertices, number = np.unique(points.reshape(-1, 6), axis=0, return_inverse=True)
    faces = np.empty(len(points), [("n", "u1"), ("corners", "<i4", 3)])
    faces["n"], faces["corners"] = 3, number.reshape(-1, 3)
    axes = "".join(f"property float {axis}\n" for axis in ("x", "y", "z", "nx", "ny", "nz"))
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{axes}"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + vertices.tobytes() + faces.tobytes())


def landings_of(a_rig: kiriko_optics.Rig, name: str) -> np.ndarray:
    """Reference landings (n, 2), display px, of the benchmark's samples; NaN outside of the image,
    and where the rules decide nothing.
    """
    origins, directions = a_rig.viewer.rays(score.samples((512, 512)))
    if name == "reference_ball":
        found = landing(a_rig, *through_ball(origins, directions, RADIUS, 1.49))
    else:
        plan, index = compile_plan(a_rig, Settings()), a_rig.glasses[0].ior.at(0.0)
        steps: list[Step] = []
        with loading.off():
            traced = run_steps(tracing(plan, origins, directions, steps=steps))
        found = main_landings(traced, len(origins)).xy.copy()
        found[traced.sample[traced.leak >= 0]] = np.nan
        found[is_undecided(plan, index, origins, steps)] = np.nan
    size = a_rig.displays[0].width, a_rig.displays[0].height
    with np.errstate(invalid="ignore"):
        found[~((found >= 0) & (found < size)).all(axis=1)] = np.nan
    return found


def is_undecided(plan: Plan, index: float, origins: Floats, steps: list[Step]) -> Bools:
    """Whether rays (n,) meet an interpolated normal on the other side of its triangle than they
    come from, or one that bends them to a side of the triangle where they cannot go.
    """
    is_odd = np.zeros(len(origins), bool)
    if plan.triangles.corner_normals is None:
        return is_odd
    last = origins.copy()
    held_places = [(held, held.places(len(plan.triangles))) for held in plan.layers]

    for step in steps:
        way = step.place - last[step.rays]
        moves = length_of(way) > 0
        rays, directions, number = step.rays[moves], normalise(way[moves]), step.triangle[moves]
        last[rays] = step.place[moves]
        for held, places in held_places:
            some = np.flatnonzero((places[number] >= 0) & plan.triangles.is_bent[number])
            triangle, came = number[some], directions[some]
            u, v = held.layer.frames.barycentric(places[triangle], last[rays[some]])
            shading = interpolate(plan.triangles.corner_normals[triangle], u, v)
            face = plan.triangles.normals[triangle]
            before, to_normal = dot(came, face), dot(came, shading)
            indices = np.where(before < 0, 1.0, index), np.where(before < 0, index, 1.0)
            against = normalise(-np.sign(to_normal)[:, None] * shading)
            bent, is_total, _ = refract(came, against, *indices)
            is_right = (before * to_normal > 0) & ((before * dot(bent, face) > 0) != is_total)
            is_odd[rays[some[~is_right]]] = True
    return is_odd


def make(name: str) -> None:
    """Write the files of a rig."""
    folder = FOLDER / "rigs" / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    a_rig = drawn(name)
    numbers = json.dumps(numbers_of(a_rig), indent=1) + "\n"
    (folder / "rig.json").write_text(numbers, encoding="utf-8")
    write_ply(folder / "glass.ply", smooth_all_over(a_rig.glasses[0].mesh))
    np.save(folder / "landings.npy", landings_of(solve.read(name), name))
    rig, landings = score.load(name)
    ideal, seen = score.ideal(rig), score.seen(rig, landings, plain(solve.read(name)))
    for image, values in (("ideal", ideal), ("plain", seen)):
        shape = score.SIDE, score.SIDE, 3
        kiriko_optics.write(folder / f"{image}.png", values.reshape(shape), "PNG8")


def plain(a_rig: kiriko_optics.Rig) -> np.ndarray:
    """The source image that shows the picture undistorted without the glass."""
    return kiriko_optics.solve(replace(a_rig, glasses=())).source


def write_sums() -> None:
    """Write the hashes of all files, as `sha256sum --check` reads them."""
    files = [path for path in (FOLDER / "rigs").rglob("*") if path.is_file()]
    files = sorted([*files, *FOLDER.glob("*.py")])
    lines = [
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(FOLDER).as_posix()}\n"
        for path in files
    ]
    (FOLDER / "SHA256SUMS").write_text("".join(lines), encoding="utf-8")


def measure(name: str, _: None, arguments: argparse.Namespace) -> Iterator[Row]:
    """The scores of each method."""
    if arguments.make:
        make(name)
        write_sums()
    a_rig = solve.read(name)
    methods: dict[str, Callable[[], np.ndarray]] = {
        "plain picture": lambda: plain(a_rig),
        "Kiriko": lambda: kiriko_optics.solve(a_rig).source,
        f"splat over embreex, {EMBREEX_SPP} spp": lambda: run_steps(
            splat(compile_plan(a_rig, Settings()), EMBREEX_SPP)
        ),
    }
    if not arguments.no_mitsuba:
        loop = MitsubaSplat(a_rig)
        loop.sums(1)  # compiled by now
        methods[f"Mitsuba, {SPP} spp"] = lambda: image_from_sums(loop.sums(SPP))
    for method, work in methods.items():
        started = process_time()
        source = work()
        row = {"method": method, "CPU s": process_time() - started}
        yield row | score.score_image(*score.load(name), source)


if __name__ == "__main__":
    run(
        __doc__,
        "bench.benchmark",
        Bench(
            dict.fromkeys(NAMES),
            {"method": "", "CPU s": ".2f", "rmse": ".5f", "psnr dB": ".2f", "ssim": ".4f"},
            measure,
        ),
        option("--make", action="store_true", help="write the rigs anew, then solve them"),
        option("--no-mitsuba", action="store_true", help="leave Mitsuba out"),
    )
