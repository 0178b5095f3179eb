"""Updates per second of Live, and its longest single steps, on balls and a wine glass: `dev.py
live`.

Drawing in the interface comes on top. The measurements of the final picture run after it is shown,
while nothing changes, so they count only for the column *whole s*. `late`: fraction of the turns
that took more than 0.1 s. `x`: final pictures a second, times the seconds of a whole solve of the
reference ball on one thread in the same run; a row with less than MARKS says so, and the bench ends
with 1. `--machine`: this solve alone, to compare machines.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable, Iterator
from time import perf_counter
from typing import NamedTuple

import bpy

from known.reference_rigs import ball_rig
from known.registered import registered

from . import brought_glass as glasses
from .runner import MISSED, Bench, Row, in_turns, option, run

registered()

from kiriko.core.base.steps import run_steps  # noqa: E402 - the operators have to be there first
from kiriko.core.native import loading  # noqa: E402
from kiriko.core.solve.session import Session  # noqa: E402
from kiriko.operators import live  # noqa: E402


def ball(segments: int, rings: int) -> None:
    """A ball of the reference rig's size, of another mesh."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=segments, ring_count=rings, radius=0.025)
    bpy.ops.object.shade_smooth()


def wine_glass() -> None:
    """A whole one, modifiers and all."""
    thing = glasses.wine_glass()
    thing.select_set(True)
    bpy.context.view_layer.objects.active = thing


BALL = {"field": 0.05, "picture_size": 0.03, "display_size": 0.05}
MIDDLE = 0.1  # m, of the whole glass's height, where a rig puts it
# as on the bench of `dev.py marks`
BOWL = {"field": 0.06, "picture_size": 0.035, "display_size": 0.1}
# by triangles; m, how far the glass is lowered to put its bowl in the middle
GLASS = {
    "20 k": (lambda: ball(100, 103), BALL, 0.0),
    "100 k": (lambda: ball(224, 225), BALL, 0.0),
    "wine glass": (wine_glass, BOWL, glasses.BOWLS["wine glass"] - MIDDLE),
}
MARKS = {"20 k": 6.0, "wine glass": 3.0}  # of a viewer that moves
BLOCKING = 0.1  # s, limit of each step after the first build


class Update(NamedTuple):
    """Seconds until the first and the last picture, and all numbers; of each turn; and the longest
    step of each kind.
    """

    first: float
    last: float
    whole: float
    turns: list[float]
    longest: dict[str, float]


def row_of(change: str, updates: list[Update]) -> Row:
    """A row of the table."""
    first, last, whole = (statistics.median(update[k] for update in updates) for k in range(3))
    turns = [seconds for update in updates for seconds in update.turns]
    worst, kind = max((s, kind) for update in updates for kind, s in update.longest.items())
    return {
        "change": change,
        "first /s": 1 / first,
        "final /s": 1 / last,
        "first s": first,
        "final s": last,
        "whole s": whole,
        "longest ms": 1000 * worst,
        "late %": 100 * sum(seconds > BLOCKING for seconds in turns) / len(turns),
        "longest step": kind,
    }


def rig_of(
    make: Callable[[], None], sizes: dict[str, float], lower: float, pixels: int
) -> dict[str, bpy.types.Object]:
    """A rig around a glass; the objects by role, and the viewer."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    make()
    bpy.ops.kiriko.add_rig(**sizes, viewer_resolution=pixels, display_resolution=(pixels, pixels))
    by_role = {thing.kiriko.role: thing for thing in bpy.context.scene.objects}
    by_role["VIEWER"] = bpy.context.scene.camera
    by_role["GLASS"].location.z -= lower
    return by_role


def update() -> Update:
    """Step Live until it has nothing left to do, as the timer would without waiting."""
    followed = live.followed() or live.start(bpy.context.scene)
    followed.longest.clear()
    n_pictures = followed.n_pictures
    started = perf_counter()
    shown, turns = [], []
    wait = 0.0
    while wait != live.live_follower.IDLE:
        turn = perf_counter()
        wait = live.tick()
        turns.append(perf_counter() - turn)
        if followed.n_pictures > n_pictures:
            n_pictures = followed.n_pictures
            shown.append(perf_counter() - started)
    if not shown:
        raise SystemExit(f"Nothing was updated: {live.status()[0]}")
    whole = perf_counter() - started
    return Update(shown[0], shown[-1], whole, turns, dict(followed.longest))


def move(name: str) -> Callable[[dict[str, bpy.types.Object], int], None]:
    """Move an object of the rig a little to and fro, further each time."""

    def apply(rig: dict[str, bpy.types.Object], n: int) -> None:
        rig[name].location.x += 1e-5 * (n + 1) * (-1) ** n
        bpy.context.view_layer.update()

    return apply


def margin(rig: dict[str, bpy.types.Object], n: int) -> None:
    """Another margin: the optics stay."""
    bpy.context.scene.kiriko.margin = 1 + n % 2


CHANGES = {
    "viewer moved": move("VIEWER"),
    "glass moved": move("GLASS"),
    "margin (optics unchanged)": margin,
}


def measure(name: str, case: tuple, arguments: argparse.Namespace) -> Iterator[Row]:
    """The first build, then updates of each kind."""
    whole = seconds_of_ball()
    rig = rig_of(*case, arguments.pixels)
    yield row_of("first build", [update()])
    for change, apply in CHANGES.items():
        updates = []
        for n in range(arguments.updates):
            apply(rig, n)
            updates.append(update())
        row = row_of(change, updates)
        row["x"] = row["final /s"] * whole
        if change == "viewer moved" and name in MARKS:
            row["mark"] = "kept" if row["x"] >= MARKS[name] else MISSED
        yield row
    live.stop()


def seconds_of_ball() -> float:
    """Seconds of a whole solve of the reference ball on one thread: by it machines are compared."""
    a_rig = ball_rig()
    loading.use_threads(1)
    seconds, _ = in_turns({"": lambda: run_steps(Session().solve(a_rig))}, 5)
    loading.use_threads(0)
    return seconds[""]


def measure_machine(name: str, _: None, arguments: argparse.Namespace) -> Iterator[Row]:
    """The whole solve alone."""
    yield {"change": "a whole solve, one thread", "final s": seconds_of_ball()}


COLUMNS = {
    "change": "", "first /s": ".2f", "final /s": ".2f", "first s": ".3f", "final s": ".3f",
    "whole s": ".3f", "longest ms": ".0f", "late %": ".1f", "longest step": "", "x": ".2f",
    "mark": "s",
}  # fmt: skip

if __name__ == "__main__":
    run(
        __doc__,
        "bench.live",
        Bench(GLASS, COLUMNS, measure),
        option("--updates", type=int, default=20, help="of each kind; medians are shown"),
        option("--pixels", type=int, default=512, help="a side, of viewer and display"),
        machine=Bench({"reference ball": None}, COLUMNS, measure_machine),
    )
