"""Seconds and peak memory of whole solves, each in a process of its own: `dev.py bench`."""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import subprocess
import sys
from dataclasses import replace
from time import perf_counter

import numpy as np
from reference_rigs import ball_rig, box, cube_rig, icosphere, lattice_image, rig

from kiriko.core.session import Session, finish

PICTURE = 1024
CASES = {
    "ball, 20 k triangles, 512 -> 512": lambda: ball_rig(5, image=lattice_image(PICTURE)),
    "the same as drawn": lambda: rig(replace(icosphere(0.025, 5), surface="facets"), image=lattice_image(PICTURE)),
    "ball, 1 k triangles, 512 -> 512": lambda: ball_rig(3, image=lattice_image(PICTURE)),
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3, help="solves of each case; medians are shown")
    parser.add_argument("--case", choices=CASES, help="measure one case here and print it as JSON")
    arguments = parser.parse_args()
    if arguments.case:
        print(json.dumps(measure(arguments.case, arguments.runs)))
        return
    heads = f"{'solve s':>8} {'repaint s':>9} {'plan s':>7} {'trace s':>8} {'shares s':>8} {'rays':>9} {'peak MB':>8}"
    print(f"{'case':<36} {heads}")
    for name in CASES:
        command = [sys.executable, __file__, "--case", name, "--runs", str(arguments.runs)]
        m = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        print(
            f"{name:<36} {m['solve']:8.2f} {m['repaint']:9.3f} {m['parts']['plan']:7.2f}"
            f" {m['parts']['tracing']:8.2f} {m['parts']['shares']:8.2f}"
            f" {m['rays']:9d} {m['peak']:8.0f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
