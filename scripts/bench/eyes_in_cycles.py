"""Where several viewers see the dots of the lattice, as predicted and in Cycles:
`dev.py eyes --cycles`. Runs inside Blender.

Ball and cube as Add Rig sets them up, two eyes and heads on a 3 x 3 grid by the buttons of the
panel. One sharp source image is made for all of them, and rendered for each: shown and predicted
displacements are px of an image in which the lattice is 1165 px wide.

`pair`: at which depth the two eyes see the dots, mm before the picture's plane, and by how many
arcmin the left eye sees them higher, from the dots of both eyes' renders and as predicted: means,
and by how much they are off; see pair_in_cycles.py.
"""

import argparse
import math
import sys
from collections.abc import Callable

import bpy
import numpy as np

from kiriko.core.base.steps import finish
from kiriko.core.blender.scene import read
from kiriko.core.lab.measure.viewer_errors import displaced
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known.registered import registered
from paper.lattice import measuring_width, shift_in_cycles

from .pair_in_cycles import pairs

SETTINGS = Settings(disagreement="sharp")
MOST_OFF = 0.05  # px of 1165, mean over the dots that both show


def ball() -> None:
    """Nothing is selected: Add Rig makes its own ball."""


def cube() -> None:
    """The paper's cube, turned by 15.8 degrees."""
    bpy.ops.mesh.primitive_cube_add(size=0.05, rotation=(0, 0, math.radians(15.8)))
    bpy.context.object.kiriko.use_ior, bpy.context.object.kiriko.ior = True, 1.49


GLASSES = {"ball": ball, "cube": cube}


def two_eyes() -> None:
    """Of 65 mm."""
    bpy.ops.kiriko.two_eyes()


def grid() -> None:
    """Of 60 mm."""
    bpy.ops.kiriko.viewer_grid(heads=(3, 3, 1), box=(0.06, 0.06, 0.0))


PAIR = "pair"
VIEWERS = {"two eyes": two_eyes, "3 x 3": grid, PAIR: two_eyes}


def set_up(
    add_glass: Callable[[], None], add_viewers: Callable[[], None], pixels: int
) -> bpy.types.Scene:
    """A rig around a glass, and who looks at it."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    add_glass()
    bpy.ops.kiriko.add_rig(
        field=0.05, picture_size=0.03, display_size=0.08, display_resolution=(pixels, pixels)
    )
    add_viewers()
    return bpy.context.scene


def seen_by_pair(scene: bpy.types.Scene) -> bool:
    """Print a line for each way to show the picture; is all as predicted?"""
    print(
        "shown for       dots   depth  core's   off mm  largest  vertical  core's  off '  largest"
    )
    is_right = True
    for pair in pairs(scene):
        depths, verticals = (
            [np.abs(one[pair.is_known]).mean() for one in both]
            for both in (1e3 * pair.depth, pair.vertical)
        )
        (off, largest), (off_up, largest_up) = (
            (values.mean(), values.max()) for values in pair.off * [[1e3], [1]]
        )
        is_right &= pair.is_as_predicted
        print(
            f"{pair.way:<15}{pair.is_known.sum():5}{depths[0]:8.3f}{depths[1]:8.3f}{off:9.4f}"
            f"{largest:9.4f}{verticals[0]:10.4f}{verticals[1]:8.4f}{off_up:8.4f}{largest_up:9.4f}"
            f"  {'met' if pair.is_as_predicted else 'MISSED'}",
            flush=True,
        )
    return is_right


def compared(scene: bpy.types.Scene, from_number: int) -> bool:
    """Print a line for each viewer, from one of them on; are all of them as predicted?"""
    print("viewer                  dots   moved px  largest   off px  largest")
    session = Session()
    is_right = True

    are_on = [number for number, one in enumerate(scene.kiriko.viewers) if one.is_on]
    for number in are_on[from_number - 1 :]:
        scene.kiriko.viewer_shown = number  # the rig's first, which Cycles looks from
        bpy.context.view_layer.update()
        reading = read(bpy.context.evaluated_depsgraph_get(), scene)
        solution = finish(session.solve(reading.rig, SETTINGS))

        ideal, seen = solution.ideal(), solution.seen()
        scale = measuring_width(reading, ideal) / reading.rig.viewer.width
        shown = shift_in_cycles(scene, reading, solution.source, ideal, seen).shift.reshape(-1, 2)
        there, straight = displaced(solution, 0)
        predicted = scale * (there - straight)
        off = np.linalg.norm(shown - predicted, axis=1)
        off = off[np.isfinite(off)]
        moved = np.linalg.norm(predicted, axis=1)
        is_met = len(off) > 0 and off.mean() < MOST_OFF
        is_right &= bool(is_met)
        print(
            f"{reading.rig.viewer.name:<22}{len(off):6}{np.nanmean(moved):10.3f}"
            f"{np.nanmax(moved):10.3f}{off.mean():9.4f}{off.max():9.4f}"
            f"  {'met' if is_met else 'MISSED'}",
            flush=True,
        )
    return is_right


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pixels", type=int, default=2048, help="of the display, each way")
    parser.add_argument("--glass", nargs="+", choices=GLASSES, default=list(GLASSES))
    parser.add_argument("--viewers", nargs="+", choices=VIEWERS, default=list(VIEWERS))
    parser.add_argument(
        "--from",
        type=int,
        default=1,
        dest="from_number",
        metavar="N",
        help="go on with the N-th viewer of each list (1)",
    )
    arguments = parser.parse_args()
    registered()
    are_met = []
    for glass in arguments.glass:
        for viewers in arguments.viewers:
            print(f"\n{glass}, {viewers}")
            scene = set_up(GLASSES[glass], VIEWERS[viewers], arguments.pixels)
            are_met.append(
                seen_by_pair(scene) if viewers == PAIR else compared(scene, arguments.from_number)
            )
    sys.exit(0 if all(are_met) else 1)


if __name__ == "__main__":
    main()
