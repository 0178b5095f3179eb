"""The systems of Add Rig > More, solved and judged: `dev.py benches`.

Add Rig builds each system with a lattice of 7 x 7 dots as its picture, and Cycles renders what the
viewer sees. `before` and `after`: mean displacement of the dots, viewer px, 1165 px across, with
the plain picture and with the source image on the display. A second row has distances of landings,
display px, from those of the system's surfaces in closed form (tests/known/sequences.py).
Plates of mirrors are judged as ideal ones, since mirrors blur the dots. `brightness`: share of the
display's light that reaches the viewer. `times`: seconds per surface that the light meets, over the
ball's. A mark is missed above 0.25 px, with fewer than 49 dots, or with less than 99 % of the
picture covered; in a second row above 0.1 px.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from functools import cache
from time import perf_counter

import bpy
import numpy as np

from known.registered import registered
from known.sequences import SEQUENCES, landings
from paper.lattice import shift_in_cycles

registered()

from kiriko.core.base.steps import run_steps  # noqa: E402 - the operators have to be there first
from kiriko.core.bench.systems import SYSTEMS  # noqa: E402
from kiriko.core.blender.read.scene import Reading  # noqa: E402
from kiriko.core.light.rays import main_landings  # noqa: E402
from kiriko.core.light.trace import trace_all  # noqa: E402
from kiriko.core.rig.settings import Settings  # noqa: E402
from kiriko.core.solve.session import Session  # noqa: E402
from kiriko.core.solve.solution import Solution, without_glass  # noqa: E402
from kiriko.operators import work  # noqa: E402

from .runner import MISSED, Bench, Row, run  # noqa: E402

MOST_PX = 0.25  # of 1165
LEAST_COVERED = 0.99
MOST_OFF = 0.1  # display px, from the closed form; meshes of balls and cylinders are curved
SAMPLES, SPLIT_SAMPLES = 4, 16  # of a viewer pixel in Cycles: light that splits is noisy
IN_GLASS = "IN_GLASS"


def built(kind: str) -> Reading:
    """The rig of a kind, in a new file, as read."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.kiriko.add_rig(kind=kind)
    return work.read(bpy.context)


def with_ideal_plates() -> Reading:
    """The rig as read with ideal plates, whose image is at the same place."""
    for thing in bpy.context.scene.objects:
        thing.kiriko.plate.model = "IDEAL"
    return work.read(bpy.context)


def solved(reading: Reading, rounds: int = 3) -> tuple[Solution, float]:
    """A solution, and the median of its seconds in new sessions."""
    settings = work.settings_of(bpy.context.scene)
    seconds = []
    for _ in range(rounds):
        started = perf_counter()
        solution = run_steps(Session().solve(reading.rig, settings))
        seconds.append(perf_counter() - started)
    return solution, float(np.median(seconds))


def n_surfaces(solution: Solution) -> float:
    """Median number of surfaces that light meets on its way to the display."""
    plan = solution.first.plan
    n = 64
    view = np.random.default_rng(0).uniform(0, (plan.viewer.width, plan.viewer.height), (n * n, 2))
    found = main_landings(trace_all(plan, *plan.viewer.rays(view)), n * n)
    return float(np.median(found.n_events[found.has_arrived]))


@cache
def ball() -> float:
    """Seconds of the ball's solve for each surface."""
    solution, seconds = solved(built(IN_GLASS))
    return seconds / n_surfaces(solution)


def measure(kind: str, _: object, arguments: argparse.Namespace) -> Iterator[Row]:
    """Build, solve and judge a system."""
    of_ball = ball()
    reading = built(kind)
    solution, seconds = solved(reading)
    split, plate = solution.first.split, solution.first.plate
    brightness = split.brightness if split else plate and plate.brightness
    if plate:
        reading = with_ideal_plates()
        solution, _ = solved(reading, 1)
    ideal, seen = solution.ideal(), solution.seen()
    scene = bpy.context.scene
    samples = SPLIT_SAMPLES if split else SAMPLES
    after = shift_in_cycles(scene, reading, solution.image, ideal, seen, samples)
    before = None
    if reading.rig.glasses and not any(glass.reflects for glass in reading.rig.glasses):
        plain = run_steps(
            Session().solve(without_glass(reading.rig), Settings(only_through_glass=False))
        ).source
        bent = solution.seen(plain)
        before = shift_in_cycles(scene, reading, plain, ideal, bent, samples).mean
    times = seconds / (of_ball * n_surfaces(solution))
    is_met = after.mean < MOST_PX and after.n_seen == 49
    is_met &= solution.picture_coverage > LEAST_COVERED
    yield {
        "judge": "Cycles",
        "before": before,
        "after": after.mean,
        "largest": after.largest,
        "covered %": 100 * solution.picture_coverage,
        "brightness": brightness,
        "stray": split.stray if split else None,
        "s": seconds,
        "times": times,
        "mark": "met" if is_met else MISSED,
    }
    if kind in SEQUENCES:
        yield {"judge": "sequence", **by_sequence(kind, solution)}


def by_sequence(kind: str, solution: Solution) -> Row:
    """Distance of landings from those of the system's surfaces, for rays through the picture."""
    plan = solution.first.plan
    corners = plan.rig.picture_place.mesh.corners[0]
    weights = np.random.default_rng(0).dirichlet(np.ones(3), 4096)
    o, d = plan.viewer.rays(plan.viewer.project(weights @ corners))
    found = main_landings(trace_all(plan, o, d), len(o))
    off = np.abs(found.xy - landings(kind, plan.rig, o, d)).max(axis=1)
    mark = "met" if off.max() < MOST_OFF else MISSED
    return {"after": float(off.mean()), "largest": float(off.max()), "mark": mark}


BENCH = Bench(
    cases={kind: None for kind in SYSTEMS},
    columns={
        "judge": "", "before": ".2f", "after": ".3f", "largest": ".3f", "covered %": ".2f",
        "brightness": ".3f", "stray": ".3f", "s": ".2f", "times": ".2f", "mark": "",
    },
    measure=measure,
)  # fmt: skip

if __name__ == "__main__":
    run(__doc__, "bench.benches", BENCH)
