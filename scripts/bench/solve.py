"""Seconds and peak memory of whole solves, each in a process of its own: `dev.py bench`.

With `--engines`: of a ball's solves by Blender's BVH beside
Embree, for both in turns, and of the engines alone.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
from dataclasses import replace
from time import perf_counter, process_time

import numpy as np

from environments import as_module
from kiriko.core.base.steps import finish
from kiriko.core.lab.measure.work_precision import peak_memory
from kiriko.core.light.engines import make_engine
from kiriko.core.native import loading
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.memory import estimated
from kiriko.core.solve.session import Session
from known.reference_rigs import ball_rig, box, cube_rig, icosphere, lattice_image, rig

PICTURE = 1024
MOVED = np.array([1e-4, 0.0, 0.0])  # m, the viewer between two solves
CASES = {
    "ball, 20 k triangles, 512 -> 512": lambda: ball_rig(5, image=lattice_image(PICTURE)),
    "the same as drawn": lambda: rig(
        replace(icosphere(0.025, 5), surface="facets"), image=lattice_image(PICTURE)
    ),
    "ball, 1 k triangles, 512 -> 512": lambda: ball_rig(3, image=lattice_image(PICTURE)),
    "ball, 5 k triangles, 512 -> 512, 1e-4 px": lambda: ball_rig(4, image=lattice_image(PICTURE)),
    "ball, 1.3 M triangles, 512 -> 512": lambda: ball_rig(8, image=lattice_image(PICTURE)),
    "cube, 512 -> 512": lambda: cube_rig(image=lattice_image(PICTURE)),
    "ball, 20 k triangles, 512 -> 4096": lambda: ball_rig(
        5, display_pixels=4096, image=lattice_image(PICTURE)
    ),
    "ball, 20 k triangles, 4096 -> 512": lambda: ball_rig(
        5, pixels=4096, image=lattice_image(PICTURE)
    ),
    "ball, 20 k triangles, 512 -> 8192": lambda: ball_rig(
        5, display_pixels=8192, image=lattice_image(PICTURE)
    ),
    "slab, 512 -> 512": lambda: rig(box([0.3, 0.03, 0.3]), image=lattice_image(PICTURE)),
}
# display px, of cases that have their own
TOLERANCES = {"ball, 5 k triangles, 512 -> 512, 1e-4 px": 1e-4}
ENGINES = ("Embree", "Blender's BVH")
ENGINE_LEVELS = (3, 5, 7)  # of a ball of 20 * 4^level triangles
N_RAYS = 1 << 16


def peak() -> float:
    """Most memory that this process has had, MB."""
    return (peak_memory() or np.nan) / 1e6


def measure(name: str, runs: int) -> dict[str, object]:
    """Solve from scratch `runs` times and paint another picture as often; then as often for a
    viewer that moved.
    """
    a_rig = CASES[name]()
    settings = Settings(tolerance=TOLERANCES.get(name, Settings().tolerance))
    before = peak()

    whole = []
    again = []
    moved = []
    parts = []
    for _ in range(runs):
        session = Session()
        started = perf_counter()
        solution = finish(session.solve(a_rig, settings))
        whole.append(perf_counter() - started)
        parts.append(solution.seconds)
        a_rig.picture.image[:] = np.flip(a_rig.picture.image, 0).copy()
        started = perf_counter()
        finish(session.solve(a_rig, settings))
        again.append(perf_counter() - started)

    most = peak()
    for k in range(1, runs + 1):
        viewer = replace(a_rig.viewer, position=a_rig.viewer.position + k * MOVED)
        started = perf_counter()
        finish(session.solve(replace(a_rig, viewers=(viewer,)), settings))
        moved.append(perf_counter() - started)

    return {
        "solve": statistics.median(whole),
        "repaint": statistics.median(again),
        "moved": statistics.median(moved),
        "parts": {part: statistics.median(p[part] for p in parts) for part in parts[0]},
        "rays": solution.n_rays,
        "shares": len(solution.first.shares),
        "peak": most,
        "told": before + sum(estimated(a_rig, settings, solution.first.view_map).values()) / 1e6,
    }


def measure_engine(name: str, level: int) -> dict[str, float]:
    """Processor seconds of one engine for a ball: to build it, for a ray (us), for a solve.

    And peak MB of all that.
    """
    import bpy  # noqa: F401 - without it there is no mathutils

    os.environ["KIRIKO_KERNEL"] = "off"  # which would ask neither
    if name != "Embree":
        sys.modules["embreex"] = None  # no import finds it from now on
    corners = icosphere(1.0, level).corners.astype(np.float32)
    started = process_time()
    engine = make_engine(corners)
    built = process_time()
    if engine.name != name:
        sys.exit(f"There is no {name} here, but {engine.name}.")
    rays = ball_rig(0, pixels=512).viewer.rays(
        np.random.default_rng(0).uniform(0, 512, (N_RAYS, 2))
    )
    origins, directions = (values.astype(np.float32) for values in (rays[0] / 0.025, rays[1]))
    shot_from = process_time()
    engine.shoot(origins, directions)
    shot = process_time()
    finish(Session().solve(ball_rig(level, image=lattice_image(PICTURE))))

    return {
        "build": built - started,
        "ray": (shot - shot_from) / N_RAYS * 1e6,
        "solve": process_time() - shot,
        "peak": peak(),
    }


def compare_engines(runs: int) -> None:
    """A line for each size and engine: the least of several runs, in which both take turns."""
    heads = f"{'build s':>8} {'us a ray':>9} {'solve s':>8} {'times Embree':>13} {'peak MB':>8}"
    print(f"{'triangles':<10} {'engine':<14} {heads}")
    for level in ENGINE_LEVELS:
        found = {name: [] for name in ENGINES}
        for _ in range(runs):
            for name in ENGINES:
                found[name].append(ask("--engine", name, "--level", str(level)))
        for name, each in found.items():
            least = {key: min(m[key] for m in each) for key in each[0]}
            ratio = statistics.median(
                m["solve"] / e["solve"] for m, e in zip(each, found["Embree"], strict=True)
            )
            print(
                f"{20 * 4**level:<10} {name:<14} {least['build']:8.3f} {least['ray']:9.2f}"
                f" {least['solve']:8.2f} {ratio:13.2f} {least['peak']:8.0f}",
                flush=True,
            )


def ask(*options: str) -> dict[str, object]:
    """Measurements of this script in another process."""
    command = [sys.executable, *as_module("bench.solve"), *options]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--runs", type=int, default=3, help="solves of each case; medians are shown"
    )
    parser.add_argument("--case", choices=CASES, help="measure one case here and print it as JSON")
    parser.add_argument(
        "--engines", action="store_true", help="Blender's BVH beside Embree instead"
    )
    parser.add_argument(
        "--engine", choices=ENGINES, help="measure one engine here and print it as JSON"
    )
    parser.add_argument(
        "--level", type=int, choices=ENGINE_LEVELS, default=5, help="how fine a ball for --engine"
    )
    parser.add_argument("--threads", type=int, default=0, help="0: as many as the machine has")
    arguments = parser.parse_args()
    loading.use_threads(arguments.threads)
    if arguments.engine:
        print(json.dumps(measure_engine(arguments.engine, arguments.level)))
        return

    if arguments.engines:
        compare_engines(arguments.runs)
        return

    if arguments.case:
        print(json.dumps(measure(arguments.case, arguments.runs)))
        return

    heads = (
        f"{'solve s':>8} {'repaint s':>9} {'moved s':>8} {'plan s':>7} {'trace s':>8}"
        f" {'shares s':>8} {'rays':>9} {'peak MB':>8}"
    )
    print(f"{'case':<40} {heads} {'told MB':>8}")

    options = ["--runs", str(arguments.runs), "--threads", str(arguments.threads)]
    for name in CASES:
        m = ask("--case", name, *options)
        print(
            f"{name:<40} {m['solve']:8.2f} {m['repaint']:9.3f} {m['moved']:8.2f}"
            f" {m['parts']['plan']:7.2f} {m['parts']['tracing']:8.2f} {m['parts']['shares']:8.2f}"
            f" {m['rays']:9d} {m['peak']:8.0f} {m['told']:8.0f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
