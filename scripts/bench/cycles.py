"""Where the light of each viewer pixel lands, beside Cycles, through glass as artists bring it.

`python3 scripts/dev.py cycles [--glass NAME ...] [--surface CHOICE ...] [--pixels N]`. Add Rig sets
each glass up, and Cycles traces the middle of each viewer pixel, in single precision. Differences
in display px, of 512. `apart` is the share of rays that arrive in Cycles and land more than a pixel
elsewhere or nowhere in Kiriko: pixels on a border between two ways. `compared` is the share of
Kiriko's light that arrives in Cycles, too. `gaps` and `normals` are the shares of Kiriko's light
that goes in or out by a gap in open glass, and that is bent by normals which contradict their
faces, as the result tells them; then 95 % and `apart` without both. Light beside the glass does not
count. Where faces are curved, Cycles sees them cut into as many triangles as memory allows.
"""

from __future__ import annotations

import argparse
from collections import defaultdict

import bpy
import numpy as np
from mathutils import Matrix

from fuzz.run import compared, how_far
from kiriko.core.blender.scene import read
from known.registered import registered

from .brought_glass import GLASSES, INDICES, SIZE, add_glass_option, fitting
from .irregular import CHOICES


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_glass_option(parser)
    parser.add_argument(
        "--surface",
        nargs="+",
        choices=CHOICES,
        default=["facets", "automatic"],
        help="only these choices",
    )
    parser.add_argument(
        "--pixels", type=int, default=256, metavar="N", help="of the viewer, across"
    )
    arguments = parser.parse_args()
    registered()

    rows = [
        f"{'glass':<16}{'surface':>10}{'median px':>11}{'95 % px':>9}"
        f"{'apart %':>9}{'compared %':>12}{'gaps %':>9}{'normals %':>11}"
        f"{'95 % px':>9}{'apart %':>9}"
    ]
    for name in arguments.glass:
        for choice in arguments.surface:
            scene = set_up(name, choice, arguments.pixels)
            found = compared(scene, read(bpy.context.evaluated_depsgraph_get(), scene))
            is_glass = found.is_glass
            is_told = found.by_gap | found.by_odd_normal
            of_all, of_rest = (
                defaultdict(
                    lambda: np.nan,
                    how_far(found.is_ours & some, found.is_theirs & some, found.off) or {},
                )
                for some in (is_glass, is_glass & ~is_told)
            )
            is_ours = found.is_ours & is_glass
            gaps, odd = (100 * some[is_ours].mean() for some in (found.by_gap, found.by_odd_normal))
            told = f"{of_all['median']:11.4f}{of_all['most']:9.4f}{100 * of_all['apart']:9.2f}"
            told += f"{100 * of_all['both']:12.1f}{gaps:9.2f}{odd:11.2f}"
            told += f"{of_rest['most']:9.4f}{100 * of_rest['apart']:9.2f}"
            rows.append(f"{name:<16}{choice:>10}{told}")

    print("", *rows, sep="\n")  # apart from the lines that Blender prints


def set_up(name: str, choice: str, pixels: int) -> bpy.types.Scene:
    """The scene with a glass, and the rig of Add Rig around it."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    thing = GLASSES[name]()
    thing.matrix_world = Matrix.Scale(SIZE, 4) @ fitting(thing)
    thing.kiriko.use_ior = True
    thing.kiriko.ior = INDICES.get(name, 1.49)
    thing.kiriko.surface = choice.upper()
    bpy.context.view_layer.objects.active = thing
    thing.select_set(True)
    # light spreads far behind such glass
    options = {"viewer_resolution": pixels, "display_resolution": (512, 512), "display_size": 0.3}
    assert bpy.ops.kiriko.add_rig(picture_size=0.035, **options) == {"FINISHED"}
    return bpy.context.scene


if __name__ == "__main__":
    main()
