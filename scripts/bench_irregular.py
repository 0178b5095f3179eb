"""Display error of irregular and noisy meshes by each choice of *Surface*, held to closed forms of what was meant.

`python3 scripts/dev.py irregular [--mesh NAME ...]`. Rays and errors are those of `dev.py surface`. Vertices are moved
by up to a part of an edge and put back onto the surface, and then off it as a scanner's are, by a part of the size;
normals are Blender's means. `curved` is the share of the triangles that *Automatic* follows as curved.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from bench_surface import BALL, OPTIONS, TORUS, judged
from numpy.typing import NDArray
from reference_rigs import icosphere, mean_normals, rig, torus

from kiriko.core.plan import Settings, make_plan
from kiriko.core.rig import Mesh, SurfaceChoice
from kiriko.core.trace import trace_all

Floats = NDArray[np.float64]

CHOICES: tuple[SurfaceChoice, ...] = ("facets", "smooth", "automatic")
ASIDE = (0.0, 0.1, 0.2, 0.3)  # of an edge
NOISE = (0.0, 1e-6, 1e-5, 3e-5, 1e-4, 1e-3, 1e-2)  # of the size
SEED = 6


def onto_ball(places: Floats) -> Floats:
    """The nearest places on the ball."""
    return BALL[0] * places / np.linalg.norm(places, axis=1, keepdims=True)


def onto_torus(places: Floats) -> Floats:
    """The nearest places on the torus around the y axis."""
    major, minor = TORUS
    ring = places * [1, 0, 1]
    ring *= major / np.linalg.norm(ring, axis=1, keepdims=True)
    out = places - ring
    return ring + minor * out / np.linalg.norm(out, axis=1, keepdims=True)


MESHES: dict[str, tuple[str, Callable[[], Mesh], Callable[[Floats], Floats]]] = {
    "ball, 1280": ("ball", lambda: icosphere(BALL[0], 3), onto_ball),
    "ball, 5120": ("ball", lambda: icosphere(BALL[0], 4), onto_ball),
    "torus, 4096": ("torus", lambda: torus(*TORUS, 64, 32), onto_torus),
}


@dataclass(frozen=True)
class Errors:
    """Errors of one choice of surface, display px, over the rays that arrived.

    lost : rays that did not; curved : share, 0..1, of the triangles that are followed as curved
    """

    median: float
    rms: float
    p99: float
    lost: int
    curved: float


def disturbed(name: str, aside: float, noise: float) -> Mesh:
    """A mesh whose vertices were moved on its surface and off it; mean normals."""
    _, make, onto = MESHES[name]
    mesh, random = make(), np.random.default_rng(SEED)
    edge = np.linalg.norm(mesh.corners[:, 1] - mesh.corners[:, 0], axis=1).mean()
    places = onto(mesh.vertices + aside * edge * random.uniform(-1, 1, mesh.vertices.shape))
    away = noise * np.ptp(mesh.bounds, axis=0).max() / 2
    normals = mesh.vertices.copy()
    normals[mesh.triangles] = mesh.corner_normals
    return mean_normals(replace(mesh, vertices=places + away * random.normal(size=(len(places), 1)) * normals))


def errors(name: str, mesh: Mesh, choice: SurfaceChoice) -> Errors:
    """How far a mesh is off by one choice of surface."""
    rays = judged(MESHES[name][0])
    plan = make_plan(rig(replace(mesh, surface=choice), **OPTIONS), Settings())
    px = np.linalg.norm(trace_all(plan, rays.origins, rays.directions).xy - rays.xy, axis=1)
    arrived = px[np.isfinite(px)]
    rms = float(np.sqrt((arrived**2).mean()))
    median, p99 = (float(np.quantile(arrived, q)) for q in (0.5, 0.99))
    return Errors(median, rms, p99, len(px) - len(arrived), sum(plan.n_curved) / len(mesh.triangles))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mesh", nargs="+", metavar="NAME", choices=MESHES, default=list(MESHES), help="only these")
    arguments = parser.parse_args()
    print(f"{'':<32}" + "".join(f"{choice:>30}" for choice in CHOICES))
    print(
        f"{'mesh':<14}{'aside':>8}{'noise':>8}  " + f"{'median':>10}{'rms':>10}{'99 % px':>10}" * 3 + f"{'curved':>9}"
    )
    worst = 0.0
    for name in arguments.mesh:
        cases = [(aside, 0.0) for aside in ASIDE] + [(0.0, noise) for noise in NOISE[1:]] + [(0.2, 1e-5), (0.2, 1e-3)]
        for aside, noise in cases:
            mesh = disturbed(name, aside, noise)
            drawn, smooth, automatic = (errors(name, mesh, choice) for choice in CHOICES)
            worst = max(worst, automatic.rms / min(drawn.rms, smooth.rms))
            told = "".join(f"{e.median:10.3g}{e.rms:10.3g}{e.p99:10.3g}" for e in (drawn, smooth, automatic))
            print(f"{name:<14}{aside:8g}{noise:8g}  {told}{automatic.curved:9.3f}", flush=True)
    print(f"\nAutomatic is at most {worst:.2f} times as far off, rms, as the better of the other two.")


if __name__ == "__main__":
    main()
