"""How time and rays grow with display pixels, viewer pixels, triangles and viewers, on the ball:
`dev.py growth`.

Slopes are of straight lines in logarithms. Each solve is from scratch but for the ray engine, which
is kept; of several viewers, of which there are 1, 2, 9 and 49, that is not kept, either. Exits with
1 where rays or time do not grow in proportion to these: the marks of `dev.py eyes`.
"""

import argparse
import statistics
import sys
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from bench.eyes import growth as by_viewers
from kiriko.core.base.steps import finish
from kiriko.core.rig.rig import Rig
from kiriko.core.solve.session import Session
from known.reference_rigs import ball_rig, lattice_image

PICTURE = 1024


def measure(a_rig: Rig, runs: int) -> tuple[float, float, int]:
    """Median seconds of a solve and of its tracing, and rays.

    The viewer is moved by a hair before each.
    """
    session = Session()
    solve = []
    tracing = []
    finish(session.solve(a_rig))

    for _ in range(runs):
        viewer = a_rig.viewer
        a_rig = replace(
            a_rig, viewers=(replace(viewer, position=viewer.position + np.array([1e-6, 0, 0])),)
        )
        solution = finish(session.solve(a_rig))
        solve.append(sum(solution.seconds.values()))
        tracing.append(solution.seconds["tracing"])

    return statistics.median(solve), statistics.median(tracing), solution.n_rays


def table(head: str, cases: Iterable[tuple[int, Rig]], runs: int) -> None:
    """A line for each size, and the slopes against it."""
    print(f"{head:<18} {'solve s':>8} {'trace s':>8} {'rays':>9}")
    found = []
    for size, a_rig in cases:
        found.append((size, *measure(a_rig, runs)))
        print(f"{size:<18} {found[-1][1]:8.3f} {found[-1][2]:8.3f} {found[-1][3]:9d}", flush=True)
    sizes, *columns = np.log(np.array(found)).T
    slopes = [np.polyfit(sizes, column, 1)[0] for column in columns]
    print(f"{'slope':<18} {slopes[0]:8.2f} {slopes[1]:8.2f} {slopes[2]:9.2f}\n")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument(
        "--most", type=int, default=4096, help="largest side of display and viewer, px"
    )
    parser.add_argument(
        "--pixels", type=int, default=256, help="of several viewers and their display, each way"
    )
    tables = ("display", "viewer", "triangles", "viewers")
    parser.add_argument("--only", nargs="+", choices=tables, default=tables, metavar="TABLE")
    arguments = parser.parse_args()
    image = lattice_image(PICTURE)
    sides = [256 * 2**k for k in range(5) if 256 * 2**k <= arguments.most]
    cases = {
        "display": (
            "display pixels",
            ((n * n, ball_rig(5, display_pixels=n, image=image)) for n in sides),
        ),
        "viewer": ("viewer pixels", ((n * n, ball_rig(5, pixels=n, image=image)) for n in sides)),
        "triangles": ("triangles", ((20 * 4**k, ball_rig(k, image=image)) for k in range(3, 9))),
    }
    for name, (head, rigs) in cases.items():
        if name in arguments.only:
            table(head, rigs, arguments.runs)
    is_right = "viewers" not in arguments.only or by_viewers(arguments.runs, arguments.pixels)
    sys.exit(0 if is_right else 1)


if __name__ == "__main__":
    main()
