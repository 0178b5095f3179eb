"""Is every landing, view map and source image the same to the last bit? `dev.py hashes`.

A change that should leave all numbers as they are is run before and after, and the two outputs are
compared with `diff`. One line a rig: hashes of the landings of random rays, of the traced points of
the view map, of the weights of all display pixels and of the source image; with the kernel, then
without it. The two reference rigs have 512 x 512 pixels, glass as artists bring it has `--pixels`.
Numbers of one machine alone are compared: numpy's last bits differ between processors.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import nullcontext

import numpy as np

from kiriko.core.base.fingerprint import fingerprint
from kiriko.core.base.steps import run_steps
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.native import loading
from kiriko.core.rig.rig import Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known.reference_rigs import ball_rig, cube_rig, glass_rig

from .brought_glass import GLASSES, INDICES, made

N_RAYS = 20_000
DIGITS = 12
FEW = "wine glass", "Suzanne", "gem", "bottle", "scan"  # by default


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--glass", nargs="*", metavar="NAME", choices=GLASSES, default=list(FEW))
    parser.add_argument("--pixels", type=int, default=128, help="of the glasses' viewer, each way")
    parser.add_argument("--no-numpy", action="store_true", help="with the kernel alone")
    arguments = parser.parse_args()

    print(f"{'rig':<16}{'way':<8}{'landings':<14}{'points':<14}{'weights':<14}source")
    for name, a_rig in rigs(arguments):
        for way in ("kernel",) if arguments.no_numpy else ("kernel", "numpy"):
            with loading.off() if way == "numpy" else nullcontext():
                print(f"{name:<16}{way:<8}{'  '.join(hashes(a_rig))}", flush=True)


def rigs(arguments: argparse.Namespace) -> Iterator[tuple[str, Rig]]:
    """The reference rigs, and glasses on the bench for them, by name."""
    yield "ball", ball_rig()
    yield "cube", cube_rig()
    for name in arguments.glass:
        index = INDICES.get(name, 1.49)
        yield name, glass_rig(made(name), ior=index, pixels=arguments.pixels)


def hashes(a_rig: Rig) -> list[str]:
    """Of landings, points, weights and source image."""
    settings = Settings()
    viewer = a_rig.viewer
    places = np.random.default_rng(0).uniform(0, [viewer.width, viewer.height], (N_RAYS, 2))
    landings = trace_all(compile_plan(a_rig, settings), *viewer.rays(places))
    solution = run_steps(Session().solve(a_rig, settings))
    things = landings, solution.first.view_map.points, solution.weight, solution.source
    return [fingerprint(thing)[:DIGITS] for thing in things]


if __name__ == "__main__":
    main()
