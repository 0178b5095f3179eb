"""What several viewers of one display ask of it, what each sees, and what they cost: `dev.py eyes`.

Tables, on the ball of 50 mm, a metre away from its viewers, who look at the picture's middle:

growth : time and rays for 1, 2, 9 and 49 viewers. Mark: rays grow in proportion to the viewers
    (slope in logarithms 0.95 to 1.05), time by no more than 1.15.
agree : with index 1 viewers ask for the same. Mark: conflict below 1e-9 picture px, by
    orthographic viewers, whose maps are affine.
conflict : by the distance between two eyes: the deviation of what they ask of a display pixel
    (mean and largest, picture px), and which way to settle it has the higher PSNR and MTF50.
settled : sharp and blended, two eyes of 64 mm and a 3 x 3 grid of 60 mm: for each viewer coverage,
    displacement of 7 x 7 points (viewer px, arcmin), PSNR against the ideal, the error that no
    source image removes (rms, linear), and the MTF50 of a slanted edge (cycles / viewer px).
    Mark: where the seen image of a lattice of dots can be measured, its dots are displaced as
    predicted, to 0.05 px on the mean.
pair : at which depth two eyes of 64 mm see 7 x 7 points of the picture, mm before its plane, and
    their vertical disparity, arcmin: uncompensated, solved for one eye, for both. Mark: with index
    1 the depth is the plane's, to 1e-9 m.
beside : the paper's question: by how many arcmin 7 x 7 points are off (mean, largest), as seen from
    some degrees beside the viewer, by the picture's size: uncompensated, solved for the middle, and
    for all of these places. *Gain* is the mean uncompensated over that of the middle, of all.
box : the same over a box of 60 mm, solved for its middle and for 3 x 3 viewers in it.
ends : how far the head may go each way, mm, by the eye box and by a walk in steps of a half per
    cent that looks at all points at each: before the picture is off by 1 and by 5 arcmin, or a
    fiftieth of it is gone. Mark: both within 2 %.

`--cycles` compares predictions with renders instead: see eyes_in_cycles.py.
"""

from __future__ import annotations

import argparse
import statistics
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from environments import run_in_newest_blender
from kiriko.core.base.steps import finish
from kiriko.core.image.seen_image import dot_centroids
from kiriko.core.lab.atlas.heads import evenly, viewer_at
from kiriko.core.lab.measure.eye_box import WAYS, Walk
from kiriko.core.lab.measure.eye_box_curves import NAMES
from kiriko.core.lab.measure.head_box import off_by
from kiriko.core.lab.measure.places_seen import Look, grid_of, places_shown
from kiriko.core.lab.measure.sharpness import sharpness
from kiriko.core.lab.measure.two_eyes import TwoEyes, two_eyes
from kiriko.core.lab.measure.viewer_errors import ViewerReport, displaced, viewer_reports
from kiriko.core.light.compile_plan import make_plan
from kiriko.core.rig.rig import Rig, Viewer
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import Solution, without_glass
from known.reference_rigs import ball_rig, lattice_image

SIDES = {1: (1, 1), 2: (2, 1), 9: (3, 3), 49: (7, 7)}  # of grids, by the number of viewers
BOX = 0.06  # m, side of the grids
EYES = 0.064  # m
APART = (0.001, 0.004, 0.016, 0.064)  # m, between two eyes
MOST_RAYS = 0.05  # by which the slope of rays may differ from 1
MOST_TIME = 1.15  # slope
MOST_CONFLICT = 1e-9  # picture px
MOST_OFF = 0.05  # viewer px, mean over the dots, of the prediction from the seen image
MOST_DEPTH = 1e-9  # m, with index 1
PICTURES = (0.01, 0.02, 0.03)  # m, sides
DEGREES = (0.0, 2.0, 5.0, 10.0)  # beside the viewer that is solved for
LIMITS = (1.0, 5.0)  # arcmin
STEP = 0.005  # of the eye box's end, of a walk
MOST_BESIDE = 0.02  # of the walk's end


def grid(a_rig: Rig, n: int, m: int, side: float = BOX) -> Rig:
    """The rig with n x m viewers, right and up, in a square around its own."""
    viewers = tuple(
        replace(
            viewer_at(a_rig.viewer, a_rig.picture_place, offset),
            name=f"{1e3 * offset[0]:+.0f} {1e3 * offset[1]:+.0f}",
        )
        for offset in evenly((n, m, 1), (side, side, side))
    )
    return replace(a_rig, viewers=viewers)


def solved(a_rig: Rig, **settings: object) -> Solution:
    """A solve in a session of its own."""
    return finish(Session().solve(a_rig, Settings(**settings)))


def growth(runs: int, pixels: int) -> bool:
    """Time and rays by the number of viewers; are they within the marks?"""
    print(f"{'viewers':<10} {'solve s':>8} {'trace s':>8} {'s each':>8} {'rays':>10}")
    a_rig = ball_rig(5, pixels=pixels, display_pixels=pixels, image=lattice_image(512))
    found = []
    for n, sides in SIDES.items():
        many = grid(a_rig, *sides)
        taken = [solved(many) for _ in range(runs)]
        seconds = statistics.median(sum(one.seconds.values()) for one in taken)
        tracing = statistics.median(one.seconds["tracing"] for one in taken)
        found.append((n, seconds, tracing, taken[0].n_rays))
        print(f"{n:<10} {seconds:8.2f} {tracing:8.2f} {seconds / n:8.2f} {found[-1][3]:10d}")

    viewers, *columns = np.log(np.array(found)).T
    solve, trace, rays = (np.polyfit(viewers, column, 1)[0] for column in columns)
    print(f"{'slope':<10} {solve:8.2f} {trace:8.2f} {'':8} {rays:10.2f}\n")
    return mark("rays", abs(rays - 1) < MOST_RAYS) & mark("time", solve < MOST_TIME)


def agree() -> bool:
    """Do all viewers ask for the same where the glass does not bend light?"""
    a_rig = ball_rig(
        3, ior=1.0, pixels=96, display_pixels=96, image=lattice_image(512), display=0.02,
        projection="orthographic", field=0.06,
    )  # fmt: skip
    viewer = a_rig.viewer
    viewers = tuple(turned(viewer, angle) for angle in (-0.05, 0.0, 0.05))
    conflict = solved(replace(a_rig, viewers=viewers)).settled.conflict
    print(f"index 1, three viewers: conflict {conflict.max():.1e} picture px at most")
    return mark("agree", conflict.max() < MOST_CONFLICT)


def turned(viewer: Viewer, angle: float) -> Viewer:
    """A viewer that stands to the right of another by an angle, as seen from the origin."""
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    name = f"{np.degrees(angle):+.1f} degrees"
    return replace(viewer, name=name, position=turn @ viewer.position, axes=viewer.axes @ turn.T)


def conflict(pixels: int) -> bool:
    """What two eyes disagree on, and 3 x 3 heads, by their distance."""
    a_rig = ball_rig(5, pixels=pixels, display_pixels=pixels, image=lattice_image(512))
    for name, n, m in (("two eyes", 2, 1), ("3 x 3", 3, 3)):
        print(f"\n{f'{name}, apart mm':<18} {'conflict px':>12} {'largest':>9}", end="")
        print(f" {'sharp dB':>9} {'blended dB':>11} {'sharp MTF50':>12} {'blended':>8}")
        for apart in APART:
            many = grid(a_rig, n, m, (n - 1) * apart)
            print_ways(f"{1e3 * apart:.0f}", many)
    return True


def print_ways(name: str, many: Rig) -> None:
    """Print a line on both ways to settle what viewers disagree on."""
    sharp, blended = (solved(many, disagreement=way) for way in ("sharp", "blended"))
    of = sharp.settled.conflict[sharp.settled.conflict > 0]
    decibels = [
        statistics.mean(report.psnr for report in finish(viewer_reports(solution)))
        for solution in (sharp, blended)
    ]
    edges = [statistics.mean(known(edges_of(many, way))) for way in ("sharp", "blended")]
    print(
        f"{name:<18} {of.mean():12.3f} {of.max():9.3f} {decibels[0]:9.2f} {decibels[1]:11.2f}"
        f" {edges[0]:12.3f} {edges[1]:8.3f}",
        flush=True,
    )


def settled(pixels: int) -> bool:
    """What each of two eyes and of nine viewers sees."""
    a_rig = ball_rig(5, pixels=pixels, display_pixels=pixels, image=lattice_image(512))
    is_right = True
    for name, many in (
        ("two eyes", grid(a_rig, 2, 1, EYES)),
        ("3 x 3", grid(a_rig, 3, 3)),
    ):
        for way in ("sharp", "blended"):
            solution = solved(many, disagreement=way)
            off = [predicted_beside_seen(solution, k) for k in range(len(many.viewers))]
            print(f"\n{name}, {way}")
            print(*lines(finish(viewer_reports(solution))), sep="\n", flush=True)
            edges = known(edges_of(many, way))
            print(
                f"MTF50: {min(edges):.3f} to {max(edges):.3f} cycles / viewer px, of {len(edges)}"
            )
            off = [one for one in off if np.isfinite(one)]
            print(f"dots beside their prediction: {np.mean(off):.3f} px on the mean")
            is_right &= mark(f"{name}, {way}", np.mean(off) < MOST_OFF)
    return is_right


def edges_of(many: Rig, way: str) -> tuple[float | None, ...]:
    """MTF50 of a slanted edge, cycles / viewer px, as each viewer sees it."""
    return finish(sharpness(Session(), many, Settings(disagreement=way)))


def known(values: tuple[float | None, ...]) -> list[float]:
    """Those that could be measured; NaN alone where none could."""
    return [value for value in values if value is not None] or [np.nan]


def pair(pixels: int) -> bool:
    """At which depth two eyes see the picture, and what of their lines of sight does not meet."""
    plain = ball_rig(5, ior=1.0, pixels=pixels, display_pixels=pixels)
    bare = seen_by_two(plain)
    off = max(float(np.nanmax(np.abs(bare.for_both.depth))), abs(bare.for_left.farthest_depth))
    print(f"\nindex 1: depth {off:.1e} m at most")
    for side in PICTURES:
        a_rig = ball_rig(5, pixels=pixels, display_pixels=pixels, picture=side)
        found = seen_by_two(a_rig)
        print(f"\n{f'picture {1e3 * side:.0f} mm':<15} {'points':>6} {'depth':>7}", end="")
        print(f" {'nearest':>8} {'farthest':>9} {'vertical':>9} {'largest':>8}", end="")
        print(f" {'horizontal':>11} {'largest':>8}")
        for name in ("uncompensated", "for_left", "for_right", "for_both"):
            sights = getattr(found, name)
            depths = sights.mean_depth, sights.nearest_depth, sights.farthest_depth
            mean, nearest, farthest = (1e3 * depth for depth in depths)
            print(
                f"{name:<15} {sights.is_seen.sum():6d} {mean:7.2f} {nearest:8.2f} {farthest:9.2f}"
                f" {sights.mean_vertical:9.2f} {sights.largest_vertical:8.2f}"
                f" {sights.mean_horizontal:11.2f} {sights.largest_horizontal:8.2f}",
                flush=True,
            )
    return mark("depth", off < MOST_DEPTH)


def seen_by_two(a_rig: Rig) -> TwoEyes:
    """How two eyes in place of the viewer of a rig see it."""
    return finish(two_eyes(grid(a_rig, 2, 1, EYES), Settings()))


def beside(pixels: int) -> bool:
    """What compensation gains beside the viewer that it is made for."""
    for side in PICTURES:
        a_rig = ball_rig(5, pixels=pixels, display_pixels=pixels, picture=side, display=0.1)
        ways = ways_to_show(a_rig, [turned(a_rig.viewer, np.radians(a)) for a in DEGREES])
        print(
            f"\n{f'picture {1e3 * side:.0f} mm':<15}", *(f"{name:>22}" for name in ways), "  gain"
        )
        for angle in DEGREES:
            head = turned(a_rig.viewer, np.radians(angle))
            plain, *means = print_off(f"{angle:.0f} degrees", ways, head)
            gains = [plain / mean if mean > 1e-9 else float("inf") for mean in means]
            print(*(f"{gain:7.2f}" for gain in gains), flush=True)
    return True


def box(pixels: int) -> bool:
    """What solving for a box of places gives beside solving for its middle."""
    a_rig = ball_rig(5, pixels=pixels, display_pixels=pixels, display=0.1)
    ways = ways_to_show(a_rig, grid(a_rig, 3, 3).viewers)
    print(f"\n{'box 60 mm':<15}", *(f"{name:>22}" for name in ways))
    for x in np.linspace(-BOX / 2, BOX / 2, 7):
        for y in (0.0, BOX / 2):
            head = viewer_at(a_rig.viewer, a_rig.picture_place, (x, y, 0.0))
            print_off(f"{1e3 * x:+.0f} {1e3 * y:+.0f}", ways, head)
            print(flush=True)
    return True


def ends(pixels: int) -> bool:
    """How far the head may go, beside a walk by steps."""
    a_rig = ball_rig(5, pixels=pixels, display_pixels=pixels, display=0.1)
    plan = make_plan(a_rig, Settings())
    largest = 0.0
    for limit in LIMITS:
        walk = Walk(plan, limit)
        found = finish(walk.box())
        print(f"\n{f'{limit:g} arcmin, mm':<15} {'eye box':>9} {'walk':>9}")
        for name, (axis, sign, _), end, is_open in zip(
            NAMES, WAYS, found.ends, found.is_open, strict=True
        ):
            if is_open:
                print(f"{name:<15} {1e3 * end:9.2f} {'open':>9}", flush=True)
                continue
            way = sign * np.eye(3)[axis]
            walked = walked_to(walk, STEP * end * way) * STEP * end
            largest = max(largest, abs(end - walked) / walked)
            print(f"{name:<15} {1e3 * end:9.2f} {1e3 * walked:9.2f}", flush=True)
    return mark("ends", largest < MOST_BESIDE)


def walked_to(walk: Walk, step: np.ndarray) -> int:
    """How many steps a head goes before the limit is passed, or too little is seen."""
    n = 0
    while finish(walk.part((n + 1) * step)) <= 1:
        n += 1
    return n


def ways_to_show(a_rig: Rig, viewers: list[Viewer]) -> dict[str, list[Look]]:
    """For whom the display shows the picture: with no glass in the way, the viewer, all of them."""
    settings = Settings()
    plan = make_plan(a_rig, settings)
    bare = make_plan(without_glass(a_rig), replace(settings, only_through_glass=False))
    return {
        "uncompensated": [Look(bare, 1.0)],
        "for the middle": [Look(plan, 1.0)],
        "for all": [Look(plan.seen_by(viewer), 1.0) for viewer in viewers],
    }


def print_off(name: str, ways: dict[str, list[Look]], head: Viewer) -> list[float]:
    """A line of a table, without its end; the means, arcmin."""
    print(f"{name:<15}", end=" ")
    means = []
    for solved in ways.values():
        plan = ways["for the middle"][0].plan
        shown = finish(places_shown(solved, grid_of(7)))
        (off,) = finish(off_by(plan, [head], grid_of(7), shown))
        off = off[np.isfinite(off)]
        mean, largest = (off.mean(), off.max()) if len(off) else (np.nan, np.nan)
        means.append(float(mean))
        print(f"{len(off):4d} {mean:8.3f} {largest:8.3f}", end=" ")
    return means


def lines(reports: tuple[ViewerReport, ...]) -> Iterator[str]:
    """A table of reports."""
    yield (
        f"{'viewer, mm':<12} {'cover':>6} {'points':>7} {'mean px':>8} {'largest':>8}"
        f" {'arcmin':>7} {'largest':>8} {'dB':>6} {'left':>7}"
    )
    for r in reports:
        yield (
            f"{r.viewer:<12} {100 * r.coverage:5.1f}% {r.n_points:7d} {r.mean_px:8.3f}"
            f" {r.largest_px:8.3f} {r.mean_arcmin:7.2f} {r.largest_arcmin:8.2f} {r.psnr:6.2f}"
            f" {r.unremovable:7.4f}"
        )


def predicted_beside_seen(solution: Solution, number: int) -> float:
    """Mean distance, viewer px, of the dots as a viewer sees them from where they are predicted."""
    channel = solution.channels[number]
    seen, straight = displaced(solution, number)
    dots = dot_centroids(channel.seen(solution.source)) - dot_centroids(channel.ideal())
    off = np.linalg.norm(dots.reshape(-1, 2) - (seen - straight), axis=1)
    return float(np.nanmean(off)) if np.isfinite(off).any() else float("nan")


def mark(name: str, is_met: bool) -> bool:
    """Tell whether a mark is met."""
    print(f"mark {name}: {'met' if is_met else 'MISSED'}", flush=True)
    return bool(is_met)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=1, help="of each solve that is timed")
    parser.add_argument("--pixels", type=int, default=256, help="of viewers and display, each way")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=("growth", "agree", "conflict", "settled", "pair", "beside", "box", "ends"),
        metavar="TABLE",
    )
    parser.add_argument("--cycles", action="store_true", help="beside renders, instead")
    arguments, rest = parser.parse_known_args()
    if arguments.cycles:
        sys.exit(run_in_newest_blender("bench.eyes_in_cycles", *rest))
    if rest:
        parser.error(f"unknown: {' '.join(rest)}")

    tables = {
        "growth": lambda: growth(arguments.runs, arguments.pixels),
        "agree": agree,
        "conflict": lambda: conflict(arguments.pixels),
        "settled": lambda: settled(arguments.pixels),
        "pair": lambda: pair(arguments.pixels),
        "beside": lambda: beside(arguments.pixels),
        "box": lambda: box(arguments.pixels),
        "ends": lambda: ends(arguments.pixels),
    }
    are_met = [table() for name, table in tables.items() if name in (arguments.only or tables)]
    sys.exit(0 if all(are_met) else 1)


if __name__ == "__main__":
    main()
