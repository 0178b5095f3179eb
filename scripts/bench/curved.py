"""The cost of curved faces for a ray, beside the same mesh as
drawn: `dev.py curved`. Processor seconds, in turns.
"""

import argparse
import statistics
from dataclasses import replace
from time import process_time

import numpy as np

from kiriko.core.light.compile_plan import make_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.settings import Settings
from known.reference_rigs import (
    bottle,
    icosphere,
    mean_normals,
    rig,
    torus,
    uv_ellipsoid,
    wavy_slab,
)

N_RAYS = 60_000
PIXELS = 256
MESHES = {
    "ball, 20 k triangles": lambda: icosphere(0.025, 5),
    "ellipsoid, 32 x 16 faces": lambda: mean_normals(uv_ellipsoid((0.025, 0.02, 0.015), 32, 16)),
    "ellipsoid, 320 x 160 faces": lambda: mean_normals(
        uv_ellipsoid((0.025, 0.02, 0.015), 320, 160)
    ),
    "torus, 32 x 16 faces": lambda: mean_normals(torus(0.018, 0.007)),
    "wavy slab, 32 x 16 faces": lambda: mean_normals(wavy_slab()),
    "bottle, 33 k triangles": bottle,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    arguments = parser.parse_args()
    print(f"{N_RAYS} rays\n{'mesh':<28} {'curved s':>9} {'drawn s':>9} {'ratio':>7}")

    for name, make in MESHES.items():
        rigs = [
            rig(replace(make(), surface=surface), pixels=PIXELS) for surface in ("smooth", "facets")
        ]
        plans = [make_plan(a_rig, Settings()) for a_rig in rigs]
        rays = rigs[0].viewer.rays(np.random.default_rng(0).uniform(0, PIXELS, (N_RAYS, 2)))
        times = []
        for _ in range(arguments.runs):
            seconds = []
            for plan in plans:
                started = process_time()
                trace_all(plan, *rays)
                seconds.append(process_time() - started)
            times.append(seconds)
        curved, drawn = (statistics.median(column) for column in zip(*times, strict=True))
        ratio = statistics.median(a / b for a, b in times)
        print(f"{name:<28} {curved:9.3f} {drawn:9.3f} {ratio:7.2f}", flush=True)


if __name__ == "__main__":
    main()
