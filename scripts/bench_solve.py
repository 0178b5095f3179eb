"""Seconds and peak memory of whole solves, each in a process of its own: `dev.py bench`."""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import subprocess
import sys
from time import perf_counter

import closed_forms
import numpy as np
from reference_rigs import ball_rig, box, cube_rig, icosphere, lattice_image, rig

from kiriko.core.plan import Settings, make_plan
from kiriko.core.session import Session, finish
from kiriko.core.trace import trace_all

PICTURE = 1024
CASES = {
    "ball, 20 k triangles, 512 -> 512": lambda: ball_rig(5, image=lattice_image(PICTURE)),
    "ball, 1.3 M triangles, 512 -> 512": lambda: ball_rig(8, image=lattice_image(PICTURE)),
    "cube, 512 -> 512": lambda: cube_rig(image=lattice_image(PICTURE)),
    "ball, 20 k triangles, 512 -> 4096": lambda: ball_rig(5, display_pixels=4096, image=lattice_image(PICTURE)),
    "ball, 20 k triangles, 4096 -> 512": lambda: ball_rig(5, pixels=4096, image=lattice_image(PICTURE)),
    "slab, 512 -> 512": lambda: rig(box([0.3, 0.03, 0.3]), image=lattice_image(PICTURE)),
}


def measure(name: str, runs: int) -> dict[str, object]:
    """Solve from scratch `runs` times, then paint another picture as often."""
    a_rig = CASES[name]()
    whole, again, parts = [], [], []
    for _ in range(runs):
        session = Session()
        started = perf_counter()
        solution = finish(session.solve(a_rig))
        whole.append(perf_counter() - started)
        parts.append(solution.seconds)
        a_rig.picture.image[:] = np.flip(a_rig.picture.image, 0).copy()
        started = perf_counter()
        finish(session.solve(a_rig))
        again.append(perf_counter() - started)
    return {
        "solve": statistics.median(whole),
        "repaint": statistics.median(again),
        "parts": {part: statistics.median(p[part] for p in parts) for part in parts[0]},
        "rays": solution.n_rays,
        "shares": len(solution.shares),
        "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6,
    }


def accuracy() -> None:
    """Print the error of meshes with the surface's own normals against closed forms, rms in display px."""
    shapes = {"ball": ((0.025,) * 3, {"picture": 0.03}), "ellipsoid": ((0.025, 0.020, 0.015), {"picture": 0.015})}
    print(f"{'triangles':>9} " + " ".join(f"{name:>10}" for name in shapes))
    for levels in (3, 4, 5, 6):
        errors = []
        for radii, options in shapes.values():
            a_rig = rig(icosphere(radii, levels), **options)
            x, y = np.meshgrid(np.arange(0, 513, 2.0), np.arange(0, 513, 2.0))
            o, d = a_rig.viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1))
            landings = trace_all(make_plan(a_rig, Settings()), o, d)
            exact = closed_forms.landing(a_rig, *closed_forms.through_ellipsoid(o, d, radii, 1.49))
            known = landings.has_arrived & np.isfinite(exact[:, 0])
            errors.append(np.sqrt(((landings.xy - exact)[known] ** 2).sum(axis=1).mean()))
        print(f"{20 * 4**levels:9d} " + " ".join(f"{error:10.4f}" for error in errors))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3, help="solves of each case; medians are shown")
    parser.add_argument("--case", choices=CASES, help="measure one case here and print it as JSON")
    parser.add_argument("--accuracy", action="store_true", help="print the error of meshes against closed forms")
    arguments = parser.parse_args()
    if arguments.accuracy:
        accuracy()
        return
    if arguments.case:
        print(json.dumps(measure(arguments.case, arguments.runs)))
        return
    print(f"{'case':<36} {'solve s':>8} {'repaint s':>9} {'trace s':>8} {'shares s':>8} {'rays':>9} {'peak MB':>8}")
    for name in CASES:
        command = [sys.executable, __file__, "--case", name, "--runs", str(arguments.runs)]
        m = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        print(
            f"{name:<36} {m['solve']:8.2f} {m['repaint']:9.3f} {m['parts']['tracing']:8.2f} {m['parts']['shares']:8.2f}"
            f" {m['rays']:9d} {m['peak']:8.0f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
